// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/io/checkpoint_scene.hpp>
#include <firn/io/replace_file.hpp>
#include <firn/state/snapshot.hpp>

#include <filesystem>
#include <fstream>
#include <new>
#include <ostream>
#include <sstream>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>

// Checkpoints: a scene in a file, from which another program continues bit by bit.
//
//     write_checkpoint("run.firn", solver, ball, frame); // as often as you like: the newest whole one stays
//     read_checkpoint("run.firn", solver, ball, frame);  // into a solver of the same policies
//
// or, to continue with other parameters of material or transfer,
//
//     auto snapshot = read_snapshot<float, 3>("run.firn", ball, frame);
//     snapshot.forget_parameters();
//     solver.restore(snapshot);
//
// A file of schema 5, or 6 where the lattice is periodic: little-endian, SI units, floats as in IEEE 754,
// nothing between one thing and the next. A text is its length as u32 and so many bytes; `real` is f32 or
// f64.
//
//     preamble, the same in all schemas to come:
//       8 bytes 89 'F' 'I' 'R' 'N' 0d 0a 1a | u32 schema | u32 01020304 hex | u64 bytes of the whole file
//       u32 CRC-32 of all that follows the preamble | u32 CRC-32 of the preamble up to here
//     u32 dimensions | u32 bytes of a real | text kernel | u32 its degree | text transfer | its parameters
//     f64 cell size [m] | 3 f64 origin [m] | f64 time [s]
//     f64 what the last step might have been that filled no duration alone [s] | f64 length of the last [s]
//     bounds of the next step: f64 wave speed | u32 its material | f64 speed [m/s] | f64 deformation rate
//     [1/s]
//       f64 acceleration [m/s^2] | f64 obstacle speed [m/s]
//     f64 unit of mass [kg] | f64 largest | f64 smallest mass in units | u32 next id
//     u32 number of companions, and of each: text kind | u32 bytes | that many bytes
//       of a motion: position, orientation (x, y, z, w), velocity and angular velocity as f64
//         | u8 whether it has a time | f64 time [s], or 0
//     u32 number of materials, and of each:
//       text name | its parameters | f64 density [kg/m^3] | f64 wave modulus at rest [Pa]
//       u64 particles | u32 fields | u64 mass groups
//       of each field: text name | u32 components
//       of each mass group: u32 first row (rank of the id) | f64 mass in units | f64 volume per unit [m^3/kg]
//       u32 id of each particle, in the order of cells
//       i32 cell of each, axis after axis (kernels of even degree: that centred on this node of the lattice,
//         else that behind it)
//       offset of each from the centre of its cell, axis after axis [cells]: f64, or i32 in 2^-30
//       real values of each, component after component of field after field
//     u32 number of particles that were removed from the scene (see Solver::quarantine), and of each:
//       u8 cause (a FailureCause) | u32 id | u32 its material | 3 f64 position [m] | f64 time [s] | f64 step
//       [s] u64 how many failed in that step
//     of schema 6 alone: 3 u32 after how many cells the lattice begins anew along each axis, or 0
//
// Parameters are u32 their number, and of each: text name | f64 value, in its SI unit.
namespace firn
{

namespace detail
{
/// Passes the snapshot in a checkpoint to `take`, and if that accepts it, restores `companions`; `where`
/// names it in errors.
template <class Number, int d, class Take, class... Companions>
void take_checkpoint(CheckpointReader reader, std::string const& where, Take const& take,
                     Companions&... companions)
{
    try {
        Snapshot<Number, d> snapshot;
        auto read = get_checkpoint<Companions...>(reader, snapshot);
        take(snapshot);
        std::tie(companions...) = std::move(read);
    }
    catch (Error const& error) {
        throw Error{error.what_is_wrong(), where + ", " + error.where(), error.remedy()};
    }
    catch (std::bad_alloc const&) {
        throw Error{"there is not enough memory for what the file holds", where,
                    "Read it where there is more."};
    }
}

/// The same for a file.
template <class Number, int d, class Take, class... Companions>
void take_checkpoint(std::filesystem::path const& path, Take const& take, Companions&... companions)
{
    std::ifstream in;
    auto const reader = open_checkpoint(path, in);
    take_checkpoint<Number, d>(reader, path.string(), take, companions...);
}

/// Writes a whole checkpoint to a stream that can be moved in.
template <class SnapshotType, class... Companions>
void write_whole_checkpoint(std::ostream& out, SnapshotType const& snapshot, Companions const&... companions)
{
    CheckpointPreamble preamble;
    preamble.schema = checkpoint_schema_of(snapshot);
    auto const begin = out.tellp();
    auto const put_preamble = [&] {
        out.write(preamble.memory().data(), static_cast<std::streamsize>(preamble.memory().size()));
    };
    put_preamble(); // to be written once more when the rest is known
    CheckpointWriter writer(out);
    put_checkpoint(writer, snapshot, companions...);
    preamble.bytes = sizeof(preamble) + writer.written();
    preamble.checksum = writer.checksum();
    preamble.own_checksum = preamble.find_own_checksum();
    out.seekp(begin);
    put_preamble();
    out.seekp(0, std::ios::end);
}
} // namespace detail

/// Writes all that the next steps of a solver depend on into a file: particles with their ids and all of
/// their fields, the particles that were removed from the scene, time, and what bounds the next step. With it
/// go `companions` of yours: numbers (a frame), Motion, RigidBody, fixed Eigen matrices.
///
/// The solver continues from what was written, also if writing failed: it and a solver that reads the file
/// are the same from then on, bit by bit (see Solver::snapshot). The file is written under another name
/// (`.part`), and renamed when the disk has it, so the last finished one is there and whole at any time. One
/// program at a time writes to a path: another one that tries meanwhile gets an Error. Of several ranks the
/// first one writes, and all of them return when it has.
///
/// The arguments of the constructor and of calls are not in the file; pass them again: material and transfer,
/// the parameters of which are in the file so that other ones are noticed; step control; effects with their
/// shapes; how many particles may be in quarantine. Throws an Error if the file cannot be created or not be
/// written to its end; the previous file is then as it was.
template <class Solver, detail::Companion... Companions>
void write_checkpoint(std::filesystem::path const& path, Solver& solver, Companions const&... companions)
{
    auto const snapshot = solver.snapshot();
    detail::on_first_rank(solver.backend(), [&] {
        detail::replace_file(
            path, [&](std::ostream& out) { detail::write_whole_checkpoint(out, snapshot, companions...); },
            detail::Survives::machine);
    });
}

/// The same in memory, for a host that keeps its own files or sends a state elsewhere: the bytes that a file
/// would have.
template <class Solver, detail::Companion... Companions>
std::string checkpoint_in_memory(Solver& solver, Companions const&... companions)
{
    std::ostringstream out(std::ios::binary);
    detail::write_whole_checkpoint(out, solver.snapshot(), companions...);
    require(bool(out), "there is not enough memory for the checkpoint", "checkpoint_in_memory",
            "Write it into a file.");
    return std::move(out).str();
}

/// Restores a solver and `companions` from the bytes of checkpoint_in_memory() or of a checkpoint's file; see
/// read_checkpoint. Bytes behind the checkpoint are an error, as in a file.
template <class Solver, detail::Companion... Companions>
void restore_from_memory(std::string const& bytes, Solver& solver, Companions&... companions)
{
    std::istringstream in(bytes, std::ios::binary);
    std::string const where = "restore_from_memory";
    detail::take_checkpoint<typename Solver::Number, Solver::d>(
        detail::checked_checkpoint(in, bytes.size(), where), where,
        [&](auto const& snapshot) { solver.restore(snapshot); }, companions...);
}

/// Writes the same to a stream, from where it is. Throws an Error if the stream does not take it.
template <class Solver, detail::Companion... Companions>
void write_checkpoint(std::ostream& out, Solver& solver, Companions const&... companions)
{
    std::string const bytes = checkpoint_in_memory(solver, companions...);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    require(bool(out), "the stream did not take the checkpoint", "write_checkpoint",
            "Open it for writing bytes, and check its place.");
}

/// Restores a solver and `companions` from a stream, which is then behind the checkpoint: others may follow.
template <class Solver, detail::Companion... Companions>
void read_checkpoint(std::istream& in, Solver& solver, Companions&... companions)
{
    restore_from_memory(detail::bytes_of_checkpoint(in), solver, companions...);
}

/// Restores a solver and `companions` from a file. The solver must have the same lattice, policies and
/// parameters, whatever it held before. Step control and backend may be others; with the same backend and
/// lanes the steps that follow are, bit by bit, those of the solver that wrote it.
///
/// Throws an Error, and changes nothing, if the file is no checkpoint, was cut off or damaged, was written by
/// another version, or does not fit: the Error names the kernel, transfer, material, parameter or field that
/// differs. To go on with other parameters see read_snapshot.
template <class Solver, detail::Companion... Companions>
void read_checkpoint(std::filesystem::path const& path, Solver& solver, Companions&... companions)
{
    if constexpr (spans_ranks<std::remove_cvref_t<decltype(solver.backend())>>)
        detail::on_all_ranks(solver.backend(), [&] { // which may not see the same files
            std::ifstream in;
            static_cast<void>(detail::open_checkpoint(path, in));
        });
    detail::take_checkpoint<typename Solver::Number, Solver::d>(
        path, [&](auto const& snapshot) { solver.restore(snapshot); }, companions...);
}

/// The snapshot in a file, of a solver of these numbers and dimensions, and with it `companions`: to inspect
/// or change a state before a solver restores it. To restore it into a solver with other parameters of
/// material and transfer, call `snapshot.forget_parameters()` first.
///
/// Throws an Error, and changes nothing, if the file is no whole checkpoint of such a solver and such
/// companions.
template <class Number, int d, detail::Companion... Companions>
Snapshot<Number, d> read_snapshot(std::filesystem::path const& path, Companions&... companions)
{
    Snapshot<Number, d> taken;
    detail::take_checkpoint<Number, d>(
        path, [&](auto& snapshot) { taken = std::move(snapshot); }, companions...);
    return taken;
}

} // namespace firn

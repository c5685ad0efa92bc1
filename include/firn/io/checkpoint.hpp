// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/io/checksum.hpp>
#include <firn/io/replace_file.hpp>
#include <firn/state/snapshot.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <istream>
#include <limits>
#include <new>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

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
// A file of schema 5: little-endian, SI units, floats as in IEEE 754, nothing between one thing and the next.
// A text is its length as u32 and so many bytes; `real` is f32 or f64.
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
//
// Parameters are u32 their number, and of each: text name | f64 value, in its SI unit.
namespace firn
{

namespace detail
{

static_assert(
    std::endian::native == std::endian::little,
    "checkpoints copy memory into little-endian files; a big-endian machine needs a byte swap here");

inline constexpr std::array<char, 8> checkpoint_magic{'\x89', 'F', 'I', 'R', 'N', '\r', '\n', '\x1a'};
inline constexpr std::uint32_t checkpoint_schema = 5;

/// The first bytes of a checkpoint of any schema.
struct CheckpointPreamble
{
    std::array<char, 8> magic = checkpoint_magic;
    std::uint32_t schema = checkpoint_schema;
    std::uint32_t byte_order = 0x01020304;
    std::uint64_t bytes = 0;    ///< of the file
    std::uint32_t checksum = 0; ///< of what follows
    std::uint32_t own_checksum = 0;

    std::span<char const> memory() const { return {reinterpret_cast<char const*>(this), sizeof(*this)}; }
    std::uint32_t find_own_checksum() const
    {
        Crc32 crc;
        crc.add(memory().first(sizeof(*this) - sizeof(own_checksum)));
        return crc.value();
    }
};
static_assert(sizeof(CheckpointPreamble) == 32 && std::is_trivially_copyable_v<CheckpointPreamble>);

/// Writes values to a stream, and keeps their number of bytes and checksum.
class CheckpointWriter
{
public:
    explicit CheckpointWriter(std::ostream& out) : out_(out) {}

    void bytes(void const* from, std::size_t count)
    {
        std::span<char const> const memory(static_cast<char const*>(from), count);
        crc_.add(memory);
        written_ += count;
        out_.write(memory.data(), static_cast<std::streamsize>(count));
    }
    template <class... Values>
    void values(Values const&... values)
    {
        static_assert((std::is_arithmetic_v<Values> && ...));
        (bytes(&values, sizeof(values)), ...);
    }
    template <class T>
    void all(std::vector<T> const& values)
    {
        bytes(values.data(), values.size() * sizeof(T));
    }
    void text(std::string const& text)
    {
        values(static_cast<std::uint32_t>(text.size()));
        bytes(text.data(), text.size());
    }

    std::uint64_t written() const { return written_; }
    std::uint32_t checksum() const { return crc_.value(); }

private:
    std::ostream& out_;
    std::uint64_t written_ = 0;
    Crc32 crc_;
};

/// Reads a file that has `left` bytes to come, with this checksum. Allocates no more memory than these bytes
/// can fill.
class CheckpointReader
{
public:
    CheckpointReader(std::istream& in, std::uint64_t left, std::uint32_t checksum)
        : in_(in), left_(left), checksum_(checksum)
    {}

    void bytes(void* to, std::uint64_t count)
    {
        expect(count, 1);
        in_.read(static_cast<char*>(to), static_cast<std::streamsize>(count));
        require(bool(in_), "the file could not be read to its end", "read_checkpoint", "Check the disk.");
        left_ -= count;
        crc_.add({static_cast<char const*>(to), static_cast<std::size_t>(count)});
    }
    template <class... Values>
    void values(Values&... values)
    {
        static_assert((std::is_arithmetic_v<Values> && ...));
        (bytes(&values, sizeof(values)), ...);
    }
    template <class T>
    std::vector<T> all(std::uint64_t count)
    {
        static_assert(std::is_arithmetic_v<T>);
        expect(count, sizeof(T));
        std::vector<T> values(count);
        bytes(values.data(), count * sizeof(T));
        return values;
    }
    std::string text()
    {
        std::uint32_t size = 0;
        values(size);
        expect(size, 1);
        std::string text(size, ' ');
        bytes(text.data(), size);
        return text;
    }

    /// Refuses a count of things of at least `size` bytes each that do not fit into the bytes left.
    void expect(std::uint64_t count, std::uint64_t size) const
    {
        require(count <= left_ / size, "the file says that it holds more than it does", "read_checkpoint",
                "It was not written by this library: pass another one.");
    }
    /// Refuses a file that holds more bytes, or other ones than when it was opened.
    void expect_end() const
    {
        require(left_ == 0, "the file holds more than it says", "read_checkpoint",
                "It was not written by this library: pass another one.");
        require(crc_.value() == checksum_, "the file has changed while it was read", "read_checkpoint",
                "Read it while no program writes into it: write_checkpoint never does, it makes a new one.");
    }

private:
    std::istream& in_;
    std::uint64_t left_;
    std::uint32_t checksum_;
    Crc32 crc_;
};

/// A value that travels with a checkpoint: numbers, Motion and RigidBody, and fixed matrices of numbers.
template <class T>
concept Companion = std::is_arithmetic_v<T> || std::is_same_v<T, Motion> || std::is_same_v<T, RigidBody> ||
    (requires { typename T::Scalar; } && std::is_arithmetic_v<typename T::Scalar> &&
     std::is_base_of_v<Eigen::PlainObjectBase<T>, T> && T::SizeAtCompileTime > 0);

/// What a companion is called in the file.
template <Companion T>
std::string kind_of_companion()
{
    if constexpr (std::is_same_v<T, Motion>)
        return "motion";
    else if constexpr (std::is_same_v<T, RigidBody>)
        return "rigid_body";
    else if constexpr (std::is_arithmetic_v<T>)
        return (std::is_floating_point_v<T> ? "f"
                : std::is_signed_v<T>       ? "i"
                                            : "u") +
               std::to_string(8 * sizeof(T));
    else
        return kind_of_companion<typename T::Scalar>() + " " + std::to_string(T::RowsAtCompileTime) + "x" +
               std::to_string(T::ColsAtCompileTime);
}

/// Calls `use(number)` for every number of a companion.
template <class T, class Use>
void for_each_number(T& companion, Use const& use)
{
    using Plain = std::remove_const_t<T>;
    if constexpr (std::is_same_v<Plain, Motion>) {
        for_each_number(companion.position, use);
        for_each_number(companion.orientation.coeffs(), use); // x, y, z, w
        for_each_number(companion.velocity, use);
        for_each_number(companion.angular_velocity, use);
        bool has_time = companion.time.has_value();
        double time = companion.time.value_or(0);
        use(has_time);
        use(time);
        if constexpr (!std::is_const_v<T>) companion.time = has_time ? std::optional(time) : std::nullopt;
    }
    else if constexpr (std::is_same_v<Plain, RigidBody>) {
        use(companion.mass);
        for_each_number(companion.inertia, use);
        for_each_number(companion.motion, use);
    }
    else if constexpr (std::is_arithmetic_v<Plain>)
        use(companion);
    else
        for (Eigen::Index i = 0; i < companion.size(); ++i) use(companion.coeffRef(i)); // column by column
}

template <Companion T>
void put_companion(CheckpointWriter& out, T companion)
{
    std::uint32_t size = 0;
    for_each_number(companion, [&](auto const& number) { size += sizeof(number); });
    out.text(kind_of_companion<T>());
    out.values(size);
    for_each_number(companion, [&](auto const& number) { out.values(number); });
}

template <Companion T>
T get_companion(CheckpointReader& in)
{
    T companion{};
    std::uint32_t size = 0, expected = 0;
    for_each_number(companion, [&](auto const& number) { expected += sizeof(number); });
    std::string const kind = in.text();
    in.values(size);
    if (kind != kind_of_companion<T>() || size != expected)
        throw Error{"the file has a companion of kind '" + kind + "' where '" + kind_of_companion<T>() +
                        "' is asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
    for_each_number(companion, [&]<class Number>(Number& number) {
        if constexpr (std::is_same_v<Number, bool>) {
            std::uint8_t truth = 0;
            in.values(truth);
            if (truth > 1)
                throw Error{
                    "the file has a companion of " + std::to_string(truth) + " where a bool is asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
            number = truth == 1;
        }
        else
            in.values(number);
    });
    return companion;
}

inline void put_parameters(CheckpointWriter& out, std::vector<Parameter> const& parameters)
{
    out.values(static_cast<std::uint32_t>(parameters.size()));
    for (Parameter const& one : parameters) {
        out.text(one.name);
        out.values(one.value);
    }
}

inline std::vector<Parameter> get_parameters(CheckpointReader& in)
{
    std::uint32_t count = 0;
    in.values(count);
    in.expect(count, sizeof(std::uint32_t) + sizeof(double));
    std::vector<Parameter> parameters(count);
    for (Parameter& one : parameters) {
        one.name = in.text();
        in.values(one.value);
    }
    return parameters;
}

template <class Number, int d>
void put_material(CheckpointWriter& out, MaterialSnapshot<Number, d> const& material)
{
    out.text(material.name);
    put_parameters(out, material.parameters);
    out.values(material.density, material.wave_modulus, std::uint64_t(material.ids.size()),
               static_cast<std::uint32_t>(material.fields.size()),
               std::uint64_t(material.mass_groups.size()));
    for (auto const& field : material.fields) {
        out.text(field.name);
        out.values(static_cast<std::uint32_t>(field.components.size()));
    }
    for (auto const& group : material.mass_groups)
        out.values(group.first_row, double(group.mass), double(group.volume));
    out.all(material.ids);
    for (int a = 0; a < d; ++a) {
        std::vector<std::int32_t> along;
        along.reserve(material.cells.size());
        for (auto const& cell : material.cells) along.push_back(cell[a]);
        out.all(along);
    }
    for (auto const& offset : material.offsets) out.all(offset);
    for (auto const& field : material.fields)
        for (auto const& component : field.components) out.all(component);
}

template <class Number, int d>
MaterialSnapshot<Number, d> get_material(CheckpointReader& in)
{
    MaterialSnapshot<Number, d> material;
    using Offset = typename MaterialSnapshot<Number, d>::Offset;
    std::uint64_t particles = 0, mass_groups = 0;
    std::uint32_t fields = 0;
    material.name = in.text();
    material.parameters = get_parameters(in);
    in.values(material.density, material.wave_modulus, particles, fields, mass_groups);
    in.expect(fields, 8);
    for (std::uint32_t i = 0; i < fields; ++i) {
        std::uint32_t components = 0;
        material.fields.push_back({in.text(), {}});
        in.values(components);
        require(components <= d * d, "a field has more components than a matrix", "read_checkpoint",
                "The file was not written by this library: pass another one.");
        material.fields.back().components.resize(components);
    }
    in.expect(mass_groups, sizeof(std::uint32_t) + 2 * sizeof(double));
    for (std::uint64_t i = 0; i < mass_groups; ++i) {
        std::uint32_t first = 0;
        double mass = 0, volume = 0;
        in.values(first, mass, volume);
        constexpr double most = std::numeric_limits<Number>::max();
        require(is_finite(mass) && is_finite(volume) && mass <= most && volume <= most && mass > 0 &&
                    volume > 0,
                "a mass or volume is out of range", "read_checkpoint",
                "The file was not written by this library: pass another one.");
        material.mass_groups.push_back({first, static_cast<Number>(mass), static_cast<Number>(volume)});
    }
    material.ids = in.all<std::uint32_t>(particles);
    material.cells.resize(particles);
    for (int a = 0; a < d; ++a) {
        auto const along = in.all<std::int32_t>(particles);
        for (std::uint64_t i = 0; i < particles; ++i) material.cells[i][a] = along[i];
    }
    for (auto& offset : material.offsets) offset = in.all<Offset>(particles);
    for (auto& field : material.fields)
        for (auto& component : field.components) component = in.all<Number>(particles);
    return material;
}

inline void put_isolated(CheckpointWriter& out, std::vector<StepFailure> const& isolated)
{
    out.values(static_cast<std::uint32_t>(isolated.size()));
    for (auto const& gone : isolated)
        out.values(static_cast<std::uint8_t>(gone.cause), gone.particle,
                   static_cast<std::uint32_t>(gone.material), gone.position.x(), gone.position.y(),
                   gone.position.z(), gone.time, gone.dt, gone.count);
}

inline std::vector<StepFailure> get_isolated(CheckpointReader& in)
{
    std::uint32_t count = 0;
    in.values(count);
    in.expect(count, 57);
    std::vector<StepFailure> isolated(count);
    for (auto& gone : isolated) {
        std::uint8_t cause = 0;
        std::uint32_t material = 0;
        in.values(cause, gone.particle, material, gone.position.x(), gone.position.y(), gone.position.z(),
                  gone.time, gone.dt, gone.count);
        gone.cause = static_cast<FailureCause>(cause);
        gone.material = material;
    }
    return isolated;
}

template <class Number, int d, class... Companions>
void put_checkpoint(CheckpointWriter& out, Snapshot<Number, d> const& from, Companions const&... companions)
{
    out.values(std::uint32_t(d), std::uint32_t(sizeof(Number)));
    out.text(from.kernel);
    out.values(std::uint32_t(from.kernel_degree));
    out.text(from.transfer);
    put_parameters(out, from.transfer_parameters);
    auto const& origin = from.lattice.origin;
    auto const& bounds = from.bounds;
    out.values(from.lattice.cell_size, origin.x(), origin.y(), origin.z(), from.time, from.previous,
               from.last, bounds.wave_speed, std::uint32_t(bounds.material), bounds.speed,
               bounds.deformation_rate, bounds.acceleration, bounds.obstacle_speed, from.masses.unit,
               from.masses.largest, from.masses.smallest, from.next_id, std::uint32_t(sizeof...(Companions)));
    (put_companion(out, companions), ...);
    out.values(static_cast<std::uint32_t>(from.materials.size()));
    for (auto const& material : from.materials) put_material(out, material);
    put_isolated(out, from.isolated);
}

/// Refuses a number other than the one that the solver was compiled for.
inline void require_compiled_for(char const* what, std::uint32_t theirs, std::uint32_t ours)
{
    if (theirs == ours) return;
    throw Error{"the file has " + std::to_string(theirs) + " " + what + ", not " + std::to_string(ours),
                "read_checkpoint",
                "Read it into a solver of the Space that wrote it, or as the snapshot of one."};
}

template <class... Companions, class Number, int d>
std::tuple<Companions...> get_checkpoint(CheckpointReader& in, Snapshot<Number, d>& to)
{
    std::uint32_t dimensions = 0, bytes = 0, degree = 0, material = 0, companions = 0, materials = 0;
    in.values(dimensions, bytes);
    require_compiled_for("dimensions", dimensions, d);
    require_compiled_for("bytes to a number", bytes, sizeof(Number));
    to.kernel = in.text();
    in.values(degree);
    to.transfer = in.text();
    to.transfer_parameters = get_parameters(in);
    auto& origin = to.lattice.origin;
    auto& bounds = to.bounds;
    in.values(to.lattice.cell_size, origin.x(), origin.y(), origin.z(), to.time, to.previous, to.last,
              bounds.wave_speed, material, bounds.speed, bounds.deformation_rate, bounds.acceleration,
              bounds.obstacle_speed, to.masses.unit, to.masses.largest, to.masses.smallest, to.next_id,
              companions);
    to.kernel_degree = static_cast<int>(degree);
    bounds.material = static_cast<int>(material);
    if (companions != sizeof...(Companions))
        throw Error{"the file has " + std::to_string(companions) + " companions, " +
                        std::to_string(sizeof...(Companions)) + " are asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
    std::tuple<Companions...> read{get_companion<Companions>(in)...}; // braces: one after the other
    in.values(materials);
    in.expect(materials, 44); // of a text, two reals and four counts
    for (std::uint32_t i = 0; i < materials; ++i) to.materials.push_back(get_material<Number, d>(in));
    to.isolated = get_isolated(in);
    in.expect_end();
    return read;
}

/// Opens a checkpoint, checks its length and checksums, and returns a reader behind its preamble.
inline CheckpointReader open_checkpoint(std::filesystem::path const& path, std::ifstream& in)
{
    auto const refuse = [&](std::string what, char const* remedy) {
        throw Error{std::move(what), path.string(), remedy};
    };
    require(!path.empty(), "a file has no name", "read_checkpoint", "Pass the path of a checkpoint.");
    std::error_code failed;
    if (std::filesystem::is_regular_file(path, failed)) in.open(path, std::ios::binary | std::ios::ate);
    if (!in.is_open() || !in) refuse("there is no file that can be read", "Pass the path of a checkpoint.");
    auto const bytes = static_cast<std::uint64_t>(in.tellg()); // of the open file, whatever has its name now
    in.seekg(0);
    CheckpointPreamble preamble;
    if (bytes < sizeof(preamble) || !in.read(reinterpret_cast<char*>(&preamble), sizeof(preamble)))
        refuse("the file has " + std::to_string(bytes) + " bytes, too few for a checkpoint",
               "It was cut off, or is none: pass another one.");
    if (preamble.magic != checkpoint_magic)
        refuse("this is no checkpoint", "Pass a file that write_checkpoint has written.");
    char const* const damaged = "Its checksum is wrong. Go on from an older checkpoint.";
    if (preamble.own_checksum != preamble.find_own_checksum())
        refuse("the checkpoint's first bytes are damaged", damaged);
    if (preamble.byte_order != CheckpointPreamble{}.byte_order)
        refuse("the checkpoint has another byte order", "Write it on a little-endian machine.");
    if (preamble.schema != checkpoint_schema)
        refuse("the checkpoint is of schema " + std::to_string(preamble.schema) + ", known here is " +
                   std::to_string(checkpoint_schema),
               preamble.schema > checkpoint_schema
                   ? "It was written by a newer version of this library: read it with that one."
                   : "It was written by an older version of this library: read it with that one.");
    if (preamble.bytes != bytes)
        refuse("the file has " + std::to_string(bytes) + " bytes instead of " +
                   std::to_string(preamble.bytes),
               "It was cut off, or something was added. Go on from an older checkpoint.");
    Crc32 crc;
    std::vector<char> piece(std::size_t(1) << 16);
    for (std::uint64_t left = bytes - sizeof(preamble); left > 0;) {
        auto const next = static_cast<std::size_t>(std::min<std::uint64_t>(left, piece.size()));
        if (!in.read(piece.data(), static_cast<std::streamsize>(next)))
            refuse("the file could not be read to its end", "Check the disk.");
        crc.add({piece.data(), next});
        left -= next;
    }
    if (crc.value() != preamble.checksum) refuse("the checkpoint is damaged", damaged);
    in.seekg(sizeof(preamble));
    return {in, bytes - sizeof(preamble), preamble.checksum};
}

/// Passes the snapshot in a file to `take`, and if that accepts it, restores `companions`.
template <class Number, int d, class Take, class... Companions>
void take_checkpoint(std::filesystem::path const& path, Take const& take, Companions&... companions)
{
    std::ifstream in;
    auto reader = open_checkpoint(path, in);
    try {
        Snapshot<Number, d> snapshot;
        auto read = get_checkpoint<Companions...>(reader, snapshot);
        take(snapshot);
        std::tie(companions...) = std::move(read);
    }
    catch (Error const& error) {
        throw Error{error.what_is_wrong(), path.string() + ", " + error.where(), error.remedy()};
    }
    catch (std::bad_alloc const&) {
        throw Error{"there is not enough memory for what the file holds", path.string(),
                    "Read it where there is more."};
    }
}

} // namespace detail

/// Writes all that the next steps of a solver depend on into a file: particles with their ids and all of
/// their fields, the particles that were removed from the scene, time, and what bounds the next step. With it
/// go `companions` of yours: numbers (a frame), Motion, RigidBody, fixed Eigen matrices.
///
/// The solver continues from what was written, also if writing failed: it and a solver that reads the file
/// are the same from then on, bit by bit (see Solver::snapshot). The file is written under another name
/// (`.part`), and renamed when the disk has it, so the last finished one is there and whole at any time. One
/// program at a time writes to a path: another one that tries meanwhile gets an Error.
///
/// The arguments of the constructor and of calls are not in the file; pass them again: material and transfer,
/// the parameters of which are in the file so that other ones are noticed; step control; effects with their
/// shapes; how many particles may be in quarantine. Throws an Error if the file cannot be created or not be
/// written to its end; the previous file is then as it was.
template <class Solver, detail::Companion... Companions>
void write_checkpoint(std::filesystem::path const& path, Solver& solver, Companions const&... companions)
{
    auto const snapshot = solver.snapshot();
    detail::replace_file(
        path,
        [&](std::ostream& out) {
            detail::CheckpointPreamble preamble;
            auto const put_preamble = [&] {
                out.write(preamble.memory().data(), static_cast<std::streamsize>(preamble.memory().size()));
            };
            put_preamble(); // to be written once more when the rest is known
            detail::CheckpointWriter writer(out);
            detail::put_checkpoint(writer, snapshot, companions...);
            preamble.bytes = sizeof(preamble) + writer.written();
            preamble.checksum = writer.checksum();
            preamble.own_checksum = preamble.find_own_checksum();
            out.seekp(0);
            put_preamble();
        },
        detail::Survives::machine);
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

// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/io/checkpoint.hpp>

// Files that say they are checkpoints: refused, with the solver as it was, or read into a scene like any
// other.
namespace firn::fuzz
{

/// A solver that reads: it holds something already.
template <class Solver>
Solver reader_of_checkpoints()
{
    using Space = typename Solver::Space;
    Solver solver(lattice(0.05), materials::fresh_snow<Space>(), {}, {.smallest = 1e-3});
    using Point = Vector<double, Solver::d>;
    Point near = Point::Constant(0.2), nearer = near;
    near[0] = 0.1, nearer[0] = 0.12;
    solver.add(std::vector<Point>{near, nearer}, 1e-3, Point::Unit(0));
    return solver;
}

/// The bytes with a preamble that fits what follows it, so that the rest is examined.
inline std::vector<std::uint8_t> signed_anew(Bytes bytes)
{
    detail::CheckpointPreamble preamble;
    std::vector<std::uint8_t> whole(sizeof(preamble) + bytes.size());
    detail::Crc32 crc;
    crc.add({reinterpret_cast<char const*>(bytes.data()), bytes.size()});
    preamble.bytes = whole.size();
    preamble.checksum = crc.value();
    preamble.own_checksum = preamble.find_own_checksum();
    std::memcpy(whole.data(), &preamble, sizeof(preamble));
    std::copy(bytes.begin(), bytes.end(), whole.begin() + sizeof(preamble));
    return whole;
}

template <class Solver>
void read_into(TemporaryFile const& file)
{
    Solver solver = reader_of_checkpoints<Solver>();
    RigidBody body;
    int frame = 7;
    auto const untouched = [&] { return frame == 7 && body.mass == 1; };
    bool taken = !refused_whole(solver, [&] { read_checkpoint(file.path(), solver); });
    if (!taken) {
        taken = !refused_whole(solver, [&] { read_checkpoint(file.path(), solver, body, frame); });
        if (!taken) expect(untouched(), "a companion was changed by a file that was refused");
    }
    if (!taken) // with this solver's own parameters, and bounds that are found anew
        taken = !refused_whole(solver, [&] {
            auto snapshot = read_snapshot<typename Solver::Number, Solver::d>(file.path());
            snapshot.forget_parameters();
            solver.restore(snapshot);
        });
    auto const told = expect_whole(solver);
    if (!taken) return;
    // it goes on: steps are made or refused, and what is written is what is read
    TemporaryFile const again(".again.firn");
    write_checkpoint(again.path(), solver);
    expect(Told<Solver>(solver) == told, "writing a checkpoint changed something");
    Solver other = reader_of_checkpoints<Solver>();
    read_checkpoint(again.path(), other);
    expect(Told<Solver>(other) == told, "what was read is not what was written");
    expect(other.isolated().size() == solver.isolated().size(), "others are taken out than were");
    refused([&] { solver.step(1e-6); });
    expect_whole(solver);
    refused([&] { solver.advance(1e-4); });
    expect_whole(solver);
    expect(solver.ids() == told.ids, "a step changed ids");
}

/// Inputs are what follows the preamble of a file; or, where their first byte is 0, a byte and a whole file.
/// (A file has a 2 or a 3 there, the number of dimensions.)
inline void checkpoint(Bytes bytes)
{
    TemporaryFile const file(".firn");
    bool const is_whole = !bytes.empty() && bytes.front() == 0;
    if (is_whole)
        file.write(bytes.subspan(1));
    else
        file.write(signed_anew(bytes));
#if defined(FIRN_FUZZ_ALL)
    std::size_t const dimensions_at = is_whole ? 1 + sizeof(detail::CheckpointPreamble) : 0;
    if (bytes.size() > dimensions_at && bytes[dimensions_at] == 3) return read_into<SnowBall>(file);
#endif
    read_into<Sheet>(file);
}

} // namespace firn::fuzz

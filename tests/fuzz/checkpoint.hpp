// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/io/checkpoint.hpp>

// Files that say they are checkpoints: refused, with the solver as it was, or read into a scene like any
// other.
namespace firn::fuzz
{

/// The solver that reads: it holds something already.
inline Sheet reader_of_checkpoints()
{
    Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>(), {}, {.smallest = 1e-3});
    solver.add(std::vector<Eigen::Vector2d>{{0.1, 0.2}, {0.12, 0.2}}, 1e-3, {1, 0});
    return solver;
}

/// The bytes with a preamble that is right for what follows it, so that it is looked at.
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

/// Inputs are what follows the preamble of a file; or, where their first byte is 0, a byte and a whole file.
/// (A file has a 2 or a 3 there, the number of dimensions.)
inline void checkpoint(Bytes bytes)
{
    TemporaryFile const file(".firn");
    if (!bytes.empty() && bytes.front() == 0)
        file.write(bytes.subspan(1));
    else
        file.write(signed_anew(bytes));
    Sheet solver = reader_of_checkpoints();
    RigidBody body;
    int frame = 7;
    auto const untouched = [&] { return frame == 7 && body.mass == 1; };
    bool taken = !refused_whole(solver, [&] { read_checkpoint(file.path(), solver); });
    if (!taken) {
        taken = !refused_whole(solver, [&] { read_checkpoint(file.path(), solver, body, frame); });
        if (!taken) expect(untouched(), "a companion was changed by a file that was refused");
    }
    auto const told = expect_whole(solver);
    if (!taken) return;
    // it goes on: steps are made or refused, and what is written is what is read
    TemporaryFile const again(".again.firn");
    write_checkpoint(again.path(), solver);
    expect(Told<Sheet>(solver) == told, "writing a checkpoint changed something");
    Sheet other = reader_of_checkpoints();
    read_checkpoint(again.path(), other);
    expect(Told<Sheet>(other) == told, "what was read is not what was written");
    refused([&] { solver.step(1e-6); });
    expect_whole(solver);
    refused([&] { solver.advance(1e-4); });
    expect_whole(solver);
    expect(solver.ids() == told.ids, "a step changed ids");
}

} // namespace firn::fuzz

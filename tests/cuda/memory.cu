// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <cmath>
#include <random>
#include <vector>

namespace
{

/// The most memory that a device has held at any time since this was made.
class MostHeld
{
public:
    MostHeld() { memory().peak[0] = before_; }
    double bytes() const { return static_cast<double>(memory().peak[0] - before_); }

private:
    static on_processor::Memory& memory() { return on_processor::Memory::one(); }
    std::size_t before_ = memory().used[0];
};

/// Bytes per particle: while particles were added, and in all.
struct Bytes
{
    double seeding, all;
};

/// A periodic box full of particles, eight in each cell, somewhere in their eighths: each block has 512. They
/// are added in so many pieces and fall by a tenth of a cell per step: one of ten changes its cell.
template <class Model>
Bytes bytes_per_particle(int pieces)
{
    using Solver = firn::Solver<firn::Cuda, Model>;
    int const cells = 44, side = 2 * cells; // more blocks than those of which a device takes all at once
    double const h = 0.01, dt = 1e-5;
    std::mt19937 random(7);
    auto const unit = [&] { return double(random()) * 0x1p-32; };
    auto space = firn::lattice(h);
    for (int axis = 0; axis < 3; ++axis) space = space.periodic(axis, cells);
    MostHeld const held;
    Solver solver(space);
    for (int piece = 0; piece < pieces; ++piece) {
        std::vector<Eigen::Vector3d> points;
        for (int i = side * piece / pieces; i < side * (piece + 1) / pieces; ++i)
            for (int j = 0; j < side * side; ++j)
                points.push_back(h / 2 * Eigen::Vector3d(i + unit(), j % side + unit(), j / side + unit()));
        solver.add(points, std::pow(h / 2, 3), {0, -0.1 * h / dt, 0});
    }
    auto const count = double(solver.size());
    double const seeding = held.bytes() / count;
    for (int i = 0; i < 3; ++i) solver.step(dt);
    return {seeding, held.bytes() / count};
}

} // namespace

// Two buffers, the order and marks of leavers: 45 bytes (elastic 109). Two tiles of 216 nodes for each block:
// 13.5, nodes 2, cells 3. Leavers are a tenth, with 81 bytes each, and 3 % of that are spare.
TEST_CASE("a device holds no more of a particle than its buffers, its share of the grid, and leavers")
{
    using Water = firn::Fluid<firn::Space<3, float>>;
    using Rubber = firn::NeoHookean<firn::Space<3, float>>;
    CHECK(bytes_per_particle<Water>(1).all <= 74);
    CHECK(bytes_per_particle<Rubber>(1).all <= 138);
    CHECK(bytes_per_particle<Water>(7).seeding <= 56);
}

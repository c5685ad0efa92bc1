// SPDX-License-Identifier: MIT
#pragma once

#include "on_each_backend.hpp"

#include <cmath>
#include <vector>

namespace firn::bench
{

inline int const side = on_a_device ? 128 : 64; // particles along the edges of a block
inline double const h = 0.05;                   // the size of cells [m]

/// A block of x by y by z particles, 8 in each cell, with a corner at the origin.
template <class Model = NeoHookean<Space<3, float>>>
Solver<Backend, Model> block(int x, int y, int z, Model const& model = {})
{
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < x; ++i)
        for (int j = 0; j < y; ++j)
            for (int k = 0; k < z; ++k) points.push_back(h / 2 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5));
    Solver<Backend, Model> solver(lattice(h), model, {}, {}, backend());
    solver.add(points, std::pow(h / 2, 3));
    return solver;
}

} // namespace firn::bench

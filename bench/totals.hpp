// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

#include <numeric>

namespace firn::bench
{

/// Sums over all particles, for what they must not lose.
struct Totals
{
    double mass = 0;                                    ///< [kg]
    Eigen::Vector3d momentum = Eigen::Vector3d::Zero(); ///< [kg m/s]

    template <class Solver>
    explicit Totals(Solver const& solver)
    {
        auto const velocity = solver.template download<Velocity>();
        auto const masses = solver.masses();
        mass = std::accumulate(masses.begin(), masses.end(), 0.0);
        for (std::size_t i = 0; i < masses.size(); ++i)
            momentum += masses[i] * velocity[i].template cast<double>();
    }
};

} // namespace firn::bench

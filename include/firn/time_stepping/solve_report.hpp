// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/space.hpp>
#include <firn/effects/effect.hpp>

#include <vector>

namespace firn
{

/// How implicit steps were solved. Counts are those of the last call of the solver, the rest is of its last
/// step.
struct SolveReport
{
    int newton = 0;         ///< linear systems
    int products = 0;       ///< of them in all: iterations of conjugate gradients
    int passes = 0;         ///< from nodes to particles and back, one for each product and for each residual
    int halvings = 0;       ///< of changes that raised the incremental energy
    int newton_of_step = 0; ///< linear systems of the last step
    double residual = 0;    ///< as a change of velocity, the root of its mean square over the mass [m/s]
    double tolerance = 0;   ///< what it was to be [m/s]
    double largest = 0;     ///< the residual of the node where it is largest [m/s]
    Eigen::Vector3d where{0, 0, 0}; ///< that node [m]
    bool converged = false; ///< the residual is as small; with Implicit::fixed other steps are taken, too
    double error = 0;       ///< of positions in the step, if Implicit::error is above 0: see there [m]

    void begin_step()
    {
        newton_of_step = 0;
        converged = false;
    }
};

/// What Solver::settle did.
struct RestReport
{
    int load_steps = 0;              ///< as many as let no node move by a cell
    SolveReport solve{};             ///< with the counts of all of them
    std::vector<Reaction> reactions; ///< one per obstacle: over a second, so that impulses are forces [N]
};

} // namespace firn

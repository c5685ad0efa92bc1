// SPDX-License-Identifier: MIT
#pragma once

#include <firn/calls_of_rank.hpp>
#include <firn/concepts.hpp>
#include <firn/effects/actions.hpp>
#include <firn/time_stepping/report.hpp>
#include <firn/time_stepping/settle_scene.hpp>
#include <firn/time_stepping/solve_report.hpp>
#include <firn/transfer/integrators.hpp>

#include <concepts>
#include <cstddef>
#include <vector>

// Calls of a Solver that are the same for all, or belong to an integrator.
namespace firn::detail
{

/// Refuses arguments of calls that are not effects with a readable message.
template <class Solver>
class RefusesOthers : public CallsOfRank<Solver>
{
public:
    template <class... Others>
    StepReport step(double, Others const&...)
    {
        require_effects<typename Solver::Real, Solver::d, Others...>();
        return {};
    }
    template <class... Others>
    std::vector<StepReport> steps(std::size_t, double, Others const&...)
    {
        require_effects<typename Solver::Real, Solver::d, Others...>();
        return {};
    }
    template <class... Others>
    AdvanceReport advance(double, Others const&...)
    {
        require_effects<typename Solver::Real, Solver::d, Others...>();
        return {};
    }
};

/// What a solver has by its integrator: nothing more with symplectic Euler.
template <class Solver, class By>
class CallsOfSolver : public RefusesOthers<Solver>
{};

/// What implicit steps have beside: see IMPLICIT.md.
template <class Solver, std::derived_from<Implicit> By>
class CallsOfSolver<Solver, By> : public RefusesOthers<Solver>
{
public:
    /// Brings the scene to rest under its loads: finds the positions in which stress balances what the
    /// effects do, without inertia, in as many load steps as let no node move by a cell. The scene's time
    /// does not pass, and velocities are zero afterwards. Something has to hold the scene.
    ///
    /// Throws an Error if there is no such state to be found. It names the place of the largest residual, or
    /// one that nothing holds; where a particle has no stress to balance anything, it is a StepError that
    /// names this. The state is then that of the last load step that was found.
    template <class... Effects>
    RestReport settle(Effects const&... effects)
    {
        require_effects<typename Solver::Real, Solver::d, Effects...>();
        auto& solver = static_cast<Solver&>(*this);
        RestReport report;
        solver.change("Solver::settle", [&] {
            solver.accept("Solver::settle", effects...);
            report = solver.time_loop_.settle(solver.scene_, effects...);
        });
        return report;
    }

    /// How the steps of the last call were solved.
    SolveReport const& solved() const { return static_cast<Solver const&>(*this).time_loop_.solved(); }
};

} // namespace firn::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/step_error.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/math/product.hpp>
#include <firn/particles/readback.hpp>
#include <firn/time_stepping/finish_step.hpp>
#include <firn/time_stepping/solve_report.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

// Which particles failed in a step, and the errors that report it. `sets` are the MaterialSets of a scene, in
// the state before the step, which began at `time` [s] and was `dt` [s] long.
namespace firn::detail
{

/// The failure of the particle in a row.
template <std::size_t k, class Sets>
StepFailure failure_of(Sets const& sets, std::uint32_t row, FailureCause cause, double time, double dt,
                       std::uint64_t count)
{
    auto const& particles = sets.template particles<k>();
    StepFailure failure{
        .cause = cause, .particle = particles.id(row), .material = k, .time = time, .dt = dt, .count = count};
    failure.position = in_space<Sets::d>(position_of(particles, row));
    if (Lattice const& lattice = particles.lattice(); lattice.half_world != 0)
        failure.world = WorldLayout<Sets::d>::of(lattice).world_of(cell_of(particles, row));
    return failure;
}

/// The failure in the log of a step.
template <class Sets>
StepFailure failure_of(Sets const& sets, StepLog const& log, double time, double dt)
{
    StepFailure failure;
    Sets::for_each([&](auto k) {
        if (static_cast<std::size_t>(log.material) == k)
            failure = failure_of<k>(sets, log.particle, log.cause, time, dt, log.failed);
    });
    return failure;
}

/// Particles whose own state has no finite stress at zero velocity gradient, `most` + 1 of them at most. They
/// contaminate what others gather from the grid, so that the first failed particle of a step may be another
/// one.
template <class Sets>
FIRN_COLD std::vector<StepFailure> without_stress(Sets const& sets, std::size_t most, double time, double dt)
{
    std::vector<StepFailure> found;
    Sets::for_each([&](auto k) {
        std::vector<std::pair<std::uint32_t, FailureCause>> rows; // particles come in any order
        for_each_particle(sets.template particles<k>(), [&](std::uint32_t row, auto& particle) {
            auto const response = sets.template response<k>(particle);
            bool const finite =
                all_finite(response.kirchhoff_stress) && is_finite(double(response.wave_modulus));
            if (response.inverted || !finite)
                rows.emplace_back(row, finite ? FailureCause::inverted : FailureCause::not_finite);
        });
        std::ranges::sort(rows);
        for (auto const& [row, cause] : rows)
            if (found.size() <= most) found.push_back(failure_of<k>(sets, row, cause, time, dt, 1));
    });
    for (auto& failure : found) failure.count = found.size();
    return found;
}

/// The particle whose own velocity or waves go furthest in a step, if that is more than a cell: it makes
/// others fail by way of the grid. Otherwise the particle in the log. `values(tag, k)` returns a field's
/// values for a material, by row.
template <class Sets, class Values>
[[gnu::cold]] StepFailure furthest_in(Sets const& sets, StepLog const& log, Values const& values,
                                      double cell_size, double time, double dt)
{
    StepFailure found = failure_of(sets, log, time, dt);
    double furthest = cell_size;
    Sets::for_each([&](auto k) {
        auto const velocities = values(Velocity{}, k);
        std::optional<std::uint32_t> worst;
        for_each_particle(sets.template particles<k>(), [&](std::uint32_t row, auto& particle) {
            auto const response = sets.template response<k>(particle);
            double const way = dt * std::max(double(norm(velocities[row])),
                                             sets.template wave_speed<k>(double(response.wave_modulus)));
            bool const is_tie = worst && exactly_equal(way, furthest); // particles come in any order
            if (!(way > furthest) && !(is_tie && row < *worst)) return;
            furthest = way;
            worst = row;
        });
        if (worst) found = failure_of<k>(sets, *worst, log.cause, time, dt, log.failed);
    });
    return found;
}

/// The log of a step in which an obstacle would have received more than its reaction can hold, with the
/// particle that is fastest along an axis, as far as velocities are known after such a step.
template <class Sets, class Values>
[[gnu::cold]] StepLog with_fastest(Sets const& sets, StepLog log, Values const& values)
{
    double fastest = -1;
    Sets::for_each([&](auto k) {
        constexpr bool is_stored = Sets::template MaterialTraits<k>::Stored::template contains<Velocity>;
        auto const& particles = sets.template particles<k>();
        auto const admit = [&](std::uint32_t row, double speed) {
            if (!(speed > fastest)) return;
            fastest = speed;
            log.material = static_cast<int>(k);
            log.particle = row;
        };
        if (particles.size() == 0) return;
        admit(0, 0);
        if (!is_stored && !particles.has_grid_fields()) return;
        auto const velocities = values(Velocity{}, k);
        for (std::uint32_t row = 0; row < particles.size(); ++row)
            for (int a = 0; a < Sets::d; ++a) // squares might overflow
                admit(row, std::abs(double(velocities[row][a])));
    });
    return log;
}

/// The log of an implicit step that was not solved, with the particle that is nearest to a place [m].
template <class Backend, class Sets>
[[gnu::cold]] StepLog with_nearest(Backend const& backend, Sets const& sets, StepLog log,
                                   Eigen::Vector3d const& place)
{
    struct Found
    {
        double away;
        std::uint32_t material, row;
        bool is_before(Found const& other) const // particles come in any order
        {
            return std::tie(away, material, row) < std::tie(other.away, other.material, other.row);
        }
    };
    Found nearest{std::numeric_limits<double>::infinity(), 0, 0};
    auto const admit = [&](Found const& found) {
        if (found.is_before(nearest)) nearest = found;
    };
    Sets::for_each([&](auto k) {
        for_each_position(sets.template particles<k>(), [&](std::uint32_t row, auto const& x) {
            admit({norm(Eigen::Vector3d(in_space<Sets::d>(x) - place)), std::uint32_t(k), row});
        });
    });
    for (Found const& of_rank : of_all_ranks(backend, std::vector<Found>{nearest})) admit(of_rank);
    log.material = static_cast<int>(nearest.material);
    log.particle = nearest.row;
    return log;
}

/// How far the solve of an implicit step came, in words.
[[gnu::cold]] inline std::string in_words(SolveReport const& solve, int d)
{
    std::ostringstream text;
    text << "After " << solve.newton_of_step << " linear systems the residual was " << solve.residual
         << " m/s, where " << solve.tolerance << " m/s was asked for, and largest "
         << at_place(solve.where, d) << " with " << solve.largest << " m/s";
    return text.str();
}

/// The particle whose own state bounds the step to `stable` [s] or less, up to rounding; none if there is no
/// such particle.
template <class Sets, class Controller, class Values>
[[gnu::cold]] std::optional<StepFailure> slowest_in(Sets const& sets, Controller controller,
                                                    Values const& values, double stable, double time,
                                                    double dt)
{
    controller.acceleration = controller.obstacle_speed = 0;
    controller.field = std::numeric_limits<double>::infinity();
    double shortest = 1.001 * stable;
    std::optional<StepFailure> found;
    Sets::for_each([&](auto k) {
        std::vector<StepBounds> bounds;
        for (auto const& velocity : values(Velocity{}, k))
            bounds.push_back({.material = static_cast<int>(k), .speed = double(norm(velocity))});
        if constexpr (Sets::template MaterialTraits<k>::State::template contains<AffineVelocity>) {
            auto const rates = values(AffineVelocity{}, k);
            for (std::size_t row = 0; row < rates.size(); ++row)
                bounds[row].deformation_rate = double(norm(rates[row]));
        }
        std::optional<std::uint32_t> slowest;
        FailureCause cause{};
        for_each_particle(sets.template particles<k>(), [&](std::uint32_t row, auto& particle) {
            auto const response = sets.template response<k>(particle);
            bounds[row].wave_speed = sets.template wave_speed<k>(double(response.wave_modulus));
            double const step = controller.stable(bounds[row].finite()).dt;
            bool const is_tie = slowest && exactly_equal(step, shortest);
            if (!(step < shortest) && !(is_tie && row < *slowest)) return;
            shortest = step;
            slowest = row;
            cause = response.inverted                           ? FailureCause::inverted
                    : !is_finite(double(response.wave_modulus)) ? FailureCause::not_finite
                                                                : FailureCause::stalled;
        });
        if (slowest) found = failure_of<k>(sets, *slowest, cause, time, dt, 1);
    });
    return found;
}

/// Throws for a failed step where the stable one is `stable` [s]. `material` is MaterialSets' name for the
/// particle's material, `kept` says what state is left, `d` is the number of coordinates.
[[noreturn, gnu::cold]] inline void throw_step_error(StepFailure const& failure, double stable,
                                                     std::string const& material, std::string const& kept,
                                                     int d)
{
    std::ostringstream what, where, remedy;
    what << "particle " << failure.particle << material << " " << describe(failure.cause);
    if (failure.count > 1) what << ", as did " << failure.count - 1 << " more";
    where << at_place(failure, d) << ", in a step of " << failure.dt << " s at t = " << failure.time << " s";
    remedy << kept << ". ";
    if (failure.dt > stable && std::isnormal(stable))
        remedy << "Take a smaller step: the stable one is " << stable << " s, and advance() takes such.";
    else
        remedy << "Take a smaller step, or look at what drives this particle: obstacles that close in on it, "
                  "or a material far too stiff or too soft for its speed.";
    throw StepError{failure, what.str(), where.str(), remedy.str()};
}

/// Throws where no state of rest is found because of a particle that has no stress.
[[noreturn, gnu::cold]] inline void throw_without_stress(StepFailure const& failure,
                                                         std::string const& material, int d)
{
    std::ostringstream what;
    what << "particle " << failure.particle << material << " " << describe(failure.cause)
         << ", so it has no stress that could balance a load";
    throw StepError{
        failure, what.str(), "Solver::settle, " + at_place(failure, d),
        "The state is that of the last load step that was found. Remove such particles (remove_if), "
        "or upload a DisplacementGradient with det F > 0 that the material can bear."};
}

/// Throws where no step advances time any more, as the chosen one shows. `since` is the particle that causes
/// it, if known; the rest is as for throw_step_error.
[[noreturn, gnu::cold]] inline void throw_no_step(TimeState const& time_state,
                                                  std::optional<StepFailure> const& since,
                                                  std::string const& material, int d)
{
    std::ostringstream what, where, remedy;
    what << "the stable time step fell to " << time_state.now.interval.length()
         << " s, too little of the duration, bounded by " << describe(time_state.now.limit);
    where << "Solver::advance at t = " << time_state.time << " s";
    remedy << "Check masses, moduli and velocities of the scene: wave speed " << time_state.bounds.wave_speed
           << " m/s, fastest particle " << time_state.bounds.speed
           << " m/s. Fast obstacles, viscous stress and what the transfer carries (Conduction) bound "
              "steps, too. Where the step is as long as it should be, pass a shorter duration.";
    if (!since) throw Error{what.str(), where.str(), remedy.str()};
    what << ", since particle " << since->particle << material << " " << describe(since->cause);
    where << ", " << at_place(*since, d);
    throw StepError{*since, what.str(), where.str(), remedy.str()};
}

} // namespace firn::detail

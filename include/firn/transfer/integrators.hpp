// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/transfer/node_fields.hpp>
#include <firn/transfer/transfer.hpp>

#include <concepts>
#include <type_traits>

// How a step finds the velocities of nodes: the integrators, and a transfer scheme that steps by another one
// than symplectic Euler. See IMPLICIT.md.
namespace firn
{

/// Stress acts on nodes as it is when the step begins, and velocities move particles as they are at its end:
/// the explicit step of the Material Point Method, which is stable up to the time of a wave through a cell.
struct SymplecticEuler
{
    static constexpr auto name = "symplectic_euler";
};

/// Backward Euler: stress acts as it is at the end of the step, so no wave bounds the length of a step. The
/// velocities of nodes are found by Newton's method, whose linear systems preconditioned conjugate gradients
/// solve without a matrix (see time_stepping/solve_step.hpp).
struct Implicit
{
    /// Newton stops where the residual, as the change of velocity that would remove it, is below this
    /// [m/s]: the root of its mean square over the mass. In Solver::settle it is the change in a second. 0:
    /// `share` of a scale of the scene. Neither asks for less than rounding leaves.
    double tolerance = 0;
    /// Of the change of velocity by outside forces in the step, or of a hundredth of the mean speed, if that
    /// is more. In Solver::settle a hundredth of this share is asked for.
    double share = 1e-2;
    /// Conjugate gradients stop where their residual is below this share of the one that they began with, or
    /// below 0.3 of that in small scenes, whose directions are kept: see KeptDirections.
    double forcing = 0.1;
    int newton = 20;    ///< the most linear systems in a step; one more is a failed step
    int linear = 2000;  ///< the most products in a linear system; what is found until then is tried
    bool coarse = true; ///< whether coarser grids precondition linear systems, too, or earlier directions
    /// The error of positions in a step of Solver::advance [m], the root of its mean square over the mass, as
    /// far as it is known from the trapezoidal rule, dt |v - v_before| / 2. Steps are as long as it allows;
    /// one with twice as much is repeated. 0: any.
    double error = 0;
    /// How many linear systems a step of Solver::advance may take before the next one is shorter, by the root
    /// of their ratio. Steps that take fewer let the next one grow. 0: any number.
    int target = 10;
    /// For real time: each step solves exactly `newton` linear systems by exactly `linear` products each, and
    /// is taken whatever residual is left, which Solver::solved() has. Fewer where rounding alone is left.
    /// `forcing` and `target` choose numbers of iterations, so they have no effect then.
    /// One in which a particle would be turned inside out, or not be finite, is a failed step all the same.
    bool fixed = false;

    static constexpr int most_fixed = 1000; ///< products in a step of a fixed number
    static constexpr auto name = "implicit";
    static constexpr double part_of_step = 1; ///< at which stress acts: its end

    /// Throws an Error if a number is out of its range.
    void validate() const
    {
        auto const keep = [](bool good, char const* what, char const* remedy) {
            require(good, what, "Implicit", remedy);
        };
        keep(is_finite(tolerance) && tolerance >= 0, "the tolerance is not a finite number, 0 or above",
             "Pass m/s, or 0 for a share of what outside forces do.");
        keep(is_finite(share) && share > 0 && share < 1, "the share is outside (0, 1)", "Pass e.g. 1e-2.");
        keep(is_finite(forcing) && forcing > 0 && forcing < 1, "forcing is outside (0, 1)",
             "Pass a share of the residual, e.g. 0.1.");
        keep(newton > 0, "no linear system may be solved", "Pass the most of a step, e.g. 20.");
        keep(linear > 0, "no product may be computed", "Pass the most of a linear system, e.g. 2000.");
        keep(is_finite(error) && error >= 0, "the error is not a finite number, 0 or above",
             "Pass metres in a step, or 0 for steps of any error.");
        keep(target >= 0, "the target is below 0",
             "Pass the linear systems from which on steps are shorter, e.g. 10, or 0 for any number.");
        keep(!fixed || double(newton) * linear <= most_fixed,
             "a step of a fixed number of iterations has more than a thousand products",
             "Set the linear systems of each step and the products of each system, e.g. .newton = 1 and "
             ".linear = 10: they are exact where `fixed` is true.");
        keep(!fixed || !(error > 0), "a step of a fixed number of iterations is not repeated for its error",
             "Leave `error` 0, or `fixed` false.");
    }
};

/// The implicit midpoint rule, of second order: stress acts as it is in the middle of the step, whose
/// velocities move and deform particles, and those at the end are as far beyond. It is backward Euler for
/// half the step, and keeps the energy of small vibrations (Love & Sulsky 2006).
struct ImplicitMidpoint : Implicit
{
    static constexpr auto name = "implicit_midpoint";
    static constexpr double part_of_step = 0.5;

    void validate() const
    {
        Implicit::validate();
        require(!(error > 0), "the error of a step is not known by the midpoint rule", "ImplicitMidpoint",
                "Leave it 0, or choose Implicit.");
    }
};

/// What an integrator of a Solver has to be.
template <class T>
concept Integrator = std::same_as<T, SymplecticEuler> || std::derived_from<T, Implicit>;

/// A transfer scheme whose steps are implicit: its particles scatter mass and momentum without the impulse of
/// their stress, which the solve finds for the end of the step.
template <class Base, class By>
struct SteppedImplicitly : Base
{
    using Explicit = Base;
    using Integrator = By;

    By integrator;

    SteppedImplicitly() = default;
    SteppedImplicitly(Base const& base, By const& by = {}) : Base(base), integrator(by) {}

    void validate() const
    {
        if constexpr (requires(Base const& base) { base.validate(); }) Base::validate();
        integrator.validate();
    }

    /// What the scheme itself scatters for a particle without stress.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d> scatter(Particle const& particle, Real mass,
                                                           Matrix<Real, d> const&, Real cell_size) const
    {
        return Base::template scatter<Kernel, Real, d>(particle, mass, zeros<Matrix<Real, d>>(), cell_size);
    }

    /// What the scheme itself gathers. If nodes hold velocities of the middle of the step, those at its end
    /// are as far beyond them as the old ones are before them.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        if constexpr (By::part_of_step < 1) {
            Gathered<Real, d> at_end = gathered;
            at_end.velocity = gathered.velocity * Real(2) - gathered.old_velocity;
            return Base::template gather<Kernel, Real, d>(particle, at_end, inverse_cell_size);
        }
        else
            return Base::template gather<Kernel, Real, d>(particle, gathered, inverse_cell_size);
    }
};

/// Whether a transfer scheme's steps are implicit.
template <class Transfer>
concept StepsImplicitly = requires
{
    typename Transfer::Explicit;
    requires std::derived_from<Transfer,
                               SteppedImplicitly<typename Transfer::Explicit, typename Transfer::Integrator>>;
};

namespace detail
{
template <class Transfer, class By>
struct SteppedByIntegrator
{
    using Type = Transfer;
};
template <class Transfer, std::derived_from<Implicit> By>
struct SteppedByIntegrator<Transfer, By>
{
    static_assert(!ExtendsVelocities<Transfer>,
                  "Xpic extends velocities that an implicit step has not found yet: choose another transfer, "
                  "or SymplecticEuler");
    static_assert(Transfer::moves_with_grid,
                  "an implicit step moves particles with the grid, and this transfer moves them by "
                  "velocities of their own: choose another one, or SymplecticEuler");
    static_assert(
        By::part_of_step >= 1 || Transfer::keeps_old_velocity,
        "the midpoint rule needs the velocity before the step where particles gather: choose Flip, or "
        "Implicit");
    using Type = SteppedImplicitly<Transfer, By>;
};
} // namespace detail

/// A transfer scheme in the steps of an integrator; with SymplecticEuler the scheme itself.
template <class Transfer, Integrator By>
using SteppedBy = typename detail::SteppedByIntegrator<Transfer, By>::Type;

/// What nodes hold beside a transfer's values while an implicit step is solved, from channel `first` on. The
/// node's velocity itself is the one that particles are to gather: one to try, or a direction of search.
template <int d, class Set, int first>
struct SolveValues
{
    static constexpr int solution = first;           ///< the velocity found so far [m/s]
    static constexpr int target = solution + d;      ///< that without stress; at rest, its change in a second
    static constexpr int impulse = target + d;       ///< of stress, at the velocity that was tried
    static constexpr int change = impulse + d;       ///< of the solution, by the linear system [m/s]
    static constexpr int residual = change + d;      ///< what is left of the linear system's right side
    static constexpr int conditioned = residual + d; ///< the same, preconditioned
    static constexpr int friction = conditioned + d; ///< its impulse, along motion that is free
    static constexpr int free = friction + d;        ///< the projection to free motion, symmetric
    static constexpr int behind =
        free + d * (d + 1) / 2; ///< the impulse of stress behind walls, by axis and side
    static constexpr int mass = behind + 2 * d;
    static constexpr int stiffness = mass + 1; ///< the diagonal by which the system is preconditioned
    static constexpr int channels = stiffness + 1 - first; ///< 23 in the plane, 35 in space

    /// Whether the value of a channel has the opposite sign in a mirror across an axis.
    FIRN_HOST_DEVICE static constexpr bool turns(int c, int axis)
    {
        if (c < first) return NodeValues<d, Set>::axis(c) == axis;
        if (c < free) return (c - first) % d == axis;
        for (int i = 0; i < d; ++i)
            for (int j = 0; j < i; ++j)
                if (c == free_at(i, j)) return i == axis || j == axis;
        return false;
    }

    /// The channel of the impulse behind a wall that faces this side.
    FIRN_HOST_DEVICE static constexpr int behind_at(int axis, int side)
    {
        return behind + 2 * axis + (side > 0 ? 1 : 0);
    }
    /// The channel of a component of the projection.
    FIRN_HOST_DEVICE static constexpr int free_at(int i, int j)
    {
        return free + (i < j ? j * (j + 1) / 2 + i : i * (i + 1) / 2 + j);
    }
};

/// How many values a node has beside those that particles gather: what the integrator of a transfer needs.
template <class Transfer, class Kernel, int d>
inline constexpr int values_of_solve = [] {
    if constexpr (StepsImplicitly<Transfer>)
        return SolveValues<d, ValuesOf<Transfer>,
                           NodeValues<d, ValuesOf<Transfer>>::template channels<Kernel>>::channels;
    else
        return 0;
}();

} // namespace firn

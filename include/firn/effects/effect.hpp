// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/grid/lattice.hpp>

#include <cmath>

// An effect is what acts on velocities beside the material itself: gravity, obstacles. Effects are arguments
// of a step. An effect is a plain description; `over(interval)` turns it into an *action*, a plain value with
// the step's numbers filled in. The phases call actions on lanes of nodes: for an acceleration, on momentum,
// on velocities, or as an obstacle, which may act on particles, too; see NodeAction. UpdateGrid itself
// applies reflecting walls. The length of a step may be known only where the phases run, so `over` runs there
// too: it is FIRN_HOST_DEVICE where that is a device.
namespace firn
{

/// The time step being taken: (begin, end] in seconds.
struct Interval
{
    double begin, end;
    /// How long stresses and gravity act [s]: the length, unless the step before had another one; see
    /// TimeStepController::time_of_forces.
    double forces = end - begin;
    FIRN_HOST_DEVICE double length() const { return end - begin; }
};

/// Where a lane of nodes or particles is: first + offset cells from the lattice's origin. All of it lies in
/// one world.
///
/// Positions relative to a reference are computed in double precision before they become lanes, so they are
/// as accurate far from the origin as near it.
template <class Real, int d>
struct LanePosition
{
    Lattice lattice;
    Coordinates<d> first;
    Vector<Real, d> offset;    ///< [cells]
    double kernel_reach = 1.5; ///< from a particle to its nodes along each axis [cells]

    /// The vector from `reference` [m] to here in this world, in world axes [m]. Along a periodic axis it is
    /// that from the nearest image of the reference.
    FIRN_HOST_DEVICE Vector<Real, d> relative_to(Eigen::Vector3d const& reference) const
    {
        using Number = ScalarOf<Real>;
        Vector<Real, d> x;
        for (int a = 0; a < d; ++a) {
            double base = lattice.origin[a] + lattice.cell_size * lattice.in_world(first[a]) - reference[a];
            bool const is_periodic = lattice.periods[std::size_t(a)] != 0;
            double const period = lattice.period(a);
            if (is_periodic) base -= period * std::floor(base / period + 0.5); // precise however far it moved
            x[a] = Real(static_cast<Number>(base)) + offset[a] * Real(static_cast<Number>(lattice.cell_size));
            if (is_periodic) // lanes lie on both sides of the middle between two images
                x[a] -= Real(static_cast<Number>(period)) *
                        floor(x[a] * Real(static_cast<Number>(1 / period)) + Real(Number(0.5)));
        }
        return x;
    }
};

/// A lane of nodes, as actions on velocities see it.
template <class Real, int d>
struct LaneNode
{
    LanePosition<Real, d> position;
    Real mass; ///< of the material that it holds, 0 where there is none [kg; in two dimensions kg/m]
    Real dt;   ///< for how long forces act in the step [s], see Interval
};

/// What contact did to a lane of velocities.
template <class Real, int d>
struct ContactResult
{
    Vector<Real, d> velocity; ///< after contact [m/s]
    Vector<Real, d> arm;      ///< from the obstacle's reference point [m]
    Mask<Real> inside;        ///< where there was contact
    Real depth;               ///< how far inside, 0 outside [m]
    Vector<Real, d> normal;   ///< outward, in world axes; set where there was contact, like what follows
    Vector<Real, d> surface;  ///< velocity of the obstacle there [m/s]
    Real surface_speed2;      ///< squared speed of the obstacle there, 0 outside [m^2/s^2]
};

/// What an obstacle received during a step or a call.
struct Reaction
{
    Eigen::Vector3d impulse{0, 0, 0};         ///< [N s]; over the time that was simulated: the mean force
    Eigen::Vector3d angular_impulse{0, 0, 0}; ///< about the obstacle's reference point [N m s]

    FIRN_HOST_DEVICE Reaction& operator+=(Reaction const& other)
    {
        for (int i = 0; i < 3; ++i) {
            impulse[i] += other.impulse[i];
            angular_impulse[i] += other.angular_impulse[i];
        }
        return *this;
    }

    friend Reaction operator*(Reaction const& received, double factor)
    {
        auto const times = [&](Eigen::Vector3d const& v) {
            return Eigen::Vector3d(v[0] * factor, v[1] * factor, v[2] * factor);
        };
        return {times(received.impulse), times(received.angular_impulse)};
    }
};

} // namespace firn

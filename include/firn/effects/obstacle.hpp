// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <limits>
#include <type_traits>

namespace firn
{

namespace detail
{
/// Where a body is at a time [s].
template <class Number, int d>
struct Pose
{
    Eigen::Vector3d position;
    Matrix<Number, d> rotation; ///< body to world

    FIRN_HOST_DEVICE Pose(Motion const& motion, double when)
    {
        Motion const now = motion.at(when);
        position = now.position;
        rotation = matrix_of<Number, d>(now.rotation());
    }
};

struct NoPose
{
    FIRN_HOST_DEVICE NoPose(Motion const&, double) {}
};
} // namespace detail

/// A solid that moves as prescribed, and acts on the grid nodes inside it.
///
/// The grid resolves its surface to about a cell. With quadratic kernels material comes to rest up to 1.6
/// cells above it, depending on where the surface lies between nodes, and under pressure goes up to a cell
/// below it. With `on_particles` it acts on particles inside it, too, and none stays there.
///
/// A Shell always acts on particles, and keeps each on its side. It acts on nodes within at least half a cell
/// of its middle, so that a layer of them stops material from either side. Nodes are bound to a shell along
/// the normal, since their momentum may come from both sides.
template <class ShapeType>
struct Obstacle
{
    /// Where its surface is, in the frame of the body.
    ShapeType shape{};
    /// What happens where material touches it.
    Contact contact{};
    /// Where it is and how it moves.
    Motion motion{};
    bool on_particles = false; ///< also act on particles after they were moved, and push them out

    /// Throws an Error unless shape, contact and motion make sense.
    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        contact.validate("Obstacle");
        motion.validate("Obstacle");
    }

    /// Throws an Error if it leaves the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        motion.validate_in_plane("Obstacle");
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }

    /// Throws an Error if it makes no sense in a scene that is periodic along some axes: see
    /// detail::require_fits_periods.
    void validate_in(Lattice const& lattice, int dimension) const
    {
        detail::require_fits_periods(shape, motion, lattice, dimension, "Obstacle");
    }

    /// A bound on the speed of its surface [m/s] in a scene of `dimension` dimensions. It limits the time
    /// step, so that nothing passes a layer of nodes. The rotation of an unbounded shape is not part of it:
    /// that counts only where something touches the surface.
    double largest_speed(int dimension) const
    {
        double own = 0;
        if constexpr (is_deforming<ShapeType>) own = shape.largest_speed();
        return own + norm(motion.velocity) +
               norm(motion.angular_velocity) * detail::reach_of(shape, dimension);
    }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    /// What it does to nodes and particles in a step.
    template <class Number, int d>
    struct Action;
    /// Where the surface was when the step began, for a shell.
    template <class Number, int d>
    using Earlier = std::conditional_t<is_two_sided<ShapeType>, detail::Pose<Number, d>, detail::NoPose>;

    /// The same as a plain value, without the memory that its shape owns, for a call that begins at `begin`
    /// [s].
    auto plain(double begin) const
    {
        return Obstacle<detail::Plain<ShapeType>>{detail::plain(shape), contact, motion.from(begin),
                                                  on_particles || is_two_sided<ShapeType>};
    }

    /// The obstacle at the end of the step, since contact is solved for the velocities at that time. Called
    /// on a plain value.
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        Motion const now = motion.at(interval.end);
        return {shape_over(shape, interval),
                contact,
                now.position,
                matrix_of<Number, d>(now.rotation()),
                vector_of<Number, d>(now.velocity),
                vector_of<Number, 3>(now.angular_velocity),
                on_particles,
                Earlier<Number, d>(motion, interval.begin)};
    }
};

template <class ShapeType>
template <class Number, int d>
struct Obstacle<ShapeType>::Action
{
    static constexpr bool keeps_sides = is_two_sided<ShapeType>;
    static constexpr bool looks_up = is_sampled<detail::Plain<ShapeType>>;

    detail::Plain<ShapeType> shape;
    Contact contact;
    Eigen::Vector3d position;
    Matrix<Number, d> rotation; ///< body to world
    Vector<Number, d> velocity;
    Vector<Number, 3> angular_velocity;
    bool on_particles;
    Earlier<Number, d> earlier; ///< at the beginning of the step

    /// Contact of lanes with velocity v at a place. `rule` is the obstacle's own or, in the last passes over
    /// a corner, slip. A solid acts as if it were larger by `skin` [m].
    template <Lane Real>
    FIRN_HOST_DEVICE ContactResult<Real, d> touch(LanePosition<Real, d> const& place,
                                                  Vector<Real, d> const& v, Contact const& rule,
                                                  Number skin = 0) const
    {
        ContactResult<Real, d> touched;
        touched.arm = place.relative_to(position);
        Matrix<Real, d> const R = matrix_of<Real, d>(rotation);
        Vector<Real, d> const local = transpose_product<Real, d>(R, touched.arm);
        auto const sample = surface_of<Real, d>(shape, local);
        Number reach = skin;
        if constexpr (is_two_sided<ShapeType>)
            reach = max(reach, Number(0.5 * (place.lattice.cell_size - shape.thickness)));
        touched.inside = !(sample.distance > Real(reach));
        touched.velocity = v;
        touched.depth = Real(0);
        touched.surface_speed2 = Real(0);
        if (!any(touched.inside)) return touched;

        touched.normal = product<Real, d>(R, sample.normal);
        Vector<Real, d> const surface = surface_velocity<Real>(touched.arm);
        if constexpr (is_two_sided<ShapeType>) // whatever moves relative to it approaches
            touched.normal = touched.normal *
                             select(dot<Real, d>(v - surface, touched.normal) > Real(0), Real(-1), Real(1));
        Vector<Real, d> after = rule.after<Real, d>(v - surface, touched.normal);
        // Only material inside the obstacle reaches nodes deeper than the kernel, and nothing slides there.
        // Behind an edge such nodes belong to one face or the other: material driven against one face would
        // slide along the other, and zigzag all the way in.
        Mask<Real> const deep = -sample.distance > Real(Number(place.kernel_reach * place.lattice.cell_size));
        if (any(deep)) {
            Vector<Real, d> const leaving = touched.normal * dot<Real, d>(after, touched.normal);
            for (int a = 0; a < d; ++a) after[a] = select(deep, leaving[a], after[a]);
        }
        for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, surface[a] + after[a], v[a]);
        touched.depth = select(touched.inside, Real(skin) - sample.distance, Real(0));
        touched.surface = surface;
        touched.surface_speed2 = select(touched.inside, dot<Real, d>(surface, surface), Real(0));
        return touched;
    }

    /// Whether it is a shell thinner than a cell. At its surface such a one acts in its middle, on either
    /// side, and takes no room.
    FIRN_HOST_DEVICE bool is_thin([[maybe_unused]] Lattice const& lattice) const
    {
        if constexpr (keeps_sides)
            return shape.thickness < lattice.cell_size;
        else
            return false;
    }
    /// Where lanes of places, moved by `shift` [m], are relative to the surface; of a thin shell to its
    /// middle, with a distance of either sign.
    template <Lane Real>
    FIRN_HOST_DEVICE SurfaceAt<Real, d> surface_at(LanePosition<Real, d> const& place,
                                                   Vector<Real, d> const& shift) const
    {
        Vector<Real, d> const arm = place.relative_to(position) + shift;
        Matrix<Real, d> const R = matrix_of<Real, d>(rotation);
        Vector<Real, d> const local = transpose_product<Real, d>(R, arm);
        SurfaceSample<Real, d> sample;
        if constexpr (keeps_sides)
            sample = is_thin(place.lattice) ? surface_of<Real, d>(shape.shape, local)
                                            : surface_of<Real, d>(shape, local);
        else
            sample = surface_of<Real, d>(shape, local);
        return {arm, sample.distance, product<Real, d>(R, sample.normal)};
    }
    /// The velocity of the surface [m/s] there.
    template <Lane Real>
    FIRN_HOST_DEVICE Vector<Real, d> velocity_at(Vector<Real, d> const& arm) const
    {
        return surface_velocity<Real>(arm);
    }

    /// Contact of lanes of particles with velocity v, at a place to which they travelled [m] since the step
    /// began: a solid pushes out particles inside it, a shell keeps each particle on its side.
    ///
    /// The side is the one at the beginning of the step, so a shell that moves across particles loses none.
    template <Lane Real>
    FIRN_HOST_DEVICE ContactResult<Real, d> hold(LanePosition<Real, d> const& place,
                                                 Vector<Real, d> const& travelled, Vector<Real, d> const& v,
                                                 Contact const& rule) const
    {
        if constexpr (!keeps_sides)
            return touch<Real>(place, v, rule);
        else {
            ContactResult<Real, d> touched;
            touched.arm = place.relative_to(position);
            auto const here = from_side<Real>(touched.arm, start<Real>(place, travelled));
            touched.inside = !(here.distance > Real(0));
            touched.velocity = v;
            touched.depth = touched.surface_speed2 = Real(0);
            touched.normal = touched.surface = Vector<Real, d>::Zero(); // or compilers warn
            if (!any(touched.inside)) return touched;

            Vector<Real, d> const surface = surface_velocity<Real>(touched.arm);
            Vector<Real, d> const after = surface + rule.after<Real, d>(v - surface, here.normal);
            for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, after[a], v[a]);
            touched.depth = select(touched.inside, -here.distance, Real(0));
            touched.normal = here.normal;
            touched.surface = surface;
            return touched;
        }
    }

    /// How deep [m] lanes of particles are inside a solid, or below the surface of a shell on their side.
    template <Lane Real>
    FIRN_HOST_DEVICE Real overlap(LanePosition<Real, d> const& place, Vector<Real, d> const& travelled) const
    {
        Vector<Real, d> const arm = place.relative_to(position);
        if constexpr (keeps_sides)
            return -from_side<Real>(arm, start<Real>(place, travelled)).distance;
        else
            return -surface_of<Real, d>(shape, transpose_product<Real, d>(matrix_of<Real, d>(rotation), arm))
                        .distance;
    }

    /// An overlap [m] beyond which particles are lost: they are past the middle of a shell.
    template <class Same>
    FIRN_HOST_DEVICE Same lost_beyond(Lattice const&) const
    {
        static_assert(std::is_same_v<Same, Number>);
        if constexpr (keeps_sides)
            return Number(0.5 * shape.thickness);
        else
            return std::numeric_limits<Number>::max();
    }

    /// The displacement [m] since the step began of lanes of particles that move with the obstacle.
    template <Lane Real>
    FIRN_HOST_DEVICE Vector<Real, d> carried(LanePosition<Real, d> const& place,
                                             Vector<Real, d> const& travelled, Real dt) const
    {
        Vector<Real, d> const from = place.relative_to(position) - travelled;
        if constexpr (keeps_sides)
            return matrix_of<Real, d>(rotation) * start<Real>(place, travelled) - from;
        else {
            Vector<Real, d> const arm = from + vector_of<Real, d>(velocity) * dt,
                                  turned = detail::rigid_velocity<Real, d>(zeros<Vector<Number, d>>(),
                                                                           angular_velocity,
                                                                           Vector<Real, d>(arm * dt));
            return surface_velocity<Real>(arm) * dt +
                   detail::rigid_velocity<Real, d>(zeros<Vector<Number, d>>(), angular_velocity, turned) *
                       (dt * Real(Number(0.5)));
        }
    }

    FIRN_HOST_DEVICE Eigen::Vector3d reference() const { return position; } ///< of its angular impulse [m]

private:
    /// Where in the body's frame lanes of particles were when the step began.
    template <Lane Real>
    FIRN_HOST_DEVICE Vector<Real, d> start(LanePosition<Real, d> const& place,
                                           Vector<Real, d> const& travelled) const requires keeps_sides
    {
        Vector<Real, d> const from = place.relative_to(earlier.position) - travelled;
        return transpose_product<Real, d>(matrix_of<Real, d>(earlier.rotation), from);
    }

    /// Distance from the surface of a shell on the side of `start`, and the normal towards that side.
    template <Lane Real>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> from_side(Vector<Real, d> const& arm,
                                                      Vector<Real, d> const& start) const requires keeps_sides
    {
        Matrix<Real, d> const R = matrix_of<Real, d>(rotation);
        Real const side =
            select(surface_of<Real, d>(shape.shape, start).distance < Real(0), Real(-1), Real(1));
        auto const here = surface_of<Real, d>(shape.shape, transpose_product<Real, d>(R, arm));
        return {here.distance * side - Real(Number(0.5 * shape.thickness)), R * (here.normal * side)};
    }

    /// v + omega x arm, and what a shape that changes its form adds.
    template <Lane Real>
    FIRN_HOST_DEVICE Vector<Real, d> surface_velocity(Vector<Real, d> const& arm) const
    {
        Vector<Real, d> u = detail::rigid_velocity<Real, d>(velocity, angular_velocity, arm);
        if constexpr (is_deforming<ShapeType>) {
            Matrix<Real, d> const R = matrix_of<Real, d>(rotation);
            u += product<Real, d>(R, velocity_of<Real, d>(shape, transpose_product<Real, d>(R, arm)));
        }
        return u;
    }
};

} // namespace firn

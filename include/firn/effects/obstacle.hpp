// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/shape.hpp>

#include <type_traits>

namespace firn
{

namespace detail
{
/// Where a body is.
template <class Number, int d>
struct Pose
{
    Eigen::Vector3d position;
    Matrix<Number, d> rotation; ///< body to world

    FIRN_HOST_DEVICE explicit Pose(Motion const& now)
        : position(now.position), rotation(now.orientation.normalized()
                                               .toRotationMatrix()
                                               .template topLeftCorner<d, d>()
                                               .template cast<Number>())
    {}
};

struct NoPose
{
    FIRN_HOST_DEVICE explicit NoPose(Motion const&) {}
};
} // namespace detail

/// A solid of a shape that moves and rotates as told, and acts on the grid nodes inside it (and, if asked, on
/// the particles inside it, which closes the visible gap of about one cell that node contact leaves).
///
/// A Shell acts on particles in any case, and keeps each on its side. It acts on nodes within half a cell of
/// its middle at least, so that there is a layer of them to stop what comes from either side: bound to it
/// along the normal, since what a node holds may come from both sides.
template <class ShapeType>
struct Obstacle
{
    ShapeType shape{};
    Contact contact{};
    Motion motion{};
    bool on_particles = false; ///< also act on particles after they were moved, and push them out

    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        contact.validate("Obstacle");
        motion.validate("Obstacle");
    }

    /// In two dimensions there is nothing along z: motion stays in the plane and rotation is about z.
    void validate_in_plane() const
    {
        Eigen::Vector3d const turned_z = motion.orientation.normalized() * Eigen::Vector3d::UnitZ();
        bool const in_plane = motion.velocity.z() == 0 && motion.angular_velocity.head<2>().isZero() &&
                              std::abs(turned_z.z()) > 1 - 1e-9;
        require(in_plane, "an obstacle of a scene in two dimensions leaves the plane", "Obstacle",
                "Keep z out of its velocity, and let it turn about z alone.");
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }

    /// A bound on the speed of its surface [m/s], which bounds the time step: nothing is to pass through a
    /// layer of nodes. The rotation of a shape without end counts only where it touches something.
    double largest_speed() const
    {
        double reach = 0;
        if constexpr (requires { shape.reach(); }) reach = shape.reach();
        return motion.velocity.norm() + motion.angular_velocity.norm() * reach;
    }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    template <class Number, int d>
    struct Action;
    template <class Number, int d>
    using Earlier = std::conditional_t<is_two_sided<ShapeType>, detail::Pose<Number, d>, detail::NoPose>;

    /// The same without what its shape owns: a plain value.
    auto plain() const
    {
        return Obstacle<detail::Plain<ShapeType>>{detail::plain(shape), contact, motion,
                                                  on_particles || is_two_sided<ShapeType>};
    }

    /// The obstacle at the end of the step: contact is solved for the velocities of that time. For a plain
    /// value.
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> during(Interval const& interval) const
    {
        Motion const now = motion.at(interval.end);
        Eigen::Matrix3d const rotation = now.orientation.normalized().toRotationMatrix();
        return {shape,
                contact,
                now.position,
                rotation.topLeftCorner<d, d>().template cast<Number>(),
                now.velocity.head<d>().template cast<Number>(),
                now.angular_velocity.template cast<Number>(),
                on_particles,
                Earlier<Number, d>(motion.at(interval.begin))};
    }
};

/// What contact did to a lane of velocities.
template <class Real, int d>
struct Touched
{
    Vector<Real, d> velocity; ///< after contact [m/s]
    Vector<Real, d> arm;      ///< from the obstacle's reference point [m]
    Mask<Real> inside;        ///< where there was contact
    Real depth;               ///< how far inside, 0 outside [m]
    Vector<Real, d> normal;   ///< outward, in world axes
    Real surface_speed2;      ///< squared speed of the obstacle there, 0 outside [m^2/s^2]
};

template <class ShapeType>
template <class Number, int d>
struct Obstacle<ShapeType>::Action
{
    static constexpr bool is_obstacle = true;
    static constexpr bool keeps_sides = is_two_sided<ShapeType>;

    detail::Plain<ShapeType> shape;
    Contact contact;
    Eigen::Vector3d position;
    Matrix<Number, d> rotation; ///< body to world
    Vector<Number, d> velocity;
    Vector<Number, 3> angular_velocity;
    bool on_particles;
    Earlier<Number, d> earlier; ///< at the beginning of the step

    /// Contact of lanes with velocity v at a place. `rule` is the obstacle's own or, to end a corner, slip.
    template <Lane Real>
    FIRN_HOST_DEVICE Touched<Real, d> touch(Place<Real, d> const& place, Vector<Real, d> const& v,
                                            Contact const& rule) const
    {
        Touched<Real, d> touched;
        touched.arm = place.relative_to(position);
        Matrix<Real, d> const R = rotation.template cast<Real>();
        Vector<Real, d> const local = R.transpose() * touched.arm;
        auto const sample = surface_of<Real, d>(shape, local);
        Number reach(0);
        if constexpr (is_two_sided<ShapeType>)
            reach = max(reach, Number(0.5 * (place.lattice.cell_size - shape.thickness)));
        touched.inside = !(sample.distance > Real(reach));
        touched.velocity = v;
        touched.depth = Real(0);
        touched.surface_speed2 = Real(0);
        if (!any(touched.inside)) return touched;

        touched.normal = R * sample.normal;
        Vector<Real, d> const surface = surface_velocity<Real>(touched.arm);
        if constexpr (is_two_sided<ShapeType>) // whatever moves relative to it approaches
            touched.normal =
                touched.normal * select((v - surface).dot(touched.normal) > Real(0), Real(-1), Real(1));
        Vector<Real, d> after = rule.after<Real, d>(v - surface, touched.normal);
        // Only what has got in reaches nodes deeper than the kernel: nothing slides there. Behind an edge
        // they belong to one face or the other, and would let what is driven at one slide by along the other:
        // all the way in, in zigzags.
        Mask<Real> const deep = -sample.distance > Real(Number(place.kernel_reach * place.lattice.cell_size));
        if (any(deep)) {
            Vector<Real, d> const leaving = touched.normal * after.dot(touched.normal);
            for (int a = 0; a < d; ++a) after[a] = select(deep, leaving[a], after[a]);
        }
        for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, surface[a] + after[a], v[a]);
        touched.depth = select(touched.inside, -sample.distance, Real(0));
        touched.surface_speed2 = select(touched.inside, surface.dot(surface), Real(0));
        return touched;
    }

    /// Keeps lanes of particles with velocity v, at a place after a displacement [m] by the grid, on the side
    /// of a shell where they were. `correction` becomes the displacement [m] that goes with it.
    ///
    /// The side is that of the shell at the beginning of the step, so nothing is lost to a shell that moves
    /// across particles. Where the way out is longer than the distances say, they are carried along with the
    /// shell.
    template <Lane Real>
    FIRN_HOST_DEVICE Touched<Real, d>
    keep_side(Place<Real, d> const& place, Vector<Real, d> const& displacement, Vector<Real, d> const& v,
              Real dt, Vector<Real, d>& correction) const requires keeps_sides
    {
        Matrix<Real, d> const R = rotation.template cast<Real>();
        Vector<Real, d> const from = place.relative_to(earlier.position) - displacement;
        Vector<Real, d> const start = earlier.rotation.template cast<Real>().transpose() * from;
        Real const zero(0), one(1), half(Number(0.5 * shape.thickness));
        Real const side = select(surface_of<Real, d>(shape.shape, start).distance < zero, -one, one);
        // towards that side, from the surface of the shell
        auto const sample = [&](Vector<Real, d> const& arm) {
            auto at = surface_of<Real, d>(shape.shape, Vector<Real, d>(R.transpose() * arm));
            return SurfaceSample<Real, d>{at.distance * side - half, R * (at.normal * side)};
        };
        Touched<Real, d> touched;
        touched.arm = place.relative_to(position);
        auto here = sample(touched.arm);
        touched.inside = !(here.distance > zero);
        touched.velocity = v;
        correction.setZero();
        if (!any(touched.inside)) return touched;

        Vector<Real, d> const surface = surface_velocity<Real>(touched.arm);
        Vector<Real, d> const after = surface + contact.after<Real, d>(v - surface, here.normal);
        Vector<Real, d> arm = touched.arm + (after - v) * dt;
        for (int i = 0; i < 3; ++i) { // once for an exact distance
            here = sample(arm);
            arm += here.normal * max(-here.distance, zero);
        }
        Mask<Real> const on_side = sample(arm).distance > -half;
        Vector<Real, d> const carried = R * start;
        for (int a = 0; a < d; ++a) {
            touched.velocity[a] = select(touched.inside, after[a], v[a]);
            correction[a] =
                select(touched.inside, select(on_side, arm[a], carried[a]) - touched.arm[a], zero);
        }
        return touched;
    }

private:
    /// v + omega x arm.
    template <Lane Real>
    FIRN_HOST_DEVICE Vector<Real, d> surface_velocity(Vector<Real, d> const& arm) const
    {
        Vector<Real, d> u = velocity.template cast<Real>();
        Real const omega_z(angular_velocity[2]);
        u[0] -= omega_z * arm[1];
        u[1] += omega_z * arm[0];
        if constexpr (d == 3) {
            Real const omega_x(angular_velocity[0]), omega_y(angular_velocity[1]);
            u[0] += omega_y * arm[2];
            u[1] -= omega_x * arm[2];
            u[2] += omega_x * arm[1] - omega_y * arm[0];
        }
        return u;
    }
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/shape.hpp>

#include <utility>

namespace firn
{

namespace detail
{
/// A shape as a plain value: its view, if it has one.
template <class ShapeType>
auto plain(ShapeType const& shape)
{
    if constexpr (requires { shape.view(); })
        return shape.view();
    else
        return shape;
}

template <class ShapeType>
using Plain = decltype(plain(std::declval<ShapeType const&>()));
} // namespace detail

/// A solid of a shape that moves and rotates as told, and acts on the grid nodes inside it (and, if asked, on
/// the particles inside it, which closes the visible gap of about one cell that node contact leaves).
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

    /// The same without what its shape owns: a plain value.
    auto plain() const
    {
        return Obstacle<detail::Plain<ShapeType>>{detail::plain(shape), contact, motion, on_particles};
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
                on_particles};
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

    detail::Plain<ShapeType> shape;
    Contact contact;
    Eigen::Vector3d position;
    Matrix<Number, d> rotation; ///< body to world
    Vector<Number, d> velocity;
    Vector<Number, 3> angular_velocity;
    bool on_particles;

    /// Contact of lanes with velocity v at a place. `rule` is the obstacle's own or, to end a corner, slip.
    template <Lane Real>
    FIRN_HOST_DEVICE Touched<Real, d> touch(Place<Real, d> const& place, Vector<Real, d> const& v,
                                            Contact const& rule) const
    {
        Touched<Real, d> touched;
        touched.arm = place.relative_to(position);
        Matrix<Real, d> const R = rotation.template cast<Real>();
        Vector<Real, d> const local = R.transpose() * touched.arm;
        auto const sample = surface_sample<Real>(local);
        touched.inside = !(sample.distance > Real(0));
        touched.velocity = v;
        touched.depth = Real(0);
        touched.surface_speed2 = Real(0);
        if (!any(touched.inside)) return touched;

        touched.normal = R * sample.normal;
        Vector<Real, d> const surface = surface_velocity<Real>(touched.arm);
        Vector<Real, d> const after = surface + rule.after<Real, d>(v - surface, touched.normal);
        for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, after[a], v[a]);
        touched.depth = select(touched.inside, -sample.distance, Real(0));
        touched.surface_speed2 = select(touched.inside, surface.dot(surface), Real(0));
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

    /// The shape's answer; a shape that answers numbers only is asked lane by lane.
    template <Lane Real>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface_sample(Vector<Real, d> const& local) const
    {
        if constexpr (Shape<detail::Plain<ShapeType>, Real, d>)
            return shape.surface(local);
        else {
            constexpr int width = lane_width<Real>;
            Scalar<Real> x[d][width], distance[width], normal[d][width];
            for (int a = 0; a < d; ++a) LaneTraits<Real>::store(local[a], x[a]);
            for (int lane = 0; lane < width; ++lane) {
                Vector<Number, d> point;
                for (int a = 0; a < d; ++a) point[a] = x[a][lane];
                auto const sample = shape.surface(point);
                distance[lane] = sample.distance;
                for (int a = 0; a < d; ++a) normal[a][lane] = sample.normal[a];
            }
            SurfaceSample<Real, d> sample;
            sample.distance = LaneTraits<Real>::load(distance);
            for (int a = 0; a < d; ++a) sample.normal[a] = LaneTraits<Real>::load(normal[a]);
            return sample;
        }
    }
};

} // namespace firn

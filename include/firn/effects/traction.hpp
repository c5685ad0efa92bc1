// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/effect.hpp>
#include <firn/math/product.hpp>

#include <cmath>

namespace firn
{

/// Loads the surfaces that are marked (see mark_face) by a stress: the force on an area A with the outward
/// normal n is stress n A. A call with a Traction is refused while no particle is marked. The
/// transfer carries the marks, such as `Carrying<Mls, LoadedSurfaces>`; others are refused at compile time.
///
/// The impulse on a body is that force times the time of forces, to rounding. It enters within the kernel's
/// reach of the marked particles, so stress is that of the load from there on inwards.
struct Traction
{
    static constexpr auto name = "Traction"; ///< in messages

    /// In world axes, tension above 0 [Pa].
    Eigen::Matrix3d stress = zeros<Eigen::Matrix3d>();

    /// A pressure on all marked surfaces, along their inward normals [Pa].
    static Traction pressure(double p)
    {
        return {made_of<Eigen::Matrix3d>([p](int i) { return i % 4 == 0 ? -p : 0.0; })};
    }

    /// The force per area `traction` [Pa] on surfaces with a normal along `normal`, and on others its part by
    /// the cosine between the two.
    static Traction on(Eigen::Vector3d const& traction, Eigen::Vector3d const& normal)
    {
        double const length = norm(normal);
        require(all_finite(normal) && length > 0, "the normal has no direction", "Traction::on",
                "Pass the outward normal of the surface.");
        return {made_of<Eigen::Matrix3d>([&](int i) { return traction[i % 3] * normal[i / 3] / length; })};
    }

    /// Throws an Error unless the stress is finite, in the range of single precision.
    void validate() const
    {
        for (int i = 0; i < 9; ++i)
            require(is_between(-1e30, stress.data()[i], 1e30),
                    "the stress of a traction is not finite, or beyond 1e30", "Traction", "Pass it in Pa.");
    }
    /// Throws an Error if it drives material out of the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        require(!(std::abs(stress(2, 0)) > 0 || std::abs(stress(2, 1)) > 0),
                "a traction in a scene in two dimensions leaves the plane", "Traction",
                "Keep z out of the force.");
    }

    /// Of one step: the force on marked faces.
    template <class Number, int d>
    struct Action
    {
        Matrix<Number, d> stress; ///< [Pa]

        /// The force on lanes of areas.
        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> surface_force(Vector<Real, d> const& area) const
        {
            return product<Real, d>(matrix_of<Real, d>(stress), area);
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const&) const
    {
        return {matrix_of<Number, d>(stress)};
    }
};

} // namespace firn

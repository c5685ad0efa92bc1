// SPDX-License-Identifier: MIT
#pragma once

#include <firn/math/largest_eigenvalue.hpp>
#include <firn/math/left_stretch.hpp>
#include <firn/models/elastoplastic.hpp>
#include <firn/models/principal_product.hpp>

namespace firn
{

/// The fixed corotated law, in principal stretches sigma: Psi = mu sum (sigma_i - 1)^2 + lambda/2 (J - 1)^2
/// (Stomakhin et al. 2012, section 3).
struct FixedCorotatedLaw : MeasuredByExtension
{
    static constexpr auto name = "fixed_corotated";

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> inverted(Vector<Real, d> const&)
    {
        return no_lanes<Real>();
    }

    /// tau_i = 2 mu (sigma_i - 1) sigma_i + lambda (J - 1) J; the wave modulus max_i sigma_i^2 Psi_ii =
    /// 2 mu sigma_1^2 + lambda J^2 or that of shear, not below its value at rest.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& extension, Real mu,
                                                            Real lambda)
    {
        Real const volume = volume_change<Real, d>(extension), J = Real(1) + volume;
        Real const pressure = lambda * volume * J;
        Real longest = extension[0];
        PrincipalStress<Real, d> found;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            found.kirchhoff[i] = Real(2) * mu * extension[i] * (Real(1) + extension[i]) + pressure;
            longest = max(longest, extension[i]);
        }
        found.wave_modulus = wave_modulus(longest, J, mu, lambda);
        return found;
    }

    /// sigma_i sigma_j Psi_ij = lambda J (2 J - 1) + (2 mu sigma_i^2 - lambda J (J - 1)) where i = j, and the
    /// shear value 2 mu - lambda (J - 1) J / (sigma_i sigma_j).
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalTangent<Real, d> tangent(Vector<Real, d> const& extension, Real mu,
                                                              Real lambda)
    {
        Real const one(1), volume = volume_change<Real, d>(extension), J = one + volume,
                           pressure = lambda * volume * J;
        auto const stretch = [&](int i) { return one + extension[i]; };
        PrincipalTangent<Real, d> found;
        found.stretching = make_matrix<Real, d>([&](int i, int j) {
            Real const both = lambda * J * (J + volume);
            return i == j ? both + Real(2) * mu * stretch(i) * stretch(i) - pressure : both;
        });
        found.shearing = make_matrix<Real, d>([&](int i, int j) {
            Real const area = stretch(i) * stretch(j);
            Mask<Real> const is_flat = !(abs(area) > Real(ScalarOf<Real>(1e-12)));
            return Real(2) * mu - pressure / select(is_flat, one, area);
        });
        return found;
    }

    /// Psi [Pa].
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Real energy(Vector<Real, d> const& extension, Real mu, Real lambda)
    {
        Real const volume = volume_change<Real, d>(extension);
        return mu * dot<Real, d>(extension, extension) + Real(ScalarOf<Real>(0.5)) * lambda * volume * volume;
    }

    /// The wave modulus from the longest stretch less one. The shear values 2 mu sigma_1^2 (1 - 1/(sigma_1 +
    /// sigma_j)) are at most mu sigma_1 (2 sigma_1 - 1): below the longitudinal one, unless nu < 0. In
    /// compression sigma_1 may be below 1, but the modulus is not below the one at rest.
    template <Lane Real>
    FIRN_HOST_DEVICE static Real wave_modulus(Real longest, Real J, Real mu, Real lambda)
    {
        Real const sigma = Real(1) + longest, rest = lambda + Real(2) * mu;
        Real const longitudinal = Real(2) * mu * sigma * sigma + lambda * J * J;
        return max(max(longitudinal, mu * sigma * (Real(2) * sigma - Real(1))), rest);
    }
};

/// Fixed corotated solid: Psi = mu |F - R|^2 + lambda/2 (J - 1)^2 with the rotation R of the polar
/// decomposition (Stomakhin et al. 2012, eq. 6). Finite under inversion, but an inverted particle does not
/// come back: a safe step keeps the sign of det F. Soft towards J = 0.
///
/// tau = 2 mu (V^2 - V) + lambda (J - 1) J I with the left stretch V: principal axes are needed only for
/// needles and near-reflections.
template <class SpaceType>
struct FixedCorotated
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<DisplacementGradient>;
    static constexpr auto name = FixedCorotatedLaw::name;

    Number density = 1000;                            ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1e5, 0.3); ///< [Pa]

    void for_each_parameter(auto const& use) const { use("elasticity", elasticity); }

    void validate() const
    {
        require_density(density, name);
        elasticity.validate(name);
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        H = deformed<Real, d>(H, velocity_gradient, dt);
        Real const volume = volume_change<Real, d>(H), J = Real(1) + volume;
        LeftStretch<Real, d> const V = left_stretch<Real, d>(H, volume);

        Response<Real, d> response;
        response.kirchhoff_stress = (V.square - V.strain) * (Real(2) * mu);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) response.kirchhoff_stress(i, i) += lambda * volume * J;
        // from V^2, which is well defined even where the rotation is not
        Real const square = largest_eigenvalue<Real>(V.square);
        Real const longest = square / (Real(1) + sqrt(max(Real(1) + square, Real(0))));
        response.wave_modulus = FixedCorotatedLaw::wave_modulus<Real>(longest, J, mu, lambda);
        response.inverted = no_lanes<Real>();
        response.capped = no_lanes<Real>();
        return response;
    }

    /// The state in its principal axes.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE StateInAxes<Real, Space::dimension> in_axes(Particle const& state) const
    {
        return state_in_axes<Real, Space::dimension>(FixedCorotatedLaw{}, state[DisplacementGradient{}],
                                                     Real(elasticity.mu), Real(elasticity.lambda));
    }

    /// Q = dP F^T, for dF = dl F: see product_in_axes.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change) const
    {
        return product_in_axes<Real, Space::dimension>(in_axes<Real>(state), change);
    }

    /// Psi [J/m^3].
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const
    {
        constexpr int d = Space::dimension;
        return FixedCorotatedLaw::energy<Real, d>(
            principal_axes<Real, d>(state[DisplacementGradient{}]).extension, Real(elasticity.mu),
            Real(elasticity.lambda));
    }
};

} // namespace firn

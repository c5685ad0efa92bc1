// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/core/finite.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/remainders.hpp>
#include <firn/models/response.hpp>

#include <limits>
#include <string>

namespace firn
{

/// Weakly compressible fluid: Tait's equation p = K/gamma (J^-gamma - 1) (Batchelor 1967, eq. 1.8.2; in MPM
/// Tampubolon et al. 2017, section 4.2.2) and Newton's viscosity, tau = -p J I + eta J (L + L^T - (2/d) tr L
/// I).
///
/// Stores ln J alone, which grows by dt tr L, so J stays above 0. There is no deformation gradient, which a
/// flow would shear without end. Choose K = density (10 v)^2 for a fastest flow of v [m/s]: it is then
/// compressed by a hundredth.
///
/// Viscous stress is that of the step before, and acts for the length that the step was planned with. A
/// particle that scatters anew, after add or upload, takes its L from the affine matrix of APIC, MLS and
/// their like; with other transfers it has no viscous stress in that step.
template <class SpaceType>
struct Fluid
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<LogVolumeRatio>;
    static constexpr auto name = "fluid";

    Number density = 1000;     ///< [kg/m^3]
    Number bulk_modulus = 2e5; ///< K [Pa], far below that of water: it bounds the time step
    Number exponent = 7;       ///< gamma
    Number viscosity = 0;      ///< eta [Pa s]
    /// Whether it bears no tension: J is then at most 1, and splashes part. A flow that is stretched and then
    /// compressed loses volume by it.
    bool parts = true;
    /// A fluid that does not part bears Tait's tension, below K / gamma, up to this J. Beyond it J is
    /// clamped, and the particle counts as capped. No liquid gets near it: water cavitates at 26 MPa, a
    /// hundredth of its volume (Herbert, Balibar and Caupin 2006, Phys. Rev. E 74, 041603). Our choice:
    /// tension times J is then at most K, which bounds the time step.
    static constexpr double largest_volume_ratio = 2;

    void for_each_parameter(auto const& use) const
    {
        use("bulk_modulus", bulk_modulus);
        use("exponent", exponent);
        use("viscosity", viscosity);
        use("parts", parts);
    }

    void validate() const
    {
        require_density(double(density), name);
        require(bulk_modulus > 0 && is_finite(bulk_modulus),
                "the bulk modulus is not a finite number above 0", name,
                "Pass Pa: density times the square of ten times the fastest flow.");
        // at 1000 a compression by a hundredth makes it 20 000 times as stiff
        require(is_between(1, exponent, 1000), "the exponent is outside [1, 1000]", name,
                "Pass gamma, e.g. 7 for water.");
        require(viscosity >= 0 && is_finite(viscosity), "the viscosity is not a finite number, 0 or above",
                name, "Pass Pa s, e.g. 1e-3 for water.");
    }

    /// What is wrong with an uploaded or restored state: a tension that this fluid does not bear, or a
    /// pressure or modulus that overflows.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        double const log_J = double(state[LogVolumeRatio{}]);
        auto const said = [&](char const* why) {
            return "a volume ratio of e^" + std::to_string(log_J) + ' ' + why;
        };
        // half of the range is left to the bulk modulus
        double const most = 0.5 * std::log(double(std::numeric_limits<Number>::max()));
        if (!(-log_J * double(exponent) <= most)) return said("gives the fluid a pressure without bounds");
        double const rounding = 1e-6; // tolerated in a state that was computed to have no pressure
        if (log_J <= largest_log_volume_ratio() + rounding) return {};
        return said(parts ? "is above 1: this fluid parts instead" : "is beyond that of any fluid");
    }

    static constexpr bool is_viscous = true;
    /// eta / rho [m^2/s]: bounds the time step, see shear_limit.
    double kinematic_viscosity() const { return double(viscosity) / double(density); }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        Real& log_J = state[LogVolumeRatio{}];
        log_J += dt * velocity_gradient.trace();
        Real const most(static_cast<Number>(largest_log_volume_ratio()));
        Mask<Real> const capped = log_J > most;
        log_J = min(log_J, most);
        auto response = answer<Real>(log_J, Real(viscosity) * exp(log_J), velocity_gradient);
        response.capped = parts ? no_lanes<Real>() : capped; // the same for all particles
        return response;
    }

    /// Stress acts on the velocity gradient itself, since J grows by its trace: an implicit step looks for
    /// the least of V0 (Psi(J_n e^(dt tr L)) + dt eta J_n |dev sym L|^2) in place of an energy of F.
    static constexpr bool acts_on_rates = true;
    /// The response at the end of an implicit step. The viscous stress is that of the volume before it, and
    /// adds to the stiffness; the stored ratio is beyond the cap where the fluid has parted.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    predict(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        Real& log_J = state[LogVolumeRatio{}];
        Real const most(static_cast<Number>(largest_log_volume_ratio())),
            shear = Real(viscosity) * exp(min(log_J, most));
        log_J += dt * velocity_gradient.trace();
        auto response = answer<Real>(min(log_J, most), shear, velocity_gradient);
        response.wave_modulus += Real(2) * shear / dt;
        response.capped = no_lanes<Real>();
        return response;
    }
    /// Of the state that was predicted, for dl = dt dL: Q = (d tau / d ln J) tr(dl) I + 2 eta J / dt dev sym
    /// dl. The viscous part takes the new J, as the old one is not stored: the two differ by as much as the
    /// fluid is compressed.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change, Real dt) const
    {
        constexpr int d = Space::dimension;
        Real const most(static_cast<Number>(largest_log_volume_ratio())),
            log_J = min(state[LogVolumeRatio{}], most), J = exp(log_J), gamma(exponent), K(bulk_modulus),
            compressed = exp_minus_one(-gamma * log_J), // J^-gamma - 1
            grown = sum_of<Real, d>([&](int i) { return change(i, i); });
        // d(-p J) / d ln J = K / gamma J ((gamma - 1) J^-gamma + 1)
        Real const bulk = select(state[LogVolumeRatio{}] > most, Real(0),
                                 K * J * (Real(1) + (gamma - Real(1)) / gamma * compressed));
        Real const shear = Real(viscosity) * J / dt,
                   isotropic = (bulk - shear * Real(Number(2.0 / d))) * grown;
        return make_matrix<Real, d>([&](int i, int j) {
            Real const sheared = shear * (change(i, j) + change(j, i));
            return i == j ? sheared + isotropic : sheared;
        });
    }

    /// The energy of Tait's pressure [J/m^3]: K/gamma (J - 1 + (J^(1 - gamma) - 1) / (gamma - 1)), or for
    /// gamma = 1 its limit K (J - 1 - ln J).
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const
    {
        Real const log_J =
            min(state[LogVolumeRatio{}], Real(static_cast<Number>(largest_log_volume_ratio())));
        Real sum = exp_remainder(log_J);
        if (exponent > 1) // the same for all particles
            sum += exp_remainder(Real(1 - exponent) * log_J) / Real(exponent - 1);
        return Real(bulk_modulus / exponent) * sum;
    }

private:
    /// The stress of a volume ratio, and eta J times the rates of shear.
    template <Lane Real>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    answer(Real const& log_J, Real const& shear,
           Matrix<Real, Space::dimension> const& velocity_gradient) const
    {
        constexpr int d = Space::dimension;
        Real const rate = velocity_gradient.trace(), J = exp(log_J), gamma(exponent), K(bulk_modulus);
        Real const compressed = exp_minus_one(-gamma * log_J); // J^-gamma - 1
        Real const pressure = K / gamma * compressed;

        Response<Real, d> response;
        Real const isotropic = -pressure * J - shear * rate * Real(Number(2.0 / d));
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            response.kirchhoff_stress(i, i) = isotropic + Real(2) * shear * velocity_gradient(i, i);
            FIRN_UNROLL
            for (int j = 0; j < i; ++j) {
                Real const stress = shear * (velocity_gradient(i, j) + velocity_gradient(j, i));
                response.kirchhoff_stress(i, j) = stress;
                response.kirchhoff_stress(j, i) = stress;
            }
        }
        // rho_0 c^2 = J^2 Psi_JJ = K J^(1 - gamma)
        response.wave_modulus = max(K * J * (compressed + Real(1)), K);
        response.inverted = no_lanes<Real>();
        return response;
    }

    FIRN_HOST_DEVICE double largest_log_volume_ratio() const
    {
        return parts ? 0 : 0.6931471805599453; // ln 2
    }
};

} // namespace firn

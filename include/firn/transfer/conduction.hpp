// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/transfer/carrying.hpp>

namespace firn
{

/// The temperature of a particle [K], above any reference: only differences matter. In single precision a
/// reference near the scene's temperatures keeps more digits of them.
struct Temperature
{
    static constexpr auto name = "temperature";
    static constexpr auto shape = FieldShape::scalar;
};

/// The gradient of the temperature at a particle, as it last gathered it [K/m].
struct TemperatureGradient
{
    static constexpr auto name = "temperature_gradient";
    static constexpr auto shape = FieldShape::vector;
};

/// The heat of a node over the heat capacity: the sum of w_i m T [K, times the unit of mass].
struct NodeHeat
{
    static constexpr auto name = "node_heat";
    static constexpr auto shape = FieldShape::scalar;
};

/// The heat that flows into a node per time, over the heat capacity [K/s, times the unit of mass].
struct NodeHeatFlow
{
    static constexpr auto name = "node_heat_flow";
    static constexpr auto shape = FieldShape::scalar;
};

/// The temperature of a node after the step [K].
struct NodeTemperature
{
    static constexpr auto name = "node_temperature";
    static constexpr auto shape = FieldShape::scalar;
};

/// By how much a node has become warmer in the step [K].
struct NodeWarming
{
    static constexpr auto name = "node_warming";
    static constexpr auto shape = FieldShape::scalar;
};

/// Heat that particles carry, and that is conducted between them through the grid:
///
///   dT/dt = div(D grad T),   D = k / (rho c)
///
/// one D for all materials of a scene, all of one heat capacity c. Surfaces, walls and obstacles are
/// insulated. Stomakhin et al. 2014, *Augmented MPM for phase-change and varied materials*, solve the same
/// equation implicitly, at the centres of cells. Here it is explicit, in its weak form on the nodes:
///
///   T_i  = sum_p w_ip m_p T_p / m_i
///   dT_i = - dt sum_p m_p D (grad T)_p . grad w_ip / m_i
///   T_p += sum_i w_ip dT_i,   (grad T)_p = sum_i (T_i + dT_i) grad w_ip
///
/// Particles take the change alone, as in FLIP: where nothing is conducted they keep their temperature to the
/// bit, and the sum of m_p T_p changes by rounding alone. What differs between particles of one cell the grid
/// does not see, and it stays.
///
/// The gradient is that of the step before. After Temperature has been uploaded, the first step conducts by
/// the gradient from before: none for new particles.
struct Conduction
{
    double diffusivity = 0; ///< D, of heat [m^2/s]

    static constexpr auto name = "conduction";
    using State = Fields<Temperature, TemperatureGradient>;
    using Stored = Fields<Temperature>;
    using ScatteredTerms = Fields<NodeHeat, GradientTerm<NodeHeatFlow>>;
    using NodeFields = Fields<NodeTemperature, NodeWarming>;
    using GatheredTerms = Fields<GradientTerm<NodeTemperature>, NodeWarming>;

    void for_each_parameter(auto const& use) const { use("diffusivity", diffusivity); }

    void validate() const
    {
        require(is_number(diffusivity) && diffusivity >= 0 && is_finite(diffusivity),
                "the diffusivity is not a finite number of 0 or above", "Conduction",
                "Pass k / (rho c) in m^2/s: 1.2e-6 for ice, 1.4e-7 for water.");
    }

    /// w_i m T, and - m D grad T . grad w_i.
    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real cell_size, Terms& terms) const
    {
        terms[NodeHeat{}] = particle[Temperature{}] * mass;
        Real const flow = mass * Real(ScalarOf<Real>(-diffusivity)) / cell_size;
        terms[GradientTerm<NodeHeatFlow>{}] = particle[TemperatureGradient{}] * flow;
    }

    /// T_i + dT_i and dT_i.
    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const& sums, Real inverse_mass, Real dt, Values& values) const
    {
        Real const warming = sums[NodeHeatFlow{}] * inverse_mass * dt;
        values[NodeTemperature{}] = sums[NodeHeat{}] * inverse_mass + warming;
        values[NodeWarming{}] = warming;
    }

    /// T += sum w dT_i, and the gradient of T_i + dT_i.
    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle& particle, Terms const& terms, Real inverse_cell_size) const
    {
        particle[Temperature{}] += terms[NodeWarming{}];
        particle[TemperatureGradient{}] = terms[GradientTerm<NodeTemperature>{}] * inverse_cell_size;
    }

    /// h^2 / (g D), g being the kernel's gradient bound.
    ///
    /// The matrix of conduction over the nodes' masses is a sum over particles, so its largest eigenvalue is
    /// at most that of one particle alone: D times the sum of |dN/dx|^2 / N along an axis, at most g D / h^2.
    /// With the gradient of the step before, steps are stable while dt times it is below 1, which is half of
    /// what it might be without that delay.
    template <class Kernel>
    double largest_step(double cell_size) const
    {
        return cell_size * cell_size / (Kernel::gradient_bound * diffusivity);
    }
};

} // namespace firn

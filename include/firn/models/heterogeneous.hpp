// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/models/response.hpp>

#include <limits>
#include <string>

namespace firn
{

/// A solid whose particles are stiffer or softer than one another: each has its own factor of the Lamé
/// moduli, 1 unless told otherwise by `solver.upload<Stiffness>(factors)`.
///
/// An isotropic law is linear in its moduli, so stress and rho_0 c^2 are those of the model times the factor.
/// What is stated in strains stays as it is: snow's critical stretches, the cone of sand. What is stated in
/// stress, such as a yield strength or sand's cohesion, grows with the moduli, so the strains at yield stay,
/// too.
template <class ModelType>
struct Heterogeneous : ModelType
{
    using Model = ModelType;
    using Space = typename Model::Space;
    using State = Join<typename Model::State, Fields<Stiffness>>;
    static_assert(!Viscous<Model>, "viscous stress is not proportional to the moduli");

    /// What is wrong with an uploaded or restored state: what the model says, or a modulus that overflows.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        if constexpr (ObjectsToStates<Model, Particle>)
            if (std::string const said = Model::objection(state); !said.empty()) return said;
        if constexpr (requires { this->elasticity.p_wave_modulus(); }) {
            double const modulus = double(this->elasticity.p_wave_modulus()) * double(state[Stiffness{}]);
            if (!(modulus <= double(std::numeric_limits<typename Space::Scalar>::max())))
                return "a stiffness of " + std::to_string(double(state[Stiffness{}])) +
                       " gives a modulus beyond all numbers";
        }
        return {};
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        return scaled<Real>(Model::template respond<Real>(state, velocity_gradient, dt), state);
    }

    /// The same while nothing flows, and its product with the tangent: see IMPLICIT.md.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    predict(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const requires
        requires(Model const& model)
    {
        model.template predict<Real>(state, velocity_gradient, dt);
    }
    {
        return scaled<Real>(Model::template predict<Real>(state, velocity_gradient, dt), state);
    }
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change) const requires
        requires(Model const& model)
    {
        model.template product<Real>(state, change);
    }
    {
        return Model::template product<Real>(state, change) * state[Stiffness{}];
    }

    /// The elastic energy [J/m^3].
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const requires TellsEnergy<Model, Real, Particle>
    {
        return Model::template energy<Real>(state) * state[Stiffness{}];
    }

private:
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE static Response<Real, Space::dimension> scaled(Response<Real, Space::dimension> response,
                                                                    Particle const& state)
    {
        Real const stiffness = state[Stiffness{}];
        response.kirchhoff_stress = response.kirchhoff_stress * stiffness;
        response.wave_modulus = response.wave_modulus * stiffness;
        return response;
    }
};

} // namespace firn

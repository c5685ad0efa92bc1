// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>

#include <concepts>

// What implicit steps ask materials for, beside their response: see IMPLICIT.md.
namespace firn
{

/// A material whose stress acts on the velocity gradient itself rather than on the change of F: a fluid,
/// whose volume grows by its trace. The stress impulse is V0 tau dt then, without A^-T, and its derivative V0
/// Q dt by dl = dt dL, for which the material answers `product(state, dl, dt)`.
template <class Model>
concept ActsOnRates = requires
{
    requires Model::acts_on_rates;
};

/// A material that answers the product of its tangent: `product(state, dl)` returns Q = dP F^T [Pa], the
/// derivative of the first Piola–Kirchhoff stress P of a state F by dF = dl F, times F^T.
template <class Model, class Real>
concept AnswersProduct = requires(Model const model,
                                  Record<Real, Model::Space::dimension, typename Model::State> const state,
                                  Matrix<Real, Model::Space::dimension> const change)
{
    {
        model.template product<Real>(state, change)
        } -> std::same_as<Matrix<Real, Model::Space::dimension>>;
}
|| (ActsOnRates<Model> &&
    requires(Model const model, Record<Real, Model::Space::dimension, typename Model::State> const state,
             Matrix<Real, Model::Space::dimension> const change, Real dt) {
        {
            model.template product<Real>(state, change, dt)
            } -> std::same_as<Matrix<Real, Model::Space::dimension>>;
    });

/// A material with a response of its own for the solve: `predict(state, L, dt)`, in which nothing flows.
template <class Model, class Particle, class Real>
concept PredictsResponse = requires(Model const model, Particle particle,
                                    Matrix<Real, Model::Space::dimension> const velocity_gradient, Real dt)
{
    model.template predict<Real>(particle, velocity_gradient, dt);
};

} // namespace firn

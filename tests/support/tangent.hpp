// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"

#include <firn/firn.hpp>
#include <firn/models/cached_tangent.hpp>

#include <random>

// A material's product with its tangent, against what it has to be.
namespace firn::test
{

/// A matrix of random numbers of this size.
template <int d>
Matrix<double, d> random_matrix(std::mt19937& random, double size)
{
    std::uniform_real_distribution<double> number(-size, size);
    return make_matrix<double, d>([&](int, int) { return number(random); });
}

/// The first Piola–Kirchhoff stress of a state while nothing flows.
template <class Model, class State>
Matrix<double, Model::Space::dimension> first_piola(Model const& model, State state)
{
    constexpr int d = Model::Space::dimension;
    Matrix<double, d> const H = state[DisplacementGradient{}], none = Matrix<double, d>::Zero();
    Matrix<double, d> tau;
    if constexpr (requires { model.template predict<double>(state, none, 0.0); })
        tau = model.template predict<double>(state, none, 0.0).kirchhoff_stress;
    else
        tau = model.template respond<double>(state, none, 0.0).kirchhoff_stress;
    return tau * (Matrix<double, d>::Identity() + H).inverse().transpose();
}

/// Compares products with differences of the stress, with one another and in a turned frame, and with those
/// of what particles keep of the state. `of` has the fields beside F - I.
template <class Model>
void check_product(Model const& model,
                   Record<double, Model::Space::dimension, typename Model::State> const& of =
                       Record<double, Model::Space::dimension, typename Model::State>::at_rest())
{
    constexpr int d = Model::Space::dimension;
    using M = Matrix<double, d>;
    std::mt19937 random(7);
    for (int i = 0; i < 20; ++i) {
        M const H = i == 0 ? M(0.1 * M::Identity()) : random_matrix<d>(random, 0.3), // equal stretches first
            one = random_matrix<d>(random, 1), other = random_matrix<d>(random, 1), F = M::Identity() + H;
        auto const state_of = [&](M const& now) {
            auto state = of;
            state[DisplacementGradient{}] = now;
            return state;
        };
        auto const state = state_of(H);
        M const Q = model.template product<double>(state, one);
        constexpr double step = 1e-5;
        M const forth = first_piola(model, state_of(H + step * one * F)),
                back = first_piola(model, state_of(H - step * one * F));
        M const difference = (forth - back) / (2 * step) * F.transpose();
        CHECK((Q - difference).norm() <= 1e-8 * Q.norm()); // the error of a difference of second order
        M const of_other = model.template product<double>(state, other);
        CHECK((other.array() * Q.array()).sum() ==
              Approx((one.array() * of_other.array()).sum()).epsilon(1e-11));
        M R = Eigen::HouseholderQR<M>(random_matrix<d>(random, 1)).householderQ();
        if (R.determinant() < 0) R.col(0) *= -1;
        M const turned =
            model.template product<double>(state_of(R * F - M::Identity()), M(R * one * R.transpose()));
        CHECK((turned - R * Q * R.transpose()).norm() <= 1e-12 * Q.norm());
        M const A = M::Identity() + random_matrix<d>(random, 0.2); // of a step that ends in this state
        auto const before = state_of(A.inverse() * F - M::Identity());
        auto const kept =
            CachedTangent<Model>::template of<double>(model, before, state, M(A.inverse().transpose()), 3.0);
        M const S = 3 * model.template product<double>(state, M(one * A.inverse())) * A.inverse().transpose(),
                by_kept = CachedTangent<Model>::template product<double>(model, kept, one, 1.0);
        CHECK((by_kept - S).norm() <= 1e-12 * S.norm());
    }
}

} // namespace firn::test

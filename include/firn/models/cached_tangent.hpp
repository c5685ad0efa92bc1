// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/host_device.hpp>
#include <firn/math/deformation.hpp>
#include <firn/math/product.hpp>
#include <firn/models/answers_product.hpp>
#include <firn/models/elasticity/neo_hookean.hpp>
#include <firn/models/heterogeneous.hpp>

#include <type_traits>

// What particles keep of the state that an implicit step has tried, so that products with its tangent cost
// little: each linear system asks for many of them at the same state.
namespace firn
{

/// The inverse of A = I + dt L, by which a step deforms a particle.
struct InverseStep
{
    static constexpr auto name = "inverse_step";
    static constexpr auto shape = FieldShape::matrix;
};

/// By how much the answer to a change of the velocity gradient is multiplied.
struct TangentScale
{
    static constexpr auto name = "tangent_scale";
    static constexpr auto shape = FieldShape::scalar;
};

/// What a particle of any model keeps for S = scale Q A^-T, the change of its impulse of stress by a change
/// dL of the velocity gradient, Q = dP F^T by dl = dL A^-1. Here it is the state, of which the model answers
/// its product; a specialisation keeps what that is made of.
template <class Model>
struct CachedTangent
{
    static constexpr int d = Model::Space::dimension;
    using Kept = std::conditional_t<ActsOnRates<Model>, Join<Fields<TangentScale>, typename Model::State>,
                                    Join<Fields<TangentScale, InverseStep>, typename Model::State>>;

    /// For a state before the step and after it, and K = A^-T.
    template <Lane Real, class Before, class After>
    FIRN_HOST_DEVICE static Record<Real, d, Kept> of(Model const&, Before const&, After const& after,
                                                     Matrix<Real, d> const& K, Real const& scale)
    {
        Record<Real, d, Kept> kept;
        copy(after, kept, typename Model::State{});
        if constexpr (!ActsOnRates<Model>)
            kept[InverseStep{}] = make_matrix<Real, d>([&](int i, int j) { return K(j, i); });
        kept[TangentScale{}] = scale;
        return kept;
    }

    template <Lane Real>
    FIRN_HOST_DEVICE static Matrix<Real, d> product(Model const& model, Record<Real, d, Kept> const& kept,
                                                    Matrix<Real, d> const& dL,
                                                    [[maybe_unused]] Real const& dt)
    {
        if constexpr (ActsOnRates<Model>)
            return model.template product<Real>(kept, dL, dt) * kept[TangentScale{}];
        else {
            Matrix<Real, d> const& A_inverse = kept[InverseStep{}];
            Matrix<Real, d> const Q =
                model.template product<Real>(kept, firn::product<Real, d>(dL, A_inverse));
            return make_matrix<Real, d>([&](int i, int j) { // Q A^-T
                return kept[TangentScale{}] *
                       sum_of<Real, d>([&](int k) { return Q(i, k) * A_inverse(j, k); });
            });
        }
    }

private:
    template <class From, class To, class... Tags>
    FIRN_HOST_DEVICE static void copy(From const& from, To& to, Fields<Tags...>)
    {
        ((to[Tags{}] = from[Tags{}]), ...);
    }
};

/// The diagonal of a symmetric matrix that is kept.
struct KeptDiagonal
{
    static constexpr auto name = "kept_diagonal";
    static constexpr auto shape = FieldShape::vector;
};
/// And what lies beside it: in space the elements (1, 2), (0, 2), (0, 1).
template <int d>
struct KeptBeside
{
    static constexpr auto name = "kept_beside";
    static constexpr auto shape = d == 3 ? FieldShape::vector : FieldShape::scalar;
};
/// By how much a change turns stress, and how it grows with volume.
struct KeptTurn
{
    static constexpr auto name = "kept_turn";
    static constexpr auto shape = FieldShape::scalar;
};

/// With K = A^-T and b = F F^T, of which A^-1 b A^-T = F_n F_n^T is known before the step:
///
///   S = scale (mu dL F_n F_n^T + (mu - lambda ln J) K dL^T K + lambda (K : dL) K)
template <class Space>
struct CachedTangent<NeoHookean<Space>>
{
    static constexpr int d = Space::dimension;
    using Model = NeoHookean<Space>;
    using Kept = Fields<InverseStep, KeptDiagonal, KeptBeside<d>, KeptTurn, TangentScale>;

    template <Lane Real, class Before, class After>
    FIRN_HOST_DEVICE static Record<Real, d, Kept> of(Model const& model, Before const& before,
                                                     After const& after, Matrix<Real, d> const& K,
                                                     Real const& scale)
    {
        Real const mu = scale * Real(model.elasticity.mu), lambda = scale * Real(model.elasticity.lambda);
        Matrix<Real, d> const strain = squared_stretch_less_one<Real, d>(before[DisplacementGradient{}]);
        Real const growth = volume_change<Real, d>(after[DisplacementGradient{}]); // J - 1
        Record<Real, d, Kept> kept;
        kept[InverseStep{}] = K;
        kept[KeptDiagonal{}] = make_vector<Real, d>([&](int i) { return mu + mu * strain(i, i); });
        if constexpr (d == 3)
            kept[KeptBeside<d>{}] =
                make_vector<Real, d>([&](int i) { return mu * strain(i == 0 ? 1 : 0, i == 2 ? 1 : 2); });
        else
            kept[KeptBeside<d>{}] = mu * strain(0, 1);
        kept[KeptTurn{}] = mu - lambda * log_one_plus(select(growth > Real(-1), growth, Real(0)));
        kept[TangentScale{}] = lambda;
        return kept;
    }

    template <Lane Real>
    FIRN_HOST_DEVICE static Matrix<Real, d> product(Model const&, Record<Real, d, Kept> const& kept,
                                                    Matrix<Real, d> const& dL, Real const&)
    {
        Matrix<Real, d> const& K = kept[InverseStep{}];
        auto const b = [&](int i, int j) -> Real const& {
            if (i == j) return kept[KeptDiagonal{}][i];
            if constexpr (d == 3)
                return kept[KeptBeside<d>{}][3 - i - j];
            else
                return kept[KeptBeside<d>{}];
        };
        Real const grown = kept[TangentScale{}] * sum_of<Real, d>([&](int i) {
                               return sum_of<Real, d>([&](int j) { return K(i, j) * dL(i, j); });
                           });
        Matrix<Real, d> const turned = make_matrix<Real, d>([&](int i, int j) { // K dL^T, and what is grown
            Real const sum = kept[KeptTurn{}] * sum_of<Real, d>([&](int k) { return K(i, k) * dL(j, k); });
            return i == j ? sum + grown : sum;
        });
        return make_matrix<Real, d>([&](int i, int j) {
            return sum_of<Real, d>([&](int k) { return dL(i, k) * b(k, j); }) +
                   sum_of<Real, d>([&](int k) { return turned(i, k) * K(k, j); });
        });
    }
};

/// A solid's own, times the stiffness of the particle.
template <class Model>
struct CachedTangent<Heterogeneous<Model>> : CachedTangent<Model>
{
    using Base = CachedTangent<Model>;
    using Base::d;
    using typename Base::Kept;

    template <Lane Real, class Before, class After>
    FIRN_HOST_DEVICE static Record<Real, d, Kept> of(Model const& model, Before const& before,
                                                     After const& after, Matrix<Real, d> const& K,
                                                     Real const& scale)
    {
        return Base::template of<Real>(model, before, after, K, scale * after[Stiffness{}]);
    }
};

} // namespace firn

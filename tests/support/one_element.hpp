// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <utility>

// One particle of a material, driven by its deformation gradient: the energies that stresses must come from,
// and deformations within the elastic range and beyond it.
namespace firn::test
{

/// The energies of the elastic laws [Pa].
template <int d>
double energy(FixedCorotatedLaw, Lame<double> const& elasticity, Matrix<double, d> const& F)
{
    double const J = F.determinant();
    return elasticity.mu * (singular_values(F).sigma - Vector<double, d>::Ones()).squaredNorm() +
           0.5 * elasticity.lambda * (J - 1) * (J - 1);
}

template <int d>
double energy(HenckyLaw, Lame<double> const& elasticity, Matrix<double, d> const& F)
{
    Vector<double, d> const strains = singular_values(F).sigma.array().log();
    return elasticity.mu * strains.squaredNorm() + 0.5 * elasticity.lambda * std::pow(strains.sum(), 2);
}

template <int d>
double energy(SplitNeoHookeanLaw, Lame<double> const& elasticity, Matrix<double, d> const& F)
{
    double const J = F.determinant(), bulk = elasticity.lambda + 2 * elasticity.mu / d;
    return 0.5 * elasticity.mu * (std::pow(J, -2.0 / d) * F.squaredNorm() - d) +
           0.5 * bulk * (0.5 * (J * J - 1) - std::log(J));
}

/// The energy of a model; of snow before it has hardened.
template <class Law, class Flow, int d = Flow::Space::dimension>
double energy(Elastoplastic<Law, Flow> const& model, Matrix<double, d> const& F)
{
    return energy<d>(Law{}, model.elasticity, F);
}

template <class SpaceType, int d = SpaceType::dimension>
double energy(NeoHookean<SpaceType> const& model, Matrix<double, d> const& F)
{
    double const log_J = std::log(F.determinant());
    return 0.5 * model.elasticity.mu * (F.squaredNorm() - d) - model.elasticity.mu * log_J +
           0.5 * model.elasticity.lambda * log_J * log_J;
}

/// A particle of a model, whatever the precision of the model: driven and asked in double.
template <class Model>
struct OneElement
{
    using Space = typename Model::Space;
    using Number = typename Space::Real;
    static constexpr int d = Space::dimension;
    using Tensor = Matrix<double, d>;
    using State = Record<Number, d, typename Model::State>;
    Model model{};

    /// The answer of a particle at rest to a deformation gradient reached in one step [of 1 s].
    Response<Number, d> answer(State& state, Tensor const& F) const
    {
        return model.template respond<Number>(
            state, Matrix<Number, d>((F - Tensor::Identity()).template cast<Number>()), Number(1));
    }

    Tensor stress(Tensor const& F) const
    {
        auto state = State::at_rest();
        return answer(state, F).kirchhoff_stress.template cast<double>();
    }

    static Tensor elastic_part(State const& state)
    {
        return deformation_gradient<double, d>(Tensor(state[DisplacementGradient{}].template cast<double>()));
    }
};

/// A deformation gradient: a rotation times stretches within bounds.
template <int d>
Matrix<double, d> random_deformation(std::mt19937& random, double low, double high)
{
    std::uniform_real_distribution<double> stretch(low, high);
    Matrix<double, d> S = Matrix<double, d>::Zero();
    for (int a = 0; a < d; ++a) S(a, a) = stretch(random);
    Matrix<double, d> const V = random_rotation<d>(random);
    return random_rotation<d>(random) * V * S * V.transpose();
}

/// Stretches at which a model's default parameters do not yield.
template <class Model>
std::pair<double, double> elastic_range()
{
    using Space = typename Model::Space;
    if constexpr (std::is_same_v<Model, Snow<Space>>)
        return {0.98, 1.007};
    else if constexpr (std::is_same_v<Model, VonMises<Space>> ||
                       std::is_same_v<Model, HardeningVonMises<Space>>)
        return {0.997, 1.003};
    else if constexpr (std::is_same_v<Model, Sand<Space>>)
        return {0.9, 0.905};
    else if constexpr (std::is_same_v<Model, CamClay<Space>>)
        return {0.9965, 0.9995};
    else if constexpr (std::is_same_v<Model, HerschelBulkley<Space>>)
        return {0.999, 1.001};
    else
        return {0.6, 1.7};
}

template <class Model>
Matrix<double, Model::Space::dimension> elastic_deformation(std::mt19937& random)
{
    auto const [low, high] = elastic_range<Model>();
    return random_deformation<Model::Space::dimension>(random, low, high);
}

template <class... Lists>
using Concatenated = decltype(std::tuple_cat(std::declval<Lists>()...));

template <class Space>
using ElasticSolids =
    std::tuple<NeoHookean<Space>, FixedCorotated<Space>, Hencky<Space>, SplitNeoHookean<Space>>;
template <class Space>
using YieldingSolids = std::tuple<Snow<Space>, VonMises<Space>, HardeningVonMises<Space>, Sand<Space>,
                                  CamClay<Space>, HerschelBulkley<Space>>;
template <class Space>
using SolidsIn = Concatenated<ElasticSolids<Space>, YieldingSolids<Space>>;
template <class Space>
using MaterialsIn = Concatenated<SolidsIn<Space>, std::tuple<Fluid<Space>>>;

} // namespace firn::test

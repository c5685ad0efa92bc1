// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <utility>

// Single particles of a material, driven by their deformation gradients: their energies, and deformations
// within the elastic range and beyond it.
namespace firn::test
{

/// The energy [J/m^3] of a deformation gradient that does not yield; of snow before it has hardened.
template <class Law, class Flow, int d = Flow::Space::dimension>
double energy(Elastoplastic<Law, Flow> const& model, Matrix<double, d> const& F)
{
    Law const& law = model;
    auto const axes = principal_axes<double, d>(F - Matrix<double, d>::Identity());
    return law.template energy<double, d>(law.template strains<double, d>(axes.extension),
                                          double(model.elasticity.mu), double(model.elasticity.lambda));
}

template <class Model, int d = Model::Space::dimension>
    requires(!requires { typename Model::Flow; })
double energy(Model const& model, Matrix<double, d> const& F)
{
    auto state = Record<double, d, typename Model::State>::at_rest();
    state[DisplacementGradient{}] = F - Matrix<double, d>::Identity();
    return model.template energy<double>(state);
}

/// The elastic energy [J] of a scene's particles, all of one rest volume [m^3], before any hardening.
template <class Solver>
double elastic_energy(Solver const& solver, double volume)
{
    constexpr int d = Solver::d;
    double sum = 0;
    for (auto const& H : solver.template download<DisplacementGradient>())
        sum += volume * energy(solver.model(),
                               Matrix<double, d>(Matrix<double, d>::Identity() + H.template cast<double>()));
    return sum;
}

/// The same and their kinetic energy.
template <class Solver>
double mechanical_energy(Solver const& solver, double volume)
{
    return Totals(solver).kinetic_energy + elastic_energy(solver, volume);
}

namespace detail
{
/// The path of the particles, where a backend's loops can reach it: component after component, those of all
/// particles `stride` apart.
template <class Number>
struct Drives
{
    Number *states, *answers; ///< told: stress, wave modulus, inverted, capped
    Number const* rates;      ///< velocity gradients, step after step [1/s]
    std::size_t stride;
    int steps, times;
    Number dt; ///< [s]
};

/// Runs one lane's worth of particles through their steps.
template <class Model, class Real>
struct DriveElements
{
    static constexpr int d = Model::Space::dimension;
    Model model;
    Drives<typename Model::Space::Scalar> drives;

    FIRN_HOST_DEVICE void operator()(std::size_t group) const
    {
        auto const& all = drives;
        std::size_t const first = group * lane_width<Real>;
        auto particle = Record<Real, d, typename Model::State>::at_rest();
        particle.for_each(
            [&](int c, Real& value) { value = LaneTraits<Real>::load(all.states + c * all.stride + first); });
        Response<Real, d> answer{Matrix<Real, d>::Zero(), Real(0), no_lanes<Real>(), no_lanes<Real>()};
        for (int step = 0; step < all.steps * all.times; ++step) {
            auto const* const rates = all.rates + step % all.steps * (d * d) * all.stride + first;
            Matrix<Real, d> L;
            for (int c = 0; c < d * d; ++c) L(c / d, c % d) = LaneTraits<Real>::load(rates + c * all.stride);
            answer = model.template respond<Real>(particle, L, Real(all.dt));
        }
        particle.for_each(
            [&](int c, Real& value) { LaneTraits<Real>::store(value, all.states + c * all.stride + first); });
        auto const tell = [&](int c, Real const& value) {
            LaneTraits<Real>::store(value, all.answers + c * all.stride + first);
        };
        for (int c = 0; c < d * d; ++c) tell(c, answer.kirchhoff_stress(c / d, c % d));
        tell(d * d, answer.wave_modulus);
        tell(d * d + 1, select(answer.inverted, Real(1), Real(0)));
        tell(d * d + 2, select(answer.capped, Real(1), Real(0)));
    }
};

/// Brings particles with what they keep to the tested backend, has `launch` drive them there, a lane's worth
/// at a time, and brings back what they have become: the same for all models that keep the same.
template <class Number, int d, class Kept>
std::vector<Response<Number, d>>
drive_elements(void const* model, void (*launch)(void const*, std::size_t, Drives<Number> const&),
               std::size_t width, std::vector<Record<Number, d, Kept>>& states,
               std::vector<std::vector<Matrix<double, d>>> const& path, double dt, int times)
{
    std::size_t const groups = (states.size() + width - 1) / width, stride = groups * width;
    std::vector<Number> kept(stride * Kept::components(d)), rates(stride * d * d * path.size()),
        told(stride * (d * d + 3));
    for (std::size_t i = 0; i < stride; ++i) { // those behind the last are at rest
        auto state = i < states.size() ? states[i] : Record<Number, d, Kept>::at_rest();
        state.for_each([&](int c, Number const& value) { kept[c * stride + i] = value; });
    }
    for (std::size_t step = 0; step < path.size(); ++step)
        for (std::size_t i = 0; i < states.size(); ++i)
            for (int c = 0; c < d * d; ++c)
                rates[(step * d * d + c) * stride + i] = static_cast<Number>(path[step][i](c / d, c % d));

    TestedBackend const backend{};
    using Array = typename TestedBackend::template Array<Number>;
    Array kept_there(backend), rates_there(backend), told_there(backend);
    auto const upload = [](Array& to, std::vector<Number> const& from) {
        to.resize(from.size());
        to.upload(0, from);
    };
    upload(kept_there, kept);
    upload(rates_there, rates);
    told_there.resize(told.size());
    launch(model, groups,
           {kept_there.data(), told_there.data(), rates_there.data(), stride, static_cast<int>(path.size()),
            times, static_cast<Number>(dt)});
    kept_there.download(0, kept);
    told_there.download(0, told);

    std::vector<Response<Number, d>> answers(states.size());
    for (std::size_t i = 0; i < states.size(); ++i) {
        states[i].for_each([&](int c, Number& value) { value = kept[c * stride + i]; });
        auto const at = [&](int c) { return told[c * stride + i]; };
        for (int c = 0; c < d * d; ++c) answers[i].kirchhoff_stress(c / d, c % d) = at(c);
        answers[i].wave_modulus = at(d * d);
        answers[i].inverted = at(d * d + 1) != 0;
        answers[i].capped = at(d * d + 2) != 0;
    }
    return answers;
}
} // namespace detail

/// Particles of a model that are driven by their deformation and asked in double, whatever the precision of
/// the model: on the tested backend, as many at a time as its lanes hold, or lanes of another type.
template <class Model, class LaneType = TestedLane<typename Model::Space::Scalar>>
struct OneElement
{
    using Space = typename Model::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    using Tensor = Matrix<double, d>;
    using State = Record<Number, d, typename Model::State>;
    using Answer = Response<Number, d>;
    Model model{};

    /// The last responses of particles that go through steps of `dt` [s] with velocity gradients
    /// `path[step][particle]` [1/s], all of it several times. The states become those at the end.
    std::vector<Answer> drive(std::vector<State>& states, std::vector<std::vector<Tensor>> const& path,
                              double dt, int times = 1) const
    {
        auto const launch = [](void const* of, std::size_t groups, detail::Drives<Number> const& drives) {
            using Drive = detail::DriveElements<Model, LaneType>;
            TestedBackend{}.for_each(groups, Drive{*static_cast<Model const*>(of), drives});
        };
        return detail::drive_elements<Number, d>(&model, +launch, lane_width<LaneType>, states, path, dt,
                                                 times);
    }

    /// The answers of particles to deformation gradients reached in one step from where they are.
    std::vector<Answer> answers(std::vector<State>& states, std::vector<Tensor> const& F) const
    {
        std::vector<Tensor> rates;
        for (auto const& to : F) rates.push_back(to - Tensor::Identity());
        return drive(states, {rates}, 1);
    }
    /// The stresses of particles at rest that are deformed in one step [Pa].
    std::vector<Tensor> stresses(std::vector<Tensor> const& F) const
    {
        auto states = at_rest(F.size());
        std::vector<Tensor> tau;
        for (auto const& answer : answers(states, F))
            tau.push_back(answer.kirchhoff_stress.template cast<double>());
        return tau;
    }
    static std::vector<State> at_rest(std::size_t count)
    {
        return std::vector<State>(count, State::at_rest());
    }

    // of one particle

    Answer drive(State& state, std::vector<Tensor> const& path, double dt, int times = 1) const
    {
        std::vector<State> states{state};
        std::vector<std::vector<Tensor>> steps;
        for (auto const& rate : path) steps.push_back({rate});
        auto const answer = drive(states, steps, dt, times).front();
        state = states.front();
        return answer;
    }
    Answer step(State& state, Tensor const& rate, double dt, int times = 1) const
    {
        return drive(state, std::vector<Tensor>{rate}, dt, times);
    }
    Answer answer(State& state, Tensor const& F) const { return step(state, F - Tensor::Identity(), 1); }
    Tensor stress(Tensor const& F) const { return stresses({F}).front(); }

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

/// A list of types, but for those that Combinations leaves out.
template <class List>
struct OfList;
template <class... Types>
struct OfList<std::tuple<Types...>>
{
    using Type = Combinations<Types...>;
};
template <class... Lists>
using Tested = typename OfList<Concatenated<Lists...>>::Type;

template <class Space>
using SolidsIn = Concatenated<ElasticModels<Space>, PlasticModels<Space>>;
using AllMaterials = Tested<firn::AllModels<Plane>, firn::AllModels<Solid>>;

} // namespace firn::test

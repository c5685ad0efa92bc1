// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>
#include <firn/models/response.hpp>

#include <bit>
#include <concepts>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>

namespace firn
{

/// What tags of parameters have in common that differ from particle to particle. Each has a name of its own
/// and says which member of a model it is:
///
///     struct OwnCone : firn::ParameterOfParticles
///     {
///         static constexpr auto name = "own_cone";
///         FIRN_HOST_DEVICE static auto& of(auto& model) { return model.cone; }
///     };
struct ParameterOfParticles
{
    static constexpr auto shape = FieldShape::scalar;
};

/// The slope alpha of sand's cone: see friction_cone.
struct OwnCone : ParameterOfParticles
{
    static constexpr auto name = "own_cone";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.cone)) { return model.cone; }
};

/// The dilatancy beta of sand: see dilatancy_cone.
struct OwnDilatancy : ParameterOfParticles
{
    static constexpr auto name = "own_dilatancy";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.dilatancy)) { return model.dilatancy; }
};

/// The cohesion of sand [Pa], or of Cam-Clay [-].
struct OwnCohesion : ParameterOfParticles
{
    static constexpr auto name = "own_cohesion";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.cohesion)) { return model.cohesion; }
};

/// The yield stress of von Mises' solids and of fluids that have one [Pa].
struct OwnYieldStress : ParameterOfParticles
{
    static constexpr auto name = "own_yield_stress";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.yield_stress))
    {
        return model.yield_stress;
    }
};

/// The shear modulus mu of a solid [Pa].
struct OwnShearModulus : ParameterOfParticles
{
    static constexpr auto name = "own_shear_modulus";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.elasticity.mu))
    {
        return model.elasticity.mu;
    }
};

/// Lamé's lambda of a solid [Pa].
struct OwnLambda : ParameterOfParticles
{
    static constexpr auto name = "own_lambda";
    FIRN_HOST_DEVICE static auto of(auto& model) -> decltype((model.elasticity.lambda))
    {
        return model.elasticity.lambda;
    }
};

namespace detail
{
template <class Tag, class Model>
concept VariesParameter = Tag::shape == FieldShape::scalar&& requires(Model& model)
{
    {
        Tag::of(model)
        } -> std::same_as<typename Model::Space::Scalar&>;
};
} // namespace detail

/// A material with some parameters of each particle's own, for example `Varied<Sand<Space>, OwnCone,
/// OwnCohesion>`. Particles that are added have those of the model, and `upload<OwnCone>(values)` or `assign`
/// sets others, in the unit of the member. Values with which the model would refuse to be made are refused.
///
/// Each particle is computed with the model that has its own values, so all that the model does holds for
/// it. In a pack of numbers that is done once for each set of values in the pack, so it costs little more
/// where neighbours have the same. A density is passed to add(): see Volumes.
template <class ModelType, class... Tags>
struct Varied : ModelType
{
    using Model = ModelType;
    using Space = typename Model::Space;
    using Number = typename Space::Scalar;
    using State = Join<typename Model::State, Fields<Tags...>>;
    static constexpr int d = Space::dimension;
    static_assert(sizeof...(Tags) > 0, "Varied<Model, Tag...> names the parameters that vary");
    static_assert((detail::VariesParameter<Tags, Model> && ...),
                  "a parameter that varies is a number of the model, and has a scalar tag with 'static auto& "
                  "of(auto& model)', which returns it: see ParameterOfParticles");

    /// Throws an Error unless the model's own parameters make sense, and those that vary may.
    void validate() const
    {
        Model::validate();
        require(!(is_in<Tags>(this->density) || ...), "the density of particles is not varied", "Varied",
                "Pass densities of particles to add(): see Volumes.");
    }

    /// Sets the values of particles that are added: the model's.
    template <class Particle>
    void set_defaults(Particle& particle) const
    {
        ((particle[Tags{}] = Tags::of(model())), ...);
        if constexpr (requires { model().set_defaults(particle); }) model().set_defaults(particle);
    }

    /// What is wrong with an uploaded or restored state: what the model with its values says.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        Model const own = with(state);
        try {
            own.validate();
        }
        catch (Error const& error) {
            return error.what_is_wrong();
        }
        if constexpr (Viscous<Model>)
            if (own.kinematic_viscosity() > this->kinematic_viscosity())
                return "a viscosity is above the model's, which bounds the time step";
        if constexpr (ObjectsToStates<Model, Particle>) return own.objection(state);
        return {};
    }

    /// The largest ratio of the modulus of an expansion to that of waves: see Lame::expansion_ratio.
    double expansion_ratio(int dimension) const
    {
        if constexpr (requires { this->elasticity.expansion_ratio(dimension); })
            if (!(is_in<Tags>(this->elasticity) || ...)) return this->elasticity.expansion_ratio(dimension);
        return dimension;
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, d> respond(Particle& state, Matrix<Real, d> const& velocity_gradient,
                                               Real dt) const
    {
        return answer<Real>(state, [&](Model const& own, Particle& of) {
            return own.template respond<Real>(of, velocity_gradient, dt);
        });
    }

    /// The same while nothing flows, and the product with the tangent: see IMPLICIT.md.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, d> predict(Particle& state, Matrix<Real, d> const& velocity_gradient,
                                               Real dt) const requires requires(Model const& model)
    {
        model.template predict<Real>(state, velocity_gradient, dt);
    }
    {
        return answer<Real>(state, [&](Model const& own, Particle& of) {
            return own.template predict<Real>(of, velocity_gradient, dt);
        });
    }
    template <Lane Real, class Particle, class... OfStep>
    FIRN_HOST_DEVICE Matrix<Real, d> product(Particle const& state, Matrix<Real, d> const& change,
                                             OfStep const&... dt) const requires requires(Model const& model)
    {
        model.template product<Real>(state, change, dt...);
    }
    {
        if constexpr (lane_width<Real> == 1)
            return with(state).template product<Real>(state, change, dt...);
        else {
            Matrix<Real, d> all = zeros<Matrix<Real, d>>();
            for_each_model<Real>(state, [&](Model const& own, Mask<Real> const& which) {
                Matrix<Real, d> const Q = own.template product<Real>(state, change, dt...);
                all = make_matrix<Real, d>([&](int i, int j) { return select(which, Q(i, j), all(i, j)); });
            });
            return all;
        }
    }

    /// The elastic energy [J/m^3].
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const requires TellsEnergy<Model, Real, Particle>
    {
        if constexpr (lane_width<Real> == 1) // a state at rest may be computed in double, too
            return with(state).template energy<Real>(state);
        else {
            Real all(0);
            for_each_model<Real>(state, [&](Model const& own, Mask<Real> const& which) {
                all = select(which, own.template energy<Real>(state), all);
            });
            return all;
        }
    }

private:
    FIRN_HOST_DEVICE Model const& model() const { return *this; }

    /// The response of each lane's model, `ask(model, state)`.
    template <Lane Real, class Particle, class Ask>
    FIRN_HOST_DEVICE Response<Real, d> answer(Particle& state, Ask const& ask) const
    {
        if constexpr (lane_width<Real> == 1) // a state at rest may be computed in double, too
            return ask(with(state), state);
        else {
            Particle const before = state;
            Response<Real, d> all;
            bool is_first = true;
            for_each_model<Real>(before, [&](Model const& own, Mask<Real> const& which) {
                Particle after = before;
                auto const response = ask(own, after);
                if (is_first) { // whatever it is in the other lanes, they get their own
                    state = after;
                    all = response;
                    is_first = false;
                    return;
                }
                for_each_tag(typename Model::State{}, [&](auto tag) {
                    using Tag = decltype(tag);
                    for_each_component<Tag, d>(state[tag], [&](int c, Real& value) {
                        value = select(which, component_of<Tag, d>(after[tag], c), value);
                    });
                });
                for (int i = 0; i < d; ++i)
                    for (int j = 0; j < d; ++j)
                        all.kirchhoff_stress(i, j) =
                            select(which, response.kirchhoff_stress(i, j), all.kirchhoff_stress(i, j));
                all.wave_modulus = select(which, response.wave_modulus, all.wave_modulus);
                all.inverted = (which & response.inverted) | ((!which) & all.inverted);
                all.capped = (which & response.capped) | ((!which) & all.capped);
            });
            return all;
        }
    }

    /// The model with a particle's own values.
    template <class Particle>
    FIRN_HOST_DEVICE Model with(Particle const& state) const
    {
        Model own = model();
        ((Tags::of(own) = static_cast<Number>(state[Tags{}])), ...);
        return own;
    }

    /// Calls `use(model, which)` for each set of values in lanes of particles, and the lanes that have it.
    template <class Real, class Particle, class Use>
    void for_each_model(Particle const& state, Use const& use) const
    {
        constexpr int width = lane_width<Real>;
        Number values[sizeof...(Tags)][std::size_t(width)];
        std::size_t tag = 0;
        (LaneTraits<Real>::store(state[Tags{}], values[tag++]), ...);
        std::uint64_t rest = ~std::uint64_t(0) >> (64 - width);
        while (rest != 0) {
            auto const lane = static_cast<std::size_t>(std::countr_zero(rest));
            Model own = model();
            Mask<Real> which = exactly_equal(Real(0), Real(0));
            tag = 0;
            ((Tags::of(own) = values[tag][lane],
              which = which & exactly_equal(state[Tags{}], Real(values[tag++][lane]))),
             ...);
            use(own, which);
            rest &= ~(bits(which) | std::uint64_t(1) << lane); // a lane without a particle may hold NaN
        }
    }

    /// Whether a tag's parameter is a part of a member of the model.
    template <class Tag, class Member>
    bool is_in(Member const& member) const
    {
        auto const* const at = reinterpret_cast<unsigned char const*>(&Tag::of(model()));
        auto const* const begin = reinterpret_cast<unsigned char const*>(&member);
        return !std::less<>{}(at, begin) && std::less<>{}(at, begin + sizeof(Member));
    }
};

} // namespace firn

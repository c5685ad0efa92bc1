// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/parameters.hpp>
#include <firn/effects/effect.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/response.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/transfer.hpp>

#include <array>
#include <concepts>
#include <string_view>

// Every kind of policy on one page: the requirements on a kernel, a transfer scheme, a field that it carries,
// and a material. Effects are in effects/effect.hpp, shapes in effects/shapes/shape.hpp, lanes in
// core/lane.hpp, backends in backend.hpp.
namespace firn
{

/// An interpolation kernel: weights and derivatives of its degree + 1 nodes per axis, and the polynomial that
/// they form within a cell (see grid/cell_polynomial.hpp). With a constant inertia also `spreads(t)`: what
/// each term of the polynomial contributes to the sum of w_i v_i (x_i - x_p) D^-1.
template <class T, class Real = double>
concept InterpolationKernel = Lane<Real> && requires(Real t, std::array<Real, T::degree + 1> nodes)
{
    requires T::degree >= 1;
    {
        T::gradient_bound
        } -> std::convertible_to<double>;
    {
        T::weights(t)
        } -> std::same_as<std::array<Real, T::degree + 1>>;
    {
        T::derivatives(t)
        } -> std::same_as<std::array<Real, T::degree + 1>>;
    {
        T::expanded(nodes)
        } -> std::same_as<std::array<Real, T::degree + 1>>;
    requires !HasConstantInertia<T> || requires
    {
        {
            T::spreads(t)
            } -> std::same_as<std::array<Real, T::degree>>;
    };
};

/// The requirements on a transfer scheme, member by member, so that the compiler can name the missing one.
namespace detail
{
template <class T>
concept HasFieldsOfTransfer = requires
{
    {
        T::State::components(2)
        } -> std::convertible_to<int>;
};

template <class T>
concept HasStored = requires
{
    {
        T::Stored::components(2)
        } -> std::convertible_to<int>;
};

template <class T, class Kernel>
concept HasScatterTerms = requires
{
    {
        T::template scatter_terms<Kernel>
        } -> std::convertible_to<Terms>;
};

template <class T, class Kernel>
concept HasGatherTerms = requires
{
    {
        T::template gather_terms<Kernel>
        } -> std::convertible_to<Terms>;
};

template <class T>
concept SaysWhatItKeeps = requires
{
    {
        T::keeps_old_velocity
        } -> std::convertible_to<bool>;
};

template <class T>
concept SaysHowItMoves = requires
{
    {
        T::moves_with_grid
        } -> std::convertible_to<bool>;
};

/// Of a particle's own velocity: see Flip.
template <class T>
concept HasFraction = requires(T const transfer)
{
    {
        transfer.fraction
        } -> std::convertible_to<double>;
};

template <class T, class Kernel, class Real, int d>
concept Scatters = requires(T const transfer, Record<Real, d, typename T::State> particle,
                            Matrix<Real, d> stress_impulse, Real number)
{
    {
        transfer.template scatter<Kernel, Real, d>(particle, number, stress_impulse, number)
        } -> std::same_as<ParticleContribution<Real, d>>;
};

template <class T, class Kernel, class Real, int d>
concept Gathers = requires(T const transfer, Record<Real, d, typename T::State> particle,
                           Gathered<Real, d> gathered, Real number)
{
    {
        transfer.template gather<Kernel, Real, d>(particle, gathered, number)
        } -> std::same_as<Matrix<Real, d>>;
};

template <class T, class Kernel, class Real, int d>
concept MovesParticles = requires(T const transfer, Record<Real, d, typename T::State> particle,
                                  Gathered<Real, d> gathered)
{
    {
        transfer.template motion<Kernel, Real, d>(particle, gathered)
        } -> std::same_as<Vector<Real, d>>;
};

template <class T>
concept KeepsOldVelocity = SaysWhatItKeeps<T> && T::keeps_old_velocity;

template <class T>
concept HasFractionIfItKeeps = !KeepsOldVelocity<T> || HasFraction<T>;

/// v^n - v* is stored in place of the old velocity: see Xpic.
template <class T>
concept KeepsIfItExtends = !ExtendsVelocities<T> || KeepsOldVelocity<T>;

template <class T, class Kernel, class Real, int d>
concept HasMotion = bool(T::moves_with_grid) || MovesParticles<T, Kernel, Real, d>;
} // namespace detail

/// A transfer scheme: the fields it adds to a particle, those of them that are stored from step to step, the
/// terms it needs, and its scatter and gather. One that keeps the old velocity has a `fraction`, and one that
/// does not move with the grid a `motion`: see Asflip. It may name its parameters, too: see SaysParameters.
template <class T, class Kernel, class Real, int d>
concept TransferScheme = Lane<Real> && detail::HasFieldsOfTransfer<T> && detail::HasStored<T> &&
    detail::HasScatterTerms<T, Kernel> && detail::HasGatherTerms<T, Kernel> && detail::SaysWhatItKeeps<T> &&
    detail::SaysHowItMoves<T> && detail::HasFractionIfItKeeps<T> && detail::KeepsIfItExtends<T> &&
    detail::Scatters<T, Kernel, Real, d> && detail::Gathers<T, Kernel, Real, d> &&
    detail::HasMotion<T, Kernel, Real, d>;

/// The requirements on what a transfer scheme carries, member by member.
namespace detail
{
template <class T>
concept HasFieldLists = requires
{
    T::State::components(2) + T::Stored::components(2) + T::NodeFields::components(2);
    T::ScatteredTerms::components(2) + T::GatheredTerms::components(2);
};

template <class T, class Real, int d>
concept ScattersField = requires(T const policy, Record<Real, d, typename T::State> const particle,
                                 Record<Real, d, typename T::ScatteredTerms> terms, Real number)
{
    policy.template scatter<Real, d>(particle, number, number, terms);
};

template <class T, class Real, int d>
concept UpdatesField = requires(T const policy,
                                Record<Real, d, FieldsOfTerms<typename T::ScatteredTerms>> const sums,
                                Record<Real, d, typename T::NodeFields> values, Real number)
{
    policy.template update<Real, d>(sums, number, number, values);
};

template <class T, class Real, int d>
concept GathersField = requires(T const policy, Record<Real, d, typename T::State> particle,
                                Record<Real, d, typename T::GatheredTerms> const terms, Real number)
{
    policy.template gather<Real, d>(particle, terms, number);
};

template <class T>
concept IsNamed = requires
{
    std::string_view(T::name);
};

/// Whether a bound on the step is called as the library calls it, or there is none.
template <class T>
concept BoundsStepsOrNot = requires(T const policy)
{
    {
        policy.template largest_step<QuadraticBSpline>(1.0)
        } -> std::convertible_to<double>;
}
|| !(
       requires(T policy) { policy.largest_step(1.0); } ||
       requires(T policy) { policy.template largest_step<QuadraticBSpline>(1.0); });
} // namespace detail

/// A field that a transfer scheme carries through the grid (see transfer/carrying.hpp): its lists, and what
/// becomes of it in the scatter, on a node and in the gather. It may have a largest_step, and name its
/// parameters: see SaysParameters.
template <class T, class Real, int d>
concept CarriedField = Lane<Real> && detail::HasFieldLists<T> && detail::ScattersField<T, Real, d> &&
    detail::UpdatesField<T, Real, d> && detail::GathersField<T, Real, d> && detail::IsNamed<T> &&
    detail::BoundsStepsOrNot<T>;

namespace detail
{
/// Reports in a sentence which member a carried field lacks.
template <class Policy, class Real, int d>
struct CompleteField
{
    static_assert(HasFieldLists<Policy>,
                  "the carried field lacks a list: using State, Stored, ScatteredTerms, NodeFields and "
                  "GatheredTerms = firn::Fields<...>");
    static_assert(!HasFieldLists<Policy> || ScattersField<Policy, Real, d>,
                  "the carried field lacks 'template <firn::Lane Real, int d, class Particle, class Terms> "
                  "void scatter(Particle const&, Real mass, Real cell_size, Terms&) const'");
    static_assert(!HasFieldLists<Policy> || UpdatesField<Policy, Real, d>,
                  "the carried field lacks 'template <firn::Lane Real, int d, class Sums, class Values> "
                  "void update(Sums const&, Real inverse_mass, Real dt, Values&) const'");
    static_assert(!HasFieldLists<Policy> || GathersField<Policy, Real, d>,
                  "the carried field lacks 'template <firn::Lane Real, int d, class Particle, class Terms> "
                  "void gather(Particle&, Terms const&, Real inverse_cell_size) const'");
    static_assert(IsNamed<Policy>, "the carried field lacks 'static constexpr auto name'");
    static_assert(BoundsStepsOrNot<Policy>,
                  "the carried field's bound on steps is to be 'template <class Kernel> double "
                  "largest_step(double cell_size) const'");
    static constexpr bool value = CarriedField<Policy, Real, d>;
};

template <class Real, int d, class... Policies>
constexpr bool are_carried(CarriedFields<Policies...> const*)
{
    return (CompleteField<Policies, Real, d>::value && ...);
}
} // namespace detail

/// The requirements on a material, member by member, so that the compiler can name the missing one.
namespace detail
{
template <class T>
concept HasSpace = requires
{
    typename T::Space::Scalar;
    {
        T::Space::dimension
        } -> std::convertible_to<int>;
};

template <class T>
concept HasState = requires
{
    {
        T::State::components(T::Space::dimension)
        } -> std::convertible_to<int>;
};

template <class T>
concept HasDensity = requires(T const model)
{
    {
        model.density
        } -> std::convertible_to<double>;
};

template <class T>
concept HasValidate = requires(T const model)
{
    model.validate();
};

template <class T, class Real>
concept Responds = requires(T const model, Record<Real, T::Space::dimension, typename T::State> state,
                            Matrix<Real, T::Space::dimension> velocity_gradient, Real dt)
{
    {
        model.template respond<Real>(state, velocity_gradient, dt)
        } -> std::same_as<Response<Real, T::Space::dimension>>;
};
} // namespace detail

/// A material: its fields, its density, a check of its parameters, and ONE call that evolves the state and
/// returns stress and wave modulus: `Response<Real, d> respond(state&, velocity_gradient, dt) const`, which
/// is FIRN_HOST_DEVICE if it is to run on devices. It may name its parameters and have an `objection(state)`,
/// too: see SaysParameters and ObjectsToStates.
template <class T, class Real>
concept ConstitutiveModel = Lane<Real> && detail::HasSpace<T> && detail::HasState<T> &&
    detail::HasDensity<T> && detail::HasValidate<T> && detail::Responds<T, Real>;

namespace detail
{
/// Reports in a sentence which member a material lacks; the compiler's note beside it names the model.
template <class Model, class Real>
struct Complete
{
    static_assert(HasState<Model>,
                  "the model lacks 'using State = firn::Fields<...>', what a particle of it keeps");
    static_assert(HasDensity<Model>, "the model lacks 'density', a number [kg/m^3]");
    static_assert(HasValidate<Model>, "the model lacks 'void validate() const', which refuses parameters");
    static_assert(!HasState<Model> || Responds<Model, Real>,
                  "the model lacks 'template <firn::Lane Real, class Particle> firn::Response<Real, d> "
                  "respond(Particle& state, firn::Matrix<Real, d> const& velocity_gradient, Real dt) const'");
    static constexpr bool value = ConstitutiveModel<Model, Real>;
};

/// Reports in a sentence which member a transfer scheme lacks; the compiler's note beside it names the
/// scheme.
template <class Transfer, class Kernel, class Real, int d>
struct CompleteTransfer
{
    static constexpr bool has_fields = HasFieldsOfTransfer<Transfer>;
    static_assert(has_fields, "the transfer scheme lacks 'using State = firn::Fields<...>', what a particle "
                              "has for it after the gather");
    static_assert(HasStored<Transfer>, "the transfer scheme lacks 'using Stored = firn::Fields<...>', what a "
                                       "particle keeps of its State from step to step");
    static_assert(HasScatterTerms<Transfer, Kernel>,
                  "the transfer scheme lacks 'template <class Kernel> static constexpr firn::Terms "
                  "scatter_terms'");
    static_assert(HasGatherTerms<Transfer, Kernel>,
                  "the transfer scheme lacks 'template <class Kernel> static constexpr firn::Terms "
                  "gather_terms'");
    static_assert(SaysWhatItKeeps<Transfer>, "the transfer scheme lacks 'static constexpr bool "
                                             "keeps_old_velocity'");
    static_assert(SaysHowItMoves<Transfer>, "the transfer scheme lacks 'static constexpr bool "
                                            "moves_with_grid'");
    static_assert(HasFractionIfItKeeps<Transfer>,
                  "the transfer scheme lacks 'fraction', which goes with keeps_old_velocity: the share of a "
                  "particle's own velocity");
    static_assert(!SaysWhatItKeeps<Transfer> || KeepsIfItExtends<Transfer>,
                  "the transfer scheme lacks 'keeps_old_velocity = true', which goes with passes()");
    static_assert(
        !has_fields || Scatters<Transfer, Kernel, Real, d>,
        "the transfer scheme lacks 'template <class Kernel, firn::Lane Real, int d, class Particle> "
        "firn::ParticleContribution<Real, d> scatter(Particle const& particle, Real mass, "
        "firn::Matrix<Real, d> const& stress_impulse, Real cell_size) const'");
    static_assert(
        !has_fields || Gathers<Transfer, Kernel, Real, d>,
        "the transfer scheme lacks 'template <class Kernel, firn::Lane Real, int d, class Particle> "
        "firn::Matrix<Real, d> gather(Particle& particle, firn::Gathered<Real, d> const& gathered, "
        "Real inverse_cell_size) const'");
    static constexpr bool moves()
    {
        if constexpr (has_fields && SaysHowItMoves<Transfer>)
            return Transfer::moves_with_grid || MovesParticles<Transfer, Kernel, Real, d>;
        else
            return true; // another sentence says so
    }
    static_assert(
        moves(), "the transfer scheme lacks 'template <class Kernel, firn::Lane Real, int d, class Particle> "
                 "firn::Vector<Real, d> motion(Particle const& particle, firn::Gathered<Real, d> const& "
                 "gathered) const', which goes with moves_with_grid = false");
    static constexpr bool value = TransferScheme<Transfer, Kernel, Real, d>;
};
} // namespace detail

} // namespace firn

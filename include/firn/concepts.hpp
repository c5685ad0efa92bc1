// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/parameters.hpp>
#include <firn/effects/effect.hpp>
#include <firn/models/response.hpp>
#include <firn/transfer/transfer.hpp>

#include <array>

// Every kind of policy on one page: the requirements on a kernel, a transfer scheme and a material. Effects
// are in effects/effect.hpp, shapes in effects/shapes/shape.hpp, lanes in core/lane.hpp, backends in
// backends/README.md.
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

/// A transfer scheme: the fields it adds to a particle, those of them that are stored from step to step, the
/// terms it needs, and its scatter and gather. It may name its parameters, too: see SaysParameters.
template <class T, class Kernel, class Real, int d>
concept TransferScheme = Lane<Real> &&
    requires(T const transfer, Record<Real, d, typename T::State> particle, Gathered<Real, d> gathered,
             Matrix<Real, d> stress_impulse, Real number, typename T::Stored stored)
{
    {
        T::template scatter_terms<Kernel>
        } -> std::convertible_to<Terms>;
    {
        T::template gather_terms<Kernel>
        } -> std::convertible_to<Terms>;
    {
        T::keeps_old_velocity
        } -> std::convertible_to<bool>;
    requires !T::keeps_old_velocity || requires { transfer.fraction; }; // of its own velocity: see Flip
    {
        T::moves_with_grid // if not, by transfer.motion(particle, gathered)
        } -> std::convertible_to<bool>;
    requires !ExtendsVelocities<T> || T::keeps_old_velocity; // v^n - v* is stored in its place: see Xpic
    {
        transfer.template scatter<Kernel, Real, d>(particle, number, stress_impulse, number)
        } -> std::same_as<ParticleContribution<Real, d>>;
    {
        transfer.template gather<Kernel, Real, d>(particle, gathered, number)
        } -> std::same_as<Matrix<Real, d>>;
};

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
} // namespace detail

} // namespace firn

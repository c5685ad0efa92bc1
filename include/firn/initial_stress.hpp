// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/finite.hpp>
#include <firn/math/product.hpp>
#include <firn/models/response.hpp>

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

// The stress in which a body lies before anything happens to it, as the field that its particles store:
// ground under its weight, water in a basin. Found without a step, by the model's own response.
namespace firn
{

/// What a body at rest bears: its weight below a level surface, and a load on that.
struct AtRest
{
    double surface = 0;                        ///< height of the surface above the origin, along up [m]
    double load = 0;                           ///< on the surface, a pressure [Pa]
    Eigen::Vector3d acceleration{0, -9.81, 0}; ///< of gravity, which says where up is [m/s^2]
    /// The horizontal stress over the vertical one. Left out, it is what comes of a load under which the
    /// material cannot yield sideways: nu / (1 - nu) for small strains.
    std::optional<double> k0{};

    /// Throws an Error if a number is out of its range.
    void validate() const
    {
        auto const keep = [](bool good, char const* what, char const* remedy) {
            require(good, what, "AtRest", remedy);
        };
        keep(is_finite(surface), "the height of the surface is not finite", "Pass metres along up.");
        keep(is_finite(load) && load >= 0, "the load is not a finite number, 0 or above",
             "Pass a pressure in Pa.");
        keep(all_finite(acceleration) && norm(acceleration) > 0,
             "the acceleration is not finite, or 0, and there is no up", "Pass that of gravity in m/s^2.");
        keep(!k0 || (is_finite(*k0) && *k0 > 0), "K0 is not a finite number above 0",
             "Pass the horizontal stress over the vertical one, e.g. 1 - sin(phi).");
    }
};

namespace detail
{
/// Solves f(x) = 0 for two numbers by Newton's method from x on, which is below 0, with slopes by
/// differences: on the side of more compression, since there may be no stress on the other. `size` is that of
/// what f subtracts. Steps are halved while f is not finite or grows. Returns whether it has come to
/// rounding.
template <class Function>
bool solve(Vector<double, 2>& x, double size, Function const& f)
{
    constexpr int n = 2;
    double const step = 1e-4 * x[0];
    Vector<double, n> value = f(x);
    for (int iteration = 0; iteration < 100; ++iteration) {
        double const error = norm(value);
        if (error <= 1e-13 * size) return true;
        Matrix<double, n> slope;
        for (int j = 0; j < n; ++j) {
            Vector<double, n> beside = x;
            beside[j] += step;
            Vector<double, n> const change = (f(beside) - value) / step;
            for (int i = 0; i < n; ++i) slope(i, j) = change[i];
        }
        Vector<double, n> const way = slope.inverse() * value;
        double share = 1;
        for (; share > 1e-6; share /= 2) {
            Vector<double, n> const next = x - share * way, there = f(next);
            if (!is_finite(norm(there)) || !(norm(there) < error)) continue;
            x = next;
            value = there;
            break;
        }
        if (!(share > 1e-6)) return error <= 1e-9 * size;
    }
    return false;
}

/// The Kirchhoff stress of a particle's state, or NaN where the model has none.
template <int d, class Model, class State>
Matrix<double, d> stress_of_state(Model const& model, State state)
{
    auto const response = model.template respond<double>(state, zeros<Matrix<double, d>>(), 0.0);
    Matrix<double, d> stress = response.kirchhoff_stress;
    if (response.inverted) stress(0, 0) = std::nan("");
    return stress;
}

template <class Model>
struct RestStates
{
    static constexpr int d = Model::Space::dimension;
    using Number = typename Model::Space::Scalar;
    using State = Record<double, d, typename Model::State>;

    Model const& model;
    AtRest const& rest;
    Vector<double, d> up;

    RestStates(Model const& of, AtRest const& how) : model(of), rest(how)
    {
        rest.validate();
        double const size = norm(rest.acceleration);
        up = make_vector<double, d>([&](int i) { return -rest.acceleration[i] / size; });
        if constexpr (d == 2)
            require(!(std::abs(rest.acceleration.z()) > 0), "gravity leaves the plane of the scene", "AtRest",
                    "Keep z out of the acceleration.");
    }

    /// The vertical pressure at a point: that of the load above the surface.
    double pressure(Vector<double, d> const& x, std::size_t place) const
    {
        double const height = dot<double, d>(up, x);
        require_at(is_finite(height), "a position is not finite", place, "Pass metres.");
        double const depth = rest.surface - height;
        return rest.load + (depth > 0 ? depth * double(model.density) * norm(rest.acceleration) : 0);
    }

    Matrix<double, d> gradient(double across, double along) const
    {
        return make_matrix<double, d>(
            [&](int i, int j) { return (i == j ? across : 0) + (along - across) * up[i] * up[j]; });
    }

    Matrix<Number, d> solid(double pressure, std::size_t place) const
    {
        auto state = state_of_new<State>(model);
        auto const stress = [&](double across, double along) {
            state[DisplacementGradient{}] = gradient(across, along);
            Matrix<double, d> const tau = stress_of_state<d>(model, state);
            Vector<double, d> const by_up = product<double, d>(tau, up);
            double const vertical = dot<double, d>(up, by_up);
            return Vector<double, 2>((tau.trace() - vertical) / (d - 1), vertical);
        };
        Vector<double, 2> strains = guess(pressure);
        bool const found = !(pressure > 0) || solve(strains, pressure, [&](Vector<double, 2> const& h) {
            Vector<double, 2> const tau = stress(h[0], h[1]);
            return Vector<double, 2>(rest.k0 ? tau[0] + *rest.k0 * pressure : h[0] * pressure,
                                     tau[1] + pressure);
        });
        Matrix<double, d> const H = gradient(strains[0], strains[1]);
        state[DisplacementGradient{}] = H;
        // a second that passes: what flows does so at once, or within it
        (void)model.template respond<double>(state, zeros<Matrix<double, d>>(), 1.0);
        require_at(found && norm_of(state[DisplacementGradient{}] - H) <= 1e-9 * norm_of(H),
                   "the material flows under this stress, or bears none such", place,
                   "Pass another k0, nearer to 1 for sand and clay, or check density and depth in SI units.");
        return make_matrix<Number, d>([&](int i, int j) { return static_cast<Number>(H(i, j)); });
    }

    Number fluid(double pressure, std::size_t place) const
    {
        auto state = state_of_new<State>(model);
        Vector<double, 2> log_J = guess(pressure); // and nothing
        bool const found = !(pressure > 0) || solve(log_J, pressure, [&](Vector<double, 2> const& logarithm) {
            state[LogVolumeRatio{}] = logarithm[0];
            return Vector<double, 2>(stress_of_state<d>(model, state).trace() / d + pressure,
                                     logarithm[1] * pressure);
        });
        require_at(found, "the fluid has no such pressure", place, "Check density and depth in SI units.");
        return static_cast<Number>(log_J[0]);
    }

private:
    /// The strains of about a pressure from all sides.
    Vector<double, 2> guess(double pressure) const
    {
        auto state = state_of_new<State>(model);
        double const strain =
            -pressure / d /
            model.template respond<double>(state, zeros<Matrix<double, d>>(), 0.0).wave_modulus;
        return {strain, strain};
    }

    static double norm_of(Matrix<double, d> const& A) { return std::sqrt(squared_norm<double, d>(A)); }

    static void require_at(bool good, char const* what, std::size_t place, char const* remedy)
    {
        if (!good) throw Error{what, "AtRest, position " + std::to_string(place), remedy};
    }
};
} // namespace detail

/// The displacement gradients of a solid that lies at rest under its weight, for
/// `solver.upload<DisplacementGradient>(k0_state(solver.model(), solver.positions(), {.surface = 2}))`.
///
/// The vertical Kirchhoff stress is -(load + rho g depth) and the horizontal one K0 times that, so nodes are
/// in balance where the particles lie evenly: positions are those of the loaded body. Cauchy's stress differs
/// from it by the volume ratio. Above the surface there is the load alone. Throws an Error if the material
/// would flow under such a stress.
template <class Model, class Points>
auto k0_state(Model const& model, Points const& positions, AtRest const& rest)
{
    static_assert(Model::State::template contains<DisplacementGradient>,
                  "the material stores no DisplacementGradient: ask for its hydrostatic() state");
    detail::RestStates<Model> const states(model, rest);
    std::vector<Matrix<typename Model::Space::Scalar, Model::Space::dimension>> values;
    values.reserve(positions.size());
    for (auto const& x : positions)
        values.push_back(states.solid(states.pressure(x, values.size()), values.size()));
    return values;
}

/// The state of a fluid or a solid under its weight in which the stress is a pressure alone: ln J of a fluid,
/// for `solver.upload<LogVolumeRatio>(...)`, and of a solid the k0_state() of K0 = 1.
template <class Model, class Points>
auto hydrostatic(Model const& model, Points const& positions, AtRest rest)
{
    if constexpr (Model::State::template contains<LogVolumeRatio>) {
        rest.k0.reset();
        detail::RestStates<Model> const states(model, rest);
        std::vector<typename Model::Space::Scalar> values;
        values.reserve(positions.size());
        for (auto const& x : positions)
            values.push_back(states.fluid(states.pressure(x, values.size()), values.size()));
        return values;
    }
    else {
        rest.k0 = 1;
        return k0_state(model, positions, rest);
    }
}

} // namespace firn

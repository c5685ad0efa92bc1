// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>

#include <limits>

namespace firn
{

/// The Lamé parameters of an isotropic elastic solid.
template <class Number>
struct Lame
{
    Number mu;     ///< shear modulus [Pa]
    Number lambda; ///< [Pa]

    /// lambda + 2 mu [Pa]: rho c^2 of the longitudinal wave at rest.
    constexpr Number p_wave_modulus() const { return lambda + 2 * mu; }

    /// (2 mu + d lambda) / (lambda + 2 mu): the modulus of a uniform expansion in d dimensions over that of
    /// the wave. Where lambda < 0, the ratio of shear, 2 mu / (lambda + 2 mu), is larger and is returned. It
    /// enters the time step at which a particle without neighbours is stable.
    constexpr double expansion_ratio(int d) const
    {
        Number const spread = lambda > 0 ? Number(d) * lambda : Number(0);
        return double(2 * mu + spread) / double(p_wave_modulus());
    }

    void for_each_parameter(auto const& use) const
    {
        use("mu", mu);
        use("lambda", lambda);
    }

    void validate(char const* where) const
    {
        // 3 lambda + 2 mu is three times the bulk modulus
        require(is_finite(mu) && mu > 0 && is_finite(3 * lambda + 2 * mu) && 3 * lambda + 2 * mu > 0,
                "the Lamé parameters are not those of a stable solid", where,
                "Use firn::lame(young_modulus, poisson_ratio) with E > 0 and -1 < nu < 0.5.");
    }
};

/// mu = E / (2 (1 + nu)), lambda = E nu / ((1 + nu)(1 - 2 nu)); throws an Error unless E > 0 [Pa] and -1 < nu
/// < 0.5.
template <class Number = double>
Lame<Number> lame(double young_modulus, double poisson_ratio)
{
    require(is_finite(young_modulus) && young_modulus > 0, "Young's modulus is not a finite number above 0",
            "lame", "Pass E in Pa, e.g. 1.4e5 for fresh snow.");
    require(is_number(poisson_ratio) && poisson_ratio > -1 && poisson_ratio < 0.5,
            "Poisson's ratio is outside (-1, 0.5)", "lame",
            "Pass nu below 0.5, e.g. 0.2 for snow; an explicit step wants at most 0.45.");
    double const mu = young_modulus / (2 * (1 + poisson_ratio));
    double const lambda = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
    return {static_cast<Number>(mu), static_cast<Number>(lambda)};
}

/// Throws an Error unless the density [kg/m^3] is finite, and at least the smallest normal number of single
/// precision.
inline void require_density(double density, char const* where)
{
    require(is_finite(density) && density >= double(std::numeric_limits<float>::min()),
            "the density is not a finite number above 0, or nearly 0", where,
            "Pass the density in kg/m^3, e.g. 400 for snow.");
}

} // namespace firn

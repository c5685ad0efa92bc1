// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elasticity/fixed_corotated.hpp>
#include <firn/models/elasticity/neo_hookean.hpp>
#include <firn/models/plasticity/snow.hpp>

/// Named parameter sets, each with its source.
namespace firn::materials
{

/// Fresh snow: E = 1.4e5 Pa, nu = 0.2, 400 kg/m^3, theta_c = 2.5e-2, theta_s = 7.5e-3, xi = 10
/// (Stomakhin et al. 2013, table 2).
template <class Space>
Snow<Space> fresh_snow()
{
    return {};
}

/// Jelly: a soft neo-Hookean solid of E = 1e5 Pa, nu = 0.3, 1000 kg/m^3 (the usual soft body of graphics
/// scenes).
template <class Space>
NeoHookean<Space> jelly()
{
    return {};
}

/// Rubber: neo-Hookean, E = 1e6 Pa, nu = 0.45, 1000 kg/m^3; a stiffer volume would only shrink an explicit
/// step.
template <class Space>
NeoHookean<Space> rubber()
{
    NeoHookean<Space> model;
    model.elasticity = lame<typename Space::Real>(1e6, 0.45);
    return model;
}

} // namespace firn::materials

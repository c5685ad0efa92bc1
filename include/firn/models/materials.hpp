// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elasticity/fixed_corotated.hpp>
#include <firn/models/elasticity/hencky.hpp>
#include <firn/models/elasticity/neo_hookean.hpp>
#include <firn/models/elasticity/split_neo_hookean.hpp>
#include <firn/models/fluids/fluid.hpp>
#include <firn/models/plasticity/cam_clay.hpp>
#include <firn/models/plasticity/drucker_prager.hpp>
#include <firn/models/plasticity/herschel_bulkley.hpp>
#include <firn/models/plasticity/snow.hpp>
#include <firn/models/plasticity/von_mises.hpp>

/// Named parameter sets in SI units, each with its source, or "usual values" where there is none. Moduli of
/// what is stiff in nature are often lowered, since they bound an explicit step: each says so. "Not verified"
/// marks values that are quoted by others after their source, which was not at hand.
namespace firn::materials
{

/// Fresh snow: E = 1.4e5 Pa, nu = 0.2, 400 kg/m^3, theta_c = 2.5e-2, theta_s = 7.5e-3, xi = 10
/// (Stomakhin et al. 2013, table 2).
template <class Space>
Snow<Space> fresh_snow()
{
    return {};
}

/// Powder: softer snow that breaks sooner and hardens less, E = 4.8e4 Pa, theta_c = 1.9e-2, theta_s = 5e-3,
/// xi = 5 (the lower ends of the ranges that Stomakhin et al. 2013 vary; not verified), 200 kg/m^3 (settled
/// dry snow, a usual value).
template <class Space>
Snow<Space> powder()
{
    using Number = typename Space::Real;
    Snow<Space> model;
    model.density = 200;
    model.elasticity = lame<Number>(4.8e4, 0.2);
    model.critical_compression = Number(1.9e-2);
    model.critical_stretch = Number(5e-3);
    model.hardening = 5;
    return model;
}

/// Wet snow: packs and sticks, by Cam-Clay with E = 2e6 Pa, nu = 0.3, M = 1.2, beta = 1, xi = 3, alpha =
/// -0.02, 450 kg/m^3 (within the ranges of Gaume et al. 2018 and Wolper et al. 2019; not verified, and the
/// choice in them is this library's).
template <class Space>
CamClay<Space> wet_snow()
{
    using Number = typename Space::Real;
    CamClay<Space> model;
    model.density = 450;
    model.elasticity = lame<Number>(2e6, 0.3);
    model.slope = Number(1.2);
    model.cohesion = 1;
    model.hardening = 3;
    model.start = Number(-0.02);
    return model;
}

/// Dry sand: 35 degrees of friction, 1600 kg/m^3 (loose quartz sand, usual values), E = 1e6 Pa, nu = 0.3: a
/// tenth or less of the stiffness of sand, which a flow does not notice.
template <class Space>
Sand<Space> dry_sand()
{
    return {};
}

/// Soft clay, undrained: 1800 kg/m^3, E = 1e6 Pa, nu = 0.3, and a yield stress of 4e4 Pa, twice an undrained
/// shear strength of 20 kPa (soft to very soft in the classes of British practice; density and E are usual
/// values).
template <class Space>
VonMises<Space> clay()
{
    VonMises<Space> model;
    model.density = 1800;
    model.yield_stress = 4e4;
    return model;
}

/// Water: 1000 kg/m^3, viscosity 1.0e-3 Pa s (at 20 degrees; 1.002e-3 in the usual tables), gamma = 7
/// (Batchelor 1967), and a bulk modulus for flows up to `fastest` [m/s]: density (10 fastest)^2, far
/// below 2.2e9 Pa.
template <class Space>
Fluid<Space> water(double fastest = 3)
{
    using Number = typename Space::Real;
    Fluid<Space> model;
    model.bulk_modulus = static_cast<Number>(1000 * 100 * fastest * fastest);
    model.viscosity = Number(1e-3);
    return model;
}

/// Honey: 1420 kg/m^3 (a usual value) and 10 Pa s (tables give 2 to 10 at room temperature, by kind and
/// water), bulk modulus as of water.
template <class Space>
Fluid<Space> honey(double fastest = 1)
{
    using Number = typename Space::Real;
    Fluid<Space> model;
    model.density = 1420;
    model.bulk_modulus = static_cast<Number>(1420 * 100 * fastest * fastest);
    model.viscosity = 10;
    return model;
}

/// Jelly: a soft neo-Hookean solid of E = 1e5 Pa, nu = 0.3, 1000 kg/m^3 (the usual soft body of graphics
/// scenes).
template <class Space>
NeoHookean<Space> jelly()
{
    return {};
}

/// Rubber: neo-Hookean, E = 1e6 Pa, nu = 0.45, 1000 kg/m^3 (usual values); a stiffer volume would only shrink
/// an explicit step.
template <class Space>
NeoHookean<Space> rubber()
{
    NeoHookean<Space> model;
    model.elasticity = lame<typename Space::Real>(1e6, 0.45);
    return model;
}

/// Structural steel: E = 210e9 Pa, nu = 0.3, 7850 kg/m^3, yield stress 235e6 Pa (EN 1993-1-1, 3.2.6, and EN
/// 10025-2, S235), and a linear hardening of 2e9 Pa, about E / 100 as EN 1993-1-5, annex C suggests. Not
/// verified. Steps are of h / 6000 m/s.
template <class Space>
HardeningVonMises<Space> steel()
{
    using Number = typename Space::Real;
    HardeningVonMises<Space> model;
    model.density = 7850;
    model.elasticity = lame<Number>(210e9, 0.3);
    model.yield_stress = Number(235e6);
    model.hardening_modulus = Number(2e9);
    return model;
}

/// Shaving foam: shear modulus 290 Pa, yield stress 31.9 Pa, consistency 27.2 Pa s^0.22, power 0.22, 77.7
/// kg/m^3 (Yue et al. 2015; not verified); its bulk modulus of 1.09e5 Pa lowered to 2.9e4 Pa.
template <class Space>
HerschelBulkley<Space> foam()
{
    using Number = typename Space::Real;
    HerschelBulkley<Space> model;
    model.density = Number(77.7);
    model.elasticity = {290, Number(2.9e4) - Number(2.0 * 290 / Space::dimension)};
    model.yield_stress = Number(31.9);
    model.consistency = Number(27.2);
    model.power = Number(0.22);
    return model;
}

} // namespace firn::materials

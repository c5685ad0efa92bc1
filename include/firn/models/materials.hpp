// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
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

namespace firn::detail
{
/// The bulk modulus [Pa] of a fluid of some density [kg/m^3] whose flow, of up to `fastest` [m/s], compresses
/// it by 1 %.
template <class Number>
Number bulk_modulus_for(double fastest, double density, char const* where)
{
    require(is_finite(fastest) && fastest > 0, "the speed of the fastest flow is not a finite number above 0",
            where, "Pass m/s, e.g. sqrt(2 g H) for a fall from a height H.");
    return static_cast<Number>(density * 100 * fastest * fastest);
}
} // namespace firn::detail

/// Named parameter sets in SI units. Each value has its source, or is said to be our choice, with the reason.
/// Moduli of materials that are stiff in nature are often lowered, since they bound an explicit step; each
/// set says so.
namespace firn::materials
{

/// Fresh snow: E = 1.4e5 Pa, nu = 0.2, 400 kg/m^3, theta_c = 2.5e-2, theta_s = 7.5e-3, xi = 10
/// (Stomakhin et al. 2013, table 2).
template <class Space>
Snow<Space> fresh_snow()
{
    return {};
}

/// Powder: snow that breaks sooner, theta_c = 1.9e-2 and theta_s = 5e-3 (the smaller ones of Stomakhin et al.
/// 2013, used there for dry and powdery snow), 200 kg/m^3 (settled snow has 200 to 300: Paterson 1994, *The
/// Physics of Glaciers*, table 2.1). E = 4.8e4 Pa and xi = 5 are the lowest values shown there; using them
/// for powder is our choice, since so light a snow is soft and takes longer to pack.
template <class Space>
Snow<Space> powder()
{
    using Number = typename Space::Scalar;
    Snow<Space> model;
    model.density = 200;
    model.elasticity = lame<Number>(4.8e4, 0.2);
    model.critical_compression = Number(1.9e-2);
    model.critical_stretch = Number(5e-3);
    model.hardening = 5;
    return model;
}

/// Wet snow: packs and sticks, by Cam-Clay. 450 kg/m^3 lies between wind-packed snow (350 to 400) and old
/// firn (400 to 830: Paterson 1994, table 2.1). All else is our choice, not measured: the 30 degrees of loose
/// grains; beta = 1, so that it bears as much tension as pressure, and sticks; alpha = -0.02 and xi = 3, so
/// that it is crushed at 6 % of its bulk modulus, and p0 has doubled where another 2 % of its volume are
/// lost; E = 2e6 Pa and nu = 0.3, which make that 1e5 Pa in space.
template <class Space>
CamClay<Space> wet_snow()
{
    using Number = typename Space::Scalar;
    CamClay<Space> model;
    model.density = 450;
    model.elasticity = lame<Number>(2e6, 0.3);
    model.slope = Number(critical_slope(Space::dimension, 0.5235987755982988)); // of 30 degrees
    model.cohesion = 1;
    model.hardening = 3;
    model.start = Number(-0.02);
    return model;
}

/// Dry sand: 35 degrees of friction where it stands (sand of medium compactness has 31 to 36: US Army Corps
/// of Engineers, EM 1110-2-2504, table 3-1), no dilatancy, so that in the plane layers of it flow from 29.8,
/// 1600 kg/m^3 (mixed-grained sand, loose, has 1590: Terzaghi & Peck 1967, *Soil Mechanics in Engineering
/// Practice*, table 6.3, and 2650 for quartz less its porosity of 40 %), E = 1e6 Pa, nu = 0.3: a tenth or
/// less of the stiffness of loose sand (10 to 24 MPa: EM 1110-1-1904), which a flow does not notice.
template <class Space>
Sand<Space> dry_sand()
{
    return {};
}

/// Soft clay, undrained: E = 1e6 Pa (very soft clay has 0.5 to 5 MPa: US Army Corps of Engineers, EM
/// 1110-1-1904), a yield stress of 4e4 Pa, twice an undrained shear strength of 20 kPa (where BS 5930:1999
/// parts very soft clay from soft), 1800 kg/m^3 (soft glacial clay, saturated, has 1770: Terzaghi & Peck
/// 1967, table 6.3), and nu = 0.3, not the 0.5 of what keeps its volume, for longer steps. It has no angle of
/// friction: in a fast flow water bears the pressure. CamClay is for clay that drains.
template <class Space>
VonMises<Space> clay()
{
    VonMises<Space> model;
    model.density = 1800;
    model.yield_stress = 4e4;
    return model;
}

/// Water: 1000 kg/m^3 and a viscosity of 1.0e-3 Pa s (at 20 degrees 998.2 and 1.002e-3: IAPWS R6-95 and
/// R12-08), gamma = 7 (Batchelor 1967), and a bulk modulus for flows up to `fastest` [m/s]: density (10
/// fastest)^2 (Monaghan 1994, J. Comput. Phys. 110: its density then changes by 1 %), far below 2.2e9 Pa.
template <class Space>
Fluid<Space> water(double fastest = 3)
{
    using Number = typename Space::Scalar;
    Fluid<Space> model;
    model.bulk_modulus = detail::bulk_modulus_for<Number>(fastest, 1000, "materials::water");
    model.viscosity = Number(1e-3);
    return model;
}

/// Honey: 1420 kg/m^3 (at 20 degrees 1417 with 18 % of water) and 10 Pa s (clover honey of 16 % of water has
/// 19 at 20 degrees and 6.5 at 30: so at 26; both by the reference guide of the National Honey Board), bulk
/// modulus as of water.
template <class Space>
Fluid<Space> honey(double fastest = 1)
{
    using Number = typename Space::Scalar;
    Fluid<Space> model;
    model.density = 1420;
    model.bulk_modulus = detail::bulk_modulus_for<Number>(fastest, 1420, "materials::honey");
    model.viscosity = 10;
    return model;
}

/// Jelly: a firm gel of gelatin, neo-Hookean with E = 1e5 Pa (3.5 parts of water to one of gelatin, on the
/// power law from 277 kPa at 2 parts to 4.3 kPa at 20: Bonavia 2025, arXiv 2512.20502), 1000 kg/m^3 (of
/// water, which most of it is), and nu = 0.3: a gel keeps its volume, but a nu near 0.5 would shrink an
/// explicit step.
template <class Space>
NeoHookean<Space> jelly()
{
    return {};
}

/// Rubber: neo-Hookean, E = 1e6 Pa (the vulcanised natural rubber of Treloar 1944, Trans. Faraday Soc. 40,
/// 59, has a shear modulus of 0.39 MPa, which makes 1.2 MPa), 1000 kg/m^3 (950 without fillers: MatWeb,
/// natural rubber, vulcanized), and nu = 0.45: a stiffer volume would only shrink an explicit step.
template <class Space>
NeoHookean<Space> rubber()
{
    NeoHookean<Space> model;
    model.elasticity = lame<typename Space::Scalar>(1e6, 0.45);
    return model;
}

/// Structural steel: E = 210e9 Pa, nu = 0.3 (EN 1993-1-1, 3.2.6), 7850 kg/m^3 (EN 1991-1-1, table A.4), yield
/// stress 235e6 Pa (S235: EN 10025-2), and a linear hardening that gives it a tangent of E / 100 beyond yield
/// (EN 1993-1-5, annex C.6). Steps are of h / 6000 m/s.
template <class Space>
HardeningVonMises<Space> steel()
{
    using Number = typename Space::Scalar;
    HardeningVonMises<Space> model;
    model.density = 7850;
    model.elasticity = lame<Number>(210e9, 0.3);
    model.yield_stress = Number(235e6);
    model.hardening_modulus = Number(210e9 / 99); // E H / (E + H) = E / 100
    return model;
}

/// Shaving foam: our choice, after what others quote from Yue et al. 2015 (ACM Trans. Graph. 34, 160); the
/// table of that paper was not at hand. 77.7 kg/m^3 (water with 92 % of gas, as shaving foams have), shear
/// modulus 290 Pa, yield stress 31.9 Pa (so it yields at a shear of 6 %), consistency 27.2 Pa s^0.22, power
/// 0.22. Bulk modulus 2.9e4 Pa, a hundred times that of shear, so that it keeps its volume: lowered from
/// 1.09e5 Pa for longer steps.
template <class Space>
HerschelBulkley<Space> foam()
{
    using Number = typename Space::Scalar;
    HerschelBulkley<Space> model;
    model.density = Number(77.7);
    model.elasticity = {290, Number(2.9e4) - Number(2.0 * 290 / Space::dimension)};
    model.yield_stress = Number(31.9);
    model.consistency = Number(27.2);
    model.power = Number(0.22);
    return model;
}

} // namespace firn::materials

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/one_element.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

/// The speed of the fastest wave in a material at rest [m/s].
template <class Model>
double wave_speed(Model const& model)
{
    model.validate();
    constexpr int d = Model::Space::dimension;
    OneElement<Model> const material{model};
    auto state = material.at_rest(1).front();
    auto const response = material.step(state, Matrix<double, d>::Zero(), 0);
    CHECK(response.kirchhoff_stress.norm() <= 1e-6 * double(response.wave_modulus)); // at rest without stress
    return std::sqrt(double(response.wave_modulus) / double(model.density));
}

/// Runs what must be refused with a what, a where and a remedy.
template <class Model>
void refused(Model const& model)
{
    try {
        model.validate();
    }
    catch (Error const& error) {
        CHECK(!error.what_is_wrong().empty());
        CHECK(!error.where().empty());
        CHECK(!error.remedy().empty());
        return;
    }
    FAIL("nothing was refused");
}

} // namespace

TEMPLATE_TEST_CASE(
    "every named material is valid, at rest without stress, and has the wave speed of its moduli", "", Plane,
    Solid, PlaneFloat, SolidFloat)
{
    CHECK(wave_speed(materials::fresh_snow<TestType>()) == Approx(19.72).epsilon(1e-3));
    CHECK(wave_speed(materials::powder<TestType>()) == Approx(std::sqrt(4.8e4 / 0.9 / 200)).epsilon(1e-3));
    double const of_third = std::sqrt(0.7 / (1.3 * 0.4)); // of E / rho, at a Poisson's ratio of 0.3
    CHECK(wave_speed(materials::wet_snow<TestType>()) ==
          Approx(of_third * std::sqrt(2e6 / 450)).epsilon(1e-3));
    CHECK(wave_speed(materials::dry_sand<TestType>()) == Approx(of_third * 25).epsilon(1e-3));
    CHECK(wave_speed(materials::clay<TestType>()) == Approx(of_third * std::sqrt(1e6 / 1800)).epsilon(1e-3));
    CHECK(wave_speed(materials::steel<TestType>()) == Approx(6001).epsilon(1e-3));
    CHECK(wave_speed(materials::jelly<TestType>()) == Approx(of_third * 10).epsilon(1e-3));
    CHECK(wave_speed(materials::rubber<TestType>()) == Approx(61.6).epsilon(1e-3));
    CHECK(wave_speed(materials::water<TestType>(3)) == Approx(30).epsilon(1e-3));
    CHECK(wave_speed(materials::honey<TestType>(1)) == Approx(10).epsilon(1e-3));
    auto const foam = materials::foam<TestType>();
    CHECK(wave_speed(foam) ==
          Approx(std::sqrt((2.9e4 + 290 * (2 - 2.0 / TestType::dimension)) / 77.7)).epsilon(1e-3));
}

TEST_CASE("values that follow from those of a source are what they are said to be")
{
    auto const steel = materials::steel<Solid>();
    double const E = 210e9, H = steel.hardening_modulus;
    CHECK(E * H / (E + H) == Approx(E / 100)); // the tangent of EN 1993-1-5, annex C.6
    auto const wet = materials::wet_snow<Solid>();
    double const bulk = wet.elasticity.lambda + 2 * wet.elasticity.mu / 3;
    CHECK(wet.preconsolidation(bulk, 0.0) == Approx(1e5).epsilon(1e-3));
    CHECK(wet.preconsolidation(bulk, -0.02) == Approx(2e5).epsilon(3e-3));
    auto const foam = materials::foam<Solid>();
    CHECK(foam.yield_stress / std::sqrt(3.0) / foam.elasticity.mu == Approx(0.0635).epsilon(1e-3));
}

TEST_CASE("sand that is given by angles and Pa, as README has it, stands and flows from where README says")
{
    auto sand = materials::dry_sand<PlaneFloat>();
    auto const degrees = [](double sine_or_slope, auto inverse) {
        return inverse(sine_or_slope) * 180 / M_PI;
    };
    auto const arc_sine = [](double x) { return std::asin(x); };
    auto const arc_tangent = [](double x) { return std::atan(x); };
    sand.cone = friction_cone(2, 0.5236);
    CHECK(degrees(std::sqrt(2.0) * sand.cone, arc_sine) == Approx(30).epsilon(0.002));
    CHECK(degrees(std::sqrt(2.0) * sand.cone, arc_tangent) == Approx(26.6).epsilon(0.002));
    sand.cone = friction_cone(2, 0.5236, Friction::flowing);
    CHECK(degrees(std::sqrt(2.0) * sand.cone, arc_sine) == Approx(35.3).epsilon(0.002));
    sand.dilatancy = dilatancy_cone(2, 0.1745);
    sand.cohesion = 1e3;
    sand.tension_cutoff = 200;
    CHECK_NOTHROW(sand.validate());
    double const in_space = 3 * friction_cone(3, M_PI / 6) / std::sqrt(2.0); // of plane strain
    CHECK(degrees(in_space, arc_sine) == Approx(43.9).epsilon(0.002));
    CHECK(degrees(in_space, arc_tangent) == Approx(34.7).epsilon(0.002));
}

TEST_CASE("parameters that make no sense are refused, with what, where and a remedy")
{
    double const nan = std::numeric_limits<double>::quiet_NaN(),
                 inf = std::numeric_limits<double>::infinity();
    auto const change = [](auto model, auto member, auto value) {
        model.*member = value;
        refused(model);
    };
    using Model = Sand<Solid>;
    change(Hencky<Solid>{}, &Hencky<Solid>::density, -1.0);
    change(Hencky<Solid>{}, &Hencky<Solid>::elasticity, Lame<double>{-1, 1});
    change(Hencky<Solid>{}, &Hencky<Solid>::elasticity, Lame<double>{1, -1.5}); // a bulk modulus below 0
    for (double bad : {-1.0, nan, inf}) {
        change(VonMises<Solid>{}, &VonMises<Solid>::yield_stress, bad);
        change(HardeningVonMises<Solid>{}, &HardeningVonMises<Solid>::hardening_modulus, bad);
        change(Model{}, &Model::cone, bad);
        change(Model{}, &Model::dilatancy, bad);
        change(Model{}, &Model::cohesion, bad);
        change(Model{}, &Model::tension_cutoff, bad);
        change(CamClay<Solid>{}, &CamClay<Solid>::slope, bad);
        change(CamClay<Solid>{}, &CamClay<Solid>::cohesion, bad);
        change(CamClay<Solid>{}, &CamClay<Solid>::hardening, bad);
        change(HerschelBulkley<Solid>{}, &HerschelBulkley<Solid>::yield_stress, bad);
        change(HerschelBulkley<Solid>{}, &HerschelBulkley<Solid>::consistency, bad);
        change(HerschelBulkley<Solid>{}, &HerschelBulkley<Solid>::power, bad);
        change(Fluid<Solid>{}, &Fluid<Solid>::bulk_modulus, bad);
        change(Fluid<Solid>{}, &Fluid<Solid>::exponent, bad);
        change(Fluid<Solid>{}, &Fluid<Solid>::viscosity, bad);
    }
    change(Snow<Solid>{}, &Snow<Solid>::hardening, 1000.0); // e^400, where half of the range is e^355
    change(CamClay<Solid>{}, &CamClay<Solid>::start, nan);
    change(CamClay<Solid>{}, &CamClay<Solid>::cohesion, 1e30); // p0 would be a rounding of its tension
    change(Model{}, &Model::dilatancy, 1.01 * Model{}.cone);   // flow would yield energy
    change(Model{}, &Model::cohesion, 1e30);
    Model sticky;
    sticky.cohesion = 1e30;
    sticky.tension_cutoff = 1e4;
    CHECK_NOTHROW(sticky.validate());
    sticky.cone = 1; // steeper than that of any angle
    refused(sticky);
    change(HerschelBulkley<Solid>{}, &HerschelBulkley<Solid>::power, 1.5);
    CHECK_THROWS_AS(friction_cone(3, 35.0), Error); // degrees
    CHECK_THROWS_AS(friction_cone(4, 0.6), Error);
    CHECK_THROWS_AS(dilatancy_cone(2, 10.0), Error);
    CHECK_THROWS_AS(dilatancy_cone(2, -0.1), Error);
    CHECK_THROWS_AS(friction_cone(2, 0.8, Friction::flowing), Error); // beyond 45 degrees
    CHECK_NOTHROW(friction_cone(2, 0.8, Friction::flowing, 0.1));
    CHECK_THROWS_AS(friction_cone(3, 0.5, Friction::flowing, 0.65), Error);
    for (double bad : {0.0, -3.0, nan, inf}) {
        CHECK_THROWS_AS(materials::water<Solid>(bad), Error);
        CHECK_THROWS_AS(materials::honey<Solid>(bad), Error);
    }
    CHECK_THROWS_AS(Asflip{.fraction = 1.1}.validate(), Error);
    CHECK_THROWS_AS(Asflip{.separation = -0.1}.validate(), Error);
}

TEST_CASE("ASFLIP's particles leave the grid's motion where material comes apart, and only there")
{
    using Particle = Record<double, 2, Fields<Velocity, AffineVelocity, DisplacementGradient>>;
    Asflip const transfer{.fraction = 0.9};
    auto particle = Particle::at_rest();
    particle[Velocity{}] = {3, 0};
    Gathered<double, 2> gathered{};
    gathered.velocity = {1, 0};
    gathered.old_velocity = {2, 0};
    auto const motion = [&](double divergence, double compression) {
        gathered.gradient = Eigen::Matrix2d::Identity() * divergence;
        particle[DisplacementGradient{}] = Eigen::Matrix2d::Identity() * -compression;
        return transfer.motion<QuadraticBSpline, double, 2>(particle, gathered).x();
    };
    CHECK(motion(0.1, 0) == Approx(1.9));
    CHECK(motion(-0.1, 0) == Approx(1));
    CHECK(motion(0.1, 0.01) == Approx(1));
}

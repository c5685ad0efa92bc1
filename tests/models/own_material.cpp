// SPDX-License-Identifier: MIT
#include "../../examples/soft_foam.hpp"
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/test_lane.hpp"

using namespace firn::test;

/// A material whose call operator lacks the time step.
template <class SpaceType>
struct Forgetful : SoftFoam<SpaceType>
{
    template <class Real, class Particle>
    FIRN_HOST_DEVICE firn::Response<Real, SpaceType::dimension>
    respond(Particle&, firn::Matrix<Real, SpaceType::dimension> const&) const;
};

/// A user-defined plastic flow: it cracks where a stretch exceeds a limit, and counts that.
template <class SpaceType>
struct Cracking
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = firn::Fields<firn::EquivalentPlasticStrain>;
    static constexpr auto name = "cracking";
    static constexpr Number default_density = 2000;
    static firn::Lame<Number> usual_elasticity() { return firn::lame<Number>(1e5, 0.2); }
    template <class Law>
    static constexpr bool supports = std::is_same_v<Law, firn::HenckyLaw>;
    Number limit = Number(0.01); // logarithmic strain

    void validate() const { firn::require(limit > 0, "the limit is not above 0", name, "Pass a strain."); }

    template <firn::Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE firn::PlasticFlow<Real, d> flow(firn::Vector<Real, d> const& trial,
                                                     firn::Lame<Real> const&, Particle& state, Real) const
    {
        using firn::min; // of numbers; that of packs is found beside them
        firn::PlasticFlow<Real, d> plastic{trial, firn::no_lanes<Real>(), Real(1), firn::no_lanes<Real>()};
        for (int i = 0; i < d; ++i) {
            plastic.strains[i] = min(trial[i], Real(limit));
            state[firn::EquivalentPlasticStrain{}] += trial[i] - plastic.strains[i];
            plastic.flowed = plastic.flowed | (trial[i] > Real(limit));
        }
        return plastic;
    }
};

TEST_CASE("a user's own plastic flow composes with an elastic law of the library's")
{
    using Ice = firn::Elastoplastic<firn::HenckyLaw, Cracking<Solid>>;
    STATIC_REQUIRE(firn::ConstitutiveModel<Ice, TestLane<double>>);
    STATIC_REQUIRE(!Cracking<Solid>::supports<firn::FixedCorotatedLaw>);
    Ice const ice;
    ice.validate();
    auto state = firn::Record<double, 3, Ice::State>::at_rest();
    Eigen::Matrix3d L = Eigen::Matrix3d::Zero();
    L(0, 0) = std::exp(0.05) - 1;
    auto const tau = ice.respond<double>(state, L, 1.0).kirchhoff_stress;
    CHECK(tau(0, 0) == Approx(0.01 * ice.elasticity.p_wave_modulus()));
    CHECK(state[firn::EquivalentPlasticStrain{}] == Approx(0.04));
}

TEST_CASE("a law with a parameter of its own meets a plastic flow, and without the parameter is a known law")
{
    using Law = firn::MooneyRivlinLaw<double>;
    using Yielding = firn::Elastoplastic<Law, firn::SnowFlow<Solid>>;
    STATIC_REQUIRE(firn::ConstitutiveModel<Yielding, TestLane<double>>);
    STATIC_REQUIRE(!firn::SnowFlow<Solid>::supports<firn::HenckyLaw>);
    Eigen::Matrix3d L = Eigen::Matrix3d::Zero();
    L(0, 0) = 0.05;
    L(0, 1) = 0.002;
    auto const stress = [&](auto const& model) {
        model.validate();
        auto state = firn::Record<double, 3, typename std::decay_t<decltype(model)>::State>::at_rest();
        return model.template respond<double>(state, L, 1.0).kirchhoff_stress;
    };
    Yielding model;
    auto const quarter = stress(model);
    model.second = 1;
    CHECK((stress(model) - quarter).norm() > 1e-5 * model.elasticity.mu);
    model.critical_stretch = 1; // it does not yield any more
    firn::MooneyRivlin<Solid> rubber;
    rubber.second = 0;
    rubber.elasticity = model.elasticity;
    firn::SplitNeoHookean<Solid> split;
    split.elasticity = model.elasticity;
    CHECK((stress(rubber) - stress(split)).norm() <= 1e-13 * model.elasticity.mu);
    rubber.second = 1;
    CHECK((stress(rubber) - stress(model)).norm() <= 1e-13 * model.elasticity.mu);
    rubber.second = 1.5;
    CHECK_THROWS_WITH(rubber.validate(), Contains("the second invariant is outside [0, 1]"));
    int told = 0;
    rubber.for_each_parameter([&](std::string_view name, auto const&) { told += name == "second"; });
    CHECK(told == 1);
}

TEST_CASE("a user's own material runs, and one without the call is refused")
{
    STATIC_REQUIRE(firn::ConstitutiveModel<SoftFoam<Solid>, double>);
    STATIC_REQUIRE(firn::ConstitutiveModel<SoftFoam<Solid>, TestLane<double>>);
    STATIC_REQUIRE(!firn::ConstitutiveModel<Forgetful<Solid>, double>);

    firn::Solver<TestedBackend, SoftFoam<SolidFloat>> solver(firn::lattice(0.05));
    solver.add(box_of_points<3>({0, 0.05, 0}, {0.2, 0.25, 0.2}, 0.05), std::pow(0.025, 3));
    auto const report = solver.advance(0.2, firn::Gravity{}, firn::Obstacle<firn::HalfSpace>{});
    CHECK(report.reactions[0].impulse.y() < 0);
    for (auto const& x : solver.positions()) CHECK(x.y() > -0.02);
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/test_lane.hpp"

using namespace firn::test;

// The README's example of a user's own material, word for word.
template <class SpaceType>
struct SoftFoam // a neo-Hookean solid without a volume term, for example
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using State = firn::Fields<firn::DisplacementGradient>; // H = F - I
    static constexpr int d = Space::dimension;
    Number density = 60, stiffness = 2e4; // [kg/m^3], [Pa]

    void validate() const
    {
        firn::require(stiffness > 0, "the stiffness is not above 0", "SoftFoam", "Pass Pa.");
    }

    template <firn::Lane Real, class Particle>
    firn::Response<Real, d> respond(Particle& state, firn::Matrix<Real, d> const& L, Real dt) const
    {
        auto& H = state[firn::DisplacementGradient{}];
        H = firn::deformed<Real, d>(H, L, dt);
        firn::Matrix<Real, d> const strain = H + H.transpose() + H * H.transpose(); // F F^T - I
        return {strain * Real(stiffness), Real(stiffness) * (Real(2) + strain.squaredNorm()),
                firn::nowhere<Real>(), firn::nowhere<Real>()}; // never inverted, never capped
    }
};

/// One whose call has forgotten the time step.
template <class SpaceType>
struct Forgetful : SoftFoam<SpaceType>
{
    template <class Real, class Particle>
    firn::Response<Real, SpaceType::dimension> respond(Particle&,
                                                       firn::Matrix<Real, SpaceType::dimension> const&) const;
};

TEST_CASE("a user's own material runs, and one without the call is refused")
{
    STATIC_REQUIRE(firn::ConstitutiveModel<SoftFoam<Solid>, double>);
    STATIC_REQUIRE(firn::ConstitutiveModel<SoftFoam<Solid>, TestLane<double>>);
    STATIC_REQUIRE(!firn::ConstitutiveModel<Forgetful<Solid>, double>);

    firn::Solver<firn::OpenMP, SoftFoam<SolidFloat>> solver(firn::lattice(0.05));
    solver.add(box_of_points<3>({0, 0.05, 0}, {0.2, 0.25, 0.2}, 0.05), std::pow(0.025, 3));
    auto const report = solver.advance(0.2, firn::Gravity{}, firn::Obstacle<firn::HalfSpace>{});
    CHECK(report.reactions[0].impulse.y() < 0);
    for (auto const& x : solver.positions()) CHECK(x.y() > -0.02);
}

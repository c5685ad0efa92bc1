// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/test_lane.hpp"

#include <limits>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{
/// A body that is pressed together and let go, after some steps: positions.
template <class Solver>
auto vibrated(Solver& solver, int steps)
{
    constexpr int d = Solver::d;
    double const h = 0.1;
    auto const points =
        box_of_points<d>(Vector<double, d>::Constant(0.01), Vector<double, d>::Constant(0.41), h);
    solver.add(points, std::pow(h / 2, d));
    std::vector<Vector<typename Solver::Number, d>> v;
    for (auto const& x : points)
        v.push_back(((x.array() - 0.21) * -4).matrix().template cast<typename Solver::Number>());
    solver.template upload<Velocity>(v);
    return [&solver, steps] {
        for (int i = 0; i < steps; ++i) solver.step(2e-4);
        return solver.positions();
    };
}

/// The largest distance between two of the same particles [m].
template <class Positions>
double furthest(Positions const& some, Positions const& others)
{
    double most = 0;
    for (std::size_t i = 0; i < some.size(); ++i) most = std::max(most, (some[i] - others[i]).norm());
    return most;
}
} // namespace

using Solids = Combinations<
    Scene<Snow<Plane>, QuadraticBSpline, Mls>,
    More<Scene<NeoHookean<Solid>, CubicBSpline, Flip>, Scene<Sand<SolidFloat>, QuadraticBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE("a factor of each particle's moduli costs four or eight bytes, and others nothing",
                        "", Solids)
{
    using Plain = typename TestType::Solver;
    using Model = Heterogeneous<typename TestType::Model>;
    using Solver = typename Scene<Model, typename TestType::Kernel, typename TestType::Transfer>::Solver;
    STATIC_REQUIRE(ConstitutiveModel<Model, TestLane<double>>);
    constexpr std::size_t number = sizeof(typename Plain::Number);
    STATIC_REQUIRE(Solver::state_bytes_per_particle == Plain::state_bytes_per_particle + number);
    STATIC_REQUIRE(Solver::bytes_per_particle == Plain::bytes_per_particle + 2 * number);
    STATIC_REQUIRE(!Plain::State::template contains<Stiffness>);
}

TEMPLATE_LIST_TEST_CASE(
    "a heterogeneous solid is its model where all factors are 1, and the model with other moduli "
    "where all are something else",
    "", Solids)
{
    using Number = typename TestType::Number;
    using Plain = typename TestType::Solver;
    using Model = Heterogeneous<typename TestType::Model>;
    using Solver = typename Scene<Model, typename TestType::Kernel, typename TestType::Transfer>::Solver;
    Plain plain(lattice(0.1));
    Solver same(lattice(0.1));
    auto const run_plain = vibrated(plain, 40);
    auto const run_same = vibrated(same, 40);
    CHECK(same.template download<Stiffness>() == std::vector<Number>(same.size(), 1));
    // to rounding: two programs, and no compiler fuses the same sums and products in both
    CHECK(furthest(run_plain(), run_same()) <= 8 * double(std::numeric_limits<Number>::epsilon()));

    Number const factor = Number(2.5);
    typename TestType::Model stiff_model;
    stiff_model.elasticity.mu *= factor;
    stiff_model.elasticity.lambda *= factor;
    Plain stiff(lattice(0.1), stiff_model);
    Solver stiffened(lattice(0.1));
    auto const run_stiff = vibrated(stiff, 40);
    auto const run_stiffened = vibrated(stiffened, 40);
    double const before = stiffened.bounds().wave_speed;
    stiffened.template upload<Stiffness>(std::vector<Number>(stiffened.size(), factor));
    CHECK(stiffened.bounds().wave_speed == Approx(std::sqrt(2.5) * before));
    auto const x = run_stiff();
    CHECK(furthest(x, run_stiffened()) <= (TestType::is_float ? 1e-6 : 1e-13));
    CHECK(furthest(x, plain.positions()) > 1e-4);
}

TEST_CASE("in a bar of two stiffnesses that is pulled the soft half gives more, by the ratio of the moduli")
{
    using Model = Heterogeneous<NeoHookean<Plane>>;
    Model rubber;
    rubber.elasticity = lame(1e5, 0.0); // no strain across: a bar in one dimension
    Scene<Model, QuadraticBSpline, Pic>::Solver solver(lattice(0.05), rubber);
    // hung up at its top, it bears a load that is its own weight: in the middle of both halves alike
    double const length = 0.8, width = 0.2, g = 2;
    auto const points = box_of_points<2>({0, 0}, {width, length}, 0.05);
    solver.add(points, 0.025 * 0.025);
    std::vector<double> factors;
    for (auto const& x : points) factors.push_back(x.y() > length / 2 ? 4 : 1);
    solver.upload<Stiffness>(factors);
    Obstacle<HalfSpace> const ceiling{
        .shape = {{0, -1, 0}}, .contact = Contact::sticky(), .motion = {.position = {0, length - 0.05, 0}}};
    solver.advance(4, Gravity{{0, -g, 0}}, ceiling);
    auto const H = solver.download<DisplacementGradient>();
    auto const strain_at = [&](double height) {
        double sum = 0;
        int count = 0;
        for (std::size_t i = 0; i < points.size(); ++i)
            if (std::abs(points[i].y() - height) < 0.03) sum += H[i](1, 1), ++count;
        return sum / count;
    };
    // the load at a height is the weight below it: rho g y; E = 1e5 below, 4e5 above
    CHECK(strain_at(0.25) == Approx(1000 * g * 0.25 / 1e5).epsilon(0.05));
    CHECK(strain_at(0.6) == Approx(1000 * g * 0.6 / 4e5).epsilon(0.05));
}

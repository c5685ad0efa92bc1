// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <random>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

using First = Material<0>;
using Second = Material<1>;
using Third = Material<2>;

template <class Space>
using Mixture = Materials<Snow<Space>, Sand<Space>, Fluid<Space>>;

Obstacle<HalfSpace> const floor_of_scene{.motion = {.position = {0, -0.01, 0}}};
Obstacle<Sphere> const ball_of_scene{
    .shape = {0.08},
    .contact = Contact::coulomb(0.5),
    .motion = {.position = {0.1, -0.03, 0.1}, .velocity = {0.5, 0, 0}, .time = 0},
    .on_particles = true};

/// Random particles of three materials, thrown on a floor and a ball that pushes particles, too.
template <class Solver>
AdvanceReport splash(Solver& solver, int steps, double dt, int count)
{
    constexpr int d = Solver::d;
    std::mt19937 random(9);
    std::uniform_real_distribution<double> inside(0, 0.2);
    std::vector<Vector<double, d>> points[3];
    for (auto& some : points) {
        some.resize(count);
        for (auto& x : some)
            for (int a = 0; a < d; ++a) x[a] = inside(random);
    }
    Vector<double, d> v = Vector<double, d>::Zero();
    v[1] = -4;
    double const volume = std::pow(0.2, d) / count / 3;
    solver.template add<First>(points[0], volume, v);
    solver.template add<Second>(points[1], volume, v);
    solver.template add<Third>(points[2], volume, v);
    AdvanceReport total;
    for (int i = 0; i < steps; ++i)
        total.add(solver.step(dt, Gravity{}, floor_of_scene, ball_of_scene), StepLimit::duration);
    return total;
}
} // namespace

using Splashes = Combinations<More<Scene<Mixture<Plane>, QuadraticBSpline, Mls>>,
                              Scene<Materials<Snow<Solid>, Sand<Solid>, Fluid<Solid>>, CubicBSpline, Flip>,
                              More<Scene<Mixture<SolidFloat>, QuadraticBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE(
    "of three materials mass stays, and momentum changes by the impulses of gravity and obstacles", "",
    Splashes)
{
    constexpr int d = TestType::d;
    typename TestType::Solver solver(lattice(0.025));
    double const dt = 5e-5;
    int const steps = 150;
    auto const report = splash(solver, steps, dt, d == 3 ? 1000 : 200);
    Totals const end(solver);
    double const mass =
        std::pow(0.2, d) / 3 *
        (double(solver.template model<First>().density) + double(solver.template model<Second>().density) +
         double(solver.template model<Third>().density));
    CHECK(std::abs(end.mass / mass - 1) <= (TestType::is_float ? 1e-6 : 1e-13));
    Vector<double, d> expected = Vector<double, d>::Zero();
    expected[1] = -4 * mass - 9.81 * steps * dt * mass;
    for (auto const& reaction : report.reactions) expected -= reaction.impulse.template head<d>();
    CHECK((end.momentum - expected).norm() <= (TestType::is_float ? 1e-5 : 1e-12) * 4 * mass);
    CHECK(report.reactions[0].impulse.y() < 0);
    CHECK(report.capped_of.size() == 3);
}

TEST_CASE("three materials give the same bits with any number of threads, and every time")
{
    using Solver = Scene<Mixture<Solid>, CubicBSpline, Flip>::Solver; // as above: it takes time to compile
#if defined(FIRN_TESTS_ON_OPENMP)
    auto const run = [](int threads) {
        Solver solver(lattice(0.01), {}, {}, {}, OpenMP{.threads = threads});
#else
    auto const run = [](int) {
        Solver solver(lattice(0.01));
#endif
        splash(solver, sample_of(20, 60), 3e-5, sample_of(3000, 6000));
        auto const some_go = solver.remove_if(Inside<Box>{.shape = {{0.05, 0.05, 0.3}}});
        CHECK(some_go > 0);
        for (int i = 0; i < 20; ++i) solver.step(3e-5, Gravity{}, floor_of_scene, ball_of_scene);
        return std::tuple{solver.ids(), solver.positions(), solver.template download<Velocity>(),
                          solver.template download<DisplacementGradient, First>()};
    };
    auto const one = run(1);
    for (int threads : {1, 2, 3}) CHECK((run(threads) == one)); // not to be printed
}

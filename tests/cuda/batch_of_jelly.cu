// SPDX-License-Identifier: MIT
#include "batch.hpp"
#include "catch.hpp"

#include <algorithm>

using namespace firn;
using namespace firn::test;

/// From some time on all momenta are no numbers.
struct NoMoreNumbers
{
    double from; ///< [s]

    void validate() const {}

    template <class Number, int d>
    struct Action
    {
        Number change;

        template <Lane Real>
        FIRN_HOST_DEVICE void on_momentum(Vector<Real, d>& momentum, Real) const
        {
            for (int a = 0; a < d; ++a) momentum[a] += Real(change);
        }
    };
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        return {interval.begin < from ? Number(0) : Number(NAN)};
    }
};

namespace
{

/// What a run tells in which any number of obstacles act on nodes and particles, solids and shells.
auto meet_many(std::size_t batch, double speed, StepControl control)
{
    Thrown<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>> scene(batch, speed, control);
    Obstacles<AnyShape<>, ActsOn::particles> solids;
    solids.list.push_back({.shape = HalfSpace{},
                           .contact = Contact::coulomb(0.3),
                           .motion = {.position = {0, 0.2, 0}},
                           .on_particles = true});
    for (int i = 0; i < 40; ++i)
        solids.list.push_back({.shape = Sphere{0.06},
                               .contact = Contact::coulomb(0.01 * i),
                               .motion = {.position = {0.1 * (i % 8) - 0.3, 0.2, 0.1 * (i / 8) - 0.3},
                                          .velocity = {0.1 * i, 1, 0},
                                          .angular_velocity = {0, 3, 0},
                                          .time = 0},
                               .on_particles = i % 2 == 0});
    Obstacles<Shell<Sphere>> const bubbles{
        {{.shape = {{0.3}, 0.002}, .motion = {.position = {0, 0.4, 0}, .time = 0}}}};
    auto const first = scene.solver.advance(0.0004 * sample_of(30, 50), Gravity{}, solids, bubbles);
    solids.list.pop_back();
    auto const second = scene.solver.advance(0.0004 * sample_of(15, 30), Gravity{}, solids, bubbles);
    std::vector<decltype(told(StepReport{}))> equal;
    for (auto const& each :
         scene.solver.steps(sample_of(8, 20), 0.2 * second.smallest_dt, Gravity{}, solids, bubbles))
        equal.push_back(told(each));
    return std::tuple{told(first), told(second), equal, state_of(scene.solver)};
}

} // namespace

TEST_CASE(
    "queued steps with any number of obstacles are those that are taken one by one, with the same reactions")
{
    auto const one_by_one = meet_many(1, 6, {});
    auto const& impulses = std::get<6>(std::get<0>(one_by_one));
    CHECK(std::count_if(impulses.begin(), impulses.end(), [](double each) { return each != 0; }) > 60);
    for (std::size_t batch : {2, 5, 64}) CHECK((meet_many(batch, 6, {}) == one_by_one));
    StepControl const strict{.deformation = 0.09, .rejection = 0.1};
    auto const with_rejected = meet_many(1, 30, strict);
    CHECK(std::get<1>(std::get<0>(with_rejected)) > 0);
    for (std::size_t batch : {3, 64}) CHECK((meet_many(batch, 30, strict) == with_rejected));
}

TEST_CASE("what obstacles of a group receive counts once where many particles leave their cells at once")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05));
    solver.add(box_of_points<3>({0.01, 0.01, 0.01}, {0.51, 0.51, 0.51}, 0.05), std::pow(0.025, 3),
               {3, -20, 1});
    Obstacles<Sphere, ActsOn::particles> balls; // between nodes, so that only particles meet them
    for (int i = 0; i < 200; ++i)
        balls.list.push_back({.shape = {0.03},
                              .contact = Contact::sticky(),
                              .motion = {.position = {0.05 * (i % 10) + 0.025, 0.05 * (i / 10 % 10) + 0.025,
                                                      0.05 * (i / 100) + 0.225}},
                              .on_particles = true});
    Totals const begin(solver);
    for (int i = 0; i < 6; ++i) {
        Totals const before(solver);
        auto const report = solver.step(2e-4, balls);
        Vector<double, 3> given = Totals(solver).momentum - before.momentum;
        for (auto const& reaction : report.reactions) given += reaction.impulse;
        CHECK(given.norm() <= 1e-4 * before.mass);
    }
    CHECK((Totals(solver).momentum - begin.momentum).norm() >= 0.01 * begin.momentum.norm());
}

TEST_CASE("so are equal steps, of which half of the particles leave their cells at once")
{
    using Solver = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
    auto const run = [](bool together) {
        int const steps = sample_of(40, 100);
        double const high = 0.01 + 0.05 * sample_of(5, 10);
        Solver solver(lattice(0.05));
        solver.add(box_of_points<3>({0.01, 0.01, 0.01}, {high, high, high}, 0.05), std::pow(0.025, 3),
                   {3, -20, 1});
        std::vector<decltype(told(StepReport{}))> all;
        if (together)
            for (auto const& report : solver.steps(steps, 2e-4, Gravity{})) all.push_back(told(report));
        else
            for (int i = 0; i < steps; ++i) all.push_back(told(solver.step(2e-4, Gravity{})));
        return std::tuple{all, state_of(solver)};
    };
    CHECK((run(true) == run(false)));
}

namespace
{

/// The result of some steps of crumbs, in batches of that size. Each crumb lies in a cell and a block of its
/// own; every second one flies, and every seven steps a fourth of those comes to a new block.
auto crumbs(int count, std::size_t batch)
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05), {}, {}, {},
                                                                        Cuda{.batch = batch});
    int const row = 12 * int(std::ceil(std::sqrt(count / 120.0)));
    std::vector<Vector<double, 3>> resting, flying;
    for (int k = 0; k < count; ++k) {
        Vector<double, 3> const low(0.4 * (k % row) + 0.05 * (k / 2 % 4) + 0.027, 0.4 * (k / row) + 0.077,
                                    0.077);
        auto const crumb = scattered<3>(
            box_of_points<3>(low, low + Vector<double, 3>::Constant(0.05), 0.05, sample_of(1, 3)), 0.002);
        auto& points = k % 2 == 0 ? resting : flying;
        points.insert(points.end(), crumb.begin(), crumb.end());
    }
    solver.add(resting, 1e-6);
    solver.add(flying, 1e-6, {35, 0.3, 0.1});
    std::vector<decltype(told(StepReport{}))> all;
    for (auto const& report : solver.steps(sample_of(9, 25), 2e-4, Gravity{})) all.push_back(told(report));
    return std::tuple{all, state_of(solver)};
}

} // namespace

TEST_CASE("so are those on whose way so many blocks are born that fewer teams share each")
{
    // up to 256 blocks have four teams each that put items in order, and up to 341 three that move them
    for (int const count : {235, 325}) {
        CAPTURE(count);
        auto const one_by_one = crumbs(count, 1);
        for (std::size_t batch : {5, 64}) CHECK((crumbs(count, batch) == one_by_one));
    }
}

TEST_CASE("so are those of so many blocks that no group follows a step before it ends, and some take several",
          "[many_blocks]")
{
    int const count = 4500;
    auto const one_by_one = crumbs(count, 1);
    for (std::size_t batch : {5, 64}) CHECK((crumbs(count, batch) == one_by_one));
}

TEST_CASE(
    "so are steps of three materials, one of them without particles: blocks are born, and some wait for "
    "others that lack room")
{
    using Solver = Scene<Materials<NeoHookean<SolidFloat>, FixedCorotated<SolidFloat>, Fluid<SolidFloat>>,
                         QuadraticBSpline, Mls>::Solver;
    auto const run = [](std::size_t batch) {
        Solver solver(lattice(0.05), {}, {}, {}, Cuda{.batch = batch});
        auto const box = [](double low, double high) {
            return box_of_points<3>({low, 0.3, 0}, {high, 0.6, 0.15}, 0.05);
        };
        solver.add<Material<0>>(box(0.01, 0.21), std::pow(0.025, 3), {4, -12, 0});
        solver.add<Material<2>>(box(0.31, 0.51), std::pow(0.025, 3), {-4, -3, 0}); // the second has none
        auto const report = solver.advance(0.001 * sample_of(15, 30), Gravity{}, Obstacle<HalfSpace>{});
        CHECK(report.substeps > 10);
        std::vector<decltype(told(StepReport{}))> equal;
        for (auto const& each :
             solver.steps(sample_of(8, 20), 0.4 * report.smallest_dt, Gravity{}, Obstacle<HalfSpace>{}))
            equal.push_back(told(each));
        return std::tuple{told(report),
                          equal,
                          solver.time(),
                          solver.positions(),
                          solver.download<Velocity, Material<0>>(),
                          solver.download<Velocity, Material<2>>()};
    };
    auto const one_by_one = run(1);
    for (std::size_t batch : {2, 5, 64}) CHECK((run(batch) == one_by_one));
}

TEST_CASE("requests for new blocks of a failed step are forgotten when the scene goes on")
{
    using Solver = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
    double const dt = 1e-4;
    for (std::size_t batch : {1, 64}) {
        Solver solver(lattice(0.05), {}, {}, {}, Cuda{.batch = batch}),
            untroubled(lattice(0.05), {}, {}, {}, Cuda{.batch = batch});
        for (auto* const scene : {&solver, &untroubled}) // all in one block of cells
            scene->add(box_of_points<3>({0, 0, 0}, {0.2, 0.2, 0.2}, 0.05), std::pow(0.025, 3), {1, 2, 3});
        CHECK_THROWS_AS(solver.steps(10, dt, NoMoreNumbers{5.5 * dt}), Error);
        CHECK(solver.time() == Approx(6 * dt));
        for (int i = 0; i < 6; ++i) untroubled.step(dt);
        for (auto* const scene : {&solver, &untroubled}) scene->steps(20, dt);
        auto const a = solver.positions(), b = untroubled.positions();
        REQUIRE(a.size() == b.size());
        double worst = 0; // velocities were read on the way, and particles scattered afresh
        for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, (a[i] - b[i]).norm());
        CHECK(worst <= 1e-7);
    }
}

TEST_CASE("a scene without particles takes its time")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05));
    CHECK(solver.steps(20, 0.1, Gravity{}).size() == 20);
    CHECK(solver.time() == Approx(2));
    CHECK(solver.advance(1).substeps >= 1);
}

#if defined(FIRN_ON_PROCESSOR) // which counts

TEST_CASE("the host waits for the device once a batch, not once a step")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    solver.add(box_of_points<3>({0, 0.2, 0}, {0.4, 0.6, 0.4}, 0.1), std::pow(0.05, 3));
    solver.advance(1e-3); // makes room
    double const dt = 0.5 * solver.step(1e-5).stable_dt;
    solver.steps(2, dt);
    auto const waits_of = [](auto const& call) {
        std::size_t const before = on_processor::waits;
        call();
        return on_processor::waits - before;
    };
    // the least of some calls: in the others the host may have to make room
    std::size_t of_steps = 64, of_advance = 64, steps = 0;
    for (int i = 0; i < 4; ++i) {
        of_steps = std::min(of_steps, waits_of([&] { solver.steps(60, dt); }));
        of_advance = std::min(of_advance, waits_of([&] { steps = solver.advance(50 * dt).substeps; }));
        CHECK(steps > 20);
    }
    CHECK(of_steps <= 2);
    CHECK(of_advance <= 2);
    // once more for what any number of obstacles received
    Obstacles<Sphere> const balls{{{.shape = {0.1}, .motion = {.position = {0.2, 0.2, 0.2}}}}};
    for (int i = 0; i < 2; ++i) solver.steps(60, dt, balls);
    CHECK(waits_of([&] { solver.steps(60, dt, balls); }) <= 4);
}

#endif

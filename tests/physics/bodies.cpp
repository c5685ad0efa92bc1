// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/local_damping.hpp>

#include <limits>
#include <utility>

using namespace firn;
using namespace firn::test;

// Bodies that touch without sticking together.
namespace
{

using Jelly = NeoHookean<Plane>;
using Five = firn::Solver<TestedBackend, BodiesOf<Jelly, 5>>;
using Two = firn::Solver<TestedBackend, Bodies<Jelly, Jelly>>;

double const h = 0.05;

Jelly jelly(double young)
{
    Jelly model;
    model.density = 1000;
    model.elasticity = lame(young, 0.3);
    return model;
}

template <std::size_t k, class Solver>
void add_box(Solver& solver, Vector<double, 2> const& low, Vector<double, 2> const& high,
             Vector<double, 2> const& velocity = {0, 0})
{
    solver.template add<Material<k>>(box_of_points<2>(low, high, h), h * h / 4, velocity);
}

/// The mean of a field of a body's particles.
template <std::size_t k, class Solver>
Vector<double, Solver::d> mean_velocity(Solver const& solver)
{
    Vector<double, Solver::d> sum = Vector<double, Solver::d>::Zero();
    auto const all = solver.template download<Velocity, Material<k>>();
    for (auto const& v : all) sum += v.template cast<double>() / double(all.size());
    return sum;
}

/// The lowest and the highest of a body's particles.
template <std::size_t k, class Solver>
std::pair<double, double> extent(Solver const& solver)
{
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (auto const& x : solver.template positions<Material<k>>())
        low = std::min(low, x[1]), high = std::max(high, x[1]);
    return {low, high};
}

} // namespace

TEST_CASE("a block that is thrown off another keeps its velocity, and the other stays at rest")
{
    double const off = GENERATE(0.0, 0.013, 0.031); // of the place between them from a node
    Two solver(lattice(h), {jelly(1e6), jelly(1e6), Contact::coulomb(0.5)});
    add_box<0>(solver, {off, 0}, {0.4 + off, 0.4}, {-1, 0});
    add_box<1>(solver, {0.4 + off, 0}, {0.8 + off, 0.4});
    solver.advance(0.3);
    CHECK((mean_velocity<0>(solver) - Vector<double, 2>(-1, 0)).norm() <= 1e-12);
    CHECK(mean_velocity<1>(solver).norm() <= 1e-12);
}

TEST_CASE("blocks that stick together as bodies share their momentum when one is pulled")
{
    Two solver(lattice(h), {jelly(1e6), jelly(1e6), Contact::sticky()});
    add_box<0>(solver, {0, 0}, {0.4, 0.4}, {-0.1, 0});
    add_box<1>(solver, {0.4, 0}, {0.8, 0.4});
    double of_second = 0; // averaged over the vibrations
    for (int i = 0; i < 50; ++i) {
        solver.advance(0.02);
        of_second += mean_velocity<1>(solver)[0] / 50;
    }
    CHECK(of_second == Approx(-0.05).margin(0.003));
    CHECK((mean_velocity<0>(solver) + mean_velocity<1>(solver))[0] == Approx(-0.1).epsilon(1e-12));
}

TEST_CASE("blocks that collide come closer than a fifth of a cell to contact, and fly apart")
{
    Two solver(lattice(h), {jelly(1e6), jelly(1e6)});
    add_box<0>(solver, {0, 0}, {0.4, 0.4}, {1, 0});
    add_box<1>(solver, {0.7, 0}, {1.1, 0.4});
    double gap = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 40; ++i) {
        solver.advance(0.02);
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (auto const& x : solver.positions<Material<1>>()) low = std::min(low, x[0]);
        for (auto const& x : solver.positions<Material<0>>()) high = std::max(high, x[0]);
        gap = std::min(gap, low - high);
    }
    double const spacing = h / 2; // of the particles, where the blocks' surfaces touch
    CHECK(gap > spacing - 0.1 * h);
    CHECK(gap < spacing + 0.2 * h);
    double const v = mean_velocity<0>(solver)[0], w = mean_velocity<1>(solver)[0];
    CHECK(v + w == Approx(1).epsilon(1e-12));
    CHECK(w > 0.75); // what is missing vibrates
}

TEST_CASE("a block that slides on another is slowed down by friction as Coulomb says")
{
    double const mu = GENERATE(0.1, 0.3, 0.6), off = GENERATE(0.0, 0.02, 0.035), g = 9.81;
    Two solver(lattice(h), {jelly(1e7), jelly(1e7), Contact::coulomb(mu)});
    add_box<0>(solver, {0, off}, {4, 0.3 + off});
    add_box<1>(solver, {0.5, 0.3 + off}, {1.3, 0.6 + off});
    Obstacle<HalfSpace> const table{.contact = Contact::sticky(), .motion = {.position = {0, off, 0}}};
    solver.advance(0.3, Gravity{}, table, Damping{.rate = 30}); // the block's weight comes to rest
    auto velocities = solver.download<Velocity, Material<1>>();
    for (auto& v : velocities) v[0] += 2;
    solver.upload<Velocity, Material<1>>(velocities);
    double const start = mean_velocity<1>(solver)[0], duration = 0.7 * std::min(0.6, 2 / (mu * g));
    solver.advance(duration, Gravity{}, table);
    CHECK((start - mean_velocity<1>(solver)[0]) / duration == Approx(mu * g).epsilon(0.02));
}

TEST_CASE("a stack of five blocks rests")
{
    BodyContact<5> contact = Contact::coulomb(0.5);
    contact.between(1, 2) = Contact::slip();
    Five solver(lattice(h), {jelly(1e6), jelly(1e6), jelly(1e6), jelly(1e6), jelly(1e6), contact});
    double const off = 0.017, g = 9.81;
    [&]<std::size_t... k>(std::index_sequence<k...>)
    {
        (add_box<k>(solver, {0.4, 0.3 * double(k) + off}, {1, 0.3 * double(k + 1) + off}), ...);
    }
    (std::make_index_sequence<5>{});
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5), .motion = {.position = {0, off, 0}}};
    solver.advance(1, Gravity{}, floor, Damping{.rate = 20});
    auto const [low, high] = extent<4>(solver);
    auto const before = solver.totals();
    auto const report = solver.advance(1, Gravity{}, floor);
    auto const after = solver.totals();
    CHECK(after.kinetic_energy <= 1e-7 * after.mass * g * h);
    CHECK((after.centre_of_mass - before.centre_of_mass).norm() <= 1e-3 * h);
    CHECK(std::abs(extent<4>(solver).second - high) <= 1e-3 * h);
    CHECK(report.reactions[0].impulse[1] == Approx(-after.mass * g).epsilon(1e-3));
    double const spacing = h / 2;
    CHECK(extent<1>(solver).first - extent<0>(solver).second == Approx(spacing).margin(0.1 * h));
    CHECK(extent<4>(solver).first - extent<3>(solver).second == Approx(spacing).margin(0.1 * h));
    CHECK(low > 1.1);
}

TEST_CASE("what bodies give each other is momentum that neither gains nor loses, five at a time")
{
    Five solver(lattice(h),
                {jelly(1e5), jelly(1e5), jelly(1e5), jelly(1e5), jelly(1e5), Contact::coulomb(0.4)});
    [&]<std::size_t... k>(std::index_sequence<k...>)
    {
        auto const fly = [&](double angle, auto material) { // all to one place
            Vector<double, 2> const way(std::cos(angle), std::sin(angle)), centre = 0.28 * way;
            solver.add<decltype(material)>(ball_of_points<2>(centre, 0.12, h), h * h / 4, -2 * way);
        };
        (fly(0.3 + 6.283 / 5 * double(k), Material<k>{}), ...);
    }
    (std::make_index_sequence<5>{});
    auto const before = solver.totals();
    Vector<double, 2> const velocity = mean_velocity<3>(solver);
    solver.advance(0.15);
    auto const after = solver.totals();
    CHECK((after.momentum - before.momentum).norm() <= 1e-12 * before.mass * velocity.norm());
    CHECK(mean_velocity<3>(solver).dot(velocity) < 0); // they have met, and fly apart
    CHECK(after.kinetic_energy < before.kinetic_energy);
}

using Pairs =
    Combinations<Scene<Bodies<NeoHookean<Solid>, FixedCorotated<Solid>>, CubicBSpline, Flip>,
                 More<Scene<Bodies<NeoHookean<SolidFloat>, FixedCorotated<SolidFloat>>, CubicBSpline, Flip>,
                      Scene<Bodies<NeoHookean<Solid>, Fluid<Solid>>, QuadraticBSpline, Mls>,
                      Scene<Bodies<Snow<Plane>, Sand<Plane>>, QuadraticBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE("bodies of other materials and transfers push each other, and let go", "", Pairs)
{
    constexpr int d = TestType::d;
    typename TestType::Solver solver(lattice(h));
    Vector<double, d> low = Vector<double, d>::Constant(0.011), high = low, step = Vector<double, d>::Zero(),
                      velocity = step;
    high += Vector<double, d>::Constant(0.2);
    step[1] = 0.2;
    velocity[1] = 1;
    solver.template add<Material<0>>(box_of_points<d>(low, high, h), std::pow(h / 2, d));
    solver.template add<Material<1>>(box_of_points<d>(low + step, high + step, h), std::pow(h / 2, d),
                                     velocity);
    double const rounding = TestType::is_float ? 1e-4 : 1e-11;
    solver.advance(0.02);
    CHECK(mean_velocity<0>(solver).norm() <= rounding);
    CHECK((mean_velocity<1>(solver) - velocity).norm() <= rounding);

    auto velocities = solver.template download<Velocity, Material<1>>();
    for (auto& v : velocities) v[1] = -2;
    solver.template upload<Velocity, Material<1>>(velocities);
    auto const before = solver.totals();
    solver.advance(0.05);
    auto const after = solver.totals();
    CHECK((after.momentum - before.momentum).norm() <= rounding * before.momentum.norm());
    CHECK(mean_velocity<0>(solver)[1] < -0.2);
}

TEST_CASE("local damping holds back bodies that fall apart from each other, each by its share of the force")
{
    using Falling = Scene<Bodies<NeoHookean<SolidFloat>, FixedCorotated<SolidFloat>>, CubicBSpline, Flip>;
    Falling::Solver solver(lattice(h));
    solver.add<Material<0>>(box_of_points<3>({0.011, 0.011, 0.011}, {0.2, 0.2, 0.2}, h), std::pow(h / 2, 3),
                            {0, -1, 0});
    solver.add<Material<1>>(box_of_points<3>({0.811, 0.011, 0.011}, {1, 0.2, 0.2}, h), std::pow(h / 2, 3),
                            {0, 1, 0});
    auto const report = solver.advance(0.02, Gravity{}, LocalDamping{0.5});
    double const fall = 9.81 * report.time_of_forces;
    CHECK(mean_velocity<0>(solver)[1] == Approx(-1 - 0.5 * fall).epsilon(1e-3));
    CHECK(mean_velocity<1>(solver)[1] == Approx(1 - 1.5 * fall).epsilon(1e-3)); // it still rises
}

TEST_CASE("a scene of bodies goes on from its snapshot bit by bit, with the same contact only")
{
    auto const scene = [](Contact const& contact) {
        Two solver(lattice(h), {jelly(1e6), jelly(1e6), contact});
        return solver;
    };
    Two solver = scene(Contact::coulomb(0.4));
    add_box<0>(solver, {0, 0}, {0.3, 0.3});
    add_box<1>(solver, {0.1, 0.32}, {0.4, 0.5}, {0.5, -1});
    solver.advance(0.05, Gravity{});
    auto const snapshot = solver.snapshot();
    Two again = scene(Contact::coulomb(0.4)), other = scene(Contact::coulomb(0.5));
    again.restore(snapshot);
    solver.advance(0.05, Gravity{});
    again.advance(0.05, Gravity{});
    auto const x = solver.positions(), y = again.positions();
    std::size_t different = 0;
    for (std::size_t i = 0; i < x.size(); ++i) different += x[i] != y[i];
    CHECK(different == 0);
    CHECK_THAT(refused([&] { other.restore(snapshot); }).what(), Contains("contact.0_1.friction"));
}

TEST_CASE("a step that failed leaves bodies as they were")
{
    auto const run = [](bool fails) {
        Two solver(lattice(h), {jelly(1e6), jelly(1e6), Contact::coulomb(0.4)});
        add_box<0>(solver, {0, 0}, {0.3, 0.3});
        add_box<1>(solver, {0.1, 0.32}, {0.4, 0.5}, {0.5, -1});
        solver.advance(0.05, Gravity{}); // they touch
        auto const velocities = solver.download<Velocity, Material<0>>();
        solver.upload<Velocity, Material<0>>(velocities); // so that particles scatter anew in either case
        auto const before = solver.positions();
        if (fails) {
            CHECK_THROWS_AS(solver.step(1, Gravity{}), StepError);
            CHECK(solver.positions() == before);
        }
        solver.steps(20, 1e-4, Gravity{});
        return std::pair{solver.positions(), solver.download<Velocity, Material<1>>()};
    };
    CHECK((run(true) == run(false)));
}

TEST_CASE("a particle of a body goes into quarantine, and all of a body may be removed")
{
    Two solver(lattice(h), {jelly(1e6), jelly(1e6), Contact::sticky()}),
        alone(lattice(h), {jelly(1e6), jelly(1e6)});
    add_box<0>(solver, {0, 0}, {0.3, 0.3}, {1, 0});
    add_box<0>(alone, {0, 0}, {0.3, 0.3}, {1, 0});
    add_box<1>(solver, {0.3, 0}, {0.6, 0.3}, {1, 0});
    std::size_t const of_each = alone.size();
    solver.quarantine(1);
    auto H = solver.download<DisplacementGradient, Material<1>>();
    H[7](0, 0) = -3; // inside out
    solver.upload<DisplacementGradient, Material<1>>(H);
    std::uint32_t const id = solver.ids<Material<1>>()[7];
    auto const isolated = solver.step(1e-5, Gravity{}).isolated;
    REQUIRE(isolated.size() == 1);
    CHECK(isolated[0].particle == id);
    CHECK(isolated[0].material == 1);
    CHECK(solver.size() == 2 * of_each - 1);
    CHECK(solver.positions<Material<0>>().size() == of_each);
    alone.step(1e-5, Gravity{});
    // with nothing beside it the body goes on as one that was alone from the beginning
    CHECK(solver.remove_if(Inside<HalfSpace>{.shape = {{-1, 0, 0}}, .pose = {.position = {0.3, 0, 0}}}) ==
          of_each - 1);
    CHECK(solver.positions<Material<1>>().empty());
    solver.advance(0.05, Gravity{});
    alone.advance(0.05, Gravity{});
    auto const x = solver.positions(), y = alone.positions();
    double worst = 0;
    for (std::size_t i = 0; i < of_each; ++i) worst = std::max(worst, (x[i] - y[i]).norm());
    CHECK(worst <= 1e-4 * h); // in the first step they still shared nodes
}

TEST_CASE("the snapshot of materials that stick together is refused by bodies, unless it is on purpose")
{
    firn::Solver<TestedBackend, Materials<Jelly, Jelly>> sticking(lattice(h), {jelly(1e6), jelly(1e6)});
    add_box<0>(sticking, {0, 0}, {0.3, 0.3});
    auto snapshot = sticking.snapshot();
    Two solver(lattice(h), {jelly(1e6), jelly(1e6)});
    CHECK_THAT(refused([&] { solver.restore(snapshot); }).what(), Contains("stick together"));
    snapshot.forget_parameters();
    solver.restore(snapshot);
    CHECK(solver.size() == sticking.size());
}

#if defined(FIRN_TESTS_ON_OPENMP)
TEST_CASE("bodies that collide give the same bits with any number of threads")
{
    auto const run = [](int threads) {
        Five solver(lattice(h),
                    {jelly(1e5), jelly(1e5), jelly(1e5), jelly(1e5), jelly(1e5), Contact::coulomb(0.4)}, {},
                    {}, {.threads = threads});
        add_box<0>(solver, {0, 0}, {2, 0.5});
        add_box<1>(solver, {0.1, 0.52}, {0.9, 1}, {0.3, -1});
        add_box<2>(solver, {1, 0.52}, {1.9, 1}, {-0.3, -1});
        solver.advance(0.05, Gravity{});
        return solver.positions();
    };
    auto const one = run(1), three = run(3);
    std::size_t different = 0;
    for (std::size_t i = 0; i < one.size(); ++i) different += one[i] != three[i];
    CHECK(different == 0);
}
#endif

TEST_CASE("contact between bodies is refused if its numbers make no sense")
{
    Two solver(lattice(0.1)); // they know what space their masses fill
    CHECK_THAT(refused([&] {
                   solver.add<Material<0>>(std::vector{Eigen::Vector2d(0, 0)}, Volumes(1e-3, 2000));
               }).what(),
               Contains("densities of their own"));
    double const no_number = std::numeric_limits<double>::quiet_NaN();
    auto const is_refused = [&](BodyContact<2> const& contact, char const* what) {
        CHECK_THAT(refused([&] {
                       Two(lattice(h), {jelly(1e6), jelly(1e6), contact});
                   }).what(),
                   Contains(what));
    };
    is_refused(Contact::coulomb(-0.1), "friction");
    is_refused(Contact::coulomb(no_number), "friction");
    BodyContact<2> contact;
    contact.touching = GENERATE_COPY(-0.1, 1.1, no_number);
    is_refused(contact, "share of space");
    CHECK_THAT(refused([&] { contact.between(1, 1); }).what(), Contains("no such two bodies"));
    CHECK_THAT(refused([&] { contact.between(0, 2) = Contact::slip(); }).what(),
               Contains("no such two bodies"));
}

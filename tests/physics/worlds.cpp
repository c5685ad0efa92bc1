// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/budget.hpp>
#include <firn/contact_points.hpp>
#include <firn/worlds.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

double const h = 0.05, dt = 2e-4;

/// A block of jelly that falls onto the floor, in the plane and in space.
using InPlane = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using InSpace = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;

template <int d>
std::vector<Vector<double, d>> block(double side)
{
    Vector<double, d> low = Vector<double, d>::Zero();
    low[1] = 0.01;
    return box_of_points<d>(low, low + Vector<double, d>::Constant(side), h);
}

Obstacle<HalfSpace> const ground{.contact = Contact::coulomb(0.3)};

/// A ball that pushes the block, the faster the higher the world's number.
Obstacle<AnyShape<>> ball(double speed)
{
    return {.shape = Sphere{0.08},
            .contact = Contact::slip(),
            .motion = {.position = {-0.1, 0.12, 0.1}, .velocity = {speed, 0, 0}, .time = 0.0}};
}

/// The values of the particles whose ids are in [first, first + count).
template <class Tag, class Solver>
auto values(Solver const& solver, std::size_t first, std::size_t count)
{
    auto const all = solver.template download<Tag>();
    auto const begin = all.begin() + std::ptrdiff_t(first);
    return std::vector(begin, begin + std::ptrdiff_t(count));
}

template <class Solver>
auto places(Solver const& solver, std::size_t first, std::size_t count)
{
    auto const all = solver.positions();
    auto const begin = all.begin() + std::ptrdiff_t(first);
    return std::vector(begin, begin + std::ptrdiff_t(count));
}

/// Whether particles of two solvers have the same bits.
template <class One, class Other>
bool same(One const& one, std::size_t first, Other const& other, std::size_t other_first, std::size_t count)
{
    return places(one, first, count) == places(other, other_first, count) &&
           values<Velocity>(one, first, count) == values<Velocity>(other, other_first, count) &&
           values<DisplacementGradient>(one, first, count) ==
               values<DisplacementGradient>(other, other_first, count);
}

/// Turns particles of some ids inside out, so that the next step fails because of them.
template <class Solver>
void turn_inside_out(Worlds<Solver>& worlds, std::vector<std::uint32_t> const& ids)
{
    auto const found = worlds.ids();
    auto of = worlds.template download<DisplacementGradient>();
    for (std::size_t i = 0; i < of.size(); ++i)
        if (std::find(ids.begin(), ids.end(), found[i]) != ids.end()) of[i](0, 0) = -2;
    worlds.template upload<DisplacementGradient>(of);
}

template <class Call>
void check_refused(Call const& call, std::string const& what)
{
    Error const error = refused(call);
    CHECK_THAT(error.what_is_wrong() + error.where(), Contains(what));
}

} // namespace

TEMPLATE_TEST_CASE("a world has the bits of a scene of its own", "[physics][worlds]", InPlane, InSpace)
{
    constexpr int d = TestType::d;
    double const volume = std::pow(h / 2, d);
    auto const points = block<d>(0.2);
    std::size_t const n = points.size();
    std::uint32_t const count = 5;
    Worlds<TestType> worlds(count, lattice(h));
    std::vector<TestType> alone;
    std::vector<Obstacles<>> of_alone;
    for (std::uint32_t w = 0; w < count; ++w) {
        CHECK(worlds.add(w, points, volume) == w * n);
        worlds.obstacles(w).push_back(ball(0.5 + w));
        alone.emplace_back(lattice(h));
        alone.back().add(points, volume);
        of_alone.push_back({worlds.obstacles(w)});
    }
    std::vector<Reaction> of_ball(count);
    for (int call = 0; call < 4; ++call) {
        auto const reports = worlds.steps(20, dt, Gravity{}, ground);
        REQUIRE(reports.size() == 20);
        REQUIRE(reports[0].reactions.size() == 1); // of the ground, in all worlds
        for (std::uint32_t w = 0; w < count; ++w) {
            Reaction received{};
            if (call > 0)
                static_cast<void>(alone[w].snapshot()); // scatters afresh, as worlds do in each call
            for (auto const& report : alone[w].steps(20, dt, Gravity{}, ground, of_alone[w]))
                received += report.reactions[1];
            REQUIRE(worlds.reactions(w).size() == 1);
            CHECK((worlds.reactions(w)[0].impulse - received.impulse).norm() <=
                  1e-12 * received.impulse.norm());
            of_ball[w] += received;
        }
    }
    for (std::uint32_t w = 0; w < count; ++w) {
        CAPTURE(w);
        CHECK(same(worlds.solver(), w * n, alone[w], 0, n));
        CHECK(of_ball[w].impulse.norm() > 0); // the ball did meet the block
        if (w > 0) CHECK(!same(worlds.solver(), w * n, worlds.solver(), 0, n));
    }
    auto const world_of = worlds.world_of_particles();
    REQUIRE(world_of.size() == count * n);
    for (std::size_t i = 0; i < world_of.size(); ++i) REQUIRE(world_of[i] == i / n);
}

TEMPLATE_TEST_CASE("a world that is reset begins anew, and the others keep their bits", "[physics][worlds]",
                   InPlane, InSpace)
{
    constexpr int d = TestType::d;
    double const volume = std::pow(h / 2, d);
    auto const points = block<d>(0.2);
    std::size_t const n = points.size();
    std::uint32_t const count = 3;
    Worlds<TestType> worlds(count, lattice(h)), undisturbed(count, lattice(h));
    auto const begin = [&](Worlds<TestType>& of) {
        for (std::uint32_t w = 0; w < count; ++w) {
            of.add(w, points, volume);
            of.obstacles(w).push_back(ball(0.5 + w));
        }
    };
    begin(worlds);
    begin(undisturbed);
    auto const start = worlds.save(1);
    CHECK(start.time == 0);
    auto const go_on = [&](Worlds<TestType>& of) { return of.steps(15, dt, Gravity{}, ground); };
    for (int call = 0; call < 3; ++call) go_on(worlds), go_on(undisturbed);
    worlds.reset(1, start);
    CHECK(worlds.time(1) == 0);
    CHECK(worlds.time(0) == Approx(45 * dt));
    CHECK(places(worlds.solver(), 0, n) == places(undisturbed.solver(), 0, n));
    CHECK(values<Velocity>(worlds.solver(), 2 * n, n) == values<Velocity>(undisturbed.solver(), 2 * n, n));
    go_on(worlds), go_on(undisturbed);
    CHECK(same(worlds.solver(), 0, undisturbed.solver(), 0, n));
    CHECK(same(worlds.solver(), 2 * n, undisturbed.solver(), 2 * n, n));
    CHECK(worlds.time(1) == Approx(15 * dt));

    // it takes the path that it took at first, with its ball at its own time, but for the rounding of times
    Worlds<TestType> first(count, lattice(h));
    begin(first);
    go_on(first);
    auto const again = places(worlds.solver(), n, n), at_first = places(first.solver(), n, n);
    for (std::size_t i = 0; i < n; ++i) REQUIRE((again[i] - at_first[i]).norm() <= 1e-9 * h);

    // the state of a world in two others at once, in whatever order its particles lie now
    auto const later = worlds.save(0);
    worlds.reset(std::vector<std::uint32_t>{2, 1}, later);
    CHECK(worlds.time(2) == worlds.time(0));
    CHECK(same(worlds.solver(), n, worlds.solver(), 0, n));
    CHECK(same(worlds.solver(), 2 * n, worlds.solver(), 0, n));
    for (std::uint32_t w = 0; w < count; ++w) worlds.obstacles(w) = {ball(1)};
    go_on(worlds);
    CHECK(same(worlds.solver(), n, worlds.solver(), 0, n));
    CHECK(same(worlds.solver(), 2 * n, worlds.solver(), 0, n));

    // cleared and filled again: other ids, and the others keep their bits
    auto const before = places(worlds.solver(), 0, n);
    CHECK(worlds.clear(1) == n);
    CHECK(places(worlds.solver(), 0, n) == before);
    CHECK(worlds.add(1, points, volume) == 3 * n);
    go_on(worlds);
    CHECK(worlds.solver().size() == 3 * n);
}

TEST_CASE("worlds refuse what they cannot do, and change nothing", "[physics][worlds][refusal]")
{
    using Solver = InPlane;
    auto const points = block<2>(0.1);
    check_refused([] { Worlds<Solver>(0, lattice(h)); }, "the number of worlds");
    check_refused([] { Worlds<Solver>((1u << 20) + 1, lattice(h)); }, "the number of worlds");
    Worlds<Solver> worlds(3, lattice(h));
    check_refused([&] { worlds.add(3, points, 1e-4); }, "there is no world 3");
    check_refused([&] { static_cast<void>(worlds.obstacles(7)); }, "there is no world 7");
    check_refused([&] { worlds.add(1, std::vector<Eigen::Vector2d>{{1e9, 0}}, 1e-4); }, "point 0");
    worlds.add(0, points, 1e-4);
    worlds.add(1, points, 2e-4);
    auto const start = worlds.save(0);
    check_refused([&] { worlds.reset(2, start); }, "world 2 has 0 particles");
    check_refused([&] { worlds.reset(1, start); }, "other masses");
    check_refused([&] { worlds.reset(std::vector<std::uint32_t>{0, 0}, start); }, "listed twice");
    check_refused([&] { Worlds<Solver>(1, lattice(2 * h)).reset(0, start); }, "another size");
    auto stiffer = Solver::Model{};
    stiffer.elasticity.mu *= 2;
    check_refused([&] { Worlds<Solver>(1, lattice(h), stiffer).reset(0, start); }, "mu");
    check_refused([&] { worlds.solver().sample(points); }, "many worlds");
    worlds.obstacles(2).push_back(ball(1));
    worlds.obstacles(2).back().motion.velocity[0] = NAN;
    check_refused([&] { worlds.advance(0.01, Gravity{}); }, "number 0 of world 2");
    worlds.obstacles(2) = {ball(1)};
    worlds.advance(0.01, Gravity{});
    CHECK(worlds.reactions(2).size() == 1);
    worlds.obstacles(2).clear();
    check_refused([&] { worlds.advance(-1, Gravity{}); }, "duration");
    CHECK(worlds.reactions(2).size() == 1); // of the call before
    worlds.obstacles(2) = {ball(1)};
    worlds.obstacles(2)[0].on_particles = true;
    check_refused([&] { worlds.advance(0.01, Gravity{}); }, "obstacles do not");
    worlds.obstacles(2).clear();

    // states that were not saved so, and of the same masses in another unit
    auto const refuses = [&](auto const& change, char const* what) {
        auto state = start;
        change(state);
        auto const before = worlds.positions();
        check_refused([&] { worlds.reset(0, state); }, what);
        CHECK(worlds.positions() == before);
    };
    refuses([](auto& state) { state.materials[0].cells[0][0] = 1 << 29; }, "a cell is out of range");
    refuses([](auto& state) { state.materials[0].ids[1] = state.materials[0].ids[0]; }, "of one rank");
    refuses([](auto& state) { state.materials[0].offsets[0].pop_back(); }, "one offset per particle");
    refuses([](auto& state) { state.bounds.material = 7; }, "out of range");
    refuses([](auto& state) { state.origin[0] = 1; }, "place");
    refuses([](auto& state) { state.masses.unit *= 2; }, "other masses");
    Worlds<Solver> others(2, lattice(h));
    others.add(1, points, 3e-4);
    others.add(0, points, 1e-4);
    others.reset(0, start);
    CHECK(others.time(0) == start.time);
    CHECK(worlds.time(2) == Approx(0.01));
    CHECK(worlds.solver().size() == 2 * points.size());
}

TEST_CASE("a particle at the border of its world fails as at the border of the lattice", "[physics][worlds]")
{
    Worlds<InPlane> worlds(5, lattice(h));
    double const edge = h * worlds.solver().lattice().half_world;
    worlds.add(0, block<2>(0.1), 1e-4);
    worlds.add(4, std::vector<Eigen::Vector2d>{{edge - 70 * h, 0}}, 1e-4, {0.2 * h / dt, 0});
    worlds.add(3, std::vector<Eigen::Vector2d>{{-edge + 70 * h, 0}}, 1e-4);
    worlds.quarantine(1);
    for (int call = 0; call < 25; ++call) worlds.steps(10, dt, Gravity{});
    REQUIRE(worlds.solver().isolated().size() == 1);
    CHECK(worlds.solver().isolated()[0].cause == FailureCause::escaped);
    CHECK(worlds.solver().size() == block<2>(0.1).size() + 1);
    CHECK(worlds.world_of_particles().back() == 3);
}

TEST_CASE("a failure names the world and the place in it, alone or in quarantine",
          "[physics][worlds][refusal]")
{
    std::uint32_t const count = 7;
    auto const points = block<2>(0.1);
    auto const n = std::uint32_t(points.size());
    auto const begun = [&] {
        Worlds<InPlane> worlds(count, lattice(h));
        for (std::uint32_t w = 0; w < count; ++w) worlds.add(w, points, h * h / 4);
        return worlds;
    };
    for (std::uint32_t w = 0; w < count; ++w) {
        CAPTURE(w);
        auto worlds = begun();
        turn_inside_out(worlds, {w * n + 3});
        auto const check = [&](StepFailure const& failure) {
            CHECK(failure.particle == w * n + 3);
            CHECK(failure.world == w);
            CHECK(failure.position.head<2>() == worlds.positions()[3]); // the same in every world
        };
        try {
            worlds.step(dt, Gravity{});
            FAIL("nothing was thrown");
        }
        catch (StepError const& error) {
            check(error.failure());
            CHECK_THAT(error.where(), Contains("m in world " + std::to_string(w)));
        }
        worlds.quarantine(1);
        auto const report = worlds.advance(dt, Gravity{});
        REQUIRE(report.isolated.size() == 1);
        CHECK(report.isolated[0].world == w);
        REQUIRE(worlds.solver().isolated().size() == 1);
        CHECK(worlds.solver().isolated()[0].world == w);
    }
    auto worlds = begun(); // no step advances time
    auto v = worlds.download<Velocity>();
    v[5 * n + 1] = {1e30, 0};
    worlds.upload<Velocity>(v);
    CHECK_THAT(refused([&] { worlds.advance(dt); }).where(), Contains("in world 5"));
    InPlane alone(lattice(h));
    alone.add(points, h * h / 4);
    auto of = alone.download<DisplacementGradient>();
    of[3](0, 0) = -2;
    alone.upload<DisplacementGradient>(of);
    CHECK_THAT(refused([&] { alone.step(dt, Gravity{}); }).where(), !Contains("world"));
}

TEMPLATE_TEST_CASE("particles in quarantine come back when their world is reset, and others keep their bits",
                   "[physics][worlds]", InPlane, InSpace)
{
    constexpr int d = TestType::d;
    auto const points = block<d>(0.2);
    auto const n = std::uint32_t(points.size());
    std::vector<double> volumes(n, std::pow(h / 2, d)); // mass groups of 4, 1 and n - 5 particles
    for (std::uint32_t i = 0; i < 4; ++i) volumes[i] *= 2;
    volumes[4] *= 3;
    std::uint32_t const count = 3, lost_first = n + 4, lost_last = 2 * n - 1;
    Worlds<TestType> worlds(count, lattice(h)), stays(count, lattice(h)), first(count, lattice(h));
    for (auto* of : {&worlds, &stays, &first}) {
        of->quarantine(2);
        for (std::uint32_t w = 0; w < count; ++w) {
            of->add(w, points, volumes);
            of->obstacles(w).push_back(ball(0.5 + w));
        }
    }
    auto const start = worlds.save(1);
    auto const go_on = [&](Worlds<TestType>& of) { of.steps(15, dt, Gravity{}, ground); };
    go_on(first);
    for (auto* of : {&worlds, &stays}) {
        go_on(*of);
        turn_inside_out(*of, {lost_first, lost_last});
        go_on(*of);
        REQUIRE(of->solver().isolated().size() == 2);
        REQUIRE(of->size() == count * n - 2);
    }
    auto const others_are_same = [&] { // two particles are not in `stays`
        return same(worlds.solver(), 0, stays.solver(), 0, n) &&
               same(worlds.solver(), 2 * n, stays.solver(), 2 * n - 2, n);
    };
    worlds.reset(1, start);
    CHECK(worlds.solver().isolated().empty());
    CHECK(worlds.time(1) == 0);
    std::vector<std::uint32_t> all(count * n);
    std::iota(all.begin(), all.end(), 0);
    CHECK(worlds.ids() == all);
    CHECK(others_are_same());
    auto const again = worlds.save(1);
    CHECK(again.materials[0].ids == start.materials[0].ids);
    CHECK(again.materials[0].offsets == start.materials[0].offsets);
    auto const &masses = start.materials[0].mass_groups, &masses_again = again.materials[0].mass_groups;
    REQUIRE(masses_again.size() == masses.size());
    for (std::size_t i = 0; i < masses.size(); ++i) {
        CHECK(masses_again[i].first_row == masses[i].first_row);
        CHECK(masses_again[i].mass == masses[i].mass);
        CHECK(masses_again[i].volume == masses[i].volume);
    }
    go_on(worlds), go_on(stays);
    CHECK(others_are_same());
    auto const now = places(worlds.solver(), n, n), then = places(first.solver(), n, n);
    for (std::size_t i = 0; i < n; ++i) REQUIRE((now[i] - then[i]).norm() <= 1e-9 * h);

    // there is room for two again; and of two that were lost one after the other, a state between has one
    turn_inside_out(worlds, {lost_last});
    go_on(worlds);
    auto const between = worlds.save(1);
    turn_inside_out(worlds, {lost_first});
    go_on(worlds);
    REQUIRE(worlds.solver().isolated().size() == 2);
    worlds.reset(1, between);
    REQUIRE(worlds.solver().isolated().size() == 1);
    CHECK(worlds.solver().isolated()[0].particle == lost_last);
    CHECK(worlds.save(1).materials[0].offsets == between.materials[0].offsets);
    check_refused([&] { worlds.reset(0, between); }, "world 0 has " + std::to_string(n) + " particles");

    // the state of a world that lost none, in two at once
    worlds.reset(std::vector<std::uint32_t>{2, 1}, start);
    CHECK(worlds.ids() == all);
    CHECK(same(worlds.solver(), n, worlds.solver(), 2 * n, n));
    for (std::uint32_t w = 1; w < count; ++w) worlds.obstacles(w) = {ball(1)};
    go_on(worlds);
    CHECK(same(worlds.solver(), n, worlds.solver(), 2 * n, n));
}

TEST_CASE("a world that lost particles is cleared of them, and refuses states that lack others",
          "[physics][worlds][refusal]")
{
    auto const points = block<2>(0.1);
    auto const n = std::uint32_t(points.size());
    Worlds<InPlane> worlds(2, lattice(h));
    worlds.quarantine(n);
    for (std::uint32_t w = 0; w < 2; ++w) worlds.add(w, points, h * h / 4);
    auto const start = worlds.save(0);
    worlds.remove_if(
        Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {points[0].x(), points[0].y(), 0}}});
    REQUIRE(worlds.size() == 2 * n - 2); // one of each world
    turn_inside_out(worlds, {3});
    worlds.step(dt);
    check_refused([&] { worlds.reset(0, start); }, "and 1 in quarantine, and the state has");
    // world 1 lost one to remove_if() alone, which says what to do
    auto const gone = refused([&] { worlds.reset(1, start); });
    CHECK_THAT(gone.what_is_wrong(), Contains("world 1 has " + std::to_string(n - 1) + " particles"));
    CHECK_THAT(gone.remedy(), Contains("What remove_if() took does not come back"));
    CHECK(worlds.solver().isolated().size() == 1);
    CHECK(worlds.clear(0) == n - 2);
    CHECK(worlds.solver().isolated().empty());
    worlds.add(0, points, h * h / 4);
    worlds.reset(0, start);
    CHECK(worlds.save(0).materials[0].offsets == start.materials[0].offsets);
    CHECK(worlds.size() == 2 * n - 1);

    Worlds<InPlane> lone(1, lattice(h)); // its only particle is lost, and others of other mass may come
    lone.quarantine(1);
    lone.add(0, std::vector{points[0]}, h * h / 4);
    auto const alone = lone.save(0);
    turn_inside_out(lone, {0});
    lone.step(dt);
    REQUIRE(lone.size() == 0);
    lone.reset(0, alone);
    CHECK(lone.positions() == std::vector{points[0]});
    CHECK(lone.ids() == std::vector<std::uint32_t>{0});
    lone.step(dt, Gravity{});
    CHECK(lone.download<Velocity>()[0].y() == Approx(-9.81 * dt));
}

TEST_CASE("worlds that are moved in their own callback, or assigned to, stay as they are",
          "[physics][worlds][refusal]")
{
    auto const points = block<2>(0.1);
    Worlds<InPlane> worlds(2, lattice(h)), other(9, lattice(h)), twin(2, lattice(h));
    for (auto* const of : {&worlds, &twin})
        for (std::uint32_t w = 0; w < 2; ++w) of->add(w, points, h * h / 4, {double(w), -1});
    int refusals = 0;
    Budget const budget{.progress = [&](Progress const&) {
        refused([&] { worlds = std::move(other); });
        refused([&] { other = std::move(worlds); });
        refused([&] { Worlds<InPlane> const gone(std::move(worlds)); });
        ++refusals;
    }};
    worlds.advance(0.02, budget, Gravity{}, ground);
    twin.advance(0.02, Gravity{}, ground);
    CHECK(refusals > 1);
    CHECK(other.count() == 9);
    CHECK(same(worlds.solver(), 0, twin.solver(), 0, 2 * points.size()));
    CHECK(worlds.world_of_particles() == twin.world_of_particles());
    other = std::move(worlds);
    CHECK(other.count() == 2);
    other.advance(1e-3, Gravity{}, ground);
}

TEST_CASE("contact points of many worlds say in which world they lie, and which of its obstacles was touched",
          "[physics][worlds][surface]")
{
    using AtSurface = Obstacles<AnyShape<>, ActsOn::surface>;
    std::uint32_t const count = 3;
    auto const points = block<2>(0.2);
    Obstacle<AnyShape<>> const board{.shape = Box{{0.5, 0.1, 1}}, .motion = {.position = {0.1, -0.1, 0}}},
        away{.shape = Sphere{0.1}, .motion = {.position = {0.1, 0.8, 0}}};
    // nothing falls in world 1
    std::vector<AtSurface> const of_worlds{{{board, away}}, {{board}}, {{away, away, board}}};
    auto const speed = [](std::uint32_t w) { return Vector<double, 2>(0, -1 - 0.5 * w); };
    auto const check = [&](auto const& worlds, std::vector<AtSurface> const& around) {
        auto const last = contact_points(worlds);
        CHECK(std::abs(last.dt - dt) < 1e-12 * dt);
        CHECK(contact_points(worlds.solver()).points.size() == last.points.size());
        std::size_t expected_points = 0;
        for (std::uint32_t w = 0; w < count; ++w) {
            CAPTURE(w);
            InPlane alone(lattice(h));
            if (w != 1) alone.add(points, h * h / 4, speed(w));
            alone.steps(20, dt, around[w]);
            for (auto const& expected : contact_points(alone).points) {
                CHECK(expected.world == 0);
                auto const is_same = [&](auto const& point) {
                    return point.world == w && point.obstacle == expected.obstacle &&
                           (point.position - expected.position).norm() < 1e-12 &&
                           (point.normal - expected.normal).norm() < 1e-12 &&
                           (point.impulse - expected.impulse).norm() < 1e-9 * expected.impulse.norm();
                };
                CHECK(std::ranges::count_if(last.points, is_same) == 1);
                ++expected_points;
            }
        }
        CHECK(last.points.size() == expected_points);
        CHECK(expected_points >= 2 * 4);
    };
    SECTION("of obstacles of their own")
    {
        Worlds<InPlane, AnyShape<>, ActsOn::surface> worlds(count, lattice(h));
        for (std::uint32_t w = 0; w < count; ++w) {
            if (w != 1) worlds.add(w, points, h * h / 4, speed(w));
            worlds.obstacles(w) = of_worlds[w].list;
        }
        CHECK(contact_points(worlds).points.empty());
        worlds.steps(20, dt);
        check(worlds, of_worlds);
    }
    SECTION("of a list that is in all of them")
    {
        Worlds<InPlane> worlds(count, lattice(h));
        for (std::uint32_t w = 0; w < count; ++w)
            if (w != 1) worlds.add(w, points, h * h / 4, speed(w));
        AtSurface const everywhere{{away, board}};
        worlds.steps(20, dt, everywhere);
        check(worlds, std::vector<AtSurface>(count, everywhere));
    }
    SECTION("of both, where their own follow the others")
    {
        Worlds<InPlane, AnyShape<>, ActsOn::surface> worlds(count, lattice(h));
        AtSurface const everywhere{{away, {.shape = HalfSpace{{1, 0, 0}}}}};
        std::vector<AtSurface> all(count, everywhere);
        for (std::uint32_t w = 0; w < count; ++w) {
            if (w != 1) worlds.add(w, points, h * h / 4, speed(w));
            worlds.obstacles(w) = of_worlds[w].list;
            all[w].list.insert(all[w].list.end(), of_worlds[w].list.begin(), of_worlds[w].list.end());
        }
        worlds.steps(20, dt, everywhere);
        check(worlds, all);
    }
}

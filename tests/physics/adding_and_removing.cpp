// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/core/host_arrays.hpp>

#include <numeric>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// What is faster than that.
struct Faster
{
    double speed;

    template <class Position, class Particle>
    FIRN_HOST_DEVICE bool operator()(Position const&, Particle const& particle) const
    {
        return double(particle[Velocity{}].norm()) > speed;
    }
};

struct NoParticle
{
    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const&) const
    {
        return false;
    }
};

/// All that there is of each particle, with its id.
template <class Solver>
auto everything(Solver const& solver)
{
    auto const ids = solver.ids();
    auto const x = solver.positions();
    auto const v = solver.template download<Velocity>();
    auto const H = solver.template download<DisplacementGradient>();
    auto const m = solver.masses();
    std::vector<std::tuple<std::uint32_t, typename decltype(x)::value_type, typename decltype(v)::value_type,
                           typename decltype(H)::value_type, double>>
        all;
    for (std::size_t i = 0; i < ids.size(); ++i) all.emplace_back(ids[i], x[i], v[i], H[i], m[i]);
    return all;
}

} // namespace

using Cases = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                           Scene<CamClay<SolidFloat>, CubicBSpline, Flip>,
                           More<Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Apic>,
                                Scene<Sand<PlaneFloat>, CubicBSpline, Asflip>>>;

TEMPLATE_LIST_TEST_CASE(
    "a particle that stays when others are removed keeps its id and, bit by bit, all it has", "", Cases)
{
    constexpr int d = TestType::d;
    double const h = 0.05;
    typename TestType::Solver solver(lattice(h));
    Vector<double, d> const low = Vector<double, d>::Constant(0.011);
    Vector<double, d> v = Vector<double, d>::Constant(0.7), above = Vector<double, d>::Zero();
    above[1] = 0.3;
    auto const box = box_of_points<d>(low, low + Vector<double, d>::Constant(0.3), h);
    auto other = box;
    for (auto& x : other) x += above;
    solver.add(box, std::pow(h / 2, d), v);
    solver.add(other, 2 * std::pow(h / 2, d), -v); // of another mass
    Obstacle<HalfSpace> const floor{};
    std::size_t removed = 0, left = solver.size();
    double plane = 0.1;
    for (int round = 0; round < 4; ++round, plane += 0.04) {
        auto expected = everything(solver);
        std::erase_if(expected, [&](auto const& particle) { return std::get<1>(particle)[0] < plane; });
        std::size_t const count = solver.remove_if(OnTheLeft{plane});
        CHECK(count > 0);
        removed += count;
        left -= count;
        CHECK(left > 0);
        CHECK(solver.size() == left);
        CHECK((everything(solver) == expected)); // not to be printed
        for (int i = 0; i < 5; ++i) solver.step(1e-4, Gravity{}, floor);
        solver.advance(1e-3, Gravity{}, floor);
        CHECK(solver.size() == left);
    }
    CHECK(removed + left == 2 * box.size());
    auto const before = everything(solver);
    CHECK(solver.remove_if(NoParticle{}) == 0);
    CHECK((everything(solver) == before));
    CHECK(solver.remove_if(Outside<Sphere>{.shape = {1e-6}, .pose = {.position = {0, -9, 0}}}) == left);
    CHECK(solver.size() == 0);
    CHECK(solver.positions().empty());
    solver.step(1e-4, Gravity{}, floor); // and it still runs
    CHECK(solver.add(box, std::pow(h / 2, d), v) == 2 * box.size());
    for (int i = 0; i < 50; ++i) solver.step(1e-4);
    auto const x = solver.positions();
    REQUIRE(x.size() == box.size());
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - box[i] - 5e-3 * v).norm());
    CHECK(worst <= (TestType::is_float ? 1e-7 : 1e-13));
}

TEST_CASE("particles are added at points in any of Eigen's vectors")
{
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    std::vector<double> numbers{0.1, 0.2, 0.3, 0.4};
    solver.add(
        std::vector{Eigen::Map<Eigen::Vector2d>(&numbers[0]), Eigen::Map<Eigen::Vector2d>(&numbers[2])},
        1e-3);
    solver.add(std::vector<Eigen::RowVector2d>{{0.5, 0.6}}, 1e-3);
    solver.add(std::vector<Eigen::Array2f>{{0.25f, 0.75f}}, 1e-3);
    solver.add(std::vector<Eigen::Matrix<double, 2, 1, Eigen::DontAlign>>{{0.7, 0.8}}, 1e-3);
    struct Corn // a host's own
    {
        int kind;
        float x, y, size;
    };
    std::vector<Corn> const corns{{1, 0.125f, 0.5f, 9}, {2, 0.75f, 0.25f, 8}};
    solver.add(points_of<2>(&corns[0].x, corns.size(), sizeof(Corn) / sizeof(float)), 1e-3);
    solver.add(points_of<2>(numbers.data(), 1), 1e-3);
    std::vector<Vector<double, 2>> const expected{{0.1, 0.2}, {0.3, 0.4},   {0.5, 0.6},   {0.25, 0.75},
                                                  {0.7, 0.8}, {0.125, 0.5}, {0.75, 0.25}, {0.1, 0.2}};
    auto const x = solver.positions();
    REQUIRE(x.size() == expected.size());
    for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i] - expected[i]).norm() <= 1e-14);
    refused([&] { (void)points_of<2>(numbers.data(), 2, 1); });
    refused([] { (void)points_of<2>(static_cast<double const*>(nullptr), 1); });
    CHECK(solver.add(points_of<2>(static_cast<double const*>(nullptr), 0), 1e-3) == expected.size());
}

TEST_CASE("particles are added with a volume each, and their masses, momentum and impulses are those of it")
{
    using Solver = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.05, density = 1000;
    auto const box = box_of_points<2>({0, 0}, {0.3, 0.3}, h);
    std::vector<float> volumes; // a host's, some equal to those before them
    for (std::size_t i = 0; i < box.size(); ++i)
        volumes.push_back(float((1 + double(i / 3 % 5)) * h * h / 12));
    Solver solver(lattice(h));
    std::vector<double> expected;
    double momentum = 0;
    auto const add = [&](auto const& given, double speed) {
        auto points = box;
        for (auto& x : points) x[0] += 0.4 * double(expected.size() / box.size());
        solver.add(points, given, {speed, 0});
        for (std::size_t i = 0; i < box.size(); ++i) {
            if constexpr (std::is_same_v<decltype(given), double const&>)
                expected.push_back(density * given);
            else
                expected.push_back(density * double(given[i]));
            momentum += expected.back() * speed;
        }
    };
    auto const check = [&] {
        auto const m = solver.masses();
        REQUIRE(m.size() == expected.size());
        for (std::size_t i = 0; i < m.size(); ++i) REQUIRE(m[i] == Approx(expected[i]).epsilon(1e-14));
    };
    add(h * h / 4, 0.5);
    add(volumes, -0.25);
    add(h * h / 4, 0.125);
    add(volumes, 0.0);
    auto all_different = std::vector<double>(volumes.begin(), volumes.end());
    for (std::size_t i = 0; i < all_different.size(); ++i) all_different[i] *= 1 + 1e-3 * double(i);
    add(all_different, 0.5);
    check();
    auto const report = solver.advance(0.01, Gravity{{0, -2, 0}});
    double mass = 0;
    for (double const one : expected) mass += one;
    CHECK(solver.totals().mass == Approx(mass).epsilon(1e-14));
    CHECK(solver.totals().momentum.x() == Approx(momentum).epsilon(1e-12));
    CHECK(solver.totals().momentum.y() == Approx(-2 * mass * report.time_of_forces).epsilon(1e-12));
    // masses stay with their particles
    auto const x = solver.positions();
    solver.remove_if(OnTheLeft{0.5});
    std::vector<double> left;
    for (std::size_t i = 0; i < x.size(); ++i)
        if (!(x[i][0] < 0.5)) left.push_back(expected[i]);
    expected = left;
    check();
    // a list of equal volumes is one volume, bit by bit
    Solver one(lattice(h)), each(lattice(h));
    one.add(box, 1e-3, {1, 0});
    each.add(box, std::vector<double>(box.size(), 1e-3), {1, 0});
    Obstacle<HalfSpace> const wall{.shape = {{-1, 0, 0}}, .motion = {.position = {0.31, 0, 0}}};
    one.advance(0.02, wall);
    each.advance(0.02, wall);
    CHECK((one.positions() == each.positions()));
    CHECK(one.memory() == each.memory());
}

TEST_CASE("particles with densities of their own are those of a model that has them")
{
    using Solver = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.05, volume = h * h / 4;
    auto const box = box_of_points<2>({0, 0.01}, {0.3, 0.31}, h);
    Obstacle<HalfSpace> const floor{};
    auto const fallen = [&](Solver solver) {
        for (int i = 0; i < 100; ++i) solver.step(1e-4, Gravity{}, floor);
        return solver;
    };
    NeoHookean<Plane> heavy;
    heavy.density = 2500;
    Solver of_model(lattice(h), heavy), own(lattice(h)), light(lattice(h));
    of_model.add(box, volume, {0, -3});
    own.add(box, Volumes(volume, std::vector<float>(box.size(), 2500)), {0, -3});
    light.add(box, volume, {0, -3});
    CHECK(own.totals().mass == Approx(2500 * 0.09).epsilon(1e-12));
    CHECK(own.stable_step() == light.stable_step()); // by the model's
    auto const of_model_after = fallen(std::move(of_model));
    auto const own_after = fallen(std::move(own)), light_after = fallen(std::move(light));
    double worst = 0, apart = 0;
    auto const x = of_model_after.positions(), y = own_after.positions(), z = light_after.positions();
    for (std::size_t i = 0; i < x.size(); ++i) {
        worst = std::max(worst, (x[i] - y[i]).norm());
        apart = std::max(apart, (z[i] - y[i]).norm());
    }
    CHECK(worst <= 1e-13);
    CHECK(apart > 1e-4);
    CHECK(own_after.energy().elastic == Approx(of_model_after.energy().elastic).epsilon(1e-9));
    // volumes and densities one by one: mass is their product
    Solver each(lattice(h));
    each.add(std::vector<Eigen::Vector2d>{{0, 0}, {1, 0}, {2, 0}},
             Volumes(std::vector<double>{1e-3, 2e-3, 1e-3}, std::array<double, 3>{2000, 1000, 1000}));
    auto const m = each.masses();
    CHECK(m[0] == Approx(2));
    CHECK(m[1] == Approx(2));
    CHECK(m[2] == Approx(1));
}

TEST_CASE("to remove no particle changes not a bit of what follows")
{
    using Solver = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
    auto const run = [](bool asks) {
        Solver solver(lattice(0.05));
        solver.add(box_of_points<2>({0, 0.01}, {0.3, 0.3}, 0.05), 0.025 * 0.025, {1, -3});
        for (int i = 0; i < 60; ++i) {
            if (asks) CHECK(solver.remove_if(OnTheLeft{-10}) == 0);
            solver.step(1e-4, Gravity{}, Obstacle<HalfSpace>{});
        }
        return everything(solver);
    };
    CHECK((run(true) == run(false)));
}

TEMPLATE_LIST_TEST_CASE("a body flies on as if one far away had never been there, once that is removed", "",
                        Cases)
{
    constexpr int d = TestType::d;
    double const h = 0.05;
    auto const run = [&](bool with_other) {
        typename TestType::Solver solver(lattice(h));
        auto const ball = ball_of_points<d>(Vector<double, d>::Constant(0.213), 0.2, h);
        Vector<double, d> v = Vector<double, d>::Zero();
        v[1] = -3;
        if (with_other) {
            auto other = ball;
            for (auto& x : other) x[0] -= 5;
            solver.add(other, std::pow(h / 2, d), v);
        }
        solver.add(ball, std::pow(h / 2, d), v);
        Obstacle<HalfSpace> const floor{.contact = Contact::slip()};
        for (int i = 0; i < 60; ++i) {
            if (i == 30) {
                if (with_other)
                    CHECK(solver.remove_if(OnTheLeft{-2}) == ball.size());
                else // scatters afresh, too
                    solver.template upload<Velocity>(solver.template download<Velocity>());
            }
            solver.step(2e-4, Gravity{}, floor);
        }
        CHECK(solver.ids()[0] == (with_other ? ball.size() : 0));
        return std::pair{solver.positions(), solver.template download<Velocity>()};
    };
    auto const [x, v] = run(true);
    auto const [y, w] = run(false);
    REQUIRE(x.size() == y.size());
    double worst = 0, faster = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        worst = std::max(worst, (x[i] - y[i]).norm());
        faster = std::max(faster, double((v[i] - w[i]).norm()));
    }
    CHECK(worst <= (TestType::is_float ? 1e-6 : 1e-13));
    CHECK(faster <= (TestType::is_float ? 1e-3 : 1e-10));
}

TEST_CASE("a body moves by the same bits in whatever order blocks of cells were created before it came")
{
    using Case = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>;
    double const h = 0.05, block = 4 * h;
    auto const run = [&](bool backwards) {
        Case::Solver solver(lattice(h));
        auto places = box_of_points<3>({-0.5 * block, -0.5 * block, -0.5 * block},
                                       {3 * block, 3 * block, 3 * block}, 2 * block); // one in each block
        if (backwards) std::ranges::reverse(places);
        for (auto const& place : places) solver.add(std::vector{place}, 1e-6);
        CHECK(solver.remove_if(Inside<HalfSpace>{.pose = {.position = {0, 9, 0}}}) == places.size());
        auto const body = scattered<3>(ball_of_points<3>({0.213, 0.213, 0.213}, 0.2, h), 0.012);
        solver.add(body, std::pow(h / 2, 3), {12, -7, 9});
        Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.3)};
        auto const report = solver.steps(sample_of(40, 100), 2e-4, floor).back();
        return std::tuple{solver.positions(), solver.template download<Velocity>(), solver.energy().total(),
                          report.reactions[0].impulse, report.reactions[0].angular_impulse};
    };
    CHECK((run(true) == run(false))); // not to be printed
}

TEMPLATE_LIST_TEST_CASE("a removed particle bounds no step any more", "", Cases)
{
    constexpr int d = TestType::d;
    double const h = 0.05;
    auto const make = [&] {
        typename TestType::Solver solver(lattice(h));
        solver.add(ball_of_points<d>(Vector<double, d>::Constant(0.213), 0.2, h), std::pow(h / 2, d));
        return solver;
    };
    auto solver = make(), untouched = make();
    Vector<double, d> v = Vector<double, d>::Zero();
    v[0] = -1e15;
    Vector<double, d> far = Vector<double, d>::Constant(5);
    far[0] = -5;
    solver.add(std::vector<Vector<double, d>>{far}, std::pow(h / 2, d), v);
    Obstacle<HalfSpace> const floor{};
    CHECK_THROWS_WITH(solver.advance(0.01, Gravity{}, floor), Contains("bounded by advection"));
    CHECK(solver.remove_if(OnTheLeft{-2}) == 1);
    CHECK(solver.bounds().speed == 0);
    auto const here = solver.advance(0.01, Gravity{}, floor),
               there = untouched.advance(0.01, Gravity{}, floor);
    CHECK(here.substeps == there.substeps);
    CHECK(here.smallest_dt == there.smallest_dt);
}

TEST_CASE("particles are removed by what they are as well as by where they are")
{
    using Solver =
        Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver; // velocities are gathered on demand
    Solver solver(lattice(0.1));
    auto const box = box_of_points<2>({0.01, 0}, {0.2, 0.2}, 0.1);
    auto far = box;
    for (auto& x : far) x[0] += 3;
    solver.add(box, 2.5e-3, {0, 1});
    solver.add(far, 2.5e-3, {0, 0.1});
    for (int i = 0; i < 5; ++i) solver.step(1e-3);
    CHECK(solver.remove_if(Faster{2}) == 0);
    CHECK(solver.remove_if(Faster{0.5}) == box.size());
    CHECK(solver.ids().front() == box.size());
    for (int i = 0; i < 5; ++i) solver.step(1e-3);
    for (auto const& v : solver.download<Velocity>()) CHECK((v - Eigen::Vector2d(0, 0.1)).norm() < 1e-12);
}

using Flows = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                           More<Scene<Snow<Solid>, CubicBSpline, Flip>>>;

TEMPLATE_LIST_TEST_CASE(
    "what is emitted layer by layer and drained again is, at any time, what has come in and "
    "not yet gone out",
    "", Flows)
{
    constexpr int d = TestType::d;
    using Solver = typename TestType::Solver;
    double const h = 0.05, speed = 2, spacing = h / 2, drain = 0.4;
    typename Solver::Model soft;
    soft.elasticity = lame(1e3, 0.3);
    Solver solver(lattice(h), soft);
    Vector<double, d> high = Vector<double, d>::Constant(0.2), v = Vector<double, d>::Zero();
    high[0] = spacing;
    v[0] = speed;
    auto const layer = box_of_points<d>(Vector<double, d>::Zero(), high, h);
    double const period =
        spacing / speed; // a layer has then moved by the distance between layers: no overlap
    Obstacle<Box> const nowhere{.shape = {{1, 1, 1}}, .motion = {.position = {0, 50, 0}}};
    Inside<HalfSpace> const sink{.shape = {{-1, 0, 0}},
                                 .pose = {.position = {drain, 0, 0}}}; // where x > drain
    std::size_t layers = 0, gone = 0, most_memory = 0;
    double inside = 0;
    for (int i = 0; i < 80; ++i) {
        CHECK(solver.add(layer, std::pow(spacing, d), v) == layers * layer.size());
        ++layers;
        solver.advance(period, nowhere);
        gone += solver.remove_if(sink);
        inside = double(layers * layer.size() - gone);
        REQUIRE(solver.size() == layers * layer.size() - gone);
        Totals const now(solver);
        CHECK(now.mass == Approx(inside * double(soft.density) * std::pow(spacing, d)).epsilon(1e-12));
        CHECK((now.momentum - now.mass * v).norm() <= 1e-10 * now.mass * speed);
        if (i == 30) most_memory = solver.memory();
    }
    // the k-th layer came at k periods; all of those move as one body
    auto const ids = solver.ids();
    auto const x = solver.positions();
    double worst = 0;
    for (std::size_t i = 0; i < ids.size(); ++i) {
        auto const k = ids[i] / layer.size();
        Vector<double, d> const expected =
            layer[ids[i] % layer.size()] + v * (solver.time() - double(k) * period);
        worst = std::max(worst, (x[i] - expected).norm());
    }
    CHECK(worst <= 1e-11);
    // half a spacing and 15 more are short of the drain, 16 are beyond it
    CHECK(solver.size() == 15 * layer.size());
    CHECK(ids.front() == 65 * layer.size());
    CHECK(solver.memory() <= most_memory + most_memory / 10); // nothing piles up
}

TEST_CASE("where particles were removed rows follow one another, and what is looked at is what is downloaded")
{
    using Solver = Scene<Snow<SolidFloat>, QuadraticBSpline, Mls>::Solver;
    Solver solver(lattice(0.1));
    solver.add(box_of_points<3>({0.01, 0, 0}, {0.41, 0.2, 0.2}, 0.1), 1.25e-4, {0, 1, 0});
    std::vector<float> J(solver.size());
    std::iota(J.begin(), J.end(), 1.0f);
    for (auto& value : J) value = 1 - 1e-4f * value;
    solver.upload<PlasticVolumeRatio>(J);
    solver.step(1e-4);
    CHECK(solver.remove_if(OnTheLeft{0.2}) == 64);
    auto const ids = solver.ids();
    auto const values = solver.download<PlasticVolumeRatio>();
    auto const view = solver.view<PlasticVolumeRatio>();
    REQUIRE(view.count == 64);
    for (std::size_t row = 0; row < ids.size(); ++row) CHECK(values[row] == J[ids[row]]);
    typename TestedBackend::Array<float> buffer{TestedBackend{}};
    buffer.resize(3 * solver.size());
    solver.write_positions(buffer.data());
    decltype(solver)(lattice(0.1)).write_positions(nullptr); // no particles to write
    std::vector<float> written(buffer.size());
    buffer.download(0, written);
    auto const x = solver.positions();
    for (std::size_t row = 0; row < ids.size(); ++row)
        CHECK((Eigen::Map<Eigen::Vector3f>(&written[3 * row]) == x[row].cast<float>()));
    std::size_t const stride = 5; // three for a velocity, and what is not theirs
    buffer.resize(stride * solver.size());
    auto const have = [&](auto const& values) {
        written.resize(buffer.size());
        buffer.download(0, written);
        for (std::size_t row = 0; row < ids.size(); ++row) {
            auto const* const value = reinterpret_cast<float const*>(&values[row]);
            int const count = sizeof values[row] / sizeof(float);
            for (int c = 0; c < count; ++c) CHECK(written[stride * row + c] == value[c]);
            CHECK(written[stride * row + 4] == -1);
        }
    };
    buffer.fill(0, buffer.size(), -1);
    solver.write<PlasticVolumeRatio>(buffer.data(), stride); // is stored
    have(values);
    solver.step(1e-4);
    solver.write<Velocity>(buffer.data(), stride); // is gathered from the grid
    have(solver.download<Velocity>());
    solver.upload<Velocity>(std::vector<Eigen::Vector3f>(64, {1, 2, 3}));
    solver.write<Velocity>(buffer.data(), stride); // is held
    have(std::vector<Eigen::Vector3f>(64, {1, 2, 3}));
    CHECK_THROWS_AS(solver.write<Velocity>(buffer.data(), 2), Error);
    CHECK_THROWS_AS(solver.write<Velocity>(nullptr), Error);
#if !defined(__CUDACC__)
    for (std::size_t i = 0; i < view.count; ++i) CHECK(view.component[0][i] == values[view.row[i]]);
#endif
}

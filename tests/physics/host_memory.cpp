// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/host_copies.hpp>
#include <firn/id_lookup.hpp>
#include <firn/io/frame_series.hpp>

#include <array>
#include <cstring>
#include <span>

using namespace firn;
using namespace firn::test;

namespace
{

/// Vectors of a host, which know nothing of Eigen.
struct HostPoint
{
    double x, y;
};
struct HostVector
{
    float x, y, z;
};
struct Padded
{
    float x, y, z, w;
};
struct OutOfOrder
{
    float y, x, z;
};
struct WithAnId
{
    float x, y;
    int id;
};
struct Unlike
{
    float x;
    int y;
    float z;
};

using PlaneSolver = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using SnowSolver = Scene<Snow<SolidFloat>, QuadraticBSpline, Mls>::Solver;

/// The numbers of Eigen's values, one after the other and row by row.
template <class Values>
std::vector<double> numbers_in(Values const& values)
{
    std::vector<double> numbers;
    for (auto const& value : values) {
        if constexpr (requires { value.rows(); }) {
            for (int i = 0; i < value.rows(); ++i)
                for (int j = 0; j < value.cols(); ++j) numbers.push_back(double(value(i, j)));
        }
        else
            numbers.push_back(double(value));
    }
    return numbers;
}

} // namespace

TEST_CASE("a host's value is known by its members, and one with padding or other numbers is none")
{
    STATIC_REQUIRE(HostValue<HostPoint, 2>);
    STATIC_REQUIRE(HostValue<HostVector, 3>);
    STATIC_REQUIRE(HostValue<float, 1>);
    STATIC_REQUIRE(HostValue<std::array<double, 3>, 3>);
    STATIC_REQUIRE(HostValue<std::array<std::array<float, 3>, 3>, 9>);
    STATIC_REQUIRE(!HostValue<HostPoint, 3>);
    STATIC_REQUIRE(!HostValue<Padded, 3>);
    STATIC_REQUIRE(!HostValue<Unlike, 3>);
    STATIC_REQUIRE(!HostValue<OutOfOrder, 3>);
    STATIC_REQUIRE(!HostValue<WithAnId, 3>);
    STATIC_REQUIRE(!HostValue<std::array<int, 3>, 3>);
    STATIC_REQUIRE(!HostValue<std::span<double>, 2>); // two words, but not two numbers
    STATIC_REQUIRE(!HostValue<Eigen::Vector2d, 2>);
    STATIC_REQUIRE(HostArray<std::span<HostVector const>, 3>);
    STATIC_REQUIRE(HostArray<std::vector<double>&, 1>);
    STATIC_REQUIRE(!HostArray<std::vector<Padded>, 3>);
}

TEST_CASE("a host's own vectors go in and come out, and are what Eigen's would be, bit by bit")
{
    std::vector<HostPoint> const points{{0.125, 0.25}, {0.5, 0.3}, {0.7, 0.8}};
    std::vector<Eigen::Vector2d> same;
    for (auto const& p : points) same.emplace_back(p.x, p.y);
    PlaneSolver solver(lattice(0.1)), by_eigen(lattice(0.1));
    CHECK(solver.add(points, 1e-3) == 0);
    CHECK(solver.add(std::span(points).first(2), 1e-3, {1, 2}) == 3);
    by_eigen.add(same, 1e-3);
    by_eigen.add(std::vector(same.begin(), same.begin() + 2), 1e-3, {1, 2});
    CHECK(solver.positions() == by_eigen.positions());
    std::vector<HostPoint> const velocities{{1, 2}, {3, 4}, {5, 6}, {7, 8}, {9, 10}};
    upload<Velocity>(solver, velocities);
    by_eigen.upload<Velocity>({{1, 2}, {3, 4}, {5, 6}, {7, 8}, {9, 10}});
    for (auto* const each : {&solver, &by_eigen})
        for (int i = 0; i < 3; ++i) each->step(1e-4, Gravity{});
    auto const x = by_eigen.positions();
    auto const v = by_eigen.download<Velocity>();
    std::vector<HostPoint> positions(5), now(5);
    download_positions(solver, positions);
    download<Velocity>(solver, std::span(now));
    for (std::size_t i = 0; i < 5; ++i) {
        CHECK((positions[i].x == x[i][0] && positions[i].y == x[i][1]));
        CHECK((now[i].x == v[i][0] && now[i].y == v[i][1]));
    }
    auto const samples = solver.sample(points);
    auto const by_eigens = by_eigen.sample(same);
    for (std::size_t i = 0; i < samples.size(); ++i) CHECK(samples[i].density == by_eigens[i].density);
}

TEST_CASE("what is downloaded to a host's memory has its stride and its numbers, whatever the scene's are")
{
    SnowSolver solver(lattice(0.1));
    solver.add(box_of_points<3>({0, 0, 0}, {0.2, 0.2, 0.2}, 0.1), 1.25e-4, {0, 1, 0});
    std::size_t const count = solver.size();
    std::vector<double> ratios(count);
    for (std::size_t i = 0; i < count; ++i) ratios[i] = 1 - 1e-3 * double(i);
    upload<PlasticVolumeRatio>(solver, ratios); // of doubles, to floats
    auto const expected = solver.download<PlasticVolumeRatio>();
    for (std::size_t i = 0; i < count; ++i) CHECK(expected[i] == float(ratios[i]));
    solver.step(1e-4);
    auto const check = [&]<class Number>(Number, std::size_t stride, std::vector<double> const& numbers,
                                         std::size_t components, auto const& write) {
        std::vector<Number> to(count * stride, Number(-7));
        write(to.data());
        for (std::size_t i = 0; i < count; ++i)
            for (std::size_t c = 0; c < stride; ++c)
                CHECK(to[i * stride + c] ==
                      (c < components ? Number(numbers[i * components + c]) : Number(-7)));
    };
    auto const x = numbers_in(solver.positions()), v = numbers_in(solver.download<Velocity>()),
               H = numbers_in(solver.download<DisplacementGradient>()),
               pressure = numbers_in(solver.download<Pressure>());
    auto const frame = frame_of<Velocity, PlasticVolumeRatio, DisplacementGradient>(solver);
    CHECK(frame.time == solver.time());
    CHECK(frame.positions == solver.positions());
    REQUIRE(frame.fields.size() == 4);
    CHECK((frame.fields[0].name == "id" && frame.fields[0].integers == solver.ids()));
    CHECK((frame.fields[1].name == "velocity" && frame.fields[1].values[7] == float(v[7])));
    CHECK(firn::detail::name_in_ply(frame, frame.fields[1]) == "v");
    CHECK(firn::detail::name_in_ply(frame, frame.fields[0]) == "id");
    CHECK((frame.fields[2].components == 1 && frame.fields[3].components == 9));
    check(float{}, 5, x, 3, [&](float* to) { download_positions(solver, to, count, 5); });
    check(double{}, 3, x, 3, [&](double* to) { download_positions(solver, to, count); });
    check(double{}, 4, x, 3, [&](double* to) { download_positions(solver, to, count, 4); });
    check(float{}, 4, v, 3, [&](float* to) { download<Velocity>(solver, to, count, 4); });
    check(double{}, 9, H, 9, [&](double* to) { download<DisplacementGradient>(solver, to, count); });
    check(double{}, 1, pressure, 1, [&](double* to) { download<Pressure>(solver, std::span(to, count)); });
    std::vector<double> in_fours(4 * count);
    for (std::size_t i = 0; i < in_fours.size(); ++i) in_fours[i] = double(i);
    upload<Velocity>(solver, in_fours.data(), count, 4);
    CHECK(solver.download<Velocity>()[7] == Eigen::Vector3f(28, 29, 30));
    std::vector<HostVector> own(count);
    download<Velocity>(solver, own);
    CHECK(own[3].y == 13);
    std::vector<std::array<float, 9>> matrices(count);
    download<DisplacementGradient>(solver, matrices);
    CHECK(matrices[5][2] == float(H[5 * 9 + 2]));
}

TEST_CASE("values for those that were added leave all others their bits, whatever the host's numbers are")
{
    PlaneSolver solver(lattice(0.1));
    solver.add(std::vector<HostPoint>{{0.1, 0.1}, {0.2, 0.2}}, 1e-3);
    auto velocities = solver.download<Velocity>();
    for (auto& v : velocities) v = Vector<double, 2>(1.0 / 3, -1.0 / 7); // no floats
    solver.upload<Velocity>(velocities);
    auto const before = solver.download<Velocity>();
    std::uint32_t const first = solver.add(std::vector<HostPoint>{{0.3, 0.3}}, 1e-3);
    upload_from<Velocity>(solver, first, std::vector<std::array<float, 2>>{{0.5f, 0.25f}});
    auto const after = solver.download<Velocity>();
    CHECK(after[0] == before[0]);
    CHECK(after[1] == before[1]);
    CHECK(after[2] == Vector<double, 2>(0.5, 0.25));

    // where the first of them is gone, its value would go to another particle
    std::uint32_t const gone = solver.add(std::vector<HostPoint>{{0.5, 0.5}, {0.7, 0.7}}, 1e-3);
    CHECK(solver.remove_if(Inside<Box>{.shape = {{0.05, 9, 9}}, .pose = {.position = {0.5, 0, 0}}}) == 1);
    auto const left = solver.download<Velocity>();
    CHECK(refused([&] {
              upload_from<Velocity>(solver, gone, std::vector<std::array<float, 2>>{{1, 1}});
          }).what_is_wrong() == "there is no particle with the id " + std::to_string(gone));
    CHECK(solver.download<Velocity>() == left);
}

TEST_CASE("an array of a host that does not fit the particles is refused, and nothing has changed")
{
    PlaneSolver solver(lattice(0.1));
    std::vector<HostPoint> some{{0.1, 0.2}, {0.3, 0.4}};
    solver.add(some, 1e-3);
    std::vector<HostPoint> few(1);
    std::vector<double> numbers(4);
    CHECK_THAT(refused([&] { download_positions(solver, few); }).what_is_wrong(),
               Contains("room for 1 values"));
    refused([&] { download<Velocity>(solver, few); });
    refused([&] { upload<Velocity>(solver, few); });
    refused([&] { download_positions(solver, numbers.data(), 2, 1); });
    refused([&] { download<Velocity>(solver, numbers.data(), 2, 1); });
    refused([&] { download<Velocity>(solver, static_cast<double*>(nullptr), 2); });
    refused([&] { upload<Velocity>(solver, static_cast<double const*>(nullptr), 2); });
    few[0] = {std::nan(""), 0};
    refused([&] { solver.add(few, 1e-3); });
    some[1].y = std::numeric_limits<double>::infinity();
    refused([&] { upload<Velocity>(solver, some); });
    CHECK(solver.size() == 2);
    CHECK(solver.download<Velocity>() == std::vector<Eigen::Vector2d>(2, Eigen::Vector2d::Zero()));
    refused([] { (void)points_of<2>(static_cast<float const*>(nullptr), 1); });
}

TEST_CASE("a particle is found by its id, whatever came and went, and one that is gone is refused")
{
    PlaneSolver solver(lattice(0.1));
    IdLookup lookup;
    CHECK_FALSE(lookup.contains(solver, 0));
    CHECK_THAT(refused([&] { (void)lookup.index_of(solver, 0); }).what_is_wrong(), Contains("the id 0"));
    solver.add(box_of_points<2>({0.01, 0}, {1.01, 0.2}, 0.1), 2.5e-3);
    auto const all_are_found = [&] {
        auto const ids = solver.ids();
        auto const indices = lookup.indices_of(solver, ids);
        REQUIRE(indices.size() == ids.size());
        for (std::size_t i = 0; i < ids.size(); ++i) CHECK(indices[i] == i);
        std::size_t here = 0; // and no other is
        for (std::uint32_t id = 0; id < ids.back() + 100; ++id) here += lookup.contains(solver, id);
        CHECK(here == ids.size());
    };
    all_are_found();
    for (int i = 0; i < 3; ++i) solver.step(1e-4, Gravity{});
    all_are_found();
    auto const before = solver.snapshot();
    CHECK(solver.remove_if(OnTheLeft{0.3}) > 0);
    CHECK_THAT(refused([&] { (void)lookup.index_of(solver, 0); }).what_is_wrong(), Contains("the id 0"));
    all_are_found(); // from another one on, without gaps
    CHECK(solver.remove_if(Inside<Box>{.shape = {{0.1, 9, 9}}, .pose = {.position = {0.6, 0, 0}}}) > 0);
    all_are_found();
    auto const next = solver.add(std::vector<HostPoint>{{5, 5}}, 2.5e-3);
    CHECK(lookup.index_of(solver, next) == solver.size() - 1);
    all_are_found();
    solver.restore(before); // as many as at first, and the same ids
    all_are_found();
    CHECK(solver.remove_if(Inside<Box>{.shape = {{0.1, 9, 9}}, .pose = {.position = {0.2, 0, 0}}}) > 0);
    auto const here = solver.snapshot();
    std::size_t const left = solver.size();
    auto const of_here = solver.ids();
    solver.restore(before);
    CHECK(solver.remove_if(Inside<Box>{.shape = {{0.1, 9, 9}}, .pose = {.position = {0.5, 0, 0}}}) > 0);
    CHECK(solver.size() == left); // as many, and others
    CHECK(solver.ids() != of_here);
    all_are_found();
    solver.restore(here);
    all_are_found();
    PlaneSolver other(lattice(0.1)); // a look-up is of the solver that it is asked about
    other.add(std::vector<HostPoint>{{5, 5}}, 2.5e-3);
    CHECK(lookup.index_of(other, 0) == 0);
    CHECK_FALSE(lookup.contains(other, 1));
    all_are_found();
    solver.remove_if(Outside<Box>{.shape = {{0.06, 9, 9}}, .pose = {.position = {0.01, 0, 0}}});
    for (int i = 0; i < 7; ++i) { // ids that lie far apart
        auto const row = box_of_points<2>({9, 9}, {19, 9.05}, 0.1);
        solver.add(row, 2.5e-3);
        solver.add(std::vector<HostPoint>{{1.0 + i, 0.01}}, 2.5e-3);
        solver.remove_if(Inside<HalfSpace>{.shape = {{0, -1, 0}}, .pose = {.position = {0, 3, 0}}});
    }
    CHECK(solver.ids().back() > 16 * solver.size());
    all_are_found();
}

TEST_CASE("solvers of one backend that take turns come to the bits of each alone")
{
    TestedBackend const backend{}; // on a device: one stream for all of them
    auto const throw_plate = [&](double speed) {
        PlaneSolver solver(lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<2>({0.01, 0}, {0.41, 0.4}, 0.1), 2.5e-3, {speed, -1});
        return solver;
    };
    auto const throw_snow = [&] {
        SnowSolver solver(lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<3>({0.01, 0, 0}, {0.41, 0.2, 0.2}, 0.1), 1.25e-4, {3, -2, 1});
        return solver;
    };
    auto const once = [](auto& solver) { solver.step(2e-4, Gravity{}, Obstacle<HalfSpace>{}); };
    auto const alone = [&](auto solver) {
        for (int i = 0; i < 12; ++i) once(solver);
        return solver.positions();
    };
    auto const plate_alone = alone(throw_plate(1)), other_alone = alone(throw_plate(-2));
    auto const snow_alone = alone(throw_snow());
    auto plate = throw_plate(1), other = throw_plate(-2);
    auto snow = throw_snow();
    for (int i = 0; i < 12; ++i) {
        once(plate);
        auto passing = throw_plate(5); // comes and goes meanwhile
        once(snow);
        once(passing);
        once(other);
    }
    CHECK(plate.positions() == plate_alone);
    CHECK(other.positions() == other_alone);
    CHECK(snow.positions() == snow_alone);
    CHECK(plate_alone != other_alone);
}

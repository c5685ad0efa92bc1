// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/smoothed.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

// What particles carry, smoothed through the grid.
using namespace firn;
using namespace firn::test;

namespace
{

double const h = 0.05;
using Jelly = NeoHookean<Plane>;
using Water = Fluid<Plane>;
using OfJelly = Scene<Jelly, QuadraticBSpline, Mls>::Solver;
using OfBoth = Scene<Materials<Jelly, Water>, QuadraticBSpline, Mls>::Solver;

template <class Solver>
struct Filled
{
    static constexpr int d = Solver::d;
    Solver solver;
    std::vector<Vector<double, d>> points;

    explicit Filled(Lattice const& cells) : solver(cells)
    {
        Vector<double, d> const low = Vector<double, d>::Constant(0.3 * h),
                                high = Vector<double, d>::Constant(10.3 * h);
        points = box_of_points<d>(low, high, h);
        solver.add(points, std::pow(h / 2, d));
        auto const there = solver.positions();
        points.assign(there.begin(), there.end());
    }
    /// Whether the kernel of a particle, and those of the nodes that it reaches, lie in the material.
    bool is_inside(std::size_t i) const
    {
        double const reach = Solver::kernel::degree + 1;
        for (int a = 0; a < d; ++a)
            if (points[i][a] < (0.3 + reach) * h || points[i][a] > (10.3 - reach) * h) return false;
        return true;
    }
};

using Kinds =
    Combinations<Scene<Jelly, QuadraticBSpline, Mls>, Scene<Snow<SolidFloat>, QuadraticBSpline, Flip>,
                 More<Scene<Jelly, CubicBSpline, Apic>>>;

} // namespace

TEMPLATE_LIST_TEST_CASE("smoothing keeps constants, and linear fields inside", "[physics][smoothed]", Kinds)
{
    using Solver = typename TestType::Solver;
    constexpr int d = Solver::d;
    Filled<Solver> const block(lattice(h));
    double const tolerance = std::is_same_v<typename Solver::Number, float> ? 1e-5 : 1e-12;
    auto const constants = smoothed(block.solver, std::vector<float>(block.points.size(), 3));
    for (float const value : constants) CHECK(std::abs(value - 3) <= 1e-6f);
    auto const places = smoothed(block.solver, block.points);
    std::vector<Matrix<double, d>> matrices;
    for (auto const& x : block.points) matrices.push_back(x[0] * Matrix<double, d>::Identity());
    auto const smooth = smoothed(block.solver, matrices);
    std::size_t inside = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
        if (!block.is_inside(i)) continue;
        ++inside;
        CHECK((places[i] - block.points[i]).norm() <= tolerance * h);
        CHECK((smooth[i] - matrices[i]).norm() <= tolerance * h);
    }
    CHECK(inside > 10);
}

TEST_CASE("what alternates from particle to particle is gone, and at an edge nearly so",
          "[physics][smoothed]")
{
    Filled<OfJelly> const block(lattice(h));
    std::vector<double> alternating;
    for (auto const& x : block.points)
        alternating.push_back(std::lround((x.x() + x.y()) / (h / 2) - 0.5) % 2 == 0 ? 1 : -1);
    auto const smooth = smoothed(block.solver, alternating);
    for (std::size_t i = 0; i < smooth.size(); ++i) {
        CHECK(std::abs(smooth[i]) <= 0.12); // a node beyond the corner has one particle
        if (block.is_inside(i)) CHECK(std::abs(smooth[i]) <= 1e-12);
    }
}

TEST_CASE("the ends of a periodic lattice are smoothed as any other place", "[physics][smoothed]")
{
    int const cells = 16;
    OfJelly solver(lattice(h).periodic(0, cells));
    double const length = cells * h;
    solver.add(box_of_points<2>({0, 0}, {length, 4 * h}, h), h * h / 4);
    std::vector<double> waves;
    auto const places = solver.positions();
    for (auto const& x : places) waves.push_back(std::cos(2 * M_PI * x.x() / length));
    auto const smooth = smoothed(solver, waves);
    // all particles have the same share of the wave
    for (std::size_t i = 0; i < smooth.size(); ++i)
        CHECK(smooth[i] / waves[i] == Approx(smooth[0] / waves[0]).epsilon(1e-2));
    CHECK(smooth[0] / waves[0] == Approx(0.96).epsilon(0.01)); // (sin(pi / 16) / (pi / 16))^6
}

TEST_CASE("values of one material are smoothed among these, and those of all by volume",
          "[physics][smoothed]")
{
    OfBoth solver(lattice(h), {Jelly{}, Water{}});
    using Points = std::vector<Eigen::Vector2d>;
    Eigen::Vector2d const x(0.11, 0.23);
    solver.add<Water>(Points{x}, 3e-4);
    solver.add<Jelly>(Points{x, x}, 1e-4);
    solver.add<Water>(Points{x}, 3e-4);
    solver.upload<LogVolumeRatio, Water>({std::log(0.5), 0}); // the first has half its volume
    for (double const value : smoothed<Jelly>(solver, std::vector<double>{1, 3})) CHECK(value == Approx(2));
    for (double const value : smoothed<Water>(solver, std::vector<double>{1, 4})) CHECK(value == Approx(3));
    auto const all = smoothed(solver, std::vector<double>{11, 0, 22, 33});
    REQUIRE(all.size() == 4);
    for (double const value : all) CHECK(value == Approx((1.5 * 11 + 22 + 3 * 33) / 6.5));
    auto const pressures = smoothed(solver, solver.download<Pressure>());
    CHECK(pressures.size() == 4);
}

TEST_CASE("a solver without particles has nothing to smooth", "[physics][smoothed]")
{
    CHECK(smoothed(OfJelly(lattice(h)), std::vector<double>{}).empty());
    CHECK(smoothed(OfBoth(lattice(h), {Jelly{}, Water{}}), std::vector<Eigen::Vector2d>{}).empty());
}

TEST_CASE("values that are not those of the particles are not smoothed", "[physics][smoothed]")
{
    Filled<OfJelly> const block(lattice(h));
    auto const says = [&](auto const& values) {
        auto const error = refused([&] { smoothed(block.solver, values); });
        return error.where() + ": " + error.what_is_wrong();
    };
    std::size_t const count = block.points.size();
    CHECK(says(std::vector<double>(count - 1)) == "smoothed: there are " + std::to_string(count - 1) +
                                                      " values, and " + std::to_string(count) + " particles");
    std::vector<double> values(count);
    values[7] = std::numeric_limits<double>::quiet_NaN();
    CHECK(says(values) == "smoothed, value 7: the value is not finite");
    std::vector<Eigen::Vector2f> vectors(count, Eigen::Vector2f::Zero());
    vectors[3].y() = std::numeric_limits<float>::infinity();
    CHECK(says(vectors) == "smoothed, value 3: the value is not finite");
}

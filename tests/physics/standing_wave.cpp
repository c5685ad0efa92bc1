// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// Smooth walls at the ends of a bar of length 1 along x, or solids that stop the nodes inside them.
enum class Ends
{
    mirrored,
    stopped
};

/// The largest error of displacements during a period of the first mode of a bar between walls, over its
/// amplitude: u = v0 / omega sin(pi x) sin(omega t), omega = pi c, while it is small.
///
/// In the plane, two cells high between smooth walls, so that there are corners.
template <class SceneType>
double error_of_wave(int cells, Ends ends)
{
    double const h = 1.0 / cells, c = 10, speed = 1e-4, omega = M_PI * c; // [m], [m/s]
    typename SceneType::Model bar;
    bar.elasticity = lame<double>(100, 0);
    bar.density = 1;
    typename SceneType::Solver solver(lattice(h), bar);
    auto const points = box_of_points<2>({0, 0}, {1, 2 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<Vector<double, 2>> velocities;
    std::vector<Matrix<double, 2>> gradients(points.size(), Matrix<double, 2>::Zero());
    for (std::size_t i = 0; i < points.size(); ++i) {
        velocities.emplace_back(speed * std::sin(M_PI * points[i].x()), 0);
        gradients[i](0, 0) = speed * M_PI * std::cos(M_PI * points[i].x());
    }
    solver.template upload<Velocity>(velocities);
    solver.template upload<AffineVelocity>(gradients);

    ReflectingWall const below{.axis = 1}, above{.axis = 1, .node = 2, .side = -1};
    double worst = 0;
    int const steps = 10 * cells, pieces = 20; // of 0.2 h / c each
    for (int piece = 1; piece <= pieces; ++piece) {
        if (ends == Ends::mirrored)
            solver.steps(steps / pieces, 0.2 * h / c, below, above, ReflectingWall{.axis = 0},
                         ReflectingWall{.axis = 0, .node = cells, .side = -1});
        else
            solver.steps(steps / pieces, 0.2 * h / c, below, above,
                         Obstacle<HalfSpace>{.shape = {{1, 0, 0}}, .contact = Contact::bound_slip()},
                         Obstacle<HalfSpace>{.shape = {{-1, 0, 0}},
                                             .contact = Contact::bound_slip(),
                                             .motion = {.position = {1, 0, 0}}});
        auto const now = solver.positions();
        double square = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            double const exact =
                speed / omega * std::sin(M_PI * points[i].x()) * std::sin(omega * solver.time());
            square += std::pow(now[i].x() - points[i].x() - exact, 2) / double(points.size());
        }
        worst = std::max(worst, std::sqrt(square) * omega / speed);
    }
    return worst;
}

} // namespace

using Schemes = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                             Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>,
                             Scene<NeoHookean<Plane>, CubicBSpline, Mls>>;

TEMPLATE_LIST_TEST_CASE("a standing wave between reflecting walls converges with the square of the cell size",
                        "", Schemes)
{
    double const coarse = error_of_wave<TestType>(16, Ends::mirrored),
                 medium = error_of_wave<TestType>(32, Ends::mirrored),
                 fine = error_of_wave<TestType>(64, Ends::mirrored);
    CAPTURE(coarse, medium, fine);
    CHECK(std::log2(coarse / medium) >= 1.9);
    CHECK(std::log2(medium / fine) >= 1.95);
    CHECK(fine <= 2e-3);
}

// The control: it is the walls, and nothing else, that decides the order.
TEMPLATE_LIST_TEST_CASE("between solids that stop nodes it converges with the cell size only", "", Schemes)
{
    double const medium = error_of_wave<TestType>(32, Ends::stopped),
                 fine = error_of_wave<TestType>(64, Ends::stopped);
    CAPTURE(medium, fine);
    CHECK(std::log2(medium / fine) <= 1.2);
    CHECK(fine >= 2e-2);
}

namespace
{

/// The root mean square error of the pressure in a column of water at rest, over that at its foot, on a floor
/// between reflecting walls; and the height of its top [m].
template <class Floor>
std::pair<double, double> column_of_water(int cells, Floor const& floor)
{
    double const H = 1, h = H / cells, g = 9.81, modulus = 2e5, density = 1000;
    Fluid<Plane> water;
    water.bulk_modulus = modulus;
    water.parts = false;
    Scene<Fluid<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(h), water);
    auto const points = box_of_points<2>({0, 0}, {2 * h, H}, h);
    solver.add(points, h * h / 4);
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1};
    double const period = 4 * H / std::sqrt(modulus / density);
    solver.advance(12 * period, Gravity{}, Damping{1.4 * 2 * M_PI / period}, left, right, floor);
    auto const log_J = solver.download<LogVolumeRatio>();
    double square = 0, top = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        double const pressure = modulus / 7 * std::expm1(-7 * log_J[i]);
        square += std::pow(pressure / (density * g * H) - (1 - points[i].y()), 2) / double(points.size());
    }
    for (auto const& x : solver.positions()) top = std::max(top, x.y());
    return {std::sqrt(square), top + h / 4};
}

} // namespace

// The scene of "a column of water at rest has the pressure of its weight", whose floor stops nodes.
TEST_CASE("on a reflecting wall a column of water has the pressure of its weight down to its foot")
{
    auto const [error, top] = column_of_water(32, ReflectingWall{});
    CHECK(error <= 5e-3);
    CHECK(top == Approx(.97819601).margin(5e-6));
    auto const [stopped, lower] = column_of_water(32, Obstacle<HalfSpace>{.contact = Contact::bound_slip()});
    CHECK(stopped >= 2e-2);
}

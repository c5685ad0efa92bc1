// SPDX-License-Identifier: MIT
#include "problems/standing_wave.hpp"
#include "catch.hpp"
#include "support/one_element.hpp"

#include <tuple>

using namespace firn;
using namespace firn::test;

using Schemes = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                             More<Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>>,
                             Scene<NeoHookean<Plane>, CubicBSpline, Mls>>;

TEMPLATE_LIST_TEST_CASE("a standing wave between reflecting walls converges with the square of the cell size",
                        "", Schemes)
{
    double const coarse = error_of_standing_wave<TestType>(16, Ends::mirrored),
                 medium = error_of_standing_wave<TestType>(32, Ends::mirrored),
                 fine = error_of_standing_wave<TestType>(64, Ends::mirrored);
    CAPTURE(coarse, medium, fine);
    CHECK(std::log2(coarse / medium) >= 1.9);
    CHECK(std::log2(medium / fine) >= 1.95);
    CHECK(fine <= 2e-3);
}

// The control: it is the walls, and nothing else, that decides the order.
TEMPLATE_LIST_TEST_CASE("between solids that stop nodes it converges with the cell size only", "", Schemes)
{
    double const medium = error_of_standing_wave<TestType>(32, Ends::stopped),
                 fine = error_of_standing_wave<TestType>(64, Ends::stopped);
    CAPTURE(medium, fine);
    CHECK(std::log2(medium / fine) <= 1.2);
    CHECK(fine >= 2e-2);
}

namespace
{

/// What has become of a bar, fixed at one end and free at the other, after ten periods of its first mode.
struct Vibration
{
    double period; ///< that of the mode's velocity, relative to 4 L / c, less 1
    double energy; ///< kinetic and elastic, of that at the start
};

/// A bar of length 1 and two cells' height in its first mode, u = v0 / omega sin(pi x / 2) sin(omega t),
/// omega = pi c / 2, while it is small.
template <class SceneType>
Vibration vibrate(int cells, typename SceneType::Transfer const& transfer = {})
{
    double const h = 1.0 / cells, c = 10, speed = 0.01; // [m], [m/s]
    typename SceneType::Model bar;
    bar.elasticity = lame<double>(100, 0);
    bar.density = 1;
    typename SceneType::Solver solver(lattice(h), bar, transfer);
    auto const points = box_of_points<2>({0, 0}, {1, 2 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<Vector<double, 2>> velocities;
    std::vector<Matrix<double, 2>> gradients(points.size(), Matrix<double, 2>::Zero());
    for (std::size_t i = 0; i < points.size(); ++i) {
        velocities.emplace_back(speed * std::sin(M_PI / 2 * points[i].x()), 0);
        gradients[i](0, 0) = speed * M_PI / 2 * std::cos(M_PI / 2 * points[i].x());
    }
    solver.template upload<Velocity>(velocities);
    if constexpr (SceneType::Solver::State::template contains<AffineVelocity>)
        solver.template upload<AffineVelocity>(gradients);
    double const start = mechanical_energy(solver, h * h / 4);

    double const exact = 4 / c;
    int const per_period = 20 * ((2 * cells + 2) / 3); // of 0.3 h / c each, a multiple of the looks
    ReflectingWall const below{.axis = 1}, above{.axis = 1, .node = 2, .side = -1}, fixed{.axis = 0},
        far_away{.axis = 0, .node = 4 * cells, .side = -1};
    // Velocities belong to the middles of steps, so that they cross zero late, always by as much.
    double before = 1, first = 0, last = 0;
    for (int look = 1; look <= 200; ++look) {
        solver.steps(std::size_t(per_period / 20), exact / per_period, below, above, fixed, far_away);
        double mode = 0;
        auto const now = solver.template download<Velocity>();
        for (std::size_t i = 0; i < points.size(); ++i)
            mode += now[i].x() * std::sin(M_PI / 2 * points[i].x()) / double(points.size());
        if ((mode > 0) != (before > 0)) { // after 0.25 periods for the first time, after 9.75 for the last
            last = solver.time() - exact / 20 * mode / (mode - before);
            if (first == 0) first = last;
        }
        before = mode;
    }
    return {(last - first) / (9.5 * exact) - 1, mechanical_energy(solver, h * h / 4) / start};
}

/// What happens to a bar of length 1 that meets a smooth, rigid wall head-on.
struct Impact
{
    double stress;  ///< that on the wall while the wave runs to and fro, of rho c v
    double contact; ///< how long the wall is pressed, of 2 L / c
    double rebound; ///< the speed in the end, of that at the start
};

/// It touches the wall at the start: nodes of the wall are felt from afar, and a slow bar that came from
/// there would be slowed down over a cell.
template <class SceneType>
Impact hit_wall(int cells)
{
    double const h = 1.0 / cells, c = 10, speed = 0.01; // [m], [m/s]
    typename SceneType::Model bar;
    bar.elasticity = lame<double>(100, 0);
    bar.density = 1;
    typename SceneType::Solver solver(lattice(h), bar);
    solver.add(box_of_points<2>({0, 0}, {1, 2 * h}, h), h * h / 4, {-speed, 0});
    ReflectingWall const below{.axis = 1}, above{.axis = 1, .node = 2, .side = -1};
    Obstacle<HalfSpace> const wall{.shape = {{1, 0, 0}}, .contact = Contact::slip()},
        far_away{.shape = {{-1, 0, 0}}, .contact = Contact::slip(), .motion = {.position = {4, 0, 0}}};
    double const plateau = speed * c * 2 * h, dt = 0.2 * h / c; // [N per metre of depth], [s]
    double until = 0, impulse = 0, during = 0;
    for (int i = 0; i < 15 * cells; ++i) { // 3 L / c
        auto const report = solver.step(dt, below, above, wall, far_away);
        double const push = -report.reactions[2].impulse.x(); // behind those of the reflecting walls
        if (push > 0.5 * plateau * dt) until = solver.time();
        if (solver.time() < 0.5 / c || solver.time() > 1.5 / c) continue;
        impulse += push;
        during += dt;
    }
    Totals const end(solver);
    return {impulse / during / plateau, until * c / 2, end.momentum.x() / end.mass / speed};
}

} // namespace

// Cases 7.4 of the validation suite; in a bar of no shear the linear mode is exact for small amplitudes.
TEMPLATE_LIST_TEST_CASE("a bar swings in the period of its length, with all of its energy", "", Schemes)
{
    auto const coarse = vibrate<TestType>(16), fine = vibrate<TestType>(32);
    CAPTURE(coarse.period, fine.period, coarse.energy, fine.energy);
    CHECK(std::abs(fine.period) <= 6e-4);
    CHECK(std::log2(coarse.period / fine.period) >= 1.8);
    CHECK(std::abs(fine.energy - 1) <= 2e-3);
}

TEST_CASE("so it does with FLIP, and PIC damps it")
{
    auto const lively = vibrate<Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>>(32, {.fraction = 1});
    CHECK(std::abs(lively.period) <= 1.3e-3);
    CHECK(std::abs(lively.energy - 1) <= 2e-3);
    CHECK(vibrate<Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>>(32).energy <= 0.2);
}

TEST_CASE("bars that swing and hit walls, in finer cells", "[.full]")
{
    using Quadratic = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    auto const coarse = vibrate<Quadratic>(64), fine = vibrate<Quadratic>(128);
    CAPTURE(coarse.period, fine.period, coarse.energy, fine.energy);
    CHECK(std::abs(fine.period) <= 4e-5);
    CHECK(std::log2(coarse.period / fine.period) >= 1.9);
    CHECK(std::abs(fine.energy - 1) <= 2e-4);
    auto const bar = hit_wall<Quadratic>(256);
    CHECK(bar.stress == Approx(1).margin(0.01));
    CHECK(bar.contact == Approx(1).margin(0.01));
    CHECK(bar.rebound == Approx(1).margin(0.01));
}

TEST_CASE("a bar that hits a wall is pressed by rho c v for 2 L / c, and flies back as fast")
{
    auto const bar = hit_wall<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>>(64);
    CHECK(bar.stress == Approx(1).margin(0.03));
    CHECK(bar.contact == Approx(1).margin(0.03));
    CHECK(bar.rebound == Approx(1).margin(0.03));
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

// The scene of "a column of water at rest has the pressure of its weight", with a floor that stops nodes.
TEST_CASE("on a reflecting wall a column of water has the pressure of its weight down to its foot")
{
    auto const [error, top] = column_of_water(32, ReflectingWall{});
    CHECK(error <= 5e-3);
    CHECK(top == Approx(.97819601).margin(5e-6));
    auto const [stopped, lower] = column_of_water(32, Obstacle<HalfSpace>{.contact = Contact::bound_slip()});
    CHECK(stopped >= 2e-2);
}

TEST_CASE("the column of water on a reflecting wall, in finer cells", "[.full]")
{
    auto const [error, top] = column_of_water(128, ReflectingWall{});
    CHECK(error <= 2e-3);
    CHECK(top == Approx(.97819601).margin(1e-6));
}

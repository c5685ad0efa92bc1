// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/column.hpp"
#include "problems/disks.hpp"

#include <algorithm>

using namespace firn;
using namespace firn::test;

namespace
{

/// What becomes of two disks that collide: cases 7.7 of the validation suite (after Sulsky et al. 1994).
struct Collision
{
    double kinetic = 0;          ///< kinetic energy at the end, of that at the start
    double least_kinetic = 1;    ///< the least on the way
    double least_at = 0;         ///< when [s]
    double largest_energy = 0;   ///< kinetic and elastic, of the kinetic one at the start
    double largest_momentum = 0; ///< [kg m/s per metre of depth]
    double angular_change = 0;   ///< largest, of the angular momentum, of that at the start
};

/// `aside` is a velocity across the diagonal, and back for the other disk: they meet off their centres [m/s].
template <class SceneType>
Collision collide(typename SceneType::Transfer const& transfer = {}, double aside = 0)
{
    CollidingDisks<SceneType> disks(40, 2, transfer);
    auto v = disks.solver.template download<Velocity>();
    for (auto& of : v) of += Eigen::Vector2d(aside, -aside) * (of.x() > 0 ? 1 : -1);
    disks.solver.template upload<Velocity>(v);
    Eigen::Vector2d momentum;
    double const start = disks.kinetic_energy(momentum), turning = Totals(disks.solver).angular_momentum;
    Collision result;
    for (int frame = 0; frame < 72; ++frame) {
        disks.solver.advance(0.05);
        result.kinetic = disks.kinetic_energy(momentum) / start;
        result.largest_energy =
            std::max(result.largest_energy, result.kinetic + disks.elastic_energy() / start);
        result.largest_momentum = std::max(result.largest_momentum, momentum.norm());
        if (aside != 0)
            result.angular_change = std::max(result.angular_change,
                                             std::abs(Totals(disks.solver).angular_momentum / turning - 1));
        if (result.kinetic < result.least_kinetic) {
            result.least_kinetic = result.kinetic;
            result.least_at = disks.solver.time();
        }
    }
    return result;
}

/// A slender beam of length 1 m, clamped at one end.
template <class SceneType>
class Cantilever
{
public:
    /// `cells` per thickness, a tenth of its length; `load`: its weight times L^3 over its flexural rigidity;
    /// `per_cell` particles per cell and axis.
    Cantilever(int cells, double load, int per_cell = 2)
        : h_(thickness / cells), gravity_{{0, -load * rigidity / (density * thickness), 0}},
          solver_(lattice(h_), material())
    {
        // it goes on into the wall, by more than the kernel reaches
        auto const points = box_of_points<2>({-4 * h_, -thickness / 2}, {1, thickness / 2}, h_, per_cell);
        solver_.add(points, h_ * h_ / (per_cell * per_cell));
        for (std::size_t i = 0; i < points.size(); ++i) // of each layer those next to the middle
            if (std::abs(points[i].y()) < 0.3 * h_ && points[i].x() > 1 - 0.3 * h_) tip_.push_back(i);
        from_end_ = 1 - points[tip_.front()].x();
    }

    /// For some time, damped at a rate [1/s].
    void advance(double duration, double damping)
    {
        solver_.advance(duration, gravity_, Damping{damping},
                        Obstacle<HalfSpace>{.shape = {{1, 0, 0}}, .contact = Contact::sticky()});
    }

    /// The displacement of the middle of the free end [m].
    Eigen::Vector2d tip() const
    {
        auto const x = solver_.positions();
        auto const H = solver_.template download<DisplacementGradient>();
        Eigen::Vector2d sum = Eigen::Vector2d::Zero();
        for (auto const i : tip_)
            sum += x[i] + from_end_ * (H[i].col(0) + Eigen::Vector2d::UnitX()) - Eigen::Vector2d::UnitX();
        return sum / double(tip_.size());
    }

    /// Of the first mode, while the deflection is small [1/s].
    static double frequency()
    {
        return 1.8751041 * 1.8751041 / (2 * M_PI) * std::sqrt(rigidity / (density * thickness));
    }

private:
    static constexpr double thickness = 0.1, young = 1e6, density = 679.6, // [m], [Pa], [kg/m^3]
        rigidity = young * thickness * thickness * thickness / 12;         // [N m]

    static typename SceneType::Model material()
    {
        typename SceneType::Model beam;
        beam.density = density;
        beam.elasticity = lame<double>(young, 0);
        return beam;
    }

    double h_, from_end_ = 0;
    Gravity gravity_;
    typename SceneType::Solver solver_;
    std::vector<std::size_t> tip_;
};

/// A disk that rolls or slides down an incline of 30 degrees: case 7.12 of the validation suite.
struct Roll
{
    double acceleration; ///< down the plane [m/s^2]
    double spin;         ///< angular acceleration times the radius [m/s^2]
};

/// Gravity is tilted, the plane lies along the cells.
template <class SceneType>
Roll roll(double friction, double h = 0.01)
{
    double const radius = 0.2, angle = M_PI / 6, g = 9.81;
    typename SceneType::Model material;
    material.elasticity = lame<double>(1e6, 0.3);
    typename SceneType::Solver solver(lattice(h), material);
    solver.add(ball_of_points<2>({0, radius + 0.5 * h}, radius, h), h * h / 4);
    Obstacle<HalfSpace> const plane{.contact = Contact::coulomb(friction)};
    Eigen::Vector3d const pull{g * std::sin(angle), -g * std::cos(angle), 0};
    // its own swings are damped out before it is let go
    solver.advance(0.1, Gravity{{0, pull.y(), 0}}, Damping{40}, plane);
    solver.advance(0.1, Gravity{pull}, Damping{0}, plane);

    auto const motion = [&] { // down the plane, and of the rim about the centre
        Totals const now(solver);
        double const about_centre =
            now.angular_momentum - now.centre.x() * now.momentum.y() + now.centre.y() * now.momentum.x();
        return std::pair{now.momentum.x() / now.mass, -about_centre / (0.5 * now.mass * radius)};
    };
    auto const [speed, spin] = motion();
    double const duration = 0.3;
    solver.advance(duration, Gravity{pull}, Damping{0}, plane);
    auto const [later_speed, later_spin] = motion();
    return {(later_speed - speed) / duration, (later_spin - spin) / duration};
}

/// How far the top of a column sinks under its own weight [m], and the error of its stress.
template <class SceneType>
std::pair<double, double> settle(int cells)
{
    Column<SceneType> column(cells);
    column.advance(0);
    column.observe(0);
    return {column.tip(), column.error()};
}

} // namespace

TEST_CASE("two elastic disks collide and part with most of their energy, and with their momentum")
{
    using Fast = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    using Affine = Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>;
    using Lively = Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>;
    auto const check = [](Collision const& disks, double kept) {
        CHECK(disks.kinetic == Approx(kept).margin(0.03));
        CHECK(disks.least_kinetic < 0.5);
        CHECK(disks.least_at > 1.5); // they touch at about 1 s
        CHECK(disks.least_at < 2.5);
        CHECK(disks.largest_energy <= 1.01);
        CHECK(disks.largest_momentum <= 1e-12);
    };
    check(collide<Fast>(), 0.87);
    check(collide<Affine>(), 0.86);
    check(collide<Lively>(Flip{.fraction = 1}), 0.90);
    using Lossy = Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>;
    CHECK(collide<Lossy>().kinetic < 0.65); // it loses what it should keep

    // off their centres they turn about one another
    for (auto const& disks : {collide<Fast>({}, 0.02), collide<Affine>({}, 0.02)}) {
        CHECK(disks.angular_change <= 1e-12);
        CHECK(disks.largest_momentum <= 1e-12);
    }
    CHECK(collide<Lively>(Flip{.fraction = 1}, 0.02).angular_change > 1e-6);
    CHECK(collide<Lossy>({}, 0.02).angular_change > 0.01);
}

TEST_CASE("an elastic column under its own weight has the stress of equilibrium and the height of its law")
{
    using Mild = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    auto const [tip, error] = settle<Mild>(16);
    CHECK(tip == Approx(-0.03485531).epsilon(1e-3));
    CHECK(error <= 0.01);
    CHECK(settle<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>>(16).first ==
          Approx(-0.03643714).epsilon(1e-3));
    CHECK(settle<Scene<Hencky<Plane>, QuadraticBSpline, Mls>>(16).first == Approx(-0.03401370).epsilon(1e-3));
    // the error of stress falls with the cell size
    CHECK(settle<Mild>(8).second > 1.5 * error);
}

TEST_CASE(
    "a column at rest stays at rest, however steps change their length: gravity acts as long as stress does")
{
    using Mild = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    Column<Mild> column(10);
    column.advance(0);
    auto& solver = column.solver;
    double const c =
        std::sqrt(double(solver.model().elasticity.p_wave_modulus()) / double(solver.model().density));
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1}, foot{.axis = 1};
    double fastest = 0;
    auto const look = [&] {
        for (auto const& v : solver.download<Velocity>()) fastest = std::max(fastest, v.norm());
    };
    for (int turn : {1, 20})
        for (int i = 0; i < 200; ++i) {
            solver.step((i / turn % 2 ? 0.03 : 0.3) * 0.1 / c, Gravity{}, left, right, foot);
            look();
        }
    for (int i = 0; i < 40; ++i) {
        solver.advance((i % 3 == 0 ? 0.1 : 1.7) * 0.1 / c, Gravity{}, left, right, foot);
        look();
    }
    CHECK(fastest <= 1e-6 * c);
}

TEST_CASE("a beam sinks under its own weight as Timoshenko's does, and swings in its period")
{
    using Beam = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    constexpr double load = 0.1, slenderness = 10;
    double const omega = 2 * M_PI * Cantilever<Beam>::frequency();
    Cantilever<Beam> still(6, load);
    still.advance(12 / omega, 2 * omega); // its first mode is damped critically
    // by bending load / 8, by shear 0.8 over the square of the slenderness of that (nu = 0, a factor of 5/6)
    CHECK(still.tip().y() == Approx(-load / 8 * (1 + 0.8 / (slenderness * slenderness))).epsilon(0.03));

    Cantilever<Beam> beam(6, 0.02);
    double const period = 1 / Cantilever<Beam>::frequency(), at_rest = 0.02 / 8;
    // released from straight it swings about rest: twice as far after half a period, back after a whole one
    double before = 0, crossings[2]{};
    int found = 0;
    for (int i = 1; i <= 80 && found < 2; ++i) {
        beam.advance(period / 64, 0);
        double const from_rest = beam.tip().y() + at_rest;
        if (i > 1 && (from_rest < 0) != (before < 0))
            crossings[found++] = (i - 1 + before / (before - from_rest)) * period / 64;
        before = from_rest;
    }
    CHECK(found == 2);
    CHECK(2 * (crossings[1] - crossings[0]) == Approx(period).epsilon(0.03));
}

// Quadratic finite elements of the same beam, its thickness and shear included, which hang by 1.3 % more than
// the elastica. 16 particles per cell, and APIC: for what fewer and MLS leave see
// tests/notes/2026-11-22-beams-that-hang-too-far.md.
TEST_CASE("a beam that hangs down by two thirds of its length does so as far as it must")
{
    using Beam = Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>;
    double const omega = 2 * M_PI * Cantilever<Beam>::frequency();
    Cantilever<Beam> beam(6, 8, 4);
    beam.advance(9 / omega, 2 * omega);
    CHECK(beam.tip().y() == Approx(-0.64899).epsilon(0.03));
    CHECK(beam.tip().x() == Approx(-0.27845).epsilon(0.03));
}

TEST_CASE("the beam that hangs down, in finer cells", "[.full]")
{
    using Beam = Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>;
    double const omega = 2 * M_PI * Cantilever<Beam>::frequency();
    Cantilever<Beam> beam(12, 8, 4);
    beam.advance(9 / omega, 2 * omega);
    CHECK(beam.tip().y() == Approx(-0.64899).epsilon(0.015));
    CHECK(beam.tip().x() == Approx(-0.27845).epsilon(0.03)); // it goes with the square of that
}

// Cells of a twentieth of the radius: at a tenth it rolls with 7 % less. While it slides it hardly spins up:
// tests/notes/2026-11-22-disks-that-slide.md.
TEST_CASE("a disk rolls down an incline with 2/3 g sin where friction holds it, and else slides")
{
    using Disk = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    double const sine = 0.5, cosine = std::sqrt(0.75), g = 9.81;
    auto const rolls = roll<Disk>(0.5); // a third of the tangent would do
    CHECK(rolls.acceleration == Approx(2.0 / 3 * g * sine).epsilon(0.05));
    // nodes touch it where it is a cell or two away, which makes it larger
    CHECK(rolls.spin == Approx(rolls.acceleration / 1.075).epsilon(0.05));
    auto const slides = roll<Disk>(0.1);
    CHECK(slides.acceleration == Approx(g * (sine - 0.1 * cosine)).epsilon(0.02));
    CHECK(slides.spin < 0.5 * rolls.spin);
}

TEST_CASE("the disk that rolls, in finer cells: the nearer to its true radius", "[.full]")
{
    auto const rolls = roll<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>>(0.5, 0.005);
    CHECK(rolls.acceleration == Approx(2.0 / 3 * 9.81 * 0.5).epsilon(0.025));
    CHECK(rolls.spin == Approx(rolls.acceleration / 1.0375).epsilon(0.05));
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/traction.hpp>
#include <firn/mark_face.hpp>
#include <firn/settle.hpp>
#include <firn/transfer/loaded_surfaces.hpp>

#include <cmath>
#include <limits>

using namespace firn;
using namespace firn::test;

namespace
{

using SceneType = Scene<NeoHookean<Plane>, QuadraticBSpline, Carrying<Mls, LoadedSurfaces>>;

constexpr double modulus = 1e5, density = 1000, height = 0.25;

/// A bar from x = 0 to 1 that does not contract across, and has its right end marked.
SceneType::Solver marked_bar(int cells)
{
    double const cell = 1.0 / cells;
    NeoHookean<Plane> rubber;
    rubber.density = density;
    rubber.elasticity = lame<double>(modulus, 0);
    SceneType::Solver solver(lattice(cell), rubber);
    solver.add(box_of_points<2>({0, 0}, {1, height}, cell), cell * cell / 4);
    auto const count = mark_face(
        solver, Inside<Box>{.shape = {{cell / 2, 1, 1}}, .pose = {.position = {1, 0, 0}}}, {height, 0});
    CHECK(count == std::size_t(std::lround(2 * cells * height)));
    return solver;
}

struct Hung
{
    double stress, error, tip, force;
};

/// It hangs from a wall, and is pulled at its end.
Hung hang(int cells, double traction)
{
    auto solver = marked_bar(cells);
    ReflectingWall const wall{.axis = 0};
    auto const load = Traction::on({traction, 0, 0}, {1, 0, 0});
    double const c = std::sqrt(modulus / density);
    REQUIRE(settle(solver, {.rate = M_PI * c, .share = 1e-12, .longest = 20 / c}, load, wall).is_at_rest);
    auto const report = solver.advance(0.5 / c, load, wall);
    auto const x = solver.positions();
    auto const stress = solver.download<Stress>();
    Hung hung{0, 0, 0, report.reactions[0].impulse.x() / report.time_of_forces};
    double count = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        if (x[i].x() > 1 - 2.0 / cells) continue; // within the kernel's reach of the load
        hung.stress += stress[i](0, 0), ++count;
        hung.error = std::max(hung.error, std::abs(stress[i](0, 0) / traction - 1));
    }
    hung.stress /= count;
    hung.tip = x.back().x() - (1 - 0.25 / cells);
    return hung;
}

} // namespace

TEST_CASE(
    "a bar under a traction at its end bears it throughout, its wall the force, and its end moves by L t/E")
{
    double const traction = 1e-3 * modulus;
    for (int const cells : {16, 32}) {
        auto const hung = hang(cells, traction);
        CHECK(hung.force == Approx(traction * height).epsilon(1e-4));
        CHECK(hung.stress == Approx(traction).epsilon(1e-3)); // strains are a thousandth
        CHECK(hung.error <= 0.01);
        // the load enters half a spacing before the end
        CHECK(hung.tip == Approx(1e-3).epsilon(1.0 / cells));
    }
}

TEST_CASE(
    "a traction gives a free body its force times the time of forces, to rounding, and pressure acts inwards")
{
    auto solver = marked_bar(16);
    auto const check = [&](Traction const& load, Eigen::Vector2d const& force) {
        Eigen::Vector2d const before = solver.totals().momentum;
        auto const report = solver.advance(0.01, load);
        Eigen::Vector2d const gained = solver.totals().momentum - before;
        CHECK((gained - force * report.time_of_forces).norm() <=
              1e-12 * force.norm() * report.time_of_forces);
    };
    check(Traction::on({300, -200, 0}, {2, 0, 0}), {300 * height, -200 * height});
    check(Traction::pressure(400), {-400 * height, 0});
    Eigen::Matrix3d stress = Eigen::Matrix3d::Zero();
    stress(0, 0) = 100;
    stress(1, 0) = stress(0, 1) = 50;
    stress(1, 1) = 70; // on the face's normal nothing of it
    check({stress}, {100 * height, 50 * height});
    // two loads add up
    Eigen::Vector2d const before = solver.totals().momentum;
    auto const report = solver.advance(0.01, Traction::pressure(100), Traction::on({0, 30, 0}, {1, 0, 0}));
    CHECK((solver.totals().momentum - before - Eigen::Vector2d(-100, 30) * height * report.time_of_forces)
              .norm() <= 1e-12);
    // a second face, which shares the particles at the corner, and what is not marked
    solver = marked_bar(16);
    CHECK(mark_face(solver, Inside<Box>{{{2, 0.5 / 16, 1}}, {.position = {0.5, height, 0}}}, {0, 1}) == 32);
    check(Traction::pressure(10), {-10 * height, -10});
}

TEST_CASE("a traction while no particle is marked is refused, and changes nothing")
{
    SceneType::Solver solver(lattice(0.1));
    auto const load = Traction::pressure(1000);
    refused([&] { solver.step(1e-4, load); }); // there is no particle at all
    solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025);
    auto const error = refused([&] { solver.advance(1e-3, Gravity{}, load); });
    CHECK_THAT(error.what_is_wrong(), Contains("no particle has the mark 'area_per_mass'"));
    CHECK(error.where() == "Traction, effect 2 of Solver::advance");
    CHECK_THAT(error.remedy(), Contains("mark_face"));
    CHECK(solver.time() == 0);
    auto const snapshot = solver.snapshot();
    Inside<Box> const top{{{1, 0.05, 1}}, {.position = {0.2, 0.4, 0}}};
    CHECK(mark_face(solver, top, {0, 0.4}) == 8);
    solver.step(1e-4, load);
    CHECK(solver.totals().momentum.norm() > 0);
    CHECK(solver.remove_if(top) == 8); // and now none is left
    refused([&] { solver.step(1e-4, load); });
    solver.restore(snapshot);
    refused([&] { solver.step(1e-4, load); });
    mark_face(solver, top, {0, 0.4});
    solver.step(1e-4, load);
    solver.restore(snapshot); // the same particles without marks
    refused([&] { solver.step(1e-4, load); });
    solver.step(1e-4); // but without it the solver goes on
}

TEST_CASE("faces without a particle or an area, and tractions without a number, are refused")
{
    auto solver = marked_bar(16);
    auto const marks = solver.download<AreaPerMass>();
    double const nan = std::numeric_limits<double>::quiet_NaN();
    Inside<Box> const end{{{0.03, 1, 1}}, {.position = {1, 0, 0}}};
    refused([&] { mark_face(solver, Inside<Box>{{{0.1, 1, 1}}, {.position = {3, 0, 0}}}, {1, 0}); });
    refused([&] { mark_face(solver, end, {0, 0}); });
    refused([&] { mark_face(solver, end, {nan, 0}); });
    refused([&] { mark_face(solver, Inside<Box>{{{-1, 1, 1}}}, {1, 0}); });
    refused([&] { (void)Traction::on({1, 0, 0}, {0, 0, 0}); });
    refused([&] { solver.step(1e-4, Traction::pressure(nan)); });
    refused([&] { solver.step(1e-4, Traction::on({0, 0, 1}, {1, 0, 0})); });
    CHECK((solver.download<AreaPerMass>() == marks));
    CHECK(solver.time() == 0);
}

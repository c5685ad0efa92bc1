// SPDX-License-Identifier: MIT
// How accurate implicit steps are, and how many iterations they take, on problems whose solution is known:
//     implicit_accuracy
// Prints, as figures that results.py reads and in double precision:
//   column    under its weight by `settle`, of rubber of 1e5 Pa to steel of 2e11 Pa in 32 to 128 cells:
//             root mean square error of its stress over that at the foot, error of its top over how far
//             that sinks, and passes over the particles until a hundredth of the load is left, and a
//             ten-thousandth
//   bar       that swings in its first mode for ten periods, in 32 to 128 cells, in steps in which a
//             wave goes through 0.3 to 30 cells: energy in the end over that at the start, less backward
//             Euler's own loss
//   order     of the error of a bar in the length of steps
//   products  of a linear system, of a block in 32 to 128 cells and steps of 10 to 300 waves' cells; and
//             of one with a part in it that is a thousand times as stiff
//   snow      of P5, in equal steps of up to 0.6 cells by the midpoint rule: error of its height over its
//             side, in twelve or in four looks
#include "problems/snow_block.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <type_traits>
#include <vector>

using namespace firn;

namespace
{

using Plane = Space<2, double>;
using Rubber = NeoHookean<Plane>;
template <class Transfer, class By, class Of = Rubber>
using SolverOf = Solver<test::TestedBackend, Of, QuadraticBSpline, Transfer, By>;

void tell(std::string const& what, double value, char const* unit = "")
{
    std::printf("figure implicit_accuracy/%s %.3g %s\n", what.c_str(), value, unit);
    std::fflush(stdout);
}

std::string text(double number)
{
    char of[32];
    std::snprintf(of, sizeof of, "%g", number);
    return of;
}

/// The stretch of a column where it bears a load P: P = mu (F - 1/F) + lambda ln F / F.
double stretch(Rubber const& of, double P)
{
    double const mu = of.elasticity.mu, lambda = of.elasticity.lambda;
    double F = 1;
    for (int i = 0; i < 30; ++i) {
        double const slope = mu * (1 + 1 / (F * F)) + lambda * (1 - std::log(F)) / (F * F);
        F -= (mu * (F - 1 / F) + lambda * std::log(F) / F - P) / slope;
    }
    return F;
}

template <class Transfer>
void column(char const* name, double young, int cells)
{
    double const h = 1.0 / cells, load = 1000 * 9.81;
    Rubber const of{.density = 1000, .elasticity = lame<double>(young, 0.3)};
    auto const points = test::box_of_points<2>({0, 0}, {2 * h, 1}, h);
    std::string const rest = std::string("/") + name + "/" + text(young) + "/" + std::to_string(cells);
    for (double const share : {0.99, 1e-2}) { // of which settle asks for a hundredth
        SolverOf<Transfer, Implicit> body(lattice(h), of, {Transfer{}, Implicit{.share = share}});
        body.add(points, h * h / 4);
        auto const report =
            body.settle(Gravity{}, ReflectingWall{.axis = 0},
                        ReflectingWall{.axis = 0, .node = 2, .side = -1}, ReflectingWall{.axis = 1});
        tell("column_passes" + rest + (share < 0.5 ? "/1e-4" : "/1e-2"), double(report.solve.passes));
        auto const x = body.positions();
        auto const H = body.template download<DisplacementGradient>();
        double squares = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            auto state = Record<double, 2, Rubber::State>::at_rest();
            state[DisplacementGradient{}] = H[i];
            Matrix<double, 2> const still = Matrix<double, 2>::Zero();
            double const P = of.respond<double>(state, still, 0.0).kirchhoff_stress(1, 1) / (1 + H[i](1, 1));
            squares += std::pow(P / load + 1 - points[i].y(), 2);
        }
        tell("column_stress" + rest + (share < 0.5 ? "/1e-4" : "/1e-2"),
             100 * std::sqrt(squares / double(points.size())), "%");
        double sinks = 0; // by Gauss's rule of two points
        constexpr int parts = 1000;
        for (int i = 0; i < 2 * parts; ++i) {
            double const at = (i / 2 + 0.5 + (i % 2 == 0 ? -0.5 : 0.5) / std::sqrt(3.0)) / parts;
            sinks += (1 - stretch(of, -load * (1 - at))) / (2 * parts);
        }
        std::size_t const top = points.size() - 1;
        double const sunk = points[top].y() - x[top].y() - H[top](1, 1) * (1 - points[top].y());
        tell("column_top" + rest + (share < 0.5 ? "/1e-4" : "/1e-2"), 100 * std::abs(sunk / sinks - 1), "%");
    }
}

/// A bar of length 1 m that swings lengthwise in its first mode, with a free end.
template <class By>
struct Bar
{
    static constexpr double c = 10; ///< [m/s]

    Bar(int cells, double cells_of_wave, double share)
        : h(1.0 / cells), dt(cells_of_wave * h / c),
          bar(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0)}, {Flip{1}, by(share)}),
          points(test::box_of_points<2>({0, 0}, {1, 2 * h}, h))
    {
        bar.add(points, h * h / 4);
        auto v = bar.template download<Velocity>();
        for (std::size_t i = 0; i < v.size(); ++i) v[i].x() = 1e-3 * std::sin(M_PI / 2 * points[i].x());
        bar.template upload<Velocity>(v);
    }
    static By by(double share)
    {
        By of;
        of.share = share;
        return of;
    }
    void step(std::size_t steps)
    {
        bar.steps(steps, dt, ReflectingWall{.axis = 0}, ReflectingWall{.axis = 1},
                  ReflectingWall{.axis = 1, .node = 2, .side = -1});
    }
    double energy() const { return bar.energy().kinetic + bar.energy().elastic; }
    double turn() const { return M_PI / 2 * c * dt; }

    double h, dt; ///< [m], [s]
    SolverOf<Flip, By> bar;
    std::vector<Eigen::Vector2d> points;
};

template <class By>
void swing(char const* name, int cells, double cells_of_wave)
{
    constexpr bool keeps = std::is_same_v<By, ImplicitMidpoint>;
    Bar<By> bar(cells, cells_of_wave, 1e-3);
    double const begin = bar.energy(), turn = bar.turn();
    auto const steps = static_cast<std::size_t>(std::lround(10 * 2 * M_PI / turn));
    bar.step(steps);
    tell(std::string("bar_energy/") + name + "/" + text(cells_of_wave) + "/" + std::to_string(cells),
         bar.energy() / begin - (keeps ? 1 : std::pow(1 + turn * turn, -double(steps))));
}

template <class By>
void order(char const* name)
{
    auto const swung = [](int halvings) {
        Bar<By> bar(32, 4.0 / (1 << halvings), 1e-6);
        bar.step(std::size_t(6) << halvings); // 0.94 of a quarter of the period
        return bar.bar.positions().back().x() - bar.points.back().x();
    };
    double const coarse = swung(0), middle = swung(1), fine = swung(2);
    tell(std::string("order/") + name, std::log2((coarse - middle) / (middle - fine)));
}

void products(int cells, double cells_of_wave, double stiff)
{
    double const h = 1.0 / cells;
    Rubber const soft{.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
        hard{.density = 1000, .elasticity = lame<double>(1e5 * stiff, 0.3)};
    SolverOf<Mls, Implicit, Materials<Rubber, Rubber>> body(lattice(h), {soft, hard});
    std::vector<Eigen::Vector2d> around, inside;
    for (auto const& x : test::box_of_points<2>({0.3 * h, 0.3 * h}, {1 + 0.3 * h, 1 + 0.3 * h}, h))
        ((x - Eigen::Vector2d(0.5, 0.5)).norm() < 0.2 ? inside : around).push_back(x);
    body.add<Material<0>>(around, h * h / 4);
    body.add<Material<1>>(inside, h * h / 4);
    body.step(cells_of_wave * h / std::sqrt(soft.elasticity.p_wave_modulus() / 1000), Gravity{{0, -0.1, 0}},
              Obstacle<HalfSpace>{.contact = Contact::sticky(), .motion = {.position = {0, 0.8 * h, 0}}});
    tell("products/" + text(stiff) + "/" + text(cells_of_wave) + "/" + std::to_string(cells),
         double(body.solved().products) / body.solved().newton);
}

/// P5 by the midpoint rule.
struct Snows
{
    using Model = Snow<Plane>;
    using Transfer = SteppedBy<Flip, ImplicitMidpoint>;
    using Backend = test::TestedBackend;
    using Space = Plane;
    using Solver = firn::Solver<Backend, Model, QuadraticBSpline, Flip, ImplicitMidpoint>;
};

/// In equal steps up to each of some looks, a part of the twelve of the problem.
void snow(int cells, double cells_of_step, int looks)
{
    test::SnowBlock<Snows> block(cells, 2, {Flip{0.95}, {}});
    double const dt = cells_of_step * block.side / cells / block.speed, part = block.duration / looks;
    auto const steps = static_cast<std::size_t>(std::ceil(part / dt - 1e-9));
    for (int look = 0; look < looks; ++look) {
        block.solver.steps(steps, part / double(steps), Gravity{},
                           Obstacle<HalfSpace>{.contact = Contact::slip()});
        block.observe((look + 1) * 12 / looks - 1);
    }
    tell("snow/" + text(part / double(steps) * block.speed * cells / block.side) + "/" +
             std::to_string(cells),
         100 * block.error() * std::sqrt(12.0 / looks), "%");
}

} // namespace

int main()
{
    for (int const cells : {32, 64, 128}) {
        for (double const young : {1e5, 1e8, 2e11}) column<Mls>("mls", young, cells);
        column<Apic>("apic", 1e5, cells);
    }
    for (double const cells_of_wave : {0.3, 1.0, 3.0}) swing<Implicit>("euler", 32, cells_of_wave);
    for (int const cells : {32, 64, 128})
        for (double const cells_of_wave : {1.0, 3.0, 10.0, 30.0})
            swing<ImplicitMidpoint>("midpoint", cells, cells_of_wave);
    order<Implicit>("euler");
    order<ImplicitMidpoint>("midpoint");
    for (int const cells : {32, 64, 128}) {
        for (double const cells_of_wave : {10.0, 30.0, 100.0, 300.0}) products(cells, cells_of_wave, 1);
        for (double const cells_of_wave : {3.0, 10.0, 30.0}) products(cells, cells_of_wave, 1000);
    }
    for (int const cells : {16, 32, 64})
        for (int const looks : {12, 4}) snow(cells, 0.6, looks);
    snow(16, 0.3, 12);
}

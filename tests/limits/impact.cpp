// SPDX-License-Identifier: MIT
#include "limits/impact.hpp"

#include <algorithm>
#include <limits>

using namespace firn;
using namespace firn::test;
using namespace firn::test::impact;

#if defined(__CUDACC__)
bool tests_need_a_device = true; // see cuda/main.cpp
#endif

// Hard cases of what is hit, turned inside out or crushed, and of input that makes no sense.
namespace
{

using Neo = Scene<NeoHookean<Solid>, QuadraticBSpline, Mls>;
using Corotated = Scene<FixedCorotated<Solid>, QuadraticBSpline, Mls>;
using Logarithmic = Scene<Hencky<Solid>, QuadraticBSpline, Mls>;
using SnowScene = Scene<Snow<Plane>, QuadraticBSpline, Mls>;

/// Whether a call was refused by an Error.
template <class Call>
bool is_refused(Call const& call)
{
    try {
        call();
    }
    catch (Error const&) {
        return true;
    }
    return false;
}

/// How many particles of a are not those of b, bit by bit.
template <class Solver>
double different_bits(Solver const& a, Solver const& b)
{
    auto const x = a.positions(), y = b.positions();
    auto const v = a.template download<Velocity>(), w = b.template download<Velocity>();
    auto const H = a.template download<DisplacementGradient>(),
               G = b.template download<DisplacementGradient>();
    double count = std::abs(double(x.size()) - double(y.size()));
    for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i)
        count += !(x[i] == y[i] && v[i] == w[i] && H[i] == G[i]);
    return count;
}

Neo::Solver running_block()
{
    Neo::Solver solver(lattice(0.1));
    solver.add(box_of_points<3>({0, 0, 0}, {0.4, 0.4, 0.4}, 0.1), 1.25e-4, {0.1, 0, 0});
    for (int i = 0; i < 5; ++i) solver.step(1e-3, Gravity{});
    return solver;
}

/// Kinetic and hardened elastic energy [J] of snow.
double energy_of_snow(SnowScene::Solver const& solver, double volume)
{
    auto const& snow = solver.model();
    auto const H = solver.download<DisplacementGradient>();
    auto const J_P = solver.download<PlasticVolumeRatio>();
    double sum = Totals(solver).kinetic_energy;
    for (std::size_t i = 0; i < H.size(); ++i) {
        double const within = std::clamp(J_P[i], snow.smallest_plastic_ratio, snow.largest_plastic_ratio);
        sum += volume * std::exp(snow.hardening * (1 - within)) *
               energy(snow, Matrix<double, 2>(Matrix<double, 2>::Identity() + H[i]));
    }
    return sum;
}

void hit_wedge(double h)
{
    HardCase const H19{"H19"};
    double const volume = h * h / 4;
    SnowScene::Solver solver{lattice(h)};
    auto const ball = ball_of_points<2>({0.003, 0.26}, 0.1, h);
    solver.add(ball, volume, {0, -20});
    Eigen::Quaterniond const upright(Eigen::AngleAxisd(M_PI / 4, Eigen::Vector3d::UnitZ()));
    Obstacle<Box> const wedge{.shape = {{0.1, 0.1, 0.1}}, .motion = {.orientation = upright}};
    double const start = energy_of_snow(solver, volume);
    double last = 1, growth = 0, capped = 0, packed = 1, shortest = 1, longest = 0;
    watch(
        solver, 0.03, 60,
        [&](AdvanceReport const& report) {
            double const now = energy_of_snow(solver, volume) / start;
            growth = std::max(growth, now / last);
            last = now;
            capped = std::max(capped, double(report.capped));
            shortest = std::min(shortest, report.smallest_dt);
            longest = std::max(longest, report.largest_dt);
            for (double J_P : solver.download<PlasticVolumeRatio>()) packed = std::min(packed, J_P);
        },
        wedge);
    H19.at_most("particles not finite", double(not_finite(solver)), 0);
    H19.at_most("largest growth of the total energy in half a millisecond", growth, 1.01);
    H19.at_least("most particles at the cap of hardening", capped, 1);
    // at the cap, J_P = 0.6, waves are e^2 times as fast as at rest
    H19.at_most("longest step / shortest", longest / shortest, 1.1 * std::exp(2.0));
    H19.at_most("smallest plastic volume ratio", packed, 0.8);
}

} // namespace

TEST_CASE("H2: an elastic cube hits a wall at 2.7 times the speed of its waves")
{
    hit_wall<Neo>("neo-Hookean", 4);
    hit_wall<Corotated>("fixed corotated", 4);
}

TEST_CASE("H2: the same, of 32 cells a side", "[.full]")
{
    hit_wall<Neo>("neo-Hookean of 32 cells", 32);
    hit_wall<Corotated>("fixed corotated of 32 cells", 32);
}

// The plan asks that 99 % of such particles return to det F > 0. None ever does, in any code that updates F
// by F' = (I + dt L) F and keeps dt |L| below 1: det (I + dt L) is then above 0, and the sign of det F stays
// as it was. (A mesh that computes F from the places of its nodes can untangle.) The test asks instead that
// nothing grows, that no other particle is inverted, and that the same particle of a law without a stress for
// it is an error.
TEST_CASE("H3: particles that are turned inside out stay so, shrink, and disturb no others")
{
    HardCase const H3{"H3"};
    double const h = 0.1, volume = std::pow(h / 2, 3);
    int const blocks = 20;
    Corotated::Solver solver(lattice(h), elastic<FixedCorotated<Solid>>(1e5, 0.3));
    std::mt19937 random(3);
    std::vector<Matrix<double, 3>> H;
    std::vector<std::size_t> turned;
    for (int block = 0; block < blocks; ++block) { // of 3 cells, 5 apart
        Vector<double, 3> const low(block * 8 * h, 0, 0);
        auto const points = box_of_points<3>(low, low + Vector<double, 3>::Constant(3 * h), h);
        solver.add(points, volume);
        turned.push_back(H.size() + random() % points.size());
        H.resize(H.size() + points.size(), Matrix<double, 3>::Zero());
        Matrix<double, 3> F = random_matrix<3>(random);
        if (F.determinant() > 0) F.col(0) *= -1;
        if (block < 2) F.setIdentity();
        if (block == 0) F(2, 2) = -1;
        if (block == 1) F *= -1;
        H[turned.back()] = F - Matrix<double, 3>::Identity();
    }
    solver.upload<DisplacementGradient>(H);
    double const start = mechanical_energy(solver, volume);
    double const wave = std::sqrt(solver.model().elasticity.p_wave_modulus() / 1000);
    double last = start, growth = 0;
    watch(solver, 10 * 6 * h / wave, 20, [&](AdvanceReport const&) { // ten times to and fro
        double const now = mechanical_energy(solver, volume);
        growth = std::max(growth, now / last);
        last = now;
    });
    auto const now = solver.download<DisplacementGradient>();
    int back = 0, others = 0;
    double volume_left = 0;
    for (std::size_t i = 0; i < now.size(); ++i) {
        double const J = 1 + volume_change<double, 3>(now[i]);
        if (std::find(turned.begin(), turned.end(), i) == turned.end())
            others += !(J > 0);
        else {
            back += J > 0;
            volume_left = std::max(volume_left, std::abs(J / (1 + volume_change<double, 3>(H[i]))));
        }
    }
    H3.at_most("particles not finite", double(not_finite(solver)), 0);
    H3.at_most("largest growth of the total energy in half a period", growth, 1.01);
    H3.at_most("other particles that were turned inside out", others, 0);
    H3.at_most("particles that were turned back", back, 0);
    H3.at_most("largest volume of one that was turned / that at the start", volume_left, 1);

    Neo::Solver refuses(lattice(h), elastic<NeoHookean<Solid>>(1e5, 0.3));
    auto const points = box_of_points<3>({0, 0, 0}, {3 * h, 3 * h, 3 * h}, h);
    refuses.add(points, volume);
    H.assign(points.size(), Matrix<double, 3>::Zero());
    H[100](2, 2) = -2;
    refuses.upload<DisplacementGradient>(H);
    H3.at_most("neo-Hookean runs that went on with one", !is_refused([&] { refuses.advance(0.01); }), 0);
}

TEST_CASE("H4: a block that was crushed to a hundredth of its volume is let go")
{
    // c / c at rest is 1.34, 1.82 and 0.19 there, and nothing counts as slower than at rest
    let_go<Neo>("neo-Hookean", 1 / 1.34);
    let_go<Logarithmic>("Hencky", 1 / 1.82);
    let_go<Corotated>("fixed corotated", 1);
}

TEST_CASE("H12: 64 particles at one place are one of 64 times the mass, also with opposite velocities")
{
    be_one<Neo>("", 1e-12);
}

TEST_CASE("H13: numbers that are none, masses, volumes, moduli and steps that make no sense")
{
    HardCase const H13{"H13"};
    double const nan = std::numeric_limits<double>::quiet_NaN(),
                 inf = std::numeric_limits<double>::infinity();
    auto solver = running_block();
    auto const points = [](double x) {
        return std::vector<Vector<double, 3>>{{0.05, 0.05, 0.05}, {x, 0, 0}};
    };
    auto const uploads = [&](auto tag, double value) {
        auto values = solver.download<decltype(tag)>();
        values[7](0) = value;
        return is_refused([&] { solver.upload<decltype(tag)>(values); });
    };
    double accepted = 0;
    for (double x : {nan, inf, 1e30}) accepted += !is_refused([&] { solver.add(points(x), 1e-4); });
    for (double v : {nan, inf}) accepted += !is_refused([&] { solver.add(points(0), 1e-4, {v, 0, 0}); });
    for (double bad : {nan, inf, -inf})
        accepted += !uploads(Velocity{}, bad) + !uploads(AffineVelocity{}, bad) +
                    !uploads(DisplacementGradient{}, bad);
    for (double bad : {nan, inf, 0.0, -1.0}) {
        accepted += !is_refused([&] { solver.add(points(0), bad); });
        accepted +=
            !is_refused([&] { Neo::Solver(lattice(0.1), elastic<NeoHookean<Solid>>(1e5, 0.3, bad)); });
        accepted += !is_refused([&] { elastic<NeoHookean<Solid>>(bad, 0.3); });
        accepted += !is_refused([&] { lattice(bad); });
        accepted += !is_refused([&] { solver.step(bad, Gravity{}); });
        if (bad != 0) accepted += !is_refused([&] { solver.advance(bad, Gravity{}); });
    }
    H13.at_most("inputs that were not refused", accepted, 0);
    auto untouched = running_block();
    H13.at_most("particles that a refusal changed", different_bits(solver, untouched), 0);
    for (auto* of : {&solver, &untouched})
        for (int i = 0; i < 20; ++i) of->step(1e-3, Gravity{});
    H13.at_most("particles that a refusal changed 20 steps before", different_bits(solver, untouched), 0);
}

TEST_CASE("H13: a particle whose stress is beyond all numbers does not spoil the grid")
{
    HardCase const H13{"H13"};
    auto solver = running_block(), without = running_block();
    std::uint32_t const bad = solver.add(std::vector<Vector<double, 3>>{{5, 5, 5}}, 1.25e-4);
    auto H = solver.download<DisplacementGradient>();
    without.upload<DisplacementGradient>(without.download<DisplacementGradient>()); // scatters afresh, too
    H.back()(0, 1) = 1e200;
    solver.upload<DisplacementGradient>(H);
    std::string said;
    for (int attempt = 0; attempt < 2; ++attempt) try {
            attempt == 0 ? void(solver.step(1e-3, Gravity{})) : void(solver.advance(1e-3, Gravity{}));
        }
        catch (Error const& error) {
            said += error.what_is_wrong();
        }
    H13.at_least("errors that name the particle", said.find("particle " + std::to_string(bad)) != said.npos,
                 1);
    solver.remove_if(Outside<Box>{.shape = {{2, 2, 2}}});
    H13.at_most("other particles that it changed", different_bits(solver, without), 0);
    for (auto* of : {&solver, &without})
        for (int i = 0; i < 20; ++i) of->step(1e-3, Gravity{});
    H13.at_most("other particles that it changed 20 steps later", different_bits(solver, without), 0);
}

TEST_CASE("H13: such a particle in the midst of others may be taken out, and they do not notice")
{
    HardCase const H13{"H13"};
    auto isolates = running_block(), removes = running_block();
    isolates.quarantine(1);
    for (auto* of : {&isolates, &removes}) {
        of->add(std::vector<Vector<double, 3>>{{0.45, 0.4, 0.4}}, 1.25e-4); // next to the block
        auto H = of->download<DisplacementGradient>();
        H.back()(0, 1) = 1e200;
        of->upload<DisplacementGradient>(H);
    }
    removes.remove_if(Outside<Box>{.shape = {{0.42, 2, 2}}});
    auto const report = isolates.step(1e-3, Gravity{});
    removes.step(1e-3, Gravity{});
    H13.at_least("in quarantine: particles that are named", double(report.isolated.size()), 1);
    H13.at_most("in quarantine: others that differ from a run without it", different_bits(isolates, removes),
                0);
    for (auto* of : {&isolates, &removes})
        for (int i = 0; i < 20; ++i) of->step(1e-3, Gravity{});
    H13.at_most("in quarantine: the same 20 steps later", different_bits(isolates, removes), 0);
}

TEST_CASE("H19: a snowball that hits a wedge at 20 m/s hardens without end") { hit_wedge(0.01); }

TEST_CASE("H19: the same in cells of a quarter", "[.full]") { hit_wedge(0.0025); }

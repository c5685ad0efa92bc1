// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

using Cases = Combinations<
    More<Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>, Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>,
         Scene<FixedCorotated<Plane>, CubicBSpline, Apic>,
         Scene<FixedCorotated<Solid>, QuadraticBSpline, Mls>,
         Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Mls>, Scene<Snow<PlaneFloat>, CubicBSpline, Flip>>,
    Scene<SplitNeoHookean<Plane>, CubicBSpline, Mls>, Scene<Hencky<SolidFloat>, QuadraticBSpline, Apic>,
    MoreThanReference<Scene<MooneyRivlin<Solid>, CubicBSpline, Flip>,
                      Scene<NeoHookean<Plane>, QuadraticBSpline, Tpic>,
                      Scene<NeoHookean<Plane>, CubicBSpline, Asflip>>>;

// A block thrown sideways falls as the symplectic Euler rule says, exactly: after n steps y = y0 - g dt^2 n
// (n + 1) / 2.
TEMPLATE_LIST_TEST_CASE("a block in free flight follows the discrete parabola and does not deform", "", Cases)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    double const h = 0.05, dt = 1e-4, g = 9.81;
    int const steps = 2000;
    Vec low = Vec::Constant(0.011), velocity = Vec::Zero();
    // A number amid those of its size, and scattered points: see
    // tests/notes/2026-11-22-roundings-that-add-up.md.
    velocity[0] = 1.3;
    typename TestType::Solver solver(lattice(h));
    auto const points = scattered<d>(box_of_points<d>(low, low + Vec::Constant(0.2), h), 0.1 * h);
    solver.add(points, std::pow(h / 2, d), velocity);
    Totals const before(solver);

    Gravity const gravity{{0, -g, 0}};
    for (int i = 0; i < steps; ++i) solver.step(dt, gravity);

    double const t = steps * dt;
    double worst = 0;
    auto const x = solver.positions();
    for (std::size_t i = 0; i < x.size(); ++i) {
        Vec expected = points[i];
        expected[0] += double(typename TestType::Number(velocity[0])) * t;
        expected[1] -= 0.5 * g * t * (t + dt);
        worst = std::max(worst, (x[i] - expected).cwiseAbs().maxCoeff());
    }
    CHECK(worst <= (TestType::is_float ? 1e-5 * h : 1e-12));

    double strain = 0;
    for (auto const& H : solver.template download<DisplacementGradient>())
        strain = std::max(strain, double(H.norm()));
    CHECK(strain <= (TestType::is_float ? 1e-4 : 1e-12));

    Totals const after(solver);
    Vec impulse = Vec::Zero();
    impulse[1] = -g * solver.time() * before.mass;
    CHECK((after.momentum - before.momentum - impulse).norm() <=
          (TestType::is_float ? 1e-5 : 1e-13) * before.momentum.norm());
    CHECK(after.mass == before.mass);
    CHECK(solver.time() == Approx(t));
}

TEST_CASE("advance takes a frame in whole and lands on its end")
{
    using Solver = Scene<SplitNeoHookean<Plane>, CubicBSpline, Mls>::Solver;
    Solver solver(lattice(0.05));
    solver.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.05), 0.025 * 0.025);
    double const frame = 1.0 / 24;
    auto report = solver.advance(frame, Gravity{});
    CHECK(solver.time() == frame);
    report.merge(solver.advance(frame, Gravity{}));
    CHECK(solver.time() == 2 * frame);
    std::uint64_t counted = 0;
    for (auto n : report.limited_by) counted += n;
    CHECK(counted == report.substeps);
    CHECK(report.smallest_dt > 0);
    CHECK(report.smallest_dt <= report.largest_dt);
    CHECK(report.lost == 0);
    CHECK(report.rejected == 0);
    CHECK(solver.positions()[0].y() < 0.01);
}

TEST_CASE("a scene without particles advances its time")
{
    Scene<Hencky<SolidFloat>, QuadraticBSpline, Apic>::Solver solver(lattice(0.1));
    CHECK(solver.advance(0.5, Gravity{}).substeps > 0);
    CHECK(solver.time() == 0.5);
    solver.add(std::vector<Eigen::Vector3d>{}, 1e-6);
    CHECK(solver.size() == 0);
}

TEST_CASE("a scene far from the origin runs as it does at the origin")
{
    // The lattice's own coordinates go far out; a kilometre in single precision would otherwise stall slow
    // particles.
    using Solver = Scene<Hencky<SolidFloat>, QuadraticBSpline, Apic>::Solver;
    double const h = 0.0625;
    Eigen::Vector3d const far(1024, -2048, 512);
    auto const points = box_of_points<3>({0, 0, 0}, {0.25, 0.25, 0.25}, h);
    auto moved = points;
    for (auto& x : moved) x += far;
    Solver here(lattice(h)), there(lattice(h));
    here.add(points, std::pow(h / 2, 3), {0.01, 0, 0});
    there.add(moved, std::pow(h / 2, 3), {0.01, 0, 0});
    Obstacle<HalfSpace> const floor{.shape = {}, .contact = Contact::coulomb(0.5)};
    Obstacle<HalfSpace> far_floor = floor;
    far_floor.motion.position = far;
    for (int i = 0; i < 300; ++i) {
        here.step(2e-4, Gravity{}, floor);
        there.step(2e-4, Gravity{}, far_floor);
    }
    double worst = 0;
    auto const a = here.positions(), b = there.positions();
    for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, (b[i] - far - a[i]).norm());
    CHECK(worst <= 1e-4 * h);
}

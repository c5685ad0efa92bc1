// SPDX-License-Identifier: MIT
// A program to be compiled with flags that let a compiler assume that there is no NaN (see fast_math.sh), for
// either backend: what the library refuses without them it refuses with them, and a step that makes NaN is
// rejected. Without a test framework, since such flags may change a framework's own comparisons.
#include <firn/firn.hpp>
#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif

#include <bit>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <vector>

namespace
{

// from bits, and unknown to the compiler
std::uint64_t volatile bits_of_nan = 0x7ff8000000000000, bits_of_infinity = 0x7ff0000000000000;
double const nan = std::bit_cast<double>(std::uint64_t(bits_of_nan));
double const infinity = std::bit_cast<double>(std::uint64_t(bits_of_infinity));

int checks = 0, failures = 0;

void check(bool holds, char const* what)
{
    ++checks;
    if (holds) return;
    ++failures;
    std::printf("does not hold: %s\n", what);
}

void refuses(char const* what, std::function<void()> const& call)
{
    bool refused = false;
    try {
        call();
    }
    catch (firn::Error const&) {
        refused = true;
    }
    check(refused, what);
}

/// What both NaN and infinity make of it is refused.
template <class Make>
void refuses_both(char const* what, Make const& make)
{
    refuses(what, [&] { make(nan); });
    refuses(what, [&] { make(infinity); });
}

/// A gas without pressure. Its stress is NaN (or whatever `stress` is) where it has grown by a hundredth.
template <class SpaceType>
struct Bursting
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = firn::Fields<firn::LogVolumeRatio>;
    static constexpr int d = Space::dimension;
    Number density = 1000, stress = 0, modulus = 1;

    void validate() const {}

    template <firn::Lane Real, class Particle>
    FIRN_HOST_DEVICE firn::Response<Real, d> respond(Particle& state, firn::Matrix<Real, d> const& L,
                                                     Real dt) const
    {
        using firn::select;
        Real& grown = state[firn::LogVolumeRatio{}];
        grown = grown + dt * (L(0, 0) + L(1, 1));
        auto const burst = grown > Real(Number(0.01));
        firn::Matrix<Real, d> tau = firn::zeros<firn::Matrix<Real, d>>();
        tau(0, 1) = tau(1, 0) = select(burst, Real(stress), Real(0));
        return {tau, Real(modulus), firn::no_lanes<Real>(), firn::no_lanes<Real>()};
    }
};

using Space = firn::Space<2, float>;
#if defined(__CUDACC__)
using Backend = firn::Cuda;
#else
using Backend = firn::OpenMP;
#endif
using Samples = firn::SignedDistanceGrid<float, 2>;
using Floor = firn::SignedDistanceGridOn<Backend, float, 2>;
using Solver = firn::Solver<Backend, Bursting<Space>, firn::QuadraticBSpline, firn::Mls>;
using Velocities = std::vector<Eigen::Vector2f>;
constexpr double h = 0.1;

/// The effects of all steps, so that one kind of them is compiled: no gravity, and an obstacle below.
struct Around
{
    firn::Gravity gravity{.acceleration = {0, 0, 0}};
    firn::Obstacle<Floor> floor{
        .shape = Samples({-1, -1}, 0.5f, {5, 2}, {-1, -1, -1, -1, -1, 1, 1, 1, 1, 1}).on(Backend{}),
        .on_particles = true};
};

void step(Solver& solver, double dt, Around const& around = {})
{
    solver.step(dt, around.gravity, around.floor);
}
firn::AdvanceReport advance(Solver& solver, double duration, Around const& around = {})
{
    return solver.advance(duration, around.gravity, around.floor);
}

std::vector<Eigen::Vector2d> block()
{
    std::vector<Eigen::Vector2d> points;
    for (int i = 0; i < 400; ++i) points.push_back(h / 2 * Eigen::Vector2d(i % 20 + 0.5, i / 20 + 0.5));
    return points;
}

Solver solver_of(double stress)
{
    Bursting<Space> material;
    material.stress = float(stress);
    Solver solver(firn::lattice(h), material, {}, {.rejection = infinity});
    solver.add(block(), h * h / 4);
    return solver;
}

/// One of ten is torn apart: those behind the tenth column move away from those before it.
void tear(Solver& solver)
{
    Velocities velocities(solver.size());
    for (std::size_t i = 0; i < velocities.size(); ++i) velocities[i] = {i % 20 < 10 ? -0.1f : 0.1f, 0.0f};
    solver.upload<firn::Velocity>(velocities);
}

bool positions_are_finite(Solver const& solver)
{
    for (auto const& x : solver.positions())
        for (int a = 0; a < 2; ++a)
            if (!((std::bit_cast<std::uint64_t>(x[a]) << 1 >> 53) < 1023 + 10)) return false; // |x| < 1024
    return true;
}

/// Whether a call ends in a StepError of this cause, and leaves positions that are numbers.
bool fails(Solver& solver, firn::FailureCause cause, std::function<void()> const& call)
{
    try {
        call();
    }
    catch (firn::StepError const& error) {
        return error.failure().cause == cause && positions_are_finite(solver);
    }
    catch (firn::Error const&) {
    }
    return false;
}

void check_input()
{
    auto solver = solver_of(0);
    auto const add_at = [&](double x) {
        auto points = block();
        points[3].x() = x;
        solver.add(points, h * h / 4);
    };
    refuses_both("a position", add_at);
    refuses_both("a volume", [&](double x) { solver.add(block(), x); });
    refuses_both("a velocity of new particles", [&](double x) { solver.add(block(), h * h / 4, {x, 0}); });
    refuses_both("an uploaded velocity", [&](double x) {
        Velocities velocities(solver.size(), Eigen::Vector2f::Zero());
        velocities[5].y() = float(x);
        solver.upload<firn::Velocity>(velocities);
    });
    refuses_both("an uploaded state", [&](double x) {
        std::vector<float> values(solver.size(), 0.0f);
        values[7] = float(x);
        solver.upload<firn::LogVolumeRatio>(values);
    });
    refuses_both("a restored state", [&](double x) {
        auto snapshot = solver.snapshot();
        snapshot.materials[0].fields[0].components[0][9] = float(x);
        solver.restore(snapshot);
    });
    refuses_both("a restored time", [&](double x) {
        auto snapshot = solver.snapshot();
        snapshot.time = x;
        solver.restore(snapshot);
    });
    refuses_both("a duration", [&](double x) { advance(solver, x); });
    refuses_both("a time step", [&](double x) { step(solver, x); });
    refuses_both("gravity", [&](double x) {
        advance(solver, 0.01, {.gravity = {.acceleration = {0, x, 0}}});
    });
    refuses_both("an obstacle's time", [&](double x) {
        Around around;
        around.floor.motion.time = x;
        advance(solver, 0.01, around);
    });

    using Ball = firn::Obstacle<firn::Sphere>;
    refuses_both("a radius", [](double x) { Ball{.shape = {x}}.validate(); });
    refuses_both("a half length", [](double x) { firn::Capsule{1, x}.validate(); });
    refuses_both("a normal", [](double x) { firn::HalfSpace{.normal = {0, x, 0}}.validate(); });
    refuses("a friction", [] { Ball{.contact = firn::Contact::coulomb(nan)}.validate(); });
    Ball{.contact = firn::Contact::coulomb(infinity)}.validate(); // sticks on approach
    refuses_both("a motion's position", [](double x) { Ball{.motion = {.position = {0, 0, x}}}.validate(); });
    refuses_both("a motion's velocity", [](double x) { Ball{.motion = {.velocity = {x, 0, 0}}}.validate(); });
    refuses_both("a spin", [](double x) { Ball{.motion = {.angular_velocity = {0, x, 0}}}.validate(); });
    refuses_both("an orientation", [](double x) {
        Ball ball;
        ball.motion.orientation = {1, x, 0, 0};
        ball.validate();
    });
    refuses_both("a body's mass", [](double x) { firn::RigidBody::ball(1, x); });
    refuses_both("a body's impulse", [](double x) {
        auto ball = firn::RigidBody::ball(1, 1);
        ball.advance({.impulse = {x, 0, 0}}, 0.1, {0, 0, 0});
    });
    refuses_both("a height", [](double x) { firn::HeightField<float, 2>({0}, 0.5f, {3}, {0, float(x), 0}); });
    refuses_both("a distance", [](double x) {
        firn::SignedDistanceGrid<float, 2>({0, 0}, 0.5f, {2, 2}, {0, 1, float(x), 2});
    });

    refuses_both("a cell size", [](double x) { firn::lattice(x); });
    refuses_both("an origin", [](double x) { firn::lattice(1, {0, x, 0}); });
    refuses_both("a FLIP fraction", [](double x) { firn::Flip{.fraction = x}.validate(); });
    refuses_both("Asflip's separation", [](double x) { firn::Asflip{.separation = x}.validate(); });
    refuses_both("the share of an advection", [](double x) { firn::StepControl{.advection = x}.validate(); });
    refuses("a share of a wave", [] { firn::StepControl{.wave = nan}.validate(); });
    refuses("a rejection", [] { firn::StepControl{.rejection = nan}.validate(); });
    refuses("a growth", [] { firn::StepControl{.growth = nan}.validate(); });
}

template <class Model>
void check_parameter(char const* what, typename Model::Number Model::*parameter)
{
    Model model;
    model.validate();
    refuses_both(what, [&](double x) {
        model.*parameter = typename Model::Number(x);
        model.validate();
    });
}

void check_materials()
{
    refuses_both("Young's modulus", [](double x) { firn::lame(x, 0.2); });
    refuses_both("Poisson's ratio", [](double x) { firn::lame(1e5, x); });
    refuses_both("lambda", [](double x) {
        firn::NeoHookean<Space> jelly;
        jelly.elasticity.lambda = float(x);
        jelly.validate();
    });
    refuses_both("an angle", [](double x) { firn::friction_cone(3, x); });
    check_parameter("a density", &firn::NeoHookean<Space>::density);
    using Snow = firn::Snow<Space>;
    check_parameter<Snow>("snow's compression", &Snow::critical_compression);
    check_parameter<Snow>("snow's hardening", &Snow::hardening);
    check_parameter<Snow>("snow's cap", &Snow::smallest_plastic_ratio);
    using Sand = firn::Sand<Space>;
    check_parameter<Sand>("sand's cone", &Sand::cone);
    using Clay = firn::CamClay<Space>;
    check_parameter<Clay>("the slope of Cam-Clay", &Clay::slope);
    check_parameter<Clay>("the cohesion of Cam-Clay", &Clay::cohesion);
    using Metal = firn::HardeningVonMises<Space>;
    check_parameter<Metal>("a yield stress", &Metal::yield_stress);
    using Foam = firn::HerschelBulkley<Space>;
    check_parameter<Foam>("a power", &Foam::power);
    using Water = firn::Fluid<Space>;
    check_parameter<Water>("an exponent", &Water::exponent);
    check_parameter<Water>("a viscosity", &Water::viscosity);
}

void check_steps()
{
    { // the same scene with a stress that is a number goes on
        auto solver = solver_of(1);
        tear(solver);
        step(solver, h);
        step(solver, h);
        check(positions_are_finite(solver), "a scene without NaN");
    }
    for (double const stress : {nan, infinity}) {
        auto solver = solver_of(stress);
        tear(solver);
        check(fails(solver, firn::FailureCause::not_finite, [&] { step(solver, h), step(solver, h); }),
              "a step that makes NaN or infinity is rejected");
        check(fails(solver, firn::FailureCause::not_finite, [&] { advance(solver, 1); }),
              "no shorter step makes it better");
    }
    {
        auto solver = solver_of(nan);
        tear(solver);
        solver.quarantine(300);
        auto const report = advance(solver, 0.02);
        check(!report.isolated.empty() && report.isolated.size() == 400 - solver.size(),
              "particles that become NaN are taken out");
        check(positions_are_finite(solver), "and the others go on");
    }
    { // velocities that overflow on the grid, to infinity less infinity, beside an obstacle that has samples
        auto solver = solver_of(0);
        Velocities velocities(solver.size());
        for (std::size_t i = 0; i < velocities.size(); ++i) {
            float const speed = i % 2 == 0 ? 3e38f : -3e38f;
            velocities[i] = {speed, speed};
        }
        solver.upload<firn::Velocity>(velocities);
        bool failed = false;
        try {
            step(solver, 1e-3);
        }
        catch (firn::StepError const&) {
            failed = true;
        }
        check(failed && positions_are_finite(solver), "displacements that are NaN reject the step");
    }
}

} // namespace

int main()
{
    check_input();
    check_materials();
    check_steps();
    std::printf("%d checks, of which %d fail\n", checks, failures);
    return failures == 0 ? 0 : 1;
}

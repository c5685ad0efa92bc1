// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

using Sheet = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using SnowBall = Scene<Snow<SolidFloat>, CubicBSpline, Flip>::Solver;
constexpr double infinite = std::numeric_limits<double>::infinity();
double const not_a_number = std::numeric_limits<double>::quiet_NaN();

/// A block that has already taken a few steps.
Sheet running_scene(StepControl const& control = {})
{
    Sheet solver(lattice(0.1), {}, {}, control);
    solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025, {0.1, 0});
    for (int i = 0; i < 5; ++i) solver.step(1e-3, Gravity{});
    return solver;
}

/// Whether two scenes are in the same state to the last bit.
template <class Solver>
bool same(Solver const& a, Solver const& b)
{
    return a.time() == b.time() && a.positions() == b.positions() &&
           a.template download<Velocity>() == b.template download<Velocity>() &&
           a.template download<DisplacementGradient>() == b.template download<DisplacementGradient>() &&
           a.ids() == b.ids();
}

/// Says of a particle of a scene that there is something wrong with it: what its F does to the second axis.
void spoil(Sheet& solver, std::size_t particle, double stretch, double shear = 0)
{
    auto H = solver.download<DisplacementGradient>();
    H[particle](1, 1) = stretch - 1;
    H[particle](0, 1) = shear;
    solver.upload<DisplacementGradient>(H);
}

/// The failure of a call that must be stopped by one.
template <class Call>
StepFailure failed(Call const& call)
{
    try {
        call();
    }
    catch (StepError const& error) {
        CHECK(error.what_is_wrong().find("particle " + std::to_string(error.failure().particle) + " " +
                                         describe(error.failure().cause)) == 0);
        return error.failure();
    }
    FAIL("nothing went wrong");
    return {};
}

} // namespace

TEST_CASE("cell sizes, moduli and densities that make no sense are refused")
{
    for (double h : {0.0, -1.0, not_a_number, infinite}) refused([&] { lattice(h); });
    refused([] { lattice(0.1, {not_a_number, 0, 0}); });
    for (double h : {1e-30, 1e30}) refused([&] { SnowBall(lattice(h)); });
    for (double h : {1e-15, 1e15}) SnowBall(lattice(h));
    for (double E : {0.0, -1e5, not_a_number, infinite}) refused([&] { lame(E, 0.3); });
    for (double nu : {0.5, 0.7, -1.0, not_a_number}) refused([&] { lame(1e5, nu); });
    for (double density : {0.0, 1e-42, -400.0, not_a_number, infinite}) {
        Snow<SolidFloat> snow;
        snow.density = static_cast<float>(density);
        CHECK(refused([&] { SnowBall(lattice(0.1), snow); }).remedy().find("kg/m^3") != std::string::npos);
    }
    Snow<SolidFloat> snow;
    snow.critical_compression = -0.1f;
    refused([&] { SnowBall(lattice(0.1), snow); });
    Snow<SolidFloat> softer;
    for (double cap : {1e7, infinite, not_a_number}) {
        softer.largest_plastic_ratio = static_cast<float>(cap);
        CHECK_THAT(refused([&] { SnowBall(lattice(0.1), softer); }).what_is_wrong(),
                   StartsWith("the caps of J_P"));
    }
    CamClay<SolidFloat> soil;
    soil.start = 3e38f;
    CHECK_THAT(refused([&] { soil.validate(); }).what_is_wrong(), StartsWith("alpha at the start"));
    Fluid<SolidFloat> water;
    for (double exponent : {0.5, 1e30, not_a_number}) {
        water.exponent = static_cast<float>(exponent);
        CHECK_THAT(refused([&] { water.validate(); }).what_is_wrong(), StartsWith("the exponent"));
    }
    refused([] { SnowBall(lattice(0.1), {}, Flip{.fraction = 1.5}); });
    auto const names = [](StepControl const& control, char const* member) {
        auto const error = refused([&] { SnowBall(lattice(0.1), {}, {}, control); });
        CHECK(error.what_is_wrong().rfind(member, 0) == 0);
    };
    names({.wave = 0}, "wave");
    names({.advection = 2}, "advection");
    names({.deformation = -1}, "deformation");
    names({.obstacle = not_a_number}, "obstacle");
    names({.growth = 1}, "growth");
    names({.rejection = 1}, "rejection");
    names({.smallest = 1}, "smallest");
    names({.retries = -1}, "retries");
#if defined(__CUDACC__)
    for (int device : {-1, 1000})
        refused([=] { SnowBall(lattice(0.1), {}, {}, {}, Cuda{.device = device}); });
#else
    for (int threads : {-1, 100000}) { // the system may refuse as many: OpenMP would end the process
        refused([=] { SnowBall(lattice(0.1), {}, {}, {}, OpenMP{.threads = threads}); });
        refused([=] { OpenMP{.threads = threads}.for_each(8, [](std::size_t) {}); }); // as samplers do
    }
    int const usual = omp_get_max_threads();
    omp_set_num_threads(100000); // as OMP_NUM_THREADS does
    CHECK(OpenMP{}.thread_count() == OpenMP::most_threads);
    omp_set_num_threads(usual);
#endif
}

TEST_CASE("particles that are not finite, too far or of no volume are refused, and none of them is added")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    using Points = std::vector<Eigen::Vector2d>;
    auto const error = refused([&] { solver.add(Points{{0, 0}, {not_a_number, 0}}, 1e-3); });
    CHECK(error.what_is_wrong().find("point 1") != std::string::npos);
    refused([&] { solver.add(Points{{0, infinite}}, 1e-3); });
    refused([&] { solver.add(Points{{0, 1e30}}, 1e-3); });
    for (double volume : {0.0, -1.0, not_a_number, infinite}) {
        refused([&] { solver.add(Points{{0, 0}}, volume); });
        auto const one = refused([&] {
            solver.add(Points{{0, 0}, {1, 0}, {0, 1}}, std::vector<double>{1e-3, 2e-3, volume});
        });
        CHECK(one.where() == "Solver::add, volume 2");
    }
    CHECK(refused([&] {
              solver.add(Points{{0, 0}}, std::vector<float>{1e-3f, 1e-3f});
          }).what_is_wrong() == "there is not one volume for each point, but 2 for 1");
    refused([&] { solver.add(Points{{0, 0}}, std::vector<double>{}); });
    // densities of particles, where the model's is 1000
    for (double density : {0.0, -2000.0, 999.0, not_a_number, infinite}) {
        refused([&] { solver.add(Points{{0, 0}}, Volumes(1e-3, density)); });
        auto const one = refused([&] {
            solver.add(Points{{0, 0}, {1, 0}}, Volumes(1e-3, std::vector<double>{2000, density}));
        });
        CHECK(one.where() == "Solver::add, density 1");
    }
    refused([&] { solver.add(Points{{0, 0}}, Volumes(1e-3, std::vector<double>{2e3, 2e3})); });
    refused([&] { solver.add(Points{{0, 0}}, Volumes(-1e-3, 2000)); });
    refused([&] { solver.add(Points{{0, 0}}, 1e-3, {not_a_number, 0}); });
    CHECK(solver.size() == untouched.size());
    CHECK(same(solver, untouched));
    solver.step(1e-3, Gravity{}); // and it still runs
}

TEST_CASE("particles that are lighter than others by more than rounding bears are refused")
{
    using Points = std::vector<Eigen::Vector3d>;
    SnowBall solver(lattice(0.1));
    solver.add(Points{{0, 0, 0}}, 1.0);
    refused([&] { solver.add(Points{{1, 0, 0}}, 1e-21); });
    refused([&] { solver.add(Points{{1, 0, 0}}, 1e21); });
    auto const each = [&](double first, double second) {
        return refused([&] { solver.add(Points{{1, 0, 0}, {2, 0, 0}}, std::vector<double>{first, second}); });
    };
    CHECK(each(1, 1e21).where() == "Solver::add, volume 1");
    CHECK(each(1e-8, 1e8).where() == "Solver::add, volume 1"); // than one another
    CHECK(each(1e-21, 1).where() == "Solver::add, volume 0");
    CHECK(solver.size() == 1);
    solver.add(Points{{1, 0, 0}}, 1e-6);
    CHECK(solver.size() == 2);
}

TEST_CASE("a half attempt is half of what was tried, also of the last step of a call")
{
    Sheet solver(lattice(0.05));
    solver.add(box_of_points<2>({0, 0}, {0.1, 0.1}, 0.05), 0.025 * 0.025);
    // the wall would be through the body by the end of the call, and nothing has touched it before
    Obstacle<HalfSpace> const wall{
        .shape = {{1, 0, 0}}, .contact = Contact::sticky(), .motion = {.position = {-0.2, 0, 0}}};
    Obstacle<HalfSpace> rushing = wall;
    rushing.motion.velocity = {1e5, 0, 0};
    auto const report = solver.advance(0.08 / 1e5, rushing);
    CHECK(report.rejected <= 2);
}

TEST_CASE("in two dimensions an obstacle that leaves the plane is refused")
{
    auto solver = running_scene();
    refused([&] { solver.step(1e-3, Obstacle<HalfSpace>{.shape = {{0, 0, 1}}}); });
    refused([&] { solver.step(1e-3, Obstacle<Sphere>{.shape = {1}, .motion = {.velocity = {0, 0, 1}}}); });
    refused([&] {
        solver.step(1e-3, Obstacle<Sphere>{.shape = {1}, .motion = {.angular_velocity = {1, 0, 0}}});
    });
    Eigen::Quaterniond const tilted(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitX()));
    refused([&] { solver.step(1e-3, Obstacle<Sphere>{.shape = {1}, .motion = {.orientation = tilted}}); });
}

TEST_CASE("a particle about to leave the range of cell coordinates is said to escape")
{
    Sheet solver(lattice(1e-3));
    solver.add(std::vector<Eigen::Vector2d>{{999999.99, 0}}, 1e-9, {10, 0});
    auto const error = refused([&] { solver.advance(20.0); });
    CHECK(error.what_is_wrong().find("range of cell coordinates") != std::string::npos);
}

TEST_CASE("steps, effects and uploads that make no sense are refused, and the state stays as it is")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    for (double dt : {0.0, -1.0, not_a_number, infinite}) refused([&] { solver.step(dt); });
    for (double duration : {-1.0, not_a_number, infinite}) refused([&] { solver.advance(duration); });
    CHECK(refused([&] { solver.steps(static_cast<std::size_t>(-1), 1e-3); }).where() == "Solver::steps");
    CHECK(solver.steps(0, 1e-3).empty());
    refused([&] { solver.step(1e-3, Gravity{{0, not_a_number, 0}}); });
    refused([&] { solver.step(1e-3, Gravity{{0, 0, -9.81}}); }); // in the plane
    Motion const turned{.orientation = Eigen::Quaterniond(Eigen::AngleAxisd(1.5, Eigen::Vector3d::UnitX()))};
    refused([&] { solver.remove_if(Inside<Box>{.shape = {{0.2, 0.01, 1}}, .pose = turned}); });
    refused([&] { solver.remove_if(Outside<HalfSpace>{.shape = {{0, 0, 1}}}); });
    CHECK(refused([&] { solver.step(1e-3, Gravity{}, Obstacle<Sphere>{.shape = {-1}}); }).where() ==
          "Sphere, effect 2 of Solver::step");
    refused([&] { solver.step(1e-3, Obstacle<Sphere>{.shape = {1}, .contact = Contact::coulomb(-0.5)}); });
    refused([&] { solver.step(1e-3, Obstacle<HalfSpace>{.shape = {{0, 2, 0}}}); });
    // what steps ask each effect that they are given
    refused([&] { Obstacle<Box>{.shape = {{1, 0, 1}}}.validate(); });
    refused([&] { Obstacle<Capsule>{.shape = {0.1, not_a_number}}.validate(); });
    refused([&] {
        solver.advance(0.1, Obstacle<Sphere>{.shape = {1}, .motion = {.velocity = {not_a_number, 0, 0}}});
    });
    refused([&] { solver.upload<Velocity>({{1, 0}}); });
    refused([&] { solver.upload<Velocity>(std::vector<Eigen::Vector2d>(solver.size(), {not_a_number, 0})); });
    CHECK(same(solver, untouched));
}

TEST_CASE("a step that goes wrong names particle, place, time and cause, and changes nothing")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    auto const error = refused([&] { solver.step(100.0, Gravity{}); });
    CHECK(error.what_is_wrong().find("particle ") == 0);
    CHECK(error.where().find(" m, in a step of ") != std::string::npos);
    CHECK(error.where().find("t = ") != std::string::npos);
    CHECK(error.remedy().find("stable one is ") != std::string::npos);
    CHECK(same(solver, untouched));
    solver.step(1e-3, Gravity{});
    CHECK(solver.time() > untouched.time());
}

TEST_CASE("steps behind one that was far too long are what they would have been without it")
{
    for (double dt : {1.0, 1e6, 1e12, 1e30}) {
        CAPTURE(dt);
        auto solver = running_scene(), untouched = running_scene();
        failed([&] { solver.step(dt, Gravity{}); });
        for (int i = 0; i < 3; ++i) {
            solver.step(1e-3, Gravity{});
            untouched.step(1e-3, Gravity{});
        }
        solver.advance(0.01, Gravity{});
        untouched.advance(0.01, Gravity{});
        // equal but for rounding: scattering once more may sum in another order
        auto const x = solver.positions(), there = untouched.positions();
        auto const v = solver.download<Velocity>(), moves = untouched.download<Velocity>();
        double way = 0, speed = 0;
        for (std::size_t i = 0; i < x.size(); ++i) {
            way = std::max(way, (x[i] - there[i]).norm());
            speed = std::max(speed, (v[i] - moves[i]).norm());
        }
        CHECK(way < 1e-13);
        CHECK(speed < 1e-11);
    }
}

TEST_CASE("a step beyond the stable one is taken, with a warning")
{
    auto solver = running_scene();
    auto const safe = solver.step(1e-4);
    CHECK(!safe.beyond_stable);
    CHECK(safe.stable_dt > 1e-4);
    auto const bold = solver.step(safe.stable_dt * 1.5);
    CHECK(bold.beyond_stable);
}

TEST_CASE("a neo-Hookean body that is turned inside out stops the run with the particle's name")
{
    Sheet solver(lattice(0.1));
    solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025);
    auto H = std::vector<Eigen::Matrix2d>(solver.size(), Eigen::Matrix2d::Zero());
    H[17](0, 0) = -1.5; // det F = -0.5
    solver.upload<DisplacementGradient>(H);
    auto const error = refused([&] { solver.advance(0.01); });
    CHECK(error.what_is_wrong().find("particle 17 was turned inside out") == 0);
}

TEST_CASE("a run that ends in a failed step leaves the last good state, the velocities that particles took "
          "included")
{
    double const speed = 60;
    Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>::Solver solver(
        lattice(0.05), {}, {}, {.deformation = 0.09, .rejection = 0.1, .retries = 0});
    solver.add(box_of_points<2>({0, 0.1}, {0.3, 0.4}, 0.05), 0.025 * 0.025, {0, -speed});
    auto const thrown = Totals(solver);
    CHECK_THAT(refused([&] { solver.advance(0.02, Obstacle<HalfSpace>{}); }).remedy(),
               Contains("last good step, but for velocities"));
    CHECK(solver.time() > 0);
    // the impulse on the floor in the steps that were taken
    auto const& done = solver.until_error();
    REQUIRE(done.reactions.size() == 1);
    CHECK(done.rejected == 1);
    CHECK(done.smallest_dt * double(done.substeps) <= solver.time());
    CHECK(done.largest_dt * double(done.substeps) >= solver.time());
    Eigen::Vector2d const lost = thrown.momentum - Totals(solver).momentum;
    CHECK(lost.norm() > 1e-4 * thrown.momentum.norm());
    CHECK((done.reactions[0].impulse.head<2>() - lost).norm() < 1e-12 * thrown.momentum.norm());
    auto const x = solver.positions();
    auto const v = solver.download<Velocity>();
    for (std::size_t i = 0; i < x.size(); ++i) {
        CHECK(x[i].allFinite());
        if (x[i].y() > 0.25) CHECK(std::abs(v[i].y() + speed) < 1e-6 * speed); // above the shock
    }
    auto const before = Totals(solver);
    solver.step(1e-6);
    CHECK((Totals(solver).momentum - before.momentum).norm() < 1e-12 * before.momentum.norm());
}

TEST_CASE("a body hurled at a wall takes rejected steps, repeats them shorter, and loses nothing")
{
    // bounds before the impact do not foresee it
    double const speed = 60, mass = 0.09 * 1000;
    Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>::Solver solver(
        lattice(0.05), {}, {}, {.deformation = 0.09, .rejection = 0.1});
    solver.add(box_of_points<2>({0, 0.1}, {0.3, 0.4}, 0.05), 0.025 * 0.025, {0, -speed});
    auto const report = solver.advance(0.01, Obstacle<HalfSpace>{});
    CHECK(report.rejected > 0);
    CHECK(report.lost == 0);
    for (auto const& x : solver.positions()) CHECK(x.allFinite());
    double const expected = -speed * mass - report.reactions[0].impulse.y();
    CHECK(std::abs(Totals(solver).momentum.y() - expected) < 1e-10 * speed * mass);
    CHECK(Totals(solver).mass == Approx(mass));
}

TEST_CASE("what went wrong in a step can be read as numbers")
{
    auto solver = running_scene();
    auto const x = solver.positions();
    spoil(solver, 17, -0.5);
    StepFailure const turned = failed([&] { solver.step(1e-4, Gravity{}); });
    CHECK(turned.cause == FailureCause::inverted);
    CHECK(turned.particle == 17);
    CHECK(turned.material == 0);
    CHECK(turned.position.head<2>() == x[17]);
    CHECK(turned.position.z() == 0);
    CHECK(turned.time == solver.time());
    CHECK(turned.dt == 1e-4);
    CHECK(turned.count == 1);
    CHECK(failed([&] { solver.advance(1e-4); }).dt < 1e-4 / 4000); // after twelve halvings

    auto other = running_scene();
    StepFailure const thrown = failed([&] { other.step(100, Gravity{}); });
    CHECK(thrown.cause == FailureCause::rejected);
    CHECK(thrown.dt == 100);
    CHECK(thrown.count == other.size());
}

TEST_CASE("without a limit to deformation steps are taken that would be rejected, but never into nowhere")
{
    refused([] { running_scene({.rejection = 2}); });
    auto shearing = [](double rate, StepControl const& control) {
        auto solver = running_scene(control);
        auto v = solver.download<Velocity>();
        auto const x = solver.positions();
        for (std::size_t i = 0; i < v.size(); ++i) v[i] = {rate * (x[i].y() - 0.2), 0};
        solver.upload<Velocity>(v);
        return solver;
    };
    StepControl const off{.rejection = infinite};
    CHECK(failed([&] { shearing(700, {}).step(1e-3); }).cause ==
          FailureCause::rejected); // dt |L| = 0.7, 0.9 cells
    auto solver = shearing(700, off);
    CHECK(solver.step(1e-3).beyond_stable);
    CHECK(failed([&] { shearing(7000, off).step(1e-3); }).cause ==
          FailureCause::rejected); // by more than a cell
    spoil(solver, 3, 1, 1e200);
    CHECK(failed([&] { solver.step(1e-3); }).cause == FailureCause::not_finite);
}

TEST_CASE("a particle in quarantine is gone, and all others are, bit by bit, as if it had been removed")
{
    for (auto const& [stretch, shear, cause] :
         {std::tuple(-0.5, 0.0, FailureCause::inverted),
          std::tuple(1.0, 1e200, FailureCause::not_finite)}) { // no stress
        auto isolates = running_scene(), removes = running_scene();
        isolates.quarantine(1);
        CHECK(same(isolates, removes)); // and before it makes no difference
        spoil(isolates, 17, stretch, shear);
        removes.upload<DisplacementGradient>(removes.download<DisplacementGradient>());
        auto const x = removes.positions();
        removes.remove_if(Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {x[17].x(), x[17].y(), 0}}});
        auto const report = isolates.step(1e-3, Gravity{});
        removes.step(1e-3, Gravity{});
        CHECK(same(isolates, removes));
        REQUIRE(report.isolated.size() == 1);
        CHECK(report.isolated[0].cause == cause);
        CHECK(report.isolated[0].particle == 17);
        CHECK(report.isolated[0].position.head<2>() == x[17]);
        CHECK(report.isolated[0].count == 1);
        for (auto* of : {&isolates, &removes})
            for (int i = 0; i < 10; ++i) of->step(1e-3, Gravity{});
        CHECK(same(isolates, removes));
        CHECK(isolates.isolated().size() == 1);
    }
}

TEST_CASE("advance goes on at once without particles that have no stress, as it does in an empty scene")
{
    for (auto const& [stretch, shear] : {std::pair(-0.5, 0.0), std::pair(1.0, 1e200)}) {
        auto isolates = running_scene(), without = running_scene();
        isolates.quarantine(stretch < 0 ? std::numeric_limits<std::size_t>::max() : 1); // all of them, or one
        auto const far = isolates.add(std::vector<Eigen::Vector2d>{{5, 5}}, 0.0025);
        spoil(isolates, isolates.size() - 1, stretch, shear);
        without.upload<DisplacementGradient>(without.download<DisplacementGradient>());
        auto const report = isolates.advance(0.05);
        auto const expected = without.advance(0.05);
        REQUIRE(report.isolated.size() == 1);
        CHECK(report.isolated[0].particle == far);
        CHECK(report.rejected <= 1); // halving does not help it
        CHECK(report.substeps == expected.substeps);
        CHECK(same(isolates, without));
    }
}

TEST_CASE("more than may be in quarantine are an error: a scene does not evaporate in silence")
{
    auto solver = running_scene();
    solver.quarantine(3);
    auto const before = solver.size();
    StepFailure const last = failed([&] { solver.step(100, Gravity{}); }); // all of them are wrong
    CHECK(last.cause == FailureCause::rejected);
    CHECK(solver.until_error().substeps == 0);
    CHECK(solver.size() == before - 3);
    REQUIRE(solver.isolated().size() == 3);
    for (auto const& failure : solver.isolated()) CHECK(failure.cause == FailureCause::rejected);
    CHECK_NOTHROW(solver.step(1e-3, Gravity{}));
    CHECK_THAT(refused([&] { solver.step(100, Gravity{}); }).remedy(),
               Contains("of 3 particles that may be in quarantine there are 3"));

    Sheet lone(lattice(0.1));
    lone.quarantine(1); // before there are particles
    lone.add(std::vector<Eigen::Vector2d>{{0, 0}}, 0.0025);
    spoil(lone, 0, -0.5);
    CHECK(lone.step(1e-3, Gravity{}).isolated.size() == 1);
    CHECK(lone.size() == 0);
    CHECK(lone.advance(0.01).substeps > 0);
}

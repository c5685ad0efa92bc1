// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "limits/hard_case.hpp"
#include "support/meshes.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/io/checkpoint.hpp>

#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// Whether two scenes are in the same state to the last bit, in all that can be asked for.
template <class Solver>
bool same(Solver const& a, Solver const& b)
{
    bool all = a.size() == b.size() && a.time() == b.time() && a.ids() == b.ids() &&
               a.positions() == b.positions() && a.masses() == b.masses();
    auto const& p = a.bounds();
    auto const& q = b.bounds();
    all = all && p.wave_speed == q.wave_speed && p.material == q.material && p.speed == q.speed &&
          p.deformation_rate == q.deformation_rate && p.acceleration == q.acceleration &&
          p.obstacle_speed == q.obstacle_speed;
    auto const compare = [&](auto k) {
        using Which = Material<k>;
        for_each_tag(typename Solver::template MaterialTraits<Which>::State{}, [&](auto tag) {
            using Tag = decltype(tag);
            all = all && a.template download<Tag, Which>() == b.template download<Tag, Which>();
        });
    };
    [&]<std::size_t... k>(std::index_sequence<k...>)
    {
        (compare(std::integral_constant<std::size_t, k>{}), ...);
    }
    (std::make_index_sequence<Solver::materials>{});
    return all;
}

/// The place of the last material.
template <class Solver>
using Last = Material<Solver::materials - 1>;

template <class SceneType>
typename SceneType::Solver new_solver([[maybe_unused]] int threads)
{
    typename SceneType::Solver::Transfer transfer;
    typename SceneType::Solver::Model model;
    Eigen::Vector3d const origin(0.1, -0.2, 0.3);
#if defined(FIRN_TESTS_ON_OPENMP)
    return typename SceneType::Solver(lattice(0.05, origin), model, transfer, {},
                                      typename SceneType::Backend{.threads = threads});
#else
    return typename SceneType::Solver(lattice(0.05, origin), model, transfer);
#endif
}

/// Bodies of several masses that hit the floor. A part is then removed, so that ids are not rows, and blocks
/// have been created and removed.
template <class SceneType>
typename SceneType::Solver scene(int threads)
{
    constexpr int d = SceneType::d;
    using Solver = typename SceneType::Solver;
    double const h = 0.05;
    Solver solver = new_solver<SceneType>(threads);
    Vector<double, d> const low = Vector<double, d>::Constant(0.011);
    Vector<double, d> v = Vector<double, d>::Constant(0.7), across = Vector<double, d>::Zero();
    v[1] = -3;
    across[0] = 0.31;
    auto const box = box_of_points<d>(low, low + Vector<double, d>::Constant(0.25), h);
    auto other = scattered<d>(box, 0.2 * h);
    for (auto& x : other) x += across;
    solver.template add<Material<0>>(box, std::pow(h / 2, d), v);
    std::vector<double> volumes;
    for (std::size_t i = 0; i < other.size(); ++i)
        volumes.push_back((2 + 0.25 * double(i % 4)) * std::pow(h / 2, d));
    solver.template add<Last<Solver>>(other, volumes, -0.5 * v);
    using Stored = typename Solver::template MaterialTraits<Material<0>>::State;
    if constexpr (Stored::template contains<Stiffness>) {
        std::vector<typename SceneType::Number> factors(solver.size());
        for (std::size_t i = 0; i < factors.size(); ++i)
            factors[i] = static_cast<typename SceneType::Number>(1 + 0.3 * std::sin(double(i)));
        solver.template upload<Stiffness>(factors);
    }
    return solver;
}

Obstacle<HalfSpace> const floor_of_scene{.contact = Contact::coulomb(0.4)};
Obstacle<Sphere> const ball_of_scene{
    .shape = {0.1},
    .motion = {.position = {0.2, 0.05, 0.1}, .velocity = {1, 0, 0}, .time = 0},
    .on_particles = true};

/// Goes on in all the ways there are: steps of the solver's own length and of mine, particles that come and
/// go.
template <class Solver>
std::vector<double> run_on(Solver& solver, int rounds)
{
    constexpr int d = Solver::d;
    std::vector<double> told;
    for (int i = 0; i < rounds; ++i) {
        AdvanceReport const report = solver.advance(3e-3, Gravity{}, floor_of_scene, ball_of_scene);
        told.insert(told.end(), {double(report.substeps), report.smallest_dt, report.largest_dt});
        for (auto const& reaction : report.reactions)
            for (int a = 0; a < 3; ++a) told.push_back(reaction.impulse[a]);
        solver.steps(3, 1e-4, Gravity{}, floor_of_scene,
                     ball_of_scene); // the same types of effects: each set of types costs compile time
        if (i % 3 == 1) {
            Vector<double, d> const high = Vector<double, d>::Constant(0.45 + 0.05 * i);
            told.push_back(solver.template add<Last<Solver>>(
                box_of_points<d>(high, high + Vector<double, d>::Constant(0.1), 0.05), 1e-5));
        }
        if (i % 4 == 2) told.push_back(double(solver.remove_if(OnTheLeft{0.02 * i})));
    }
    return told;
}

std::vector<int> const thread_counts =
#if defined(FIRN_TESTS_ON_OPENMP)
    {1, 2};
#else
    {1};
#endif

} // namespace

using Cases = Combinations<Scene<HardeningVonMises<Plane>, QuadraticBSpline, Apic>,
                           Scene<Heterogeneous<Snow<SolidFloat>>, CubicBSpline, Flip>,
                           Scene<Materials<Sand<PlaneFloat>, Fluid<PlaneFloat>>, QuadraticBSpline, Asflip>>;

TEST_CASE("a checkpoint in memory or in a stream is the one of a file")
{
    using InPlane = Scene<Snow<Plane>, QuadraticBSpline, Mls>;
    meshes::Folder const folder;
    auto solver = scene<InPlane>(1), other = new_solver<InPlane>(1);
    run_on(solver, 2);
    write_checkpoint(folder / "run.firn", solver, 7);
    std::string const bytes = checkpoint_in_memory(solver, 7);
    std::ifstream file(folder / "run.firn", std::ios::binary);
    CHECK((bytes == std::string(std::istreambuf_iterator<char>(file), {})));
    int frame = 0;
    restore_from_memory(bytes, other, frame);
    CHECK(frame == 7);
    CHECK(same(solver, other));

    std::stringstream stream(std::ios::in | std::ios::out | std::ios::binary);
    stream << "before";
    write_checkpoint(stream, solver, 8); // two, one behind the other
    run_on(solver, 1);
    write_checkpoint(stream, solver, 9);
    stream.ignore(6);
    read_checkpoint(stream, other, frame);
    CHECK(frame == 8);
    CHECK(!same(solver, other));
    read_checkpoint(stream, other, frame);
    CHECK(frame == 9);
    CHECK(same(solver, other));

    auto const before = other.positions();
    refused([&] { read_checkpoint(stream, other, frame); }); // there are no more
    refused([&] { restore_from_memory(bytes + "x", other, frame); });
    for (std::size_t const cut : {std::size_t(0), std::size_t(20), std::size_t(32), bytes.size() - 1}) {
        refused([&] { restore_from_memory(bytes.substr(0, cut), other, frame); });
        std::istringstream short_one(bytes.substr(0, cut));
        refused([&] { read_checkpoint(short_one, other, frame); });
    }
    CHECK(frame == 9);
    CHECK((other.positions() == before));
}

TEMPLATE_LIST_TEST_CASE("a run that goes on from a file is the run that wrote it, bit by bit", "", Cases)
{
    meshes::Folder const folder;
    auto const path = folder / "run.firn";
    std::vector<double> of_one_thread;
    for (int const threads : thread_counts) {
        auto solver = scene<TestType>(threads);
        run_on(solver, 4);
        auto restarted =
            new_solver<TestType>(thread_counts.back() + 1 - threads); // the others, where there are
        RigidBody const ball = RigidBody::ball(0.1, 3, {.position = {1, 2, 3}, .time = solver.time()});
        RigidBody same_ball;
        Motion const pose{.position = {0, 4, 0}}; // without a time
        Motion same_pose{.time = 3};
        int frame = 0;
        write_checkpoint(path, solver, ball, pose, 17);
        read_checkpoint(path, restarted, same_ball, same_pose, frame);
        CHECK(frame == 17);
        CHECK(same_ball.mass == ball.mass);
        CHECK(same_ball.inertia == ball.inertia);
        CHECK(same_ball.motion.position == ball.motion.position);
        CHECK(same_ball.motion.time == solver.time());
        CHECK(same_pose.position == pose.position);
        CHECK(!same_pose.time.has_value());
        CHECK(same(solver, restarted));
        auto const once = solver.snapshot(), theirs = restarted.snapshot(); // changes nothing in either
        CHECK(once.previous > 0);                                           // how fast steps may grow
        CHECK(solver.snapshot().previous == once.previous);
        CHECK(theirs.previous == once.previous);
        CHECK(theirs.next_id == once.next_id);
        auto const told = run_on(solver, 6), told_again = run_on(restarted, 6);
        CHECK(told == told_again);
        CHECK(same(solver, restarted));
        HardCase{"H25"}.at_most(std::string(TestType::Solver::Transfer::name) + " in " +
                                    std::to_string(TestType::d) + "D from " + std::to_string(threads) +
                                    " to " + std::to_string(thread_counts.back() + 1 - threads) +
                                    " threads: restarts that are not the run that wrote",
                                !(told == told_again && same(solver, restarted)), 0);
        if (of_one_thread.empty()) of_one_thread = told;
        CHECK(told == of_one_thread);
        // and once more, into a solver that has gone on
        write_checkpoint(path, solver, ball, 18);
        run_on(restarted, 1);
        read_checkpoint(path, restarted, same_ball, frame);
        CHECK(same(solver, restarted));
        CHECK(run_on(solver, 3) == run_on(restarted, 3));
        CHECK(same(solver, restarted));
    }
}

TEMPLATE_LIST_TEST_CASE(
    "writing a checkpoint changes nothing of what particles have: they give afresh, as after upload", "",
    Cases)
{
    meshes::Folder const folder;
    auto solver = scene<TestType>(1), other = scene<TestType>(1);
    auto const steps = [](auto& of, int count) {
        for (int i = 0; i < count; ++i) of.step(1e-4, Gravity{}, floor_of_scene, ball_of_scene);
    };
    steps(solver, 20);
    steps(other, 20);
    CHECK(same(solver, other));
    write_checkpoint(folder / "a.firn", solver);
    CHECK(same(solver, other));
#if !defined(__CUDACC__) // a device numbers its blocks of cells anew, which changes the order of sums
    using Solver = typename TestType::Solver;
    other.template upload<Velocity, Material<0>>(other.template download<Velocity, Material<0>>());
    if constexpr (Solver::materials > 1)
        other.template upload<Velocity, Last<Solver>>(other.template download<Velocity, Last<Solver>>());
    steps(solver, 5);
    steps(other, 5);
    CHECK(same(solver, other));
#endif
}

TEST_CASE("a scene without particles, and one that has lost them, can be written and go on")
{
    using Of = Scene<HardeningVonMises<Plane>, QuadraticBSpline, Apic>;
    meshes::Folder const folder;
    auto const path = folder / "empty.firn";
    for (bool const had_some : {false, true}) {
        auto solver = had_some ? scene<Of>(1) : new_solver<Of>(1);
        if (had_some) solver.remove_if(OnTheLeft{1e9});
        CHECK(solver.size() == 0);
        solver.step(1e-4, Gravity{}, floor_of_scene, ball_of_scene);
        write_checkpoint(path, solver);
        auto restarted = scene<Of>(1);
        read_checkpoint(path, restarted);
        CHECK(same(solver, restarted));
        for (auto* const each : {&solver, &restarted}) {
            each->step(1e-4, Gravity{}, floor_of_scene, ball_of_scene);
            CHECK(each->add(std::vector<Eigen::Vector2d>{{0, 1}, {0.01, 1.02}}, 1e-3) ==
                  (had_some ? 200 : 0));
            each->advance(1e-2, Gravity{}, floor_of_scene, ball_of_scene);
        }
        CHECK(same(solver, restarted));
    }
}

TEST_CASE("two-way coupling goes on from a file with the body that was kept beside it")
{
    using Of = Scene<HardeningVonMises<Plane>, QuadraticBSpline, Apic>;
    meshes::Folder const folder;
    auto const path = folder / "coupled.firn";
    auto const couple = [](Of::Solver& solver, RigidBody& ball, int times) {
        for (int i = 0; i < times; ++i) {
            Obstacle<Sphere> const sphere{.shape = {0.1},
                                          .contact = Contact::coulomb(0.5),
                                          .motion = ball.motion,
                                          .on_particles = true};
            auto const report = solver.advance(1e-3, Gravity{}, Obstacle<HalfSpace>{}, sphere);
            ball.advance(report.reactions[1], 1e-3, Gravity{}.acceleration);
        }
    };
    auto solver = scene<Of>(1), restarted = new_solver<Of>(1);
    RigidBody ball = RigidBody::ball(0.1, 5, {.position = {0.15, 0.4, 0}, .velocity = {0, -2, 0}, .time = 0}),
              other;
    couple(solver, ball, 30);
    write_checkpoint(path, solver, ball);
    read_checkpoint(path, restarted, other);
    couple(solver, ball, 30);
    couple(restarted, other, 30);
    CHECK(same(solver, restarted));
    CHECK(ball.motion.velocity == other.motion.velocity);
    CHECK(ball.motion.angular_velocity == other.motion.angular_velocity);
    CHECK(ball.motion.orientation.coeffs() == other.motion.orientation.coeffs());
    CHECK(ball.motion.velocity.y() > -2); // it was pushed
}

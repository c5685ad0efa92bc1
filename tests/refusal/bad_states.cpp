// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <algorithm>

using namespace firn;
using namespace firn::test;

namespace
{

/// A share of what there was, of a user's own.
struct Soundness
{
    static constexpr auto name = "soundness";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr double at_rest = 0.75;
    static constexpr FieldRange range{.at_least = 0, .at_most = 1};
};

/// A user's own material: as stiff as it is sound. Compressed by more than it bears, the less the less
/// sound it is, it has no stress that is a number, though all it stores is one.
template <class SpaceType>
struct Rotten
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<DisplacementGradient, Soundness>;
    static constexpr int d = Space::dimension;
    Number density = 100; // [kg/m^3]
    Number bears = std::numeric_limits<Number>::infinity();

    void validate() const {}

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, d> respond(Particle& state, Matrix<Real, d> const& L, Real dt) const
    {
        auto& H = state[DisplacementGradient{}];
        H = deformed<Real, d>(H, L, dt);
        Real modulus = state[Soundness{}] * Real(Number(1e4));
        Real const infinite(std::numeric_limits<Number>::infinity());
        modulus = select(H(0, 0) + Real(bears) * state[Soundness{}] < Real(0), infinite, modulus);
        return {(H + H.transpose()) * modulus, Real(3) * modulus, no_lanes<Real>(), no_lanes<Real>()};
    }
};

constexpr double cell = 0.1;

template <class Model>
auto block(Model const& model = {}, Eigen::Vector2d const& low = {0, 0})
{
    using Solver = typename Scene<Model, QuadraticBSpline, Mls>::Solver;
    Solver solver(lattice(cell), model);
    solver.add(box_of_points<2>(low, low + Eigen::Vector2d(0.4, 0.4), cell), cell * cell / 4);
    return solver;
}

/// What is said to an upload of a value that particle 3 has, and to a snapshot with it, which change nothing.
template <class Tag, class Model>
std::string refusal_of(double value, Model const& model = {})
{
    auto solver = block(model);
    auto const before = solver.template download<Tag>();
    auto values = before;
    for_each_component<Tag, 2>(values[3], [&](int c, auto& component) { // of a matrix the first
        if (c == 0) component = static_cast<typename Model::Space::Scalar>(value);
    });
    auto const error = refused([&] { solver.template upload<Tag>(values); });
    CHECK(error.where().starts_with("Solver::upload, value 3"));
    auto snapshot = solver.snapshot();
    for (auto& field : snapshot.materials[0].fields)
        if (field.name == Tag::name)
            field.components[0][3] = static_cast<typename Model::Space::Scalar>(value);
    CHECK(refused([&] { solver.restore(snapshot); }).what_is_wrong() == error.what_is_wrong());
    CHECK(solver.template download<Tag>() == before);
    return error.what_is_wrong();
}

} // namespace

TEST_CASE("values that a field cannot have are neither uploaded nor restored")
{
    CHECK(refusal_of<PlasticVolumeRatio, Snow<Plane>>(0) ==
          "a value of 'plastic_volume_ratio' is not above 0");
    CHECK(refusal_of<PlasticVolumeRatio, Snow<PlaneFloat>>(-3) ==
          "a value of 'plastic_volume_ratio' is not above 0");
    CHECK(refusal_of<EquivalentPlasticStrain, HardeningVonMises<Plane>>(-1) ==
          "a value of 'equivalent_plastic_strain' is below 0");
    CHECK(refusal_of<LooseVolume, Sand<Plane>>(-1e-9) == "a value of 'loose_volume' is below 0");
    auto sand = block<Sand<Plane>>();
    CHECK_NOTHROW(sand.upload<LooseVolume>(std::vector<double>(sand.size(), 0.0)));
}

TEST_CASE("states from which a material cannot go on are neither uploaded nor restored")
{
    Fluid<Plane> water;
    for (double log_J : {30.0, 1e-5})
        CHECK(refusal_of<LogVolumeRatio>(log_J, water) ==
              "a volume ratio of e^" + std::to_string(log_J) + " is above 1: this fluid parts instead");
    water.parts = false;
    for (double log_J : {0.7, 30.0, 800.0})
        CHECK(refusal_of<LogVolumeRatio>(log_J, water) ==
              "a volume ratio of e^" + std::to_string(log_J) + " is beyond that of any fluid");
    CHECK(refusal_of<LogVolumeRatio>(-200, water) ==
          "a volume ratio of e^-200.000000 gives the fluid a pressure without bounds");
    CHECK_THAT((refusal_of<LogPlasticVolumeRatio, CamClay<Plane>>(-300)), StartsWith("an alpha of -300.01"));
    CHECK_THAT((refusal_of<EquivalentPlasticStrain, HardeningVonMises<Plane>>(1e306)),
               StartsWith("an equivalent plastic strain of 1"));
    CHECK_THAT((refusal_of<Stiffness, Heterogeneous<Sand<PlaneFloat>>>(1e35)), StartsWith("a stiffness of"));
    CHECK(refusal_of<DisplacementGradient, Heterogeneous<Snow<Plane>>>(-1.5) == // as the model itself
          "an elastic volume ratio of -0.500000 is not above 0");
    CHECK(refusal_of<DisplacementGradient, Snow<Plane>>(-1.5) ==
          "an elastic volume ratio of -0.500000 is not above 0");
    for (double stretch : {1e6, 1e-7})
        CHECK_THAT((refusal_of<DisplacementGradient, Snow<PlaneFloat>>(stretch - 1)),
                   StartsWith("elastic stretches are further apart"));
    // what they can bear, the next step does
    auto solver = block(water);
    solver.upload<LogVolumeRatio>(std::vector<double>(solver.size(), -1.0));
    CHECK(std::isfinite(solver.bounds().wave_speed));
    CHECK(solver.bounds().wave_speed == Approx(std::sqrt(2e5 * std::exp(6.0) / 1000)));
    CamClay<Plane> soil;
    soil.start = -300;
    CHECK_THAT(refused([&] { soil.validate(); }).what_is_wrong(), StartsWith("alpha at the start"));
    soil.start = -0.16; // of -0.1604
    CHECK_NOTHROW(soil.validate());
    soil.start = -1;
    soil.hardening = 0;
    CHECK_NOTHROW(soil.validate());
}

TEST_CASE("a user's own field states its value at rest, and its range")
{
    auto solver = block<Rotten<PlaneFloat>>();
    for (float const sound : solver.download<Soundness>()) CHECK(sound == 0.75f);
    CHECK(solver.bounds().wave_speed == Approx(std::sqrt(3 * 0.75e4 / 100)));
    CHECK(refusal_of<Soundness, Rotten<PlaneFloat>>(1.5) == "a value of 'soundness' is above 1");
    CHECK(refusal_of<Soundness, Rotten<PlaneFloat>>(-0.5) == "a value of 'soundness' is below 0");
    solver.upload<Soundness>(std::vector<float>(solver.size(), 1.0f));
    CHECK(solver.bounds().wave_speed == Approx(std::sqrt(3e4 / 100)));
}

TEST_CASE("what is uploaded leaves the next step the bounds that only a step finds")
{
    auto solver = block<Rotten<Plane>>();
    auto velocities = solver.download<Velocity>();
    auto const points = solver.positions();
    for (std::size_t i = 0; i < points.size(); ++i) velocities[i] = {40 * points[i].x(), 0};
    solver.upload<Velocity>(velocities);
    solver.step(1e-5, Obstacle<HalfSpace>{.motion = {.position = {0, 0.1, 0}, .velocity = {7, 0, 0}}});
    auto const found = solver.bounds();
    CHECK(found.deformation_rate > 20);
    CHECK(found.obstacle_speed == Approx(7));
    solver.upload<Soundness>(std::vector<double>(solver.size(), 0.5));
    CHECK(solver.bounds().deformation_rate >= found.deformation_rate);
    CHECK(solver.bounds().obstacle_speed == found.obstacle_speed);
    Eigen::Matrix2d const faster{{0, 1000}, {0, 0}};
    solver.upload<AffineVelocity>(std::vector<Eigen::Matrix2d>(solver.size(), faster));
    CHECK(solver.bounds().deformation_rate == Approx(1000));
}

TEST_CASE("particles behind a reflecting wall, or across it, are refused, whenever they come there")
{
    ReflectingWall const floor{.axis = 1}, ceiling{.axis = 1, .side = -1}, left{.axis = 0};
    for (double low : {-0.5, -0.2}) { // all behind; half of them
        auto solver = block<NeoHookean<Plane>>({}, {0, low});
        auto const before = solver.positions();
        for (int call = 0; call < 2; ++call) {
            auto const error = refused([&] { solver.advance(0.01, Gravity{}, floor); });
            CHECK_THAT(error.what_is_wrong(), StartsWith("particle 0 and "));
            CHECK_THAT(error.what_is_wrong(), Contains(" behind a reflecting wall"));
            CHECK_THAT(error.where(), Contains("across axis 1 at node 0"));
        }
        CHECK(solver.time() == 0);
        CHECK((solver.positions() == before));
        CHECK_NOTHROW(solver.step(1e-5, left));
    }
    auto solver = block<NeoHookean<Plane>>();
    CHECK_NOTHROW(solver.step(1e-5, floor, left));
    refused([&] { solver.step(1e-5, ceiling); });
    // particles that come later
    solver.add(std::vector<Eigen::Vector2d>{{0.1, 0.5}, {0.2, -0.002}}, 1e-3);
    auto const error = refused([&] { solver.step(1e-5, floor, left); });
    CHECK(error.what_is_wrong() == "particle 65 is behind a reflecting wall");
    solver.remove_if(Inside<HalfSpace>{});
    CHECK_NOTHROW(solver.step(1e-5, floor, left));
    // a body that left while there was no wall
    auto falling = block<NeoHookean<Plane>>();
    CHECK_NOTHROW(falling.step(1e-5, floor));
    auto const snapshot = falling.snapshot();
    falling.advance(0.3, Gravity{});
    refused([&] { falling.step(1e-5, floor); });
    falling.restore(snapshot);
    CHECK_NOTHROW(falling.step(1e-5, floor));
}

TEST_CASE("nothing bounds the steps of a scene without particles")
{
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05));
    auto const report =
        solver.advance(1e6, Gravity{}, Obstacle<Sphere>{.shape = {0.1}, .motion = {.velocity = {1e3, 0, 0}}});
    CHECK(report.substeps < 1000);
    CHECK(solver.time() == Approx(1e6));
    // for new particles steps are as short as ever, and begin with the forces of their own length
    solver.add(std::vector<Eigen::Vector2d>{{0, 1}}, 1e-3, {0, 0});
    CHECK(solver.step(1e-6, Gravity{}).time_of_forces == Approx(1e-6));
    CHECK(solver.advance(1e-2, Gravity{{0, -1e6, 0}}).limited_by[int(StepLimit::acceleration)] > 0);
    // the last particle is isolated in the middle of a call
    solver.upload<DisplacementGradient>({Eigen::Matrix2d{{-3, 0}, {0, 0}}});
    solver.quarantine(1);
    auto const last = solver.advance(1e6, Gravity{}, Obstacle<Sphere>{.motion = {.velocity = {1e3, 0, 0}}});
    CHECK(last.isolated.size() == 1);
    CHECK(last.substeps < 1000);
}

TEST_CASE("bounds found for particles that are gone, or were changed, hold no step up")
{
    auto const hasty = [] { // no step of it gets on
        auto solver = block<NeoHookean<Plane>>();
        std::vector<Eigen::Matrix2d> rates(solver.size(), Eigen::Matrix2d::Zero());
        rates[5] << 0, 1e14, 0, 0;
        solver.upload<AffineVelocity>(rates);
        return solver;
    };
    auto stands = hasty();
    CHECK_THAT(refused([&] { stands.advance(1e-2); }).what_is_wrong(),
               Contains("since particle 5 is too fast"));
    auto removed = hasty();
    auto const where = removed.positions()[5];
    CHECK(removed.remove_if(Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {where[0], where[1], 0}}}) ==
          1);
    CHECK(removed.advance(1e-2).substeps < 100);
    auto corrected = hasty();
    corrected.upload<AffineVelocity>(std::vector<Eigen::Matrix2d>(corrected.size(), Eigen::Matrix2d::Zero()));
    auto restored = block<NeoHookean<Plane>>();
    restored.restore(corrected.snapshot());
    CHECK(corrected.advance(1e-2).substeps < 100);
    CHECK(restored.advance(1e-2).substeps < 100);
    // but particles that an effect stops keep them
    auto stopped = hasty();
    stopped.upload<AffineVelocity>(std::vector<Eigen::Matrix2d>(stopped.size(), Eigen::Matrix2d::Zero()));
    auto const before = stopped.bounds();
    refused([&] {
        stopped.advance(1, Obstacle<Sphere>{.motion = {.position = {9, 9, 0}, .velocity = {1e14, 0, 0}}});
    });
    CHECK(stopped.bounds().deformation_rate == before.deformation_rate);
    auto isolated = hasty();
    isolated.quarantine(1);
    auto const report = isolated.advance(1e-2);
    REQUIRE(report.isolated.size() == 1);
    CHECK(report.isolated[0].particle == 5);
    CHECK(report.substeps < 100);
    auto emptied = hasty();
    emptied.remove_if(Outside<Sphere>{.shape = {1e-6}, .pose = {.position = {9, 9, 0}}});
    CHECK(emptied.size() == 0);
    CHECK(emptied.bounds().deformation_rate == 0);
    CHECK(emptied.advance(1).substeps < 10);
}

TEST_CASE("a particle without a stress is named, not those that fail because of it")
{
    auto const wrong = [](auto solver) {
        auto states = solver.template download<DisplacementGradient>();
        states[7](0, 0) = 1e200;
        solver.template upload<DisplacementGradient>(states);
        try {
            solver.step(1e-5);
        }
        catch (StepError const& error) {
            CHECK(error.failure().count > 1);
            return error.failure().particle;
        }
        FAIL("nothing went wrong");
        return std::uint32_t{};
    };
    CHECK(wrong(block<NeoHookean<Plane>>()) == 7);
    CHECK(wrong(block<Sand<Plane>>()) == 7);
}

TEST_CASE("a state that flying sand comes to is restored")
{
    auto sand = block<Sand<PlaneFloat>>();
    sand.upload<LooseVolume>(std::vector<float>(sand.size(), 100)); // a grain that spreads for seconds
    auto again = block<Sand<PlaneFloat>>();
    again.restore(sand.snapshot());
    CHECK(again.download<LooseVolume>() == sand.download<LooseVolume>());
}

TEST_CASE("a time that would be lost to rounding is refused: no caller waits for it in vain")
{
    auto solver = block<NeoHookean<Plane>>();
    CHECK(solver.advance(1e-20).substeps == 1); // there is none yet beside which it were lost
    solver.step(1e-5);
    double const now = solver.time();
    for (double lost : {1e-300, 1e-22}) {
        CHECK_THAT(refused([&] { solver.advance(lost); }).what_is_wrong(), Contains("too short"));
        refused([&] { solver.step(lost); });
    }
    CHECK(solver.time() == now);
    auto old = solver.snapshot();
    old.time = 0x1p53 - 2; // [s]: there are no odd numbers from the end of the second step on
    auto late = block<NeoHookean<Plane>>();
    late.restore(old);
    late.remove_if(Outside<Sphere>{.shape = {1e-6}}); // particles that move by a cell would be an error, too
    CHECK_THAT(refused([&] { late.steps(5, 1); }).what_is_wrong(), Contains("too short"));
    CHECK(late.time() == 0x1p53);
    CHECK(solver.advance(0).substeps == 0);
    CHECK_NOTHROW(solver.advance(1e-20)); // an ulp of 1e-5 is 2e-21
    auto single = block<NeoHookean<PlaneFloat>>();
    refused([&] { single.advance(1e-40); }); // a float of it has few bits, or none
    CHECK_NOTHROW(single.advance(1e-20));
    single.advance(1e-3);
    refused([&] { single.advance(1e-20); });
}

TEST_CASE("a particle with a stress that is no number is named, or taken out, before others gather it")
{
    using Solver = Scene<Rotten<Plane>, QuadraticBSpline, Mls>::Solver;
    std::uint32_t const weakest = 30;
    auto const scene = [&] {
        Rotten<Plane> material;
        material.bears = 0.5;
        Solver solver(lattice(cell), material);
        solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, cell), cell * cell / 4);
        auto sound = solver.download<Soundness>();
        sound[weakest] = 0.1; // it bears a compression by 5 per cent
        solver.upload<Soundness>(sound);
        std::vector<Eigen::Vector2d> velocities;
        for (auto const& x : solver.positions()) velocities.emplace_back(-10 * (x.x() - 0.2), x.x() * x.y());
        solver.upload<Velocity>(velocities);
        return solver;
    };
    auto stops = scene();
    auto const error = refused([&] { stops.steps(20, 1e-3); });
    CHECK(error.what_is_wrong() == "particle 30 has a state that is not finite");

    auto isolates = scene(), removes = scene();
    isolates.quarantine(1);
    int before = 0;
    while (isolates.step(1e-3).isolated.empty() && before < 20) ++before;
    CHECK(before > 1);
    REQUIRE(isolates.isolated().size() == 1);
    CHECK(isolates.isolated()[0].particle == weakest);
    CHECK(isolates.isolated()[0].cause == FailureCause::not_finite);
    CHECK(isolates.isolated()[0].time == Approx(before * 1e-3));
    for (int i = 0; i < before; ++i) removes.step(1e-3);
    removes.remove_if(Inside<Sphere>{.shape = {1e-6}, .pose = {.position = isolates.isolated()[0].position}});
    removes.step(1e-3);
    auto const alike = [&] {
        return isolates.ids() == removes.ids() && isolates.positions() == removes.positions() &&
               isolates.download<Velocity>() == removes.download<Velocity>() &&
               isolates.download<DisplacementGradient>() == removes.download<DisplacementGradient>();
    };
    CHECK(alike());
    isolates.steps(20, 1e-3);
    removes.steps(20, 1e-3);
    CHECK(alike());
    auto queued = scene(); // in the midst of steps that a device does not wait for
    queued.quarantine(1);
    auto const reports = queued.steps(static_cast<std::size_t>(before) + 21, 1e-3);
    CHECK(reports[static_cast<std::size_t>(before)].isolated.size() == 1);
    CHECK((queued.positions() == isolates.positions()));

    // steps that follow the bound shrink before it as before a wall; the error or the report still names the
    // particle
    auto shrinks = scene(), goes_on = scene();
    auto const advance = [](Solver& solver) {
        for (int i = 0; i < 20; ++i) solver.advance(1e-3);
    };
    try {
        advance(shrinks);
        FAIL("nothing went wrong");
    }
    catch (StepError const& failed) {
        CHECK(failed.failure().particle == weakest);
        CHECK_THAT(failed.what_is_wrong(), Contains("particle 30"));
    }
    goes_on.quarantine(1);
    CHECK_NOTHROW(advance(goes_on));
    REQUIRE(goes_on.isolated().size() == 1);
    CHECK(goes_on.isolated()[0].particle == weakest);

    auto two = scene(); // the last particle is as weak, and rows have changed when it fails
    auto sound = two.download<Soundness>();
    sound.back() = sound[weakest];
    two.upload<Soundness>(sound);
    two.quarantine(2);
    CHECK_NOTHROW(advance(two));
    std::vector<std::size_t> gone;
    for (auto const& failure : two.isolated()) gone.push_back(failure.particle);
    std::sort(gone.begin(), gone.end());
    CHECK(gone == std::vector<std::size_t>{weakest, sound.size() - 1});
}

TEST_CASE("a particle that is far too fast is taken out, and not those that it carries along")
{
    auto solver = block<NeoHookean<Plane>>();
    std::size_t const count = solver.size();
    solver.quarantine(1);
    std::vector<Eigen::Vector2d> velocities(count, Eigen::Vector2d::Zero());
    auto const fast = static_cast<std::uint32_t>(count / 2);
    velocities[fast] = {1e5, 0};
    solver.upload<Velocity>(velocities);
    auto const isolated = solver.step(1e-3).isolated;
    REQUIRE(isolated.size() == 1);
    CHECK(isolated[0].particle == fast);
    CHECK(solver.size() == count - 1);
}

TEST_CASE("a particle so fast that no step gets on is named, or taken out")
{
    auto const scene = [](double speed) {
        auto solver = block<NeoHookean<Plane>>();
        solver.advance(1e-3);
        std::vector<Eigen::Vector2d> velocities(solver.size(), Eigen::Vector2d::Zero());
        velocities[17] = {0, speed};
        solver.upload<Velocity>(velocities);
        return solver;
    };
    for (double speed : {1e14, 1e200}) { // of the smallest share of what is asked for; beside the time
        auto stops = scene(speed);
        auto const x = stops.positions();
        double const time = stops.time();
        StepFailure failure;
        try {
            stops.advance(1e-2);
            FAIL("nothing went wrong");
        }
        catch (StepError const& error) {
            failure = error.failure();
            CHECK_THAT(error.what_is_wrong(),
                       Contains("bounded by advection, since particle 17 is too fast"));
        }
        CHECK(failure.cause == FailureCause::stalled);
        CHECK(failure.particle == 17);
        CHECK(failure.position.head<2>() == x[17]);
        CHECK(failure.time == time);
        CHECK(failure.dt < 1e-14);
        CHECK((stops.positions() == x));

        auto goes_on = scene(speed), without = scene(0);
        goes_on.quarantine(1);
        without.remove_if(Inside<Sphere>{.shape = {1e-6}, .pose = {.position = failure.position}});
        auto const report = goes_on.advance(1e-2);
        REQUIRE(report.isolated.size() == 1);
        CHECK(report.isolated[0].particle == 17);
        CHECK(report.rejected == 0);
        without.advance(1e-2);
        CHECK((goes_on.positions() == without.positions()));
    }
    // of several such particles each is named until they are too many; gravity is not the cause
    auto all = block<NeoHookean<Plane>>();
    all.upload<Velocity>(std::vector<Eigen::Vector2d>(all.size(), {1e14, 0}));
    all.quarantine(3);
    CHECK_THROWS_AS(all.advance(1e-2), StepError);
    CHECK(all.isolated().size() == 3);
    auto falls = block<NeoHookean<Plane>>();
    try {
        falls.advance(1, Gravity{{0, -1e40, 0}});
        FAIL("nothing went wrong");
    }
    catch (Error const& error) {
        CHECK(dynamic_cast<StepError const*>(&error) == nullptr);
        CHECK_THAT(error.what_is_wrong(), Contains("bounded by acceleration"));
    }
    auto touched = block<NeoHookean<Plane>>(); // nor is a motion just within its range
    auto const error = refused([&] {
        touched.advance(1, Obstacle<Sphere>{.shape = {0.1}, .motion = {.velocity = {1e15, 0, 0}}});
    });
    CHECK_THAT(error.what_is_wrong(), Contains("bounded by obstacle"));
}

TEST_CASE("what goes wrong again and again, with steps that go well between, ends in an error")
{
    // a ball at many times the speed of waves: what it turns inside out is pushed at every step
    auto const hit = [](std::size_t quarantine) {
        Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05));
        solver.add(box_of_points<2>({0, 0}, {0.3, 0.3}, 0.05), 6e-4, {1, -1});
        if (quarantine > 0) solver.quarantine(quarantine);
        Motion const flies{.position = {-1, 0.1, 0}, .velocity = {200, 0, 0}, .time = 0};
        Obstacle<Sphere> const ball{.shape = {0.4}, .motion = flies, .on_particles = true};
        for (int i = 0; i < 100; ++i) solver.advance(1e-4, ball);
    };
    CHECK_THROWS_AS(hit(0), StepError);
    CHECK_NOTHROW(hit(1000));
}

TEST_CASE("a state whose stress is beyond all numbers is named, and not those that it would spoil")
{
    auto solver = block<NeoHookean<Plane>>();
    auto H = solver.download<DisplacementGradient>();
    H[9](0, 0) = 1e200;
    solver.upload<DisplacementGradient>(H);
    CHECK_THAT(refused([&] { solver.advance(1e-2); }).what_is_wrong(), Contains("since particle 9 "));
}

TEST_CASE(
    "particles that were taken out are back with the snapshot that has them, and may be taken out once more")
{
    auto solver = block<NeoHookean<Plane>>();
    solver.quarantine(2);
    auto const take_out = [&](std::size_t which) {
        auto velocities = solver.download<Velocity>();
        velocities[which] = {0, 1e5};
        solver.upload<Velocity>(velocities);
        return solver.step(1e-3).isolated.at(0).particle;
    };
    auto const ids_of = [&] {
        std::vector<std::uint32_t> ids;
        for (auto const& failure : solver.isolated()) ids.push_back(failure.particle);
        return ids;
    };
    using Ids = std::vector<std::uint32_t>;
    take_out(20);
    auto const snapshot = solver.snapshot();
    take_out(30); // the 30th of the particles that are left
    CHECK(ids_of() == Ids{20, 31});
    solver.restore(snapshot);
    CHECK(ids_of() == Ids{20});
    CHECK(solver.size() == 63);
    take_out(40); // there is room for one more, again
    CHECK(ids_of() == Ids{20, 41});
    CHECK_THROWS_AS(take_out(10), StepError);
    CHECK(ids_of() == Ids{20, 41});
    auto fresh = block<NeoHookean<Plane>>();
    fresh.restore(snapshot); // as a program does that goes on from a file
    REQUIRE(fresh.isolated().size() == 1);
    fresh.quarantine(1); // of which nothing is left
    fresh.upload<Velocity>(std::vector<Eigen::Vector2d>(fresh.size(), {0, 1e5}));
    CHECK_THROWS_AS(fresh.step(1e-3), StepError);
    CHECK(fresh.size() == 63);
}

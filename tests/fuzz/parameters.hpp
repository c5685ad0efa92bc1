// SPDX-License-Identifier: MIT
#pragma once

#include "surroundings.hpp"

#include <firn/budget.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>
#include <firn/initial_stress.hpp>
#include <firn/io/frame_series.hpp>
#include <firn/io/write_samples.hpp>
#include <firn/mark_face.hpp>
#include <firn/sampling/fill.hpp>
#include <firn/sampling/polygon.hpp>
#include <firn/settle.hpp>

#include <algorithm>
#include <array>
#include <map>

// Scenes in which any parameter is any number, finite or not: they are refused, or run with all invariants
// intact until an Error.
namespace firn::fuzz
{

/// Parameters one after the other, of which some are others than usual: the input begins with how many, and
/// says which, and what they are.
class Parameters
{
public:
    explicit Parameters(Input& input)
    {
        int const count = 1 + input.below(8);
        for (int i = 0; i < count; ++i) {
            int const which = input.byte();
            for (auto& byte : chosen_[which]) byte = input.byte();
        }
    }

    /// The next one; some are numbers of the solver's precision.
    template <class Number>
    void next(Number& parameter)
    {
        auto const found = chosen_.find(count_++);
        if (found == chosen_.end()) return;
        double const value = Input(found->second).any(double(parameter));
        if constexpr (std::is_integral_v<Number>) {
            constexpr double least = double(std::numeric_limits<Number>::min()),
                             largest = double(std::numeric_limits<Number>::max());
            parameter = static_cast<Number>(std::isnan(value) ? least : std::clamp(value, least, largest));
        }
        else
            parameter = static_cast<Number>(value);
    }
    template <class... Numbers>
        requires(sizeof...(Numbers) > 1)
    void next(Numbers&... parameters) { (next(parameters), ...); }
    void next(Eigen::Vector3d& vector) { next(vector.x(), vector.y(), vector.z()); }
    void next(Eigen::Quaterniond& turn) { next(turn.w(), turn.x(), turn.y(), turn.z()); }
    void next(Motion& motion)
    {
        next(motion.position);
        next(motion.velocity);
        next(motion.angular_velocity);
        next(motion.orientation);
        double time = motion.time.value_or(0);
        next(time);
        motion.time = time;
    }
    void next(Contact& contact) { next(contact.friction); }
    template <std::size_t bodies>
    void next(BodyContact<bodies>& contact)
    {
        next(contact.touching);
        next(contact.between(0, 1));
    }
    void next(StepControl& control)
    {
        next(control.wave, control.advection, control.deformation, control.obstacle, control.growth,
             control.rejection, control.smallest, control.retries);
    }
    template <class Model>
    void next_of_model(Model& model)
    {
        if constexpr (requires { model.contact; }) {
            std::apply([&](auto&... each) { (next_of_model(each), ...); }, model.of);
            next(model.contact);
        }
        else
            next_of_material(model);
    }
    template <class Model>
    void next_of_material(Model& model)
    {
        next(model.density);
        if constexpr (requires { model.elasticity; }) next(model.elasticity.mu, model.elasticity.lambda);
        if constexpr (requires { model.critical_compression; })
            next(model.critical_compression, model.critical_stretch, model.hardening,
                 model.smallest_plastic_ratio, model.largest_plastic_ratio);
        if constexpr (requires { model.cone; })
            next(model.cone, model.cohesion, model.dilatancy, model.tension_cutoff);
        if constexpr (requires { model.slope; })
            next(model.slope, model.cohesion, model.hardening, model.start);
        if constexpr (requires { model.consistency; })
            next(model.yield_stress, model.consistency, model.power);
        if constexpr (requires { model.hardening_modulus; })
            next(model.yield_stress, model.hardening_modulus);
        if constexpr (requires { model.bulk_modulus; })
            next(model.bulk_modulus, model.exponent, model.viscosity);
        if constexpr (requires { model.sweeps; }) next(model.interval, model.sweeps);
    }
    template <class Transfer>
    void next_of_transfer(Transfer& transfer)
    {
        if constexpr (requires { transfer.fraction; }) next(transfer.fraction);
        if constexpr (requires { transfer.separation; }) next(transfer.separation);
    }

    /// A byte names each of them.
    void expect_room() const { expect(count_ <= 256, "there are more parameters than a byte can name"); }

private:
    std::map<int, std::array<std::uint8_t, 10>> chosen_;
    int count_ = 0;
};

/// The numbers of a scene that are no effects'.
template <class Solver>
struct SceneNumbers
{
    typename Solver::Model model{};
    typename Solver::Transfer transfer{};
    StepControl control{};
    double h = 0.05, volume = 6e-4, dt = 1e-4, duration = 1e-3;
    Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    Eigen::Vector3d from{0, 0.02, 0}, velocity{0.5, -2, 0};
    double spacing = 0.025;
    Budget budget{.steps = 20};
    int is_periodic = 0, axis = 0, period = 16;
    int have_own_volumes = 0;
    double other_volume = 5e-4;
    double marks = 0.5, modulus = 2e5, lambda = 1e5;
    Eigen::Vector3d area{0, 0.1, 0};
    Settling settling{.rate = 1e3, .longest = 1e-3, .between = 2e-4};
    AtRest rest{.surface = 0.2, .load = 100, .k0 = 0.5};
    Filling filling{.spacing = 0.03, .pose = {.position = {0.4, 0.3, 0}}};
    double filled = 0.1;
    double begin = 0, path_duration = 1e-3;
    Motion first_key{.time = 0}, second_key{.position = {0.01, 0, 0}, .time = 1e-3};
    Eigen::Vector3d place{0, 0.05, 0};
    Eigen::Vector2d low{-0.1, 0}, high{0.2, 0.2}; // of a grid of samples
    int along_x = 4, along_y = 3;
    Eigen::Vector2d corner{0.5, 0.3}, corner_of_hole{0.36, 0.28}; // of a polygon
    double polygon_spacing = 0.03;
    double time_of_frame = 1;
    typename Solver::Number distance = -0.05, apart = 0.1, way = 0.01; // of a solid that changes its form
    Eigen::Vector2d first_node{-0.1, -0.1};
    double deforms_from = 0, deforms_for = 1e-3;
};

/// The usual effects: all of them act.
template <class Solver>
Surroundings<Solver> usual_surroundings()
{
    Surroundings<Solver> around;
    around.ball.on_particles = true;
    around.crates.list = {
        {.shape = Sphere{0.1}, .motion = {.position = {0.1, 0, 0}}},
        {.shape = Box{{0.05, 0.05, 0.05}}, .motion = {.position = {0, 0.1, 0}}},
        {.shape = typename Surroundings<Solver>::Pair{{{.shape = {0.05}}, {.shape = {{0.1, 0.02, 0.1}}}}},
         .motion = {.position = {0.3, 0.4, 0}},
         .on_particles = true}};
    around.shells.list = {{.shape = {Sphere{0.3}, 0.01}, .motion = {.position = {0.1, 0.1, 0}}}};
    around.held = {
        .shape = {0.03}, .motion = {.position = {0.1, 0.1, 0}}, .velocity = Eigen::Vector3d(0, 0, 0)};
    around.blast.acceleration = {1, 0, 0};
    around.damping.rate = 1;
    around.local_damping.share = 0.1;
    around.wind.acceleration = {0, 5, 0};
    around.grip = {.velocity = Eigen::Vector3d(0, 0, 0), .beyond = 0.2};
    around.load = Traction::pressure(10);
    return around;
}

/// Chooses all of them. New ones come behind the others, so that inputs keep their meaning.
template <class Solver>
void choose(Parameters& parameters, SceneNumbers<Solver>& scene, Surroundings<Solver>& around)
{
    parameters.next_of_model(scene.model);
    parameters.next_of_transfer(scene.transfer);
    parameters.next(scene.control);
    parameters.next(scene.h, scene.volume, scene.dt, scene.duration);
    parameters.next(scene.origin);
    parameters.next(scene.from);
    parameters.next(scene.velocity);
    parameters.next(scene.spacing);
    parameters.next(around.gravity.acceleration);
    parameters.next(around.floor.shape.normal);
    parameters.next(around.floor.contact);
    parameters.next(around.floor.motion);
    parameters.next(around.ball.shape.radius);
    parameters.next(around.ball.contact);
    parameters.next(around.ball.motion);
    parameters.next(around.left.axis, around.left.node, around.left.side, around.right.axis,
                    around.right.node, around.right.side);
    parameters.next(around.crates.list[0].shape.template as<Sphere>()->radius);
    for (std::size_t i = 0; i < 2; ++i) {
        parameters.next(around.crates.list[i].contact);
        parameters.next(around.crates.list[i].motion);
    }
    parameters.next(around.held.shape.radius);
    parameters.next(around.held.motion);
    parameters.next(*around.held.velocity);
    parameters.next(around.blast.shape.radius);
    parameters.next(around.blast.acceleration);
    parameters.next(around.blast.motion);
    parameters.next(around.damping.rate);
    parameters.next(scene.budget.steps);
    parameters.next(scene.is_periodic, scene.axis, scene.period);
    parameters.next(scene.have_own_volumes, scene.other_volume);
    parameters.next(around.wind.acceleration);
    parameters.next(around.grip.motion);
    parameters.next(*around.grip.velocity);
    parameters.next(around.grip.beyond, scene.marks, scene.modulus, scene.lambda);

    parameters.next(around.local_damping.share);
    for (int i : {0, 1, 3, 4, 5}) parameters.next(around.load.stress.data()[i]);
    parameters.next(scene.area);
    auto& [sphere, box] =
        around.crates.list[2].shape.template as<typename Surroundings<Solver>::Pair>()->parts;
    parameters.next(sphere.shape.radius, box.shape.half_extents.x());
    parameters.next(box.position);
    parameters.next(box.orientation);
    parameters.next(around.shells.list[0].shape.thickness);
    parameters.next(scene.budget.seconds, scene.budget.respond_within);
    parameters.next(scene.settling.rate, scene.settling.share, scene.settling.longest, scene.settling.between,
                    scene.settling.least);
    parameters.next(scene.rest.surface, scene.rest.load, *scene.rest.k0);
    parameters.next(scene.rest.acceleration);
    parameters.next(scene.filled, scene.filling.spacing, scene.filling.jitter);
    parameters.next(scene.filling.pose.orientation);
    parameters.next(scene.begin, scene.path_duration, *scene.first_key.time, *scene.second_key.time);
    parameters.next(scene.second_key.position);
    parameters.next(scene.second_key.orientation);
    parameters.next(scene.place);
    parameters.next(scene.low.x(), scene.low.y(), scene.high.x(), scene.high.y(), scene.along_x,
                    scene.along_y);
    parameters.next(scene.corner.x(), scene.corner.y(), scene.corner_of_hole.x(), scene.corner_of_hole.y(),
                    scene.polygon_spacing, scene.time_of_frame);
    parameters.next(scene.distance, scene.apart, scene.way, scene.first_node.x(), scene.first_node.y(),
                    scene.deforms_from, scene.deforms_for);
    parameters.expect_room();
}

/// Bounds what would take for long.
template <class Solver>
void shorten(SceneNumbers<Solver>& scene)
{
    // any smaller positive share is valid too, but the run might then never end
    if (scene.control.smallest > 0 && scene.control.smallest < 1e-2) scene.control.smallest = 1e-2;
    if (scene.budget.steps > 100) scene.budget.steps = 100;
    auto const no_less = [](double& number, double least) { number = number < least ? least : number; };
    no_less(scene.filling.spacing, std::abs(scene.filled) / 20);
    no_less(scene.settling.between, scene.settling.longest / 10);
    auto const corners = {scene.corner.x(), scene.corner.y(), scene.corner_of_hole.x(),
                          scene.corner_of_hole.y()};
    for (double const x : corners) // a polygon that is so large
        if (std::abs(x) < 1e300) no_less(scene.polygon_spacing, std::abs(x) / 40);
    double const samples = double(scene.along_x) * double(scene.along_y);
    if (samples > 4096 && samples < 2147483648.0) scene.along_x = scene.along_y = 3;
}

/// A polygon is refused, or filled with points that stand for its area.
template <class Solver>
void fill_polygon(SceneNumbers<Solver> const& scene)
{
    refused([&] {
        Polygon const polygon({{0.3, 0.2}, {0.5, 0.2}, scene.corner, {0.3, 0.3}},
                              {{{0.34, 0.24}, {0.4, 0.24}, scene.corner_of_hole}});
        auto const filled = fill<2>(polygon, {.spacing = scene.polygon_spacing});
        double const sum = filled.volume_per_point * double(filled.points.size());
        expect(std::abs(sum - polygon.area()) <= 1e-9 * polygon.area(), "points have another area");
        for (auto const& x : filled.points)
            expect(polygon.contains(x), "a point of a filled polygon lies outside");
    });
}

/// Samples on a grid and a frame are what they are asked for, and are written, or refused.
template <class Solver>
void write_files(Solver const& solver, SceneNumbers<Solver> const& scene)
{
    constexpr int d = Solver::d;
    refused([&] {
        Vector<double, d> low = Vector<double, d>::Zero(), high = low;
        Coordinates<d> points = Coordinates<d>::Ones();
        low.template head<2>() = scene.low;
        high.template head<2>() = scene.high;
        points.template head<2>() = Eigen::Vector2i(scene.along_x, scene.along_y);
        auto const grid = sample_grid(solver, low, high, points);
        for (std::size_t i = 0; i < grid.samples.size(); ++i)
            expect(grid.place(i).allFinite() && grid.samples[i].stress.allFinite() &&
                       grid.samples[i].velocity.allFinite() && std::isfinite(grid.samples[i].density),
                   "a sample of a grid is not finite");
        TemporaryFile const file(".samples");
        bool const was_refused = refused([&] { write_vti(file.path(), grid, scene.time_of_frame); });
        expect(was_refused != std::isfinite(scene.time_of_frame), "a time that is none, or the reverse");
        write_csv(file.path(), grid);
    });
    auto frame = frame_of<Velocity, Stress>(solver);
    frame.time = scene.time_of_frame;
    TemporaryFile const file(".frame");
    for (bool const is_ply : {false, true}) {
        bool const was_refused =
            refused([&] { is_ply ? write_ply(file.path(), frame) : write_vtp(file.path(), frame); });
        expect(was_refused != std::isfinite(scene.time_of_frame), "a time that is none, or the reverse");
    }
}

/// A solid of a few nodes that changes its form.
template <class Solver>
auto deforming_solid(SceneNumbers<Solver> const& scene)
{
    constexpr int d = Solver::d;
    using Number = typename Solver::Number;
    Eigen::Array<int, d, 1> const nodes = Eigen::Array<int, d, 1>::Constant(3);
    std::vector<Number> before(std::size_t(nodes.prod()), Number(0.04));
    before[before.size() / 2] = scene.distance;
    auto after = before;
    after[before.size() / 2] = -Number(0.05);
    std::vector<Vector<Number, d>> ways(before.size(), Vector<Number, d>::Zero());
    for (auto& way : ways) way[1] = scene.way;
    Vector<Number, d> first = Vector<Number, d>::Constant(-scene.apart);
    first.template head<2>() = scene.first_node.template cast<Number>();
    SignedDistanceGrid<Number, d> const from(first, scene.apart, nodes, before),
        to(first, scene.apart, nodes, after);
    return DeformingGrid<Number, d>(from, to, ways, scene.deforms_from, scene.deforms_for);
}

template <class Solver>
void run_with(Input& input)
{
    constexpr int d = Solver::d;
    Parameters parameters(input);
    SceneNumbers<Solver> scene;
    auto around = usual_surroundings<Solver>();
    choose(parameters, scene, around);
    shorten(scene);
    Vector<double, d> const velocity = scene.velocity.template head<d>();

    std::vector<Vector<double, d>> points;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            points.push_back((scene.from + scene.spacing * Eigen::Vector3d(i, j, i % 2)).template head<d>());

    refused([&] {
        Lattice cells{scene.h, scene.origin};
        if (scene.is_periodic != 0) cells = cells.periodic(scene.axis, scene.period);
        Solver solver(cells, scene.model, scene.transfer, scene.control);
        std::vector<double> volumes(points.size(), scene.volume);
        volumes[5] = scene.other_volume;
        if constexpr (Solver::materials == 1)
            solver.add(points, scene.have_own_volumes == 0 ? Volumes(scene.volume) : Volumes(volumes),
                       velocity);
        else
            for (std::size_t i = 0; i < points.size(); ++i) {
                std::vector const one{points[i]};
                if (i % 2 == 0)
                    solver.template add<Material<0>>(one, scene.volume, velocity);
                else
                    solver.template add<Material<1>>(one, scene.volume);
            }
        refused([&] { // what is filled is added, or refused
            auto const filled = fill<d>(Sphere{scene.filled}, scene.filling);
            if (filled.points.size() > 200) return;
            refused_whole(solver, [&] {
                solver.template add<Material<0>>(filled.points, filled.volume_per_point, velocity);
            });
        });
        auto const first = expect_whole(solver);
        auto const look = [&] {
            auto const told = expect_whole(solver);
            expect(told.ids == first.ids && told.masses == first.masses, "ids or masses have changed");
        };
        if constexpr (has_marks<Solver>) {
            std::vector<std::uint32_t> const few{1, 4, 7};
            refused_whole(solver, [&] { assign<Mark>(solver, Inside<Sphere>{.shape = {0.05}}, 1); });
            refused_whole(solver, [&] { assign<Mark>(solver, few, scene.marks); });
            refused_whole(solver, [&] { assign<OwnShearModulus>(solver, few, scene.modulus); });
            refused_whole(solver, [&] { assign<OwnLambda>(solver, scene.lambda); });
            refused_whole(solver, [&] {
                mark_face(solver, Inside<Sphere>{.shape = {0.06}},
                          Vector<double, d>(scene.area.template head<d>()));
            });
            mark_one(solver);
            refused_whole(solver, [&] {
                solver.template upload<DisplacementGradient>(
                    k0_state(solver.model(), solver.positions(), scene.rest));
            });
        }
        refused([&] {
            PosePath path;
            for (Motion const& key : {scene.first_key, scene.second_key})
                path.add(*key.time, key.position, key.orientation);
            around.crates.list[1].motion = path.during(scene.begin, scene.path_duration);
            double const part = path.until_key(scene.begin, scene.path_duration);
            expect(part >= 0 && part <= scene.path_duration && (part > 0 || !(scene.path_duration > 0)),
                   "it is no part of a call to the next key");
        });
        fill_polygon(scene);
        write_files(solver, scene);
        refused([&] { solver.sample(std::vector<Vector<double, d>>{scene.place.template head<d>()}); });
        refused([&] { solver.totals(Vector<double, d>(scene.place.template head<d>())); });
        refused([&] { solver.energy(around.gravity); });
        look();
        double stable = 1e-9;
        auto const advance = [&](auto const&... effects) {
            for (int i = 0; i < 3; ++i) {
                refused([&] { expect_finite(solver.step(scene.dt, effects...).reactions); });
                look();
            }
            stable = solver.step(1e-9, effects...).stable_dt;
            look();
            auto const least = [](double& number, double most) { number = number > most ? most : number; };
            least(scene.duration, 30 * stable); // else one may wait for long
            refused([&] { expect_finite(solver.advance(scene.duration, effects...).reactions); });
            look();
            refused(
                [&] { expect_finite(solver.advance(scene.duration, scene.budget, effects...).reactions); });
            look();
            least(scene.settling.longest, 30 * stable);
            if constexpr (has_marks<Solver>)
                refused([&] { expect_finite(settle(solver, scene.settling, effects...).steps.reactions); });
            look();
        };
        if constexpr (Solver::materials == 1)
            around.with(advance);
        else // bodies, which know no ReflectingWall
            advance(around.gravity, around.floor, around.crates, around.held, around.blast, around.damping);
        if constexpr (!is_pool<Solver>)
            refused([&] {
                using Solid = decltype(deforming_solid(scene));
                Obstacle<Solid> const glove{.shape = deforming_solid(scene),
                                            .motion = {.position = {0.1, 0.1, 0}}};
                expect_finite(solver.advance(scene.duration, scene.budget, around.gravity, glove).reactions);
            });
        look();
#if !defined(FIRN_FUZZ_FEW)
        if constexpr (Solver::materials == 1 && !is_pool<Solver>) { // beside it there is no ReflectingWall
            Obstacles<AnyShape<typename Surroundings<Solver>::Pair>, ActsOn::surface_and_particles> const
                surface{around.crates.list};
            refused([&] {
                expect_finite(solver
                                  .advance(scene.duration, scene.budget, around.gravity, surface, around.held,
                                           around.blast, around.damping)
                                  .reactions);
            });
            look();
        }
#endif
        auto const saved = solver.snapshot();
        Solver other(cells, scene.model, scene.transfer, scene.control);
        other.restore(saved);
        expect(Told<Solver>(other) == Told<Solver>(solver), "what was restored is not what was saved");
    });
}

/// The first byte says which scene it is.
inline void parameters(Bytes bytes)
{
    Input input(bytes);
    int const scene = input.byte();
#if !defined(FIRN_FUZZ_FEW)
    if (scene >= 252) return run_with<Pool>(input);
#endif
    switch (scene % 9) {
#if !defined(FIRN_FUZZ_FEW)
    case 0:
        return run_with<Sheet>(input);
#endif
#if defined(FIRN_FUZZ_ALL)
    case 2:
        return run_with<Solver<OpenMP, Sand<SolidFloat>, CubicBSpline, Asflip>>(input);
    case 3:
        return run_with<Solver<OpenMP, HerschelBulkley<PlaneFloat>, QuadraticBSpline, Apic>>(input);
    case 4:
        return run_with<Solver<OpenMP, Fluid<SolidFloat>, QuadraticBSpline, Mls>>(input);
    case 5:
        return run_with<Solver<OpenMP, HardeningVonMises<Plane>, CubicBSpline, Tpic>>(input);
    case 6:
        return run_with<Solver<OpenMP, NeoHookean<PlaneFloat>, CubicBSpline, Pic>>(input);
    case 7:
        return run_with<SnowBall>(input);
    case 1: {
        using Two = Bodies<NeoHookean<PlaneFloat>, Snow<PlaneFloat>>;
        return run_with<Solver<OpenMP, Two, QuadraticBSpline, Mls>>(input);
    }
#endif
    default:
        return run_with<MarkedSheet>(input);
    }
}

} // namespace firn::fuzz

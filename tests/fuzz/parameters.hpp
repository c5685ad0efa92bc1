// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/budget.hpp>
#include <firn/effects/damping.hpp>
#include <firn/effects/force.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/obstacles.hpp>

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
            int const which = input.below(180);
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
            constexpr double least = std::numeric_limits<Number>::min(),
                             largest = std::numeric_limits<Number>::max();
            parameter = static_cast<Number>(std::isnan(value) ? least : std::clamp(value, least, largest));
        }
        else
            parameter = static_cast<Number>(value);
    }
    template <class... Numbers>
        requires(sizeof...(Numbers) > 1)
    void next(Numbers&... parameters) { (next(parameters), ...); }
    void next(Eigen::Vector3d& vector) { next(vector.x(), vector.y(), vector.z()); }
    void next(Motion& motion)
    {
        next(motion.position);
        next(motion.velocity);
        next(motion.angular_velocity);
        next(motion.orientation.w(), motion.orientation.x(), motion.orientation.y(), motion.orientation.z());
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
    }
    template <class Transfer>
    void next_of_transfer(Transfer& transfer)
    {
        if constexpr (requires { transfer.fraction; }) next(transfer.fraction);
        if constexpr (requires { transfer.separation; }) next(transfer.separation);
    }

private:
    std::map<int, std::array<std::uint8_t, 10>> chosen_;
    int count_ = 0;
};

template <class Solver>
void run_with(Input& input)
{
    constexpr int d = Solver::d;
    Parameters parameters(input);
    typename Solver::Model model;
    parameters.next_of_model(model);
    typename Solver::Transfer transfer;
    parameters.next_of_transfer(transfer);
    StepControl control;
    parameters.next(control);
    // any smaller positive share is valid too, but the run might then never end
    if (control.smallest > 0 && control.smallest < 1e-2) control.smallest = 1e-2;
    double h = 0.05, volume = 6e-4, dt = 1e-4, duration = 1e-3;
    Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    parameters.next(h, volume, dt, duration);
    parameters.next(origin);
    Eigen::Vector3d from(0, 0.02, 0), velocity(0.5, -2, 0);
    double spacing = 0.025;
    parameters.next(from);
    parameters.next(velocity);
    parameters.next(spacing);
    Gravity gravity;
    parameters.next(gravity.acceleration);
    Obstacle<HalfSpace> floor{.contact = Contact::coulomb(0.3)};
    parameters.next(floor.shape.normal);
    parameters.next(floor.contact);
    parameters.next(floor.motion);
    Obstacle<Sphere> ball{.shape = {0.2}, .motion = {.position = {0.3, 0.1, 0}}, .on_particles = true};
    parameters.next(ball.shape.radius);
    parameters.next(ball.contact);
    parameters.next(ball.motion);
    ReflectingWall left{.axis = 0, .node = -20, .side = 1}, right{.axis = 0, .node = 20, .side = -1};
    parameters.next(left.axis, left.node, left.side, right.axis, right.node, right.side);
    Obstacles<> crates{{{.shape = Sphere{0.1}, .motion = {.position = {0.1, 0, 0}}},
                        {.shape = Box{{0.05, 0.05, 0.05}}, .motion = {.position = {0, 0.1, 0}}}}};
    double radius = 0.1;
    parameters.next(radius);
    crates.list[0].shape = Sphere{radius};
    for (auto& crate : crates.list) {
        parameters.next(crate.contact);
        parameters.next(crate.motion);
    }
    Held<Sphere> held{
        .shape = {0.03}, .motion = {.position = {0.1, 0.1, 0}}, .velocity = Eigen::Vector3d(0, 0, 0)};
    parameters.next(held.shape.radius);
    parameters.next(held.motion);
    parameters.next(*held.velocity);
    Force<Sphere> wind{.shape = {0.2}, .acceleration = {1, 0, 0}};
    parameters.next(wind.shape.radius);
    parameters.next(wind.acceleration);
    parameters.next(wind.motion);
    Damping damping{.rate = 1};
    parameters.next(damping.rate);
    Budget budget{.steps = 20};
    parameters.next(budget.steps);
    if (budget.steps > 100) budget.steps = 100; // else one may wait for long
    int is_periodic = 0, axis = 0, period = 16;
    parameters.next(is_periodic, axis, period);
    int have_own_volumes = 0;
    double other_volume = 5e-4;
    parameters.next(have_own_volumes, other_volume);
    MarkedForce<Mark> pull{.acceleration = {0, 5, 0}};
    parameters.next(pull.acceleration);
    HeldMarked<Mark> grip{.velocity = Eigen::Vector3d(0, 0, 0), .beyond = 0.2};
    parameters.next(grip.motion);
    parameters.next(*grip.velocity);
    double marks = 0.5, modulus = 2e5, lambda = 1e5;
    parameters.next(grip.beyond, marks, modulus, lambda);

    std::vector<Vector<double, d>> points;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            points.push_back((from + spacing * Eigen::Vector3d(i, j, i % 2)).template head<d>());

    refused([&] {
        Lattice cells{h, origin};
        if (is_periodic != 0) cells = cells.periodic(axis, period);
        Solver solver(cells, model, transfer, control);
        std::vector<double> volumes(points.size(), volume);
        volumes[5] = other_volume;
        if constexpr (Solver::materials == 1)
            solver.add(points, have_own_volumes == 0 ? Volumes(volume) : Volumes(volumes),
                       velocity.template head<d>());
        else
            for (std::size_t i = 0; i < points.size(); ++i) {
                std::vector const one{points[i]};
                if (i % 2 == 0)
                    solver.template add<Material<0>>(one, volume, velocity.template head<d>());
                else
                    solver.template add<Material<1>>(one, volume);
            }
        auto const first = expect_whole(solver);
        auto const look = [&] {
            auto const told = expect_whole(solver);
            expect(told.ids == first.ids && told.masses == first.masses, "ids or masses have changed");
        };
        if constexpr (has_marks<Solver>) {
            std::vector<std::uint32_t> const few{1, 4, 7};
            refused_whole(solver, [&] { assign<Mark>(solver, Inside<Sphere>{.shape = {0.05}}, 1); });
            refused_whole(solver, [&] { assign<Mark>(solver, few, marks); });
            refused_whole(solver, [&] { assign<OwnShearModulus>(solver, few, modulus); });
            refused_whole(solver, [&] { assign<OwnLambda>(solver, lambda); });
            refused([&] { solver.step(dt, gravity, pull, grip); });
            look();
        }
        double stable = 1e-9;
        if constexpr (Solver::materials == 1) {
            for (int i = 0; i < 3; ++i) {
                refused([&] { solver.step(dt, gravity, floor, ball, left, right); });
                look();
            }
            stable = solver.step(1e-9, gravity, floor, ball, left, right).stable_dt;
            look();
            if (duration > 30 * stable) duration = 30 * stable; // else one may wait for long
            refused([&] { solver.advance(duration, gravity, floor, ball, left, right); });
            look();
        }
        else // bodies, which know no ReflectingWall
            stable = solver.step(1e-9, gravity, floor).stable_dt;
        if (duration > 30 * stable) duration = 30 * stable;
#if !defined(FIRN_FUZZ_FEW)
        refused([&] { solver.advance(duration, budget, gravity, crates, held, wind, damping); });
        look();
#endif
        auto const saved = solver.snapshot();
        Solver other({h, origin}, model, transfer, control);
        other.restore(saved);
        expect(Told<Solver>(other) == Told<Solver>(solver), "what was restored is not what was saved");
    });
}

/// The first byte says which scene it is.
inline void parameters(Bytes bytes)
{
    Input input(bytes);
    switch (input.below(9)) {
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

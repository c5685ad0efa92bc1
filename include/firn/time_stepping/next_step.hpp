// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/time_stepping/bounds.hpp>
#include <firn/time_stepping/failures.hpp>
#include <firn/time_stepping/step_controller.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <type_traits>

namespace firn
{

/// The time of a scene, and what the length of its next step depends on. `Scene` is a SceneState, the same in
/// every call.
template <class Scene>
class NextStep
{
    using Sets = typename Scene::Sets;
    using Kernel = typename Scene::Kernel;
    static constexpr int d = Scene::d;

public:
    using Controller = TimeStepController<static_cast<int>(Sets::count)>;

    explicit NextStep(StepControl const& step_control) : control(step_control) {}

    StepControl control;
    TimeState time_state{};

    /// The time step controller for the materials of `sets`, the scene's or new ones, without effects.
    Controller controller_of(Scene const& scene, Sets const& sets) const
    {
        return detail::controller_of_materials<Kernel>(sets, scene.transfer, control,
                                                       scene.lattice.cell_size);
    }

    /// The time step controller of a call with these effects.
    template <class... Effects>
    Controller controller_for(Scene const& scene, Effects const&... effects)
    {
        time_state.ready = false; // it was planned for other effects and another end
        time_state.retries = 0;
        return controller_with(scene, effects...);
    }

    /// The longest stable step from the present state on with these effects.
    template <class... Effects>
    ChosenStep stable(Scene const& scene, Effects const&... effects) const
    {
        return controller_with(scene, effects...).stable(time_state.bounds);
    }

    /// Chooses the next step on the host.
    void choose(Scene const& scene, Controller const& controller)
    {
        if (!exactly_equal(time_state.scattered.interval.forces, scene.grid_state.scattered_dt()))
            time_state.scattered = {};
        controller.choose(time_state);
    }

    /// After particles of a material were added with a speed [m/s]: they bound the next step, too.
    template <std::size_t k>
    void admit(Scene const& scene, double speed, bool are_first)
    {
        if (are_first) time_state.previous = time_state.last = 0; // earlier steps had no particles
        double const modulus = scene.sets.template response_at_rest<k>().wave_modulus;
        controller_of(scene, scene.sets)
            .admit(time_state.bounds, static_cast<int>(k), scene.sets.template wave_speed<k>(modulus));
        time_state.bounds.speed = std::max(time_state.bounds.speed, speed);
        time_state.bounds = time_state.bounds.finite();
    }

    /// After particles came that were in a scene whose next step had these bounds.
    void admit(StepBounds const& bounds)
    {
        StepBounds& now = time_state.bounds;
        if (bounds.wave_speed > now.wave_speed)
            now.wave_speed = bounds.wave_speed, now.material = bounds.material;
        now.speed = std::max(now.speed, bounds.speed);
        now.deformation_rate = std::max(now.deformation_rate, bounds.deformation_rate);
        bounds_are_old_ = true;
    }

    /// After particles were removed: finds the bounds of the remaining ones if those of the removed ones may
    /// hold steps up.
    void follow_removal(Scene const& scene)
    {
        if (is_held_up(scene) || !scene.sets.has_particles(time_state.bounds.material)) find_bounds(scene);
    }

    /// Finds the bounds of the next step after the state was set from outside.
    void find_bounds(Scene const& scene)
    {
        time_state.bounds = bounds_of(scene, scene.sets, time_state.bounds);
        bounds_are_old_ = true;
    }
    /// The same where nothing moves. `modulus(k)` returns a material's largest wave modulus [Pa].
    template <class Modulus>
    void find_bounds_at_rest(Scene const& scene, Modulus const& modulus)
    {
        auto const none = []<class Tag, std::size_t k>(Tag, std::integral_constant<std::size_t, k>) {
            return std::array<FieldValue<Tag, typename Scene::Number, d>, 0>{};
        };
        time_state.bounds =
            detail::bounds_of(scene.sets, controller_of(scene, scene.sets), time_state.bounds, none, modulus);
        bounds_are_old_ = true;
    }
    /// The bounds for the particles of `sets`, the scene's or new ones; `found` are earlier bounds.
    StepBounds bounds_of(Scene const& scene, Sets const& sets, StepBounds const& found) const
    {
        return detail::bounds_of(sets, controller_of(scene, sets), found, scene.values(sets));
    }

    /// After a step, which found its bounds from the particles as they are.
    void trust_bounds() { bounds_are_old_ = false; }

    /// Drops stale limits (found before particles changed) if they alone prevent progress; the next step
    /// recomputes them.
    bool forgets_bounds(Scene const& scene, Controller const& controller)
    {
        if (!bounds_are_old_) return false;
        TimeState const kept = time_state;
        for (int k = 0; k < 2 && !controller.gets_on(time_state); ++k) {
            if (time_state.now.limit == StepLimit::deformation)
                time_state.bounds.deformation_rate = 0;
            else if (time_state.now.limit == StepLimit::obstacle)
                time_state.bounds.obstacle_speed = 0;
            find_bounds(scene);
            choose(scene, controller);
        }
        bool const gets_on = controller.gets_on(time_state);
        if (!gets_on) time_state = kept;
        return gets_on;
    }

    /// The particle whose own state bounds the chosen step, of length `dt` [s]; none if something else does.
    std::optional<StepFailure> slowest(Scene const& scene, Controller const& controller, double dt) const
    {
        if (time_state.now.limit > StepLimit::deformation) return {}; // by effects, or earlier steps
        return detail::slowest_in(scene.sets, controller, scene.values(scene.sets), time_state.stable,
                                  time_state.time, dt);
    }

    /// Goes on from another time and other bounds.
    void go_on_from(TimeState const& from)
    {
        time_state = from;
        bounds_are_old_ = true;
    }

private:
    template <class... Effects>
    Controller controller_with(Scene const& scene, Effects const&... effects) const
    {
        Controller controller = controller_of(scene, scene.sets);
        if (scene.size() > 0) // else effects bound no step
            (detail::admit_effect<d>(controller, effects), ...);
        return controller;
    }

    /// Whether steps are less than half as long as for particles at rest.
    bool is_held_up(Scene const& scene) const
    {
        auto const& sets = scene.sets;
        Controller const controller = controller_of(scene, sets);
        StepBounds at_rest;
        Sets::for_each([&](auto k) {
            if (sets.template particles<k>().size() == 0) return;
            double const modulus = sets.template response_at_rest<k>().wave_modulus;
            controller.admit(at_rest, static_cast<int>(k), sets.template wave_speed<k>(modulus));
        });
        return controller.stable(time_state.bounds).dt < 0.5 * controller.stable(at_rest).dt;
    }

    bool bounds_are_old_ = false; ///< some bounds were found by a step before particles changed
};

} // namespace firn

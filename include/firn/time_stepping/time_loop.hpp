// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/effects/actions.hpp>
#include <firn/effects/groups.hpp>
#include <firn/time_stepping/durations.hpp>
#include <firn/time_stepping/failures.hpp>
#include <firn/time_stepping/last_contacts.hpp>
#include <firn/time_stepping/next_step.hpp>
#include <firn/time_stepping/pace.hpp>
#include <firn/time_stepping/quarantine.hpp>
#include <firn/time_stepping/report.hpp>
#include <firn/time_stepping/solve_report.hpp>
#include <firn/time_stepping/step_queue.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// Advances a scene in time: chooses steps, has them taken, retries failed ones with half their length, and
/// removes particles where that is allowed. `Scene` is a SceneState, the same in every call.
template <class Scene>
class TimeLoop
{
    using Sets = typename Scene::Sets;
    using Number = typename Scene::Number;
    using Kernel = typename Scene::Kernel;
    using Transfer = typename Scene::Transfer;
    static constexpr int d = Scene::d;
    using Driver = StepsOn<typename Scene::Backend, Sets, Kernel, Transfer>;
    using Controller = typename Driver::Controller;
    using Failures = std::vector<StepFailure>;

public:
    TimeLoop(StepControl const& control, Scene const& scene)
        : next_(control), memory_(scene.lattice, scene.transfer, scene.backend), groups_(scene.backend)
    {
        if constexpr (spans_ranks<typename Scene::Backend>) {
            std::ostringstream text;
            text.precision(17);
            for (double const own : {control.wave, control.advection, control.deformation, control.obstacle,
                                     control.growth, control.rejection, control.smallest})
                text << own << ' ';
            text << control.retries;
            detail::require_same_on_ranks(scene.backend, "StepControl", text.str());
            if constexpr (StepsImplicitly<Transfer>) {
                Implicit const& by = scene.transfer.integrator;
                detail::require_same_on_ranks(scene.backend, "Implicit",
                                              detail::text_of(by.tolerance, by.share, by.forcing, by.newton,
                                                              by.linear, by.coarse, by.error, by.target,
                                                              by.fixed));
            }
        }
    }

    /// The time, and what the next step depends on.
    NextStep<Scene>& next_step() { return next_; }
    NextStep<Scene> const& next_step() const { return next_; }
    /// The particles that were removed from the scene.
    Failures const& isolated() const { return quarantine_.isolated(); }
    /// See contact_points().
    ContactPoints<d> last_contacts(Scene const& scene) const
    {
        ContactPoints<d> last{.dt = next_.time_state.last, .points = {}};
        for (auto* const group : groups_.of_call())
            if (auto const* const memory = group->surface())
                detail::add_contacts(*memory, scene.lattice, scene.masses.unit, last.points);
        return last;
    }
    /// See Solver::until_error.
    AdvanceReport const& until_error() const { return until_error_; }

    /// Whether a call broke off after a failed step, with velocities that only the grid had and that are no
    /// longer there.
    bool has_lost_velocities(Scene const& scene) const
    {
        return memory_.nodes_spoiled && !scene.sets.has_grid_fields();
    }

    /// See Solver::quarantine.
    void quarantine(std::size_t most)
    {
        quarantine_.allow(most);
        isolate_ = &TimeLoop::isolate;
    }
    /// Takes particles off the list of removed ones.
    void release(std::vector<std::uint32_t> const& ids) { quarantine_.release(ids); }

    /// Takes `count` steps of length `dt` [s]; see Solver::steps.
    template <class... Effects>
    std::vector<StepReport> steps(Scene& scene, std::size_t count, double dt, Effects const&... effects)
    {
        auto reports = detail::room_for_reports(count);
        Controller controller = next_.controller_for(scene, effects...);
        controller.equal = dt;
        require_same_on_ranks(scene, "Solver::step", controller, double(count));
        auto plain = plain_effects(next_.time_state.time, effects...);
        groups_.stage(plain, scene.lattice, next_.time_state.time, double(count) * dt, effects...);
        begin_call(scene);
        Failures isolated;
        auto const take = [&] {
            // again: time has advanced
            detail::require_to_last<Number>(next_.time_state.time, dt, "Solver::step");
            if (!next_.time_state.ready) next_.choose(scene, controller);
            bool const beyond_stable = dt > next_.time_state.stable;
            if (beyond_stable) scene.cache_grid_fields(); // the step may fail
            std::size_t const most = beyond_stable ? 1 : count - reports.size();
            StepLog const& log = run(scene, controller, most, plain, [&](auto const& record) {
                StepReport report;
                describe<Effects...>(record, scene.masses.unit, report);
                reports.push_back(std::move(report)); // filled before it is added: allocation may fail
                reports.back().beyond_stable = dt > record.stable;
                std::swap(reports.back().isolated, isolated); // isolated before that step
            });
            if (log.failed > 0 && !isolates(scene, controller, failed_step(log, dt, true), isolated))
                fail(scene, log, dt);
        };
        try {
            while (reports.size() < count) take();
        }
        catch (...) {
            until_error_ = {};
            for (auto const& report : reports) until_error_.add(report, StepLimit::duration);
            throw;
        }
        next_.time_state.ready = false;
        return reports;
    }

    /// Takes as many stable steps as fill a duration [s], or as `pace` allows; see Solver::advance.
    template <class Pace, class... Effects>
    AdvanceReport advance(Scene& scene, double duration, Pace&& pace, Effects const&... effects)
    {
        Controller controller = next_.controller_for(scene, effects...);
        controller.cuts = pace.cuts_last_step();
        controller.duration = duration;
        controller.end = next_.time_state.time + duration;
        require_same_on_ranks(scene, "Solver::advance", controller, 0);
        auto plain = plain_effects(next_.time_state.time, effects...);
        groups_.stage(plain, scene.lattice, next_.time_state.time, duration, effects...);
        begin_call(scene);
        constexpr bool is_full = std::is_same_v<std::remove_cvref_t<Pace>, FullPace>; // asks no clock
        AdvanceReport all;
        all.reactions.resize(groups_.template count_obstacles<Effects...>()); // also if no step fits
        StepReport of_step; // reused, so that its lists are allocated once
        StepLog failed;     // the step that is being repeated, if next_.time_state.retries > 0
        auto const get_on = [&](std::size_t allowed) { // returns false where a whole step does not fit
            if (!next_.time_state.ready) next_.choose(scene, controller);
            if (!controller.gets_on(next_.time_state)) {
                get_unstuck(scene, controller, failed, all);
                return true;
            }
            if (!controller.fits(next_.time_state)) return false;
            // the number of steps if all were as long as this one, limited to what can be counted
            auto const most = static_cast<std::size_t>(std::min(
                std::ceil((controller.end - next_.time_state.time) / next_.time_state.now.interval.length()),
                0x1p62));
            StepLog const& log =
                run(scene, controller, std::min(most, allowed), plain, [&](auto const& record) {
                    describe<Effects...>(record, scene.masses.unit, of_step);
                    all.add(of_step, record.limit);
                });
            if (log.failed == 0) return true;
            failed = log;
            retry(scene, controller, failed, all);
            return true;
        };
        auto const finish = [&] {
            all.left = std::max(controller.end - next_.time_state.time, 0.0);
            all.stopped_by = pace.stopped_by();
        };
        try {
            while (controller.goes_on(next_.time_state)) {
                // not between a failed step and its repetition: the nodes lack the velocities of the last
                // good one until then
                std::size_t allowed = next_.time_state.retries > 0 ? 1 : pace.steps_allowed(all);
                if constexpr (!is_full) allowed = detail::of_first_rank(scene.backend, allowed);
                std::uint64_t const taken = all.substeps;
                if (allowed == 0 || !get_on(allowed)) break;
                bool const goes_well = all.substeps > taken && next_.time_state.retries == 0;
                if (goes_well) pace.tell(next_.time_state.time, controller.end, all);
            }
        }
        catch (...) {
            finish();
            until_error_ = std::move(all);
            throw;
        }
        next_.time_state.ready = false;
        finish();
        if constexpr (!is_full) all.stopped_by = detail::of_first_rank(scene.backend, all.stopped_by);
        return all;
    }

    /// Brings the scene to rest; see Solver::settle, and settle_scene.hpp.
    template <class... Effects>
    RestReport settle(Scene& scene, Effects const&... effects);
    /// How the last call of implicit steps was solved.
    SolveReport const& solved() const { return memory_.solve.report; }
    /// Bytes that implicit steps keep of particles and coarse grids.
    std::size_t memory() const
    {
        if constexpr (StepsImplicitly<Transfer>)
            return memory_.solve.memory();
        else
            return 0;
    }

    /// Goes on from another time and other bounds, and from another list of removed particles.
    void go_on_from(TimeState const& time_state, Failures isolated)
    {
        quarantine_.go_on_from(std::move(isolated));
        go_on_from(time_state);
    }
    /// The same with the list as it is.
    void go_on_from(TimeState const& time_state)
    {
        next_.go_on_from(time_state);
        memory_.nodes_spoiled = false;
    }

private:
    /// The least share of the load of a scene that settles in one step.
    static constexpr double smallest_load = 0x1p-6;

    typename Driver::Scene parts_of(Scene& scene)
    {
        return {scene.sets,        scene.grid_state,           next_.time_state,
                scene.masses.unit, scene.smallest_node_mass(), quarantine_.most() > 0,
                groups_.of_call()};
    }

    void begin_call(Scene& scene)
    {
        scene.begin_call();
        if constexpr (Sets::keep_volume) memory_.volumes.begin_call();
        if constexpr (StepsImplicitly<Transfer>) memory_.solve.report = {};
    }

    /// Takes the chosen step and, on a backend that queues, some of the `most - 1` after it: see
    /// StepDriver::take and StepQueue::take.
    template <class Effects, class Visit>
    StepLog const& run(Scene& scene, Controller const& controller, std::size_t most, Effects const& effects,
                       Visit const& visit)
    {
        auto const parts = parts_of(scene);
        int at_once = 1;
        if constexpr (Scene::Backend::queues)
            at_once = groups_.most_steps(driver_.steps_at_once(memory_, parts, most));
        if constexpr (Sets::keep_volume)
            at_once = memory_.volumes.steps_at_once(at_once, next_.time_state.time,
                                                    next_.time_state.now.interval.length(),
                                                    volume_interval(scene.sets, scene.lattice.cell_size));
        // outside of the change: this may run out of memory before the scene changes
        typename Driver::template Steps<Effects> steps(memory_, parts, controller, effects, at_once);
        StepLog const* log = nullptr;
        scene.change([&] { log = &driver_.take(steps, visit); });
        if (log->failed == 0)
            next_.trust_bounds();
        else if (log->cause == FailureCause::overflowed) {
            overflowed_ = detail::with_fastest(scene.sets, *log, scene.values(scene.sets));
            log = &overflowed_;
        }
        if constexpr (StepsImplicitly<Transfer>)
            if (log->failed > 0 &&
                (log->cause == FailureCause::unsolved || log->cause == FailureCause::inaccurate)) {
                if (memory_.solve.refused != nullptr) refuse_step(scene);
                overflowed_ = detail::with_nearest(scene.backend, scene.sets, *log, solved().where);
                log = &overflowed_;
            }
        return *log;
    }

    /// Overwrites a report with a record; the report may have been another step's.
    template <class... Effects, class Record>
    void describe(Record const& record, double mass_unit, StepReport& report)
    {
        report.dt = record.dt;
        report.time_of_forces = record.forces;
        report.stable_dt = record.stable;
        report.capped_of.assign(record.capped.begin(), record.capped.end());
        report.capped = std::accumulate(record.capped.begin(), record.capped.end(), std::uint64_t(0));
        report.reactions.clear();
        groups_.template append_reactions<Effects...>(record.reactions, mass_unit, report.reactions);
    }

    /// Where the chosen step is too short to advance time: repeated halving did not prevent the failure of
    /// `failed`, or a particle's own state allows no step. Drops stale bounds or removes particles, or
    /// throws.
    [[gnu::cold]] void get_unstuck(Scene& scene, Controller& controller, StepLog const& failed,
                                   AdvanceReport& all)
    {
        double const tried = next_.time_state.now.interval.length();
        bool const repeated = next_.time_state.retries > 0;
        auto const failure = repeated ? detail::failure_of(scene.sets, failed, next_.time_state.time, tried)
                                      : next_.slowest(scene, controller, tried);
        if (!repeated && !failure && next_.forgets_bounds(scene, controller)) return;
        auto step = failed_step(repeated ? failed : StepLog{}, tried, failure.has_value());
        step.failure = failure;
        if (!isolates(scene, controller, step, all.isolated)) fail_to_get_on(scene, failure);
    }

    /// After a failed step: plans it at half its length or without some particles, or throws.
    [[gnu::cold]] void retry(Scene& scene, Controller& controller, StepLog const& failed, AdvanceReport& all)
    {
        ++all.rejected;
        // Too many failures in a row, or a step that earlier failures have made as short. Without the second
        // test, single good steps between failing ones would keep the loop going for ever.
        bool const last =
            ++next_.time_state.retries > next_.control.retries ||
            next_.time_state.now.longest <
                std::ldexp(std::min(next_.time_state.stable, controller.duration), -next_.control.retries);
        double const dt = next_.time_state.now.interval.length();
        if (!isolates(scene, controller, failed_step(failed, dt, last), all.isolated) && last)
            fail(scene, failed, dt);
    }

    /// Refuses a call that ranks make with other lengths of steps, or with effects of other bounds.
    static void require_same_on_ranks(Scene const& scene, char const* call, Controller const& of,
                                      double count)
    {
        if constexpr (spans_ranks<typename Scene::Backend>)
            detail::require_same_on_ranks(
                scene.backend, call,
                detail::text_of(of.equal, count, of.duration, of.acceleration, of.obstacle_speed, of.field));
    }

    detail::FailedStep failed_step(StepLog const& log, double dt, bool last) const
    {
        return {.log = log, .time = next_.time_state.time, .dt = dt, .last = last};
    }

    /// Removes particles because of a failed step, and finds the bounds anew: see Quarantine::isolate.
    bool isolate(Scene& scene, detail::FailedStep const& step, Failures& isolated)
    {
        if (!quarantine_.isolate(scene, step, isolated)) return false;
        next_.time_state.retries = 0;
        next_.time_state.ready = false;
        next_.find_bounds(scene);
        return true;
    }

    /// The same if quarantine() was called; drops the limits that came from the removed particles. The call
    /// goes through a pointer so that isolate() is compiled only for programs that ask for it.
    [[gnu::cold]] bool isolates(Scene& scene, Controller& controller, detail::FailedStep const& step,
                                Failures& isolated)
    {
        if (isolate_ == nullptr || !(this->*isolate_)(scene, step, isolated)) return false;
        Controller const of_rest = next_.controller_of(scene, scene.sets);
        controller.limits = of_rest.limits;
        controller.field = of_rest.field;
        if (scene.size() == 0) controller.acceleration = controller.obstacle_speed = 0;
        return true;
    }

    /// After a failed step: see GridState::regain_velocities.
    [[gnu::cold]] void regain_velocities(Scene& scene)
    {
        if (!memory_.nodes_spoiled) return;
        if (scene.sets.has_grid_fields())
            // the sums contain the forces of the failed step, which may be too large to subtract without
            // rounding errors
            scene.grid_state.forget();
        else
            scene.change([&] { scene.grid_state.regain_velocities(scene.sets, scene.smallest_node_mass()); });
        memory_.nodes_spoiled = false;
    }

    /// Where an implicit step cannot be solved at all.
    [[noreturn, gnu::cold]] void refuse_step(Scene& scene)
    {
        regain_velocities(scene);
        throw Error{memory_.solve.refused, place_of_solve(),
                    "Pass obstacles that hold the scene against its load, held regions, forces and gravity, "
                    "or choose "
                    "SymplecticEuler."};
    }
    /// Where a solve did not go on, if that is not so in all of a scene that is to rest.
    std::string place_of_solve() const
    {
        std::string const call = memory_.solve.at_rest ? "Solver::settle" : "an implicit step";
        return memory_.solve.is_everywhere ? call : call + ", " + detail::at_place(solved().where, d);
    }
    /// Where no load step was found, since a particle has no stress as it is.
    [[gnu::cold]] void require_stress(Scene const& scene) const
    {
        auto const without = detail::without_stress(scene.sets, 0, next_.time_state.time, 0);
        if (without.empty()) return;
        detail::throw_without_stress(without.front(), Sets::name(without.front().material), d);
    }
    [[noreturn, gnu::cold]] void fail_to_rest() const
    {
        std::string const why =
            memory_.solve.loose != nullptr ? memory_.solve.loose : detail::in_words(solved(), d);
        throw Error{"no state of rest was found for a load step of " + std::to_string(smallest_load) +
                        " of the load: " + why,
                    place_of_solve(),
                    "The state is that of the last load step that was found. Look at what is not held, at "
                    "loads beyond what the material bears, or at few particles per cell: 9 in the plane."};
    }

    [[noreturn, gnu::cold]] void fail_to_get_on(Scene& scene, std::optional<StepFailure> const& since)
    {
        regain_velocities(scene);
        detail::throw_no_step(next_.time_state, since, since ? Sets::name(since->material) : "", d);
    }

    [[noreturn, gnu::cold]] void fail(Scene& scene,
                                      StepLog const log, // a copy: later work overwrites the log
                                      double dt)
    {
        bool const cached = scene.sets.has_grid_fields();
        regain_velocities(scene); // first, because what follows may run out of memory
        std::string kept = "The state is that of the last good step";
        if (!cached) kept += ", but for velocities, which were taken anew (see Solver::step)";
        if (isolate_ != nullptr)
            kept += "; of " + std::to_string(quarantine_.most()) +
                    " particles that may be in quarantine there are " + std::to_string(isolated().size()) +
                    ", which stay out (Solver::isolated)";
        if constexpr (StepsImplicitly<Transfer>)
            if (log.cause == FailureCause::unsolved) kept = detail::in_words(solved(), d) + ". " + kept;
        StepFailure failure = detail::failure_of(scene.sets, log, next_.time_state.time, dt);
        auto const spoilers = detail::without_stress(scene.sets, 0, next_.time_state.time, dt);
        if (!spoilers.empty()) { // their missing stress makes other particles fail
            failure = spoilers.front();
            failure.count = log.failed;
        }
        detail::throw_step_error(failure, next_.time_state.stable, Sets::name(failure.material), kept, d);
    }

    NextStep<Scene> next_;
    typename Driver::Memory memory_;
    Driver driver_;
    Groups<typename Scene::Backend, Number, d> groups_;
    detail::Quarantine quarantine_;
    bool (TimeLoop::*isolate_)(Scene&, detail::FailedStep const&, Failures&) = nullptr;
    AdvanceReport until_error_; ///< see until_error()
    StepLog overflowed_;        ///< of such a step, or one that was not solved, with a particle
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/groups.hpp>
#include <firn/particles/material_sets.hpp>
#include <firn/phases/g2p2g.hpp>
#include <firn/time_stepping/act_at_surfaces.hpp>
#include <firn/time_stepping/find_shifts.hpp>
#include <firn/time_stepping/finish_step.hpp>
#include <firn/time_stepping/grid_state.hpp>
#include <firn/time_stepping/solve_step.hpp>
#include <firn/time_stepping/step_scene.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <type_traits>
#include <utility>

namespace firn
{

/// The steps of one batch: the phases that a backend runs for each of them, and the host's part before and
/// after. A batch is one step, or as many as a backend queues. Steps are counted from 0 on. StepDriver shows
/// in which order a step calls its members.
template <class Backend, class Sets, class Kernel, class Transfer, class Effects>
class StepPhases
{
public:
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension, materials = static_cast<int>(Sets::count);
    using Scene = StepScene<Backend, Sets, Kernel, Transfer>;
    using Memory = StepMemory<Backend, Sets, Transfer>;
    using Controller = TimeStepController<materials>;
    using Actions = decltype(std::declval<Effects const&>().template over<Number, d>(Interval{}));
    using Entry = StepEntry<Actions::obstacles, materials>;

    /// Prepares the log of `most` steps, and the first step's context. If the time state is ready, controller
    /// and effects of the batch before are used, whatever is passed here.
    FIRN_COLD StepPhases(Memory& memory, Scene const& scene, Controller const& controller,
                         Effects const& effects, int most)
        : memory_(memory), scene_(scene), most_(most), is_of_given_length_(controller.equal > 0),
          largest_deformation_(static_cast<Number>(controller.control.rejection)),
          storage_(resized(memory.storage.template of<Storage>(), 1)),
          log_(resized(memory.storage.template of<Entry>(), Entry::count(std::size_t(most))))
    {
        for_each_group([&](auto& group) { group.expect(most); });
        BeginBatch<Actions::obstacles, materials> const begin{scene.time_state, log_};
        auto const entries = Entry::count(std::size_t(most));
        if (scene.time_state.ready)
            memory.backend.for_each(entries, begin);
        else
            memory.backend.for_each(
                entries, BeginSteps<Number, d, materials, Effects, Actions>{
                             begin, {controller, scene.sets.densities(), effects}, &storage_->plan, now(0)});
        Sets::for_each([&](auto k) {
            particles<k>().make_next();
            had_cached_[k] = particles<k>().has_grid_fields();
            wrote_derived_[k] = MaterialTraits<k>::Derived::components(d) > 0 &&
                                (effects.touch_particles() || scene.may_lose_particles);
        });
    }

    Backend const& backend() const { return memory_.backend; }
    /// How many steps there are at most.
    int most() const { return most_; }

    /// Rebins the particles into the cells that they have moved to. Scattering the leavers may complete it.
    void rebin()
    {
        Sets::for_each([&](auto k) { particles<k>().begin_sort(); });
        if constexpr (StepsImplicitly<Transfer> || Sets::keep_volume) finish_rebin();
    }
    /// Called where a step ends before the particles have moved, or is not committed.
    void finish_rebin()
    {
        Sets::for_each([&](auto k) { particles<k>().finish_sort(); });
    }

    /// Activates the grid blocks under the particles.
    void activate_grid() { grid().activate(orders()); }

    /// Particles scatter what they have not yet: nothing usually, since they did in the step before.
    void scatter_missing()
    {
        scene_.grid_state.scatter_missing(scene_.time_state.now.interval.forces, scene_.sets);
        if constexpr (spans_ranks<Backend>)
            detail::balance_ranks(scene_.sets, scene_.grid_state.grid(), memory_.backend);
    }

    /// Finds how far the particles of a fluid are to be moved in the first step, so that it keeps its volume:
    /// in the steps that correct it, and for other materials never.
    void find_shifts()
    {
        if constexpr (Sets::keep_volume) {
            if (!memory_.volumes.is_due()) return;
            // obstacles are placed to find the room beside them; update_grid() begins the step with them anew
            for_each_group([&](auto& group) { group.begin(begun(0)); });
            firn::find_shifts(memory_, scene_, now(0));
        }
    }

    /// Finds the velocities of an implicit step, which take up the first of a batch. If they are not found,
    /// returns false and logs that the step failed.
    bool solve()
    {
        if constexpr (StepsImplicitly<Transfer>) {
            // obstacles are placed for the solve; update_grid() begins the step with them anew
            for_each_group([&](auto& group) { group.begin(begun(0)); });
            auto step = solve_step(0);
            FailureCause cause = FailureCause::unsolved;
            if (step.solve()) {
                ChosenStep const longest = step.longest_next();
                if (is_of_given_length_ || step.is_accurate()) {
                    memory_.backend.for_each(1, NoteLongest<Entry>{log_, 0, longest});
                    return true;
                }
                cause = FailureCause::inaccurate;
            }
            memory_.backend.for_each(1, LogUnsolved<Entry>{log_, 0, cause});
            return false;
        }
        else
            return true;
    }

    /// Nodes turn momentum into velocity, on which the effects act, and last of them the obstacles that act
    /// at their surface. Returns the reactions of obstacles, or a handle to them.
    auto update_grid(int step)
    {
        constexpr bool at_surfaces = Actions::groups_at_surface > 0;
        for_each_group([&](auto& group) { group.begin(begun(step)); });
        if constexpr (StepsImplicitly<Transfer>)
            return solve_step(step).conclude(step);
        else {
            scene_.grid_state.extend_velocities(scene_.sets, scene_.smallest_node_mass);
            auto const phase = scene_.grid_state.grid_update(
                scene_.sets, now(step), scene_.smallest_node_mass, scene_.mass_unit, true);
            auto reactions = [&] {
                if constexpr (at_surfaces)
                    return find_points_and_update(memory_, scene_, now(step), phase, step == 0);
                else
                    return memory_.backend.for_each_node(orders(), grid(), phase);
            }();
            if constexpr (spans_ranks<Backend>) {
                for_each_group([](auto& group) { group.do_not_count(); });
                memory_.backend.for_each_other_node(orders(), grid(), phase);
                for_each_group([&](auto& group) { group.count(step); });
            }
            if constexpr (at_surfaces)
                act_at_surfaces(memory_, scene_, now(step), step == 0 ? nullptr : now(step - 1));
            return reactions;
        }
    }

    /// Particles gather velocities, move, and scatter to the grid of the next step. Returns what they found,
    /// material by material.
    auto g2p2g(int step) const { return run_g2p2g(g2p2g_phases(step), Places{}); }
    /// Ranks whose loops leave what they have found on devices share it here.
    template <class OfNodes, class Found>
    void share_results([[maybe_unused]] OfNodes& of_nodes, [[maybe_unused]] Found& found) const
    {
        if constexpr (shares_results) {
            Sets::for_each(
                [&](auto k) { detail::tell_what_travels(particles<k>().contents(), wrote_derived_[k]); });
            memory_.backend.share_results(orders(), of_nodes, found);
        }
    }
    /// They learn here, when the log is read, whether all of them had room, and else do it once more.
    template <class OfNodes, class Found>
    void repeat_without_room([[maybe_unused]] int step, [[maybe_unused]] OfNodes& of_nodes,
                             [[maybe_unused]] Found& found)
    {
        if constexpr (shares_results)
            while (!memory_.backend.had_room(
                orders(), of_nodes, found, [&] { found = run_g2p2g(g2p2g_phases_again(step), Places{}); })) {
                run_finish(step, of_nodes, found);
                read_log(step + 1);
            }
    }
    /// The phases of which that consists.
    auto g2p2g_phases(int step) const { return g2p2g_phases(step, Places{}); }
    /// The same to move particles once more in a step in which some had no room.
    auto g2p2g_phases_again(int step) const
    {
        for_each_group([&](auto& group) { group.begin_again(begun(step)); });
        return g2p2g_phases(step);
    }

    /// Chooses the next step by what the others have found.
    template <class OfNodes, class Found>
    void finish_step(int step, OfNodes const& of_nodes, Found const& found) const
    {
        if constexpr (spans_ranks<Backend>) for_each_group([&](auto& group) { group.add_ranks(step); });
        run_finish(step, of_nodes, found);
    }
    /// The phase that does so.
    auto finish_phase(int step) const
    {
        return FinishStep<Number, d, materials, Effects, Actions>{&storage_->plan, log_, step, now(step + 1)};
    }

    /// Commits a step that is done, or is queued and expected to succeed.
    void commit()
    {
        Sets::for_each([&](auto k) { particles<k>().swap(wrote_derived_[k]); });
        grid().swap();
    }

    /// Waits for the first so many steps, and reads the log.
    void read_log(int steps)
    {
        for_each_group([&](auto& group) { group.add_up(steps); });
        auto& log = memory_.storage.template of<Entry>();
        if constexpr (shares_results) { // what needs no answer goes on while the host waits
            log.fetch();
            memory_.backend.go_on_early(orders());
        }
        heard_ = log.read();
    }
    Entry const& entry(int i) const { return heard_[i]; }
    /// How many steps have been taken.
    int taken() const
    {
        int count = 0;
        while (heard_[count + 1].taken != 0) ++count;
        return count;
    }
    /// Whether the step after those that were taken was begun, and then stopped: the host is to begin it.
    bool has_stopped() const
    {
        bool has = false;
        for_each_group([&](auto& group) { has = has || group.has_stopped(); });
        return has;
    }
    /// Whether the step after those that were taken failed.
    bool has_failed() const { return heard_[taken() + 1].after.failed > 0; }

    /// Adopts the state that an entry of the log describes, after so many steps; `leavers_scattered` says
    /// whether particles that changed cells in the last one have scattered to their new cells.
    void adopt(int place, int taken, bool leavers_scattered)
    {
        scene_.time_state = heard_[place].after.time_state;
        Sets::for_each([&](auto k) {
            particles<k>().set_cached(taken > 0 ? wrote_derived_[k] : had_cached_[k], had_cached_[k]);
        });
        if (taken > 0)
            scene_.grid_state.set_scattered(scene_.time_state.scattered.interval.forces, leavers_scattered);
    }

    /// Says how the batch ended, for the next one: how many steps were taken, and whether the one behind them
    /// failed.
    void end(int taken, bool failed)
    {
        for_each_group(
            [&](auto& group) { group.end(taken, failed, taken > 0 ? heard_[taken].record.dt : 0); });
        if constexpr (Sets::keep_volume) memory_.volumes.end(taken);
        memory_.turn = (memory_.turn + taken) % 2;
        memory_.nodes_spoiled = failed;
    }

    /// The cell orders of all materials, and the grid's layers.
    auto orders() const { return scene_.sets.orders(); }
    auto layers() const { return layers(Places{}); }

protected:
    using GridStateType = GridState<Backend, Sets, Kernel, Transfer>;

    template <std::size_t k>
    auto& particles() const
    {
        return scene_.sets.template particles<k>();
    }
    auto& grid() const { return scene_.grid_state.grid(); }
    bool wrote_derived(std::size_t material) const { return wrote_derived_[material]; }

private:
    template <std::size_t k>
    using MaterialTraits = typename Sets::template MaterialTraits<k>;
    using Places = typename Sets::Places;
    using Storage = StepStorage<Number, materials, Effects, Actions>;

    /// Whether loops leave what they have found on devices, and ranks share it.
    static constexpr bool shares_results = [] {
        if constexpr (spans_ranks<Backend>)
            return Backend::shares_results;
        else
            return false;
    }();

    template <class OfNodes, class Found>
    void run_finish(int step, OfNodes const& of_nodes, Found const& found) const
    {
        auto const finish = finish_phase(step);
        if constexpr (requires { memory_.backend.finish_step(finish, of_nodes, found); })
            memory_.backend.finish_step(finish, of_nodes, found);
        else
            std::apply([&](auto const&... of) { finish(of_nodes, of...); }, found);
    }

    template <class Phases, std::size_t... k>
    auto run_g2p2g(Phases const& phases, std::index_sequence<k...>) const
    {
        auto layers = this->layers();
        return std::tuple{memory_.backend.for_each_cell(particles<k>().cells(), layers[k],
                                                        std::get<k>(phases))...}; // one after the other
    }

    template <class Buffer>
    static auto* resized(Buffer& buffer, std::size_t size)
    {
        buffer.resize(size);
        return buffer.data();
    }

    template <class Use>
    void for_each_group([[maybe_unused]] Use const& use) const
    {
        if constexpr (detail::has_groups<Effects>)
            for (auto* const group : scene_.groups) use(*group);
    }
    auto solve_step(int step) const
    {
        return SolveStep<Backend, Sets, Kernel, Transfer, Actions>(memory_, scene_, now(step));
    }
    BegunStep begun(int step) const
    {
        return {step, &log_[step].after.time_state.now.interval, step > 0 ? &log_[step].taken : nullptr};
    }
    auto* now(int step) const { return storage_->now + (memory_.turn + step) % 2; }

    template <std::size_t... k>
    auto g2p2g_phases(int step, std::index_sequence<k...>) const
    {
        return std::tuple{g2p2g_of<k>(step)...};
    }
    template <std::size_t k>
    auto g2p2g_of(int step) const
    {
        auto& table = particles<k>();
        return G2p2g<Space, typename MaterialTraits<k>::Model, Kernel, Transfer, Actions,
                     typename MaterialTraits<k>::Stored, typename MaterialTraits<k>::Derived>{
            scene_.sets.template model<k>(),
            memory_.transfer,
            now(step),
            table.current(),
            table.next(),
            wrote_derived_[k] ? table.next_derived() : typename MaterialTraits<k>::Table::DerivedView{},
            table.mass_groups(),
            memory_.lattice,
            static_cast<Number>(memory_.lattice.cell_size),
            static_cast<Number>(1 / memory_.lattice.cell_size),
            largest_deformation_,
            shifts_of<k>(step)};
    }
    /// How far particles are moved in a step beside the grid's motion.
    template <std::size_t k>
    auto shifts_of([[maybe_unused]] int step) const
    {
        ShiftsOf<typename MaterialTraits<k>::Model, Number, d> shifts{};
        if constexpr (KeepsItsVolume<typename MaterialTraits<k>::Model>)
            if (step == 0 && memory_.volumes.is_due())
                shifts = memory_.volumes.shifts(k, particles<k>().size());
        return shifts;
    }
    template <std::size_t... k>
    auto layers(std::index_sequence<k...>) const
    {
        return std::array{grid().layer(k)...};
    }

    Memory& memory_;
    Scene const& scene_;
    int most_;
    bool is_of_given_length_; ///< each step, however large its error
    Number largest_deformation_;
    Storage* storage_;             ///< where steps run
    Entry* log_;                   ///< where steps run
    Entry const* heard_ = nullptr; ///< the host's copy of the log
    /// Of each material: whether the gathered fields were cached before the batch, and whether its steps
    /// write them. Steps must write them where obstacles push particles, which sets velocities that cannot be
    /// regathered, and where particles may be removed after a failed step, which has overwritten the grid.
    std::array<bool, Sets::count> had_cached_{}, wrote_derived_{};
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/particles/material_sets.hpp>
#include <firn/phases/g2p2g.hpp>
#include <firn/time_stepping/finish_step.hpp>
#include <firn/time_stepping/grid_state.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <tuple>
#include <type_traits>
#include <utility>

namespace firn
{

/// Takes the steps of a scene, in batches. A backend with queues takes as many steps in one batch as it
/// queues before the host reads the log; others take them one by one.
///
/// A step is: rebin the particles, activate the grid blocks under them, scatter what is missing (most was
/// scattered in the step before); then update the grid, gather, move, scatter to the next step, and choose
/// that by the bounds found. See StepBatch, and the phases.
template <class Backend, class Sets, class Kernel, class Transfer>
class StepDriver
{
public:
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension, materials = static_cast<int>(Sets::count);
    using Controller = TimeStepController<materials>;
    using GridStateType = GridState<Backend, Sets, Kernel, Transfer>;

    /// What steps change, and the values they need for it.
    struct Scene
    {
        Sets& sets;
        GridStateType& grid_state;
        TimeState& time_state;
        double mass_unit;          ///< of masses [kg]
        Number smallest_node_mass; ///< below it a node's momentum is rounding alone [mass units]
        bool may_lose_particles;   ///< after a failed step
    };

    StepDriver(Lattice lattice, Transfer const& transfer, Backend const& backend)
        : lattice_(lattice), transfer_(transfer), backend_(backend), now_(backend_), log_(backend_)
    {}

    /// Takes the chosen step and those after it, `most` in all: as many as the backend queues, and as long as
    /// they go as planned. Calls `visit` with the record of each. A failed step leaves the particles, and the
    /// sums they scattered, unchanged. If the time state is ready, controller and effects of the batch before
    /// are used, whatever is passed here.
    ///
    /// If memory runs out or a device fails in the middle, there is no state to go on from.
    template <class Effects, class Visit>
    FIRN_COLD StepLog const& take(Scene const& scene, Controller const& controller, std::size_t most,
                                  Effects const& effects, Visit const& visit)
    {
        auto const orders = scene.sets.orders();
        int const expected = static_cast<int>(std::min(most, backend_.steps_to_queue(orders, queue_)));
        StepBatch<Effects> batch(*this, scene, controller, effects, expected);
        auto& grid = scene.grid_state.grid();
        Sets::for_each([&](auto k) { // the order of cells, which scattering the leavers may complete
            scene.sets.template particles<k>().sort(
                [](auto& cells, auto const& offsets) { cells.begin_rebin(offsets); });
        });
        grid.activate(orders); // the blocks under them
        scene.grid_state.scatter_missing(scene.time_state.now.interval.forces, scene.sets);
        batch.begin(controller, effects);
        auto const layers = batch.layers();
        auto reacted = batch.update_nodes(0);
        int queued = 1;
        if constexpr (Backend::queues)
            for (; queued < expected && backend_.throttle(orders); reacted = batch.update_nodes(queued++)) {
                auto const choice = backend_.move_on(orders, layers, batch.move(queued - 1), reacted,
                                                     batch.finish(queued - 1));
                batch.commit(); // expecting success
                batch.rebin(choice);
            }
        backend_.move(orders, layers, batch.move(queued - 1), reacted, batch.finish(queued - 1));
        batch.read_log();
        bool lacked = false, scattered_early = false;
        if constexpr (Backend::queues) {
            lacked = backend_.poll(orders);
            scattered_early = !lacked && backend_.rebins_early(orders) && batch.taken() < queued;
            if (lacked) { // a step ran out of room, and those after it did nothing
                int const lacking = batch.taken() - (batch.has_failed() ? 0 : 1);
                batch.rollback(queued - 1 - lacking, queued - 1 - lacking);
                queued = lacking + 1;
                do {
                    batch.adopt(lacking, lacking, true);
                    backend_.complete(orders, layers, batch.move(lacking), reacted, batch.finish(lacking));
                    batch.read_log();
                } while (backend_.poll(orders));
            }
        }
        int const taken = batch.taken();
        spoiled_ = taken < queued && batch.has_failed();
        if (taken == queued)
            batch.commit();
        else if constexpr (Backend::queues)
            batch.rollback(queued - 1 - taken, queued - 1 - taken + (spoiled_ ? 0 : 1));
        int const last = taken + (spoiled_ ? 1 : 0);
        batch.adopt(last, taken, spoiled_ || scattered_early);
        turn_ = (turn_ + taken) % 2;
        learn(taken, taken == expected && !lacked);
        for (int i = 0; i < taken; ++i) visit(batch.heard().records[i]);
        return batch.heard().at[last];
    }

    /// Whether the last step failed, so that nodes do not have the velocities of the last good one.
    bool has_spoiled_nodes() const { return spoiled_; }
    void forget_spoiled_nodes() { spoiled_ = false; }

    /// The context of some step, without its effects.
    StepContext<Number, Chain<>> const* any_step()
    {
        return reinterpret_cast<StepContext<Number, Chain<>> const*>(now_.data());
    }

private:
    template <std::size_t k>
    using MaterialTraits = typename Sets::template MaterialTraits<k>;

    /// The steps of one batch: builds their phases, and does the host's part.
    template <class Effects>
    class StepBatch
    {
        using Actions = decltype(std::declval<Effects const&>().template over<Number, d>(Interval{}));
        using Now = StepContext<Number, Actions>;
        using Plan = BatchPlan<Effects, materials>;
        using Log = BatchLog<Actions::obstacles, materials>;
        static_assert(std::is_trivially_destructible_v<Now>, "an effect's action is a plain value");
        static_assert(std::is_trivially_destructible_v<Plan>, "an effect, as steps know it, too");
        // a plan may need stricter alignment than the contexts before it end at: obstacles have quaternions
        static constexpr std::size_t plan_at =
            (2 * sizeof(Now) + alignof(Plan) - 1) / alignof(Plan) * alignof(Plan);

    public:
        StepBatch(StepDriver& driver, Scene const& scene, Controller const& controller,
                  Effects const& effects, int expected)
            : driver_(driver), scene_(scene),
              largest_deformation_(static_cast<Number>(controller.control.rejection)), expected_(expected)
        {
            driver_.now_.resize(plan_at + sizeof(Plan));
            driver_.log_.resize(Log::bytes(std::size_t(expected)));
            now_ = reinterpret_cast<Now*>(driver_.now_.data());
            plan_ = reinterpret_cast<Plan*>(driver_.now_.data() + plan_at);
            log_ = Log::over(driver_.log_.data(), std::size_t(expected));
            Sets::for_each([&](auto k) {
                had_cached_[k] = particles<k>().has_grid_fields();
                wrote_derived_[k] = MaterialTraits<k>::Derived::components(d) > 0 &&
                                    (effects.touch_particles() || scene.may_lose_particles);
            });
        }

        /// Prepares the log and the first step.
        void begin(Controller const& controller, Effects const& effects)
        {
            BeginBatch<Actions::obstacles, materials> const begin_batch{scene_.time_state, log_};
            if (scene_.time_state.ready)
                driver_.backend_.for_each(Log::places(std::size_t(expected_)), begin_batch);
            else
                driver_.backend_.for_each(
                    Log::places(std::size_t(expected_)),
                    BeginSteps<Number, d, materials, Effects, Actions>{
                        begin_batch, {controller, scene_.sets.densities(), effects}, plan_, now(0)});
        }

        /// Updates the grid. Returns the reactions of obstacles.
        auto update_nodes(int step)
        {
            scene_.grid_state.extend_velocities(scene_.sets, scene_.smallest_node_mass);
            return driver_.backend_.for_each_node(scene_.sets.orders(), scene_.grid_state.grid(),
                                                  UpdateGrid<Space, Kernel, Transfer, Actions>{
                                                      now(step), driver_.lattice_, scene_.smallest_node_mass,
                                                      scene_.grid_state.flip_fraction(),
                                                      static_cast<Number>(scene_.mass_unit)});
        }

        /// The phase that moves the particles of all materials.
        auto move(int step) const { return move(step, typename Sets::Places{}); }

        /// The phase that chooses the step after this one.
        auto finish(int step) const
        {
            return FinishStep<Number, d, materials, Effects, Actions>{plan_, log_, step, now(step + 1)};
        }

        /// The grid's layers of all materials.
        auto layers() const { return layers(typename Sets::Places{}); }

        /// Rebins the particles into the cells that they have moved to; those that changed cells (the
        /// leavers) scatter there.
        template <class Choice>
        void rebin(Choice const& choice)
        {
            Sets::for_each([&](auto k) {
                particles<k>().sort([&](auto& cells, auto const& offsets) {
                    auto layer = scene_.grid_state.grid().layer(k);
                    driver_.backend_.template rebin<typename GridStateType::template P2g<k>>(cells, layer,
                                                                                             offsets, choice);
                });
            });
        }

        /// Waits for the steps, and reads their log.
        void read_log()
        {
            heard_ = Log::over(const_cast<unsigned char*>(driver_.log_.read()), std::size_t(expected_));
        }
        Log const& heard() const { return heard_; }
        int taken() const { return static_cast<int>(*heard_.taken); }
        /// Whether the step after those that were taken failed.
        bool has_failed() const { return heard_.at[taken() + 1].failed > 0; }

        /// Commits a step that is done, or is queued and expected to succeed.
        void commit()
        {
            Sets::for_each([&](auto k) { particles<k>().swap(wrote_derived_[k]); });
            scene_.grid_state.grid().swap();
        }

        /// Undoes commit() and rebin() for steps that were queued and then not taken.
        void rollback(int accepted, int rebinned) requires Backend::queues
        {
            Sets::for_each([&](auto k) { particles<k>().rollback(accepted, rebinned, wrote_derived_[k]); });
            if (accepted % 2 != 0) scene_.grid_state.grid().swap(); // an odd number of swaps is undone by one
        }

        /// Adopts the state after some steps; `leavers_scattered` says whether particles that changed cells
        /// in the last one have scattered to their new cells.
        void adopt(int place, int taken, bool leavers_scattered)
        {
            scene_.time_state = heard_.at[place].time_state;
            Sets::for_each([&](auto k) {
                particles<k>().set_cached(taken > 0 ? wrote_derived_[k] : had_cached_[k], had_cached_[k]);
            });
            if (taken > 0)
                scene_.grid_state.set_scattered(scene_.time_state.scattered.interval.forces,
                                                leavers_scattered);
        }

    private:
        template <std::size_t k>
        auto& particles() const
        {
            return scene_.sets.template particles<k>();
        }
        Now* now(int step) const { return now_ + (driver_.turn_ + step) % 2; }

        template <std::size_t... k>
        auto move(int step, std::index_sequence<k...>) const
        {
            return std::tuple{move_material<k>(step)...};
        }
        template <std::size_t k>
        auto move_material(int step) const
        {
            auto& table = particles<k>();
            return G2p2g<Space, typename MaterialTraits<k>::Model, Kernel, Transfer, Actions,
                         typename MaterialTraits<k>::Stored, typename MaterialTraits<k>::Derived>{
                scene_.sets.template model<k>(),
                driver_.transfer_,
                now(step),
                table.current(),
                table.next(),
                wrote_derived_[k] ? table.next_derived() : typename MaterialTraits<k>::Table::DerivedView{},
                table.mass_groups(),
                driver_.lattice_,
                largest_deformation_};
        }
        template <std::size_t... k>
        auto layers(std::index_sequence<k...>) const
        {
            return std::array{scene_.grid_state.grid().layer(k)...};
        }

        StepDriver& driver_;
        Scene const& scene_;
        Number largest_deformation_;
        int expected_; ///< steps at most
        Now* now_;     ///< two, used by steps in turn
        Plan* plan_;
        Log log_{}, heard_{}; ///< where steps run, and the host's copy
        /// Of each material: whether the gathered fields were cached before the batch, and whether its steps
        /// write them. Steps must write them where obstacles push particles, which sets velocities that
        /// cannot be regathered, and where particles may be removed after a failed step, which has
        /// overwritten the grid.
        std::array<bool, Sets::count> had_cached_{}, wrote_derived_{};
    };

    /// Learns from a batch of `taken` steps how many to queue next time.
    void learn(int taken, bool as_planned)
    {
        unstopped_ += static_cast<std::size_t>(taken);
        if (as_planned)
            queue_ = std::max<std::size_t>(queue_, std::size_t(2 * taken));
        else {
            queue_ = std::max<std::size_t>(unstopped_ / 2, 1);
            unstopped_ = 0;
        }
    }

    Lattice lattice_;
    Transfer transfer_;
    Backend backend_;
    /// Two StepContext and a BatchPlan, whatever their effects. Initially zeros, because it is copied when it
    /// grows.
    typename Backend::template ReadbackBuffer<unsigned char> now_;
    typename Backend::template ReadbackBuffer<unsigned char> log_; ///< a BatchLog
    int turn_ = 0;                                                 ///< which StepContext the next step reads
    std::size_t queue_ = 1;     ///< how many steps may be queued blindly: half as many succeeded
    std::size_t unstopped_ = 0; ///< steps since queued ones were last stopped
    bool spoiled_ = false;      ///< see has_spoiled_nodes()
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/objects_by_type.hpp>
#include <firn/effects/actions.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

// Effects that stand for any number of obstacles (see Obstacles) need memory where the steps run: for the
// obstacles, and for what each of them receives.
namespace firn
{

/// The beginning of a step of a batch. What it points to lies where loops run, and may be written when the
/// step is queued already.
struct BegunStep
{
    int number;                 ///< in the batch, from 0 on
    Interval const* interval;   ///< of the step
    std::uint32_t const* taken; ///< whether the step before was taken: else this one is not; null: it is
};

template <class Backend, class Number, int d>
class SurfaceMemory;

/// The memory of one such effect in scenes on this backend.
template <class Backend, class Number, int d>
class GroupMemory
{
public:
    virtual ~GroupMemory() = default;
    /// How many obstacles the call has in it.
    virtual std::size_t size() const = 0;
    /// How many steps may be in a batch.
    virtual int most_steps() const = 0;
    /// Before a batch of at most so many steps: makes room for what obstacles receive.
    virtual void expect(int steps) = 0;
    /// Before a step: the obstacles are placed, and nothing has been received in it.
    virtual void begin(BegunStep const& step) = 0;
    /// Before a part of the step is repeated: the obstacles are placed once more, and what they receive from
    /// now on does not count, since they have received it before.
    virtual void begin_again(BegunStep const& step) = 0;
    /// On several ranks: another one counts what obstacles receive from now on, until count().
    virtual void do_not_count() = 0;
    virtual void count(int step) = 0;
    /// Adds up what they received on all ranks in a step.
    virtual void add_ranks(int step) = 0;
    /// Before the host hears of a batch: what was received in its first so many steps is added up.
    virtual void add_up(int steps) = 0;
    /// Whether loops of the batch have stopped it before a step, which the host is to begin.
    virtual bool has_stopped() { return false; }
    /// After a batch, of which so many steps were taken, the last one with a length of `dt` [s], and the next
    /// one may have failed.
    virtual void end(int taken, bool failed, double dt) = 0;
    /// Appends what each obstacle received in the next of these steps, times a factor.
    virtual void append(std::vector<Reaction>& to, double factor) = 0;
    /// The memory of obstacles that act at their surface; null for others.
    virtual SurfaceMemory<Backend, Number, d>* surface() { return nullptr; }
};

namespace detail
{
/// Whether there are groups among plain effects.
template <class Plain>
inline constexpr bool has_groups = false;
template <class First, class... Rest>
inline constexpr bool has_groups<PlainEffects<First, Rest...>> =
    is_group<First> || has_groups<PlainEffects<Rest...>>;
} // namespace detail

/// The memory of the groups of a call, kept for later calls. `Backend` runs the steps, in `d` dimensions.
///
/// An effect that is a group has `template <class Backend, class Number, int d> Staged`, a GroupMemory that
/// is made of a backend and stores the obstacles of a call by `stage(effect, lattice, begin, duration,
/// plain)`.
template <class Backend, class Number, int d>
class Groups
{
    /// The place among a call's arguments is part of the type, so that two groups of one type have memory of
    /// their own.
    template <class Effect, std::size_t place>
    struct Memory : Effect::template Staged<Backend, Number, d>
    {
        using Effect::template Staged<Backend, Number, d>::Staged;
    };

public:
    using Group = GroupMemory<Backend, Number, d>;

    explicit Groups(Backend const& backend) : backend_(backend) {}

    /// Stores the obstacles of a call that takes a time [s] from `begin` on, and writes their addresses into
    /// the call's plain effects.
    template <class Plain, class... Effects>
    void stage(Plain& plain, Lattice const& lattice, double begin, double duration, Effects const&... effects)
    {
        of_call_.clear();
        if constexpr (detail::has_groups<Plain>) {
            stage_from<0>(plain, lattice, begin, duration, effects...);
            join_surfaces();
        }
    }

    /// The groups of the call.
    std::vector<Group*> const& of_call() const { return of_call_; }
    /// At most how many of `steps` steps a batch may have.
    int most_steps(int steps) const
    {
        for (Group const* const group : of_call_) steps = std::min(steps, group->most_steps());
        return steps;
    }

    /// How many obstacles the effects of the call are.
    template <class... Effects>
    std::size_t count_obstacles() const
    {
        std::size_t count = 0;
        for (Group const* const group : of_call_) count += group->size();
        [[maybe_unused]] auto const add = [&]<class Action>(std::type_identity<Action>) {
            count += !is_group<Action> && is_obstacle<Action> ? 1 : 0;
        };
        (add(std::type_identity<detail::ActionOf<Effects, Number, d>>{}), ...);
        return count;
    }
    /// Appends what each of them received in a step, times a factor: `single` has those that are no group's,
    /// and groups have the others, in the order of steps.
    template <class... Effects, int obstacles>
    void append_reactions(Reactions<obstacles> const& single, double factor, std::vector<Reaction>& to) const
    {
        [[maybe_unused]] std::size_t next_single = 0, next_group = 0;
        [[maybe_unused]] auto const append = [&]<class Action>(std::type_identity<Action>) {
            if constexpr (is_group<Action>)
                of_call_[next_group++]->append(to, factor);
            else if constexpr (is_obstacle<Action>)
                to.push_back(single.of[next_single++] * factor);
        };
        (append(std::type_identity<detail::ActionOf<Effects, Number, d>>{}), ...);
    }

private:
    /// Obstacles that act at their surface have one surface, in whichever lists they are: see SurfaceMemory.
    void join_surfaces()
    {
        SurfaceMemory<Backend, Number, d>* first = nullptr;
        for (Group* const group : of_call_) {
            auto* const own = group->surface();
            if (first == nullptr)
                first = own;
            else if (own != nullptr)
                first->join(*own);
        }
    }

    template <std::size_t place, class Plain>
    void stage_from(Plain const&, Lattice const&, double, double)
    {}
    template <std::size_t place, class First, class... Rest, class Effect, class... Effects>
    void stage_from(PlainEffects<First, Rest...>& plain, Lattice const& lattice, double begin,
                    double duration, Effect const& effect, Effects const&... effects)
    {
        if constexpr (is_group<First>) {
            auto& memory = memory_.template of<Memory<Effect, place>>(backend_);
            memory.stage(effect, lattice, begin, duration, plain.first);
            of_call_.push_back(&memory);
        }
        stage_from<place + 1>(plain.rest, lattice, begin, duration, effects...);
    }

    Backend backend_;
    ObjectsByType memory_;
    std::vector<Group*> of_call_;
};

} // namespace firn

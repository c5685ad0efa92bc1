// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/objects_by_type.hpp>
#include <firn/effects/actions.hpp>

#include <cstddef>
#include <vector>

// Effects that stand for any number of obstacles (see Obstacles) need memory where the steps run: for the
// obstacles, and for what each of them receives.
namespace firn
{

/// The memory of one such effect.
class GroupMemory
{
public:
    virtual ~GroupMemory() = default;
    /// Before a step, whose interval lies where loops run: the obstacles are placed, and nothing has been
    /// received.
    virtual void begin(Interval const* interval) = 0;
    /// Before a part of the step is repeated: the obstacles are placed once more, and what they receive from
    /// now on does not count, since they have received it before.
    virtual void begin_again(Interval const* interval) = 0;
    /// After it: appends what each obstacle received, times a factor.
    virtual void append(std::vector<Reaction>& to, double factor) = 0;
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
    explicit Groups(Backend const& backend) : backend_(backend) {}

    /// Stores the obstacles of a call that takes a time [s] from `begin` on, and writes their addresses into
    /// the call's plain effects.
    template <class Plain, class... Effects>
    void stage(Plain& plain, Lattice const& lattice, double begin, double duration, Effects const&... effects)
    {
        of_call_.clear();
        if constexpr (detail::has_groups<Plain>) stage_from<0>(plain, lattice, begin, duration, effects...);
    }

    /// The groups of the call.
    std::vector<GroupMemory*> const& of_call() const { return of_call_; }
    /// See GroupMemory; for the group in this place among those of the call.
    void append(std::size_t place, std::vector<Reaction>& to, double factor)
    {
        of_call_[place]->append(to, factor);
    }

private:
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
    std::vector<GroupMemory*> of_call_;
};

} // namespace firn

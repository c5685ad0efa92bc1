// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/lane.hpp>
#include <firn/openmp/scatter.hpp>
#include <firn/openmp/tuning.hpp>

#include <cstddef>
#include <cstdint>

// Gather, update and scatter of a group of cells rank by rank, without a scratch in between.
namespace firn::openmp
{

/// Items of one rank of a group of cells as a phase sees them that loads what earlier loops stored: lane l is
/// the item of cell l, and scratch is in registers. Lanes without an item have zeros; `whole` says that there
/// are none.
template <class Lane, int channels, bool whole>
class ItemsOfRank
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;

    /// The items are those of the slots from `slot` on, in the lanes of the pattern.
    ItemsOfRank(std::size_t slot, std::uint64_t pattern) : slot_(slot), pattern_(pattern) {}

    void set_scratch(int channel, Lane const& value) { scratch_[channel] = value; }
    Lane const& scratch(int channel) const { return scratch_[channel]; }
    /// Values of cells in the lanes of their items: the same lanes here.
    Lane const& of_cells(Lane const& value) const { return value; }

    /// May read behind the last item.
    Lane load_stored(Number const* array) const
    {
        Lane const side_by_side = Lane::load(array + slot_);
        if constexpr (whole)
            return side_by_side;
        else
            return side_by_side.expanded(pattern_);
    }

private:
    std::size_t slot_;
    std::uint64_t pattern_;
    Lane scratch_[std::size_t(channels)];
};

namespace detail
{
/// The items of a group as a phase sees them that says what it will load: of these items, and of those behind
/// the group. Fetched one rank at a time, values arrive while others are gathered; all at once they would
/// wait for one another.
struct ExpectedItems
{
    std::size_t slot; ///< of the first of some of these
    std::size_t next; ///< of the first of some of the others

    template <class T>
    void expect_stored(T const* array) const
    {
        __builtin_prefetch(array + slot, 0, 3);
    }
    template <class T>
    void expect_next(T const* array) const
    {
        __builtin_prefetch(array + next, 0, 3);
    }
};

/// Whether a phase may go rank by rank: it moves no items, loads none from where they lie, and gathers all
/// channels of nodes at once.
template <class Lane, class Phase>
concept GoesByRank = lane_width<Lane> >
1 && Phase::work.loads_stored && !Phase::work.moves && Phase::work.scatters_to == ScatterTarget::next_sums &&
    Phase::template CellNodes<Lane>::channels >= Phase::node_channels;

/// Lets the items of a rank gather, updates them, and prepares what they scatter.
template <bool whole, class Phase, class Group, class Nodes, class Spread>
void go_on(Phase const& phase, Group const& group, std::size_t slot, Nodes const& nodes, Spread& spread)
{
    ItemsOfRank<typename Group::Real, Phase::scratch_channels, whole> items(slot, group.pattern());
    typename Phase::Result nothing;
    phase.begin(items);
    Phase::Gather::gather(items, nodes, 0);
    phase.update(items, nothing);
    Phase::Scatter::make_ready(items, spread);
}

/// The items of a group, whose first one has this slot, gather, are updated and scatter. `behind` is behind
/// the slots of all.
template <class Phase, class Group, class Nodes, class Spreads>
FIRN_INLINE_WHOLE void go_by_rank(Phase const& phase, Group& group, std::size_t first, std::size_t behind,
                                  Nodes& nodes, Spreads& spreads)
{
    nodes.read(group, 0);
    group.restart();
    for (int rank = 0, ranks = group.ranks(); rank < ranks;) {
        int here = 0;
        for (; here < static_cast<int>(spreads.size()) && rank < ranks; ++here, ++rank) {
            group.enter(rank);
            std::size_t const slot = first + group.item(), ahead = slot + slots_ahead<Group::lanes>;
            if (ahead < behind) phase.expect(ExpectedItems{ahead, ahead});
            auto& spread = spreads[static_cast<std::size_t>(here)];
            if (group.is_whole())
                go_on<true>(phase, group, slot, nodes, spread);
            else
                go_on<false>(phase, group, slot, nodes, spread);
        }
        add_rows<typename Phase::Scatter>(group, spreads, here);
    }
}
} // namespace detail

} // namespace firn::openmp

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <cstdint>

namespace firn
{

/// The result of a phase that finds nothing.
struct NothingFound
{
    std::uint32_t nothing = 0;
    FIRN_HOST_DEVICE void merge(NothingFound const&) {}
};

/// The sums on the grid that a phase scatters to.
enum class ScatterTarget
{
    nothing,
    sums,     ///< the current ones: afresh, or onto what is there if the phase `adds_to_sums()`
    next_sums ///< those that swap() makes the current ones, afresh
};

/// What a phase does with the items of the cells. A backend's for_each_cell() does it in this order: items
/// gather from the nodes, are updated, may move, and scatter. A phase that gathers scatters to the next sums
/// or to none, another one to the current sums.
struct CellWork
{
    bool gathers = false; ///< `begin`, the gather, and `update` with a result; otherwise `prepare` alone
    bool moves = false;   ///< `update` may move items out of their cells
    ScatterTarget scatters_to = ScatterTarget::nothing;
    bool loads_stored = false; ///< of items it loads nothing but what earlier loops stored, by slot
};

/// Whether a phase of nodes sees the sums of each layer by themselves, and has values for each.
template <class Phase>
concept TellsLayersApart = requires
{
    requires Phase::tells_layers_apart;
};

/// Whether a phase of nodes asks for no sums. It may then be called for nodes to which nothing was added.
template <class Phase>
concept AsksNoSums = requires
{
    requires Phase::asks_no_sums;
};

/// Whether a phase of nodes looks around in several loops over the same nodes, so that a backend may list
/// once what they look at: see backend.hpp.
template <class Phase>
concept ListsImages = requires
{
    requires Phase::looks_around;
    requires Phase::lists_images;
};

/// Whether a phase of nodes is called where all sums are zero, too.
template <class Phase>
concept TakesZeroSums = requires
{
    requires Phase::takes_zero_sums;
};

/// Whether a phase of nodes leaves the values that it does not set as they are. Else they are undefined.
template <class Phase>
concept KeepsValues = requires
{
    requires Phase::keeps_values;
};

/// Whether a node, as a phase sees it, is a single one that has an index.
template <class Node>
concept HasIndex = requires
{
    requires Node::has_index;
};

/// Whether a phase over nodes says which of them concern it, so that a backend adds up no sums of others.
template <class Phase>
concept SaysWhichConcern = requires
{
    requires Phase::says_which_concern;
};

} // namespace firn

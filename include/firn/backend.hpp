// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/queue_outcome.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

// What a backend owes, and what its loops show to phases, on one page. `backends/reference` does all of it
// but queueing by plain loops.
//
// A backend knows items, cells and nodes, and not what phases compute of them. An *item* lies at a *place* of
// all arrays. The order of cells visits the items, and an item's number in this order is its *slot*. A loop
// loads from places and stores to slots. After commit() items lie at their slots; loops with a phase still
// load from the places before that, until rebin(), so that what was gathered can be gathered once more.
// A *layer* is the grid as one order of cells sees it: sums of its own, and values that all layers share, or
// its own.
namespace firn
{

namespace detail
{
// What stands for any plain value, and for the function objects of callers.
struct alignas(32) AnyPlain
{
    explicit AnyPlain(int);
    double of[4];
};
struct AnyBody
{
    void operator()(std::size_t) const;
};
template <int d>
struct AnyVisit
{
    void operator()(std::size_t, Coordinates<d> const&) const;
};
struct AnySteps;

template <class B, class Number, int d>
using OrderOf = typename B::template CellOrder<Number, d>;
template <class B, class Number, int d>
using GridOf = typename B::template Grid<Number, d, 2, 1 + d, d, 1>; // what a default solver has, too
} // namespace detail

/// The types and constants of a backend. It is copied to all that uses it.
template <class B, class Number>
concept BackendTraits = std::copy_constructible<B> && Lane<typename B::template Lane<Number>> &&
    requires(B const backend, void* address)
{
    typename B::SharedCount;      // an int that several threads of the host may change concurrently
    bool{B::queues};              // whether loops may still be at work when a call returns
    bool{B::reaches_host_memory}; // whether loops reach the memory of the host
    int{B::largest_degree};       // the largest degree of a kernel, up to which Grid works
    backend.validate();           // throws an Error if the backend cannot work on this machine
    // if loops do not reach the host's memory: whether they can write to this address
    requires B::reaches_host_memory || requires { bool{backend.reaches(address)}; };
};

/// `B::Array<T>`: a growing array of plain values that loops access. New elements have no value.
template <class T, class B>
concept BackendArray = std::constructible_from<T, B const&> && std::movable<T> &&
    requires(T array, T const constant, std::size_t i, typename T::Value value,
             std::span<typename T::Value> values)
{
    array.resize(i);              // keeps the elements that fit
    array.resize(i, i);           // keeps the first so many; if memory is short, nothing has changed
    array.upload(i, values);      // sets elements from i on, from memory of the host
    array.fill(i, i, value);      // sets so many elements from i on
    constant.download(i, values); // copies elements from i on to memory of the host
    array.swap(array);            // with another array
    array.data();                 // where loops access it
    constant.data();
    std::size_t{constant.size()};   // elements
    std::size_t{constant.memory()}; // bytes held, spare capacity included
};

/// `B::ReadbackBuffer<T>`: values that loops write and the host reads, of any plain type: it may lack a
/// default constructor, and be aligned to more than a number. The destructor waits for loops that use it.
template <class T, class B>
concept BackendReadbackBuffer = std::constructible_from<T, B const&> && requires(T buffer, std::size_t size)
{
    buffer.resize(size);
    buffer.data();  // where loops write them
    buffer.fetch(); // read() waits for the loops that were queued before this alone
    *buffer.read(); // waits for the loops, and returns where the host reads them
};

/// Whether it is constructed from a backend and the periods of a lattice in cells.
template <class T, class B, int d, class PeriodsInCells = Periods<d>>
concept MadeWithPeriods = std::constructible_from<T, B const&, PeriodsInCells>;

/// `B::CellOrder<Number, d>`: the items of one material by their cells, and by rank within a cell. Cells are
/// wrapped by the periods that it is made with.
template <class T, class B, class Number, int d>
concept BackendCellOrder = MadeWithPeriods<T, B, d> && std::movable<T> &&
    requires(T order, T const constant, Coordinates<d> const* cells, std::uint32_t first,
             unsigned char const* gone, std::size_t kept,
             std::array<typename CellOffset<Number>::Stored*, std::size_t(d)> offsets)
{
    double{T::largest_coordinate};    // of a cell, along any axis and to either side
    std::size_t{T::bytes_per_item};   // of the order
    int{T::extent(0)};                // the cells along this axis of which a period must be a multiple
    order.insert(cells, kept, first); // adds so many items that lie at first, first + 1, … in these cells
    order.erase(gone, &first, kept);  // erases by `gone[place]`; `kept` items will lie at `second[place]`
    order.begin_rebin(offsets);       // begins rebin(), which the loop that needs it first completes
    order.rebin(offsets);             // sorts items, which lie at their slots, by offsets that it wraps
    order.commit();                   // says that all items now lie at their slots
    constant.for_each(detail::AnyVisit<d>{}); // visits (place, cell) of every item, on the host
    std::size_t{constant.size()};             // items
    std::size_t{constant.memory()};           // bytes held
};

/// `B::Grid<Number, d, degree, sums, values, layers, own_values, ungathered>`: the nodes under the cells of
/// as many orders as it has layers, each node with `sums` sums per layer, twice, and `values` values, or so
/// many per layer if `own_values` is true. Values from `values` on, `ungathered` in number, are for nodes
/// alone: items do not gather them. The last two are false and 0 if they are not said. Nodes are wrapped by
/// its periods.
template <class T, class B, class Order, int d>
concept BackendGrid = MadeWithPeriods<T, B, d> && std::movable<T> &&
    requires(T grid, T const constant, std::array<Order*, 1> orders, std::size_t layer)
{
    grid.activate(orders); // creates the nodes under the cells, and keeps the sums of those that stay
    grid.swap();           // makes the next sums the current ones, and the other way round
    grid.layer(layer);     // a handle to this layer, for the loops
    std::size_t{grid.node_count()};      // the indices of nodes
    std::uint64_t{constant.numbering()}; // changes whenever activate() gives nodes other indices
    // for loops without a phase, once nodes have been updated and until activate(): `find(node)`, its index
    // or `absent`; `find_next(node, before)`, the same if the one before it along the last axis is known;
    // `sum(index, channel)`, over all layers, and a reference to `value(index, channel)`
    grid.nodes_by_index();
    std::size_t{constant.memory()}; // bytes held
};

/// The loops of a backend without a phase. See below for those with one.
template <class B, class Order, int d>
concept BackendLoops = requires(B const backend, Order const cells, std::size_t count)
{
    backend.for_each(count, detail::AnyBody{}); // `body(i)` for every i in [0, count), in any order
    // `visit(place, cell)` for every item, for those of a cell one after the other
    backend.for_each_place(cells, detail::AnyVisit<d>{});
};

/// What a backend owes beyond that if it queues steps before it knows how those before them ended.
template <class B, class Order, class Number, int d>
concept QueueingBackend = requires(B const backend, Order order, std::array<Order*, 1> orders,
                                   std::size_t blindly, int count, detail::AnySteps& steps,
                                   std::array<typename CellOffset<Number>::Stored*, std::size_t(d)> offsets)
{
    std::size_t{backend.steps_to_queue(orders, blindly)}; // how many; `blindly` is the most to risk in vain
    QueueOutcome{backend.run_steps(steps, count)};        // queues at most so many QueuedSteps, and waits
    order.rollback(count, count, offsets);                // undoes so many commit() and rebin()
    backend.for_each_in_step(orders, blindly, detail::AnyBody{}); // for_each, unless steps have stopped
    backend.stop_steps_if(orders, std::declval<std::uint32_t const*>(), count,
                          std::declval<std::uint32_t*>()); // stops them, and sets the second, if any is not 0
    typename B::WatchedNumber; // a std::uint32_t at which the host looks while loops write it: see
                               // cuda/watched_number.hpp
};

/// All that a solver asks of a backend before it compiles a loop.
template <class B, class Number, int d>
concept CompleteBackend = BackendTraits<B, Number> && BackendArray<typename B::template Array<Number>, B> &&
    BackendReadbackBuffer<typename B::template ReadbackBuffer<detail::AnyPlain>, B> &&
    BackendCellOrder<detail::OrderOf<B, Number, d>, B, Number, d> &&
    BackendGrid<detail::GridOf<B, Number, d>, B, detail::OrderOf<B, Number, d>, d> &&
    BackendLoops<B, detail::OrderOf<B, Number, d>, d> &&
    (!B::queues || QueueingBackend<B, detail::OrderOf<B, Number, d>, Number, d>);

// ---- the loops with a phase
//
// A *phase* is a function object of plain values, with `Number`, `d`, and `Result`: what it finds, or
// NothingFound. Results are merged by `merge(other)`, in an order that does not depend on how the work was
// divided. No concept can ask for these loops without compiling one, so tests/agreement compiles them.
//
//   for_each_cell(order, layer, phase)     all items gather, are updated, may move, and scatter;
//                                          `Phase::work` says which of these (see CellWork). Returns the
//                                          merged results of a phase that moves items
//   scatter_leavers<Phase>(order, layer)   items that moved to other cells, and were rebinned, scatter there
//                                          to the current sums
//   for_each_node(orders, grid, phase)     updates all nodes that any layer added to. Returns the merged
//                                          results, or a handle from which run_steps() merges them
//   call_with(handle, body)                if it is a handle: calls `body(merged results)` once, where loops
//                                          run, before the next loop over nodes
//
// A backend that queues joins loops, for scenes so small that launching one takes longer than its work:
//
//   for_each_node(orders, grid, phase, body)   the same, and then as call_with()
//   for_each_in_turn(handle, body, loops...)   each `LoopInTurn<Body>{count, body}` after the one before, and
//                                              then as call_with(); or the loops alone
//   for_each_place(order, visit)               passes the item's slot, too, to a visit that takes three
//
// A loop over cells calls `phase.prepare(items)` if the phase does not gather. Else it calls `begin(items)`,
// gathers, and calls `update(items, result)`, or `update(items, result, rare)` with a second result for what
// is rare. Meanwhile it may ask the phase, if that has such a member, to say by `expect(items)` what it will
// load by slot: `expect_stored(array)` for items that are being gathered, `expect_next(array)` for others. If
// its `work` says that it `loads_stored`, the loop need not find out where the items lie, and may pass on an
// item from `begin` to the scatter before it begins with the next. Then it scatters: onto the current sums if
// the phase `adds_to_sums()`, and otherwise afresh.
//
//   gather(row)                            all `node_channels` of a row's nodes. Or some at a time:
//   Gather::gather(row, nodes, first)      after `nodes.read(row, first)`, where nodes are CellNodes<Real>
//   scatter(row, sums)                     to `sums[k][line][channel]`. Or line by line of the stencil:
//   Scatter::scatter(spread, line, sums)   to `sums[k][channel]`, after `Scatter::make_ready(row, spread)`
//
// A loop over nodes calls `phase(node, result)`. If the phase `looks_around`, it asks once for
// `phase.walls()`, and calls `phase.look_around(walls, node, result)` in place of that for the lanes of nodes
// for which `phase.looks_around_at(walls, first, lanes)` is true. For one that `lists_images` a backend may
// list once, for all loops over the same nodes, what they look at: `phase.list_images(walls, node)` calls
// `node.note_image(first, along, which, behind, walls)` for each image, and the node that look_around() gets
// calls them up by `node.for_each_image(use)`. What a phase that `keeps_values` does not set stays as it is;
// with others, and on nodes to which nothing was added, it may become 0. One that `asks_no_sums`, of other
// nodes neither, may be called for any nodes that such a phase was called for, and for zeros. One that
// `takes_zero_sums` is called for nodes to which zeros were added, too. One that `says_which_concern` it,
// lanes of nodes at a time, by `concerns(first, offset)`, need not be called for others.
//
// ---- what a phase sees
//
// *Items* side by side in the lanes of a `Real`, whatever their cells. A lane without an item repeats one.
//
//   here()                                 the lanes that have an item
//   load(array), store(array, lane)        from places, and to slots
//   load_stored(array)                     from slots, what an earlier loop stored before items moved
//   store_at(array, index, lane)           to `array[index[place]]`
//   copy(from, to)                         from places to slots, whatever the type
//   map(ask), value(array, lane)           the lanes of `ask(place)`; the element of one lane's item
//   load_offset(array, axis)               offsets from the centres of cells [cells], see CellOffset
//   move_offset(from, to, axis, by, value) moves the offsets that were loaded; `value` becomes what was
//                                          stored. Returns which items are still in their cells
//   leave(which, zero_from, channels)      items leave their cells: scatter_leavers() scatters so many
//                                          channels of their scratch, with their new offsets as the first d.
//                                          Here channels from `zero_from` on become 0
//   first(), along()                       the coordinates of a cell, and the way from it to the lanes' own:
//                                          0 to 7 cells along an axis, and as many as lanes along the last
//   at_the_edge()                          whether an item might leave the range of coordinates
//   expect_load(array), expect_store(array)   say what comes next
//
// A *row*: one item of each cell of a group of neighbouring cells. A lane without an item has scratch of 0.
//
//   node(channel, line, k)                 a value of node k in a line of the lanes' stencils, less
//                                          reference(channel): a value of any node nearby
//   of_cells(lane)                         moves values of cells to the lanes of their items
//
// Both have `set_scratch(channel, lane)` and `scratch(channel)`: `scratch_channels` values of an item, which
// one function of a phase stores for the next.
//
// A *node*, or neighbours along the last axis:
//
//   sum(channel), value(channel)           the sum over all layers, and the value before the update
//   set(channel, lane)                     the value after it
//   first(), offset()                      the coordinates of one, and the ways from it to the lanes' own
//   sums_at(first, along, which, sums)     the sums of the nodes `along` the last axis from `first`, in the
//                                          lanes of `which`; zeros where there is no node
//   index()                                where a node `has_index`: its number in nodes_by_index()
//
// For a phase that `tells_layers_apart`, on a grid whose layers have their own values, in place of these:
//
//   has(layer)                             whether the layer may have added to one of the nodes; for others
//                                          there is no sum to ask for and no value to set
//   sum(layer, channel)                    the sum of this layer alone
//   sum_beside(layer, channel, step, which)   that of the nodes `step` beside them, in the lanes of `which`
//   set(layer, channel, lane)              the layer's value after the update
//   first(), offset()                      as above

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/cell_group.hpp>
#include <firn/openmp/lanes.hpp>
#include <firn/openmp/node_rows.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/tuning.hpp>
#include <firn/openmp/workspace.hpp>

#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <span>
#include <type_traits>
#include <vector>

namespace firn::openmp
{

/// Lanes as wide as the compile flags allow.
struct NativeLanes
{
    template <class Number>
    using Lane = NativeLane<Number>;
};

/// One number at a time.
struct ScalarLanes
{
    template <class Number>
    using Lane = Number;
};

/// Whether exponentials, logarithms and roundings of packs are correct. xsimd's break under
/// -fassociative-math, and clang has no macro by which that flag could be refused.
template <class Number>
bool functions_hold()
{
    using Real = NativeLane<Number>;
    static bool const hold = [] {
        bool all = true;
        for (double const number : {0.3, 1.7, 5.7, 40.1}) {
            Number volatile const unknown = Number(number); // hidden from the compiler
            Number const x = unknown;
            auto const is = [&](Real lanes, Number should) {
                Number found[lane_width<Real>];
                LaneTraits<Real>::store(lanes, found);
                all = all && std::abs(found[0] - should) <=
                                 256 * std::numeric_limits<Number>::epsilon() * std::abs(should);
            };
            using firn::exp, firn::floor, firn::log;
            is(exp(Real(x)), std::exp(x));
            is(log(Real(x)), std::log(x));
            is(floor(Real(x)), std::floor(x));
        }
        return all;
    }();
    return hold;
}

/// Calls `body(i)` for each i below `count`, in any order and on several threads.
template <class Body>
void for_each(Threads const& threads, std::size_t count, Body const& body)
{
    parallel_for(threads.limited_to(count > 256 ? threads.count : 1), static_cast<std::int64_t>(count), 256,
                 [&](int) { return [&](std::int64_t i) { body(static_cast<std::size_t>(i)); }; });
}

namespace detail
{
/// Clears the rows of a tile that `rows` has bits for.
template <class GridType, int channels, class Number>
void clear_rows(Number* tile, std::uint64_t rows)
{
    for (rows &= ~GridType::ends; rows != 0; rows &= rows - 1)
        for (int c = 0; c < channels; ++c) {
            auto* const from =
                tile + c * GridType::tile_channel + std::countr_zero(rows) * GridType::row_length;
            std::fill(from, from + GridType::row_length, Number(0));
        }
}

/// The part of a block's tile that its items touch: rows, and `ends` (see touched_by).
template <class GridType, class Order>
std::uint64_t touched_by_items(Order const& cells, std::size_t b)
{
    std::uint64_t rows = 0;
    for (int group = 0; group < GridType::Shape::groups; ++group)
        if (cells.group_end(b, group) > cells.group_begin(b, group))
            rows |= GridType::touched_by(cells.counts(b, group), group);
    return rows;
}

/// A group of cells. The type is the same for a const grid, so that the code inlined into it is compiled
/// once.
template <class Lane, class GridType>
using GroupOf = CellGroup<Lane, std::remove_const_t<GridType>>;

/// Calls `use(items, how many)` for the items of some groups of cells, each with its own nodes. Out of line:
/// it is rare, and stands between loops that are not.
template <class Lane, class GridType, class Order, class Number, class Use>
[[gnu::noinline]] void use_alone(Order const& cells, std::size_t b, std::size_t slot, std::size_t count,
                                 Scratch<Lane, GridType::dimension>& scratch, Number const* read,
                                 Number* write, Use const& use)
{
    assert(count > 0 && count <= lane_width<Lane> && "items that go alone are one pack");
    int places[lane_width<Lane>];
    cells.find_places(b, slot, static_cast<int>(count), places);
    ScatteredItems<Lane, std::remove_const_t<GridType>> items(places, static_cast<int>(count), scratch, read,
                                                              write);
    use(items, count);
}

/// Calls `use(group, number behind its last item)` for each non-empty group of cells from `first` up to
/// `behind`, or once for the items of all of them if these are few in many groups. The groups' items lie side
/// by side; `read` and `write` as in CellGroup.
template <class Lane, class GridType, class Order, class Number, class Use>
void for_each_group(Order const& cells, std::size_t b, int first, int behind,
                    Scratch<Lane, GridType::dimension>& scratch, Number const* read, Number* write,
                    Use const& use)
{
    std::size_t const begin = cells.group_begin(b, first);
    if constexpr (may_go_alone<GridType::dimension, lane_width<Lane>>)
        if (behind - first > 1) {
            std::size_t filled = 0;
            for (int g = first; g < behind; ++g) filled += cells.group_end(b, g) > cells.group_begin(b, g);
            if (go_alone(1, filled))
                return use_alone<Lane, GridType>(cells, b, begin, cells.group_end(b, behind - 1) - begin,
                                                 scratch, read, write, use);
        }
    for (int g = first; g < behind; ++g) {
        std::size_t const from = cells.group_begin(b, g), to = cells.group_end(b, g);
        if (from == to) continue;
        GroupOf<Lane, GridType> group(cells.counts(b, g), g, scratch, from - begin, read, write);
        use(group, to - begin);
    }
}

/// Scatters the contributions of a group's items, row by row of their stencils, so that the sums of a row
/// stay in registers.
template <class Scatter, class Group, class Spreads>
FIRN_INLINE_WHOLE void scatter(Group& group, Spreads& spreads)
{
    using Real = typename Group::Real;
    group.restart();
    for (int rank = 0, ranks = group.ranks(); rank < ranks;) {
        int here = 0;
        for (; here < static_cast<int>(spreads.size()) && rank < ranks; ++here, ++rank) {
            group.enter(rank);
            Scatter::make_ready(group, spreads[static_cast<std::size_t>(here)]);
        }
        for (int row = 0; row < Scatter::rows; ++row) {
            Real sums[Scatter::width][Scatter::channels];
            for (auto& node : sums)
                for (auto& sum : node) sum = Real(typename Group::Number(0));
            for (int i = 0; i < here; ++i) Scatter::scatter(spreads[static_cast<std::size_t>(i)], row, sums);
            group.template add<Scatter::width, Scatter::channels>(row, sums);
        }
    }
}

/// The contributions of as many ranks as are summed at once.
template <class Lane, class Scatter>
using Spreads = std::array<typename Scatter::template Spread<Lane>, ranks_at_once>;

/// A thread's buffers for scattering.
template <class Lane, class Scatter>
struct ScatterBuffers
{
    Scratch<Lane, Scatter::d> scratch;
    Spreads<Lane, Scatter> spreads;
};

template <class Phase, class Items>
FIRN_INLINE_WHOLE void prepare(Phase const& phase, Items& items)
{
    phase.prepare(items);
}

template <class Phase, class Items>
FIRN_INLINE_WHOLE void begin_items(Phase const& phase, Items& items)
{
    phase.begin(items);
}

/// Gathers from a group's nodes. Like scatter(), this is a template over what is gathered, not over the
/// phase, so that phases share the code. Where only few cells have so many items, these are processed side by
/// side, whatever their cells. The group's items end before number `end` in the scratch.
template <class Gather, class Group, class Nodes>
FIRN_INLINE_WHOLE void gather(Group& group, std::size_t end, Nodes& nodes)
{
    for (int channel = 0; channel < Gather::node_channels; channel += Nodes::channels) {
        nodes.read(group, channel);
        group.restart();
        for (int rank = 0, ranks = group.ranks(); rank < ranks; ++rank) {
            group.enter(rank);
            if (group.is_sparse(ranks - rank, end)) {
                group.side_by_side(rank, end, [&](auto& some) { Gather::gather(some, nodes, channel); });
                break;
            }
            Gather::gather(group, nodes, channel);
        }
    }
}

/// The results of the parts of a loop, merged in the order of the parts, whichever thread did them. The
/// thread that works on a part calls begin() for it: then no other thread's cache needs to hold it.
template <class Result>
class ResultsOf
{
public:
    static ResultsOf& make_ready(Workspace& workspace, std::size_t parts)
    {
        auto& results = workspace.for_threads(1).template of<ResultsOf>(0);
        results.of_.resize(parts);
        return results;
    }
    Result& begin(std::size_t part) { return of_[part] = {}; }
    Result merged() const
    {
        Result all{};
        for (Result const& result : of_) all.merge(result);
        return all;
    }

private:
    std::vector<Result> of_;
};

/// A phase that finds bounds keeps them in one result per thread: starting each block at zero would find a
/// new largest value many times over.
template <class Phase, class Items>
FIRN_INLINE_WHOLE void update_items(Phase const& phase, Items& items, typename Phase::Result& of_thread,
                                    typename Phase::Result& of_block)
{
    if constexpr (requires { phase.update(items, of_thread, of_block); })
        phase.update(items, of_thread, of_block);
    else
        phase.update(items, of_block);
}
} // namespace detail

/// Each block of cells sums the contributions of its items into its own tile: afresh, or onto what is there.
template <class Lane, class Order, class GridType, class Phase>
void scatter(Threads const& threads, Order const& cells, GridType& grid, Phase const& phase, bool afresh)
{
    constexpr int d = Phase::d, lanes = lane_width<Lane>;
    using ScatterBuffers = detail::ScatterBuffers<Lane, typename Phase::Scatter>;
    int const blocks = static_cast<int>(cells.blocks().size());
    Workspace& workspace = cells.workspace().for_threads(threads.count);
    parallel_for(threads, blocks, cells.partitions(), [&](int thread) {
        return [&, &buffers = workspace.of<ScatterBuffers>(thread)](int b) {
            auto& [scratch, spreads] = buffers;
            if (afresh) grid.touched(std::size_t(b)) = 0;
            std::uint64_t const rows = detail::touched_by_items<GridType>(cells, std::size_t(b));
            detail::clear_rows<GridType, Phase::channels>(grid.tile(std::size_t(b)),
                                                          rows & ~grid.touched(std::size_t(b)));
            grid.touched(std::size_t(b)) |= rows;
            Items<Lane, Order, d> items(cells, std::size_t(b), scratch);
            for (int g = 0; g < GridType::Shape::groups; ++g) {
                std::size_t const begin = cells.group_begin(std::size_t(b), g),
                                  end = cells.group_end(std::size_t(b), g);
                if (begin == end) continue;
                scratch.reserve(Phase::scratch_channels, end - begin);
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    items.enter(slot, end, slot - begin);
                    detail::prepare(phase, items);
                }
                detail::GroupOf<Lane, GridType> group(cells.counts(std::size_t(b), g), g, scratch, 0, nullptr,
                                                      grid.tile(std::size_t(b)));
                detail::scatter<typename Phase::Scatter>(group, spreads);
            }
        };
    });
}

namespace detail
{
/// Copies the contributions of a group's items, listed cell by cell, to where a group of cells expects them:
/// rank by rank.
template <int channels, class Lane, int d, class Leaver>
void copy_contributions(Leaver const* leavers, std::uint32_t const* counts, Scratch<Lane, d>& scratch)
{
    using Number = ScalarOf<Lane>;
    constexpr int lanes = lane_width<Lane>;
    std::uint32_t first[std::size_t(lanes)];
    std::exclusive_scan(counts, counts + lanes, first, std::uint32_t(0));
    std::size_t item = 0;
    for (std::uint32_t rank = 0;; ++rank) {
        std::uint64_t pattern = lanes_above<lanes>(counts, rank);
        if (pattern == 0) break;
        for (; pattern != 0; pattern &= pattern - 1, ++item) {
            Number const* const contribution = leavers[first[std::countr_zero(pattern)] + rank].contribution;
            for (int c = 0; c < channels; ++c) *scratch.at(c, item) = contribution[c];
        }
    }
}

/// Scatters listed items, in the order of their cells, to the tile of their block.
template <class Lane, class Scatter, class Layer, class Leaver>
void scatter_listed(std::span<Leaver const> leavers, Layer const&, typename Scatter::Number* tile,
                    std::uint64_t& touched, ScatterBuffers<Lane, Scatter>& buffers)
{
    auto& [scratch, spreads] = buffers;
    using Shape = typename Layer::Shape;
    constexpr int lanes = lane_width<Lane>;
    if (leavers.empty()) return;
    std::array<std::uint32_t, Shape::cells> counts;
    counts.fill(0);
    for (auto const& leaver : leavers) ++counts[leaver.place];
    std::array<std::size_t, Shape::groups> of_group;
    std::size_t filled = 0;
    std::uint64_t rows = 0;
    for (int g = 0; g < Shape::groups; ++g) {
        std::uint32_t const* const count = &counts[std::size_t(g * lanes)];
        of_group[std::size_t(g)] = std::accumulate(count, count + lanes, std::size_t(0));
        if (of_group[std::size_t(g)] == 0) continue;
        rows |= Layer::touched_by(count, g);
        ++filled;
    }
    clear_rows<Layer, Scatter::channels>(tile, rows & ~touched);
    touched |= rows;

    auto const* next = leavers.data();
    if constexpr (may_go_alone<Layer::dimension, lanes>)
        if (go_alone((leavers.size() + lanes - 1) / lanes, filled)) {
            scratch.reserve(Scatter::scratch_channels, lanes);
            for (auto const* const end = next + leavers.size(); next < end; next += lanes) {
                int const count = static_cast<int>(std::min<std::ptrdiff_t>(lanes, end - next));
                int places[std::size_t(lanes)];
                for (int l = 0; l < count; ++l) {
                    places[l] = next[l].place;
                    for (int c = 0; c < Scatter::scratch_channels; ++c)
                        *scratch.at(c, std::size_t(l)) = next[l].contribution[c];
                }
                ScatteredItems<Lane, Layer> items(places, count, scratch, nullptr, tile);
                scatter<Scatter>(items, spreads);
            }
            return;
        }
    for (int g = 0; g < Shape::groups; next += of_group[std::size_t(g++)]) {
        if (of_group[std::size_t(g)] == 0) continue;
        std::uint32_t const* const count = &counts[std::size_t(g * lanes)];
        scratch.reserve(Scatter::scratch_channels, of_group[std::size_t(g)]);
        copy_contributions<Scatter::scratch_channels>(next, count, scratch);
        GroupOf<Lane, Layer> group(count, g, scratch, 0, nullptr, tile);
        scatter<Scatter>(group, spreads);
    }
}
} // namespace detail

/// Completes the order of cells if needed, and the sums: items in the cells where they stayed have scattered
/// already; the leavers scatter where they are now.
template <class Lane, class Phase, class Order, class GridType>
void scatter_leavers(Order& cells, GridType& grid)
{
    using ScatterBuffers = detail::ScatterBuffers<Lane, typename Phase::Scatter>;
    cells.complete([&](int thread) {
        return [&, &buffers = cells.workspace().template of<ScatterBuffers>(thread)](int b) {
            detail::scatter_listed<Lane, typename Phase::Scatter>(cells.leavers(std::size_t(b)), grid,
                                                                  grid.tile(std::size_t(b)),
                                                                  grid.touched(std::size_t(b)), buffers);
        };
    });
}

namespace detail
{
/// What nodes of a phase look around for, if they do: found once for all nodes that a thread updates.
template <class Phase>
auto surroundings(Phase const& phase)
{
    if constexpr (Phase::looks_around)
        return phase.walls();
    else
        return 0;
}
} // namespace detail

/// Nodes add up the tiles that cover them and are updated, row by row, owner by owner. Threads get the same
/// partitions as of `cells` if that is the only order (see parallel_for).
template <class Lane, class Order, class GridType, class Phase>
typename Phase::Result for_each_node(Threads const& threads, Order const& cells, GridType& grid,
                                     Phase const& phase)
{
    constexpr int d = Phase::d;
    using Shape = typename GridType::Shape;
    using Number = typename Phase::Number;
    using Result = typename Phase::Result;
    auto& results =
        detail::ResultsOf<Result>::make_ready(cells.workspace(), static_cast<std::size_t>(grid.owners()));
    int const most = threads_for(grid.nodes().size(), threads.count, node_blocks_per_thread);
    parallel_for(threads.limited_to(most), grid.owners(), cells.partitions(), [&](int) {
        auto const update = [&, around = detail::surroundings(phase)](int n, Result& result) {
            auto const& block = grid.nodes()[std::size_t(n)];
            alignas(64) Number sums[Phase::Sums::channels][Shape::along];
            for (int row = 0; row < Shape::rows; ++row) {
                if (!detail::sum_row<GridType, Phase::Sums::channels>(grid, block, row, sums)) continue;
                for (int place = 0; place < Shape::along; place += lane_width<Lane>) {
                    Coordinates<d> const at = GridType::node_at(block.coordinates, row, place);
                    Number* const values = grid.node_values(std::size_t(n)) + row * Shape::along + place;
                    NodeLanes<Lane, GridType, d> node(&sums[0][place], values, at);
                    if constexpr (Phase::looks_around)
                        if (phase.looks_around_at(around, at, lane_width<Lane>)) {
                            LookingNodes<Lane, GridType, d> looking(node, &sums[0][0], grid, n, row);
                            phase.look_around(around, looking, result);
                            continue;
                        }
                    phase(node, result);
                }
            }
        };
        return [&, update](int owner) {
            Result& result = results.begin(static_cast<std::size_t>(owner));
            for (std::uint32_t const n : grid.nodes_at(owner)) update(static_cast<int>(n), result);
        };
    });
    return results.merged();
}

namespace detail
{
/// Copies some rows of the nodes under a block of cells into one tile.
template <class GridType, int channels, class Number>
void fill_tile(GridType const& grid, std::size_t b, std::uint64_t rows, Number* tile)
{
    using Shape = typename GridType::Shape;
    constexpr int d = GridType::corners == 8 ? 3 : 2, degree = GridType::row_length - Shape::along;
    auto const& nodes = grid.nodes_of(b);
    for (std::uint64_t rest = rows & ~GridType::ends; rest != 0; rest &= rest - 1) {
        int const tile_row = std::countr_zero(rest);
        int first = tile_row, second = 0, corner = 0;
        if constexpr (d == 3) {
            first = tile_row / GridType::rows_across;
            second = tile_row % GridType::rows_across;
            corner = (first / Shape::across) * 4 + (second / Shape::across) * 2;
        }
        else
            corner = (first / Shape::across) * 2;
        int const row =
            d == 3 ? first % Shape::across * Shape::across + second % Shape::across : first % Shape::across;
        for (int c = 0; c < channels; ++c) {
            Number* const to = tile + c * GridType::tile_channel + tile_row * GridType::row_length;
            int const at = c * GridType::block_channel + row * Shape::along;
            std::memcpy(to, grid.node_values(std::size_t(nodes[std::size_t(corner)])) + at,
                        Shape::along * sizeof(Number));
            if ((rows & GridType::ends) != 0)
                std::memcpy(to + Shape::along,
                            grid.node_values(std::size_t(nodes[std::size_t(corner + 1)])) + at,
                            degree * sizeof(Number));
            else
                std::fill(to + Shape::along, to + Shape::along + degree, Number(0));
        }
    }
}
} // namespace detail

namespace detail
{
/// A thread's buffers for gathering.
template <class Lane, class GridType, class Phase>
struct GatherBuffers
{
    Array<typename Phase::Number> nodes;
    typename Phase::template CellNodes<Lane> nodes_of_cells;
    Scratch<Lane, Phase::d> scratch;
};

/// A thread's scatter to the next step's grid, block by block and group by group.
template <class Lane, class Order, class GridType, class Phase>
struct ScatterToNext
{
    using ItemsType = Items<Lane, Order, Phase::d>;
    using ScratchType = Scratch<Lane, Phase::d>;
    using Scatter = typename Phase::Scatter;

    Order const& cells;
    GridType& grid;
    ScatterBuffers<Lane, Scatter>& buffers;

    ItemsType begin(std::size_t block, std::uint64_t rows, ScratchType& scratch)
    {
        clear_rows<GridType, Phase::channels>(grid.next_tile(block), rows);
        grid.next_touched(block) = rows;
        return {cells, block, scratch};
    }
    void scatter(std::size_t block, int first, int behind, ScratchType& scratch)
    {
        typename Phase::Number const* const nothing = nullptr;
        for_each_group<Lane, GridType>(
            cells, block, first, behind, scratch, nothing, grid.next_tile(block),
            [&](auto& group, std::size_t) { detail::scatter<Scatter>(group, buffers.spreads); });
    }
    void end(std::size_t) {}
};

/// The same for items that move. Of the leavers, some scatter when the rest of their block has (see
/// CellOrder::note_outgoing).
template <class Lane, class Order, class GridType, class Phase>
struct MoveAndScatter
{
    using ItemsType = MovingItems<Lane, Order, Phase::d>;
    using Stay = ScatterToNext<Lane, Order, GridType, Phase>;
    using ScratchType = typename Stay::ScratchType;

    Order& cells;
    typename Order::LeaverNotes& notes;
    Stay stay;

    ItemsType begin(std::size_t block, std::uint64_t rows, ScratchType& scratch)
    {
        stay.begin(block, rows, scratch);
        return {cells, block, scratch, notes};
    }
    void scatter(std::size_t block, int first, int behind, ScratchType& scratch)
    {
        stay.scatter(block, first, behind, scratch);
    }
    void end(std::size_t block)
    {
        scatter_listed<Lane, typename Phase::Scatter>(cells.note_outgoing(block, notes), stay.grid,
                                                      stay.grid.next_tile(block),
                                                      stay.grid.next_touched(block), stay.buffers);
    }
};

/// For loops that only gather.
template <class Lane, class Order, class Phase>
struct ScatterNothing
{
    using ItemsType = Items<Lane, Order, Phase::d>;
    using ScratchType = Scratch<Lane, Phase::d>;

    Order const& cells;

    ItemsType begin(std::size_t block, std::uint64_t, ScratchType& scratch)
    {
        return {cells, block, scratch};
    }
    void scatter(std::size_t, int, int, ScratchType&) {}
    void end(std::size_t) {}
};

/// Each block of cells copies the nodes it needs into one tile; its items gather from it and are updated, and
/// their contributions are scattered by the buffers of each thread: `make_buffers(its number)`. Gather and
/// scatter go group by group; the update in between goes by whole packs, which sparse groups share.
template <class Lane, class Order, class GridType, class Phase, class MakeBuffers>
typename Phase::Result gather_and_update(Threads const& threads, Order& cells, GridType& grid,
                                         Phase const& phase, Workspace& workspace,
                                         MakeBuffers const& make_buffers)
{
    constexpr int lanes = lane_width<Lane>;
    int const blocks = static_cast<int>(cells.blocks().size());
    using Result = typename Phase::Result;
    auto& results = ResultsOf<Result>::make_ready(workspace, cells.blocks().size());
    workspace.for_threads(threads.count);
    parallel_for(threads, blocks, cells.partitions(), [&](int thread) {
        // On the heap: compilers would split it into scalars and copy these for every group.
        auto& gather_buffers = workspace.of<GatherBuffers<Lane, GridType, Phase>>(thread);
        gather_buffers.nodes.resize(Phase::node_channels * GridType::tile_channel);
        return [&, found = Result{}, buffers = make_buffers(thread)](int b) mutable {
            Result& result = results.begin(static_cast<std::size_t>(b));
            // no structured binding: clang's OpenMP does not capture it in a lambda
            auto& nodes = gather_buffers.nodes;
            auto& nodes_of_cells = gather_buffers.nodes_of_cells;
            auto& scratch = gather_buffers.scratch;
            typename Phase::Number* const nowhere = nullptr;
            std::uint64_t const rows = touched_by_items<GridType>(cells, std::size_t(b));
            fill_tile<GridType, Phase::node_channels>(grid, std::size_t(b), rows, nodes.data());
            auto items = buffers.begin(std::size_t(b), rows, scratch);
            for (int g = 0, next; g < GridType::Shape::groups; g = next) {
                next = cells.end_of_groups(std::size_t(b), g);
                std::size_t const begin = cells.group_begin(std::size_t(b), g),
                                  end = cells.group_end(std::size_t(b), next - 1);
                if (begin == end) continue;
                scratch.reserve(Phase::scratch_channels, end - begin);
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    items.enter(slot, end, slot - begin);
                    begin_items(phase, items);
                }
                for_each_group<Lane, GridType>(
                    cells, std::size_t(b), g, next, scratch, std::as_const(nodes).data(), nowhere,
                    [&](auto& group, std::size_t behind) {
                        gather<typename Phase::Gather>(group, behind, nodes_of_cells);
                    });
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    items.enter_again(slot, slot - begin);
                    update_items(phase, items, found, result);
                }
                buffers.scatter(std::size_t(b), g, next, scratch);
            }
            result.merge(found);
            buffers.end(std::size_t(b));
        };
    });
    return results.merged();
}
} // namespace detail

/// Items gather from the nodes, move, and scatter to their block's tile for the next step.
template <class Lane, class Order, class GridType, class Phase>
typename Phase::Result move(Threads const& threads, Order& cells, GridType& grid, Phase const& phase)
{
    cells.expect_outgoing();
    Workspace& workspace = cells.workspace();
    return detail::gather_and_update<Lane>(threads, cells, grid, phase, workspace, [&](int thread) {
        return detail::MoveAndScatter<Lane, Order, GridType, Phase>{
            cells,
            workspace.of<typename Order::LeaverNotes>(thread),
            {cells, grid, workspace.of<detail::ScatterBuffers<Lane, typename Phase::Scatter>>(thread)}};
    });
}

/// Items gather from the nodes and scatter in place to the next sums.
template <class Lane, class Order, class GridType, class Phase>
void scatter_back(Threads const& threads, Order const& cells, GridType& grid, Phase const& phase)
{
    Workspace& workspace = cells.workspace();
    detail::gather_and_update<Lane>(threads, cells, grid, phase, workspace, [&](int thread) {
        return detail::ScatterToNext<Lane, Order, GridType, Phase>{
            cells, grid, workspace.of<detail::ScatterBuffers<Lane, typename Phase::Scatter>>(thread)};
    });
}

/// Items gather from the nodes as in their last move, and the phase stores the results. Several host threads
/// may do so at the same time, so this does not use the workspace of the cells.
template <class Lane, class Order, class GridType, class Phase>
void gather(Threads const& threads, Order const& cells, GridType const& grid, Phase const& phase)
{
    Workspace own;
    detail::gather_and_update<Lane>(threads, cells, grid, phase, own,
                                    [&](int) { return detail::ScatterNothing<Lane, Order, Phase>{cells}; });
}

} // namespace firn::openmp

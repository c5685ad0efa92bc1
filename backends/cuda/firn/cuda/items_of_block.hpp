// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/shape_of_items.hpp>
#include <firn/cuda/shared_memory.hpp>
#include <firn/cuda/shared_tiles.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>

// How a group of threads works on the items of a block of cells, in two phases: first each thread on items of
// its own, which lie side by side whatever their cells; then each on one cell and one layer of its stencil,
// whose sums it has in registers. What items scatter lies in shared memory in between.
namespace firn::cuda::detail
{

/// The work of a group of threads on a block: of at most `most` teams.
template <class Order, class GridType, class Phase, unsigned most = 1>
class ItemsOfBlock
{
public:
    using In = ShapeOfItems<GridType, Phase>;
    static constexpr int d = Phase::d;
    using Number = typename GridType::Number;
    using Tile = typename GridType::TileShape;
    using Shape = typename GridType::Shape;
    using Sums = typename GridType::Sums;
    using Item = CellOfThread<Order, GridType, Phase, d>;

    /// Finds the items of the block.
    __device__ ItemsOfBlock(typename Order::View const& cells, std::uint32_t block)
        : cells_(cells), tiles_(shared_memory(), In::gathers), first_(cells.begin[block * Shape::cells]),
          end_(cells.begin[(block + 1) * Shape::cells])
    {
        for (unsigned half = 0; half < Shape::cells / 32; ++half)
            begin_[half] = cells.begin[block * Shape::cells + half * 32 + threadIdx.x % 32];
    }

    /// Reads the values of the nodes under the block.
    __device__ void read(typename GridType::View const& grid, std::uint32_t block)
    {
        origin_ = cells_.cell(block * Shape::cells);
        source_ = first_ + threadIdx.x < end_ ? cells_.order[first_ + threadIdx.x] : 0;
        if (threadIdx.x < Shape::cells) begins()[threadIdx.x] = threadIdx.x < 32 ? begin_[0] : begin_[1];
        if (threadIdx.x == 0) begins()[Shape::cells] = end_;
        if constexpr (In::gathers) tiles_.read_values(grid, block, cell_with_items());
        __syncthreads();
    }

    /// Known to the compiler in a loop for one team.
    __device__ static unsigned teams() { return most == 1 ? 1 : blockDim.x / In::team_threads; }
    __device__ static bool divides() { return In::divides_by_count && teams() == 1; }
    __device__ static unsigned threads() { return most == 1 ? In::team_threads : blockDim.x; }

    __device__ std::uint32_t size() const { return end_ - first_; }
    /// Of a cell of the block.
    __device__ std::uint32_t size_of_cell(std::uint32_t place) const
    {
        return begins()[place + 1] - begins()[place];
    }

    /// Calls `use(item, number in the chunk)` for each item, chunk by chunk; and once for each chunk, and at
    /// least once, `then(is the first)`, in all threads, after what items scatter was stored.
    template <class Use, class Then>
    __device__ void for_each(Use const& use, Then const& then)
    {
        Item item(origin_, tiles_.values + Tile::nodes);
        std::uint32_t chunk = first_;
        do {
            chunk_ = chunk;
            count_ = std::min(end_ - chunk, +In::room);
            mark_places();
            std::uint32_t i = threadIdx.x, source = source_;
            if (chunk != first_ && i < count_) source = cells_.order[chunk + i];
            __syncthreads();
            if (divides()) divide_by_count();
            for (; i < count_; i += threads()) {
                std::uint32_t const from = source;
                if (i + threads() < count_) source = cells_.order[chunk + i + threads()];
                Coordinates<d> const cell = Shape::cell(places()[i]);
                item.enter(origin_ + cell, tiles_.values + Tile::at(cell), from, chunk + i);
                use(item, i);
            }
            __syncthreads();
            then(chunk == first_);
            chunk += In::room;
        } while (chunk < end_);
    }

    /// Stores what an item scatters, with the offset in its new cell if it moves.
    __device__ void store(Item const& item, std::uint32_t i) const
    {
#pragma unroll
        for (int v = 0; v < In::stored_channels / Some::count; ++v) {
            Some some;
#pragma unroll
            for (int k = 0; k < Some::count; ++k) {
                int const c = v * Some::count + k;
                some.of[k] = c >= In::channels    ? Number(0)
                             : In::moves && c < d ? item.offset_in_cell(std::min(c, d - 1))
                                                  : item.scratch(std::min(c, In::channels - 1));
            }
            contributions()[v * In::stride + padded(i)] = some;
        }
    }

    /// Notes in a list of the chunk, and by a bit, that an item leaves its cell: its new cell scatters it.
    /// Returns the place of its old one.
    __device__ std::uint32_t note_leaver(Item const& item, std::uint32_t i, std::uint32_t& count) const
    {
        atomicOr(left() + i / 32, 1u << i % 32);
        leavers()[atomicAdd(&count, 1u)] = i | item.way() << 16;
        return places()[i];
    }

    /// Writes the `count` leavers of the chunk that lie in a list from `first` on: called by all threads.
    __device__ void write_leavers(Leavers<Number> const& to, Destinations<d> const& where,
                                  std::uint32_t block, std::uint32_t first, std::uint32_t count) const
    {
        constexpr std::uint32_t of_each = In::stored_channels / Some::count;
        auto* const contribution = reinterpret_cast<Some*>(to.contribution) + std::size_t(first) * of_each;
        for (std::uint32_t n = threadIdx.x; n < count * of_each; n += threads()) {
            std::uint32_t const k = n / of_each, i = leavers()[k] & 0xffffu;
            if (first + k < to.most)
                contribution[n] = contributions()[int(n % of_each) * In::stride + padded(i)];
        }
        for (std::uint32_t k = threadIdx.x; k < count && first + k < to.most; k += threads()) {
            std::uint32_t const leaver = leavers()[k], i = leaver & 0xffffu, way = leaver >> 16,
                                c = block * Shape::cells + places()[i];
            to.slot[first + k] = chunk_ + i;
            to.cell[first + k] = c;
            to.way[first + k] = static_cast<std::uint8_t>(way);
            if (where.at_once) find_new_cell<d>(to, where, first + k, c, way);
        }
    }

    /// Adds up what the items of a chunk scatter: afresh to the tile, or onto what is there. Calls
    /// `meanwhile()` in all threads before the contributions are lost.
    template <class Meanwhile>
    __device__ void scatter(Sums* to, bool afresh, Meanwhile const& meanwhile) const
    {
        using Scatter = typename Phase::Scatter;
        std::uint32_t const team = most == 1 ? 0 : threadIdx.x / In::team_threads,
                            layer = threadIdx.x % In::team_threads / block_threads,
                            nth = threadIdx.x % block_threads;
        std::uint32_t const place = divides() ? by_count()[nth] : nth;
        auto const [begin, end] = in_chunk(place);
        SumsOfLayer sums{};
        auto const use = [&](auto const& frame, std::uint32_t i) {
            Row const row(contributions() + padded(i));
#pragma unroll
            for (unsigned p = 0; p < In::depth; ++p)
                Scatter::scatter_layer(row, static_cast<int>(In::depth == 1 ? layer : p), frame, sums.at[p]);
        };
        auto const frame =
            Scatter::frame_of(Row(contributions() + padded(begin + team < end ? begin + team : 0)));
        [[maybe_unused]] std::uint32_t k = team;
        for (std::uint32_t first = begin; first < end; first += 32, k -= 32) {
            std::uint32_t stay = that_stay(first, end);
            if constexpr (most == 1)
                for (; stay != 0; stay &= stay - 1)
                    use(frame, first + static_cast<std::uint32_t>(__ffs(static_cast<int>(stay)) - 1));
            else
                for (; k < std::min(end - first, 32u); k += teams())
                    if ((stay >> k & 1) != 0) use(frame, first + k);
        }
        if (begin + team < end)
#pragma unroll
            for (unsigned p = 0; p < In::depth; ++p) Scatter::leave_frame(frame, sums.at[p]);
        __syncthreads();
        meanwhile();
        add_up(sums, layer, place, to, afresh);
    }

private:
    /// A cell that has items, if one of the block has: the last of the cells that begin with the first item
    /// of the block. Each warp finds it for itself.
    __device__ int cell_with_items() const
    {
        int begin_so = 0;
        for (std::uint32_t const begin : begin_) begin_so += __popc(__ballot_sync(~0u, begin == first_));
        return begin_so - 1;
    }
    __device__ std::uint32_t* begins() const
    {
        return reinterpret_cast<std::uint32_t*>(shared_memory() + In::begins);
    }
    /// The cell of each item of the chunk.
    __device__ unsigned char* places() const { return shared_memory() + In::places; }
    __device__ std::uint32_t* leavers() const
    {
        return reinterpret_cast<std::uint32_t*>(shared_memory() + In::leavers);
    }
    /// A bit per item of the chunk: whether it has left. One word more than these take.
    __device__ std::uint32_t* left() const
    {
        return reinterpret_cast<std::uint32_t*>(shared_memory() + In::left);
    }
    /// Of the items [first, end) of the chunk, the first 32 at most: a bit for each that stays in its cell.
    /// So no thread of a warp waits for those of other cells that have left.
    __device__ std::uint32_t that_stay(std::uint32_t first, std::uint32_t end) const
    {
        std::uint32_t const all = end - first < 32 ? (1u << (end - first)) - 1 : ~0u;
        if constexpr (In::moves) {
            std::uint32_t const* const words = left() + first / 32;
            return all & ~__funnelshift_r(words[0], words[1], first % 32);
        }
        else
            return all;
    }
    using Some = NumbersAtOnce<Number>;
    __device__ Some* contributions() const
    {
        return reinterpret_cast<Some*>(shared_memory() + In::contributions);
    }
    /// Where the items of a cell begin and end in the chunk.
    struct Range
    {
        std::uint32_t begin, end;
    };
    __device__ Range in_chunk(std::uint32_t place) const
    {
        auto const in = [&](std::uint32_t begin) {
            return std::min(std::max(begin, chunk_) - chunk_, count_);
        };
        return {in(begins()[place]), in(begins()[place + 1])};
    }
    /// Places in an array where neighbouring cells begin in different banks.
    __device__ static std::uint32_t padded(std::uint32_t i) { return i + i / In::padding; }

    /// What an item scatters, as a phase sees it.
    struct Row
    {
        using Real = Number;
        Number of[In::stored_channels];

        __device__ explicit Row(Some const* first)
        {
#pragma unroll
            for (int v = 0; v < In::stored_channels / Some::count; ++v) {
                Some const some = first[v * In::stride];
#pragma unroll
                for (int k = 0; k < Some::count; ++k) of[v * Some::count + k] = some.of[k];
            }
        }
        __device__ Number scratch(int channel) const { return of[channel]; }
    };

    /// The sums of one cell at one place along the first axis of its stencil.
    struct SumsOfPlace
    {
        Number of[In::width][d == 3 ? In::width : 1][GridType::Sums::stored];
        __device__ auto& operator[](int k) { return of[k]; }
    };
    /// The sums of one cell and one layer of its stencil.
    struct SumsOfLayer
    {
        SumsOfPlace at[In::depth];
    };

    /// Adds the sums of all cells and layers to the tile, in a fixed order. They are added up in tiles that
    /// lie where contributions lay.
    __device__ void add_up(SumsOfLayer const& sums, [[maybe_unused]] std::uint32_t layer, std::uint32_t place,
                           Sums* to, bool afresh) const
    {
        auto* const tiles = reinterpret_cast<Sums*>(contributions());
        Coordinates<d> cell = Shape::cell(static_cast<int>(place));
        int const warp = int(threadIdx.x / 32);
        if constexpr (In::has_tiles_of_warps) {
            int const nodes = In::nodes_of_warp(teams());
            Sums* const own = tiles + warp * nodes;
            for (int n = int(threadIdx.x % 32); n < nodes; n += 32) own[n] = Sums{};
            __syncwarp();
            if (!divides()) cell[0] %= Shape::group_extent;
            add(sums, own + Tile::at(cell));
        }
        else {
            for (int n = int(threadIdx.x); n < Tile::nodes; n += int(threads())) tiles[n] = Sums{};
            for (int turn = 0; turn < int(threads() / 32); ++turn) {
                __syncthreads();
                if (turn == warp) add(sums, tiles + Tile::at(cell) + int(layer) * Tile::plane);
            }
        }
        __syncthreads();
        for (int n = int(threadIdx.x); n < Tile::nodes; n += int(threads())) {
            Sums sum{};
            if (!afresh) sum = to[n];
            if constexpr (In::has_tiles_of_warps) {
                // A layer has a tile for each group of cells, or two of the whole block.
                int const nodes = In::nodes_of_warp(teams()), apart = divides() ? 0 : Shape::group_extent;
                for (unsigned t = 0; t < teams(); ++t)
#pragma unroll
                    for (int l = 0; l < int(In::layers); ++l)
#pragma unroll
                        for (int k = 0; k < Shape::groups; ++k)
                            if (int const at = n - (l + k * apart) * Tile::plane; at >= 0 && at < nodes)
                                SharedTiles<GridType>::plus(
                                    sum,
                                    tiles[((int(t) * int(In::layers) + l) * Shape::groups + k) * nodes + at]);
            }
            else
                SharedTiles<GridType>::plus(sum, tiles[n]);
            to[n] = sum;
        }
        __syncthreads();
    }

    /// Adds the sums of the thread's cell and layer to nodes from the first one on. All lanes of a warp add
    /// to the same node of their stencils at a time, hence to different nodes.
    __device__ static void add(SumsOfLayer const& sums, Sums* nodes)
    {
        using Scatter = typename Phase::Scatter;
#pragma unroll
        for (int p = 0; p < int(In::depth); ++p)
#pragma unroll
            for (int row = 0; row < Scatter::rows_of_layer; ++row)
#pragma unroll
                for (int k = 0; k < Scatter::width; ++k) {
                    Sums& node = nodes[p * Tile::plane + Tile::in_layer(row, k)];
                    Sums sum = node;
#pragma unroll
                    for (int c = 0; c < Scatter::channels; ++c) sum.of[c] += sums.at[p].of[k][row][c];
                    node = sum;
                    __syncwarp();
                }
    }
    /// Notes the cell of each item of the chunk.
    __device__ void mark_places() const
    {
        std::uint32_t const place = threadIdx.x;
        if constexpr (In::moves) {
            static_assert(In::room / 32 < In::team_threads, "each thread clears one word at most");
            if (threadIdx.x <= In::room / 32) left()[threadIdx.x] = 0;
        }
        if (place >= Shape::cells) return;
        auto const [begin, end] = in_chunk(place);
        for (std::uint32_t i = begin; i < end; ++i) places()[i] = static_cast<unsigned char>(place);
        if (divides()) {
            std::uint32_t const full = __ballot_sync(~0u, (end - begin) * Shape::cells > count_);
            if (place % 32 == 0) full_cells()[place / 32] = full;
        }
    }

    /// Cells in an order in which those with more items than the mean come first.
    __device__ unsigned char* by_count() const { return shared_memory() + In::by_count; }
    /// A bit per cell: whether it has more items than the mean.
    __device__ std::uint32_t* full_cells() const
    {
        return reinterpret_cast<std::uint32_t*>(shared_memory() + In::by_count + Shape::cells);
    }
    /// Finds that order, once it is known which cells have more.
    __device__ void divide_by_count() const
    {
        static_assert(Shape::cells == 64, "there is a bit for each cell");
        std::uint32_t const place = threadIdx.x;
        if (place >= Shape::cells) return;
        std::uint64_t const full = std::uint64_t(full_cells()[1]) << 32 | full_cells()[0],
                            before = full & ((std::uint64_t(1) << place) - 1);
        auto const count = [](std::uint64_t bits) {
            return static_cast<std::uint32_t>(__popc(std::uint32_t(bits)) +
                                              __popc(std::uint32_t(bits >> 32)));
        };
        std::uint32_t const fuller = count(before);
        by_count()[(full >> place & 1) != 0 ? fuller : count(full) + place - fuller] =
            static_cast<unsigned char>(place);
    }

    typename Order::View const& cells_;
    SharedTiles<GridType> tiles_;
    Coordinates<d> origin_;
    std::uint32_t first_, end_;              ///< of the block's items
    std::uint32_t begin_[Shape::cells / 32]; ///< of those of one cell in each half of the block
    std::uint32_t source_ = 0, chunk_ = 0, count_ = 0;
};

} // namespace firn::cuda::detail

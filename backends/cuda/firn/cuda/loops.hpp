// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/shared_memory.hpp>

#include <algorithm>
#include <cassert>

namespace firn::cuda
{

namespace detail
{
inline constexpr unsigned block_threads = 64; ///< one per cell, and one per node
/// Where there are few blocks, at most this many teams of `block_threads` share one: each handles every n-th
/// item of a cell. In the largest group each thread still has up to 128 registers. Numbers in double
/// precision need two each, and are faster with half as many threads.
template <class Number>
inline constexpr unsigned most_teams = sizeof(Number) > sizeof(float) ? 4 : 8;
/// The same for the loop that moves items. A phase that holds many values across a call is limited to six
/// teams, in effect four, and 168 registers are left for each thread.
template <class Phase>
inline constexpr unsigned most_teams_that_move = Phase::calls_amid_much
                                                     ? std::min(most_teams<typename Phase::Number>, 6u)
                                                     : most_teams<typename Phase::Number>;
/// Groups of threads that must fit on a multiprocessor in loops of one team: this leaves 168 registers per
/// thread. Without it the compiler may stop at 48 or 96, and spill.
inline constexpr unsigned enough_groups = 6;
/// Shared memory that a device grants without a request; the same less the little that loops declare; and the
/// most it grants at all, less that too (compute capability 7.5; later ones grant more) [bytes].
inline constexpr std::size_t given_shared = 48 * 1024, unasked_shared = 40 * 1024, most_shared = 60 * 1024;

/// A lane's view of its warp's group of cells: which items are where.
struct Ranks
{
    std::uint32_t begin, count; ///< of the items of the lane's cell
    std::uint32_t slot;         ///< of the first item of the current rank, over all lanes

    __device__ Ranks(std::uint32_t const* begins, std::uint32_t cell)
        : begin(begins[cell]), count(begins[cell + 1] - begin), slot(begins[cell - threadIdx.x % 32])
    {}
    /// Of items that are listed by cell, and have no slots.
    __device__ explicit Ranks(ArrivedInCell const& came) : begin(came.begin), count(came.count), slot(0) {}

    /// Calls `use(rank, whether the cell has an item of it, the item's slot)` with all lanes of the warp: for
    /// every rank, or for those of one of several teams.
    template <class Use>
    __device__ void for_each(Use const& use, std::uint32_t team = 0, std::uint32_t teams = 1)
    {
        std::uint32_t const below = (1u << threadIdx.x % 32) - 1;
        for (std::uint32_t rank = team, passed = 0;; rank += teams) {
            for (; passed < rank; ++passed)
                slot += __popc(__ballot_sync(~0u, passed < count)); // ranks of other teams
            std::uint32_t const pattern = __ballot_sync(~0u, rank < count);
            if (pattern == 0) return;
            use(rank, rank < count, slot + __popc(pattern & below));
            slot += __popc(pattern);
            passed = rank + 1;
        }
    }
};

/// The tiles of one block of cells in shared memory: node values, and for each team the sums of the block's
/// two groups.
template <class GridType>
struct SharedTiles
{
    using Tile = typename GridType::TileShape;
    using Shape = typename GridType::Shape;
    using Sums = typename GridType::Sums;
    using Values = typename GridType::Values;
    static constexpr int d = GridType::corners == 8 ? 3 : 2;

    static constexpr std::size_t bytes(bool reads, bool adds, unsigned teams = 1)
    {
        constexpr std::size_t values =
            (Tile::nodes * sizeof(Values) + 15) / 16 * 16; // sums are aligned to 16 bytes
        return (reads ? values : 0) + (adds ? teams * 2 * Tile::group_nodes * sizeof(Sums) : 0);
    }

    /// How many teams share a block in a scene of so many blocks: together as many threads as a large device
    /// runs at once, within the shared memory that every device has. The number is the same on every device,
    /// since sums are added up team by team.
    static constexpr unsigned teams(std::uint32_t blocks,
                                    unsigned most = most_teams<typename GridType::Number>)
    {
        unsigned teams = most_teams<typename GridType::Number>;
        while (teams > 1 &&
               (teams > most || teams * blocks > 1024 || bytes(true, true, teams) > unasked_shared))
            teams /= 2;
        return teams;
    }

    /// The same for scattering the items that came into a block.
    static unsigned teams_that_rebin(std::uint32_t blocks)
    {
        return std::min(teams(blocks), most_teams_that_rebin);
    }

    static_assert(bytes(true, true) <= most_shared, "a block's tiles do not fit into shared memory");

    Values* values;
    Sums* sums; ///< of both groups, one after the other, team by team

    __device__ SharedTiles(unsigned char* memory, bool reads)
        : values(reinterpret_cast<Values*>(memory)),
          sums(reinterpret_cast<Sums*>(memory + bytes(reads, false)))
    {}

    __device__ void clear_sums() const
    {
        int const teams = int(blockDim.x / block_threads);
        for (int n = int(threadIdx.x); n < teams * 2 * Tile::group_nodes; n += int(blockDim.x))
            sums[n] = Sums{};
    }

    /// Where the stencil of the thread's cell begins in the sums of its group and team.
    __device__ Sums* own_sums(int place) const
    {
        int const group = place / Shape::lanes, team = int(threadIdx.x / block_threads);
        return sums + team * 2 * Tile::group_nodes + group * (Tile::group_nodes - Tile::group_offset) +
               Tile::at(Shape::cell(place));
    }

    /// Writes the sums of both groups, team by team, to the block's tile.
    __device__ void write_sums(Sums* tile) const
    {
        for (int n = int(threadIdx.x); n < Tile::nodes; n += int(blockDim.x)) {
            Sums sum{};
            plus_teams(sum, n, blockDim.x / block_threads);
            tile[n] = sum;
        }
    }

    /// Adds them to the tile, for `teams` teams.
    __device__ void add_sums(Sums* tile, unsigned teams = 1) const
    {
        constexpr int at_once = 4; // independent loads: otherwise each would wait for the one before
        int const threads = int(teams * block_threads);
        for (int first = int(threadIdx.x); first < Tile::nodes; first += at_once * threads) {
            Sums sum[at_once];
#pragma unroll
            for (int i = 0; i < at_once; ++i)
                if (int const n = first + i * threads; n < Tile::nodes) sum[i] = tile[n];
#pragma unroll
            for (int i = 0; i < at_once; ++i)
                if (int const n = first + i * threads; n < Tile::nodes) {
                    plus_teams(sum[i], n, teams);
                    tile[n] = sum[i];
                }
        }
    }

    /// Loads the node values under a block of cells.
    __device__ void read_values(typename GridType::View const& grid, std::uint32_t block) const
    {
        for (int n = int(threadIdx.x); n < Tile::nodes; n += int(blockDim.x)) {
            Coordinates<d> node;
            if (!Tile::node_at(n, node)) continue;
            std::uint32_t corner = 0;
            int at = 0;
            for (int a = 0; a < d; ++a) {
                corner = 2 * corner + static_cast<std::uint32_t>(node[a] >> Shape::bits);
                at = at * Shape::extent + (node[a] & (Shape::extent - 1));
            }
            std::uint32_t const nodes = grid.nodes_of[block * GridType::corners + corner];
            assert(nodes != absent && "a block of cells has its nodes");
            values[n] = grid.node_values[std::size_t(nodes) * Shape::cells + static_cast<std::size_t>(at)];
        }
    }

private:
    /// Adds the sums of both groups of each team at one node of the tile.
    __device__ void plus_teams(Sums& sum, int n, unsigned teams) const
    {
        for (unsigned team = 0; team < teams; ++team) {
            Sums const* const of_team = sums + int(team) * 2 * Tile::group_nodes;
            if (n < Tile::group_nodes) plus(sum, of_team[n]);
            if (n >= Tile::group_offset) plus(sum, of_team[Tile::group_nodes + n - Tile::group_offset]);
        }
    }
    __device__ static void plus(Sums& sum, Sums const& other)
    {
#pragma unroll
        for (int c = 0; c < Sums::stored; ++c) sum.of[c] += other.of[c];
    }
};

/// All items scatter, cell by cell, to the tile of their block.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(block_threads, enough_groups)
    scatter(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid, bool afresh)
{
    if (signal.stops()) return;
    SharedTiles<GridType> const tiles(shared_memory(), false);
    tiles.clear_sums();
    __syncthreads();
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    CellOfThread<Order, GridType, Phase, Phase::d> cell(cells.cell(c), nullptr);
    SumsInTile<GridType> sums{tiles.own_sums(int(threadIdx.x))};
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        cell.forget();
        if (here) {
            cell.enter(cells.order[cells.begin[c] + rank], slot);
            phase.prepare(cell);
        }
        Phase::scatter(cell, sums);
    });
    __syncthreads();
    typename GridType::Sums* const tile = grid.tiles + std::size_t(blockIdx.x) * GridType::TileShape::nodes;
    if (afresh)
        tiles.write_sums(tile);
    else
        tiles.add_sums(tile);
}

/// Items that came into the cells of a block scatter the contributions that were stored when they left
/// theirs.
template <class Order, class GridType, class Phase>
struct ScatterIncoming
{
    typename Order::View cells;
    typename Order::Arrived arrived;
    typename Order::Leavers leavers;
    typename GridType::View grid;

    /// Called by all threads of a group of `teams` teams, with shared memory for the sums of each.
    __device__ void operator()(std::uint32_t block, ArrivedInCell const& came, std::uint32_t teams) const
    {
        if (!__syncthreads_or(came.count > 0)) return; // most blocks have few, or none
        SharedTiles<GridType> const tiles(shared_memory(), false);
        tiles.clear_sums();
        __syncthreads();
        std::uint32_t const team = teams == 1 ? 0 : threadIdx.x / block_threads,
                            place = threadIdx.x % block_threads;
        CellOfThread<Order, GridType, Phase, Phase::d> cell(cells.cell(block * block_threads + place),
                                                            nullptr);
        SumsInTile<GridType> sums{tiles.own_sums(int(place))};
        std::uint32_t const* const of_cell = arrived.arrived + came.begin;
        std::uint32_t next = team < came.count ? of_cell[team] : 0; // loaded one rank ahead
        auto const use = [&](std::uint32_t rank, bool here, std::uint32_t) {
            cell.forget();
            if (here) {
                cell.read_outgoing(leavers, arrived.offset, next);
                if (rank + teams < came.count) next = of_cell[rank + teams];
            }
            Phase::scatter(cell, sums);
        };
        Ranks(came).for_each(use, team, teams);
        __syncthreads();
        tiles.add_sums(grid.tiles + std::size_t(block) * GridType::TileShape::nodes, teams);
        __syncthreads();
    }
};

/// The same for all blocks once their order is written, with at most `most` teams. A thread in a small group
/// uses more registers, which costs more than it gains where there are many blocks. In double precision the
/// compiler is not told that a group may use all registers, because it would use more than there are.
template <unsigned most, class Order, class GridType, class Phase>
__global__ void __launch_bounds__(most* block_threads,
                                  most > 1 && sizeof(typename GridType::Number) == sizeof(float) ? 1 : 0)
    scatter_leavers(Signal signal, std::uint32_t blocks, ScatterIncoming<Order, GridType, Phase> scatter)
{
    if (signal.stops()) return;
    for (std::uint32_t block = blockIdx.x; block < blocks; block += gridDim.x) {
        std::uint32_t const c = block * block_threads + threadIdx.x % block_threads,
                            begin = scatter.arrived.begin[c];
        scatter(block, {begin, scatter.arrived.begin[c + 1] - begin},
                most == 1 ? 1 : blockDim.x / block_threads);
    }
}

/// Adds up the tiles that cover a node of a block; sets `any` if one of the sums is not zero.
template <class GridType, int d>
__device__ __forceinline__ typename GridType::Sums
sum_of_tiles(typename GridType::View const& grid, std::uint32_t n, Coordinates<d> const& here, bool& any)
{
    using Shape = typename GridType::Shape;
    using Tile = typename GridType::TileShape;
    using Sums = typename GridType::Sums;
    Sums sums{};
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer) {
        typename GridType::Cover const& of = grid.layer[layer];
        std::uint32_t
            block[GridType::corners]; // loaded together: otherwise each would wait for the one before
#pragma unroll
        for (int corner = 0; corner < GridType::corners; ++corner)
            block[corner] = of.covered_by[n * GridType::corners + static_cast<unsigned>(corner)];
#pragma unroll
        for (int corner = 0; corner < GridType::corners; ++corner) {
            Coordinates<d> at = here; // in the tile of a block that lies `corner` before this one
            bool covers = block[corner] != absent;
#pragma unroll
            for (int a = 0; a < d; ++a) {
                at[a] += ((corner >> (d - 1 - a)) & 1) * Shape::extent;
                covers = covers && at[a] < Tile::width;
            }
            Sums more{};
            if (covers)
                more = of.tiles[std::size_t(block[corner]) * Tile::nodes +
                                static_cast<std::size_t>(Tile::at(at))];
#pragma unroll
            for (int c = 0; c < Sums::stored; ++c) {
                sums.of[c] += more.of[c];
                any = any || more.of[c] != 0;
            }
        }
    }
    return sums;
}

/// One node that reads the sums of others.
template <class GridType, int d>
class LoneNode
{
public:
    using Real = typename GridType::Number;

    __device__ LoneNode(typename GridType::View const& grid, BlockSet::View const& blocks,
                        Coordinates<d> const& at)
        : grid_(grid), blocks_(blocks), at_(at)
    {}

    __device__ Coordinates<d> first() const { return at_; }
    __device__ static Vector<Real, d> offset() { return Vector<Real, d>::Zero(); }
    __device__ void set(int channel, Real value) { values_.of[channel] = value; }
    __device__ typename GridType::Values const& values() const { return values_; }

    /// The sums of the node `first` + `along`, the latter on the last axis; zeros if there is none.
    template <int channels>
    __device__ void sums_at(Coordinates<d> const& first, Real along, bool, Real (&found)[channels]) const
    {
        Coordinates<d> node = first;
        node[d - 1] += static_cast<int>(along);
        using Shape = typename GridType::Shape;
        Coordinates<d> block, here;
        for (int a = 0; a < d; ++a) {
            int const at = node[a] + GridType::reach;
            block[a] = at >> Shape::bits;
            here[a] = at & (Shape::extent - 1);
        }
        std::uint32_t const n = blocks_.find(block_key<d>(block));
        typename GridType::Sums sums{};
        bool any = false;
        if (n != absent) sums = sum_of_tiles<GridType, d>(grid_, n, here, any);
        for (int c = 0; c < channels; ++c) found[c] = sums.of[c];
    }

private:
    typename GridType::View const& grid_;
    BlockSet::View const& blocks_;
    typename GridType::Values values_{};
    Coordinates<d> at_;
};

/// For phases that do not look around.
struct NoBlocks
{};

/// Nodes add up the tiles that cover them and are updated. `blocks` finds the blocks of other nodes that a
/// phase looks at. The loop also clears the incoming items of each layer's cells before new ones are listed.
template <class GridType, class Phase, class Blocks>
__global__ void __launch_bounds__(block_threads)
    for_each_node(Signal signal, Phase phase, typename GridType::View grid, Blocks blocks,
                  ResultsOfGroups<typename Phase::Result> results,
                  std::array<ArrivalsToForget, GridType::layers> to_forget)
{
    if (signal.stops()) return;
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer) to_forget[layer].forget(blockIdx.x);
    using Shape = typename GridType::Shape;
    constexpr int d = Phase::d;
    Coordinates<d> here;
    int place = int(threadIdx.x);
    for (int a = d - 1; a >= 0; --a, place /= Shape::extent) here[a] = place % Shape::extent;

    bool any = false;
    typename GridType::Sums const sums = sum_of_tiles<GridType, d>(grid, blockIdx.x, here, any);
    Coordinates<d> const node = block_of_key<d>(grid.keys[blockIdx.x]) * int{Shape::extent} + here -
                                Coordinates<d>::Constant(int{GridType::reach});
    typename Phase::Result result{};
    typename GridType::Values& values =
        grid.node_values[std::size_t(blockIdx.x) * Shape::cells + threadIdx.x];
    bool alone = false;
    if constexpr (Phase::looks_around) {
        auto const walls = phase.walls();
        alone = phase.looks_around_at(walls, node, 1);
        if (alone) {
            LoneNode<GridType, d> lane(grid, blocks, node);
            if (any) phase.look_around(walls, lane, result);
            values = lane.values();
        }
    }
    if (!alone) {
        NodeOfThread<GridType, d> lane(sums, values, node);
        if (any) phase(lane, result); // nothing was added to the others
        values = lane.values();
    }
    __shared__ __align__(16) unsigned char parts[2 * sizeof(typename Phase::Result)];
    results.take(result, reinterpret_cast<typename Phase::Result*>(parts));
}

/// What the moving loop writes beside what the phase does.
template <class Number, class Result>
struct Moved
{
    Leavers<Number> leavers;
    Destinations to;
    unsigned char* left;
    ResultsOfGroups<Result> results;
};

/// All items gather, are updated, and scatter to the tile of the next step. Leavers go to a list, and to the
/// list of their new cell.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(most_teams_that_move<Phase>* block_threads, 1)
    move(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid,
         Moved<typename GridType::Number, typename Phase::Result> moved)
{
    using Tile = typename GridType::TileShape;
    Signal::Heard const heard = signal.hear();
    std::uint32_t const team = threadIdx.x / block_threads, teams = blockDim.x / block_threads;
    std::uint32_t const place = threadIdx.x % block_threads, c = blockIdx.x * block_threads + place,
                        below = (1u << threadIdx.x % 32) - 1;
    Ranks ranks(cells.begin, c); // loaded while the signal is on its way
    if (heard.stops()) return;
    std::uint32_t const* const sources = cells.order + ranks.begin;
    std::uint32_t const count = ranks.count;
    std::uint32_t next_source = team < count ? sources[team] : 0; // loaded one rank ahead

    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    tiles.clear_sums();
    __shared__ std::uint32_t left_cell[block_threads], left_group[2];
    if (threadIdx.x < block_threads) left_cell[threadIdx.x] = 0;
    if (threadIdx.x < 2) left_group[threadIdx.x] = 0;
    __syncthreads();

    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + Tile::at(GridType::Shape::cell(int(place))));
    SumsInTile<GridType> sums{tiles.own_sums(int(place))};
    typename Phase::Result result{}, rare{};
    auto const use = [&](std::uint32_t rank, bool here, std::uint32_t slot) {
        cell.forget();
        if (here) {
            cell.enter(next_source, slot);
            if (rank + teams < count) next_source = sources[rank + teams];
            phase.begin(cell);
            Phase::gather(cell);
            phase.update(cell, result, rare);
            moved.left[slot] = cell.departed();
        }
        if (std::uint32_t const left = __ballot_sync(~0u, cell.departed())) {
            std::uint32_t first = 0;
            if (threadIdx.x % 32 == 0) {
                first =
                    atomicAdd(&moved.leavers.counters->departed, static_cast<std::uint32_t>(__popc(left)));
                atomicAdd(left_group + place / 32, static_cast<std::uint32_t>(__popc(left)));
            }
            std::uint32_t const i = __shfl_sync(~0u, first, 0) + __popc(left & below);
            if (cell.departed()) {
                atomicAdd(left_cell + place, 1u);
                if (i < moved.leavers.most) {
                    cell.write_outgoing(moved.leavers, i, c);
                    if (moved.to.at_once) find_new_cell<Phase::d>(moved.leavers, moved.to, i, c, cell.way());
                }
                cell.forget_contribution();
            }
        }
        Phase::scatter(cell, sums);
    };
    ranks.for_each(use, team, teams);
    __syncthreads();
    if (team == 0) {
        Changes const& changes = moved.to.changes;
        changes.stay[c] = count - left_cell[place];
        if (place == 0) {
            std::uint32_t const had = cells.begin[c + block_threads] - ranks.begin;
            changes.block_stay[blockIdx.x] = had - left_group[0] - left_group[1];
        }
        if (place % 32 == 0) changes.group_left[2 * blockIdx.x + place / 32] = left_group[place / 32];
    }
    tiles.write_sums(grid.next_tiles + std::size_t(blockIdx.x) * Tile::nodes);
    __shared__ __align__(
        16) unsigned char parts[2 * most_teams_that_move<Phase> * sizeof(typename Phase::Result)];
    result.merge(rare);
    moved.results.take(result, reinterpret_cast<typename Phase::Result*>(parts));
}

/// All items gather and scatter in place to their block's tile of the next sums.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(block_threads)
    scatter_back(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    tiles.clear_sums();
    __syncthreads();
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + GridType::TileShape::at(GridType::Shape::cell(int(threadIdx.x))));
    SumsInTile<GridType> sums{tiles.own_sums(int(threadIdx.x))};
    typename Phase::Result result{};
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        cell.forget();
        if (here) {
            cell.enter(cells.order[cells.begin[c] + rank], slot);
            phase.begin(cell);
            Phase::gather(cell);
            phase.update(cell, result);
        }
        Phase::scatter(cell, sums);
    });
    __syncthreads();
    tiles.write_sums(grid.next_tiles + std::size_t(blockIdx.x) * GridType::TileShape::nodes);
}

/// All items gather, and the phase stores what it needs. In double precision the compiler spills with 128 or
/// 168 registers, and when it chooses itself, but not with 96.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(block_threads,
                                  sizeof(typename GridType::Number) == sizeof(float) ? enough_groups : 10)
    gather(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    __syncthreads();
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + GridType::TileShape::at(GridType::Shape::cell(int(threadIdx.x))));
    typename Phase::Result result{};
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        if (!here) return;
        cell.enter(cells.order[cells.begin[c] + rank], slot);
        phase.begin(cell);
        Phase::gather(cell);
        phase.update(cell, result);
    });
}

/// Visits all items: at their slots, or where the order says they lie.
template <class Order, class Visit>
__global__ void __launch_bounds__(block_threads)
    for_each_place(Signal signal, Visit visit, typename Order::View cells, bool at_slots)
{
    if (signal.stops()) return;
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    auto const cell = cells.cell(c);
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        if (here) visit(std::size_t{at_slots ? slot : cells.order[cells.begin[c] + rank]}, cell);
    });
}

template <class Body>
__global__ void for_each(Body body, std::size_t count)
{
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) body(i);
}

/// Shared memory that the moving loop declares for a phase, without padding in between [bytes].
template <class Phase>
inline constexpr std::size_t declared_by_move = 2 * most_teams_that_move<Phase> *
                                                    sizeof(typename Phase::Result) +
                                                (block_threads + 2) * sizeof(std::uint32_t) + 64;

/// Lets a loop use this much dynamic shared memory [bytes].
template <class... Parameters>
void allow_shared(void (*loop)(Parameters...), std::size_t bytes)
{
    cudaError_t const status =
        cudaFuncSetAttribute(loop, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes));
    if (status == cudaErrorInvalidValue) {
        static_cast<void>(cudaGetLastError());
        throw Error{"the device's shared memory is short: " + std::to_string(bytes) +
                        " bytes were needed, beside what a loop declares",
                    "CUDA", "Pass fewer obstacles to a call, or use a device with more shared memory."};
    }
    check(status, "cudaFuncSetAttribute");
}

/// Launches a loop over blocks with its shared memory.
template <class... Parameters, class... Arguments>
void launch(char const* name, Queue const& queue, void (*loop)(Parameters...), std::uint32_t blocks,
            unsigned teams, std::size_t shared, Arguments const&... arguments)
{
    if (shared > unasked_shared) allow_shared(loop, shared);
    launch_behind(name, queue, loop, blocks, teams * block_threads, shared, arguments...);
}
} // namespace detail

} // namespace firn::cuda

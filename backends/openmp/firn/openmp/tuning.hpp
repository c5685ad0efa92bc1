// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>

// Asks for a function to be inlined with all it calls: by itself the compiler stops in the middle of the
// formulas, and packs then travel through memory. Instrumented code would take ten minutes to compile that
// way. FIRN_COMPILE_SOON trades speed of steps for compile time.
#if defined(__OPTIMIZE__) && !defined(FIRN_COMPILE_SOON) && !defined(__SANITIZE_ADDRESS__) &&                \
    !defined(__SANITIZE_THREAD__)
#define FIRN_INLINE_WHOLE [[gnu::flatten]]
#else
#define FIRN_INLINE_WHOLE
#endif

// For short loops that occur in code many times: unrolled, they would take compile time and instruction
// cache.
#if defined(__clang__)
#define FIRN_KEEP_LOOP _Pragma("clang loop unroll(disable)")
#elif defined(__GNUC__)
#define FIRN_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define FIRN_KEEP_LOOP
#endif

namespace firn::openmp
{

/// Each further thread needs at least this many items: the other threads are awake and have the data at hand.
/// Measured on standing waves: two threads take as long as one for 1000 items, half as long again for 250.
inline constexpr std::size_t items_per_thread = 512;
/// The same for blocks of nodes, most of which lie at the edge of a body.
inline constexpr std::size_t node_blocks_per_thread = 6;

/// How many of the threads work on so many items, or blocks.
constexpr int threads_for(std::size_t work, int threads, std::size_t of_each = items_per_thread)
{
    std::size_t const most = work / of_each;
    return most >= static_cast<std::size_t>(threads) ? threads : std::max(1, static_cast<int>(most));
}

/// The shape of a grid block: the unit of memory, of work and of sums. Rows lie along the last axis, where
/// lanes are.
///
/// Measured on snow with cubic kernels: smaller blocks cost more at their borders, since a block sums into
/// its own nodes and `degree` more per axis; larger ones hold more empty cells at free surfaces.
template <int d, int lanes>
struct BlockShape
{
    static constexpr int across = d == 3 ? 4 : 8;       ///< cells along every axis but the last
    static constexpr int along = lanes > 8 ? lanes : 8; ///< cells along the last axis
    static constexpr int rows = d == 3 ? across * across : across;
    static constexpr int cells = rows * along;
    static constexpr int groups_per_row = along / lanes; ///< a group is `lanes` cells of a row
    static constexpr int groups = rows * groups_per_row;

    static constexpr int extent(int axis) { return axis == d - 1 ? along : across; }
};

/// How many ranks of a group scatter at once: their contributions stay in the fastest cache, and the sums of
/// a row of nodes in registers. Measured on quadratic kernels: 8 and 16 are one or two per cent slower.
inline constexpr int ranks_at_once = 12;

/// Whether the items of sparsely filled groups may be processed one by one (see ScatteredItems). A group of
/// cells reads all its nodes, and adds to all, however few items it has. Measured with 16 lanes on standing
/// waves between walls, where one column of cells is left over: 2 % less time for a step. In space, where
/// each item has three times the nodes, it gains nothing.
template <int d, int lanes>
inline constexpr bool may_go_alone = d == 2 && lanes > 2;
/// Whether so many packs of such items, from so many groups, are processed this way.
constexpr bool go_alone(std::size_t packs, std::size_t groups) { return groups >= 3 * packs; }

/// The relative cost of a gather for a pack of items in any cells, and for a pack with one item per cell. In
/// any cells, one permutation per coefficient moves values of cells to the lanes of their items.
inline constexpr std::size_t price_of_any_cells = 3, price_of_own_cells = 2;

/// Whether a group of cells goes rank by rank where a phase can do so: it has so many items in so many ranks.
/// Nothing is stored in between then, but all of its lanes are updated, whether they have an item or not.
constexpr bool go_by_rank(std::size_t items, int ranks, int lanes)
{
    return 3 * items >= 2 * std::size_t(ranks) * std::size_t(lanes);
}
/// How far ahead such a loop fetches what it will load.
template <int lanes>
inline constexpr std::size_t slots_ahead = 8 * lanes;

/// If more than one in this many items of a block goes to another cell of the block, these scatter before the
/// next block is processed; otherwise their contributions are stored. Measured: scattering at once whatever
/// their number takes a step of random items, a tenth of which leave their cells, 5 % longer, and one of a
/// splash 12 %. Storing takes some 110 bytes per leaver, which matters where half of all items leave in one
/// step.
inline constexpr std::size_t most_listed_share = 4;

} // namespace firn::openmp

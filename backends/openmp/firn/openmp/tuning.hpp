// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>

// Asks for a function to be inlined whole: the compiler's own measure stops in the middle of the formulas,
// and packs then travel through memory. Instrumented code would take ten minutes to compile that way, and
// who defines FIRN_COMPILE_SOON would rather wait for steps than for the compiler.
#if defined(__OPTIMIZE__) && !defined(FIRN_COMPILE_SOON) && !defined(__SANITIZE_ADDRESS__) &&                \
    !defined(__SANITIZE_THREAD__)
#define FIRN_INLINE_WHOLE [[gnu::flatten]]
#else
#define FIRN_INLINE_WHOLE
#endif

// Before a loop of few turns that stands in code many times: unrolled, it would take the compiler's time and
// the cache of instructions.
#if defined(__clang__)
#define FIRN_KEEP_LOOP _Pragma("clang loop unroll(disable)")
#elif defined(__GNUC__)
#define FIRN_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define FIRN_KEEP_LOOP
#endif

namespace firn::openmp
{

/// A thread has so many items or more, or others do its work, too: they are awake and have the data at hand.
/// (Measured on standing waves: two threads take as long as one for 1000 items, half as long again for 250.)
inline constexpr std::size_t items_per_thread = 512;
/// The same for blocks of nodes, of which the edge of a body has most.
inline constexpr std::size_t node_blocks_per_thread = 6;

/// How many of some threads work on so many items, or blocks.
constexpr int threads_for(std::size_t work, int threads, std::size_t of_each = items_per_thread)
{
    std::size_t const most = work / of_each;
    return most >= static_cast<std::size_t>(threads) ? threads : std::max(1, static_cast<int>(most));
}

/// The shape of a grid block: the unit of memory, of work and of sums. Rows lie along the last axis, where
/// lanes are.
///
/// Measured on snow with cubic kernels: smaller blocks cost more in their borders (a block sums into its own
/// nodes and `order` more per axis), larger ones hold more empty cells at free surfaces.
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

/// How many ranks of a group give at once: what they give stays in the fastest cache, and the sums of a row
/// of nodes in registers. (Measured on quadratic kernels: 8 and 16 are one or two per cent slower.)
inline constexpr int ranks_at_once = 12;

/// Whether items that are few in some groups of cells may go each for itself (see ScatteredItems): a group's
/// cells read all their nodes, and add to all, whoever is in them. (Measured with 16 lanes on standing waves
/// between walls, where one column of cells is left over: 2 % less for a step. In space, where each item has
/// three times the nodes, nothing.)
template <int d, int lanes>
inline constexpr bool may_go_alone = d == 2 && lanes > 2;
/// Whether so many packs of them, from so many groups, do so.
constexpr bool go_alone(std::size_t packs, std::size_t groups) { return groups >= 3 * packs; }

/// What it costs to let a pack of items take from nodes, in any cells against one of each cell: what is of
/// the cells goes to the lanes of their items, one permutation per coefficient.
inline constexpr std::size_t price_of_any_cells = 3, price_of_own_cells = 2;

/// Of the items of a block at most one in so many is kept with what it gives when it goes to another cell of
/// the block; if there are more, they give before the next block's turn. (Measured: that whatever their
/// number takes a step of random particles, a tenth of which leave their cells, 5 % longer, one of a splash
/// 12 %; what is kept is some 110 bytes each, which counts where half of all leave in one step.)
inline constexpr std::size_t share_to_keep = 4;

} // namespace firn::openmp

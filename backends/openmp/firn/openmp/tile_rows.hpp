// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

// Rows of the tile of a block of cells: which of them the block touches, and how they are cleared or filled.
namespace firn::openmp::detail
{

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

} // namespace firn::openmp::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/openmp/cell_group.hpp>
#include <firn/openmp/grid.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

namespace firn::openmp
{

namespace detail
{
/// Adds up, for one row of a node block, the tiles of a layer that cover it; sets `any` if one does.
template <class LayerType, int channels, class Number>
void add_row(LayerType const& layer, std::array<int, LayerType::corners> const& covered_by, int row,
             Number (&sums)[std::size_t(channels)][std::size_t(LayerType::Shape::along)], bool& any)
{
    using Shape = typename LayerType::Shape;
    constexpr int d = LayerType::corners == 8 ? 3 : 2, degree = LayerType::row_length - Shape::along;
    for (int corner = 0; corner < LayerType::corners; ++corner) {
        int const b = covered_by[std::size_t(corner)];
        if (b == LayerType::absent) continue;
        // the row's place in the tile of a block that lies `corner` before this one
        auto const o = LayerType::offset(corner);
        int const first = (d == 3 ? row / Shape::across : row) + o[0] * Shape::across;
        if (first >= LayerType::rows_across) continue;
        int tile_row = first;
        if constexpr (d == 3) {
            int const second = row % Shape::across + o[1] * Shape::across;
            if (second >= LayerType::rows_across) continue;
            tile_row = first * LayerType::rows_across + second;
        }
        std::uint64_t const touched = layer.touched(std::size_t(b));
        if (((touched >> tile_row) & 1) == 0 || (o[d - 1] == 1 && (touched & LayerType::ends) == 0)) continue;
        if (!any)
            for (auto& channel : sums) std::fill(channel, channel + Shape::along, Number(0));
        any = true;
        for (int c = 0; c < channels; ++c) {
            Number const* const from =
                layer.tile(std::size_t(b)) + c * LayerType::tile_channel + tile_row * LayerType::row_length;
            if (o[d - 1] == 0)
                for (int k = 0; k < Shape::along; ++k) sums[c][k] += from[k];
            else
                for (int k = 0; k < degree; ++k) sums[c][k] += from[Shape::along + k];
        }
    }
}

/// The same for all layers; false if no tile covers the row.
template <class GridType, int channels, class Number>
bool sum_row(GridType& grid, typename GridType::NodeBlock const& node, int row,
             Number (&sums)[std::size_t(channels)][std::size_t(GridType::Shape::along)])
{
    bool any = false;
    for (int l = 0; l < GridType::layers; ++l)
        add_row<typename GridType::Layer, channels>(grid.layer(std::size_t(l)),
                                                    node.covered_by[std::size_t(l)], row, sums, any);
    return any;
}
} // namespace detail

/// Neighbouring nodes along a row that look at others.
template <class Lane, class GridType, int d>
class LookingNodes : public NodeLanes<Lane, GridType, d>
{
    using Base = NodeLanes<Lane, GridType, d>;
    using Shape = typename GridType::Shape;
    static constexpr int lanes = lane_width<Lane>;

public:
    using Number = typename Base::Number;

    /// `node` is a pack of nodes in a row of a block; `sums` holds the whole row.
    LookingNodes(Base const& node, Number const* sums, GridType& grid, int block, int row)
        : Base(node), sums_(sums), grid_(grid), block_(block), row_(row)
    {}

    /// The sums of the nodes `first` + `along`, the latter on the last axis, in the lanes of `which`; zeros
    /// where there is no node, and in other lanes.
    template <int channels>
    void sums_at(Coordinates<d> const& first, Lane const& along, Mask<Lane> const& which,
                 Lane (&found)[std::size_t(channels)]) const
    {
        auto const [block, place] = GridType::block_and_place(first);
        int row = 0;
        for (int a = 0; a < d - 1; ++a) row = row * Shape::across + place[a];
        Number other[std::size_t(channels)][std::size_t(Shape::along)];
        Number const* const sums = row_sums<channels>(block, row, other);

        // most packs look at consecutive nodes
        Mask<Lane> const in_turn = exactly_equal(along, counting<Lane>());
        for (int c = 0; c < channels; ++c)
            found[c] = select(which & in_turn, LaneTraits<Lane>::load(sums + c * Shape::along + place[d - 1]),
                              Lane(Number(0)));
        std::uint64_t rest = bits(which & !in_turn);
        if (rest == 0) return;
        Number steps[std::size_t(lanes)];
        LaneTraits<Lane>::store(along, steps);
        for (; rest != 0; rest &= rest - 1) {
            int const lane = std::countr_zero(rest), at = place[d - 1] + static_cast<int>(steps[lane]);
            Number of_node[std::size_t(channels)];
            if (at >= 0 && at < Shape::along)
                for (int c = 0; c < channels; ++c) of_node[c] = sums[c * Shape::along + at];
            else {
                Coordinates<d> node = first;
                node[d - 1] += static_cast<int>(steps[lane]);
                grid_.sums_at(node, of_node);
            }
            auto const here = mask_of<Lane>(std::uint64_t{1} << lane);
            for (int c = 0; c < channels; ++c) found[c] = select(here, Lane(of_node[c]), found[c]);
        }
    }

private:
    /// The sums of a row of a block; computed into `other` unless this row's are at hand.
    template <int channels>
    Number const* row_sums(Coordinates<d> const& block, int row,
                           Number (&other)[std::size_t(channels)][std::size_t(Shape::along)]) const
    {
        int const n = block == grid_.nodes()[std::size_t(block_)].coordinates ? block_ : grid_.find(block);
        if (n == block_ && row == row_) return sums_;
        if (n == GridType::absent ||
            !detail::sum_row<GridType, channels>(grid_, grid_.nodes()[std::size_t(n)], row, other))
            for (auto& channel : other) std::fill(channel, channel + Shape::along, Number(0));
        return &other[0][0];
    }

    Number const* sums_;
    GridType& grid_;
    int block_, row_;
};

} // namespace firn::openmp

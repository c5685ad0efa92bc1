// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/openmp/cell_group.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/image_lists.hpp>
#include <firn/openmp/items.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace firn::openmp
{

namespace detail
{
/// Calls `use(block of a tile, its row, whether it covers no more than the first nodes)` for the tiles of a
/// layer that cover one row of a node block, and were added to there.
template <class LayerType, class Use>
FIRN_INLINE_WHOLE void for_each_tile(LayerType const& layer,
                                     std::array<int, LayerType::corners> const& covered_by, int row,
                                     Use const& use)
{
    using Shape = typename LayerType::Shape;
    constexpr int d = LayerType::corners == 8 ? 3 : 2;
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
        use(std::size_t(b), tile_row, o[d - 1] == 1);
    }
}

/// Adds up, for one row of a node block, some channels of the tiles of a layer that cover it; sets `any` if
/// one does. By packs: compilers do not know that tiles and sums lie apart.
template <class Lane, class LayerType, int channels, class Number = ScalarOf<Lane>>
void add_row(LayerType const& layer, std::array<int, LayerType::corners> const& covered_by, int row,
             Number (&sums)[std::size_t(channels)][std::size_t(LayerType::Shape::along)], bool& any,
             int first_channel = 0)
{
    using Shape = typename LayerType::Shape;
    constexpr int degree = LayerType::row_length - Shape::along, lanes = lane_width<Lane>;
    for_each_tile(layer, covered_by, row, [&](std::size_t b, int tile_row, bool covers_begin) {
        if (!any)
            for (auto& channel : sums)
                for (int k = 0; k < Shape::along; k += lanes)
                    LaneTraits<Lane>::store(Lane(Number(0)), channel + k);
        any = true;
        for (int c = 0; c < channels; ++c) {
            Number const* const from = layer.tile(b) + (first_channel + c) * LayerType::tile_channel +
                                       tile_row * LayerType::row_length;
            if (!covers_begin)
                for (int k = 0; k < Shape::along; k += lanes)
                    LaneTraits<Lane>::store(
                        LaneTraits<Lane>::load(sums[c] + k) + LaneTraits<Lane>::load(from + k), sums[c] + k);
            else if constexpr (lanes >= degree && lanes > 1)
                LaneTraits<Lane>::store(
                    LaneTraits<Lane>::load(sums[c]) + Lane::load_first(degree, from + Shape::along), sums[c]);
            else
                for (int k = 0; k < degree; ++k) sums[c][k] += from[Shape::along + k];
        }
    });
}

/// The same for all layers; false if no tile covers the row.
template <class Lane, class GridType, int channels, class Number = ScalarOf<Lane>>
bool sum_row(GridType& grid, typename GridType::NodeBlock const& node, int row,
             Number (&sums)[std::size_t(channels)][std::size_t(GridType::Shape::along)])
{
    bool any = false;
    for (int l = 0; l < GridType::layers; ++l)
        add_row<Lane, typename GridType::Layer, channels>(grid.layer(std::size_t(l)),
                                                          node.covered_by[std::size_t(l)], row, sums, any);
    return any;
}

/// The rows of a node block that tiles of a layer cover which were added to there: a bit for each.
template <class LayerType>
std::uint64_t covered_rows(LayerType const& layer, std::array<int, LayerType::corners> const& covered_by)
{
    constexpr int d = LayerType::corners == 8 ? 3 : 2, across = LayerType::Shape::across;
    auto const first_bits = [](int count) { return (std::uint64_t{1} << count) - 1; };
    std::uint64_t rows = 0;
    for (int corner = 0; corner < LayerType::corners; ++corner) {
        int const b = covered_by[std::size_t(corner)];
        if (b == LayerType::absent) continue;
        std::uint64_t const touched = layer.touched(std::size_t(b));
        auto const o = LayerType::offset(corner);
        if (o[d - 1] == 1 && (touched & LayerType::ends) == 0) continue;
        auto const here = [&](int axis) { // of the rows along an axis, so many
            return std::min(across, LayerType::rows_across - o[axis] * across);
        };
        if constexpr (d == 3)
            for (int i = 0; i < here(0); ++i) {
                int const first = (i + o[0] * across) * LayerType::rows_across + o[1] * across;
                rows |= ((touched >> first) & first_bits(here(1))) << (i * across);
            }
        else
            rows |= (touched >> (o[0] * across)) & first_bits(here(0));
    }
    return rows;
}
/// The same for all layers.
template <class GridType>
std::uint64_t covered_rows(GridType& grid, typename GridType::NodeBlock const& node)
{
    std::uint64_t rows = 0;
    for (int l = 0; l < GridType::layers; ++l)
        rows |= covered_rows(grid.layer(std::size_t(l)), node.covered_by[std::size_t(l)]);
    return rows;
}
} // namespace detail

/// Neighbouring nodes along a row, with the sums and values of each layer.
template <class Lane, class GridType, int d, int channels>
class NodesOfLayers
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;
    using Shape = typename GridType::Shape;
    static constexpr std::size_t layers = std::size_t(GridType::layers);

    /// The nodes of a row of a block, those at `place` first.
    NodesOfLayers(GridType& grid, std::size_t block, int row) : grid_(grid), block_(block), row_(row)
    {
        auto const& covered_by = grid.nodes()[block].covered_by;
        for (std::size_t l = 0; l < layers; ++l)
            detail::add_row<Lane, typename GridType::Layer, channels>(grid.layer(l), covered_by[l], row,
                                                                      sums_[l], has_[l]);
    }
    /// Goes to the nodes at `place` in the row.
    void enter(int place) { place_ = place; }

    /// Whether something of a layer, or of any, was added to the row.
    bool has(std::size_t layer) const { return has_[layer]; }
    bool has_any() const { return std::find(has_.begin(), has_.end(), true) != has_.end(); }
    Lane sum(std::size_t layer, int channel) const
    {
        return LaneTraits<Lane>::load(&sums_[layer][std::size_t(channel)][std::size_t(place_)]);
    }
    /// The sums of the nodes `step` beside these, in the lanes of `which`.
    Lane sum_beside(std::size_t layer, int channel, Coordinates<d> const& step, Mask<Lane> const& which) const
    {
        Row const& row = row_beside(layer, channel, step);
        return select(which, LaneTraits<Lane>::load(&row.sums[place_ + 1 + step[d - 1]]), Lane(Number(0)));
    }
    void set(std::size_t layer, int channel, Lane const& value) const
    {
        LaneTraits<Lane>::store(value, grid_.node_values(block_, layer) + channel * GridType::block_channel +
                                           row_ * Shape::along + place_);
    }
    Coordinates<d> first() const
    {
        return GridType::node_at(grid_.nodes()[block_].coordinates, row_, place_);
    }
    Vector<Lane, d> offset() const
    {
        Vector<Lane, d> steps = zeros<Vector<Lane, d>>();
        steps[d - 1] = counting<Lane>();
        return steps;
    }

private:
    /// One channel of a layer along a row, from one node before it to one behind it.
    struct Row
    {
        int channel = -1; ///< -1: not known yet
        Number sums[std::size_t(Shape::along + 2)];
    };

    /// The row that lies `step` beside this one, but for the step's part along the row.
    Row const& row_beside(std::size_t layer, int channel, Coordinates<d> step) const
    {
        step[d - 1] = 0;
        int which = 0;
        for (int a = 0; a < d - 1; ++a) which = 3 * which + step[a] + 1;
        Row& found = beside_[layer][std::size_t(which)];
        if (found.channel == channel) return found;
        found.channel = channel;
        Coordinates<d> const node = GridType::node_at(grid_.nodes()[block_].coordinates, row_, 0) + step;
        auto const [block, place] = GridType::block_and_place(node);
        int row = 0;
        for (int a = 0; a < d - 1; ++a) row = row * Shape::across + place[a];
        Number sums[1][std::size_t(Shape::along)];
        bool any = false;
        if (int const n = grid_.find(block); n != GridType::absent)
            detail::add_row<Lane, typename GridType::Layer, 1>(
                grid_.layer(layer), grid_.nodes()[std::size_t(n)].covered_by[layer], row, sums, any, channel);
        for (int k = 0; k < Shape::along; ++k) found.sums[k + 1] = any ? sums[0][k] : Number(0);
        auto const at_end = [&](int along) {
            Coordinates<d> end = node;
            end[d - 1] += along;
            Number of_node[std::size_t(channels)]{};
            grid_.add_sums_at(end, layer, of_node);
            found.sums[along + 1] = of_node[channel];
        };
        at_end(-1);
        at_end(Shape::along);
        return found;
    }

    GridType& grid_;
    std::size_t block_;
    int row_, place_ = 0;
    std::array<bool, layers> has_{};
    alignas(64) Number sums_[layers][std::size_t(channels)][std::size_t(Shape::along)];
    mutable Row beside_[layers][d == 3 ? 9 : 3];
};

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
            Number of_node[std::size_t(GridType::node_sums)]; // a phase may know some of them
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
            !detail::sum_row<Lane, GridType, channels>(grid_, grid_.nodes()[std::size_t(n)], row, other))
            for (auto& channel : other) std::fill(channel, channel + Shape::along, Number(0));
        return &other[0][0];
    }

    Number const* sums_;
    GridType& grid_;
    int block_, row_;
};

/// Neighbouring nodes along a row that look at images which are listed.
template <class Lane, class GridType, int d>
class ListedNodes : public NodeLanes<Lane, GridType, d>
{
    using Base = NodeLanes<Lane, GridType, d>;
    using Shape = typename GridType::Shape;

public:
    using Number = typename Base::Number;
    static constexpr bool has_listed_images = true;

    /// `node` is a pack of nodes in a row of a block; `sums` holds the whole row.
    ListedNodes(Base const& node, Number const* sums, GridType& grid, int block, int row,
                ImageLists::Pack const& listed)
        : Base(node), sums_(sums), grid_(grid), block_(static_cast<std::uint32_t>(block)),
          row_(static_cast<std::uint8_t>(row)), listed_(listed)
    {}

    Mask<Lane> are_images() const { return mask_of<Lane>(listed_.are_images); }

    /// Calls `use(sums, behind which walls)` for the nodes themselves and for their images, with zeros in
    /// lanes that have no such image.
    template <int channels, class Use>
    void for_each_image(Use const& use) const
    {
        alignas(64) Number other[std::size_t(channels)][std::size_t(Shape::along)];
        auto const& images = listed_.images;
        for (std::size_t i = 0; i < images.size();) {
            // row by row, so that what `use` adds up stays in registers between the calls for rows
            std::uint32_t const block = images[i].block;
            std::uint8_t const row = images[i].row;
            bool const is_own = block == block_ && row == row_;
            bool const any =
                is_own || detail::sum_row<Lane, GridType, channels>(grid_, grid_.nodes()[block], row, other);
            Number const* const sums = is_own ? sums_ : &other[0][0];
            for (; i < images.size() && images[i].block == block && images[i].row == row; ++i)
                if (any) use_image<channels>(images[i], sums, use);
        }
    }

private:
    template <int channels, class Use>
    static void use_image(ImageInRow const& image, Number const* sums, Use const& use)
    {
        Mask<Lane> const lanes = mask_of<Lane>(image.lanes);
        Lane found[std::size_t(channels)];
        for (int c = 0; c < channels; ++c) {
            Number const* const from = sums + c * Shape::along + image.place;
            found[c] =
                select(lanes, image.is_single ? Lane(*from) : LaneTraits<Lane>::load(from), Lane(Number(0)));
        }
        use(found, image.behind);
    }

    Number const* sums_;
    GridType& grid_;
    std::uint32_t block_;
    std::uint8_t row_;
    ImageLists::Pack listed_;
};

/// A pack of nodes whose images are being listed.
template <class Lane, class GridType, int d>
class ListingNodes
{
    using Shape = typename GridType::Shape;
    using Number = ScalarOf<Lane>;
    static constexpr int lanes = lane_width<Lane>;
    static_assert(lanes <= 32 && Shape::rows <= 256 && Shape::along <= 256, "as ImageInRow keeps them");

public:
    using Real = Lane;

    ListingNodes(GridType const& grid, Coordinates<d> const& first, ImageLists& lists)
        : grid_(grid), first_(first), lists_(lists)
    {}

    Coordinates<d> first() const { return first_; }
    Vector<Lane, d> offset() const
    {
        Vector<Lane, d> steps = zeros<Vector<Lane, d>>();
        steps[d - 1] = counting<Lane>();
        return steps;
    }

    /// Notes that the nodes `first` + `along`, the latter on the last axis, are images of those in the lanes
    /// of `which`, behind some walls.
    template <class Walls, std::size_t count>
    void note_image(Coordinates<d> const& first, Lane const& along, Mask<Lane> const& which,
                    std::array<bool, count> const& behind, Walls const& walls) const
    {
        static_assert(count <= BehindWalls::most);
        BehindWalls of_walls;
        for (std::size_t w = 0; w < count; ++w) {
            if (!behind[w]) continue;
            of_walls.bits |= std::uint32_t(1) << w;
            of_walls.turns[walls[w].axis] = -1;
        }
        Mask<Lane> const in_turn = exactly_equal(along, counting<Lane>()); // most lanes look so
        if (any(which & in_turn)) note(first, bits(which & in_turn), of_walls, false);
        Number steps[std::size_t(lanes)];
        LaneTraits<Lane>::store(along, steps);
        for (std::uint64_t rest = bits(which & !in_turn); rest != 0; rest &= rest - 1) {
            int const lane = std::countr_zero(rest);
            Coordinates<d> node = first;
            node[d - 1] += static_cast<int>(steps[lane]);
            note(node, std::uint64_t{1} << lane, of_walls, true);
        }
    }

private:
    void note(Coordinates<d> const& node, std::uint64_t which, BehindWalls behind, bool is_single) const
    {
        auto const [block, place] = GridType::block_and_place(node);
        int const n = grid_.find(block);
        if (n == GridType::absent) return;
        int row = 0;
        for (int a = 0; a < d - 1; ++a) row = row * Shape::across + place[a];
        lists_.add({static_cast<std::uint32_t>(which), behind, static_cast<std::uint32_t>(n),
                    static_cast<std::uint8_t>(row), static_cast<std::uint8_t>(place[d - 1]), is_single});
    }

    GridType const& grid_;
    Coordinates<d> first_;
    ImageLists& lists_;
};

/// Lists the images that a phase looks at, unless they are listed already.
template <class Lane, class GridType, class Phase, class Walls>
void list_images(GridType& grid, Phase const& phase, Walls const& walls)
{
    using Shape = typename GridType::Shape;
    constexpr int d = Phase::d, lanes = lane_width<Lane>, packs_of_row = Shape::along / lanes;
    if (grid.images().are_of(grid.numbering(), walls, grid.nodes())) return;
    grid.images().make(
        grid.numbering(), walls, grid.nodes(), Shape::rows * packs_of_row,
        [&](std::size_t n, int pack, ImageLists& lists) -> std::uint64_t {
            Coordinates<d> const at = GridType::node_at(grid.nodes()[n].coordinates, pack / packs_of_row,
                                                        pack % packs_of_row * lanes);
            if (!phase.looks_around_at(walls, at, lanes)) return 0;
            return bits(phase.list_images(walls, ListingNodes<Lane, GridType, d>(grid, at, lists)));
        });
}

} // namespace firn::openmp

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/grid.hpp>

#include <cassert>

namespace firn::cuda
{

/// One cell and one of its items at a time, as a phase sees them. A device thread plays both roles, that of
/// items side by side and that of a group of cells, and keeps in registers what goes from one to the other.
template <class Order, class GridType, class Phase, int d>
class CellOfThread
{
public:
    using Real = typename GridType::Number;
    using Number = Real;
    using Offset = typename Order::Offset;
    using TileShape = typename GridType::TileShape;

    /// `read` is the reference value of the tile of node values that the cell's items will read, or null for
    /// a phase that reads none.
    __device__ CellOfThread(Coordinates<d> const& cell, typename GridType::Values const* read)
        : cell_(cell), read_(read), reference_(read)
    {
        forget();
    }

    /// Goes to the item of a cell that lies at `source` and has the slot `slot`.
    __device__ void enter(Coordinates<d> const& cell, typename GridType::Values const* read,
                          std::uint32_t source, std::uint32_t slot)
    {
        assert(source != absent && slot != absent && "an item is one that is there");
        cell_ = cell;
        read_ = read;
        source_ = source;
        slot_ = slot;
        way_ = 0;
        leaves_ = false;
    }

    /// Sets the scratch to zero: the cell has no item of this rank.
    __device__ void forget()
    {
#pragma unroll
        for (int c = 0; c < Phase::scratch_channels; ++c) scratch_[c] = 0;
        leaves_ = false;
    }

    __device__ bool here() const { return true; }

    __device__ void set_scratch(int channel, Number value) { scratch_[channel] = value; }
    __device__ Number scratch(int channel) const { return scratch_[channel]; }

    __device__ Number load(Number const* array) const { return read(array); }
    __device__ void store(Number* array, Number value) const { array[slot_] = value; }
    __device__ Number load_stored(Number const* array) const { return array[slot_]; }
    __device__ void store_at(Number* array, std::uint32_t const* index, Number value) const
    {
        array[read(index)] = value;
    }
    template <class T>
    __device__ void expect_load(T const*) const
    {}
    template <class T>
    __device__ void expect_store(T const*) const
    {}

    __device__ Number load_offset(Offset const* array, int) const
    {
        return CellOffset<Number>::value(read(array));
    }

    /// Moves the offset along the next axis and notes the neighbour it leads to.
    __device__ bool move_offset(Offset const* from, Offset* to, int axis, Number displacement,
                                Number& value) const
    {
        Offset stored = CellOffset<Number>::moved(read(from), displacement);
        to[slot_] = stored;
        value = CellOffset<Number>::value(stored);
        int const cells = CellOffset<Number>::wrap(stored);
        moved_[axis] = stored;
        way_ = 3 * way_ + static_cast<std::uint32_t>(cells + 1);
        return cells == 0;
    }

    template <class T>
    __device__ void copy(T const* from, T* to) const
    {
        to[slot_] = read(from);
    }
    template <class Ask>
    __device__ Number map(Ask const& ask) const
    {
        return ask(source_);
    }
    template <class T>
    __device__ T value(T const* array, int) const
    {
        return array[source_];
    }

    __device__ Coordinates<d> first() const { return cell_; }
    __device__ Vector<Number, d> along() const { return Vector<Number, d>::Zero(); }
    __device__ bool at_the_edge() const
    {
        constexpr int most = static_cast<int>(Order::largest_coordinate);
        bool is_near = false;
#pragma unroll
        for (int a = 0; a < d; ++a) is_near = is_near || cell_[a] > most || cell_[a] < -most;
        return is_near;
    }

    /// Marks the item as a leaver. Its contribution goes to a list, and is not scattered here.
    __device__ void leave(bool, int, int) { leaves_ = true; }
    __device__ bool leaves() const { return leaves_; }
    __device__ std::uint32_t slot() const { return slot_; }
    __device__ std::uint32_t way() const { return way_; } ///< the neighbour it goes to, as in Leavers
    /// After the item has moved: its offset in the cell where it is then.
    __device__ Number offset_in_cell(int axis) const { return CellOffset<Number>::value(moved_[axis]); }
    /// Loads the contribution of a leaver.
    __device__ void read_outgoing(detail::Leavers<Number> const& leavers, std::uint32_t i)
    {
        using Some = detail::NumbersAtOnce<Number>;
        constexpr int channels = Phase::Scatter::scratch_channels,
                      vectors = detail::in_whole_vectors<Number>(channels) / Some::count;
        auto const* const from =
            reinterpret_cast<Some const*>(leavers.contribution) + std::size_t(i) * vectors;
#pragma unroll
        for (int v = 0; v < vectors; ++v) {
            Some const some = from[v];
#pragma unroll
            for (int k = 0; k < Some::count; ++k)
                if (int const c = v * Some::count + k; c < channels) scratch_[c] = some.of[k];
        }
    }

    /// Channel c of a node in the middle of the tile.
    __device__ Number reference(int c) const { return reference_->of[c]; }
    /// Channel c of the node at place k in a row of the cell's stencil, less the reference.
    __device__ Number node(int c, int row, int k) const
    {
        assert(TileShape::has(row, k) && "a node is in the stencil of its cell");
        return read_[TileShape::in_stencil(row, k)].of[c];
    }

private:
    /// What a table has of the item. A loop that moves items only reads from the table before, so that loads
    /// need not wait for stores.
    template <class T>
    __device__ T read(T const* array) const
    {
        if constexpr (Phase::work.moves)
            return __ldg(array + source_);
        else
            return array[source_];
    }

    Coordinates<d> cell_;
    typename GridType::Values const *read_, *reference_;
    std::uint32_t source_ = 0, slot_ = 0;
    mutable std::uint32_t way_ = 0;
    mutable Offset moved_[d]; ///< into its cell
    bool leaves_ = false;
    Number scratch_[Phase::scratch_channels];
};

/// The sums of a cell's stencil where its group of cells adds them up: `sums[k][row]` is a node that is
/// loaded once, added to, and stored. All lanes of a warp do so at the same node of their stencils at a time,
/// so that no two of them touch the same node of the grid. Lanes without an item leave memory alone: it has
/// the most to do where few lanes have one.
template <class GridType>
struct SumsInTile
{
    using Sums = typename GridType::Sums;

    /// A node while it is added to; the destructor stores it.
    struct Node
    {
        Sums* to;
        Sums sums{};
        bool here;

        __device__ Node(Sums* where, bool is_here) : to(where), here(is_here)
        {
            if (here) sums = *to;
        }
        Node(Node const&) = delete;
        __device__ ~Node()
        {
            if (here) *to = sums;
            __syncwarp();
        }
        __device__ auto& operator[](int channel) { return sums.of[channel]; }
    };

    /// The nodes of a stencil that share a `k`.
    struct Column
    {
        Sums* first;
        int k;
        bool here;
        __device__ Node operator[](int row) const
        {
            assert(GridType::TileShape::has(row, k) && "a node is in the stencil of its cell");
            return Node(first + GridType::TileShape::in_stencil(row, k), here);
        }
    };

    Sums* first;
    bool here = true; ///< whether the cell has an item
    __device__ Column operator[](int k) const { return {first, k, here}; }
};

/// One node, as a phase sees it, which keeps the values that are not set or not.
template <class GridType, int d, bool keeps>
class NodeOfThread
{
public:
    using Real = typename GridType::Number;
    static constexpr bool has_index = true;

    __device__ NodeOfThread(typename GridType::Sums const& sums, typename GridType::Values const& before,
                            Coordinates<d> const& node, std::size_t index)
        : sums_(sums), before_(before), node_(node), index_(index)
    {
        if constexpr (keeps) values_ = before;
    }

    __device__ Real sum(int channel) const { return sums_.of[channel]; }
    /// The value from before this update.
    __device__ Real value(int channel) const { return before_.of[channel]; }
    __device__ void set(int channel, Real value)
    {
        values_.of[channel] = value;
        are_new_ = true;
    }
    __device__ Coordinates<d> first() const { return node_; }
    __device__ Vector<Real, d> offset() const { return Vector<Real, d>::Zero(); }
    __device__ std::size_t index() const { return index_; } ///< of all nodes of the grid
    __device__ typename GridType::Values const& values() const { return values_; }
    /// Whether they are to be written. A phase that sets none neither reads nor writes any.
    __device__ bool are_new() const { return are_new_; }

private:
    bool are_new_ = !keeps;
    typename GridType::Sums sums_;
    typename GridType::Values values_{};
    typename GridType::Values const& before_;
    Coordinates<d> node_;
    std::size_t index_;
};

} // namespace firn::cuda

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/reference/cell_order.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

// The nodes, and one of them as a phase sees it. What their members owe is in firn/backend.hpp.
namespace firn::reference
{

/// The nodes under the cells. They appear when something is added to them. Each order of cells has a *layer*:
/// sums of its own, of this step and of the next one. All layers share the values, or each has its own.
template <class Number, int d, int degree, int sums, int values, int layers, bool own_values>
class Grid
{
public:
    /// In double precision for any Number, so that the order in which items are added hardly matters.
    using Sums = std::array<double, std::size_t(sums)>;
    using Values = std::array<Number, std::size_t(values)>;
    /// Numbers of nodes; those of a new node are 0.
    template <class Numbers>
    using NodeMap = std::map<Coordinates<d>, Numbers, FirstAxisFirst>;

    /// The grid as one order of cells sees it. A light handle, made when needed.
    struct Layer
    {
        NodeMap<Sums>&sums_now, &next_sums;
        NodeMap<Values> const& node_values;
        Periods<d> periods;

        /// The values around a cell; all of these nodes have been updated.
        auto values_around(Coordinates<d> const& cell) const
        {
            return around(cell, [&](auto const& node) { return node_values.at(node).data(); });
        }
        /// The sums around a cell, of this step or of the next one.
        auto sums_around(Coordinates<d> const& cell, NodeMap<Sums>& of) const
        {
            return around(cell, [&](auto const& node) { return of[node].data(); });
        }

    private:
        /// What `find` finds of each node around a cell: `stencil[k][row]`, as phases count nodes.
        template <class Find>
        auto around(Coordinates<d> const& cell, Find const& find) const
        {
            constexpr int width = degree + 1, rows = d == 3 ? width * width : width;
            std::array<std::array<decltype(find(cell)), std::size_t(rows)>, std::size_t(width)> stencil;
            for (int row = 0; row < rows; ++row)
                for (int k = 0; k < width; ++k) {
                    Coordinates<d> node = cell - Coordinates<d>::Constant(stencil_reach(degree));
                    node[0] += d == 3 ? row / width : row;
                    if (d == 3) node[1] += row % width;
                    node[d - 1] += k;
                    stencil[std::size_t(k)][std::size_t(row)] = find(periods.wrapped(node));
                }
            return stencil;
        }
    };

    /// Single nodes that have been updated, by their indices, which hold until the next activate().
    class Nodes
    {
    public:
        static constexpr std::uint32_t absent = ~std::uint32_t(0);

        explicit Nodes(Grid& grid) : grid_(&grid)
        {
            for (auto const& [node, of_node] : grid.values_[0]) nodes_.push_back(node);
        }
        std::uint32_t find(Coordinates<d> const& node) const
        {
            Coordinates<d> const wrapped = grid_->periods_.wrapped(node);
            auto const found = std::ranges::lower_bound(nodes_, wrapped, FirstAxisFirst{});
            bool const is_there = found != nodes_.end() && *found == wrapped;
            return is_there ? static_cast<std::uint32_t>(found - nodes_.begin()) : absent;
        }
        std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t) const { return find(node); }
        Coordinates<d> const& node(std::uint32_t index) const { return nodes_[index]; }
        Number sum(std::uint32_t index, int channel) const { return grid_->sum(nodes_[index], channel); }
        Number& value(std::uint32_t index, int channel) const { return grid_->value(nodes_[index], channel); }

    private:
        Grid* grid_;
        std::vector<Coordinates<d>> nodes_;
    };

    explicit Grid(Reference const&, Periods<d> const& periods = {}) : periods_(periods) {}

    /// Prepares the nodes for a step: the values of the last one are not needed any more.
    void activate(auto const& /*orders*/)
    {
        for (auto& of_layer : values_) of_layer.clear();
        ++numbering_;
    }
    void swap() { now_.swap(next_); }

    Layer layer(std::size_t of) { return {now_[of], next_[of], values_[own_values ? of : 0], periods_}; }
    Nodes nodes_by_index() { return Nodes(*this); }
    std::size_t node_count() const { return values_[0].size(); }
    /// Changes whenever the indices of nodes do.
    std::uint64_t numbering() const { return numbering_; }

    /// The nodes that any layer added to.
    std::set<Coordinates<d>, FirstAxisFirst> nodes() const
    {
        std::set<Coordinates<d>, FirstAxisFirst> all;
        for (auto const& of_layer : now_)
            for (auto const& [node, of_node] : of_layer) all.insert(node);
        return all;
    }
    bool has(std::size_t layer, Coordinates<d> const& node) const { return now_[layer].contains(node); }
    /// What one layer added to a node, or all of them.
    double sum_of(std::size_t layer, Coordinates<d> const& node, int channel) const
    {
        auto const found = now_[layer].find(periods_.wrapped(node));
        return found == now_[layer].end() ? 0.0 : found->second[std::size_t(channel)];
    }
    Number sum(Coordinates<d> const& node, int channel) const
    {
        double sum = 0;
        for (std::size_t layer = 0; layer < now_.size(); ++layer) sum += sum_of(layer, node, channel);
        return static_cast<Number>(sum);
    }
    /// A value of a node, and of a layer if each has its own.
    Number& value(Coordinates<d> const& node, int channel, std::size_t layer = 0)
    {
        return values_[layer][node][std::size_t(channel)];
    }

    /// As much as a node of a map has usually: its numbers, its key, three links and a colour.
    std::size_t memory() const
    {
        std::size_t bytes = 0;
        auto const add = [&](auto const& of_layers) {
            for (auto const& of_layer : of_layers)
                bytes += of_layer.size() * (sizeof *of_layer.begin() + 4 * sizeof(void*));
        };
        add(values_), add(now_), add(next_);
        return bytes;
    }

protected:
    std::array<NodeMap<Sums>, std::size_t(layers)> now_, next_; ///< by layer
    std::array<NodeMap<Values>, own_values ? std::size_t(layers) : 1> values_;
    Periods<d> periods_;
    std::uint64_t numbering_ = 0;
};

/// One node, as a phase sees it: its sums over all layers and the values that these share, or the sums and
/// the values of each layer.
template <class GridType, int d>
class Node
{
public:
    using Real = typename GridType::Values::value_type;

    Node(GridType& grid, Coordinates<d> const& at) : grid_(grid), at_(at) {}

    Coordinates<d> first() const { return at_; }
    Vector<Real, d> offset() const { return zeros<Vector<Real, d>>(); }

    Real sum(int channel) const { return grid_.sum(at_, channel); }
    Real value(int channel) const { return grid_.value(at_, channel); }
    void set(int channel, Real value) { grid_.value(at_, channel) = value; }
    template <int channels>
    void sums_at(Coordinates<d> first, Real along, bool, Real (&found)[std::size_t(channels)]) const
    {
        first[d - 1] += static_cast<int>(along);
        for (int c = 0; c < channels; ++c) found[c] = grid_.sum(first, c);
    }

    bool has(std::size_t layer) const { return grid_.has(layer, at_); }
    Real sum(std::size_t layer, int channel) const { return Real(grid_.sum_of(layer, at_, channel)); }
    Real sum_beside(std::size_t layer, int channel, Coordinates<d> const& step, bool) const
    {
        return Real(grid_.sum_of(layer, at_ + step, channel));
    }
    void set(std::size_t layer, int channel, Real value) { grid_.value(at_, channel, layer) = value; }

private:
    GridType& grid_;
    Coordinates<d> at_;
};

} // namespace firn::reference

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/reference/array.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

// The nodes, and one of them as a phase sees it.
namespace firn::reference
{

/// Numbers of nodes by the nodes' coordinates, the first axis first. Those of a new node are 0.
template <class Numbers, int d>
using NodeMap = std::map<std::array<int, std::size_t(d)>, Numbers>;

/// A node's key in such a map.
template <int d>
std::array<int, std::size_t(d)> key_of(Coordinates<d> const& node)
{
    std::array<int, std::size_t(d)> key;
    std::copy_n(node.data(), d, key.begin());
    return key;
}

/// The numbers of the nodes of a cell's stencil: `stencil[k][row][channel]`, as phases count nodes.
template <class Number, int d, int degree>
class Stencil
{
public:
    static constexpr int width = degree + 1, rows = d == 3 ? width * width : width;

    Stencil() = default;
    /// `find(node)` says where its numbers are.
    template <class Find>
    Stencil(Coordinates<d> const& cell, Find const& find)
    {
        Coordinates<d> const first = cell - Coordinates<d>::Constant(stencil_reach(degree));
        for (int row = 0; row < rows; ++row)
            for (int k = 0; k < width; ++k) {
                Coordinates<d> node = first;
                node[0] += d == 3 ? row / width : row;
                if (d == 3) node[1] += row % width;
                node[d - 1] += k;
                node_[k][row] = find(node);
            }
    }

    auto& operator[](int k) const
    {
        assert(k >= 0 && k < width && "a node is in the stencil of its cell");
        return node_[k];
    }

private:
    Number* node_[std::size_t(width)][std::size_t(rows)]{};
};

/// The nodes under the cells. They appear when something is added to them. Each order of cells has a *layer*:
/// sums of its own, of this step and of the next one. All layers share the values, or each has its own.
template <class Number, int d, int degree, int sums, int values, int layers, bool own_values>
class Grid
{
public:
    /// In double precision for any Number, so that the order in which items are added hardly matters.
    using Sums = std::array<double, std::size_t(sums)>;
    using Values = std::array<Number, std::size_t(values)>;

    /// The grid as one order of cells sees it. A light handle, made when needed.
    struct Layer
    {
        NodeMap<Sums, d>&sums_now, &next_sums;
        NodeMap<Values, d> const& node_values;
        Periods<d> periods;

        /// The values around a cell; all of these nodes have been updated.
        Stencil<Number const, d, degree> values_around(Coordinates<d> const& cell) const
        {
            return {cell, [&](auto const& node) {
                        return node_values.at(key_of<d>(periods.wrapped(node))).data();
                    }};
        }
        /// The sums around a cell, of this step or of the next one.
        Stencil<double, d, degree> sums_around(Coordinates<d> const& cell, NodeMap<Sums, d>& of) const
        {
            return {cell, [&](auto const& node) { return of[key_of<d>(periods.wrapped(node))].data(); }};
        }
    };

    /// Single nodes that have been updated, by their indices, which hold until the next activate().
    class Nodes
    {
    public:
        static constexpr std::uint32_t absent = ~std::uint32_t(0);

        explicit Nodes(Grid& grid) : grid_(&grid)
        {
            for (auto& [key, of_node] : grid.values_[0]) {
                index_[key] = static_cast<std::uint32_t>(of_nodes_.size());
                of_nodes_.push_back({key, &of_node});
            }
        }
        std::uint32_t find(Coordinates<d> const& node) const
        {
            auto const found = index_.find(grid_->key(node));
            return found == index_.end() ? absent : found->second;
        }
        std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t) const { return find(node); }
        Number sum(std::uint32_t index, int channel) const
        {
            double sum = 0;
            for (auto const& of_layer : grid_->now_)
                if (auto const found = of_layer.find(of_nodes_[index].first); found != of_layer.end())
                    sum += found->second[std::size_t(channel)];
            return static_cast<Number>(sum);
        }
        Number& value(std::uint32_t index, int channel) const
        {
            return (*of_nodes_[index].second)[std::size_t(channel)];
        }

    private:
        Grid* grid_;
        NodeMap<std::uint32_t, d> index_;
        std::vector<std::pair<std::array<int, std::size_t(d)>, Values*>> of_nodes_;
    };

    explicit Grid(Reference const&, Periods<d> const& periods = {}) : periods_(periods) {}

    Layer layer(std::size_t of) { return {now_[of], next_[of], values_[own_values ? of : 0], periods_}; }
    /// A node's key.
    std::array<int, std::size_t(d)> key(Coordinates<d> const& node) const
    {
        return key_of<d>(periods_.wrapped(node));
    }

    /// Prepares the nodes for a step: the values of the last one are not needed any more.
    template <class Orders>
    void activate(Orders const&)
    {
        for (auto& of_layer : values_) of_layer.clear();
    }

    /// Makes the sums of the next step those of this one.
    void swap() { now_.swap(next_); }

    /// The sums of all nodes, added up layer by layer.
    NodeMap<Sums, d> all_sums() const
    {
        NodeMap<Sums, d> all;
        for (auto const& of_layer : now_)
            for (auto const& [node, more] : of_layer) {
                Sums& found = all[node];
                for (std::size_t c = 0; c < found.size(); ++c) found[c] += more[c];
            }
        return all;
    }
    /// The sums of one layer.
    NodeMap<Sums, d> const& sums_of(std::size_t layer) const { return now_[layer]; }
    /// The values of a node, and of a layer if each has its own.
    Values& values_at(std::array<int, std::size_t(d)> const& node, std::size_t layer = 0)
    {
        return values_[layer][node];
    }

    Nodes nodes_by_index() { return Nodes(*this); }
    /// How many indices there are.
    std::size_t node_count() const { return values_[0].size(); }

    /// As much as a node of a map has usually: its numbers, its key, three links and a colour.
    std::size_t memory() const
    {
        std::size_t const more = 4 * sizeof(void*);
        std::size_t bytes = 0;
        for (auto const& of_layer : values_) bytes += of_layer.size() * (sizeof(*of_layer.begin()) + more);
        for (auto const* both : {&now_, &next_})
            for (auto const& of_layer : *both) bytes += of_layer.size() * (sizeof(*of_layer.begin()) + more);
        return bytes;
    }

private:
    std::array<NodeMap<Sums, d>, std::size_t(layers)> now_, next_; ///< by layer
    std::array<NodeMap<Values, d>, own_values ? std::size_t(layers) : 1> values_;
    Periods<d> periods_;
};

/// One node, as a phase sees it that tells layers apart.
template <class GridType, int d>
class NodeOfLayers
{
public:
    using Key = std::array<int, std::size_t(d)>;
    using Real = typename GridType::Values::value_type;

    NodeOfLayers(GridType& grid, Key const& at) : grid_(grid), at_(at) {}

    bool has(std::size_t layer) const { return grid_.sums_of(layer).contains(at_); }
    Real sum(std::size_t layer, int channel) const { return sum_at(layer, channel, at_); }
    Real sum_beside(std::size_t layer, int channel, Coordinates<d> const& step, bool) const
    {
        return sum_at(layer, channel, grid_.key(first() + step));
    }
    void set(std::size_t layer, int channel, Real value)
    {
        grid_.values_at(at_, layer)[std::size_t(channel)] = value;
    }
    Coordinates<d> first() const { return Coordinates<d>(at_.data()); }
    Vector<Real, d> offset() const { return zeros<Vector<Real, d>>(); }

private:
    Real sum_at(std::size_t layer, int channel, Key const& node) const
    {
        auto const& sums = grid_.sums_of(layer);
        auto const found = sums.find(node);
        return found == sums.end() ? Real(0) : static_cast<Real>(found->second[std::size_t(channel)]);
    }

    GridType& grid_;
    Key at_;
};

/// One node, as a phase sees it.
template <class Number, int d, class Sums, class Values>
class Node
{
public:
    using Real = Number;

    /// `all` are the sums of all nodes, and `at` is one of them.
    Node(NodeMap<Sums, d> const& all, typename NodeMap<Sums, d>::const_iterator at, Values& values)
        : all_(all), at_(at), before_(values), values_(values)
    {}

    Number sum(int channel) const { return static_cast<Number>(at_->second[std::size_t(channel)]); }
    /// The value from before this update.
    Number value(int channel) const { return before_[std::size_t(channel)]; }
    void set(int channel, Number value) { values_[std::size_t(channel)] = value; }

    Coordinates<d> first() const { return Coordinates<d>(at_->first.data()); }
    Vector<Number, d> offset() const { return zeros<Vector<Number, d>>(); }

    /// The sums of the node that lies `along` the last axis from `first`; zeros if there is none.
    template <int channels>
    void sums_at(Coordinates<d> first, Number along, bool, Number (&found)[std::size_t(channels)]) const
    {
        first[d - 1] += static_cast<int>(along);
        auto const other = all_.find(key_of<d>(first));
        for (std::size_t c = 0; c < channels; ++c)
            found[c] = other == all_.end() ? Number(0) : static_cast<Number>(other->second[c]);
    }

private:
    NodeMap<Sums, d> const& all_;
    typename NodeMap<Sums, d>::const_iterator at_;
    Values const before_;
    Values& values_;
};

} // namespace firn::reference

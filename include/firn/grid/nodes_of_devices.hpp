// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

// Nodes on several ranks whose loops run on devices. There all ranks have the same nodes by the same indices,
// and the values of others' nodes have a place: they need no list of their own.
namespace firn
{

/// The nodes of a grid, with sums that are known of nodes elsewhere, too: by index, in one channel.
template <class Nodes, class Number>
struct NodesWithSums : Nodes
{
    Number* sums;

    FIRN_HOST_DEVICE Number sum(std::uint32_t index, int) const { return sums[index]; }
};

/// What a rank tells of a node: its sum in a channel, and some values.
template <class Number, int d>
struct ToldNode
{
    std::uint32_t index;
    Number sum;
    Vector<Number, d> values;
};

/// Lists what this rank tells of the nodes that points of surfaces reach: of those for which it speaks.
template <class Points, class Nodes, class Shares, class Number, int d>
struct TellNodes
{
    Points of;
    Nodes by_index;
    Shares share_of;
    int channel, first_value;
    ToldNode<Number, d>* told;
    std::uint32_t* count;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i >= *of.reached_nodes || of.reached[i].node == 0) return;
        std::uint32_t const index = of.reached[i].node - 1;
        if (share_of(index) != NodeShare::results) return;
        ToldNode<Number, d>& node = told[next_number_of_all(*count)];
        node.index = index;
        node.sum = by_index.sum(index, channel);
        for (int a = 0; a < d; ++a) node.values[a] = by_index.value(index, first_value + a);
    }
};

/// Takes what all ranks tell.
template <class Nodes, class Number, int d>
struct HearNodes
{
    ToldNode<Number, d> const* told;
    Nodes by_index;
    Number* sums;
    int first_value;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        ToldNode<Number, d> const& node = told[i];
        sums[node.index] = node.sum;
        for (int a = 0; a < d; ++a) by_index.value(node.index, first_value + a) = node.values[a];
    }
};

/// Lets all ranks know the nodes that points of surfaces reach.
template <class Backend, class Number, int d>
class NodesOfDevices
{
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    explicit NodesOfDevices(Backend const& backend) : told_(backend), count_(backend), sums_(backend) {}

    /// The nodes of a grid with what was told last.
    template <class Grid>
    auto nodes(Grid& grid)
    {
        if (sums_.size() < grid.node_count()) sums_.resize(grid.node_count(), 0);
        auto const by_index = grid.nodes_by_index();
        return NodesWithSums<std::remove_const_t<decltype(by_index)>, Number>{by_index, sums_.data()};
    }

    /// Tells of the nodes that these points reach, at most so many: a sum, and values from `first_value` on.
    /// All ranks reach the same nodes.
    template <class Grid, class Points>
    void share(Backend const& backend, Grid& grid, Points const& of, std::size_t most, int channel,
               int first_value)
    {
        auto const by_index = grid.nodes_by_index();
        auto const shares = grid.shares();
        using Nodes = std::remove_const_t<decltype(by_index)>;
        using Shares = std::remove_const_t<decltype(shares)>;
        count_.resize(1);
        count_.fill(0, 1, 0);
        if (told_.size() < most) told_.resize(most + most / 4, 0);
        backend.for_each(most, TellNodes<Points, Nodes, Shares, Number, d>{
                                   of, by_index, shares, channel, first_value, told_.data(), count_.data()});
        std::uint32_t count = 0;
        count_.download(0, {&count, 1});
        std::vector<ToldNode<Number, d>> told(count);
        if (count > 0) told_.download(0, told);
        told = detail::of_all_ranks(backend, std::move(told));
        if (told.empty()) return;
        if (told_.size() < told.size()) told_.resize(told.size() + told.size() / 4, 0);
        told_.upload(0, told);
        backend.for_each(told.size(),
                         HearNodes<Nodes, Number, d>{told_.data(), by_index, sums_.data(), first_value});
    }

private:
    Array<ToldNode<Number, d>> told_;
    Array<std::uint32_t> count_;
    Array<Number> sums_; ///< by index
};

} // namespace firn

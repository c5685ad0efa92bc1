// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/grid/periods.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace firn
{

/// Nodes of other ranks around those of this one, with values that are sent again when they have changed.
template <class Number, int d>
class NodeHalo
{
public:
    explicit NodeHalo(auto const& /*backend*/) {}

    /// The nodes of a grid, and behind them those around, as loops without a phase see them.
    template <class Grid, class OfGrid>
    class Nodes
    {
    public:
        static constexpr std::uint32_t absent = ~std::uint32_t(0);

        Nodes(Grid& grid, OfGrid const& own, NodeHalo& halo)
            : grid_(&grid), own_(own), halo_(&halo), count_(static_cast<std::uint32_t>(grid.node_count()))
        {}

        std::uint32_t find(Coordinates<d> const& node) const
        {
            std::uint32_t const index = own_.find(node);
            if (index != own_.absent && grid_->share_of(index) != NodeShare::none) return index;
            std::uint32_t const number = halo_->list_.find(node);
            return number == ListedNodes<Number, d>::Nodes::absent ? absent : count_ + number;
        }
        std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t) const { return find(node); }
        Number sum(std::uint32_t index, int channel) const
        {
            return index < count_ ? own_.sum(index, channel) : halo_->list_.of_node(index - count_)[0];
        }
        Number& value(std::uint32_t index, int channel) const
        {
            return index < count_ ? own_.value(index, channel)
                                  : halo_->list_.of_node(index - count_)[1 + channel];
        }

    private:
        Grid* grid_;
        OfGrid own_;
        NodeHalo* halo_;
        std::uint32_t count_;
    };
    template <class Grid>
    auto nodes(Grid& grid)
    {
        auto const own = grid.nodes_by_index();
        return Nodes<Grid, std::remove_const_t<decltype(own)>>(grid, own, *this);
    }
    std::size_t size() const { return list_.size(); }

    /// Finds the nodes so far around that have a sum above this in a channel, with room for `values` values.
    template <class Backend, class Grid, class Orders>
    void begin(Backend const& backend, Grid& grid, Orders const& orders, int distance, int channel,
               Number least_sum, int values)
    {
        auto const own = grid.nodes_by_index();
        indices_.assign(static_cast<std::size_t>(backend.ranks()), {});
        std::vector<std::vector<std::byte>> to(indices_.size());
        grid.for_each_near(orders, distance, [&](std::size_t rank, std::uint32_t first, std::uint32_t count) {
            for (std::uint32_t index = first; index < first + count; ++index)
                if (Found const found{own.node(index), own.sum(index, channel)}; found.sum > least_sum) {
                    indices_[rank].push_back(index);
                    append(to[rank], found);
                }
        });
        std::vector<Coordinates<d>> nodes;
        std::vector<Number> sums;
        numbers_.clear();
        for (auto const& from : backend.exchange(to))
            for (std::size_t i = 0; i < from.size() / sizeof(Found); ++i) {
                auto const found = nth<Found>(from, i);
                std::uint32_t const index = own.find(found.node);
                bool const is_here = index != own.absent && grid.share_of(index) != NodeShare::none;
                numbers_.push_back(is_here ? own.absent : static_cast<std::uint32_t>(nodes.size()));
                if (is_here) continue;
                nodes.push_back(found.node);
                sums.push_back(found.sum);
            }
        list_.set(std::move(nodes), values, {});
        for (std::size_t i = 0; i < sums.size(); ++i) list_.of_node(i)[0] = sums[i];
    }

    /// Lets the values of these channels come again.
    template <class Backend, class Grid>
    void update(Backend const& backend, Grid& grid, std::span<int const> channels)
    {
        auto const own = grid.nodes_by_index();
        std::vector<std::vector<std::byte>> to(indices_.size());
        for (std::size_t rank = 0; rank < to.size(); ++rank)
            for (std::uint32_t const index : indices_[rank])
                for (int const channel : channels) append(to[rank], Number(own.value(index, channel)));
        std::size_t next = 0;
        for (auto const& from : backend.exchange(to))
            for (std::size_t i = 0; i < from.size() / sizeof(Number); i += channels.size(), ++next)
                if (numbers_[next] != own.absent)
                    for (std::size_t c = 0; c < channels.size(); ++c)
                        list_.of_node(numbers_[next])[1 + channels[c]] = nth<Number>(from, i + c);
    }

private:
    struct Found
    {
        Coordinates<d> node = Coordinates<d>::Zero();
        Number sum = 0;
    };
    template <class T>
    static void append(std::vector<std::byte>& to, T const& value)
    {
        std::size_t const before = to.size();
        to.resize(before + sizeof value);
        std::memcpy(to.data() + before, static_cast<void const*>(&value), sizeof value);
    }
    template <class T>
    static T nth(std::vector<std::byte> const& from, std::size_t i)
    {
        T value;
        std::memcpy(static_cast<void*>(&value), from.data() + i * sizeof value, sizeof value);
        return value;
    }

    ListedNodes<Number, d> list_;
    std::vector<std::vector<std::uint32_t>> indices_; ///< by rank: of the nodes that it needs
    std::vector<std::uint32_t> numbers_; ///< of what comes: in the list, or absent if the node is here, too
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn
{

/// Which part of a node a rank has: of several ranks that update one, its results are the first one's.
enum class NodeShare : unsigned char
{
    none,   ///< it is not updated here
    values, ///< it is updated, with the same bits as elsewhere
    results ///< and this rank speaks for it
};

/// A list of single nodes, wherever they lie, by their numbers in it. Loops without a phase see it as they
/// see the nodes of a grid (see Grid::nodes_by_index() in firn/backend.hpp), so that several ranks may work
/// on nodes that none of them has in its grid alone. It lies in the memory of the host.
template <class Number, int d>
class ListedNodes
{
public:
    /// As loops see it: of each node a sum and some values, which follow one another. The values begin with a
    /// channel of the grid's.
    class Nodes
    {
    public:
        static constexpr std::uint32_t absent = ~std::uint32_t(0);

        Nodes(ListedNodes& list, int first_value) : list_(&list), first_value_(first_value) {}

        std::uint32_t find(Coordinates<d> const& node) const { return list_->find(node); }
        std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t) const { return find(node); }
        Number sum(std::uint32_t number, int) const { return list_->of_node(number)[0]; }
        Number& value(std::uint32_t number, int channel) const
        {
            return list_->of_node(number)[1 + channel - first_value_];
        }

    private:
        ListedNodes* list_;
        int first_value_;
    };

    /// Makes the list anew, of nodes that differ from one another, with so many values each.
    void set(std::vector<Coordinates<d>> nodes, int values, Periods<d> const& periods)
    {
        nodes_ = std::move(nodes);
        values_ = values;
        periods_ = periods;
        of_nodes_.assign(nodes_.size() * std::size_t(1 + values_), Number(0));
        table_.assign(std::bit_ceil(2 * nodes_.size() + 1), 0);
        for (std::size_t i = 0; i < nodes_.size(); ++i) {
            nodes_[i] = periods_.wrapped(nodes_[i]);
            std::size_t at = place_of(nodes_[i]);
            while (table_[at] != 0) at = next(at);
            table_[at] = static_cast<std::uint32_t>(i + 1);
        }
        ++numbering_;
    }

    std::size_t size() const { return nodes_.size(); }
    Coordinates<d> const& operator[](std::size_t number) const { return nodes_[number]; }
    /// The sum of a node, and behind it its values.
    Number* of_node(std::size_t number) { return of_nodes_.data() + number * std::size_t(1 + values_); }
    /// Those of all nodes.
    std::vector<Number>& of_nodes() { return of_nodes_; }
    Nodes nodes(int first_value) { return {*this, first_value}; }
    /// Changes whenever the numbers of nodes do.
    std::uint64_t numbering() const { return numbering_; }

    /// The number of a node, or Nodes::absent.
    std::uint32_t find(Coordinates<d> const& node) const
    {
        Coordinates<d> const wrapped = periods_.wrapped(node);
        for (std::size_t at = place_of(wrapped); table_[at] != 0; at = next(at))
            if (nodes_[table_[at] - 1] == wrapped) return table_[at] - 1;
        return Nodes::absent;
    }

private:
    std::size_t place_of(Coordinates<d> const& node) const
    {
        return static_cast<std::size_t>((block_key<d>(node) * 0x9e3779b97f4a7c15u) >> 24) &
               (table_.size() - 1);
    }
    std::size_t next(std::size_t at) const { return (at + 1) & (table_.size() - 1); }

    std::vector<Coordinates<d>> nodes_;
    std::vector<std::uint32_t> table_{0}; ///< numbers from 1 on; 0: nothing is there
    std::vector<Number> of_nodes_;
    int values_ = 0;
    Periods<d> periods_{};
    std::uint64_t numbering_ = 0;
};

/// A list of nodes that several ranks work on, and those of them that this rank has in its grid.
template <class Number, int d>
struct NodesOfRanks
{
    ListedNodes<Number, d> list;
    std::vector<std::uint32_t> own;  ///< indices in the grid of those that this rank speaks for
    std::vector<std::uint32_t> here; ///< by number in the list: the index in the grid, or Nodes::absent
    std::uint64_t numbering = 0;     ///< of the grid, for which these hold

    template <class Backend>
    explicit NodesOfRanks(Backend const&)
    {}

    /// Makes the list anew.
    template <class Grid>
    void set(std::vector<Coordinates<d>> nodes, int values, Lattice const& lattice, Grid& grid)
    {
        list.set(std::move(nodes), values, periods_of<d>(lattice));
        auto const by_index = grid.nodes_by_index();
        here.resize(list.size());
        for (std::size_t i = 0; i < list.size(); ++i) {
            here[i] = by_index.find(list[i]);
            if (here[i] != by_index.absent && grid.share_of(here[i]) == NodeShare::none)
                here[i] = by_index.absent;
        }
        numbering = grid.numbering();
    }

    /// Writes the values of the list to the grid, at nodes with a sum above this.
    template <class Backend, class Grid>
    void return_values(Backend const& backend, Grid& grid, int first_value, int values, Number least_sum)
    {
        auto const by_index = grid.nodes_by_index();
        backend.for_each(list.size(), [&](std::size_t i) {
            Number const* const of_node = list.of_node(i);
            if (here[i] == by_index.absent || !(of_node[0] > least_sum)) return;
            for (int c = 0; c < values; ++c) by_index.value(here[i], first_value + c) = of_node[1 + c];
        });
    }
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/grid.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/partition.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/reference/cell_order.hpp>
#include <firn/reference/grid.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <set>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

// The reference backend on several ranks: each has some cells, and all have all nodes. It is there to be read
// and compared with, as the reference backend is; the sums of nodes are added rank by rank, in double
// precision.
namespace firn::distributed
{

template <class C, class Number, int d>
class CellOrder<reference::CellOrder<Number, d>, C, Number, d> : public reference::CellOrder<Number, d>
{
    using Local = reference::CellOrder<Number, d>;
    using typename Local::Entry;

public:
    using typename Local::Offset;

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend.local, periods), communicator_(backend.communicator), partition_(backend.partition),
          curve_(partition_->lattice(), Local::extent)
    {}

    C const& communicator() const { return communicator_; }
    std::uint64_t block_of(Coordinates<d> const& cell) const
    {
        return block_key<d>(this->periods_.wrapped(cell));
    }
    std::vector<std::uint32_t> own(std::span<Coordinates<d> const> cells)
    {
        return partition_->own(communicator_, cells.size(),
                               [&](std::size_t i) { return on_curve(cells[i]); });
    }

    /// What leaves for another rank: where the items lie, and their new cells.
    struct Departure
    {
        std::vector<std::uint32_t> places{};
        Parcel notes{};
    };
    std::vector<Departure> depart(std::array<Offset*, std::size_t(d)> const& offset)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        for (std::uint32_t slot = 0; slot < this->entries_.size(); ++slot) {
            Entry& entry = this->entries_[slot];
            entry.place = slot;
            Coordinates<d> cell = entry.cell;
            for (int a = 0; a < d; ++a) {
                Offset wrapped = offset[std::size_t(a)][slot];
                cell[a] += CellOffset<Number>::wrap(wrapped);
            }
            int const owner = partition_->owner(on_curve(cell));
            if (owner == communicator_.rank()) continue;
            auto& to = by_rank[static_cast<std::size_t>(owner)];
            put(to.notes, entry.cell);
            to.places.push_back(slot);
            entry.place = gone;
        }
        return by_rank;
    }

    template <class Move>
    void arrive(std::span<Parcel const> notes, std::uint32_t first,
                std::array<Offset*, std::size_t(d)> const& offset, Move const& move)
    {
        sort_in(notes, first, move);
        for (Entry& entry : this->entries_) {
            for (int a = 0; a < d; ++a)
                entry.cell[a] += CellOffset<Number>::wrap(offset[std::size_t(a)][entry.place]);
            entry.cell = this->periods_.wrapped(entry.cell);
        }
        this->committed_ = false;
        this->sort();
    }

    void weigh(std::vector<Partition::Weight>& to) const
    {
        for (auto const& entry : this->entries_) to.push_back({on_curve(entry.cell), 1});
    }
    /// Nodes are the same on all ranks, so that sums need not be handed over.
    template <class Layer>
    std::vector<Departure> hand_over(Layer const&)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        for (Entry& entry : this->entries_) {
            int const owner = partition_->owner(on_curve(entry.cell));
            if (owner == communicator_.rank()) continue;
            auto& to = by_rank[static_cast<std::size_t>(owner)];
            put(to.notes, entry.cell);
            to.places.push_back(entry.place);
            entry.place = gone;
        }
        return by_rank;
    }
    template <class Layer, class Move>
    void take_over(std::span<Parcel const> notes, std::uint32_t first, Layer const&, Move const& move)
    {
        sort_in(notes, first, move);
        this->sort();
    }
    template <class Layer>
    void take_tiles(Layer const&) const
    {}

    template <class Result>
    Result merge_whole(Result const& own) const
    {
        if constexpr (std::is_same_v<Result, NothingFound>)
            return own;
        else
            return merge_over_ranks<Result>(communicator_,
                                            {{0, static_cast<std::uint64_t>(communicator_.rank()), own}});
    }

private:
    static constexpr std::uint32_t gone = ~std::uint32_t(0);

    /// Adds the items that came, and lets the last ones fill the places of those that are gone.
    template <class Move>
    void sort_in(std::span<Parcel const> notes, std::uint32_t first, Move const& move)
    {
        std::uint32_t all = first;
        for (Parcel const& parcel : notes)
            for (Reader from(parcel); !from.at_end(); ++all)
                this->entries_.push_back({from.template get<Coordinates<d>>(), all});
        std::vector<char> is_hole(all, 1);
        std::erase_if(this->entries_, [](Entry const& entry) { return entry.place == gone; });
        for (Entry const& entry : this->entries_) is_hole[entry.place] = 0;
        std::vector<std::uint32_t> from, to;
        std::uint32_t hole = 0;
        for (Entry& entry : this->entries_) {
            if (entry.place < this->entries_.size()) continue;
            while (!is_hole[hole]) ++hole;
            from.push_back(entry.place);
            to.push_back(entry.place = hole++);
        }
        move(std::as_const(from), std::as_const(to));
    }

    std::uint64_t on_curve(Coordinates<d> const& cell) const
    {
        return curve_.place(this->periods_.wrapped(cell));
    }

    C communicator_;
    std::shared_ptr<Partition> partition_;
    Curve<d> curve_;
};

template <class Number, int d, int degree, int sums, int values, int layers, bool own_values, class Order>
class Grid<reference::Grid<Number, d, degree, sums, values, layers, own_values>, Order, d, sums>
    : public reference::Grid<Number, d, degree, sums, values, layers, own_values>
{
    using Local = reference::Grid<Number, d, degree, sums, values, layers, own_values>;
    using Sums = typename Local::Sums;

public:
    template <class Backend>
    explicit Grid(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend.local, periods), is_first_(backend.rank() == 0)
    {}

    struct Layer : Local::Layer
    {
        bool* are_old;
        void change_sums() const { *are_old = true; }
    };
    Layer layer(std::size_t of) { return {Local::layer(of), &are_old_}; }

    /// The same, with the sums of all ranks.
    class NodesOfAll : public Local::Nodes
    {
    public:
        explicit NodesOfAll(Grid& grid) : Local::Nodes(grid), grid_(&grid) {}
        Number sum(std::uint32_t index, int channel) const { return grid_->sum(this->node(index), channel); }

    private:
        Grid const* grid_;
    };
    NodesOfAll nodes_by_index() { return NodesOfAll(*this); }
    NodeShare share_of(std::uint32_t) const { return is_first_ ? NodeShare::results : NodeShare::values; }
    template <class Orders, class Use>
    void for_each_near(Orders const&, int, Use const&) const
    {}
    template <class Orders>
    static int rank_of(Orders const&, Coordinates<d> const&)
    {
        return 0;
    }
    /// Every rank has all nodes: nothing is told.
    template <class Orders, class T, class NodeOf>
    std::vector<T> exchange_near(Orders const&, std::vector<T> const&, int, NodeOf const&) const
    {
        return {};
    }

    template <class Orders>
    void activate(Orders const& orders)
    {
        Local::activate(orders);
        are_old_ = true;
    }
    void swap()
    {
        Local::swap();
        are_old_ = true;
    }

    /// Adds up what all ranks added to each node.
    template <class Orders>
    void exchange(Orders const& orders, int /*reach*/)
    {
        if (!std::exchange(are_old_, false)) return;
        for (std::size_t l = 0; l < all_.size(); ++l) {
            Parcel own;
            for (auto const& [node, sum] : this->now_[l]) {
                put(own, node);
                put(own, sum);
            }
            all_[l].clear();
            for (Parcel const& parcel : orders[0]->communicator().all_gather(own))
                for (Reader from(parcel); !from.at_end();) {
                    auto const node = from.template get<Coordinates<d>>();
                    auto const part = from.template get<Sums>();
                    Sums& sum = all_[l][node];
                    for (std::size_t c = 0; c < sum.size(); ++c) sum[c] += part[c];
                }
        }
    }

    /// Every rank updates all nodes; the first one has their results, so that what they add up counts once.
    void show(Nodes which) { shows_none_ = which != Nodes::all && (which == Nodes::own) != is_first_; }
    std::set<Coordinates<d>, reference::FirstAxisFirst> nodes() const
    {
        std::set<Coordinates<d>, reference::FirstAxisFirst> all;
        if (shows_none_) return all;
        for (auto const& of_layer : all_)
            for (auto const& [node, of_node] : of_layer) all.insert(node);
        return all;
    }
    bool has(std::size_t layer, Coordinates<d> const& node) const { return all_[layer].contains(node); }
    double sum_of(std::size_t layer, Coordinates<d> const& node, int channel) const
    {
        auto const found = all_[layer].find(this->periods_.wrapped(node));
        return found == all_[layer].end() ? 0.0 : found->second[std::size_t(channel)];
    }
    Number sum(Coordinates<d> const& node, int channel) const
    {
        double sum = 0;
        for (std::size_t layer = 0; layer < all_.size(); ++layer) sum += sum_of(layer, node, channel);
        return static_cast<Number>(sum);
    }

private:
    std::array<typename Local::template NodeMap<Sums>, std::size_t(layers)> all_; ///< of all ranks, by layer
    bool are_old_ = true, shows_none_ = false, is_first_;
};

} // namespace firn::distributed

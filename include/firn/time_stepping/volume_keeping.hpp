// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/particles/storage.hpp>
#include <firn/phases/keep_volume.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// When volumes are corrected in a call, and the memory for it. What a call does depends on the state before
/// it alone, and on no batch of steps.
template <class Backend, class Space, std::size_t materials>
class VolumeKeeping
{
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    template <class T>
    using Array = typename Backend::template Array<T>;
    using Shifts = DerivedStorage<Backend, Space, Fields<VolumeShift>>;

public:
    explicit VolumeKeeping(Backend const& backend)
        : backend_(backend), nodes_(backend), numbers_(backend), count_(backend), of_ranks_(backend)
    {
        count_.resize(1);
        nodes_.resize(256);
    }

    void begin_call() { left_ = unknown; }
    /// How many of `most` steps may follow in a batch, the first of which is this long [s]; volumes are
    /// corrected in the step with which an `interval` [s] of time begins.
    int steps_at_once(int most, double time, double dt, double interval)
    {
        if (left_ == unknown) {
            double const rest = (std::floor(time / interval) + 1) * interval - time;
            left_ = interval > 0 ? static_cast<int>(std::min(rest / dt, 1e6)) : 0;
        }
        return left_ == 0 ? 1 : std::min(most, left_);
    }
    bool is_due() const { return left_ == 0; }
    /// After a batch of which so many steps were taken.
    void end(int taken)
    {
        if (taken > 0) left_ = left_ == 0 ? unknown : left_ - taken;
    }

    /// The shifts of a material's particles, of which there are `count`.
    typename Shifts::View shifts(std::size_t material, std::size_t count)
    {
        auto& own = shifts_[material];
        if (!own || size_[material] != count) own.emplace(backend_, size_[material] = count);
        return own->view();
    }

    /// Finds what nodes have too much or too little of, and gives the grid the potential. `find(nodes)` is to
    /// list the nodes that have volume; `orders` are those of the grid's cells.
    template <class Grid, class Orders, class Find>
    void solve(Grid& grid, Orders const& orders, Lattice const& lattice, int sweeps, Find const& find)
    {
        for (;;) {
            count_.fill(0, 1, 0);
            find(view());
            if (count() <= nodes_.size()) break;
            nodes_.resize(count() + count() / 4, 0);
        }
        if constexpr (spans_devices<Backend>) {
            share_nodes_of_devices(grid, orders, sweeps);
            find_potential(grid.nodes_by_index(), grid.node_count(), sweeps);
        }
        else if constexpr (spans_ranks<Backend>) {
            share_nodes(grid, orders, lattice, sweeps);
            find_potential(of_ranks_.list.nodes(0), of_ranks_.list.size(), sweeps);
            of_ranks_.return_values(backend_, grid, 0, 1, Number(-1));
        }
        else
            find_potential(grid.nodes_by_index(), grid.node_count(), sweeps);
    }

private:
    static constexpr int unknown = -1;

    /// Finds the potential of the listed nodes. `by_index` are all nodes, of which there are `indices`.
    template <class Nodes>
    void find_potential(Nodes const& by_index, std::size_t indices, int sweeps)
    {
        std::size_t const nodes = count();
        if (nodes == 0) return;
        if (numbers_.size() < indices) numbers_.resize(indices, 0);
        numbers_.fill(0, indices, NodeOfVolume<Number, d>::none);
        backend_.for_each(nodes, NumberVolumes<Number, d, Nodes>{view(), by_index});
        backend_.for_each(nodes, FindSources<Number, d, Nodes>{view(), by_index});
        // of the operator phi_i - mean(phi_j): what varies more slowly than its least eigenvalue here is left
        // to later corrections
        double const least = 0.05, middle = (2 + least) / 2, half = (2 - least) / 2, sigma = middle / half;
        double rho = 1 / sigma, of_change = 0, of_residual = 1 / middle;
        for (int sweep = 0; sweep < sweeps; ++sweep) {
            backend_.for_each(nodes, SweepPotential<Number, d>{nodes_.data(), sweep % 2,
                                                               static_cast<Number>(of_change),
                                                               static_cast<Number>(of_residual)});
            double const next = 1 / (2 * sigma - rho);
            of_change = next * rho, of_residual = 2 * next / half, rho = next;
        }
        backend_.for_each(nodes, ReturnPotential<Number, d, Nodes>{nodes_.data(), by_index, sweeps % 2});
    }

    /// On several ranks: lists the nodes of others, too, as far as they matter to the potential of nodes
    /// here. A sweep looks one node further, and so does what a source is.
    template <class Grid, class Orders>
    void share_nodes(Grid& grid, Orders const& orders, Lattice const& lattice, int sweeps)
    {
        using Node = NodeOfVolume<Number, d>;
        auto const by_index = grid.nodes_by_index();
        auto const share_of = [&](Node const& node) {
            auto const index = by_index.find(node.node);
            return index == by_index.absent ? NodeShare::none : grid.share_of(index);
        };
        auto const nodes = with_nodes_nearby(grid, orders, sweeps, share_of);
        std::vector<Coordinates<d>> places;
        places.reserve(nodes.size());
        for (Node const& node : nodes) places.push_back(node.node);
        of_ranks_.set(std::move(places), 1, lattice, grid);
    }
    /// The same on devices, where nodes have the same indices on all ranks.
    template <class Grid, class Orders>
    void share_nodes_of_devices(Grid& grid, Orders const& orders, int sweeps)
    {
        auto const by_index = grid.nodes_by_index();
        if (numbers_.size() < grid.node_count()) numbers_.resize(grid.node_count(), 0);
        backend_.for_each(
            count(), NumberVolumes<Number, d, std::remove_const_t<decltype(by_index)>>{view(), by_index});
        with_nodes_nearby(grid, orders, sweeps,
                          [shares = grid.shares_on_host()](auto const& node) { return shares(node.index); });
    }
    /// Lists nodes of other ranks behind those here, of which `share_of(node)` is what this rank has. Returns
    /// all of them.
    template <class Grid, class Orders, class ShareOf>
    std::vector<NodeOfVolume<Number, d>> with_nodes_nearby(Grid& grid, Orders const& orders, int sweeps,
                                                           ShareOf const& share_of)
    {
        using Node = NodeOfVolume<Number, d>;
        std::vector<Node> nodes(count(), Node{}), own;
        nodes_.download(0, nodes);
        for (Node const& node : nodes)
            if (share_of(node) == NodeShare::results) own.push_back(node);
        for (Node const& node :
             grid.exchange_near(orders, own, sweeps, [](Node const& of) { return of.node; }))
            if (share_of(node) == NodeShare::none) nodes.push_back(node);
        if (nodes.size() > nodes_.size()) nodes_.resize(nodes.size() + nodes.size() / 4, 0);
        nodes_.upload(0, nodes);
        count_.fill(0, 1, static_cast<std::uint32_t>(nodes.size()));
        return nodes;
    }

    NodesOfVolume<Number, d> view()
    {
        return {nodes_.data(), count_.data(), static_cast<std::uint32_t>(nodes_.size()), numbers_.data()};
    }
    std::uint32_t count() const
    {
        std::uint32_t count = 0;
        count_.download(0, {&count, 1});
        return count;
    }

    Backend backend_;
    int left_ = unknown; ///< steps before the next correction
    Array<NodeOfVolume<Number, d>> nodes_;
    Array<std::uint32_t> numbers_, count_;
    NodesOfRanks<Number, d> of_ranks_; ///< the same nodes, if there are several
    std::array<std::optional<Shifts>, materials> shifts_;
    std::array<std::size_t, materials> size_{};
};

/// The time [s] between two corrections, for the material of these that asks for the shortest, in cells of
/// this size [m].
template <class Sets>
double volume_interval(Sets const& sets, double cell_size)
{
    double least = std::numeric_limits<double>::infinity();
    Sets::for_each([&](auto k) {
        if constexpr (KeepsItsVolume<typename Sets::template MaterialTraits<k>::Model>) {
            double const modulus = sets.template response_at_rest<k>().wave_modulus;
            least = std::min(least, double(sets.template model<k>().interval) * cell_size /
                                        sets.template wave_speed<k>(modulus));
        }
    });
    return least;
}

/// The most sweeps that one of these materials asks for.
template <class Sets>
int most_sweeps(Sets const& sets)
{
    int most = 0;
    Sets::for_each([&](auto k) {
        if constexpr (KeepsItsVolume<typename Sets::template MaterialTraits<k>::Model>)
            most = std::max(most, sets.template model<k>().sweeps);
    });
    return most;
}

/// Where no material keeps its volume.
struct NoVolumeKeeping
{
    explicit NoVolumeKeeping(auto const&) {}
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/exchange_on_cuda.hpp>
#include <firn/distributed/node_halo.hpp>
#include <firn/distributed/nodes_on_cuda.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

// Nodes of other devices around those of this one. All ranks have the same nodes by the same indices, so that
// they lie in the grid, and are sent by whole blocks.
namespace firn::distributed
{

namespace detail
{
/// The nodes of a grid that are known here: those of this rank, and those around.
template <class Nodes, class Number, int d, int cells>
struct KnownNodes : Nodes
{
    unsigned char const* known; ///< of each block
    Number* sums;               ///< of a channel, by index

    __device__ std::uint32_t find(Coordinates<d> const& node) const
    {
        std::uint32_t const index = Nodes::find(node);
        return index == Nodes::absent || known[index / cells] == 0 ? Nodes::absent : index;
    }
    __device__ std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t) const { return find(node); }
    __device__ Number sum(std::uint32_t index, int) const { return sums[index]; }
};

/// Sums up nodes that this rank has.
template <class Nodes, class Shares, class Number>
struct SumOwnNodes
{
    Nodes nodes;
    Shares share_of;
    int channel;
    Number* sums;

    __device__ void operator()(std::size_t i) const
    {
        auto const index = static_cast<std::uint32_t>(i);
        sums[i] = share_of(index) != NodeShare::none ? nodes.sum(index, channel) : Number(0);
    }
};

/// Copies some values of all nodes of some blocks, or the sums of `Nodes`: from the grid, or to it.
template <class Nodes, class Number, int cells>
struct CopyNodes
{
    static constexpr int most = 8;

    Nodes nodes;
    std::uint32_t const* blocks;
    Number* packed;
    bool packs;
    int count; ///< of channels; 0: their sum
    std::array<int, most> channels;

    __device__ void operator()(std::size_t i) const
    {
        std::uint32_t const index = blocks[i / cells] * std::uint32_t{cells} + std::uint32_t(i % cells);
        if (count == 0) copy(nodes.sums[index], packed[i]);
        for (int c = 0; c < count; ++c)
            copy(nodes.value(index, channels[std::size_t(c)]),
                 packed[i * std::size_t(count) + std::size_t(c)]);
    }

private:
    __device__ void copy(Number& of_node, Number& of_message) const
    {
        if (packs)
            of_message = of_node;
        else
            of_node = of_message;
    }
};
} // namespace detail

template <class Number, int d>
class NodeHalo<Cuda, Number, d>
{
    static constexpr int cells = cuda::BlockShape<d>::cells;

public:
    template <class Backend>
    explicit NodeHalo(Backend const& backend)
        : queue_(backend.queue()), out_(queue_), in_(queue_), known_(queue_), sums_(queue_), exchange_(queue_)
    {}

    /// See firn::NodeHalo.
    template <class Grid>
    auto nodes(Grid& grid)
    {
        auto const all = grid.nodes_by_index();
        return detail::KnownNodes<std::remove_const_t<decltype(all)>, Number, d, cells>{all, known_.data(),
                                                                                        sums_.data()};
    }
    static constexpr std::size_t size() { return 0; } ///< those around have indices of the grid
    template <class Backend, class Grid, class Orders>
    void begin(Backend const& backend, Grid& grid, Orders const& orders, int distance, int channel,
               Number /*least_sum*/, int /*values*/)
    {
        std::vector<std::vector<std::uint32_t>> to(static_cast<std::size_t>(backend.ranks())), from;
        grid.for_each_near(orders, distance,
                           [&](std::size_t rank, std::uint32_t block) { to[rank].push_back(block); });
        std::vector<Parcel> parcels(to.size());
        for (std::size_t rank = 0; rank < to.size(); ++rank)
            put(parcels[rank], to[rank].data(), to[rank].size());
        for (Parcel const& parcel : backend.exchange(parcels)) {
            auto& blocks = from.emplace_back(parcel.size() / sizeof(std::uint32_t));
            Reader(parcel).get(blocks.data(), blocks.size());
        }
        out_.set(to);
        in_.set(from);
        std::vector<unsigned char> known = grid.shares_on_host().kind;
        for (auto const& of_rank : from)
            for (auto const block : of_rank) known[block] = 1;
        known_.renew(known.size());
        known_.upload(0, known);
        sums_.renew(grid.node_count());
        auto const all = grid.nodes_by_index();
        auto const shares = grid.shares();
        backend.for_each(
            grid.node_count(),
            detail::SumOwnNodes<std::remove_const_t<decltype(all)>, std::remove_const_t<decltype(shares)>,
                                Number>{all, shares, channel, sums_.data()});
        update(backend, grid, {});
    }
    template <class Backend, class Grid>
    void update(Backend const& backend, Grid& grid, std::span<int const> channels)
    {
        auto const nodes = this->nodes(grid);
        using Copy = detail::CopyNodes<std::remove_const_t<decltype(nodes)>, Number, cells>;
        assert(channels.size() <= std::size_t(Copy::most));
        std::size_t const numbers = std::max<std::size_t>(channels.size(), 1) * cells;
        std::vector<DeviceMessage> to, from;
        out_.add_messages(to, numbers);
        in_.add_messages(from, numbers);
        auto const copy = [&](Side& side, bool packs) {
            Copy copy{nodes, side.blocks.data(), side.packed.data(), packs, static_cast<int>(channels.size()),
                      {}};
            std::ranges::copy(channels, copy.channels.begin());
            backend.for_each(side.begin.back() * cells, copy);
        };
        copy(out_, true);
        exchange_(backend.communicator, to, from);
        copy(in_, false);
    }

private:
    /// The blocks that go to each rank, or come from it, rank by rank.
    struct Side
    {
        cuda::Array<std::uint32_t> blocks;
        cuda::Array<Number> packed;
        std::vector<std::size_t> begin{0}; ///< by rank

        explicit Side(cuda::Queue const& queue) : blocks(queue), packed(queue) {}
        void set(std::vector<std::vector<std::uint32_t>> const& of_ranks)
        {
            std::vector<std::uint32_t> all;
            begin.assign(1, 0);
            for (auto const& of_rank : of_ranks) {
                all.insert(all.end(), of_rank.begin(), of_rank.end());
                begin.push_back(all.size());
            }
            blocks.renew(all.size());
            blocks.upload(0, all);
        }
        void add_messages(std::vector<DeviceMessage>& to, std::size_t numbers_of_block)
        {
            packed.renew(begin.back() * numbers_of_block);
            for (std::size_t r = 0; r + 1 < begin.size(); ++r)
                if (begin[r] < begin[r + 1])
                    to.push_back({static_cast<int>(r),
                                  reinterpret_cast<std::byte*>(packed.data() + begin[r] * numbers_of_block),
                                  (begin[r + 1] - begin[r]) * numbers_of_block * sizeof(Number)});
        }
    };

    cuda::Queue queue_;
    Side out_, in_;
    cuda::Array<unsigned char> known_;
    cuda::Array<Number> sums_;
    DeviceExchange exchange_;
};

} // namespace firn::distributed

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/parts_of_tiles.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/distributed/parts_on_cuda.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firn::distributed
{

/// Which nodes of a grid a rank's device updates, and which parts of tiles it swaps with others for it.
template <class LocalGrid, class Order, int d, int layers>
class Borders
{
    static constexpr std::size_t count_of_layers = std::size_t(layers);
    using Parts = SwappedParts<d>;

public:
    /// The blocks of cells above each block of nodes, and which rank has each.
    using Above = cuda::detail::BlocksAbove<layers>;

    explicit Borders(cuda::Queue const& queue)
        : queue_(queue), lists_{cuda::Array<std::uint32_t>(queue), cuda::Array<std::uint32_t>(queue),
                                cuda::Array<std::uint32_t>(queue)},
          kinds_(queue), borders_(queue), of_groups_(queue), counts_(queue), counts_of_parts_(queue),
          told_(queue)
    {
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            sent_.emplace_back(queue);
            came_.emplace_back(queue);
        }
    }

    /// Finds them, where nodes look at those up to `looks` blocks away.
    void find(std::array<Order*, count_of_layers> const& orders, Above const& above, std::uint32_t blocks,
              int looks)
    {
        auto const& communicator = orders[0]->communicator();
        auto const rank = static_cast<std::uint32_t>(communicator.rank());
        auto const ranks = static_cast<std::size_t>(communicator.size());
        kinds_.renew(blocks);
        listed_ = {};
        for (auto* const all : {&sent_, &came_})
            for (Parts& parts : *all) parts.had_room(0, std::vector<std::size_t>(ranks + 1, 0));
        if (blocks == 0) return;
        unsigned const groups = cuda::groups_of(blocks, cuda::detail::bordering_threads);
        borders_.renew(blocks);
        for (auto& list : lists_) list.renew(blocks);
        of_groups_.renew_amply(groups);
        counts_.renew(listed_.size());
        counts_.fill_bytes(0, listed_.size(), 0);
        cuda::launch_after(
            "find_borders", queue_, cuda::detail::find_borders<layers, LocalGrid::corners>, groups,
            cuda::detail::bordering_threads, above, blocks, rank, kinds_.data(),
            cuda::detail::ListsOfNodes{counts_.data(), lists_[0].data(), lists_[1].data(), lists_[2].data()},
            of_groups_.data());
        if (looks <= 1) {
            cuda::launch_after("list_borders", queue_, cuda::detail::list_borders, groups,
                               cuda::detail::bordering_threads, kinds_.data(), blocks, of_groups_.data(),
                               borders_.data(), counts_.data() + listed_.size() - 1);
            list_parts(above, rank, ranks);
            return;
        }
        tell_lists(nullptr, 0);
        PartsOfRanks<d> sent, came;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            sent.assign(ranks, {});
            came.assign(ranks, {});
            list_whole(*orders[l], looks, sent, came);
            sent_[l].set(sent);
            came_[l].set(came);
        }
    }

    /// What each block of nodes is to this rank: see kind_of_nodes.
    cuda::Array<unsigned char> const& kinds() const { return kinds_; }
    /// Blocks of nodes: those inside, those at borders, and those of other ranks (see ListsOfNodes).
    std::uint32_t const* list(std::size_t which) const { return lists_[which].data(); }
    std::uint32_t listed(std::size_t which) const { return listed_[which]; } ///< how many are in a list
    /// By layer.
    Parts const& sent(std::size_t layer) const { return sent_[layer]; }
    Parts const& came(std::size_t layer) const { return came_[layer]; }

    std::size_t memory() const
    {
        std::size_t bytes = kinds_.memory() + borders_.memory() + of_groups_.memory() + counts_.memory() +
                            counts_of_parts_.memory();
        for (auto const& list : lists_) bytes += list.memory();
        for (auto const* const all : {&sent_, &came_})
            for (Parts const& parts : *all) bytes += parts.there.memory();
        return bytes;
    }

private:
    /// Waits until the host knows how many blocks of nodes each list has, and some other counts.
    cuda::detail::CountsOfParts const* tell_lists(cuda::detail::CountsOfParts const* counts,
                                                  std::size_t number)
    {
        using Counts = cuda::detail::CountsOfParts;
        static_assert(sizeof(Counts) == sizeof listed_);
        auto* const told = told_.template as<Counts>(1 + number);
        cuda::copy_queued(queue_, reinterpret_cast<std::uint32_t*>(told),
                          static_cast<std::uint32_t const*>(counts_.data()), listed_.size());
        cuda::copy_queued(queue_, told + 1, counts, number);
        queue_.wait();
        std::copy_n(reinterpret_cast<std::uint32_t const*>(told), listed_.size(), listed_.begin());
        return told + 1;
    }
    /// Lists the parts of tiles that ranks swap for the blocks of nodes at borders.
    void list_parts(Above const& above, std::uint32_t rank, std::size_t ranks)
    {
        constexpr std::size_t chunks = cuda::detail::chunks_of_borders;
        counts_of_parts_.renew_amply(count_of_layers * ranks * chunks);
        auto const list = [&](bool counts_only) {
            cuda::detail::ListsOfParts<d, layers> lists{};
            lists.counts = counts_of_parts_.data();
            lists.counts_only = counts_only;
            for (std::size_t l = 0; l < count_of_layers; ++l) {
                lists.sent[l] = sent_[l].there.data();
                lists.came[l] = came_[l].there.data();
                lists.room_sent[l] = static_cast<std::uint32_t>(sent_[l].there.size());
                lists.room_came[l] = static_cast<std::uint32_t>(came_[l].there.size());
            }
            cuda::launch_after(
                "list_parts", queue_,
                cuda::detail::list_parts<d, layers, LocalGrid::corners, LocalGrid::Shape::extent,
                                         LocalGrid::TileShape::width>,
                static_cast<unsigned>(count_of_layers * ranks * chunks), cuda::detail::bordering_threads,
                above, borders_.data(), counts_.data() + listed_.size() - 1, rank,
                static_cast<std::uint32_t>(ranks), lists);
        };
        list(true);
        list(false); // mostly there is room
        auto const* const counts = tell_lists(counts_of_parts_.data(), count_of_layers * ranks * chunks);
        bool had_room = true;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            std::size_t sent = 0, came = 0;
            std::vector<std::size_t> sent_begin{0}, came_begin{0};
            for (std::size_t r = 0; r < ranks; ++r) {
                sent_begin.push_back(sent_begin.back());
                came_begin.push_back(came_begin.back());
                for (std::size_t c = 0; c < chunks; ++c) {
                    auto const& of_chunk = counts[(l * ranks + r) * chunks + c];
                    sent += of_chunk.sent;
                    came += of_chunk.came;
                    sent_begin.back() += of_chunk.nodes_sent;
                    came_begin.back() += of_chunk.nodes_came;
                }
            }
            had_room = sent_[l].had_room(sent, sent_begin) && had_room;
            had_room = came_[l].had_room(came, came_begin) && had_room;
        }
        if (!had_room) list(false);
    }
    /// Lists whole tiles, where nodes look at others: those of blocks up to `looks` away from another
    /// rank's.
    static void list_whole(Order const& cells, int looks, PartsOfRanks<d>& sent, PartsOfRanks<d>& came)
    {
        int const rank = cells.communicator().rank(), width = 2 * looks + 1;
        int steps = 1;
        for (int a = 0; a < d; ++a) steps *= width;
        for (std::uint32_t b = 0; b < cells.blocks(); ++b) {
            Coordinates<d> const block = block_of_key<d>(cells.keys()[b]);
            int const owner = cells.owners()[b];
            for (int step = 0; step < steps; ++step) {
                Coordinates<d> way;
                for (int a = 0, rest = step; a < d; ++a, rest /= width) way[a] = rest % width - looks;
                int const other = cells.owner(block + way);
                if (other == owner || (owner != rank && other != rank)) continue;
                auto& list = owner == rank ? sent[std::size_t(other)] : came[std::size_t(owner)];
                if (list.empty() || list.back().block != b)
                    list.push_back(whole_tile<d, LocalGrid::TileShape::width>(b));
            }
        }
    }

    cuda::Queue queue_;
    std::array<cuda::Array<std::uint32_t>, 3> lists_;
    std::array<std::uint32_t, 4> listed_{}; ///< how many there are in each, and in borders_
    std::vector<Parts> sent_, came_;        ///< by layer
    cuda::Array<unsigned char> kinds_;
    cuda::Array<std::uint32_t> borders_, of_groups_; ///< blocks of nodes at borders; how many in each group
    cuda::Array<std::uint32_t> counts_;
    cuda::Array<cuda::detail::CountsOfParts> counts_of_parts_;
    cuda::HostMemory told_; ///< what the host reads of these
};

} // namespace firn::distributed

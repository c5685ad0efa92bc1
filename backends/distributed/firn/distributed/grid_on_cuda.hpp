// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/grid.hpp>
#include <firn/cuda/parts_of_tiles.hpp>
#include <firn/cuda/side_queue.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/distributed/exchange_on_cuda.hpp>
#include <firn/distributed/grid.hpp>
#include <firn/distributed/near_ranks.hpp>
#include <firn/distributed/nodes_on_cuda.hpp>
#include <firn/distributed/order_on_cuda.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/results_on_cuda.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/grid/periods.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The grid of a device that shares it with other ranks. All ranks number the blocks of nodes alike, and each
/// updates those under its own blocks of cells. The tiles of other ranks' blocks beside these come from
/// there, not reduced, so that nodes add up what they would add up on one device.
template <class Number, int d, int degree, int sums, int values, int layer_count, bool own_values,
          int ungathered, class Order>
class Grid<cuda::Grid<Number, d, degree, sums, values, layer_count, own_values, ungathered>, Order, d, sums>
    : public cuda::Grid<Number, d, degree, sums, values, layer_count, own_values, ungathered>
{
    using Local = cuda::Grid<Number, d, degree, sums, values, layer_count, own_values, ungathered>;
    using Part = cuda::detail::PartOfTile<d>;
    using PartsOfRanks = std::vector<std::vector<Part>>;
    using Orders = std::array<Order*, std::size_t(layer_count)>;
    using CommunicatorType = std::remove_cvref_t<decltype(std::declval<Order&>().communicator())>;
    static constexpr std::size_t count_of_layers = std::size_t(layer_count);

public:
    using Shape = cuda::BlockShape<d>;
    using typename Local::Sums, typename Local::TileShape;

    /// The nodes as loops see them, which leave alone those that are not shown.
    struct View : Local::View
    {
        unsigned char const* kind; ///< per block of nodes: see kind_of_nodes
        unsigned char shown;
        std::uint32_t const* list; ///< of blocks, or null: all
        __device__ bool shows(std::uint32_t block) const { return (kind[block] & shown) != 0; }
        __device__ std::uint32_t block(std::uint32_t group) const { return list ? list[group] : group; }
    };

    template <class Backend>
    explicit Grid(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend, periods), queue_(backend.queue()), lists_{cuda::Array<std::uint32_t>(queue_),
                                                                   cuda::Array<std::uint32_t>(queue_),
                                                                   cuda::Array<std::uint32_t>(queue_)},
          kinds_(backend), borders_(queue_), of_groups_(queue_), counts_(queue_), counts_of_parts_(queue_),
          told_(queue_), found_by_nodes_(queue_), of_other_nodes_(queue_), exchange_(queue_), side_(queue_)
    {
        bool const are_more = backend.communicator.size() > 1;
        if (are_more) this->node_results().keep_apart();
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            if (are_more) Local::layer(l).item_results().keep_apart();
            found_by_items_.emplace_back(queue_);
            leave_.emplace_back(queue_);
            arrive_.emplace_back(queue_);
            sent_.emplace_back(queue_);
            came_.emplace_back(queue_);
        }
    }

    View view() const
    {
        namespace kind = cuda::detail::kind_of_nodes;
        return {Local::view(), kinds_.data(),
                static_cast<unsigned char>((shown_ == Nodes::others ? 0 : kind::own) |
                                           (shown_ == Nodes::own ? 0 : kind::others)),
                list_ < 0 ? nullptr : lists_[static_cast<std::size_t>(list_)].data()};
    }
    std::uint32_t groups() const
    {
        return list_ < 0 ? this->node_blocks() : listed_[static_cast<std::size_t>(list_)];
    }

    /// See the primary template.
    class Layer : public Local::Layer
    {
    public:
        Layer(Grid& grid, std::size_t number) : Local::Layer(grid, number), grid_(&grid), number_(number) {}
        void change_sums() const { grid_->are_old_ = true; }

        /// The whole tiles of some blocks, one behind the other.
        std::vector<Sums> tiles(std::vector<std::uint32_t> const& blocks) const
        {
            Parts parts(grid_->queue_);
            parts.set_all(whole(blocks));
            grid_->copy(number_, parts, true, grid_->leave_[number_]);
            std::vector<Sums> tiles(parts.begin.back());
            grid_->leave_[number_].download(0, tiles);
            return tiles;
        }
        void set_tiles(std::vector<std::uint32_t> const& blocks, std::vector<Sums> const& tiles) const
        {
            Parts parts(grid_->queue_);
            parts.set_all(whole(blocks));
            grid_->arrive_[number_].renew(tiles.size());
            grid_->arrive_[number_].upload(0, tiles);
            grid_->copy(number_, parts, false, grid_->arrive_[number_]);
            grid_->queue_.wait(); // the list of parts is about to be freed
        }

        /// What the items have found in the last loop.
        template <class Result>
        Found<Result> found(Order const& cells) const
        {
            if (this->blocks() == 0) return {};
            return {&this->item_results(), &grid_->found_by_items_[number_], cells.view().here};
        }

    private:
        static std::vector<Part> whole(std::vector<std::uint32_t> const& blocks)
        {
            std::vector<Part> parts;
            for (auto const block : blocks) parts.push_back(Grid::whole(block));
            return parts;
        }

        Grid* grid_;
        std::size_t number_;
    };
    Layer layer(std::size_t of) { return {*this, of}; }

    void activate(Orders const& orders)
    {
        bool const is_first = this->node_blocks() == 0 && orders[0]->communicator().size() > 1;
        for (std::size_t l = 0; l < count_of_layers; ++l) this->reserve_tiles(l, orders[l]->blocks(), true);
        Local::activate(orders);
        for (std::size_t l = 0; is_first && l < count_of_layers; ++l)
            this->reserve_tiles(l, orders[l]->blocks() + orders[l]->blocks() / 16, false);
        are_old_ = true;
    }
    void swap()
    {
        Local::swap();
        are_old_ = true;
    }
    /// Which nodes loops update: at the borders to other ranks' cells, or elsewhere.
    enum class Where
    {
        anywhere,
        inside,
        at_borders
    };
    void show(Nodes which, Where where = Where::anywhere)
    {
        shown_ = which;
        list_ = -1;
        if (which == Nodes::others)
            list_ = 2;
        else if (which == Nodes::own && where != Where::anywhere)
            list_ = where == Where::inside ? 0 : 1;
    }

    /// See the primary template.
    void exchange(Orders const& orders, int distance)
    {
        if (!begin_exchange(orders, distance)) return;
        go_on_with_exchange();
        end_exchange();
    }
    /// Begins it, if there is anything to exchange: packs what is to travel. Nodes at borders have to wait
    /// until it has ended, and others need not. It takes the host some 20 us to let it travel, so that loops
    /// over others are best queued before that.
    bool begin_exchange(Orders const& orders, int distance)
    {
        std::array<std::uint64_t, count_of_layers> ownership;
        for (std::size_t l = 0; l < count_of_layers; ++l) ownership[l] = orders[l]->ownership();
        bool const others = ownership != ownership_ || distance > looks_;
        if (!are_old_ && !others) return false;
        cuda::OnDevice const here(queue_);
        communicator_ = &orders[0]->communicator();
        if (others) {
            ownership_ = ownership;
            looks_ = std::max(distance, looks_);
            find_borders(orders);
        }
        are_old_ = false;
        to_.clear();
        from_.clear();
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            sent_[l].add_messages(to_, leave_[l]);
            came_[l].add_messages(from_, arrive_[l]);
        }
        // where the host takes part, all ranks do
        if (exchanges_beside && to_.empty() && from_.empty()) return false;
        beside_ = exchanges_beside ? side_.begin() : queue_;
        for (std::size_t l = 0; l < count_of_layers; ++l) copy(l, sent_[l], true, leave_[l], beside_);
        return true;
    }
    /// Lets it travel.
    void go_on_with_exchange()
    {
        exchange_.in(beside_, *communicator_, to_, from_);
        for (std::size_t l = 0; l < count_of_layers; ++l) copy(l, came_[l], false, arrive_[l], beside_);
    }
    void end_exchange()
    {
        if constexpr (exchanges_beside) side_.end();
    }
    /// Whether loops may run meanwhile.
    static constexpr bool exchanges_beside = DeviceExchange::is_on_device<CommunicatorType>;

    /// What the nodes have found in the last loop that did not leave out those of which this rank has
    /// results.
    template <class Result>
    Found<Result> found()
    {
        if (this->node_blocks() == 0) return {};
        return {&Local::node_results(), &found_by_nodes_, kinds_.data()};
    }
    cuda::Results& node_results()
    {
        return shown_ == Nodes::others ? of_other_nodes_ : Local::node_results();
    }

    /// What this rank has of the node with an index, as loops see it: see Local::nodes_by_index(). It holds
    /// until blocks of cells, or their ranks, change.
    SharesOfNodes<Shape::cells> shares() const { return {kinds_.data()}; }
    /// The same for the host.
    SharesOnHost<Shape::cells> shares_on_host() const
    {
        SharesOnHost<Shape::cells> shares;
        shares.kind.resize(kinds_.size());
        kinds_.download(0, shares.kind);
        return shares;
    }
    /// Calls `use(rank, number)` for blocks of nodes for which this rank speaks: those that another rank may
    /// have cells so few nodes away from.
    template <class Use>
    void for_each_near(Orders const& orders, int distance, Use const& use) const
    {
        auto const keys = this->keys_of_nodes();
        auto const shares = shares_on_host();
        for (std::uint32_t n = 0; n < keys.size(); ++n)
            if (share_of_kind(shares.kind[n]) == NodeShare::results)
                for (std::size_t const rank :
                     ranks_near<Local>(*orders[0], block_of_key<d>(keys[n]), distance))
                    use(rank, n);
    }
    /// The rank that has the cell which begins at a node.
    static int rank_of(Orders const& orders, Coordinates<d> const& node)
    {
        return orders[0]->owner(BlocksOf<Local>::block(node));
    }
    /// See distributed::exchange_near().
    template <class T, class NodeOf>
    std::vector<T> exchange_near(Orders const& orders, std::vector<T> const& own, int distance,
                                 NodeOf const& node_of) const
    {
        return distributed::exchange_near<Local>(*orders[0], own, distance, node_of);
    }

    std::size_t memory() const
    {
        std::size_t bytes = Local::memory() + kinds_.memory() + borders_.memory() + found_by_nodes_.memory();
        for (auto const& of : found_by_items_) bytes += of.memory();
        for (auto const& list : lists_) bytes += list.memory();
        for (auto const* const all : {&sent_, &came_})
            for (Parts const& parts : *all) bytes += parts.there.memory();
        bytes += of_groups_.memory() + counts_.memory() + counts_of_parts_.memory();
        for (auto const* const packed : {&leave_, &arrive_})
            for (auto const& of_layer : *packed) bytes += of_layer.memory();
        return bytes;
    }

private:
    /// Parts of tiles that go to other ranks, or come from them, rank by rank.
    struct Parts
    {
        cuda::Array<Part> there;
        std::size_t count = 0;
        std::vector<std::size_t> begin{0}; ///< by rank: where its nodes begin among all

        explicit Parts(cuda::Queue const& queue) : there(queue), queue_(queue), here_(queue) {}
        /// Adds what goes to each rank, or comes from it; `packed` are all parts.
        void add_messages(std::vector<DeviceMessage>& to, cuda::Array<Sums>& packed) const
        {
            packed.renew_amply(begin.back());
            for (std::size_t r = 0; r + 1 < begin.size(); ++r)
                if (begin[r] < begin[r + 1])
                    to.push_back({static_cast<int>(r), reinterpret_cast<std::byte*>(packed.data() + begin[r]),
                                  (begin[r + 1] - begin[r]) * sizeof(Sums)});
        }
        /// Uploads what has been listed by rank. The host has waited since this was called last.
        void set(PartsOfRanks const& of_ranks)
        {
            count = 0;
            for (auto const& of_rank : of_ranks) count += of_rank.size();
            if (count > room_) room_ = 2 * count; // all ranks wait while one allocates
            auto* const all = here_.template as<Part>(room_);
            auto* next = all;
            begin.assign(1, 0);
            for (auto const& of_rank : of_ranks) {
                begin.push_back(begin.back());
                for (Part part : of_rank) {
                    part.first = static_cast<std::uint32_t>(begin.back());
                    begin.back() += part.nodes();
                    *next++ = part;
                }
            }
            there.renew_amply(count);
            cuda::copy_queued(queue_, there.data(), static_cast<Part const*>(all), count);
        }
        void set_all(std::vector<Part> const& whole_tiles) { set(PartsOfRanks{whole_tiles}); }
        /// So many have been listed on the device, of so many nodes for each rank; returns whether there was
        /// room. There is then.
        bool had_room(std::size_t listed, std::vector<std::size_t> const& begins)
        {
            count = listed;
            begin = begins;
            if (count <= there.size()) return true;
            there.renew(2 * count);
            return false;
        }

    private:
        cuda::Queue queue_;
        cuda::HostMemory here_; ///< one rank's behind the other's, on the way to the device
        std::size_t room_ = 0;  ///< for so many there
    };

    void copy(std::size_t layer, Parts const& parts, bool packs, cuda::Array<Sums>& packed)
    {
        packed.renew_amply(parts.begin.back());
        copy(layer, parts, packs, packed, queue_);
    }
    /// The same in another queue, where there is room for them.
    void copy(std::size_t layer, Parts const& parts, bool packs, cuda::Array<Sums>& packed,
              cuda::Queue const& in)
    {
        if (parts.count == 0) return;
        cuda::OnDevice const here(in);
        cuda::launch_after("copy_parts", in, cuda::detail::copy_parts<TileShape, Sums, d>,
                           static_cast<unsigned>(parts.count), 64, parts.there.data(), packs,
                           this->tiles(layer).data(), packed.data());
    }

    using Above = cuda::detail::BlocksAbove<layer_count>;

    /// Finds out which nodes are updated here, and which parts of tiles ranks swap for it.
    void find_borders(Orders const& orders)
    {
        std::uint32_t const blocks = this->node_blocks(), rank = std::uint32_t(communicator_->rank());
        auto const ranks = static_cast<std::size_t>(communicator_->size());
        kinds_.renew(blocks);
        listed_ = {};
        for (auto* const all : {&sent_, &came_})
            for (Parts& parts : *all) parts.had_room(0, std::vector<std::size_t>(ranks + 1, 0));
        if (blocks == 0) return;
        Above above{};
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            above.covered_by[l] = this->covered_by(l).data();
            above.owners[l] = orders[l]->owners_there();
        }
        unsigned const groups = cuda::groups_of(blocks, cuda::detail::bordering_threads);
        borders_.renew(blocks);
        for (auto& list : lists_) list.renew(blocks);
        of_groups_.renew_amply(groups);
        counts_.renew(listed_.size());
        counts_.fill_bytes(0, listed_.size(), 0);
        cuda::launch_after(
            "find_borders", queue_, cuda::detail::find_borders<layer_count, Local::corners>, groups,
            cuda::detail::bordering_threads, above, blocks, rank, kinds_.data(),
            cuda::detail::ListsOfNodes{counts_.data(), lists_[0].data(), lists_[1].data(), lists_[2].data()},
            of_groups_.data());
        if (looks_ <= 1) {
            cuda::launch_after("list_borders", queue_, cuda::detail::list_borders, groups,
                               cuda::detail::bordering_threads, kinds_.data(), blocks, of_groups_.data(),
                               borders_.data(), counts_.data() + listed_.size() - 1);
            list_parts(above, rank, ranks);
            return;
        }
        tell_lists(nullptr, 0);
        PartsOfRanks sent, came;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            sent.assign(ranks, {});
            came.assign(ranks, {});
            list_whole(*orders[l], sent, came);
            sent_[l].set(sent);
            came_[l].set(came);
        }
    }
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
        counts_of_parts_.renew_amply(count_of_layers * ranks);
        auto const list = [&](bool counts_only) {
            cuda::detail::ListsOfParts<d, layer_count> lists{};
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
                cuda::detail::list_parts<d, layer_count, Local::corners, Shape::extent, TileShape::width>,
                static_cast<unsigned>(count_of_layers * ranks), cuda::detail::scanning_threads, above,
                borders_.data(), counts_.data() + listed_.size() - 1, rank, static_cast<std::uint32_t>(ranks),
                lists);
        };
        list(true);
        list(false); // mostly there is room
        auto const* const counts = tell_lists(counts_of_parts_.data(), count_of_layers * ranks);
        bool had_room = true;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            std::size_t sent = 0, came = 0;
            std::vector<std::size_t> sent_begin{0}, came_begin{0};
            for (std::size_t r = 0; r < ranks; ++r) {
                auto const& of_rank = counts[l * ranks + r];
                sent += of_rank.sent;
                came += of_rank.came;
                sent_begin.push_back(sent_begin.back() + of_rank.nodes_sent);
                came_begin.push_back(came_begin.back() + of_rank.nodes_came);
            }
            had_room = sent_[l].had_room(sent, sent_begin) && had_room;
            had_room = came_[l].had_room(came, came_begin) && had_room;
        }
        if (!had_room) list(false);
    }
    /// Lists whole tiles, where nodes look at others: those of blocks up to `looks_` away from another
    /// rank's.
    void list_whole(Order const& cells, PartsOfRanks& sent, PartsOfRanks& came) const
    {
        int const rank = communicator_->rank(), width = 2 * looks_ + 1;
        int steps = 1;
        for (int a = 0; a < d; ++a) steps *= width;
        for (std::uint32_t b = 0; b < cells.blocks(); ++b) {
            Coordinates<d> const block = block_of_key<d>(cells.keys()[b]);
            int const owner = cells.owners()[b];
            for (int step = 0; step < steps; ++step) {
                Coordinates<d> way;
                for (int a = 0, rest = step; a < d; ++a, rest /= width) way[a] = rest % width - looks_;
                int const other = cells.owner(block + way);
                if (other == owner || (owner != rank && other != rank)) continue;
                auto& list = owner == rank ? sent[std::size_t(other)] : came[std::size_t(owner)];
                if (list.empty() || list.back().block != b) list.push_back(whole(b));
            }
        }
    }
    static Part whole(std::uint32_t block)
    {
        Part part{block, 0, {}, {}};
        part.end.fill(TileShape::width);
        return part;
    }

    cuda::Queue queue_;
    CommunicatorType const* communicator_ = nullptr;
    std::array<std::uint64_t, count_of_layers> ownership_{}; ///< of the orders, see CellOrder::ownership
    int looks_ = 0;
    Nodes shown_ = Nodes::all;
    int list_ = -1;                                   ///< the list of those, or -1
    std::array<cuda::Array<std::uint32_t>, 3> lists_; ///< of blocks of nodes: see ListsOfNodes
    std::array<std::uint32_t, 4> listed_{};           ///< how many there are in each, and in borders_
    bool are_old_ = true;
    std::vector<Parts> sent_, came_; ///< by layer
    cuda::Array<unsigned char> kinds_;
    cuda::Array<std::uint32_t> borders_, of_groups_; ///< blocks of nodes at borders; how many in each group
    cuda::Array<std::uint32_t> counts_;
    cuda::Array<cuda::detail::CountsOfParts> counts_of_parts_;
    cuda::HostMemory told_;                         ///< what the host reads of these
    std::vector<cuda::Array<Sums>> leave_, arrive_; ///< by layer: parts of tiles, one behind the other
    cuda::ResultsOfDevices found_by_nodes_;
    std::vector<cuda::ResultsOfDevices> found_by_items_; ///< by layer
    cuda::Results of_other_nodes_;                       ///< they are other ranks'
    DeviceExchange exchange_;
    std::vector<DeviceMessage> to_, from_; ///< of an exchange that has begun
    cuda::Queue beside_{};                 ///< the queue in which it travels
    cuda::SideQueue side_;
};

} // namespace firn::distributed

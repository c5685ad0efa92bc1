// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/grid.hpp>
#include <firn/cuda/parts_of_tiles.hpp>
#include <firn/cuda/side_queue.hpp>
#include <firn/distributed/borders_on_cuda.hpp>
#include <firn/distributed/exchange_on_cuda.hpp>
#include <firn/distributed/grid.hpp>
#include <firn/distributed/near_ranks.hpp>
#include <firn/distributed/nodes_on_cuda.hpp>
#include <firn/distributed/order_on_cuda.hpp>
#include <firn/distributed/parts_on_cuda.hpp>
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
    using Parts = SwappedParts<d>;
    using Orders = std::array<Order*, std::size_t(layer_count)>;
    using CommunicatorType = std::remove_cvref_t<decltype(std::declval<Order&>().communicator())>;
    static constexpr std::size_t count_of_layers = std::size_t(layer_count);
    using BordersType = Borders<Local, Order, d, layer_count>;

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
        : Local(backend, periods), queue_(backend.queue()), borders_(queue_), found_by_nodes_(queue_),
          of_other_nodes_(queue_), exchange_(queue_), side_(queue_)
    {
        bool const are_more = backend.communicator.size() > 1;
        if (are_more) this->node_results().keep_apart();
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            if (are_more) Local::layer(l).item_results().keep_apart();
            found_by_items_.emplace_back(queue_);
            leave_.emplace_back(queue_);
            arrive_.emplace_back(queue_);
        }
    }

    View view() const
    {
        namespace kind = cuda::detail::kind_of_nodes;
        return {Local::view(), borders_.kinds().data(),
                static_cast<unsigned char>((shown_ == Nodes::others ? 0 : kind::own) |
                                           (shown_ == Nodes::own ? 0 : kind::others)),
                list_ < 0 ? nullptr : borders_.list(static_cast<std::size_t>(list_))};
    }
    std::uint32_t groups() const
    {
        return list_ < 0 ? this->node_blocks() : borders_.listed(static_cast<std::size_t>(list_));
    }

    /// See the primary template.
    class Layer : public Local::Layer
    {
    public:
        Layer(Grid& grid, std::size_t number) : Local::Layer(grid, number), grid_(&grid), number_(number) {}
        void change_sums() const { grid_->are_old_ = true; }

        /// The whole tiles of blocks that ranks swap.
        class SwapOfTiles
        {
        public:
            SwapOfTiles(Grid& grid, std::size_t number)
                : grid_(grid), number_(number), out_(grid.queue_), in_(grid.queue_)
            {}
            void add_messages(std::vector<DeviceMessage>& to, std::vector<DeviceMessage>& from)
            {
                grid_.copy(number_, out_, true, grid_.leave_[number_]);
                out_.add_messages(to, grid_.leave_[number_]);
                in_.add_messages(from, grid_.arrive_[number_]);
            }
            void unpack() { grid_.copy(number_, in_, false, grid_.arrive_[number_]); }

        private:
            friend class Layer;
            Grid& grid_;
            std::size_t number_;
            Parts out_, in_;
        };
        /// Those go to each rank, and these come from there.
        SwapOfTiles swap_of_tiles(std::vector<std::vector<std::uint32_t>> const& go,
                                  std::vector<std::vector<std::uint32_t>> const& come) const
        {
            SwapOfTiles swap(*grid_, number_);
            PartsOfRanks<d> parts;
            for (auto const& of_rank : go) parts.push_back(whole(of_rank));
            swap.out_.set(parts);
            parts.clear();
            for (auto const& of_rank : come) parts.push_back(whole(of_rank));
            swap.in_.set(parts);
            return swap;
        }

        /// What the items have found in the last loop.
        template <class Result>
        Found<Result> found(Order const& cells) const
        {
            if (this->blocks() == 0) return {};
            return {&this->item_results(), &grid_->found_by_items_[number_], cells.view().here};
        }

    private:
        static auto whole(std::vector<std::uint32_t> const& blocks)
        {
            std::vector<cuda::detail::PartOfTile<d>> parts;
            for (auto const block : blocks) parts.push_back(whole_tile<d, TileShape::width>(block));
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
            typename BordersType::Above above{};
            for (std::size_t l = 0; l < count_of_layers; ++l) {
                above.covered_by[l] = this->covered_by(l).data();
                above.owners[l] = orders[l]->owners_there();
            }
            borders_.find(orders, above, this->node_blocks(), looks_);
        }
        are_old_ = false;
        to_.clear();
        from_.clear();
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            borders_.sent(l).add_messages(to_, leave_[l]);
            borders_.came(l).add_messages(from_, arrive_[l]);
        }
        if (exchanges_beside && to_.empty() && from_.empty()) {
            exchange_(*communicator_, to_, from_); // all ranks take part
            return false;
        }
        beside_ = exchanges_beside ? side_.begin() : queue_;
        for (std::size_t l = 0; l < count_of_layers; ++l) copy(l, borders_.sent(l), true, leave_[l], beside_);
        return true;
    }
    /// Lets it travel.
    void go_on_with_exchange()
    {
        exchange_.in(beside_, *communicator_, to_, from_);
        for (std::size_t l = 0; l < count_of_layers; ++l)
            copy(l, borders_.came(l), false, arrive_[l], beside_);
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
        return {&Local::node_results(), &found_by_nodes_, borders_.kinds().data()};
    }
    cuda::Results& node_results()
    {
        return shown_ == Nodes::others ? of_other_nodes_ : Local::node_results();
    }

    /// What this rank has of the node with an index, as loops see it: see Local::nodes_by_index(). It holds
    /// until blocks of cells, or their ranks, change.
    SharesOfNodes<Shape::cells> shares() const { return {borders_.kinds().data()}; }
    /// The same for the host.
    SharesOnHost<Shape::cells> shares_on_host() const
    {
        SharesOnHost<Shape::cells> shares;
        shares.kind.resize(borders_.kinds().size());
        borders_.kinds().download(0, shares.kind);
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
        std::size_t bytes = Local::memory() + borders_.memory() + found_by_nodes_.memory();
        for (auto const& of : found_by_items_) bytes += of.memory();
        for (auto const* const packed : {&leave_, &arrive_})
            for (auto const& of_layer : *packed) bytes += of_layer.memory();
        return bytes;
    }

private:
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

    cuda::Queue queue_;
    CommunicatorType const* communicator_ = nullptr;
    std::array<std::uint64_t, count_of_layers> ownership_{}; ///< of the orders, see CellOrder::ownership
    int looks_ = 0;
    Nodes shown_ = Nodes::all;
    int list_ = -1; ///< the list of those, or -1
    BordersType borders_;
    bool are_old_ = true;
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

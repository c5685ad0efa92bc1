// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/fill_holes.hpp>
#include <firn/distributed/owned_blocks.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/partition.hpp>
#include <firn/distributed/results_on_cuda.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The order of cells of a device that shares them with other ranks. All ranks know all blocks, and number
/// them alike, as one device alone would. So they agree with it on all that depends on these numbers: the
/// order of items that come into a cell, how many threads share a block, and in which order results are
/// merged. Each rank has the items of its own blocks; the others are empty.
template <class C, class Number, int d>
class CellOrder<cuda::CellOrder<Number, d>, C, Number, d> : public cuda::CellOrder<Number, d>
{
    using Local = cuda::CellOrder<Number, d>;
    using Shape = cuda::BlockShape<d>;

public:
    using typename Local::Offset;

    /// The cells as loops see them, which leave the blocks of other ranks alone.
    struct View : Local::View
    {
        unsigned char const* here; ///< per block: 1 if this rank has it
        __device__ bool has(std::uint32_t block) const { return here[block] != 0; }
    };

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend, periods), communicator_(backend.communicator), partition_(backend.partition),
          here_(backend), strays_(backend), search_(backend), told_(backend.queue()),
          told_strays_(backend.queue()), count_(backend), list_(backend), picked_(backend), origins_(backend)
    {}

    C const& communicator() const { return communicator_; }
    View view() const { return {Local::view(), here_.data()}; }
    /// The rank that has a block of cells.
    int owner(Coordinates<d> const& block) const
    {
        return partition_->owner(place_on_curve<d>(this->periods_.wrapped(block)));
    }
    /// Of all blocks.
    std::span<std::uint64_t const> keys() const { return of_all_.keys(); }
    std::span<int const> owners() const { return of_all_.owners(); }
    /// Changes whenever these do.
    std::uint64_t ownership() const { return of_all_.version(); }
    bool has(std::size_t block) const { return owners()[block] == communicator_.rank(); }

    /// As for the order of one device: whether there are few blocks and many items, on all ranks.
    bool is_small() const { return this->blocks() <= 128 && all_ >= std::size_t(32) * this->blocks(); }

    /// The number of a cell's block.
    std::uint64_t block_of(Coordinates<d> const& cell) const
    {
        return of_all_.find(block_key<d>(this->periods_.wrapped(block_at(cell))));
    }
    std::vector<std::uint32_t> own(std::span<Coordinates<d> const> cells)
    {
        return partition_->own(communicator_, cells.size(), [&](std::size_t i) {
            return place_on_curve<d>(this->periods_.wrapped(block_at(cells[i])));
        });
    }

    void insert(Coordinates<d> const* cells, std::size_t count, std::uint32_t first)
    {
        Local::insert(cells, count, first, [&] { return births_of_all_ranks(); });
        find_owners();
        all_ = sum_of_ranks(communicator_, this->size());
    }
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        Local::erase(gone, place, kept);
        all_ = sum_of_ranks(communicator_, this->size());
    }

    /// Items find their new cells in depart().
    cuda::detail::Destinations<d> destinations()
    {
        auto to = Local::destinations();
        to.ahead = is_small() ? 3 : 0;
        to.at_once = false;
        return to;
    }
    /// Incoming items are forgotten before items move.
    cuda::detail::ArrivalsToForget forget_incoming_on_the_way(std::uint32_t)
    {
        return {this->changes(), 0, this->leavers_.counters.data()};
    }
    /// Queues the search for the new cells of items that have moved, and what it tells the host. The loop
    /// that moves items does not search, since it does not know which blocks are here.
    void search()
    {
        searched_ = {};
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        strays_.renew(this->leavers_.most);
        search_.renew(1);
        search_.fill_bytes(0, 1, 0);
        cuda::launch_after("find_cells_here", this->queue_, cuda::detail::find_cells_here<d, Number>,
                           cuda::groups_of(this->leavers_.most, 256), 256, this->leavers(), destinations(),
                           here_.data(), strays_.data(), search_.data());
        cuda::launch_after("tell_searched", this->queue_, cuda::detail::tell_searched,
                           cuda::groups_of(this->blocks(), 128), 128, this->leavers_.counters.data(),
                           this->set_.born_count(), this->changes(), this->blocks(), search_.data());
        strays_at_once_ = std::min(strays_at_once_, this->leavers_.most);
        cuda::copy_queued(this->queue_, told_.as<Searched>(), search_.data(), 1);
        cuda::copy_queued(this->queue_, told_strays_.as<Stray>(strays_at_once_), strays_.data(),
                          strays_at_once_);
    }
    /// Called when the host has waited: says what has been found.
    void put_searched(Parcel& to)
    {
        read_searched();
        put(to, searched_);
        put(to, static_cast<std::uint32_t>(searched_.leavers > this->leavers_.most));
    }
    /// Hears what all ranks say; returns whether all had room for their leavers. If not, makes it.
    bool hear(std::vector<Reader>& told)
    {
        live_ = strays_of_all_ = births_ = 0;
        bool had_room = true;
        for (Reader& of_rank : told) {
            auto const searched = of_rank.template get<Searched>();
            had_room = of_rank.template get<std::uint32_t>() == 0 && had_room;
            live_ += searched.live;
            strays_of_all_ += searched.strays;
            births_ += searched.births;
        }
        if (had_room) return true;
        this->short_ = {1, searched_.leavers, 0, 0};
        this->make_room();
        return false;
    }
    /// Creates the blocks that were missing on any rank; all leavers search again.
    void create_missing()
    {
        if (births_ == 0) return;
        cuda::OnDevice const here(this->queue_);
        while (std::uint32_t const births = births_of_all_ranks()) {
            this->add_blocks(births);
            find_owners();
            search();
            this->queue_.wait();
            read_searched();
        }
        live_ = 0; // not known
        strays_of_all_ = 1;
    }

    /// See distributed::share_results.
    template <class Orders, class OfNodes, class OfItems>
    bool share_results(Orders const& orders, OfNodes& of_nodes, OfItems& of_items) const
    {
        return distributed::share_results(communicator_, this->queue(), orders, of_nodes, of_items);
    }

    /// See the primary template.
    struct Departure
    {
        std::vector<std::uint32_t> places{};
        Parcel notes{};
    };
    std::vector<Departure> depart(std::array<Offset*, std::size_t(d)> const& /*offset*/)
    {
        gone_.clear();
        if (strays_of_all_ == 0) return {}; // none on any rank
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        cuda::OnDevice const here(this->queue_);
        auto const contributions = contributions_of_strays();
        auto const channels = static_cast<std::size_t>(this->channels_);
        for (std::size_t i = 0; i < strays_here_.size(); ++i) {
            auto const& stray = strays_here_[i];
            auto& to = by_rank[static_cast<std::size_t>(owners()[stray.block])];
            WayOut const out(stray.cell % Shape::cells, stray.way);
            put(to.notes,
                Arrival{AllLeavers::origin_of(stray.cell / Shape::cells, stray.slot),
                        static_cast<std::uint32_t>(stray.block * std::uint32_t{Shape::cells} + out.place)});
            put(to.notes, contributions.data() + i * channels, channels);
            to.places.push_back(stray.slot);
            gone_.push_back(stray.slot);
        }
        return by_rank;
    }
    template <class Move>
    void arrive(std::span<Parcel const> notes, std::uint32_t first,
                std::array<Offset*, std::size_t(d)> const& offset, Move const& move)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        std::size_t const came = admit(notes, first);
        std::size_t const count = first - gone_.size() + came;
        this->find_block_begins();
        this->offset_ = offset;
        this->rebinned_blocks_ = this->blocks();
        auto const leavers = all_leavers();
        this->rearrange(leavers, listed_, this->left_.data(), offset, count);
        this->left_.renew(std::max(count, this->left_.size()));
        fill_holes(*this, gone_, first + came, static_cast<std::uint32_t>(count), move);
        drop_empty_blocks();
    }
    /// Items that lay at places from `first` on lie at `place[where it lay - first]` now.
    void relocate(std::uint32_t first, std::vector<std::uint32_t> const& place)
    {
        list_.renew(place.size());
        list_.upload(0, place);
        for (auto const& [where, count] : {std::pair{this->order_.data(), this->size()},
                                           std::pair{this->leavers_.slot.data(), std::size_t{listed_}}})
            if (count > 0)
                cuda::launch_after("relocate", this->queue_, cuda::detail::relocate,
                                   cuda::groups_of(count, 256), 256, where, count, first, list_.data());
    }

    void weigh(std::vector<Partition::Weight>& to) const
    {
        if (this->blocks() == 0) return;
        auto const begin = downloaded(this->begin_, keys().size() * Shape::cells + 1);
        for (std::size_t b = 0; b < keys().size(); ++b)
            if (std::uint32_t const items = begin[(b + 1) * Shape::cells] - begin[b * Shape::cells];
                items > 0)
                to.push_back(
                    {place_on_curve<d>(block_of_key<d>(keys()[b])), items + Partition::weight_of_block});
    }

    /// See the primary template.
    template <class Layer>
    std::vector<Departure> hand_over(Layer const& layer)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        gone_.clear();
        if (this->blocks() == 0) return by_rank;
        begin_here_ = downloaded(this->begin_, keys().size() * Shape::cells + 1);
        order_here_ = downloaded(this->order_, this->size());
        if (this->committed_) std::iota(order_here_.begin(), order_here_.end(), std::uint32_t(0));
        std::vector<std::uint32_t> blocks;
        for (std::uint32_t b = 0; b < keys().size(); ++b)
            if (has(b) && owner(block_of_key<d>(keys()[b])) != communicator_.rank()) blocks.push_back(b);
        auto const tiles = layer.tiles(blocks);
        for (std::size_t i = 0; i < blocks.size(); ++i) {
            std::uint32_t const b = blocks[i], *const begin = &begin_here_[std::size_t(b) * Shape::cells];
            auto& to = by_rank[static_cast<std::size_t>(owner(block_of_key<d>(keys()[b])))];
            put(to.notes, b);
            put(to.notes, begin, Shape::cells + 1);
            put(to.notes, tiles.data() + i * Layer::TileShape::nodes, Layer::TileShape::nodes);
            std::span const items = std::span(order_here_).subspan(*begin, begin[Shape::cells] - *begin);
            to.places.insert(to.places.end(), items.begin(), items.end());
            gone_.insert(gone_.end(), items.begin(), items.end());
        }
        return by_rank;
    }
    template <class Layer, class Move>
    void take_over(std::span<Parcel const> notes, std::uint32_t first, Layer const& layer, Move const& move)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        std::vector<std::vector<std::uint32_t>> came(keys().size()); // beginnings of the cells of each block
        std::vector<std::uint32_t> place(keys().size()), blocks;
        std::vector<typename Layer::Sums> tiles;
        std::uint32_t next = first;
        for (Parcel const& parcel : notes)
            for (Reader from(parcel); !from.at_end();) {
                auto const b = from.template get<std::uint32_t>();
                came[b].resize(Shape::cells + 1);
                from.get(came[b].data(), came[b].size());
                place[b] = next;
                next += came[b].back() - came[b].front();
                blocks.push_back(b);
                tiles.resize(tiles.size() + Layer::TileShape::nodes);
                from.get(&tiles[tiles.size() - Layer::TileShape::nodes], Layer::TileShape::nodes);
            }
        layer.set_tiles(blocks, tiles);
        std::vector<std::uint32_t> begin{0}, order;
        for (std::size_t b = 0; b < keys().size(); ++b) {
            bool const stays = has(b) && owner(block_of_key<d>(keys()[b])) == communicator_.rank();
            std::uint32_t const* const before = stays ? &begin_here_[b * Shape::cells] : came[b].data();
            for (int c = 0; c < Shape::cells; ++c) {
                std::uint32_t const items = before == nullptr ? 0 : before[c + 1] - before[c];
                for (std::uint32_t i = 0; i < items; ++i)
                    order.push_back(stays ? order_here_[before[c] + i] : place[b]++);
                begin.push_back(static_cast<std::uint32_t>(order.size()));
            }
        }
        find_owners();
        this->begin_.upload(0, begin);
        this->order_.resize(order.size());
        this->order_.upload(0, order);
        this->left_.renew(std::max(order.size(), this->left_.size()));
        this->stay_all();
        this->size_ = order.size();
        this->committed_ = false;
        searched_ = {};
        strays_here_.clear();
        listed_ = 0;
        fill_holes(*this, gone_, next, static_cast<std::uint32_t>(this->size()), move);
    }
    /// They have been taken with the blocks.
    template <class Layer>
    void take_tiles(Layer const&) const
    {}

    std::size_t memory() const
    {
        return Local::memory() + here_.memory() + strays_.memory() + origins_.memory();
    }

private:
    using WayOut = cuda::detail::WayOut<d>;
    using AllLeavers = cuda::detail::LeaversOfDevices<Number>;
    using Stray = cuda::detail::Stray;
    using Searched = cuda::detail::Searched;

    /// An item that comes from another rank.
    struct Arrival
    {
        std::uint64_t origin;
        std::uint32_t cell;
    };

    static Coordinates<d> block_at(Coordinates<d> cell)
    {
        for (int a = 0; a < d; ++a) cell[a] >>= Shape::bits;
        return cell;
    }
    template <class T>
    static std::vector<T> downloaded(cuda::Array<T> const& from, std::size_t count)
    {
        std::vector<T> values(count);
        from.download(0, values);
        return values;
    }
    /// Finds out which rank has which block, after blocks or parts have changed.
    void find_owners()
    {
        std::vector<std::uint64_t> keys(this->blocks());
        if (!keys.empty()) this->set_.download_keys(keys);
        of_all_.set(std::move(keys), [&](std::uint64_t key) { return owner(block_of_key<d>(key)); });
        std::vector<unsigned char> here;
        for (int const rank : owners()) here.push_back(rank == communicator_.rank());
        here_.resize(here.size());
        here_.upload(0, here);
    }

    /// Lets all ranks request what any of them has; returns how many blocks that are, or more than there is
    /// room for.
    std::uint32_t births_of_all_ranks()
    {
        std::uint32_t const own = this->set_.births();
        bool const lacks_room = !this->set_.has_room_for(own);
        std::vector<std::uint64_t> keys;
        if (!lacks_room) keys = this->set_.requested(own);
        if (sum_of_ranks(communicator_, own) == 0) return 0;
        std::uint64_t const most = sum_of_ranks(communicator_, lacks_room ? own : 0);
        if (most > 0) return static_cast<std::uint32_t>(std::min<std::uint64_t>(most, std::uint32_t(-2)));
        this->set_.want(of_all_ranks(communicator_, keys));
        return this->set_.births();
    }

    /// Reads what a search has told, when the host has waited.
    void read_searched()
    {
        strays_here_.clear();
        if (this->blocks() == 0) return;
        searched_ = *told_.template get<Searched>();
        if (searched_.leavers > this->leavers_.most) return;
        strays_here_.resize(searched_.strays);
        auto const come = std::min<std::size_t>(searched_.strays, strays_at_once_);
        std::copy_n(told_strays_.template get<Stray>(), come, strays_here_.begin());
        if (come < searched_.strays) { // next time there is room for them
            strays_.download(come, std::span(strays_here_).subspan(come));
            strays_at_once_ = searched_.strays + searched_.strays / 4;
        }
        std::ranges::sort(strays_here_, {}, &Stray::slot);
    }
    std::vector<Number> contributions_of_strays()
    {
        std::size_t const count = strays_here_.size() * static_cast<std::size_t>(this->channels_);
        if (count == 0) return {};
        std::vector<std::uint32_t> leavers;
        for (auto const& stray : strays_here_) leavers.push_back(stray.leaver);
        list_.renew(leavers.size());
        list_.upload(0, leavers);
        picked_.renew(count);
        cuda::launch_after("pick_contributions", this->queue_, cuda::detail::pick_contributions<Number>,
                           cuda::groups_of(count, 256), 256, this->leavers(), list_.data(), leavers.size(),
                           picked_.data());
        return downloaded(picked_, count);
    }

    AllLeavers all_leavers()
    {
        return {this->leavers(), searched_.leavers, origins_.data(), this->order_before_.data()};
    }
    /// Lists what came, and lets it into its cells; returns how many items.
    std::size_t admit(std::span<Parcel const> notes, std::uint32_t first)
    {
        std::vector<std::uint64_t> origins;
        std::vector<std::uint32_t> cells;
        std::vector<Number> contributions;
        auto const channels = static_cast<std::size_t>(this->channels_);
        for (Parcel const& parcel : notes)
            for (Reader from(parcel); !from.at_end();) {
                auto const item = from.template get<Arrival>();
                origins.push_back(item.origin);
                cells.push_back(item.cell);
                contributions.resize(contributions.size() + channels);
                from.get(contributions.data() + contributions.size() - channels, channels);
            }
        listed_ = searched_.leavers + static_cast<std::uint32_t>(cells.size());
        this->order_before_.renew(listed_);
        if (cells.empty()) return 0;
        std::vector<std::uint32_t> places(cells.size());
        std::iota(places.begin(), places.end(), first);
        auto& to = this->leavers_;
        to.grow(listed_, this->channels_);
        to.slot.upload(searched_.leavers, places);
        to.contribution.upload(searched_.leavers * channels, contributions);
        origins_.renew(origins.size());
        origins_.upload(0, origins);
        list_.renew(cells.size());
        list_.upload(0, cells);
        cuda::launch_after("admit", this->queue_, cuda::detail::admit<Number>,
                           cuda::groups_of(cells.size(), 256), 256, all_leavers(),
                           static_cast<std::uint32_t>(cells.size()), list_.data(), this->changes());
        return cells.size();
    }

    /// Whether there are too many empty blocks beside so many live ones, as one device would find.
    bool are_crowded(std::size_t live) const
    {
        return live > 0 && this->blocks() > live + cuda::detail::most_empty_blocks(
                                                       static_cast<std::uint32_t>(live), is_small());
    }
    /// Drops empty blocks where there are too many, as one device would.
    void drop_empty_blocks()
    {
        std::uint32_t const blocks = this->blocks();
        if (strays_of_all_ == 0 && !are_crowded(live_)) return; // what stays on its device is all
        count_.renew(1);
        count_.fill_bytes(0, 1, 0);
        cuda::launch_after("count_live_blocks", this->queue_, cuda::detail::count_live_blocks,
                           cuda::groups_of(blocks, 128), 128, this->begin_.data(), blocks, count_.data());
        std::size_t const live = sum_of_ranks(communicator_, downloaded(count_, 1)[0]);
        if (!are_crowded(live)) return;
        std::uint32_t const here = this->list_live_blocks();
        auto all = of_all_ranks(communicator_, downloaded(this->blocks_before_, here));
        std::ranges::sort(all);
        this->blocks_before_.upload(0, all);
        this->forget_empty_blocks(static_cast<std::uint32_t>(all.size()));
        this->stay_all(); // loops leave the blocks of other ranks as they are
        find_owners();
    }

    C communicator_;
    std::shared_ptr<Partition> partition_;
    OwnedBlocks of_all_;
    std::size_t all_ = 0;                                   ///< items of all ranks
    Searched searched_{};                                   ///< of the items that left their cells last
    std::size_t live_ = 0, births_ = 0, strays_of_all_ = 0; ///< the same of all ranks
    std::uint32_t listed_ = 0;                              ///< leavers, and those that came from other ranks
    std::vector<std::uint32_t> gone_;                    ///< where items lay that have left for other ranks
    std::vector<std::uint32_t> begin_here_, order_here_; ///< copies, while blocks are handed over
    cuda::Array<unsigned char> here_;
    cuda::Array<Stray> strays_;
    cuda::Array<Searched> search_;
    cuda::HostMemory told_, told_strays_;
    std::size_t strays_at_once_ = 256; ///< so many come to the host with what was found
    std::vector<Stray> strays_here_;   ///< in the order of their slots
    cuda::Array<std::uint32_t> count_, list_;
    cuda::Array<Number> picked_;
    cuda::Array<std::uint64_t> origins_; ///< of what came
};

} // namespace firn::distributed

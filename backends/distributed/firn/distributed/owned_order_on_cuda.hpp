// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/owned_blocks.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/partition.hpp>
#include <firn/distributed/results_on_cuda.hpp>
#include <firn/distributed/room_for_items.hpp>
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
#include <vector>

namespace firn::distributed
{

/// The order of cells of a device that knows which rank has which block, and where the items that have moved
/// are to go. All ranks know all blocks, and number them alike, as one device alone would. So they agree with
/// it on all that depends on these numbers: the order of items that come into a cell, how many threads share
/// a block, and in which order results are merged. Each rank has the items of its own blocks; the others are
/// empty.
template <class C, class Number, int d>
class OwnedOrder : public cuda::CellOrder<Number, d>
{
    using Local = cuda::CellOrder<Number, d>;

public:
    /// The cells as loops see them, which leave the blocks of other ranks alone.
    struct View : Local::View
    {
        unsigned char const* here;   ///< per block: 1 if this rank has it
        std::uint32_t const* blocks; ///< those that it has; null: all
        __device__ std::uint32_t block(std::uint32_t group) const
        {
            return blocks == nullptr ? group : blocks[group];
        }
        static constexpr bool forgets_incoming = true; // into other ranks' blocks none ever come
    };

    template <class Backend>
    explicit OwnedOrder(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend, periods), communicator_(backend.communicator), partition_(backend.partition),
          curve_(partition_->lattice(), Local::extent), here_(backend), strays_(backend), search_(backend),
          owners_(backend), blocks_here_(backend), told_(backend.queue()), shared_(backend.queue()),
          room_(communicator_.size()), room_of_packed_(room_), count_(backend)
    {}

    C const& communicator() const { return communicator_; }
    View view() const { return {Local::view(), here_.data(), has_all() ? nullptr : blocks_here_.data()}; }
    bool has_all() const { return own_.size() == this->blocks(); } ///< whether this rank has all blocks
    std::uint32_t groups(std::uint32_t of_blocks) const
    {
        return static_cast<std::uint32_t>(std::ranges::lower_bound(own_, of_blocks) - own_.begin());
    }
    /// The rank that has a block of cells.
    int owner(Coordinates<d> const& block) const
    {
        return partition_->owner(curve_.place(this->periods_.wrapped(block)));
    }
    /// Of all blocks.
    std::span<std::uint64_t const> keys() const { return of_all_.keys(); }
    std::span<int const> owners() const { return of_all_.owners(); }
    /// The rank that is to have a block by its number, when space has been divided anew.
    int next_owner(std::size_t block) const { return partition_->owner(of_all_.places()[block]); }
    /// The blocks that this rank has.
    cuda::detail::PartOfBlocks part() const
    {
        return {blocks_here_.data(), static_cast<std::uint32_t>(own_.size()), here_.data(), this->blocks()};
    }
    std::uint32_t const* owners_there() const { return owners_.data(); } ///< on the device
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
            return curve_.place(this->periods_.wrapped(block_at(cells[i])));
        });
    }

    void insert(Coordinates<d> const* cells, std::size_t count, std::uint32_t first)
    {
        Local::insert(cells, count, first, [&] { return births_of_all_ranks(this->set_.births()); });
        find_owners();
        // ahead of need, since all ranks wait while one allocates
        if (communicator_.size() > 1) this->reserve_blocks(this->blocks() + this->blocks() / 16);
        all_ = sum_of_ranks(communicator_, this->size());
        knows_live_here_ = false;
    }
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        Local::erase(gone, place, kept);
        knows_live_here_ = false;
        all_ = sum_of_ranks(communicator_, this->size());
    }

    /// Room for so many items, with a spare: a rank has at most a twentieth more than its share for long (see
    /// Partition).
    static std::size_t with_room(std::size_t items) { return items + items / 16; }

    /// Items find their new cells in a search of its own.
    cuda::detail::Destinations<d> destinations()
    {
        auto to = Local::destinations();
        to.ahead = is_small() ? 3 : 0;
        to.at_once = false;
        return to;
    }
    /// Incoming items are forgotten as items move.
    cuda::detail::ArrivalsToForget forget_incoming_on_the_way(std::uint32_t)
    {
        return {this->changes(), 0, this->leavers_.counters.data()};
    }
    typename Local::Leavers expect_outgoing(int channels)
    {
        this->may_have_arrived_ = false;
        auto const leavers = Local::expect_outgoing(channels);
        this->leavers_.counters.fill_bytes(0, 1, 0);
        return leavers;
    }
    /// What searches for the new cells of items that have moved, and tells at `to` what SearchOfRanks has of
    /// a rank; zero before. The loop that moves items does not search, since it does not know which blocks
    /// are here.
    cuda::detail::SearchHere<d, Number> search(std::uint32_t* to)
    {
        if (this->blocks() == 0) return {};
        strays_.renew(this->leavers_.most);
        return {this->blocks(),
                this->leavers(),
                destinations(),
                owners_.data(),
                static_cast<std::uint32_t>(communicator_.rank()),
                strays_.data(),
                reinterpret_cast<Searched*>(to),
                to + SearchOfRanks::words_of_searched};
    }
    /// Reads what all ranks have found, which was shared by the first order of cells; returns whether all had
    /// room for their leavers. If not, makes it.
    bool hear(OwnedOrder const& first, std::size_t number)
    {
        return hear(first.shared_.search(number, communicator_.size()));
    }
    /// Creates the blocks that were missing on any rank; all leavers search again.
    void create_missing()
    {
        if (births_ == 0) return;
        cuda::OnDevice const here(this->queue_);
        std::size_t const words = SearchOfRanks::words(communicator_.size());
        while (births_ > 0) {
            std::size_t const before = this->blocks();
            std::uint32_t const births = births_of_all_ranks(this->with_those_around(searched_.births));
            if (this->set_.has_room_for(births))
                this->reserve_blocks(static_cast<std::uint32_t>(before) + births);
            this->add_blocks(births);
            born_.resize(this->blocks() - before); // all, or none if there was no room
            add_owners(before, born_);
            queue_search();
            auto const all = of_all_ranks(communicator_, downloaded(search_, words));
            hear({all.data(), words});
        }
        are_swapped_ = false; // they have been listed anew
    }

    /// See SharedResults.
    template <class Orders, class OfNodes, class OfItems>
    void share_results(Orders const& orders, OfNodes& of_nodes, OfItems& of_items, bool again)
    {
        shared_.share(communicator_, orders, of_nodes, of_items, again);
    }
    /// See SharedResults.
    template <class Orders>
    void go_on_early(Orders const& orders) const
    {
        shared_.go_on_early(orders);
    }
    template <class OfNodes, class OfItems>
    bool had_room_for_results(OfNodes& of_nodes, OfItems& of_items)
    {
        return shared_.had_room(communicator_, of_nodes, of_items);
    }

    /// How many items come from other ranks.
    std::size_t coming() const { return std::accumulate(coming_.begin(), coming_.end(), std::size_t{0}); }

    /// What the items here weigh, as far as it is known without a look at them; -1 if it is not, which is so
    /// on all ranks.
    double weight_here() const
    {
        if (this->blocks() == 0) return 0;
        return knows_live_here_ ? double(this->size()) + double(searched_.live) * Partition::weight_of_block
                                : -1;
    }
    void weigh(std::vector<Partition::Weight>& to)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        count_.renew(keys().size());
        cuda::launch_after("count_items", this->queue_, cuda::detail::count_items,
                           cuda::groups_of(keys().size(), 256), 256, this->begin_.data(), this->blocks(),
                           count_.data());
        items_ = downloaded(count_, keys().size());
        for (std::size_t b = 0; b < items_.size(); ++b)
            if (items_[b] > 0) to.push_back({of_all_.places()[b], items_[b] + Partition::weight_of_block});
    }

    std::size_t memory() const
    {
        return Local::memory() + here_.memory() + strays_.memory() + shared_.memory() + search_.memory() +
               owners_.memory() + blocks_here_.memory() + count_.memory();
    }

protected:
    using Shape = cuda::BlockShape<d>;
    using Stray = cuda::detail::Stray;
    using Searched = cuda::detail::Searched;

    static constexpr std::size_t place_of_strays =
        offsetof(Searched, strays) / sizeof(std::uint32_t); ///< in what a rank tells

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
    /// Finds out which rank has which block, after blocks have come behind the first `kept`, which are as
    /// they were.
    void find_owners(std::size_t kept = 0)
    {
        std::vector<std::uint64_t> keys(this->blocks() - kept);
        this->set_.download_keys(kept, keys);
        add_owners(kept, keys);
    }
    /// The same for blocks with these keys.
    void add_owners(std::size_t kept, std::vector<std::uint64_t> const& keys)
    {
        of_all_.set(
            kept, keys, [&](std::uint64_t key) { return curve_.place(block_of_key<d>(key)); },
            [&](std::uint64_t place) { return partition_->owner(place); });
        tell_owners(kept);
    }
    /// The same where only the listed blocks are left, in their order.
    void keep_owners(std::span<std::uint32_t const> list)
    {
        of_all_.keep(list);
        tell_owners(0);
    }
    /// The same where ranks have other parts.
    void divide_owners()
    {
        of_all_.divide([&](std::uint64_t place) { return partition_->owner(place); });
        tell_owners(0);
    }
    /// Lets the device know which rank has which block, of those behind the first `kept`.
    void tell_owners(std::size_t kept)
    {
        auto const owners = this->owners().subspan(kept);
        while (!own_.empty() && own_.back() >= kept) own_.pop_back();
        std::size_t const own_before = own_.size();
        // the host has waited since these were copied last; all ranks wait while one allocates
        if (owners.size() > room_told_) room_told_ = 2 * owners.size();
        auto* const told = told_.template as<std::uint32_t>(3 * room_told_);
        auto* const here = reinterpret_cast<unsigned char*>(told + 2 * owners.size());
        for (std::size_t b = 0; b < owners.size(); ++b) {
            told[b] = static_cast<std::uint32_t>(owners[b]);
            here[b] = owners[b] == communicator_.rank();
            if (here[b] != 0) own_.push_back(static_cast<std::uint32_t>(kept + b));
        }
        std::size_t const more = own_.size() - own_before;
        std::copy_n(own_.end() - static_cast<std::ptrdiff_t>(more), more, told + owners.size());
        owners_.resize(this->blocks());
        here_.resize(this->blocks());
        blocks_here_.resize(own_.size());
        cuda::copy_queued(this->queue_, owners_.data() + kept, static_cast<std::uint32_t const*>(told),
                          owners.size());
        cuda::copy_queued(this->queue_, here_.data() + kept, static_cast<unsigned char const*>(here),
                          owners.size());
        cuda::copy_queued(this->queue_, blocks_here_.data() + own_before,
                          static_cast<std::uint32_t const*>(told + owners.size()), more);
    }

    /// Lets leavers search once more; what they find is in `search_`.
    void queue_search()
    {
        std::size_t const words = SearchOfRanks::words(communicator_.size());
        search_.renew(words);
        search_.fill_bytes(0, words, 0);
        std::array const again{search(search_.data())};
        cuda::launch_after("search_step", this->queue_,
                           cuda::detail::search_step<cuda::detail::SearchHere<d, Number>, 1>,
                           again[0].groups(), cuda::detail::searching_threads, again, again[0].groups());
    }
    /// Lets all ranks request what any of them has; returns how many blocks that are, or more than there is
    /// room for. They are in `born_`, which need not be loaded from the device.
    std::uint32_t births_of_all_ranks(std::uint32_t own)
    {
        bool const lacks_room = !this->set_.has_room_for(own);
        Parcel parcel;
        put(parcel, lacks_room ? own : std::uint32_t{0});
        born_.clear();
        if (!lacks_room) born_ = this->set_.requested(own);
        put(parcel, born_.data(), born_.size());
        born_.clear();
        std::uint64_t most = 0;
        for (Parcel const& of_rank : communicator_.all_gather(parcel)) {
            Reader from(of_rank);
            most += from.template get<std::uint32_t>();
            while (!from.at_end()) born_.push_back(from.template get<std::uint64_t>());
        }
        if (most > 0) born_.clear();
        if (most > 0) return static_cast<std::uint32_t>(std::min<std::uint64_t>(most, std::uint32_t(-2)));
        this->set_.want(born_);
        std::ranges::sort(born_); // as they are numbered
        born_.erase(std::unique(born_.begin(), born_.end()), born_.end());
        return static_cast<std::uint32_t>(born_.size());
    }

    bool hear(SearchOfRanks const& found)
    {
        live_ = strays_of_all_ = births_ = 0;
        bool had_room = true;
        std::uint32_t most = 0; // if one rank had no room for so many, others soon have none
        int const ranks = communicator_.size(), own = communicator_.rank();
        leaving_.clear();
        coming_.clear();
        for (int rank = 0; rank < ranks; ++rank) {
            Searched const& searched = found.of(rank);
            had_room = had_room && searched.lacks_room == 0;
            most = std::max(most, searched.leavers);
            live_ += searched.live;
            strays_of_all_ += searched.strays;
            births_ += searched.births;
            leaving_.push_back(found.leaving(own, rank));
            coming_.push_back(found.leaving(rank, own));
        }
        searched_ = found.of(own);
        live_is_known_ = knows_live_here_ = true;
        are_swapped_ = had_room && are_packed_ && births_ == 0;
        for (int from = 0; are_swapped_ && from < ranks; ++from)
            for (int to = 0; to < ranks; ++to)
                are_swapped_ = are_swapped_ && found.leaving(from, to) <= room_of_packed_(from, to);
        if (had_room) {
            room_.count_step([&](int from, int to) { return found.leaving(from, to); });
            return true;
        }
        this->short_ = {1, most + most / 2, 0, 0}; // all ranks wait while items move again
        this->make_room();
        return false;
    }
    /// Called when strays have come to their ranks: none is left.
    void forget_strays()
    {
        strays_of_all_ = 0;
        leaving_.clear();
        coming_.clear();
        live_is_known_ = false;
    }

    /// Whether there are too many empty blocks beside so many live ones, as one device would find.
    bool are_crowded(std::size_t live) const
    {
        return live > 0 &&
               this->blocks() > live + cuda::detail::most_empty_blocks(static_cast<std::uint32_t>(live),
                                                                       is_small(), this->spreads());
    }
    /// The same of what is known before strays have arrived: each of them may have come into an empty block.
    bool may_be_crowded() const
    {
        constexpr std::size_t fewer_behind = 4097; // see most_empty_blocks
        return are_crowded(live_) ||
               (live_ < fewer_behind && live_ + strays_of_all_ >= fewer_behind && are_crowded(fewer_behind));
    }
    C communicator_;
    std::shared_ptr<Partition> partition_;
    Curve<d> curve_;
    OwnedBlocks of_all_;
    std::size_t all_ = 0;                                   ///< items of all ranks
    Searched searched_{};                                   ///< of the items that left their cells last
    std::size_t live_ = 0, births_ = 0, strays_of_all_ = 0; ///< the same of all ranks
    bool live_is_known_ = false, knows_live_here_ = false;
    cuda::Array<unsigned char> here_;
    cuda::Array<Stray> strays_;
    cuda::Array<std::uint32_t> search_, owners_;
    std::vector<std::uint32_t> own_;              ///< the blocks of this rank, in their order
    cuda::Array<std::uint32_t> blocks_here_;      ///< the same on the device
    cuda::HostMemory told_;                       ///< which ranks have blocks, on the way to the device
    std::size_t room_told_ = 0;                   ///< for so many blocks there
    std::vector<std::uint64_t> born_;             ///< keys of the blocks that were missing on any rank
    std::vector<std::uint32_t> items_;            ///< of each block here, when it was last weighed
    SharedResults shared_;                        ///< used of the first order of cells
    RoomForItems room_, room_of_packed_;          ///< in messages with strays
    bool are_packed_ = false;                     ///< strays have been sent by the latter
    bool are_swapped_ = false;                    ///< so have all of them, on all ranks
    std::vector<std::uint32_t> leaving_, coming_; ///< how many strays go to each rank, and come from there
    cuda::Array<std::uint32_t> count_;
};

} // namespace firn::distributed

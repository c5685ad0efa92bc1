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
#include <firn/distributed/swap_on_cuda.hpp>
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
        static constexpr bool forgets_incoming = true; // into other ranks' blocks none ever come
    };

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend, periods), communicator_(backend.communicator), partition_(backend.partition),
          here_(backend), strays_(backend), search_(backend), owners_(backend), told_(backend.queue()),
          shared_(backend.queue()), count_(backend), list_(backend), swap_(backend.queue()), origins_(backend)
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
            return place_on_curve<d>(this->periods_.wrapped(block_at(cells[i])));
        });
    }

    void insert(Coordinates<d> const* cells, std::size_t count, std::uint32_t first)
    {
        Local::insert(cells, count, first, [&] { return births_of_all_ranks(this->set_.births()); });
        find_owners();
        all_ = sum_of_ranks(communicator_, this->size());
        knows_live_here_ = false;
    }
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        Local::erase(gone, place, kept);
        knows_live_here_ = false;
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
    /// Queues the search for the new cells of items that have moved, which tells at `to` what SearchOfRanks
    /// has of a rank; zero before. The loop that moves items does not search, since it does not know which
    /// blocks are here.
    void search(std::uint32_t* to)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        strays_.renew(this->leavers_.most);
        auto* const searched = reinterpret_cast<Searched*>(to);
        cuda::launch_after("find_cells_here", this->queue_, cuda::detail::find_cells_here<d, Number>,
                           cuda::groups_of(this->leavers_.most, 256), 256, this->leavers(), destinations(),
                           owners_.data(), static_cast<std::uint32_t>(communicator_.rank()), strays_.data(),
                           searched, to + SearchOfRanks::words_of_searched);
        cuda::launch_after("tell_searched", this->queue_, cuda::detail::tell_searched,
                           cuda::groups_of(this->blocks(), 128), 128, this->leavers_.counters.data(),
                           static_cast<std::uint32_t>(this->leavers_.most), this->set_.born_count(),
                           this->changes(), this->blocks(), searched);
    }
    /// Reads what all ranks have found, which was shared by the first order of cells; returns whether all had
    /// room for their leavers. If not, makes it.
    bool hear(CellOrder const& first, std::size_t number)
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
            std::uint32_t const births = births_of_all_ranks(searched_.births);
            if (this->set_.has_room_for(births))
                this->reserve_blocks(static_cast<std::uint32_t>(before) + births);
            this->add_blocks(births);
            find_owners(before);
            search_.renew(words);
            search_.fill_bytes(0, words, 0);
            search(search_.data());
            auto const all = of_all_ranks(communicator_, downloaded(search_, words));
            hear({all.data(), words});
        }
    }

    /// See SharedResults.
    template <class Orders, class OfNodes, class OfItems>
    void share_results(Orders const& orders, OfNodes& of_nodes, OfItems& of_items, bool again)
    {
        shared_.share(communicator_, orders, of_nodes, of_items, again);
    }
    template <class OfNodes, class OfItems>
    bool had_room_for_results(OfNodes& of_nodes, OfItems& of_items)
    {
        return shared_.had_room(communicator_, of_nodes, of_items);
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
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        if (this->blocks() == 0) return by_rank;
        cuda::OnDevice const here(this->queue_);
        auto const strays = downloaded(strays_, searched_.strays);
        auto const contributions = contributions_of(strays);
        auto const channels = static_cast<std::size_t>(this->channels_);
        for (std::size_t i = 0; i < strays.size(); ++i) {
            auto const& stray = strays[i];
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
        auto const count = static_cast<std::uint32_t>(first - gone_.size() + came);
        sort_in(count, offset);
        fill_holes(*this, gone_, first + came, count, move);
        drop_empty_blocks();
        forget_strays();
    }
    /// Both in one, without the host, where nothing else has to travel with items. `fields(use)` calls
    /// `use(array)` for each array of the items. These have room for `first` items that were here and for
    /// coming() more; `offset` are some of them.
    template <class Fields>
    void swap_items(std::uint32_t first, std::array<Offset*, std::size_t(d)> const& offset,
                    Fields const& fields)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        auto const came = static_cast<std::uint32_t>(coming());
        if (strays_of_all_ > 0)
            swap_(communicator_, strays_, owners_.data(), this->leavers(), leaving_, coming_, fields);
        expect_arrivals(came, first);
        swap_.unpack(coming_, first, fields,
                     {origins_.data(), list_.data(),
                      this->leavers_.contribution.data() +
                          searched_.leavers * static_cast<std::size_t>(this->channels_)});
        let_in(came);
        std::uint32_t const gone = std::accumulate(leaving_.begin(), leaving_.end(), std::uint32_t{0});
        sort_in(first + came - gone, offset);
        swap_.fill_holes(first + came, first + came - gone, fields,
                         [&](std::uint32_t const* place) { relocate(first + came - gone, place); });
        drop_empty_blocks();
        forget_strays();
    }
    /// How many items come from other ranks.
    std::size_t coming() const { return std::accumulate(coming_.begin(), coming_.end(), std::size_t{0}); }

    /// Items that lay at places from `first` on lie at `place[where it lay - first]` now.
    void relocate(std::uint32_t first, std::vector<std::uint32_t> const& place)
    {
        list_.renew(place.size());
        list_.upload(0, place);
        relocate(first, list_.data());
    }
    void relocate(std::uint32_t first, std::uint32_t const* place)
    {
        for (auto const& [where, count] : {std::pair{this->order_.data(), this->size()},
                                           std::pair{this->leavers_.slot.data(), std::size_t{listed_}}})
            if (count > 0)
                cuda::launch_after("relocate", this->queue_, cuda::detail::relocate,
                                   cuda::groups_of(count, 256), 256, where, count, first, place);
    }

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
        auto const items = downloaded(count_, keys().size());
        for (std::size_t b = 0; b < items.size(); ++b)
            if (items[b] > 0)
                to.push_back(
                    {place_on_curve<d>(block_of_key<d>(keys()[b])), items[b] + Partition::weight_of_block});
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
        knows_live_here_ = false;
        listed_ = 0;
        fill_holes(*this, gone_, next, static_cast<std::uint32_t>(this->size()), move);
    }
    /// They have been taken with the blocks.
    template <class Layer>
    void take_tiles(Layer const&) const
    {}

    std::size_t memory() const
    {
        return Local::memory() + here_.memory() + strays_.memory() + origins_.memory() + swap_.memory() +
               shared_.memory();
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
    /// Finds out which rank has which block, after blocks or parts have changed; `kept` of the blocks that
    /// were known are as they were.
    void find_owners(std::size_t kept = 0)
    {
        std::vector<std::uint64_t> keys(this->blocks() - kept);
        this->set_.download_keys(kept, keys);
        of_all_.set(kept, keys, [&](std::uint64_t key) { return owner(block_of_key<d>(key)); });
        auto const owners = this->owners().subspan(kept);
        // the host has waited since these were copied last
        auto* const told = told_.template as<std::uint32_t>(2 * owners.size());
        auto* const here = reinterpret_cast<unsigned char*>(told + owners.size());
        for (std::size_t b = 0; b < owners.size(); ++b) {
            told[b] = static_cast<std::uint32_t>(owners[b]);
            here[b] = owners[b] == communicator_.rank();
        }
        owners_.resize(this->blocks());
        here_.resize(this->blocks());
        cuda::copy_queued(this->queue_, owners_.data() + kept, static_cast<std::uint32_t const*>(told),
                          owners.size());
        cuda::copy_queued(this->queue_, here_.data() + kept, static_cast<unsigned char const*>(here),
                          owners.size());
    }

    /// Lets all ranks request what any of them has; returns how many blocks that are, or more than there is
    /// room for.
    std::uint32_t births_of_all_ranks(std::uint32_t own)
    {
        bool const lacks_room = !this->set_.has_room_for(own);
        Parcel parcel;
        put(parcel, lacks_room ? own : std::uint32_t{0});
        std::vector<std::uint64_t> keys;
        if (!lacks_room) keys = this->set_.requested(own);
        put(parcel, keys.data(), keys.size());
        keys.clear();
        std::uint64_t most = 0;
        for (Parcel const& of_rank : communicator_.all_gather(parcel)) {
            Reader from(of_rank);
            most += from.template get<std::uint32_t>();
            while (!from.at_end()) keys.push_back(from.template get<std::uint64_t>());
        }
        if (most > 0) return static_cast<std::uint32_t>(std::min<std::uint64_t>(most, std::uint32_t(-2)));
        if (keys.empty()) return 0;
        this->set_.want(keys);
        return this->set_.births();
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
        if (had_room) return true;
        this->short_ = {1, most + most / 8, 0, 0};
        this->make_room();
        return false;
    }
    std::vector<Number> contributions_of(std::vector<Stray> const& strays)
    {
        std::vector<Number> contributions;
        auto const channels = static_cast<std::size_t>(this->channels_);
        if (strays.empty() || channels == 0) return contributions;
        auto const all = downloaded(this->leavers_.contribution, searched_.leavers * channels);
        for (auto const& stray : strays) {
            auto const* const own = all.data() + stray.leaver * channels;
            contributions.insert(contributions.end(), own, own + channels);
        }
        return contributions;
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
        auto const count = static_cast<std::uint32_t>(cells.size());
        expect_arrivals(count, first);
        if (count == 0) return 0;
        this->leavers_.contribution.upload(searched_.leavers * channels, contributions);
        origins_.upload(0, origins);
        list_.upload(0, cells);
        let_in(count);
        return count;
    }
    /// Makes room for what comes from other ranks, from place `first` on.
    void expect_arrivals(std::uint32_t count, std::uint32_t first)
    {
        listed_ = searched_.leavers + count;
        this->order_before_.renew(listed_);
        if (count == 0) return;
        this->leavers_.grow(listed_, this->channels_);
        origins_.renew(count);
        list_.renew(count);
        cuda::launch_after("number_from", this->queue_, cuda::detail::number_from,
                           cuda::groups_of(count, 256), 256, first, count,
                           this->leavers_.slot.data() + searched_.leavers);
    }
    /// Lets that into its cells, which are listed.
    void let_in(std::uint32_t count)
    {
        if (count == 0) return;
        cuda::launch_after("admit", this->queue_, cuda::detail::admit<Number>, cuda::groups_of(count, 256),
                           256, all_leavers(), count, list_.data(), this->changes());
    }
    /// Sorts all items into the new order, of which there are `count`.
    void sort_in(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        this->find_block_begins();
        this->offset_ = offset;
        this->rebinned_blocks_ = this->blocks();
        this->rearrange(all_leavers(), listed_, this->left_.data(), offset, count);
        this->left_.renew(std::max<std::size_t>(count, this->left_.size()));
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
        return live > 0 && this->blocks() > live + cuda::detail::most_empty_blocks(
                                                       static_cast<std::uint32_t>(live), is_small());
    }
    /// The same of what is known before strays have arrived: each of them may have come into an empty block.
    bool may_be_crowded() const
    {
        constexpr std::size_t fewer_behind = 4097; // see most_empty_blocks
        return are_crowded(live_) ||
               (live_ < fewer_behind && live_ + strays_of_all_ >= fewer_behind && are_crowded(fewer_behind));
    }
    /// Drops empty blocks where there are too many, as one device would.
    void drop_empty_blocks()
    {
        std::uint32_t const blocks = this->blocks();
        if (live_is_known_ && !may_be_crowded()) return;
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
    bool live_is_known_ = false, knows_live_here_ = false;
    std::uint32_t listed_ = 0;                           ///< leavers, and those that came from other ranks
    std::vector<std::uint32_t> gone_;                    ///< where items lay that have left for other ranks
    std::vector<std::uint32_t> begin_here_, order_here_; ///< copies, while blocks are handed over
    cuda::Array<unsigned char> here_;
    cuda::Array<Stray> strays_;
    cuda::Array<std::uint32_t> search_, owners_;
    cuda::HostMemory told_;                       ///< which ranks have blocks, on the way to the device
    SharedResults shared_;                        ///< used of the first order of cells
    std::vector<std::uint32_t> leaving_, coming_; ///< how many strays go to each rank, and come from there
    cuda::Array<std::uint32_t> count_, list_;
    SwapOfItems<Number, d> swap_;
    cuda::Array<std::uint64_t> origins_; ///< of what came
};

} // namespace firn::distributed

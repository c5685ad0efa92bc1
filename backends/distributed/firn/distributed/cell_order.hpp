// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/cell_work.hpp>
#include <firn/distributed/fill_holes.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/partition.hpp>
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
#include <type_traits>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The order of the cells that this rank has: that of the backend below, and what goes to other ranks and
/// comes from them. An item's contribution to the grid travels with it, and is scattered where it arrives.
template <class Local, class C, class Number, int d>
class CellOrder : public Local
{
public:
    using typename Local::Flow, typename Local::Leaver, typename Local::Offset;

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Local(backend.local, periods), communicator_(backend.communicator), partition_(backend.partition),
          curve_(partition_->lattice(), Local::extent)
    {}

    C const& communicator() const { return communicator_; }
    /// The rank that has a block of cells.
    int owner(Coordinates<d> const& block) const
    {
        return partition_->owner(curve_.place(this->periods().wrapped(block)));
    }

    /// The key of a cell's block, in the order in which blocks are visited.
    std::uint64_t block_of(Coordinates<d> const& cell) const
    {
        return block_key<d>(this->periods().wrapped(Local::block_and_place(cell).first));
    }

    /// Which of some cells this rank has. All ranks pass the same ones; the first time space is divided by
    /// them.
    std::vector<std::uint32_t> own(std::span<Coordinates<d> const> cells)
    {
        return partition_->own(communicator_, cells.size(), [&](std::size_t i) {
            return curve_.place(this->periods().wrapped(Local::block_and_place(cells[i]).first));
        });
    }

    /// What leaves for another rank: where the items lie, and what that rank's order needs of them.
    struct Departure
    {
        std::vector<std::uint32_t> places{};
        Parcel notes{};
    };
    /// Begins a rebin: returns what leaves, by rank. The items' values are still those before their offsets
    /// are wrapped.
    std::vector<Departure> depart(std::array<Offset*, std::size_t(d)> const& /*offset*/)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        gone_.clear();
        std::size_t const channels = Local::contribution_size();
        auto const rank_of = [&](Flow const& flow) {
            return partition_->owner(curve_.place(block_of_key<d>(flow.key)));
        };
        for (auto& to : by_rank) put(to.notes, std::uint64_t{channels});
        Local::divert([&](Flow const& flow) { return rank_of(flow) != communicator_.rank(); },
                      [&](Flow const& flow) {
                          auto& to = by_rank[static_cast<std::size_t>(rank_of(flow))];
                          put(to.notes, std::array<std::uint64_t, 3>{flow.from, flow.key, flow.count});
                          for (Leaver const& leaver : std::span(flow.first, flow.count)) {
                              put(to.notes, leaver.place);
                              put(to.notes, leaver.contribution, channels);
                              to.places.push_back(leaver.source);
                              gone_.push_back(leaver.source);
                          }
                      });
        return by_rank;
    }

    /// Ends the rebin: `notes` came from each rank with items that lie at `first` and behind it, rank by
    /// rank. Afterwards every item lies below size(); `move(from, to)` is called for those that must move for
    /// it. Offsets of what came are wrapped, too.
    template <class Move>
    void arrive(std::span<Parcel const> notes, std::uint32_t first,
                std::array<Offset*, std::size_t(d)> const& offset, Move const& move)
    {
        std::size_t const came = list_arrivals(notes, first);
        for (std::size_t place = first; place < first + came; ++place)
            for (int a = 0; a < d; ++a) CellOffset<Number>::wrap(offset[std::size_t(a)][place]);
        std::size_t const count = first - gone_.size() + came;
        Local::rebin_rest(offset, flows_, count);
        fill_holes(static_cast<Local&>(*this), gone_, first + came, static_cast<std::uint32_t>(count), move);
    }

    /// Adds what the blocks here weigh to a list.
    void weigh(std::vector<Partition::Weight>& to) const
    {
        for (auto const& block : this->blocks())
            to.push_back(
                {curve_.place(block.coordinates), block.end - block.begin + Partition::weight_of_block});
    }

    /// After space has been divided anew: what leaves for another rank with whole blocks, their order and
    /// their sums on a layer of the grid; by rank, as depart().
    template <class Layer>
    std::vector<Departure> hand_over(Layer const& layer)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        gone_.clear();
        kept_.clear();
        for (std::size_t b = 0; b < this->blocks().size(); ++b) {
            auto const block = Local::whole_block(b);
            int const to_rank = owner(this->blocks()[b].coordinates);
            if (to_rank == communicator_.rank()) {
                kept_.push_back(block);
                continue;
            }
            auto& to = by_rank[static_cast<std::size_t>(to_rank)];
            put(to.notes, std::array<std::uint64_t, 2>{block.key, block.sources.size()});
            put(to.notes, block.counts.data(), block.counts.size());
            layer.put_tile(b, to.notes);
            to.places.insert(to.places.end(), block.sources.begin(), block.sources.end());
            gone_.insert(gone_.end(), block.sources.begin(), block.sources.end());
        }
        return by_rank;
    }
    /// Takes over what came, as arrive(). `grid.activate()` follows, and then take_tiles().
    template <class Layer, class Move>
    void take_over(std::span<Parcel const> notes, std::uint32_t first, Layer const& layer, Move const& move)
    {
        std::uint32_t place = first;
        tiles_.clear();
        for (Parcel const& parcel : notes) {
            for (Reader from(parcel); !from.at_end();) {
                auto const [key, count] = from.template get<std::array<std::uint64_t, 2>>();
                typename Local::WholeBlock block{key, std::vector<std::uint32_t>(Local::Shape::cells),
                                                 std::vector<std::uint32_t>(count)};
                from.get(block.counts.data(), block.counts.size());
                std::iota(block.sources.begin(), block.sources.end(), place);
                place += static_cast<std::uint32_t>(count);
                tiles_.emplace_back(key, layer.copied_tile(from));
                kept_.push_back(std::move(block));
            }
        }
        std::ranges::sort(kept_, {}, &Local::WholeBlock::key);
        Local::replace_blocks(kept_);
        kept_.clear();
        fill_holes(static_cast<Local&>(*this), gone_, place, static_cast<std::uint32_t>(this->size()), move);
    }
    /// Writes the sums that came with blocks to a layer.
    template <class Layer>
    void take_tiles(Layer const& layer)
    {
        for (auto const& [key, tile] : tiles_) {
            auto const at = std::ranges::lower_bound(
                this->blocks(), key, {}, [](auto const& block) { return block_key<d>(block.coordinates); });
            layer.set_tile(static_cast<std::size_t>(at - this->blocks().begin()), tile);
        }
        tiles_.clear();
    }

    /// Merges the results of the blocks of all ranks.
    template <class Result>
    Result merged(std::span<Result const> of_blocks) const
    {
        if constexpr (std::is_same_v<Result, NothingFound>)
            return {};
        else {
            std::vector<Part<Result>> parts;
            parts.reserve(of_blocks.size());
            for (std::size_t b = 0; b < of_blocks.size(); ++b)
                parts.push_back({0, block_key<d>(this->blocks()[b].coordinates), of_blocks[b]});
            return merge_over_ranks(communicator_, std::move(parts));
        }
    }

private:
    /// Lists what came as flows; returns how many items.
    std::size_t list_arrivals(std::span<Parcel const> notes, std::uint32_t first)
    {
        struct Begin
        {
            std::uint64_t from, key;
            std::size_t item, count;
        };
        std::vector<Begin> begins;
        arrived_.clear();
        contributions_.clear();
        std::vector<std::size_t> contribution; // where that of each item begins
        for (Parcel const& parcel : notes) {
            if (parcel.empty()) continue; // this rank's own
            Reader from(parcel);
            auto const channels = static_cast<std::size_t>(from.template get<std::uint64_t>());
            while (!from.at_end()) {
                auto const [block, key, count] = from.template get<std::array<std::uint64_t, 3>>();
                begins.push_back({block, key, arrived_.size(), static_cast<std::size_t>(count)});
                for (std::uint64_t i = 0; i < count; ++i) {
                    Leaver item{first + static_cast<std::uint32_t>(arrived_.size()),
                                from.template get<decltype(Leaver::place)>(), 0, nullptr};
                    contribution.push_back(contributions_.size());
                    contributions_.resize(contributions_.size() + channels);
                    from.get(contributions_.data() + contribution.back(), channels);
                    arrived_.push_back(item);
                }
            }
        }
        for (std::size_t i = 0; i < arrived_.size(); ++i)
            arrived_[i].contribution = contributions_.data() + contribution[i];
        flows_.clear();
        for (Begin const& begin : begins)
            flows_.push_back({begin.from, begin.key, arrived_.data() + begin.item,
                              static_cast<std::uint32_t>(begin.count), -1});
        return arrived_.size();
    }

    C communicator_;
    std::shared_ptr<Partition> partition_;
    Curve<d> curve_;
    std::vector<std::uint32_t> gone_; ///< where items lay that have left for other ranks
    std::vector<Leaver> arrived_;     ///< what came in the last rebin, flow by flow
    std::vector<Number> contributions_;
    std::vector<Flow> flows_;
    std::vector<typename Local::WholeBlock> kept_;
    std::vector<std::pair<std::uint64_t, Parcel>> tiles_; ///< of blocks that came
};

} // namespace firn::distributed

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/grid/nodes_of_devices.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// The memory of SurfacePoints, kept for later steps. Between steps no point reaches a node.
template <class Backend, class Number, int d>
class SurfaceMemory
{
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    explicit SurfaceMemory(Backend const& backend)
        : nodes_of_ranks(backend), backend_(backend), counts_(backend), candidates_(backend), seen_(backend),
          candidate_table_(backend), points_(backend), before_(backend), table_(backend),
          table_before_(backend), to_list_(backend), tried_(backend), stencils_(backend), acting_(backend),
          ranks_(backend), points_of_nodes_(backend), reached_(backend), indices_(backend),
          velocities_(backend), of_nodes_(backend)
    {
        counts_.resize(all_counts);
        counts_.fill(0, all_counts, 0);
        candidates_.resize(256);
        seen_.resize(256);
        points_.resize(256);
    }

    /// A call begins, with a list of so many obstacles, which are at rest or move at most so fast [m/s]. What
    /// it does depends on the state before it alone. `numbers` are those among the obstacles of their worlds
    /// if each is in one world, else empty.
    void begin_call(std::size_t obstacles, bool are_at_rest, double largest_speed,
                    std::vector<std::uint32_t> numbers)
    {
        forget();
        obstacles_ = static_cast<std::uint32_t>(obstacles);
        are_at_rest_ = are_at_rest;
        largest_speed_ = largest_speed;
        numbers_ = std::move(numbers);
        is_joined_ = false;
    }
    /// Takes over another list of the call, whose obstacles follow: from now on that memory has no points,
    /// and no say in how many steps a batch has.
    void join(SurfaceMemory& other)
    {
        are_at_rest_ = are_at_rest_ && other.are_at_rest_;
        largest_speed_ = std::max(largest_speed_, other.largest_speed_);
        if (!numbers_.empty() || !other.numbers_.empty()) {
            for (auto i = static_cast<std::uint32_t>(numbers_.size()); i < obstacles_; ++i)
                numbers_.push_back(i);
            for (std::uint32_t i = 0; i < other.obstacles_; ++i)
                numbers_.push_back(obstacles_ + other.number_of(i));
        }
        obstacles_ += other.obstacles_;
        other.is_joined_ = true;
    }
    /// The number of an obstacle for the user: where each is in one world, those before its list and those
    /// before it in its world count.
    std::uint32_t number_of(std::uint32_t obstacle) const
    {
        return numbers_.empty() ? obstacle : numbers_[obstacle];
    }
    /// How fast obstacles move at most [m/s]: see Obstacles::largest_speed().
    double largest_speed() const { return largest_speed_; }
    /// Whether sweeps start from the impulses of the step before.
    bool goes_on() const { return known_ > 0; }
    /// Before a step, the first of a batch or a later one. It goes on with the points of the step before. Now
    /// and then the first one finds points anew, since those are among them that were points once.
    void begin_step(bool is_first)
    {
        if (is_first) step_before_ = step_, counts_are_zero_ = false;
        ++step_;
        bool const finds_all = is_first && is_to_find_all();
        first_new_ = finds_all ? 0 : known_;
        if (finds_all || !are_at_rest_) enter_points();
        if (!finds_all) return;
        points_.swap(before_);
        if (points_.size() < before_.size()) points_.resize(before_.size(), 0);
        table_.swap(table_before_);
        before_mask_ = mask_of(table_size_);
        entered_points_ = 0;
        table_size_ = 0;
        found_all_ = step_;
        known_candidates_ = 0;
        ++numbered_;
        entered_ = 0;
        have_nodes_ = false;
    }
    /// How many steps a batch may have: the first one is to find all points, if any is. After a step with new
    /// points others often have some, too.
    int most_steps() const
    {
        if (is_joined_) return steps_between;
        std::uint32_t const left =
            is_to_find_all() ? steps_between : found_all_ + steps_between - (step_ + 1);
        return static_cast<int>(std::clamp<std::uint32_t>(4 * quiet_, 1, left));
    }
    /// Lets the nodes of a grid note which candidates they are, so that a step need not find that out again:
    /// while obstacles are at rest, and nodes keep their indices and candidates their numbers.
    void note_candidates_of(std::size_t nodes, std::uint64_t numbering)
    {
        finds_ahead_ = false;
        if (!are_at_rest_) return;
        if (noted_ == std::pair(numbering, numbered_) && of_nodes_.size() >= nodes) return;
        if (of_nodes_.size() < nodes) of_nodes_.resize(nodes + nodes / 4);
        of_nodes_.fill(0, of_nodes_.size(), {});
        noted_ = {numbering, numbered_};
        finds_ahead_ = true;
    }
    /// Whether nodes without mass are candidates in this step, see FindCandidates: once, when a grid has
    /// other nodes than before.
    bool finds_ahead() const { return finds_ahead_; }
    /// Before points are looked for: none is counted.
    void begin()
    {
        if (!counts_are_zero_) counts_.fill(0, 2, 0);
        counts_are_zero_ = false;
    }
    /// The batch stops where anything has been counted, so that later steps of it count from nothing.
    void stop_if_counted() { counts_are_zero_ = true; }
    /// Whether points of the step are to be looked for: in a later one of a batch new candidates stop it, and
    /// others stay where they are unless walls move.
    bool looks_at_candidates(bool is_first) const { return is_first || may_move(); }
    /// Whether a step that the host does not take part in knows what may become a point: where walls move and
    /// none is known, it does not.
    bool can_go_on() const { return are_at_rest_ || known_ > 0; }
    /// Where loops count what is new, two numbers, and where one is set if that stopped a batch.
    std::uint32_t* counts_of_new() { return counts_.data(); }
    std::uint32_t* stopped() { return counts_.data() + place_of_stopped; }
    /// Lets the batch stop before this step.
    void stop() { counts_.fill(0, 1, 1); }
    /// Whether it stopped: see stopped(). After fetch_counts().
    bool has_stopped()
    {
        if (is_joined_ || counts_.read()[place_of_stopped] == 0) return false;
        counts_.fill(place_of_stopped, 1, 0);
        return true;
    }
    /// On several ranks, after candidates have been found that had room: all ranks get those of all, by the
    /// same numbers.
    void share_candidates()
    {
        std::size_t const first = known_candidates_;
        if (first > 0) {
            std::vector<std::uint32_t> seen(first), numbers;
            seen_.download(0, seen);
            for (std::uint32_t i = 0; i < first; ++i)
                if (seen[i] == step_) numbers.push_back(i);
            for (auto const i : detail::of_all_ranks(backend_, std::move(numbers))) seen[i] = step_;
            seen_.upload(0, seen);
        }
        std::vector<SurfaceCandidate<d>> found(counted().candidates);
        candidates_.download(first, found);
        found = detail::of_all_ranks(backend_, std::move(found));
        std::sort(found.begin(), found.end()); // nodes at borders are found on both sides
        found.erase(std::unique(found.begin(), found.end()), found.end());
        auto const count = static_cast<std::uint32_t>(found.size());
        had_room({count, 0, 0});
        candidates_.upload(first, found);
        seen_.fill(first, found.size(), step_);
        counts_.fill(0, 1, count);
    }
    /// On several ranks: the nodes that points reach, with what all ranks know of them.
    std::conditional_t<spans_devices<Backend>, NodesOfDevices<Backend, Number, d>, NodesOfRanks<Number, d>>
        nodes_of_ranks;
    /// The number of the first point that the step before did not have.
    std::uint32_t first_new() const { return first_new_; }
    /// After points have been found. Returns how many there are.
    std::uint32_t note(SurfaceCounts const& found)
    {
        reached_before_ = found.reached;
        std::uint32_t const points = first_new_ + found.points;
        if (first_new_ == 0) most_known_ = points + points / 4 + 64;
        known_candidates_ += found.candidates;
        // points at rest are known ahead of material; others often follow new ones
        quiet_ = found.candidates + found.points > 0 ? std::uint32_t(are_at_rest_) : quiet_ + 1;
        if (found.candidates == 0) return points;
        std::size_t const size = std::bit_ceil(2 * std::size_t(known_candidates_) + 1);
        if (entered_ == 0 || candidate_table_size_ < size) {
            candidate_table_size_ = 2 * size;
            if (candidate_table_.size() < candidate_table_size_)
                candidate_table_.resize(candidate_table_size_, 0);
            candidate_table_.fill(0, candidate_table_size_, 0);
            entered_ = 0;
        }
        backend_.for_each(known_candidates_ - entered_,
                          KnownCandidates<d>{candidates_.data(), candidate_table_.data(),
                                             static_cast<std::uint32_t>(candidate_table_size_ - 1),
                                             entered_});
        entered_ = known_candidates_;
        return points;
    }
    /// Whether points that the step before had may have moved.
    bool may_move() const { return first_new_ > 0 && !are_at_rest_; }
    /// How many candidates are looked at: those that are new, or all.
    std::size_t looked_at() { return most_candidates() + (may_move() ? known_candidates_ : 0); }
    /// How many candidates may have been found; waits for no loop.
    std::size_t most_candidates()
    {
        std::size_t const room = candidates_.size() - known_candidates_;
        return Backend::queues ? room : std::min<std::size_t>(counted().candidates, room);
    }
    /// How many nodes points reached when points were counted last.
    std::size_t reached_before() const { return reached_before_; }
    /// How many nodes points may reach, if so many are new at most; waits for no loop.
    std::size_t most_reached(std::size_t most_new)
    {
        most_reached_ =
            Backend::queues ? std::min(reached_before_ + most_new, reached_.size()) : counted().reached;
        return most_reached_;
    }
    /// What most_reached() was in the step before.
    std::size_t reached_at_most() const { return most_reached_; }
    /// After loops have been queued that count: what is queued from now on keeps counted() from nothing.
    void fetch_counts()
    {
        if (!is_joined_) counts_.fetch();
    }
    /// What loops have counted; waits for them.
    SurfaceCounts counted()
    {
        std::uint32_t const* const counts = counts_.read();
        return {counts[0], counts[1], counts[2]};
    }
    /// Whether what was found had room. Else there is room now to look for it again.
    bool had_room(SurfaceCounts const& found)
    {
        bool had = true;
        auto const make_room = [&](auto& array, std::uint32_t count) {
            if (count <= array.size()) return;
            array.resize(count + count / 4);
            had = false;
        };
        make_room(candidates_, known_candidates_ + found.candidates);
        make_room(points_, first_new_ + found.points);
        if (seen_.size() < candidates_.size()) seen_.resize(candidates_.size());
        return had;
    }
    /// Whether the points of the step before have their stencils.
    bool have_nodes() const { return have_nodes_; }
    /// After points have forgotten their nodes: none reaches any.
    void forget_nodes()
    {
        reached_before_ = 0;
        counts_.fill(2, 1, 0);
    }
    /// Whether their nodes have the indices that they had then, by the grid's numbering.
    bool have_indices(std::uint64_t numbering) const { return numbering == numbering_; }
    /// Makes room for the stencils of so many points, with so many nodes each, of which so many are reached
    /// by none as yet, in a grid of so many nodes.
    void make_room(std::size_t points, std::size_t nodes_of_each, std::size_t most_new, std::size_t nodes,
                   std::uint64_t numbering)
    {
        constexpr std::size_t tile = SurfacePoints<Number, d>::tile;
        auto const make_room_for = [](auto& array, std::size_t size) {
            if (array.size() < size) array.resize(size + size / 4);
        };
        std::size_t const in_tiles = (points + tile - 1) / tile * tile * nodes_of_each;
        make_room_for(to_list_, points);
        make_room_for(tried_, points);
        make_room_for(stencils_, in_tiles);
        make_room_for(acting_, in_tiles);
        make_room_for(ranks_, in_tiles);
        make_room_for(points_of_nodes_, points * nodes_of_each);
        make_room_for(reached_, reached_before_ + most_new);
        if (velocities_.size() <= reached_.size()) {
            velocities_.resize(reached_.size() + 1);
            velocities_.fill(0, 1, VectorAndNumber<Number, d>{});
        }
        counts_.fill(3, 2, 0);
        have_nodes_ = true;
        numbering_ = numbering;
        if (indices_.size() >= nodes) return;
        std::size_t const before = indices_.size();
        make_room_for(indices_, nodes);
        indices_.fill(before, indices_.size() - before, {0, 0});
    }
    /// After a step with so many points.
    void end_step(std::uint32_t points) { known_ = points; }
    /// See GroupMemory::end. Steps that were queued and not taken have left no trace.
    void end_batch(int taken, bool failed, double dt)
    {
        step_ = step_before_ + static_cast<std::uint32_t>(taken) + (failed ? 1 : 0);
        step_before_ = step_;
        if (taken > 1) quiet_ += static_cast<std::uint32_t>(taken - 1);
        if (taken == 0 || failed)
            forget();
        else
            dt_ = static_cast<Number>(dt);
    }
    std::uint32_t known() const { return known_; } ///< points of the step before
    Number dt_before() const { return dt_; }       ///< the length of the last step of the batch before [s]
    /// The points of the last step, on the host.
    std::vector<SurfacePoint<Number, d>> last() const
    {
        std::vector<SurfacePoint<Number, d>> points(known_);
        if (known_ > 0) points_.download(0, points);
        return points;
    }

    SurfacePoints<Number, d> view()
    {
        std::uint32_t* const counts = counts_.data();
        return {counts,
                counts + 1,
                counts + 2,
                counts + 3,
                counts + 4,
                known_candidates(),
                candidates_.data(),
                seen_.data(),
                step_,
                are_at_rest_,
                first_new_,
                points_.data(),
                static_cast<std::uint32_t>(candidates_.size()),
                static_cast<std::uint32_t>(points_.size()),
                to_list_.data(),
                tried_.data(),
                stencils_.data(),
                acting_.data(),
                ranks_.data(),
                points_of_nodes_.data(),
                reached_.data(),
                indices_.data(),
                velocities_.data(),
                {points_.data(), table_.data(), may_move() ? mask_of(table_size_) : 0, entered_points_},
                {before_.data(), table_before_.data(), before_mask_, known_},
                are_at_rest_ && of_nodes_.size() > 0 ? of_nodes_.data() : nullptr};
    }

private:
    static constexpr std::size_t place_of_stopped = 5, all_counts = 6;
    static constexpr std::uint32_t steps_between = 64; ///< those that find all points

    /// Forgets the impulses of the step before.
    void forget()
    {
        known_ = known_candidates_ = entered_points_ = 0;
        ++numbered_;
        table_size_ = 0;
    }
    /// Whether the next step finds all points.
    bool is_to_find_all() const
    {
        return known_ == 0 || known_ > most_known_ || step_ + 1 - found_all_ >= steps_between;
    }
    static std::uint32_t mask_of(std::size_t size)
    {
        return size > 0 ? static_cast<std::uint32_t>(size - 1) : 0;
    }

    /// The points of the step before go into the table.
    void enter_points()
    {
        std::size_t const size = std::bit_ceil(2 * std::size_t(known_) + 1);
        if (table_size_ < size || entered_points_ > known_) {
            table_size_ = 2 * size;
            if (table_.size() < table_size_) table_.resize(table_size_, 0);
            table_.fill(0, table_size_, 0);
            entered_points_ = 0;
        }
        backend_.for_each(
            known_ - entered_points_,
            KnownPoints<Number, d>{points_.data(), table_.data(), mask_of(table_size_), entered_points_});
        entered_points_ = known_;
    }
    KnownCandidates<d> known_candidates()
    {
        return {candidates_.data(), candidate_table_.data(),
                entered_ > 0 ? static_cast<std::uint32_t>(candidate_table_size_ - 1) : 0, known_candidates_};
    }

    Backend backend_;
    std::uint32_t obstacles_ = 0;
    bool are_at_rest_ = false, is_joined_ = false; ///< see begin_call() and join()
    double largest_speed_ = 0;
    std::vector<std::uint32_t> numbers_; ///< see number_of()
    /// Those of SurfaceCounts, SurfacePoints::listed and changes, and stopped().
    typename Backend::template ReadbackBuffer<std::uint32_t> counts_;
    Array<SurfaceCandidate<d>> candidates_;
    Array<std::uint32_t> seen_, candidate_table_;
    Array<SurfacePoint<Number, d>> points_, before_;
    Array<std::uint32_t> table_, table_before_;
    std::size_t table_size_ = 0;
    std::uint32_t entered_points_ = 0, before_mask_ = 0;
    std::uint32_t known_ = 0;                          ///< the points of the step before
    std::uint32_t known_candidates_ = 0, entered_ = 0; ///< and how many of these are in the table
    std::size_t candidate_table_size_ = 0;
    std::uint32_t first_new_ = 0, most_known_ = 0; ///< points
    std::uint32_t step_ = 0, found_all_ = 0;       ///< this one, and that in which all points were found
    std::uint32_t quiet_ = 0;                      ///< steps since one with new points
    std::uint32_t step_before_ = 0;                ///< the one before the batch
    bool have_nodes_ = false, counts_are_zero_ = false, finds_ahead_ = false;
    std::size_t reached_before_ = 0, most_reached_ = 0;
    std::uint64_t numbering_ = 0;
    Number dt_ = 1; ///< its length [s]
    Array<unsigned char> to_list_;
    Array<VectorAndNumber<Number, d>> tried_;
    Array<NodeOfPoint<Number>> stencils_, acting_;
    Array<std::uint32_t> ranks_;
    Array<PointOfNode<Number>> points_of_nodes_;
    Array<NodeAtSurface<Number, d>> reached_;
    Array<ReachedIndex> indices_;
    Array<VectorAndNumber<Number, d>> velocities_;
    Array<CandidatesOfNode> of_nodes_;
    std::uint64_t numbered_ = 1; ///< how often candidates have been numbered anew
    std::pair<std::uint64_t, std::uint64_t>
        noted_{}; ///< the numbering of the nodes that note theirs, and that
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/surface_points.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
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
        : backend_(backend), counts_(backend), reach_(backend), candidates_(backend), seen_(backend),
          candidate_table_(backend), points_(backend), before_(backend), table_(backend), tried_(backend),
          stencils_(backend), acting_(backend), ranks_(backend), points_of_nodes_(backend), reached_(backend),
          lists_(backend), velocities_(backend)
    {
        counts_.resize(1);
        reach_.resize(2);
        reach_.fill(0, 2, 0);
        candidates_.resize(256);
        seen_.resize(256);
        points_.resize(256);
    }

    /// Forgets the impulses of the step before: it was not taken, or a call begins. What a call does then
    /// depends on the state before it alone.
    void forget() { known_ = known_candidates_ = 0; }
    bool is_at_rest = false; ///< whether no obstacle moves in this call
    /// Of obstacles that are in one world each: their numbers among those of their world. Empty for others.
    std::vector<std::uint32_t> numbers_in_worlds;
    /// Takes over what these say of another list of the call, whose obstacles follow.
    void join(SurfaceMemory& other)
    {
        is_at_rest = is_at_rest && other.is_at_rest;
        auto& numbers = other.numbers_in_worlds;
        numbers_in_worlds.insert(numbers_in_worlds.end(), numbers.begin(), numbers.end());
        numbers.clear();
    }
    /// Whether sweeps start from the impulses of the step before.
    bool goes_on() const { return known_ > 0; }
    /// Before a step. While obstacles are at rest it goes on with the points of the step before. Now and then
    /// points are found anew, since those are among them that were points once.
    void begin_step()
    {
        ++step_;
        bool const finds_all = !is_at_rest || known_ == 0 || known_ > most_known_ || step_ - found_all_ >= 64;
        first_new_ = finds_all ? 0 : known_;
        if (!finds_all) return;
        points_.swap(before_);
        if (points_.size() < before_.size()) points_.resize(before_.size(), 0);
        std::size_t const size = std::bit_ceil(2 * std::size_t(known_) + 1);
        if (table_.size() < size) table_.resize(size, 0);
        table_.fill(0, size, 0);
        before_view_ = {before_.data(), table_.data(), static_cast<std::uint32_t>(size - 1)};
        backend_.for_each(known_, before_view_);
        found_all_ = step_;
        known_candidates_ = 0;
        entered_ = 0;
        have_nodes_ = false;
    }
    /// Before points are looked for: nothing is counted.
    void begin() { counts_.fill(0, 1, SurfaceCounts{}); }
    /// The number of the first point that the step before did not have.
    std::uint32_t first_new() const { return first_new_; }
    /// After points have been found. Returns how many there are.
    std::uint32_t note(SurfaceCounts const& found)
    {
        std::uint32_t const points = first_new_ + found.points;
        if (first_new_ == 0) most_known_ = points + points / 4 + 64;
        known_candidates_ += found.candidates;
        if (!is_at_rest || found.candidates == 0) return points;
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
    /// How many candidates may have been found; waits for no loop.
    std::size_t most_candidates() const
    {
        std::size_t const room = candidates_.size() - known_candidates_;
        return Backend::queues ? room : std::min<std::size_t>(counted().candidates, room);
    }
    /// How many nodes points may have reached when room was made for them last.
    std::size_t most_reached_before() const { return most_reached(reached_.size()); }
    /// How many nodes points may reach, of so many at most; waits for no loop.
    std::size_t most_reached(std::size_t at_most) const
    {
        if (Backend::queues) return at_most;
        std::uint32_t nodes = 0;
        reach_.download(0, {&nodes, 1});
        return nodes;
    }
    /// What loops have counted; waits for them.
    SurfaceCounts counted() const
    {
        SurfaceCounts counts;
        counts_.download(0, {&counts, 1});
        return counts;
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
    /// Whether points that the step before had reach the same nodes as then, whose indices have this
    /// numbering.
    bool have_nodes(std::uint64_t numbering) const { return have_nodes_ && numbering == numbering_; }
    /// Makes room for the stencils of so many points, with so many nodes each, among so many nodes in all.
    /// Room is made for all if no point has any yet.
    void make_room(std::size_t points, std::size_t nodes_of_each, std::size_t nodes, std::uint64_t numbering)
    {
        constexpr std::size_t tile = SurfacePoints<Number, d>::tile;
        auto const make_room_for = [](auto& array, std::size_t size) {
            if (array.size() < size) array.resize(size + size / 4);
        };
        std::size_t const in_tiles = (points + tile - 1) / tile * tile * nodes_of_each;
        make_room_for(tried_, points);
        make_room_for(stencils_, in_tiles);
        make_room_for(acting_, in_tiles);
        make_room_for(ranks_, in_tiles);
        make_room_for(points_of_nodes_, points * nodes_of_each);
        make_room_for(reached_, std::min(points * nodes_of_each, nodes));
        if (!have_nodes(numbering)) reach_.fill(0, 1, 0);
        reach_.fill(1, 1, 0);
        have_nodes_ = true;
        numbering_ = numbering;
        if (lists_.size() >= nodes + 1) return;
        make_room_for(velocities_, nodes + 1);
        make_room_for(lists_, nodes + 1);
        velocities_.fill(0, 1, VectorAndNumber<Number, d>{});
        lists_.fill(0, lists_.size(), {0, 0});
    }
    /// After a step with so many points, of this length [s].
    void end_step(std::uint32_t points, double dt)
    {
        known_ = points;
        dt_ = dt;
    }
    double dt_before() const { return dt_; } ///< [s]
    /// The points of the last step, on the host.
    std::vector<SurfacePoint<Number, d>> last() const
    {
        std::vector<SurfacePoint<Number, d>> points(known_);
        if (known_ > 0) points_.download(0, points);
        return points;
    }

    SurfacePoints<Number, d> view()
    {
        return {counts_.data(),
                reach_.data(),
                reach_.data() + 1,
                known_candidates(),
                candidates_.data(),
                seen_.data(),
                step_,
                first_new_,
                points_.data(),
                static_cast<std::uint32_t>(candidates_.size()),
                static_cast<std::uint32_t>(points_.size()),
                tried_.data(),
                stencils_.data(),
                acting_.data(),
                ranks_.data(),
                points_of_nodes_.data(),
                reached_.data(),
                lists_.data(),
                velocities_.data(),
                before_view_};
    }

private:
    KnownCandidates<d> known_candidates()
    {
        return {candidates_.data(), candidate_table_.data(),
                entered_ > 0 ? static_cast<std::uint32_t>(candidate_table_size_ - 1) : 0, known_candidates_};
    }

    Backend backend_;
    Array<SurfaceCounts> counts_; ///< one
    Array<std::uint32_t> reach_;  ///< how many nodes points reach, and how often
    Array<SurfaceCandidate<d>> candidates_;
    Array<std::uint32_t> seen_, candidate_table_;
    Array<SurfacePoint<Number, d>> points_, before_;
    Array<std::uint32_t> table_;
    PointsBefore<Number, d> before_view_{};
    std::uint32_t known_ = 0;                          ///< the points of the step before
    std::uint32_t known_candidates_ = 0, entered_ = 0; ///< and how many of these are in the table
    std::size_t candidate_table_size_ = 0;
    std::uint32_t first_new_ = 0, most_known_ = 0; ///< points
    std::uint32_t step_ = 0, found_all_ = 0;       ///< this one, and that in which all points were found
    bool have_nodes_ = false;
    std::uint64_t numbering_ = 0;
    double dt_ = 1; ///< its length [s]
    Array<VectorAndNumber<Number, d>> tried_;
    Array<NodeOfPoint<Number>> stencils_, acting_;
    Array<std::uint32_t> ranks_;
    Array<PointOfNode<Number>> points_of_nodes_;
    Array<NodeAtSurface<Number, d>> reached_;
    Array<PointsOfNode> lists_;
    Array<VectorAndNumber<Number, d>> velocities_;
};

} // namespace firn

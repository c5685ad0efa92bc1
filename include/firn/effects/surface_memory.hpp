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
        : backend_(backend), counts_(backend), candidates_(backend), points_(backend), before_(backend),
          table_(backend), tried_(backend), stencils_(backend), ranks_(backend), points_of_nodes_(backend),
          reached_(backend), lists_(backend), velocities_(backend)
    {
        counts_.resize(1);
        candidates_.resize(256);
        points_.resize(256);
    }

    /// Forgets the impulses of the step before: it was not taken, or a call begins. What a call does then
    /// depends on the state before it alone.
    void forget() { known_ = 0; }
    /// Of obstacles that are in one world each: their numbers among those of their world. Empty for others.
    std::vector<std::uint32_t> numbers_in_worlds;
    /// Whether sweeps start from the impulses of the step before.
    bool goes_on() const { return known_ > 0; }
    /// Before a step: the points of the last one become those before it.
    void begin_step()
    {
        points_.swap(before_);
        if (points_.size() < before_.size()) points_.resize(before_.size(), 0);
        std::size_t const size = std::bit_ceil(2 * std::size_t(known_) + 1);
        if (table_.size() < size) table_.resize(size, 0);
        table_.fill(0, size, 0);
        before_view_ = {before_.data(), table_.data(), static_cast<std::uint32_t>(size - 1)};
        backend_.for_each(known_, before_view_);
    }
    /// Before points are looked for: nothing is counted.
    void begin() { counts_.fill(0, 1, SurfaceCounts{}); }
    /// How many candidates may have been found; waits for no loop.
    std::size_t most_candidates() const
    {
        return Backend::queues ? candidates_.size()
                               : std::min<std::size_t>(counted().candidates, candidates_.size());
    }
    /// How many nodes points may reach, of so many at most; waits for no loop.
    std::size_t most_reached(std::size_t at_most) const
    {
        return Backend::queues ? at_most : counted().nodes;
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
            array.resize(count + count / 4, 0);
            had = false;
        };
        make_room(candidates_, found.candidates);
        make_room(points_, found.points);
        return had;
    }
    /// Makes room for the stencils of so many points, with so many nodes each, among so many nodes in all.
    void make_room(std::size_t points, std::size_t nodes_of_each, std::size_t nodes)
    {
        constexpr std::size_t tile = SurfacePoints<Number, d>::tile;
        auto const make_room_for = [](auto& array, std::size_t size) {
            if (array.size() < size) array.resize(size + size / 4, 0);
        };
        std::size_t const in_tiles = (points + tile - 1) / tile * tile * nodes_of_each;
        make_room_for(tried_, points);
        make_room_for(stencils_, in_tiles);
        make_room_for(ranks_, in_tiles);
        make_room_for(points_of_nodes_, points * nodes_of_each);
        make_room_for(reached_, std::min(points * nodes_of_each, nodes));
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
                candidates_.data(),
                points_.data(),
                static_cast<std::uint32_t>(candidates_.size()),
                static_cast<std::uint32_t>(points_.size()),
                tried_.data(),
                stencils_.data(),
                ranks_.data(),
                points_of_nodes_.data(),
                reached_.data(),
                lists_.data(),
                velocities_.data(),
                before_view_};
    }

private:
    Backend backend_;
    Array<SurfaceCounts> counts_; ///< one
    Array<SurfaceCandidate<d>> candidates_;
    Array<SurfacePoint<Number, d>> points_, before_;
    Array<std::uint32_t> table_;
    PointsBefore<Number, d> before_view_{};
    std::uint32_t known_ = 0; ///< the points of the step before
    double dt_ = 1;           ///< its length [s]
    Array<VectorAndNumber<Number, d>> tried_;
    Array<NodeOfPoint<Number>> stencils_;
    Array<std::uint32_t> ranks_;
    Array<PointOfNode<Number>> points_of_nodes_;
    Array<NodeAtSurface<Number, d>> reached_;
    Array<PointsOfNode> lists_;
    Array<VectorAndNumber<Number, d>> velocities_;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>
#include <firn/sampling/interior.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{

/// Throws darts into a box; a dart stays if it is no closer than `radius` to one that stayed.
///
/// The cells of a grid are so small (diagonal = radius) that each holds one point at most, and cells three
/// apart cannot disturb one another. So cells with the same indices modulo three form a phase, in which all
/// darts are thrown at the same time, after L.-Y. Wei, *Parallel Poisson disk sampling* (2008). A round
/// visits the 27 phases in random order and throws one dart at each cell that still has room for one.
class DartThrowing
{
public:
    DartThrowing(Eigen::AlignedBox3d const& box, double radius, std::uint64_t seed)
        : lowest_(box.min().array() - radius), radius_(radius),
          size_(Eigen::Array3d::Constant(radius / std::sqrt(3.0))), random_(seed)
    {
        Eigen::Array3d cells = ((box.sizes().array() + 2 * radius) / size_).ceil();
        for (int i = 0; i < 3; ++i)
            if (box.sizes()[i] < size_[i]) { // a sheet: darts beside it would be wasted
                lowest_[i] = box.min()[i];
                size_[i] = box.sizes()[i];
                cells[i] = 1;
            }
        if (!(cells.prod() <= most_cells))
            throw Error{
                "this needs more than 5e8 cells of memory", "poisson_disk_points",
                "Ask for fewer points (a larger radius), or split a solid that leaves most of its box "
                "empty." +
                    about_units(box)};
        // With a rim of empty cells the search for neighbours needs no checks of indices.
        for (int i = 0; i < 3; ++i) count_[std::size_t(i)] = static_cast<std::uint32_t>(cells[i]) + 2 * reach;
        row_ = count_[0];
        slab_ = row_ * count_[1];
        grid_.assign(std::size_t(slab_) * count_[2], empty);
        for (std::uint32_t z = reach; z < count_[2] - reach; ++z)
            for (std::uint32_t y = reach; y < count_[1] - reach; ++y)
                for (std::uint32_t x = reach; x < count_[0] - reach; ++x)
                    phases_[x % 3 + 3 * (y % 3) + 9 * (z % 3)].push_back(
                        static_cast<std::uint32_t>(x + y * row_ + z * slab_));
        find_neighbours();
    }

    template <class Loop>
    std::vector<Eigen::Vector3d> operator()(Loop const& loop)
    {
        for (int round = 0; round < rounds; ++round) {
            for (auto i = phases_.size(); i > 1; --i) phases_[i - 1].swap(phases_[random_.below(i)]);
            for (auto& phase : phases_) throw_at(phase, loop);
        }
        return std::move(points_);
    }

private:
    enum class Fate : char
    {
        free,    ///< no point within the radius
        taken,   ///< a point is too close, but part of the cell may be free
        hopeless ///< a point is too close to all of the cell
    };

    /// Throws one dart at each cell of a phase, and keeps the cells that may have room for another.
    template <class Loop>
    void throw_at(std::vector<std::uint32_t>& phase, Loop const& loop)
    {
        std::size_t kept = 0;
        for (std::size_t first = 0; first < phase.size(); first += batch_size) {
            std::span const cells{phase.data() + first, std::min(batch_size, phase.size() - first)};
            darts_.resize(cells.size());
            fates_.resize(cells.size());
            for (std::size_t i = 0; i < cells.size(); ++i)
                darts_[i] = lowest_.array() + (corner(cells[i]) + random_.vector()) * size_;
            loop.for_each(cells.size(), [&](std::size_t i) { fates_[i] = judge(darts_[i], cells[i]); });
            for (std::size_t i = 0; i < cells.size(); ++i) {
                if (fates_[i] == Fate::free) {
                    grid_[cells[i]] = static_cast<std::int32_t>(points_.size());
                    points_.push_back(darts_[i]);
                }
                else if (fates_[i] == Fate::taken)
                    phase[kept++] = cells[i]; // never ahead of what is read
            }
        }
        phase.resize(kept);
    }

    Fate judge(Eigen::Vector3d const& x, std::uint32_t cell) const
    {
        double const squared = radius_ * radius_;
        for (auto const step : neighbours_) {
            auto const other = grid_[std::size_t(cell + step)];
            if (other == empty || (points_[std::size_t(other)] - x).squaredNorm() >= squared) continue;
            Eigen::Array3d const middle = lowest_.array() + (corner(cell) + 0.5) * size_;
            Eigen::Array3d const furthest =
                (points_[std::size_t(other)].array() - middle).abs() + 0.5 * size_;
            return furthest.matrix().squaredNorm() < squared ? Fate::hopeless : Fate::taken;
        }
        return Fate::free;
    }

    /// The cells in which a point may be too close, nearest first; the 8 at the corners are a radius away.
    void find_neighbours()
    {
        std::vector<std::pair<int, std::ptrdiff_t>> by_distance;
        for (int z = -reach; z <= reach; ++z)
            for (int y = -reach; y <= reach; ++y)
                for (int x = -reach; x <= reach; ++x)
                    if (auto const d = x * x + y * y + z * z; d > 0 && d < 3 * reach * reach)
                        by_distance.emplace_back(d, x + y * row_ + z * slab_);
        std::ranges::sort(by_distance);
        for (auto const& [distance, step] : by_distance) neighbours_.push_back(step);
    }

    /// Lowest corner of a cell, in cells from the lowest corner of the box.
    Eigen::Array3d corner(std::uint32_t cell) const
    {
        return {double(cell % row_) - reach, double(cell / row_ % count_[1]) - reach,
                double(cell / slab_) - reach};
    }

    static constexpr double most_cells = 5e8;
    static constexpr int reach = 2, rounds = 12;
    static constexpr std::int32_t empty = -1;

    Eigen::Vector3d lowest_;
    double radius_;
    Eigen::Array3d size_; ///< of a cell
    UnitRandom random_;
    std::array<std::uint32_t, 3> count_{};
    std::ptrdiff_t row_ = 0, slab_ = 0;
    std::vector<std::int32_t> grid_; ///< the cell's point
    std::vector<std::ptrdiff_t> neighbours_;
    std::array<std::vector<std::uint32_t>, 27> phases_;
    std::vector<Eigen::Vector3d> points_, darts_;
    std::vector<Fate> fates_;
};

/// The points inside of a Poisson-disk sample of all the box, so that none gather at the surface.
template <Interior Solid, class Loop>
std::vector<Eigen::Vector3d> poisson_disk_inside(Solid const& interior, double radius, std::uint64_t seed,
                                                 Loop const& loop)
{
    auto const everywhere = DartThrowing(box_to_sample(interior, "poisson_disk_points"), radius, seed)(loop);
    std::vector<Eigen::Vector3d> points;
    keep_inside(interior, everywhere, loop, points);
    return points;
}

} // namespace detail

/// Random points no two of which are closer than `radius`, nearly as many as fit.
///
/// About 0.6 points come out for each cube of the radius. The cost is that of the bounding box. Throws
/// firn::Error: radius not above 0, no solid, no point inside, a grid of more than 5e8 cells (2 to 4 GB).
template <Interior Solid, class Loop = Serial>
PointSample poisson_disk_points(Solid const& interior, Radius radius, std::uint64_t seed = 0,
                                Loop const& loop = {})
{
    require(is_finite(radius.length) && radius.length > 0, "the radius is not a finite number above 0",
            "poisson_disk_points", "Pass a finite length [m].");
    return detail::sample_of(interior, detail::poisson_disk_inside(interior, radius.length, seed, loop),
                             "poisson_disk_points");
}

/// As above with exactly `count` points: the radius is found by trial such that a few more come out (below
/// 3 % from 10 000 points on), and those too many are left out at random, which keeps the least distance.
///
/// The least distance is about 0.83 of the cube root of the volume per point.
template <Interior Solid, class Loop = Serial>
PointSample poisson_disk_points(Solid const& interior, Count count, std::uint64_t seed = 0,
                                Loop const& loop = {})
{
    auto const wanted = detail::checked_count(count, "poisson_disk_points");
    auto const box = detail::box_to_sample(interior, "poisson_disk_points");
    auto const target = double(wanted);
    double radius = 0.842 * detail::spacing_for(interior, target + std::cbrt(target));
    std::vector<Eigen::Vector3d> best;
    for (int attempt = 0; attempt < 30; ++attempt) {
        auto points = detail::poisson_disk_inside(interior, radius, seed, loop);
        auto const found = double(points.size());
        if (found >= target && (best.empty() || points.size() < best.size())) best = std::move(points);
        if (!best.empty() && (double(best.size()) < 1.03 * target || attempt >= 4)) break;
        if (exactly_equal(found, 0) && box.volume() > 1e5 * std::pow(radius, 3))
            break; // there is nothing to be found
        radius *=
            std::clamp(std::cbrt(found / (1.01 * target + std::cbrt(target) + 0.1 * attempt)), 0.5, 1.5);
    }
    detail::UnitRandom random(seed + 1);
    detail::thin(best, wanted, random);
    return detail::sample_of(interior, std::move(best), "poisson_disk_points");
}

} // namespace firn

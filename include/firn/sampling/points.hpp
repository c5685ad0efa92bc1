// SPDX-License-Identifier: MIT
#pragma once

// Particles for a solid. The same seed gives the same points, whatever the loop and the standard library.
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>
#include <firn/sampling/interior.hpp>
#include <firn/sampling/poisson_disk_points.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{

/// The points of a lattice that is centred in the box, in the order of the lattice.
template <Interior Solid, class Loop>
std::vector<Eigen::Vector3d> lattice_inside(Solid const& interior, double spacing, double jitter,
                                            std::uint64_t seed, Loop const& loop)
{
    auto const box = box_to_sample(interior, "lattice_points");
    // A box that is a whole number of spacings wide must not gain a layer by rounding.
    Eigen::Array3d const cells = (box.sizes().array() / spacing - 1e-9).ceil().max(1);
    check_candidates(cells.prod(), box, "lattice_points");
    Eigen::Array3d const lowest = box.center().array() - 0.5 * spacing * cells;
    UnitRandom random(seed);
    std::vector<Eigen::Vector3d> points, candidates;
    candidates.reserve(batch_size);
    auto const flush = [&] {
        keep_inside(interior, candidates, loop, points);
        candidates.clear();
    };
    for (double z = 0; z < cells[2]; ++z)
        for (double y = 0; y < cells[1]; ++y)
            for (double x = 0; x < cells[0]; ++x) {
                Eigen::Array3d place = Eigen::Array3d{x, y, z} + 0.5;
                if (jitter > 0) place += jitter * (random.vector() - 0.5);
                candidates.push_back(lowest + spacing * place);
                if (candidates.size() == batch_size) flush();
            }
    flush();
    return points;
}

inline void check_jitter(double jitter)
{
    require(
        is_between(0, jitter, 1), "the jitter is not in [0, 1]", "lattice_points",
        "Pass the fraction of the spacing over which points are scattered: 0 for a lattice, 1 for a point "
        "anywhere in its cell.");
}

} // namespace detail

/// Points on a cubic lattice of the given spacing, each moved at random by up to ±jitter/2 spacings along
/// each axis (0: not at all, 1: anywhere in its cell).
///
/// The lattice is centred in the bounding box. Throws firn::Error: spacing not above 0, jitter outside [0,
/// 1], no solid, no point inside, more than 1e10 places to try.
template <Interior Solid, class Loop = Serial>
PointSample lattice_points(Solid const& interior, Spacing spacing, double jitter = 0, std::uint64_t seed = 0,
                           Loop const& loop = {})
{
    require(is_finite(spacing.length) && spacing.length > 0, "the spacing is not a finite number above 0",
            "lattice_points", "Pass a finite length [m].");
    detail::check_jitter(jitter);
    auto points = detail::lattice_inside(interior, spacing.length, jitter, seed, loop);
    return detail::sample_of(interior, std::move(points), "lattice_points");
}

/// As above with exactly `count` points: the spacing is the cube root of the volume per point, or slightly
/// less, and the few points too many (measured: below 0.5 % from 10 000 points on) are left out at random.
template <Interior Solid, class Loop = Serial>
PointSample lattice_points(Solid const& interior, Count count, double jitter = 0, std::uint64_t seed = 0,
                           Loop const& loop = {})
{
    auto const wanted = detail::checked_count(count, "lattice_points");
    detail::check_jitter(jitter);
    auto const box = detail::box_to_sample(interior, "lattice_points");
    // Where the surface cuts the lattice is chance, which changes the number of points by the order of
    // count^(1/3).
    auto const enough =
        wanted + static_cast<std::size_t>(2 * std::cbrt(double(wanted)) + 0.002 * double(wanted));
    double spacing = detail::spacing_for(interior, double(wanted));
    std::vector<Eigen::Vector3d> best;
    for (int attempt = 0; attempt < 40; ++attempt) {
        auto points = detail::lattice_inside(interior, spacing, jitter, seed, loop);
        auto const found = double(points.size());
        if (points.size() >= wanted && (best.empty() || points.size() < best.size()))
            best = std::move(points);
        bool const good_enough = !best.empty() && (best.size() <= enough || attempt >= 6);
        if (good_enough) break;
        if (exactly_equal(found, 0) && box.volume() > 1e6 * std::pow(spacing, 3))
            break; // nothing to be found
        // Aims at the middle of the accepted range, and a little finer each time, so that this ends.
        double const aim =
            0.5 * double(wanted + enough) * (1 + 0.01 * attempt * attempt / std::cbrt(double(wanted)));
        spacing *= std::clamp(std::cbrt(found / aim), 0.5, 1.1);
    }
    detail::UnitRandom random(seed + 1);
    detail::thin(best, wanted, random);
    return detail::sample_of(interior, std::move(best), "lattice_points");
}

/// Exactly `count` independent points, uniform in the solid, by rejection from its box.
///
/// Throws firn::Error: count not above 0, no solid, no point inside, more than 1e10 places to try.
template <Interior Solid, class Loop = Serial>
PointSample uniform_points(Solid const& interior, Count count, std::uint64_t seed = 0, Loop const& loop = {})
{
    auto const wanted = detail::checked_count(count, "uniform_points");
    auto const box = detail::box_to_sample(interior, "uniform_points");
    double const expected = double(wanted) * box.volume() / interior.volume();
    detail::check_candidates(expected, box, "uniform_points");
    detail::UnitRandom random(seed);
    std::vector<Eigen::Vector3d> points, candidates;
    candidates.resize(static_cast<std::size_t>(std::min(1.2 * expected + 100, double(detail::batch_size))));
    for (double tried = 0; points.size() < wanted; tried += double(candidates.size())) {
        // Only reached if the solid is not in its box, or much smaller than its volume.
        require(tried < 10 * expected + 1e7, "hardly any point falls inside", "uniform_points",
                "The solid's volume and box do not fit what it contains.");
        for (auto& x : candidates) x = box.min().array() + random.vector() * box.sizes().array();
        detail::keep_inside(interior, candidates, loop, points);
    }
    points.resize(wanted);
    return detail::sample_of(interior, std::move(points), "uniform_points");
}

} // namespace firn

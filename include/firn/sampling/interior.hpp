// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// A solid that can be sampled: tells which points [m] lie inside (as something true or false for each), its
/// volume [m³] and a box that holds it [m]. `MeshInterior` is one; a host engine may bring its own.
template <class T>
concept Interior = requires(T const& interior, std::span<Eigen::Vector3d const> points)
{
    {
        interior.contains(points, Serial{})[0]
        } -> std::convertible_to<bool>;
    {
        interior.volume()
        } -> std::convertible_to<double>;
    {
        interior.bounding_box()
        } -> std::convertible_to<Eigen::AlignedBox3d>;
};

/// Points inside a solid, and the share of its volume that each stands for: volume / number of points [m³].
struct PointSample
{
    std::vector<Eigen::Vector3d> points; ///< [m]
    double volume_per_point = 0;         ///< [m³]
};

/// Asks for this many points; any integer will do, such as a container's size.
struct Count
{
    constexpr explicit Count(std::integral auto number)
        : points(std::in_range<std::int64_t>(number) ? static_cast<std::int64_t>(number)
                                                     : std::numeric_limits<std::int64_t>::max())
    {}

    std::int64_t points;
};

/// Asks for points this far apart [m].
struct Spacing
{
    double length;
};

/// Asks for points of which no two are closer than this [m].
struct Radius
{
    double length;
};

namespace detail
{

/// Numbers in [0, 1) with 53 random bits; the standard's own distributions differ between libraries.
class UnitRandom
{
public:
    explicit UnitRandom(std::uint64_t seed) : engine_(seed) {}

    double operator()() { return double(engine_() >> 11) * 0x1p-53; }
    Eigen::Array3d vector()
    {
        double const x = (*this)(), y = (*this)(), z = (*this)();
        return {x, y, z};
    }
    std::size_t below(std::size_t bound) { return static_cast<std::size_t>((*this)() * double(bound)); }

private:
    std::mt19937_64 engine_;
};

constexpr double most_candidates = 1e10;
constexpr std::size_t batch_size = 1 << 16;

template <Interior Solid>
Eigen::AlignedBox3d box_to_sample(Solid const& interior, char const* sampler)
{
    Eigen::AlignedBox3d const box = interior.bounding_box();
    double const volume = interior.volume();
    bool const sound = all_finite(box.min()) && all_finite(box.max()) && box.volume() > 0;
    require(sound && is_finite(volume) && volume > 0, "there is no solid to sample", sampler,
            "The solid's volume and bounding box must be above 0 and finite.");
    return box;
}

inline std::size_t checked_count(Count count, char const* sampler)
{
    require(count.points > 0, "the number of points is not above 0", sampler, "Ask for at least one point.");
    return static_cast<std::size_t>(count.points);
}

/// A hint for errors about too large a solid: it may be in millimetres.
inline std::string about_units(Eigen::AlignedBox3d const& box)
{
    double const size = box.sizes().maxCoeff();
    if (!(size >= 100)) return {};
    std::ostringstream text;
    text << " The solid is " << size << " m across: if its file is in millimetres, read it with "
         << "MeshPlacement{.scale = 0.001}.";
    return text.str();
}

inline void check_candidates(double candidates, Eigen::AlignedBox3d const& box, char const* sampler)
{
    if (!(candidates <= most_candidates))
        throw Error{"this would try more than 1e10 places", sampler,
                    "Ask for fewer points (a coarser spacing), or split a solid that leaves most of its box "
                    "empty." +
                        about_units(box)};
}

/// The spacing [m] of a lattice with `count` places inside, by the volumes alone. A solid thinner than that
/// is one layer thick: the cube root of the volume per point would then be far too small.
template <Interior Solid>
double spacing_for(Solid const& interior, double count)
{
    Eigen::Array3d const box = interior.bounding_box().sizes().array();
    double const places = count * box.prod() / interior.volume();
    double low = 0, high = std::cbrt(box.prod()) + box.maxCoeff();
    for (int halving = 0; halving < 60; ++halving) {
        double const middle = (low + high) / 2;
        ((box / middle).max(1).prod() > places ? low : high) = middle;
    }
    return high;
}

/// Appends those of the candidates that lie inside.
template <Interior Solid, class Loop>
void keep_inside(Solid const& interior, std::span<Eigen::Vector3d const> candidates, Loop const& loop,
                 std::vector<Eigen::Vector3d>& points)
{
    auto const inside = interior.contains(candidates, loop);
    for (std::size_t i = 0; i < candidates.size(); ++i)
        if (inside[i]) points.push_back(candidates[i]);
}

/// Drops points chosen at random until `count` are left; the others keep their order.
inline void thin(std::vector<Eigen::Vector3d>& points, std::size_t count, UnitRandom& random)
{
    // Selection sampling (Knuth, The Art of Computer Programming 2, 3.4.2, algorithm S).
    std::size_t kept = 0;
    for (std::size_t i = 0, total = points.size(); i < total && kept < count; ++i)
        if (random() * double(total - i) < double(count - kept)) points[kept++] = points[i];
    points.resize(kept);
}

template <Interior Solid>
PointSample sample_of(Solid const& interior, std::vector<Eigen::Vector3d> points, char const* sampler)
{
    require(!points.empty(), "no point falls inside", sampler,
            "Ask for more points (a finer spacing), and check that the solid is where its box says.");
    double const volume = interior.volume() / double(points.size());
    return {std::move(points), volume};
}

} // namespace detail

} // namespace firn

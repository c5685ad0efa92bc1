// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_arrays.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/storage.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <type_traits>
#include <vector>

// Where new particles lie: the backend checks their points and finds their cells. `Table` is a ParticleTable.
namespace firn::detail
{

/// A point that is its coordinates and nothing else: a host's, or one of Eigen's that holds them.
template <class Point, int d>
concept PlainPoint = HostValue<Point, d> || requires
{
    requires std::is_same_v<Point, typename Point::PlainObject>; // no view of numbers elsewhere
    requires sizeof(Point) == d * sizeof(typename Point::Scalar);
};

/// Points that lie in memory one after the other, coordinate by coordinate.
template <class Points, int d>
concept PointsInMemory = requires(Points const& points)
{
    requires PlainPoint<std::remove_cvref_t<decltype(*std::data(points))>, d>;
    std::size(points);
};

/// The number that the coordinates of such points are.
template <class Point>
struct CoordinateOf
{
    using Type = firn::NumberIn<Point>;
};
template <class Point>
    requires requires { typename Point::Scalar; }
struct CoordinateOf<Point>
{
    using Type = typename Point::Scalar;
};

/// The points that have cells.
template <int d>
struct RangeOfPoints
{
    Lattice lattice;
    double largest; ///< distance from the origin [cells]

    template <class Table>
    explicit RangeOfPoints(Table const& table)
        : lattice(table.lattice()),
          largest(lattice.half_world == 0 ? Table::CellOrder::largest_coordinate
                                          : lattice.half_world - 2 * WorldLayout<d>::margin)
    {}

    /// Whether a point is finite and near enough [m].
    FIRN_HOST_DEVICE bool contains(Vector<double, d> const& x) const
    {
        bool is_near = true; // false for NaN, too
        for (int a = 0; a < d; ++a)
            is_near = is_near && is_finite(x[a]) &&
                      std::abs(x[a] - lattice.origin[a]) / lattice.cell_size < largest;
        return is_near;
    }

    [[noreturn, gnu::cold]] void refuse(std::size_t point) const
    {
        throw Error{"point " + std::to_string(point) + " is not finite or too far from the lattice's origin",
                    "Solver::add",
                    "Pass finite positions in metres, within " + std::to_string(static_cast<long>(largest)) +
                        " cells of the origin: use a larger cell or move the lattice's origin."};
    }
};

/// Where new particles lie: writes the cell, the offset and the row of each, or that a point is out of range.
template <class Number, int d, class Coordinate>
struct LocatePoints
{
    std::array<Coordinate, std::size_t(d)> const* points; ///< [m]
    RangeOfPoints<d> range;
    int kernel_degree;
    Coordinates<d> centre; ///< of the world that they are in
    std::uint32_t first;   ///< row and place of the first one
    Coordinates<d>* cells; ///< from its own on
    unsigned char* is_far; ///< 1 or 0: whether the point is not finite or too far, from the first one on
    std::array<typename CellOffset<Number>::Stored*, std::size_t(d)> offset;
    std::uint32_t* id;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const x =
            make_vector<double, d>([&](int a) { return static_cast<double>(points[i][std::size_t(a)]); });
        is_far[i] = range.contains(x) ? 0 : 1;
        if (is_far[i] != 0) return;
        CellPosition<d> const located = locate<d>(range.lattice, kernel_degree, x);
        for (int a = 0; a < d; ++a) {
            cells[i][a] = located.cell[a] + centre[a];
            offset[std::size_t(a)][first + i] = CellOffset<Number>::from(located.offset[a]);
        }
        id[first + i] = first + static_cast<std::uint32_t>(i);
    }
};

/// Writes the places of new particles behind the existing ones, where there is room, and their cells. The
/// backend finds them, some at a time. Throws an Error if a point is out of range.
template <class Table, class Points>
void place_points(Table& table, Points const& points, std::uint32_t first,
                  Coordinates<Table::d> const& centre, Coordinates<Table::d>* cells)
{
    constexpr int d = Table::d;
    constexpr std::size_t at_once = std::size_t(1) << 20;
    using Point = std::remove_cvref_t<decltype(*std::begin(points))>;
    static_assert(
        PointOf<Point, d>,
        "points have as many coordinates as the scene has dimensions, and those of a host no padding: "
        "see HostValue in firn/core/host_arrays.hpp");
    constexpr bool in_memory = PointsInMemory<Points, d>;
    using Coordinate =
        typename std::conditional_t<in_memory, CoordinateOf<Point>, CoordinateOf<double>>::Type;
    using Place = std::array<Coordinate, std::size_t(d)>;
    using Backend = typename Table::Backend;
    RangeOfPoints<d> const range(table);
    std::size_t const count = std::size(points);
    typename Backend::template Array<Place> there(table.backend());
    typename Backend::template Array<unsigned char> is_far(table.backend());
    there.resize(std::min(count, at_once));
    is_far.resize(count);
    auto& buffer = table.contents().buffer[0];
    std::vector<Place> here;
    auto next = std::begin(points);
    for (std::size_t done = 0; done < count;) {
        std::size_t const some = std::min(count - done, at_once);
        if constexpr (in_memory)
            there.upload(0, {reinterpret_cast<Place const*>(std::data(points)) + done, some});
        else {
            here.resize(some);
            for (Place& place : here) {
                Vector<double, d> const x = point_of<d>(*next);
                for (int a = 0; a < d; ++a) place[std::size_t(a)] = x[a];
                ++next;
            }
            there.upload(0, here);
        }
        LocatePoints<typename Table::Number, d, Coordinate> locate{there.data(),
                                                                   range,
                                                                   table.kernel_degree(),
                                                                   centre,
                                                                   first + static_cast<std::uint32_t>(done),
                                                                   cells + done,
                                                                   is_far.data() + done,
                                                                   {},
                                                                   buffer.id.data()};
        for (std::size_t a = 0; a < locate.offset.size(); ++a) locate.offset[a] = buffer.offset[a].data();
        table.backend().for_each(some, locate);
        done += some;
    }
    auto const far = downloaded(is_far);
    auto const first_far = std::find(far.begin(), far.end(), 1);
    if (first_far != far.end()) range.refuse(static_cast<std::size_t>(first_far - far.begin()));
}

} // namespace firn::detail

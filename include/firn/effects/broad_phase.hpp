// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

// Which of many obstacles may touch nodes or particles of a place. Space is cut into cubes of some cells, and
// each cube that an obstacle's box meets has a list of such obstacles, by rising number. A cube is found by a
// hash table.
namespace firn
{

/// The cells that an obstacle may meet during a call.
template <int d>
struct SweptBox
{
    std::array<int, std::size_t(d)> low{}, high{}; ///< both included
    bool is_bounded = false;                       ///< false: it is everywhere
    float reach = 0; ///< how far from its reference point it acts [m]; 0: it is unbounded
    /// One that is unbounded meets no cell whose coordinates have a product with `outward` of more than
    /// `furthest`.
    std::array<double, std::size_t(d)> outward{}; // floats would be cells off, far from the origin
    double furthest = 0;

    /// The box of an obstacle that nothing is to meet.
    static SweptBox nowhere()
    {
        SweptBox box;
        box.low.fill(1);
        box.is_bounded = true;
        return box;
    }
    bool is_empty() const { return low[0] > high[0]; }
    friend bool operator==(SweptBox const&, SweptBox const&) = default;
};

/// A cube and where its list begins and ends in all lists; an empty place of the table has no end.
template <int d>
struct ListOfCube
{
    std::array<int, std::size_t(d)> cube{};
    std::uint32_t begin = 0, end = 0;
};

/// An obstacle in a list, with all by which a node is found to be far from it: loops wait for memory once.
template <int d>
struct ListedObstacle
{
    std::array<int, std::size_t(d)> low{}, high{}; ///< its box, if it is bounded
    std::uint32_t number = 0;
    float reach = 0;                              ///< from its reference point [m]; 0: it is unbounded
    std::array<double, std::size_t(d)> outward{}; ///< of one that is unbounded: see SweptBox
    double furthest = 0;

    FIRN_HOST_DEVICE bool may_meet(Coordinates<d> const& cell) const
    {
        bool inside = true;
        for (int a = 0; a < d; ++a)
            inside = inside && low[std::size_t(a)] <= cell[a] && cell[a] <= high[std::size_t(a)];
        return inside;
    }

    /// Whether a cell lies beyond the side of one that is unbounded.
    FIRN_HOST_DEVICE bool is_beyond(Coordinates<d> const& cell) const
    {
        double along = 0;
        for (int a = 0; a < d; ++a) along += outward[std::size_t(a)] * cell[a];
        return along > furthest;
    }
};

/// The lists in the memory where loops read them: a plain value.
template <int d>
struct NearObstacles
{
    ListOfCube<d> const* table = nullptr;
    std::uint32_t mask = 0; ///< the table's size, a power of two, less one
    ListedObstacle<d> const* lists = nullptr;
    std::uint32_t everywhere = 0; ///< the length of the first list, of obstacles that are everywhere
    int shift = 0;                ///< cubes have 2^shift cells along each axis
    int before = 0;               ///< the cube of cell 0 begins so many cells before it

    /// Calls `use(number, reach)` for all obstacles whose boxes a cell lies in, by rising number.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(Coordinates<d> const& cell, Use const& use) const
    {
        std::array<int, std::size_t(d)> cube{};
        for (int a = 0; a < d; ++a) cube[std::size_t(a)] = (cell[a] + before) >> shift;
        std::uint32_t at = 0, end = 0;
        for (std::uint32_t place = hash(cube) & mask; table[place].end != 0; place = (place + 1) & mask)
            if (same(table[place].cube, cube)) {
                at = table[place].begin;
                end = table[place].end;
                break;
            }
        // two lists by rising number: those of the cube, and those that are everywhere
        for (std::uint32_t unbounded = 0;;) {
            while (at < end && !lists[at].may_meet(cell)) ++at;
            while (unbounded < everywhere && lists[unbounded].is_beyond(cell)) ++unbounded;
            bool const has_near = at < end, has_unbounded = unbounded < everywhere;
            if (!has_near && !has_unbounded) return;
            bool const takes_near =
                has_near && (!has_unbounded || lists[at].number < lists[unbounded].number);
            ListedObstacle<d> const& next = lists[takes_near ? at++ : unbounded++];
            use(next.number, next.reach);
        }
    }

    FIRN_HOST_DEVICE static std::uint32_t hash(std::array<int, std::size_t(d)> const& cube)
    {
        std::uint64_t mixed = 0;
        for (int a = 0; a < d; ++a) {
            mixed ^= static_cast<std::uint32_t>(cube[std::size_t(a)]);
            mixed *= 0x9e3779b97f4a7c15u;
            mixed ^= mixed >> 29;
        }
        return static_cast<std::uint32_t>(mixed >> 16);
    }

private:
    FIRN_HOST_DEVICE static bool same(std::array<int, std::size_t(d)> const& a,
                                      std::array<int, std::size_t(d)> const& b)
    {
        bool equal = true;
        for (std::size_t i = 0; i < std::size_t(d); ++i) equal = equal && a[i] == b[i];
        return equal;
    }
};

/// Makes the lists on the host.
template <int d>
class BroadPhase
{
    using Cube = std::array<int, std::size_t(d)>;

public:
    std::vector<ListOfCube<d>> table;
    std::vector<ListedObstacle<d>> lists;
    std::uint32_t everywhere = 0;
    int shift = 2; ///< as large as a block of cells or nodes, which then have one list

    /// The cube of cell 0 begins `before` cells before it.
    explicit BroadPhase(std::vector<SweptBox<d>> const& boxes, int before = 0) : before_(before)
    {
        // large cubes where there are many or large obstacles: time and memory are bounded
        double const most = 8192 + 16 * double(boxes.size());
        while (shift < 30 && cubes_of(boxes) > most) ++shift;
        std::vector<std::pair<Cube, std::uint32_t>> met;
        for (std::uint32_t i = 0; i < boxes.size(); ++i) {
            if (!boxes[i].is_bounded)
                lists.push_back(listed(boxes, i));
            else if (!boxes[i].is_empty())
                for_each_cube(boxes[i], [&](Cube const& cube) { met.push_back({cube, i}); });
        }
        everywhere = static_cast<std::uint32_t>(lists.size());
        std::sort(met.begin(), met.end());
        std::size_t cubes = 0;
        for (std::size_t i = 0; i < met.size(); ++i) cubes += i == 0 || met[i].first != met[i - 1].first;
        table.resize(std::bit_ceil(2 * cubes + 1));
        for (std::size_t i = 0; i < met.size();) {
            std::size_t last = i;
            while (last < met.size() && met[last].first == met[i].first) ++last;
            add_list(boxes, met, i, last);
            i = last;
        }
    }

private:
    template <class Use>
    void for_each_cube(SweptBox<d> const& box, Use const& use) const
    {
        Cube low, high;
        for (std::size_t a = 0; a < std::size_t(d); ++a)
            low[a] = (box.low[a] + before_) >> shift, high[a] = (box.high[a] + before_) >> shift;
        Cube cube = low;
        for (;;) {
            use(cube);
            std::size_t a = 0;
            while (a < std::size_t(d) && ++cube[a] > high[a]) cube[a] = low[a], ++a;
            if (a == std::size_t(d)) return;
        }
    }

    double cubes_of(std::vector<SweptBox<d>> const& boxes) const
    {
        double sum = 0;
        for (auto const& box : boxes) {
            double cubes = 1;
            for (std::size_t a = 0; a < std::size_t(d); ++a)
                cubes *=
                    double((box.high[a] + before_) >> shift) - double((box.low[a] + before_) >> shift) + 1;
            if (box.is_bounded && !box.is_empty()) sum += cubes;
        }
        return sum;
    }

    static ListedObstacle<d> listed(std::vector<SweptBox<d>> const& boxes, std::uint32_t i)
    {
        return {boxes[i].low, boxes[i].high, i, boxes[i].reach, boxes[i].outward, boxes[i].furthest};
    }

    /// The list of one cube.
    void add_list(std::vector<SweptBox<d>> const& boxes,
                  std::vector<std::pair<Cube, std::uint32_t>> const& met, std::size_t first, std::size_t last)
    {
        ListOfCube<d> of{met[first].first, static_cast<std::uint32_t>(lists.size()), 0};
        for (std::size_t i = first; i < last; ++i) lists.push_back(listed(boxes, met[i].second));
        of.end = static_cast<std::uint32_t>(lists.size());
        auto const mask = static_cast<std::uint32_t>(table.size() - 1);
        std::uint32_t at = NearObstacles<d>::hash(of.cube) & mask;
        while (table[at].end != 0) at = (at + 1) & mask;
        table[at] = of;
    }

    int before_;
};

} // namespace firn

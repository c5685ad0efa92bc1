// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/chain.hpp>
#include <firn/grid/lattice.hpp>

#include <array>
#include <cstddef>
#include <cstdlib>

namespace firn
{

/// A reflecting wall of a chain.
struct WallPlane
{
    int axis, node, side;
    int obstacle; ///< its place among the reactions

    /// Whether a node at this coordinate along the axis has an image that is not itself: kernels reach one
    /// node beyond a wall.
    FIRN_HOST_DEVICE bool mirrors(int coordinate) const
    {
        return coordinate == node - 1 || coordinate == node + 1;
    }
    FIRN_HOST_DEVICE int image(int coordinate) const { return 2 * node - coordinate; }
};

/// The walls of a chain.
template <class... Actions>
FIRN_HOST_DEVICE std::array<WallPlane, Chain<Actions...>::walls> walls_of(Chain<Actions...> const& chain)
{
    std::array<WallPlane, Chain<Actions...>::walls> walls{};
    std::size_t found = 0;
    int obstacle = 0;
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (is_wall<Action>) walls[found++] = {action.axis, action.node, action.side, obstacle};
        obstacle += int(is_obstacle<Action>);
    });
    return walls;
}

/// Whether one of `count` nodes in a row along the last axis is on a wall, or beside one.
template <int d, std::size_t walls>
FIRN_HOST_DEVICE bool is_beside(std::array<WallPlane, walls> const& planes, Coordinates<d> const& first,
                                int count)
{
    bool beside = false;
    for (WallPlane const& wall : planes) {
        int const from = first[wall.axis], to = from + (wall.axis == d - 1 ? count - 1 : 0);
        beside = beside || (from <= wall.node + 1 && to >= wall.node - 1);
    }
    return beside;
}

/// Lanes of nodes along a row beside reflecting walls: where they are, or their images on the walls' side.
template <class Real, int d, std::size_t count>
struct NodesOrImages
{
    using Number = ScalarOf<Real>;
    std::array<WallPlane, count> const& walls;
    /// The nodes on the side of the walls: first + along, the latter on the last axis.
    Coordinates<d> first;
    Real along;
    std::array<Mask<Real>, std::size_t(d)>
        flipped;                      ///< whether the node in question is behind a wall across this axis
    std::array<Mask<Real>, count> on; ///< or on this wall

    /// For the lanes of nodes `at`.
    template <class Node>
    FIRN_HOST_DEVICE NodesOrImages(std::array<WallPlane, count> const& planes, Node const& at)
        : walls(planes), first(at.first()), along(at.offset()[d - 1])
    {
        Real const zero(Number(0));
        Mask<Real> const every = exactly_equal(zero, zero), none = zero > zero;
        for (int a = 0; a < d; ++a) flipped[std::size_t(a)] = none;
        for (std::size_t w = 0; w < count; ++w) {
            WallPlane const& wall = walls[w];
            int const before = (first[wall.axis] - wall.node) * wall.side; // of lane 0
            on[w] = none;
            if (wall.axis != d - 1) { // all lanes or none
                if (before == 0) on[w] = every;
                if (before != -1) continue;
                flipped[std::size_t(wall.axis)] = every;
                first[wall.axis] = wall.image(first[wall.axis]);
            }
            else if (reaches(wall, first, 1)) {
                Real const ahead = Real(Number(first[wall.axis] - wall.node)) + along;
                on[w] = exactly_equal(ahead, zero);
                Mask<Real> const behind = exactly_equal(ahead, Real(Number(-wall.side)));
                if (!any(behind)) continue;
                flipped[std::size_t(wall.axis)] = flipped[std::size_t(wall.axis)] | behind;
                along = along + select(behind, Real(Number(2 * wall.side)), zero);
            }
        }
    }
    template <class Node>
    NodesOrImages(std::array<WallPlane, count> const&&, Node const&) = delete; ///< stores a reference

    /// Which of the nodes in question are images.
    FIRN_HOST_DEVICE Mask<Real> is_image() const
    {
        Mask<Real> is = flipped[0];
        for (int a = 1; a < d; ++a) is = is | flipped[std::size_t(a)];
        return is;
    }

    /// Which are on a wall across an axis.
    FIRN_HOST_DEVICE Mask<Real> on_wall(int axis) const
    {
        Mask<Real> is = Real(Number(1)) < Real(Number(0));
        for (std::size_t w = 0; w < count; ++w)
            if (walls[w].axis == axis) is = is | on[w];
        return is;
    }

protected:
    /// Whether lanes along a row from `row` on come within `distance` nodes of a wall across its axis.
    FIRN_HOST_DEVICE static bool reaches(WallPlane const& wall, Coordinates<d> const& row, int distance)
    {
        int const lane = wall.node - row[d - 1];
        return lane >= -distance && lane < lane_width<Real> + distance;
    }
};

/// Whether nodes know which images they look at, from a loop before this one: see list_images().
template <class Node>
concept HasListedImages = requires
{
    requires Node::has_listed_images;
};

/// The sums of nodes together with those of their images behind the walls.
template <class Sums, class Real, int d, std::size_t count>
struct SumsWithImages
{
    using Number = ScalarOf<Real>;
    Real sums[Sums::channels];
    /// The part of the sums that lies behind each wall: mass, and momentum and impulse along its axis,
    /// unmirrored. Phases that sum up stress alone do not need it.
    Real mass_behind[count], momentum_behind[count], impulse_behind[Sums::forces_are_apart ? count : 1];

    FIRN_HOST_DEVICE SumsWithImages()
    {
        Real const zero(Number(0));
        for (auto& sum : sums) sum = zero;
        for (std::size_t w = 0; w < count; ++w) {
            mass_behind[w] = momentum_behind[w] = zero;
            if constexpr (Sums::forces_are_apart) impulse_behind[w] = zero;
        }
    }

    /// Adds what was found at nodes, or at their images behind some of the walls. No index of an array is a
    /// variable, so that compilers can keep all in registers.
    /// `turns(axis)` is -1 for images behind a wall across the axis, else 1.
    template <class Behind, class Turns>
    FIRN_HOST_DEVICE void add(Real const (&found)[std::size_t(Sums::channels)], Behind const& behind,
                              Turns const& turns, std::array<WallPlane, count> const& walls)
    {
        if constexpr (requires { Sums::mass; })
            for (std::size_t w = 0; w < count; ++w) {
                if (!behind[w]) continue;
                mass_behind[w] += found[Sums::mass];
                for (int a = 0; a < d; ++a) {
                    if (a != walls[w].axis) continue;
                    momentum_behind[w] += found[Sums::momentum + a];
                    if constexpr (Sums::forces_are_apart) impulse_behind[w] += found[Sums::impulse + a];
                }
            }
        for (int c = 0; c < Sums::channels; ++c) {
            int const axis = Sums::axis(c);
            sums[c] += axis < 0 ? found[c] : found[c] * Real(Number(turns(axis)));
        }
    }

    /// The same, where it is not known yet across which axes the walls lie.
    template <class Behind>
    FIRN_HOST_DEVICE void add(Real const (&found)[std::size_t(Sums::channels)], Behind const& behind,
                              std::array<WallPlane, count> const& walls)
    {
        std::array<bool, std::size_t(d)> reverse{};
        for (std::size_t w = 0; w < count; ++w)
            for (int a = 0; a < d; ++a)
                reverse[std::size_t(a)] = reverse[std::size_t(a)] || (behind[w] && a == walls[w].axis);
        add(
            found, behind, [&](int axis) { return reverse[std::size_t(axis)] ? -1 : 1; }, walls);
    }
};

/// Lanes of nodes beside reflecting walls with the sums of both: the nodes and their images behind the walls.
///
/// What particles scatter to a node behind a wall, their mirror images scatter to the node in front of it,
/// with momentum along the wall's axis of opposite sign. So the sum of both solves the whole problem, body
/// and image; where walls meet, axis by axis. Other vectors are mirrored as momentum is, and scalars keep
/// their sign. A wall across the row's own axis mirrors single lanes, one across another axis whole rows.
template <class Sums, class Real, int d, std::size_t count>
struct MirroredNode : NodesOrImages<Real, d, count>, SumsWithImages<Sums, Real, d, count>
{
    using Base = NodesOrImages<Real, d, count>;
    using Totals = SumsWithImages<Sums, Real, d, count>;
    using Base::walls, Base::first, Base::along;
    using typename Base::Number;

    /// For the lanes of nodes `at`, which reads other nodes by `sums_at(first, along, which lanes, sums)`; or
    /// which notes them by `note_image(first, along, which lanes, behind which, walls)`, and later goes
    /// through these again by `for_each_image`.
    template <class Node>
    FIRN_HOST_DEVICE MirroredNode(std::array<WallPlane, count> const& planes, Node const& at)
        : Base(planes, at)
    {
        if constexpr (HasListedImages<Node>) {
            Totals totals; // a local variable can be in registers
            at.template for_each_image<Sums::channels>([&](auto const& found, auto const& behind) {
                totals.add(
                    found, behind, [&](int axis) { return behind.turns[axis]; }, planes);
            });
            static_cast<Totals&>(*this) = totals;
        }
        else {
            Real const zero(Number(0));
            std::array<bool, count> behind{};
            add_images<0>(at, first, along, exactly_equal(zero, zero), behind);
        }
    }
    template <class Node>
    MirroredNode(std::array<WallPlane, count> const&&, Node const&) = delete; ///< stores a reference

private:
    /// Adds the sums at places and at their images across this axis and those after it.
    template <int axis, class Node>
    FIRN_HOST_DEVICE void add_images(Node const& from, Coordinates<d> const& row, Real const& places,
                                     Mask<Real> const& which, std::array<bool, count> const& behind)
    {
        if constexpr (axis == d)
            add_sums(from, row, places, which, behind);
        else {
            add_images<axis + 1>(from, row, places, which, behind);
            for (std::size_t w = 0; w < count; ++w) {
                if (walls[w].axis != axis) continue;
                auto behind_this = behind;
                behind_this[w] = true;
                if constexpr (axis == d - 1) {
                    if (!Base::reaches(walls[w], row, 3))
                        continue; // images lie up to two nodes beyond the lanes
                    Real const distance = Real(Number(row[axis] - walls[w].node)) + places;
                    Mask<Real> const mirrored = which & exactly_equal(abs(distance), Real(Number(1)));
                    if (any(mirrored))
                        add_images<axis + 1>(from, row, places - Real(Number(2)) * distance, mirrored,
                                             behind_this);
                }
                else if (walls[w].mirrors(row[axis])) {
                    Coordinates<d> image = row;
                    image[axis] = walls[w].image(row[axis]);
                    add_images<axis + 1>(from, image, places, which, behind_this);
                }
            }
        }
    }

    template <class Node>
    FIRN_HOST_DEVICE void add_sums(Node const& from, Coordinates<d> const& row, Real const& places,
                                   Mask<Real> const& which, std::array<bool, count> const& behind)
    {
        if constexpr (requires { from.note_image(row, places, which, behind, walls); })
            from.note_image(row, places, which, behind, walls);
        else {
            Real found[Sums::channels];
            from.template sums_at<Sums::channels>(row, places, which, found);
            Totals::add(found, behind, walls);
        }
    }
};

/// Lets the lanes of nodes note which images they look at. Returns which of them are images themselves.
template <int d, class Sums, std::size_t count, class Node>
Mask<typename Node::Real> list_images(std::array<WallPlane, count> const& walls, Node const& node)
{
    return MirroredNode<Sums, typename Node::Real, d, count>(walls, node).is_image();
}

} // namespace firn

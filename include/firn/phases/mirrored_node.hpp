// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/chain.hpp>
#include <firn/grid/lattice.hpp>

#include <array>
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
    FIRN_HOST_DEVICE bool is_behind(int coordinate) const { return (coordinate - node) * side < 0; }
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
        obstacle += int(Action::is_obstacle);
    });
    return walls;
}

/// A node beside reflecting walls, or its image on their side: what it holds together with its images behind
/// them.
///
/// What particles give to a node behind a wall, their mirror images give to the node in front of it, where
/// momentum along the wall's axis is of the other sign. So sums of both make the whole problem, body and
/// image; where walls meet, axis by axis.
template <class Sums, class Number, int d, std::size_t count>
struct MirroredNode
{
    std::array<WallPlane, count> walls;
    Coordinates<d> node;              ///< on the side of the walls
    std::array<bool, d> flipped{};    ///< whether the node in question is behind a wall across this axis
    std::array<bool, d> on_wall{};    ///< or on it
    Number sums[Sums::channels] = {}; ///< of the node and its images
    /// Of what the sums hold, behind each wall: as it is there, momentum and impulse along its axis.
    Number mass_behind[count] = {}, momentum_behind[count] = {}, impulse_behind[count] = {};

    /// Of the node `at`, which looks at others by `sums_at(coordinates, sums)`.
    template <class Node>
    FIRN_HOST_DEVICE MirroredNode(std::array<WallPlane, count> const& planes, Node const& at)
        : walls(planes), node(at.first())
    {
        for (WallPlane const& wall : walls) {
            int& coordinate = node[wall.axis];
            on_wall[wall.axis] = on_wall[wall.axis] || coordinate == wall.node;
            if (!wall.mirrors(coordinate) || !wall.is_behind(coordinate)) continue;
            coordinate = wall.image(coordinate);
            flipped[wall.axis] = true;
        }
        std::array<bool, count> behind{};
        add<0>(at, node, behind);
    }

    FIRN_HOST_DEVICE bool is_image() const
    {
        bool is = false;
        for (bool here : flipped) is = is || here;
        return is;
    }

private:
    /// Adds what is found at a place and at its images across this axis and those after it.
    template <int axis, class Node>
    FIRN_HOST_DEVICE void add(Node const& from, Coordinates<d> const& place,
                              std::array<bool, count> const& behind)
    {
        if constexpr (axis == d)
            add_sums(from, place, behind);
        else {
            add<axis + 1>(from, place, behind);
            for (std::size_t w = 0; w < count; ++w) {
                if (walls[w].axis != axis || !walls[w].mirrors(place[axis])) continue;
                Coordinates<d> image = place;
                image[axis] = walls[w].image(place[axis]);
                auto behind_this = behind;
                behind_this[w] = true;
                add<axis + 1>(from, image, behind_this);
            }
        }
    }

    template <class Node>
    FIRN_HOST_DEVICE void add_sums(Node const& from, Coordinates<d> const& place,
                                   std::array<bool, count> const& behind)
    {
        Number found[Sums::channels];
        from.sums_at(place, found);
        std::array<bool, d> reverse{};
        for (std::size_t w = 0; w < count; ++w) {
            if (!behind[w]) continue;
            reverse[walls[w].axis] = true;
            mass_behind[w] += found[Sums::mass];
            momentum_behind[w] += found[Sums::momentum + walls[w].axis];
            impulse_behind[w] += found[Sums::impulse + walls[w].axis];
        }
        sums[Sums::mass] += found[Sums::mass];
        for (int c = 1; c < Sums::channels; ++c) sums[c] += reverse[(c - 1) % d] ? -found[c] : found[c];
    }
};

} // namespace firn

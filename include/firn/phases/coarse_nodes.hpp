// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/phases/mirrored_node.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/step_context.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// Nodes of a grid that is four times as coarse, by which implicit steps are preconditioned: what they have to
// do with the grid's own nodes, by multilinear interpolation.
namespace firn
{

/// The ratio of cell sizes of two grids of the preconditioner.
inline constexpr int coarsening = 4;

/// The weight of one node among those of another grid.
template <class Number>
struct NodeWeight
{
    std::uint32_t node = 0;
    Number weight = 0;
};

/// A coarse node, and those beside it, itself in the middle: by their numbers, or `absent`.
template <int d>
struct CoarseNode
{
    static constexpr int beside_count = d == 3 ? 27 : 9;
    /// The nodes that it reaches: so many along a line, and so many lines.
    static constexpr int along = 2 * coarsening - 1, lines = d == 3 ? along * along : along,
                         reached_count = lines * along;
    static constexpr std::uint32_t absent = ~std::uint32_t(0);

    Coordinates<d> at = zeros<Coordinates<d>>(); ///< on its own grid
    std::array<std::uint32_t, std::size_t(beside_count)> beside{};

    /// The offset of the i-th of the nodes that a coarse node reaches, less than `coarsening` along each
    /// axis.
    FIRN_HOST_DEVICE static Coordinates<d> offset(int i)
    {
        Coordinates<d> way;
        for (int a = d - 1; a >= 0; --a, i /= 2 * coarsening - 1)
            way[a] = i % (2 * coarsening - 1) - coarsening + 1;
        return way;
    }
    /// The weight of the node at an offset, where those corners of its coarse cell that are there share all.
    template <class Number>
    FIRN_HOST_DEVICE Number weight(Coordinates<d> const& way) const
    {
        Number own(0), sum(0);
        for (int corner = 0; corner < 1 << d; ++corner) {
            int place = 0;
            bool is_own = true;
            Number w(1);
            for (int a = 0; a < d; ++a) {
                int const low = way[a] < 0 ? -1 : 0, at_corner = low + ((corner >> a) & 1);
                int const apart = way[a] - coarsening * at_corner;
                w *= Number(1) - Number(apart < 0 ? -apart : apart) / Number(coarsening);
                place = 3 * place + at_corner + 1;
                is_own = is_own && at_corner == 0;
            }
            if (beside[std::size_t(place)] == absent) continue;
            sum += w;
            if (is_own) own = w;
        }
        return own > Number(0) ? own / sum : Number(0);
    }
    /// Which corner of the coarse cell of the node at an offset this one is.
    FIRN_HOST_DEVICE static int corner(Coordinates<d> const& way)
    {
        int which = 0;
        for (int a = 0; a < d; ++a) which |= (way[a] < 0 ? 1 : 0) << a;
        return which;
    }
};

/// How a node takes part in the coarse grid: its weights, and the axes across which it is an image.
template <class Number, int d>
struct NodeInCoarse
{
    static constexpr std::uint32_t takes_part = 1u << d; ///< a bit beside those of the axes

    std::array<NodeWeight<Number>, std::size_t(1 << d)> corners{};
    std::uint32_t flipped = 0; ///< a bit for each axis, and takes_part of all that have weights
};

/// Links each coarse node with the nodes that have mass. Images behind walls get the weights of the nodes
/// whose images they are.
template <class Space, class Kernel, class Transfer, class Effects, class Nodes>
struct LinkCoarseNodes
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Coarse = CoarseNode<d>;
    using Sums = NodeSums<d, SumsOf<Transfer>>;

    StepContext<Number, Effects> const* now;
    Nodes nodes;
    Number smallest_mass;
    CoarseNode<d> const* coarse;
    std::size_t count;           ///< of coarse nodes
    NodeWeight<Number>* reached; ///< for each coarse node one after the other, Coarse::reached_count times
    NodeInCoarse<Number, d>* linked; ///< for each index of a node
    /// The numbers of these coarse nodes among all, if they are a part of them.
    std::uint32_t const* numbers = nullptr;

    /// For one of the nodes that a coarse node reaches.
    FIRN_HOST_DEVICE void operator()(std::size_t pair) const
    {
        std::size_t const number = pair % count;
        Coarse const& own = coarse[number];
        auto const walls = walls_of(now->actions);
        reached[pair] = {};
        Coordinates<d> const way = Coarse::offset(static_cast<int>(pair / count)),
                             node = own.at * int{coarsening} + way;
        if (is_image(walls, node)) return;
        std::uint32_t const index = find(node);
        if (index == Nodes::absent) return;
        reached[pair] = {index, own.template weight<Number>(way)};
        auto const of_all = numbers == nullptr ? static_cast<std::uint32_t>(number) : numbers[number];
        link<0>(walls, node, index, 0, {of_all, reached[pair].weight}, Coarse::corner(way));
    }

private:
    FIRN_HOST_DEVICE std::uint32_t find(Coordinates<d> const& node) const
    {
        std::uint32_t const index = nodes.find(node);
        if (index == Nodes::absent || !(nodes.sum(index, Sums::mass) > smallest_mass)) return Nodes::absent;
        return index;
    }
    template <class Walls>
    FIRN_HOST_DEVICE static bool is_image(Walls const& walls, Coordinates<d> const& node)
    {
        bool is = false;
        for (WallPlane const& wall : walls) is = is || (node[wall.axis] - wall.node) * wall.side < 0;
        return is;
    }
    /// Links a node, and its images across walls of this axis and those behind it.
    template <int axis, class Walls>
    FIRN_HOST_DEVICE void link(Walls const& walls, Coordinates<d> const& node, std::uint32_t index,
                               std::uint32_t flipped, NodeWeight<Number> const& by, int corner) const
    {
        if constexpr (axis == d) {
            if (index == Nodes::absent) return;
            linked[index].corners[std::size_t(corner)] = by;
            linked[index].flipped = flipped | NodeInCoarse<Number, d>::takes_part;
        }
        else {
            link<axis + 1>(walls, node, index, flipped, by, corner);
            for (WallPlane const& wall : walls) {
                if (wall.axis != axis || !wall.mirrors(node[axis])) continue;
                Coordinates<d> image = node;
                image[axis] = wall.image(node[axis]);
                link<axis + 1>(walls, image, find(image), flipped | 1u << axis, by, corner);
            }
        }
    }
};

/// Adds what coarse nodes have found to the preconditioned residual of each node, but for what is held; and
/// adds up R c of CorrectFirst in parts, as which the numbers behind those of nodes count. Nodes are those of
/// a list, or all.
template <class Space, class Kernel, class Transfer, class Nodes>
struct ProlongCorrection
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
    static constexpr std::size_t of_part = 64; ///< coarse nodes

    Nodes nodes;
    std::uint32_t const* list; ///< of indices, or nullptr
    std::size_t node_count;
    NodeInCoarse<Number, d> const* linked;
    Vector<double, d> const* correction;
    double const* products;
    std::size_t coarse_count;
    double* parts;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i < node_count)
            prolong(list == nullptr ? static_cast<std::uint32_t>(i) : list[i]);
        else {
            std::size_t const part = i - node_count;
            double sum = 0;
            for (std::size_t n = part * of_part; n < coarse_count && n < (part + 1) * of_part; ++n)
                sum += products[n];
            parts[part] = sum;
        }
    }

private:
    FIRN_HOST_DEVICE void prolong(std::uint32_t index) const
    {
        NodeInCoarse<Number, d> const& own = linked[index];
        if (own.flipped == 0) return;
        Vector<Number, d> sum = zeros<Vector<Number, d>>();
        for (auto const& [number, w] : own.corners)
            if (w > Number(0))
                for (int a = 0; a < d; ++a) sum[a] += w * Number(correction[number][a]);
        for (int a = 0; a < d; ++a)
            if ((own.flipped >> a & 1) != 0) sum[a] = -sum[a];
        for (int a = 0; a < d; ++a) {
            Number free = 0;
            for (int b = 0; b < d; ++b) free += nodes.value(index, Own::free_at(a, b)) * sum[b];
            nodes.value(index, Own::conditioned + a) += free;
        }
    }
};

} // namespace firn

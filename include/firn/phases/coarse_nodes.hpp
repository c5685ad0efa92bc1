// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
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
    static constexpr int beside_count = d == 3 ? 27 : 9, reached_count = d == 3 ? 343 : 49;
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
    std::array<NodeWeight<Number>, std::size_t(1 << d)> corners{};
    std::uint32_t flipped = 0; ///< a bit for each axis
};

/// The cells around a node that hold a particle: between nodes, by a bit for each corner of the node.
template <int d>
struct HeldCells
{
    Coordinates<d> node = zeros<Coordinates<d>>();
    std::uint32_t corners = 0;

    /// Calls `use(cell)` for each, by the lowest of its own nodes.
    template <class Use>
    void for_each(Use const& use) const
    {
        for (int corner = 0; corner < 1 << d; ++corner) {
            if ((corners >> corner & 1) == 0) continue;
            Coordinates<d> cell = node;
            for (int a = 0; a < d; ++a) cell[a] -= (corner >> a) & 1;
            use(cell);
        }
    }
};

/// Notes for each particle of a material in which of the cells around a node it lies.
template <class Number, int d, class Nodes>
struct NoteHeldCells
{
    Nodes nodes;
    std::array<typename CellOffset<Number>::Stored const*, std::size_t(d)> offset;
    bool between_nodes; ///< cells lie between nodes already, which they do for kernels of an odd degree
    HeldCells<d>* held; ///< for each index of a node

    FIRN_HOST_DEVICE void operator()(std::size_t place, Coordinates<d> const& cell) const
    {
        std::uint32_t const index = nodes.find(cell);
        if (index == Nodes::absent) return;
        int corner = 0;
        if (!between_nodes)
            for (int a = 0; a < d; ++a)
                corner |= (CellOffset<Number>::exact(offset[std::size_t(a)][place]) < 0 ? 1 : 0) << a;
        held[index].node = cell;
        held[index].corners |= 1u << corner; // the particles of a cell are visited one after the other
    }
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
    NodeWeight<Number>* reached;     ///< Coarse::reached_count for each coarse node
    NodeInCoarse<Number, d>* linked; ///< for each index of a node

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Coarse const& own = coarse[number];
        auto const walls = walls_of(now->actions);
        for (int i = 0; i < Coarse::reached_count; ++i) {
            auto& to = reached[number * std::size_t(Coarse::reached_count) + std::size_t(i)];
            to = {};
            Coordinates<d> const way = Coarse::offset(i), node = own.at * int{coarsening} + way;
            if (is_image(walls, node)) continue;
            std::uint32_t const index = find(node);
            if (index == Nodes::absent) continue;
            to = {index, own.template weight<Number>(way)};
            link<0>(walls, node, index, 0, {static_cast<std::uint32_t>(number), to.weight},
                    Coarse::corner(way));
        }
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
            linked[index].flipped = flipped;
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

/// What a coarse node knows of the system: mass, how much stress resists, and how much nodes that are held
/// do.
template <int d>
struct CoarseWeights
{
    double mass = 0, resists = 0;
    std::array<double, std::size_t(d)> held{};         ///< by weights
    std::array<double, std::size_t(d)> held_squares{}; ///< by their squares
};

/// Sums that up, of each coarse node.
template <class Space, class Kernel, class Transfer, class Nodes>
struct WeighCoarseNodes
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
    using Coarse = CoarseNode<d>;

    Nodes nodes;
    NodeWeight<Number> const* reached;
    CoarseWeights<d>* weights;
    bool at_rest;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        CoarseWeights<d> sum;
        for (int i = 0; i < Coarse::reached_count; ++i) {
            auto const [index, w] = reached[number * std::size_t(Coarse::reached_count) + std::size_t(i)];
            if (!(w > Number(0))) continue;
            double const mass = double(nodes.value(index, Own::mass)),
                         diagonal = double(nodes.value(index, Own::stiffness)), weight = double(w);
            sum.mass += weight * mass;
            sum.resists += weight * (at_rest ? diagonal : diagonal - mass);
            for (int a = 0; a < d; ++a) {
                double const held = diagonal * (1 - double(nodes.value(index, Own::free_at(a, a))));
                sum.held[std::size_t(a)] += weight * held;
                sum.held_squares[std::size_t(a)] += weight * weight * held;
            }
        }
        weights[number] = sum;
    }
};

/// Sums up the residual of each coarse node.
template <class Space, class Kernel, class Transfer, class Nodes>
struct RestrictResidual
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
    using Coarse = CoarseNode<d>;

    Nodes nodes;
    NodeWeight<Number> const* reached;
    Vector<double, d>* residual;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<Number, d> sum = zeros<Vector<Number, d>>();
        for (int i = 0; i < Coarse::reached_count; ++i) {
            auto const [index, w] = reached[number * std::size_t(Coarse::reached_count) + std::size_t(i)];
            if (!(w > Number(0))) continue;
            for (int a = 0; a < d; ++a) sum[a] += w * nodes.value(index, Own::residual + a);
        }
        for (int a = 0; a < d; ++a) residual[number][a] = double(sum[a]);
    }
};

/// Adds what coarse nodes have found to the preconditioned residual of each node.
template <class Space, class Kernel, class Transfer, class Nodes>
struct ProlongCorrection
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;

    Nodes nodes;
    NodeInCoarse<Number, d> const* linked;
    Vector<double, d> const* correction;

    FIRN_HOST_DEVICE void operator()(std::size_t index) const
    {
        NodeInCoarse<Number, d> const& own = linked[index];
        Vector<Number, d> sum = zeros<Vector<Number, d>>();
        bool any = false;
        for (auto const& [number, w] : own.corners)
            if (w > Number(0)) {
                any = true;
                for (int a = 0; a < d; ++a) sum[a] += w * Number(correction[number][a]);
            }
        if (!any) return;
        for (int a = 0; a < d; ++a) {
            auto& value = nodes.value(static_cast<std::uint32_t>(index), Own::conditioned + a);
            value += (own.flipped >> a & 1) != 0 ? -sum[a] : sum[a];
        }
    }
};

} // namespace firn

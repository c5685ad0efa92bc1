// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/phases/coarse_nodes.hpp>
#include <firn/phases/solve_phase.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// What coarse nodes sum up over the grid's own nodes, and where they are needed: see coarse_nodes.hpp.
namespace firn
{

/// The cells around a node that hold a particle, of those that lie in different coarse cells: between nodes,
/// by a bit for each corner of the node.
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
        int corner = 0; // other planes than those of coarse nodes have the same coarse cell on both sides
        for (int a = 0; a < d; ++a)
            if (!between_nodes && cell[a] % coarsening == 0)
                corner |= (CellOffset<Number>::exact(offset[std::size_t(a)][place]) < 0 ? 1 : 0) << a;
        held[index].node = cell;
        held[index].corners |= 1u << corner; // the particles of a cell are visited one after the other
    }
};

/// What a coarse node knows of the system: mass, how much stress resists, and how much nodes that are held
/// do.
template <class Number, int d>
struct CoarseWeights
{
    Number mass = 0, resists = 0;
    std::array<Number, std::size_t(d)> held{};         ///< by weights
    std::array<Number, std::size_t(d)> held_squares{}; ///< by their squares

    template <class Other>
    FIRN_HOST_DEVICE void add(CoarseWeights<Other, d> const& other)
    {
        mass += other.mass, resists += other.resists;
        for (std::size_t a = 0; a < std::size_t(d); ++a) {
            held[a] += other.held[a];
            held_squares[a] += other.held_squares[a];
        }
    }
};

/// What the phases have in common that sum up over the nodes which coarse nodes reach: first line by line,
/// for coarse nodes one after the other, so that many sums are on their way at once.
template <class Space, class Kernel, class Transfer, class Nodes>
struct LineOfCoarseNode
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;

    Nodes nodes;
    NodeWeight<Number> const* reached;
    std::size_t count; ///< of coarse nodes

    /// Calls `use(index of a node, weight)` for the nodes of a line.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(std::size_t line_of_node, Use const& use) const
    {
        constexpr int along = CoarseNode<d>::along;
        std::size_t const number = line_of_node % count, first = line_of_node / count * std::size_t(along);
        NodeWeight<Number> links[std::size_t(along)];
        for (int i = 0; i < along; ++i) links[i] = reached[(first + std::size_t(i)) * count + number];
        for (auto const& [index, w] : links)
            if (w > Number(0)) use(index, w);
    }
};

/// Sums up what coarse nodes know of the system.
template <class Space, class Kernel, class Transfer, class Nodes>
struct WeighLines : LineOfCoarseNode<Space, Kernel, Transfer, Nodes>
{
    using Base = LineOfCoarseNode<Space, Kernel, Transfer, Nodes>;
    using Base::d;
    using typename Base::Number, typename Base::Own;

    CoarseWeights<Number, d>* lines;
    bool at_rest;

    FIRN_HOST_DEVICE void operator()(std::size_t line) const
    {
        CoarseWeights<Number, d> sum;
        this->for_each(line, [&](std::uint32_t index, Number w) {
            Number const mass = this->nodes.value(index, Own::mass),
                         diagonal = this->nodes.value(index, Own::stiffness);
            sum.mass += w * mass;
            sum.resists += w * (at_rest ? diagonal : diagonal - mass);
            for (int a = 0; a < d; ++a) {
                Number const held = diagonal * (1 - this->nodes.value(index, Own::free_at(a, a)));
                sum.held[std::size_t(a)] += w * held;
                sum.held_squares[std::size_t(a)] += w * w * held;
            }
        });
        lines[line] = sum;
    }
};
template <class Number, int d>
struct AddWeightsOfLines
{
    std::size_t count; ///< of coarse nodes
    CoarseWeights<Number, d> const* lines;
    CoarseWeights<double, d>* weights;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        CoarseWeights<double, d> sum;
        for (int line = 0; line < CoarseNode<d>::lines; ++line)
            sum.add(lines[std::size_t(line) * count + number]);
        weights[number] = sum;
    }
};

/// Sums up the residual of coarse nodes.
template <class Space, class Kernel, class Transfer, class Nodes>
struct RestrictLines : LineOfCoarseNode<Space, Kernel, Transfer, Nodes>
{
    using Base = LineOfCoarseNode<Space, Kernel, Transfer, Nodes>;
    using Base::d;
    using typename Base::Number, typename Base::Own;

    Vector<Number, d>* lines;

    FIRN_HOST_DEVICE void operator()(std::size_t line) const
    {
        Vector<Number, d> sum = zeros<Vector<Number, d>>();
        this->for_each(line, [&](std::uint32_t index, Number w) {
            for (int a = 0; a < d; ++a) sum[a] += w * this->nodes.value(index, Own::residual + a);
        });
        lines[line] = sum;
    }
};
template <class Number, int d>
struct AddResidualsOfLines
{
    std::size_t count; ///< of coarse nodes
    Vector<Number, d> const* lines;
    Vector<double, d>* residual;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> sum = zeros<Vector<double, d>>();
        FIRN_UNROLL
        for (int line = 0; line < CoarseNode<d>::lines; ++line)
            for (int a = 0; a < d; ++a) sum[a] += double(lines[std::size_t(line) * count + number][a]);
        residual[number] = sum;
    }
};

} // namespace firn

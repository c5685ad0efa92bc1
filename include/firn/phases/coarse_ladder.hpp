// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/phases/coarse_nodes.hpp>
#include <firn/phases/coarse_sums.hpp>

#include <cstddef>
#include <cstdint>

// What the grids of the preconditioner's ladder do with each other, node by node. `begin[i]` to `begin[i +
// 1]` are the links of node i with another grid of the ladder.
namespace firn
{

/// What is linked with the nodes of a grid of the ladder, and by which weights.
struct LadderLinks
{
    std::uint32_t const* begin;
    NodeWeight<double> const* links;

    /// Calls `use(node of the other grid, weight)` in the order of the links.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(std::size_t node, Use const& use) const
    {
        for (std::uint32_t i = begin[node]; i < begin[node + 1]; ++i)
            use(std::size_t(links[i].node), links[i].weight);
    }
};

/// Sums up what the nodes of a grid know of the system, from those of the finer grid.
template <int d>
struct WeighLevel
{
    LadderLinks finer;
    CoarseWeights<double, d> const* of_finer;
    CoarseWeights<double, d>* own;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        CoarseWeights<double, d> sum;
        finer.for_each(number, [&](std::size_t from, double w) {
            auto const& of = of_finer[from];
            sum.mass += w * of.mass;
            sum.resists += w * of.resists;
            for (std::size_t a = 0; a < std::size_t(d); ++a) {
                sum.held[a] += w * of.held[a];
                sum.held_squares[a] += w * w * of.held[a];
            }
        });
        own[number] = sum;
    }
};

/// One over the diagonal of each node.
template <int d>
struct InvertDiagonal
{
    CoarseWeights<double, d> const* weights;
    Vector<double, d>* inverse;
    double stiffening; ///< of what stress resists, for a grid of this cell size
    bool at_rest;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        auto const& of = weights[number];
        for (int a = 0; a < d; ++a) {
            double const diagonal =
                (at_rest ? 0 : of.mass) + of.resists * stiffening + of.held_squares[std::size_t(a)];
            inverse[number][a] = diagonal > 0 ? 1 / diagonal : 0;
        }
    }
};

/// Sums up residuals for coarser grids, of the first grid's nodes and link by link in parts of a node's sum.
template <int d>
struct RestrictPart
{
    LadderLinks links; ///< of each part, with nodes of the first grid
    Vector<double, d> const* of_first;
    Vector<double, d>* parts;

    FIRN_HOST_DEVICE void operator()(std::size_t part) const
    {
        Vector<double, d> sum = zeros<Vector<double, d>>();
        links.for_each(part, [&](std::size_t from, double w) { sum += of_first[from] * w; });
        parts[part] = sum;
    }
};

/// The parts become a coarser grid's correction.
template <int d>
struct CorrectCoarser
{
    std::uint32_t const* begin; ///< of each node's parts
    Vector<double, d> const* parts;
    Vector<double, d> const* inverse; ///< of the diagonal
    Vector<double, d>* values;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> sum = zeros<Vector<double, d>>();
        for (std::uint32_t part = begin[number]; part < begin[number + 1]; ++part) sum += parts[part];
        for (int a = 0; a < d; ++a) values[number][a] = sum[a] * inverse[number][a];
    }
};

/// The residuals of the first grid's nodes become corrections, to which those of all coarser grids are added.
template <int d>
struct CorrectFirst
{
    LadderLinks coarser; ///< of each node with those of coarser grids
    Vector<double, d> const* of_coarser;
    Vector<double, d> const* inverse; ///< of the diagonal
    Vector<double, d>* values;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> sum = values[number];
        for (int a = 0; a < d; ++a) sum[a] *= inverse[number][a];
        coarser.for_each(number, [&](std::size_t to, double w) { sum += of_coarser[to] * w; });
        values[number] = sum;
    }
};

} // namespace firn

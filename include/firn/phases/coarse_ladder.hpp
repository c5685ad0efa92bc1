// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/phases/coarse_nodes.hpp>

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
    CoarseWeights<d> const* of_finer;
    CoarseWeights<d>* own;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        CoarseWeights<d> sum;
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
    CoarseWeights<d> const* weights;
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

/// Sums up the residual of a grid's nodes, from those of the finer grid.
template <int d>
struct RestrictLevel
{
    LadderLinks finer;
    Vector<double, d> const* of_finer;
    Vector<double, d>* own;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> sum = zeros<Vector<double, d>>();
        finer.for_each(number, [&](std::size_t from, double w) { sum += of_finer[from] * w; });
        own[number] = sum;
    }
};

/// The residuals of a grid's nodes become corrections, to which those of the coarser grid are added.
template <int d>
struct ProlongLevel
{
    bool is_last; ///< there is no coarser grid
    LadderLinks coarser;
    Vector<double, d> const* of_coarser;
    Vector<double, d> const* inverse; ///< of the diagonal
    Vector<double, d>* own;

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> sum = own[number];
        for (int a = 0; a < d; ++a) sum[a] *= inverse[number][a];
        if (!is_last) coarser.for_each(number, [&](std::size_t to, double w) { sum += of_coarser[to] * w; });
        own[number] = sum;
    }
};

} // namespace firn

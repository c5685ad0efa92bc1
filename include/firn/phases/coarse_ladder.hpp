// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/math/product.hpp>
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

    /// Calls `use(value of the other grid's node, weight)` in the order of the links. Some are loaded at a
    /// time, since a device would wait for each that is used before the next is loaded.
    template <class T, class Use>
    FIRN_HOST_DEVICE void for_each(std::size_t node, T const* values, Use const& use) const
    {
        constexpr std::uint32_t at_once = 8;
        std::uint32_t const end = begin[node + 1];
        for (std::uint32_t i = begin[node]; i < end; i += at_once) {
            NodeWeight<double> own[std::size_t(at_once)];
            FIRN_UNROLL
            for (std::uint32_t k = 0; k < at_once; ++k)
                own[k] = i + k < end ? links[i + k] : NodeWeight<double>{links[i].node, 0};
            T of[std::size_t(at_once)];
            FIRN_UNROLL
            for (std::uint32_t k = 0; k < at_once; ++k) of[k] = values[own[k].node];
            FIRN_UNROLL
            for (std::uint32_t k = 0; k < at_once; ++k) use(of[k], own[k].weight);
        }
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
        finer.for_each(number, of_finer, [&](auto const& of, double w) {
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
        links.for_each(part, of_first, [&](auto const& value, double w) { sum += value * w; });
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
        constexpr std::uint32_t at_once = 8;
        std::uint32_t const end = begin[number + 1];
        for (std::uint32_t part = begin[number]; part < end; part += at_once) {
            Vector<double, d> some[std::size_t(at_once)];
            FIRN_UNROLL
            for (std::uint32_t k = 0; k < at_once; ++k)
                some[k] = part + k < end ? parts[part + k] : zeros<Vector<double, d>>();
            FIRN_UNROLL
            for (std::uint32_t k = 0; k < at_once; ++k) sum += some[k];
        }
        for (int a = 0; a < d; ++a) values[number][a] = sum[a] * inverse[number][a];
    }
};

/// The residuals R of the first grid's nodes become corrections c, to which those of all coarser grids are
/// added. What they add to r z is R c.
template <int d>
struct CorrectFirst
{
    LadderLinks coarser; ///< of each node with those of coarser grids
    Vector<double, d> const* of_coarser;
    Vector<double, d> const* inverse; ///< of the diagonal
    Vector<double, d>* values;
    double* products; ///< R c

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        Vector<double, d> const residual = values[number];
        Vector<double, d> sum = residual;
        for (int a = 0; a < d; ++a) sum[a] *= inverse[number][a];
        coarser.for_each(number, of_coarser, [&](auto const& value, double w) { sum += value * w; });
        values[number] = sum;
        products[number] = dot<double, d>(residual, sum);
    }
};

} // namespace firn

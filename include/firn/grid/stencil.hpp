// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <array>
#include <cassert>
#include <cstddef>
#include <limits>

namespace firn
{

/// A particle's stencil: per axis the weights of its nodes, their derivatives and their distances from the
/// particle.
///
/// Node (i, j, k) has weight N_i N_j N_k. Nodes are visited in *rows* along the last axis, so that factors
/// common to a row (a product over the other axes) are computed once, and so that a backend can store rows
/// contiguously.
template <class Kernel, Lane Real, int d>
struct Stencil
{
    static constexpr int width = Kernel::degree + 1; ///< nodes per axis
    static constexpr int rows = d == 3 ? width * width : width;
    static constexpr int last = d - 1;

    std::array<std::array<Real, std::size_t(width)>, std::size_t(d)> weight;     ///< N_i
    std::array<std::array<Real, std::size_t(width)>, std::size_t(d)> derivative; ///< dN_i/dx in 1/h
    std::array<std::array<Real, std::size_t(width)>, std::size_t(d)> distance;   ///< x_i - x_p in cells

    /// The stencil of a particle at an offset from its cell's centre, in cells.
    FIRN_HOST_DEVICE explicit Stencil(Vector<Real, d> const& offset)
    {
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            auto const weights = Kernel::weights(offset[a]), derivatives = Kernel::derivatives(offset[a]);
            assert(add_up_to_one(weights) && "the weights of a stencil add up to one");
            FIRN_UNROLL
            for (int i = 0; i < width; ++i) { // one by one: see copy_of()
                weight[std::size_t(a)][std::size_t(i)] = weights[std::size_t(i)];
                derivative[std::size_t(a)][std::size_t(i)] = derivatives[std::size_t(i)];
                distance[std::size_t(a)][std::size_t(i)] =
                    Real(ScalarOf<Real>(i) - ScalarOf<Real>(0.5) * Kernel::degree) - offset[a];
            }
        }
    }

    /// The index of a row's nodes along an axis other than the last.
    FIRN_HOST_DEVICE static constexpr int index(int row, int axis)
    {
        return d == 2 ? row : (axis == 0 ? row / width : row % width);
    }

    /// The product of the weights of all axes but the last.
    FIRN_HOST_DEVICE Real row_weight(int row) const
    {
        Real product = weight[0][place(row, 0)];
        if constexpr (d == 3) product = product * weight[1][place(row, 1)];
        return product;
    }

    /// The row's part of the gradient along `axis` (not the last): the derivative there, weights elsewhere.
    FIRN_HOST_DEVICE Real row_gradient(int row, int axis) const
    {
        Real product = derivative[std::size_t(axis)][place(row, axis)];
        if constexpr (d == 3) product = product * weight[std::size_t(1 - axis)][place(row, 1 - axis)];
        return product;
    }

    /// Whether weights add up to one, up to rounding.
    FIRN_HOST_DEVICE static bool add_up_to_one(std::array<Real, std::size_t(width)> const& weights)
    {
        Real sum = weights[0];
        for (int i = 1; i < width; ++i) sum += weights[std::size_t(i)];
        return all(abs(sum - Real(1)) <= Real(64 * std::numeric_limits<ScalarOf<Real>>::epsilon()));
    }

    /// The row's distance along `axis` (not the last), in cells.
    FIRN_HOST_DEVICE Real row_distance(int row, int axis) const
    {
        return distance[std::size_t(axis)][place(row, axis)];
    }

private:
    FIRN_HOST_DEVICE static constexpr std::size_t place(int row, int axis)
    {
        return static_cast<std::size_t>(index(row, axis));
    }
};

} // namespace firn

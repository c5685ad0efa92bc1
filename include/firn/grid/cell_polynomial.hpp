// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <array>
#include <cstddef>

namespace firn
{

/// A particle's factors of a CellPolynomial's terms: along each axis the powers t^m / m! of its offset from
/// the cell's centre, and the kernel's spreads.
template <class Kernel, Lane Real, int d>
struct Monomials
{
    static constexpr int degree = Kernel::degree;

    std::array<std::array<Real, std::size_t(degree)>, std::size_t(d)> power; ///< t^m / m!, m = 1, 2, …
    std::array<std::array<Real, std::size_t(degree)>, std::size_t(d)>
        spread; ///< Kernel::spreads: m = 1, 2, …

    FIRN_HOST_DEVICE explicit Monomials(Vector<Real, d> const& offset)
    {
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            power[std::size_t(a)][0] = offset[a];
            FIRN_UNROLL
            for (int m = 1; m < degree; ++m)
                power[std::size_t(a)][std::size_t(m)] = power[std::size_t(a)][std::size_t(m - 1)] *
                                                        offset[a] * Real(ScalarOf<Real>(1.0 / (m + 1)));
            if constexpr (requires { Kernel::spreads(offset[a]); })
                spread[std::size_t(a)] = Kernel::spreads(offset[a]);
        }
    }
};

/// The interpolant of the nodes around a cell: a B-spline is a polynomial within the cell, and this is its
/// expansion about the cell's centre, for some channels, the same for all particles of the cell.
///
/// Sums over a particle's stencil become polynomials of its offset, with half the multiplications and none of
/// the weights. A field that is the same on all nodes has no term but the first, so its gradient is exactly
/// zero.
template <class Kernel, Lane RealType, int d, int channel_count>
class CellPolynomial
{
    static constexpr int degree = Kernel::degree, width = degree + 1;
    static constexpr int rows = d == 3 ? width * width : width, terms = rows * width;

public:
    using Real = RealType;
    static constexpr int channels = channel_count;

    /// Reads the channels from `first` on: `nodes.node(channel, row, k)`, rows as in Stencil.
    template <class Nodes>
    FIRN_HOST_DEVICE void read(Nodes const& nodes, int first)
    {
        for (int c = 0; c < channels; ++c) {
            Real term[std::size_t(terms)];
            FIRN_UNROLL
            for (int row = 0; row < rows; ++row) {
                FIRN_UNROLL
                for (int k = 0; k < width; ++k) term[row * width + k] = nodes.node(first + c, row, k);
                expand<1>(&term[row * width]);
            }
            expand_across(term);
            FIRN_UNROLL
            for (int row = 0; row < rows; ++row) FIRN_UNROLL
            for (int k = 0; k < width; ++k) term_[c][row * width + k] = term[row * width + k];
        }
    }

    /// The sums at the particles' positions; terms that were not requested are not set.
    struct Found
    {
        Real value[std::size_t(channels)];                  ///< sum of w_i v_i
        Real affine[std::size_t(channels)][std::size_t(d)]; ///< sum of w_i v_i (x_i - x_p)^T D^-1 [per cell]
        Real gradient[std::size_t(channels)][std::size_t(d)]; ///< sum of v_i dw_i^T [per cell]
    };

    template <bool has_affine, bool has_gradient>
    FIRN_HOST_DEVICE Found at(Monomials<Kernel, Real, d> const& powers) const
    {
        return at<has_affine, has_gradient>(powers, [](Real const& term) { return term; });
    }
    /// The same for particles whose cells lie in other lanes: `pick(term)` moves each particle's term to its
    /// own lane.
    template <bool has_affine, bool has_gradient, class Pick>
    FIRN_HOST_DEVICE Found at(Monomials<Kernel, Real, d> const& powers, Pick const& pick) const
    {
        Found found;
        sum<0, has_affine, has_gradient>(powers, 0, pick, found);
        return found;
    }

private:
    /// Replaces nodal values by the expansion along one axis.
    template <int stride>
    FIRN_HOST_DEVICE static void expand(Real* line)
    {
        std::array<Real, std::size_t(width)> node;
        FIRN_UNROLL
        for (int m = 0; m < width; ++m) node[std::size_t(m)] = line[m * stride];
        node = Kernel::expanded(node);
        FIRN_UNROLL
        for (int m = 0; m < width; ++m) line[m * stride] = node[std::size_t(m)];
    }

    /// Expands along all axes but the last.
    FIRN_HOST_DEVICE static void expand_across(Real (&term)[std::size_t(terms)])
    {
        if constexpr (d == 3) {
            FIRN_UNROLL
            for (int row = 0; row < rows; ++row) expand<width>(&term[row / width * rows + row % width]);
        }
        FIRN_UNROLL
        for (int i = 0; i < rows; ++i) expand<rows>(&term[i]);
    }

    /// The sum over the axes from `axis` on of the terms from `first` on.
    template <int axis, bool has_affine, bool has_gradient, class Pick>
    FIRN_HOST_DEVICE void sum(Monomials<Kernel, Real, d> const& powers, int first, Pick const& pick,
                              Found& found) const
    {
        if constexpr (axis == d) {
            FIRN_UNROLL
            for (int c = 0; c < channels; ++c) found.value[c] = pick(term_[c][first]);
        }
        else {
            sum<axis + 1, has_affine, has_gradient>(powers, first * width, pick, found);
            FIRN_UNROLL
            for (int m = 1; m <= degree; ++m) {
                Found part;
                sum<axis + 1, has_affine, has_gradient>(powers, first * width + m, pick, part);
                Real const power = powers.power[axis][std::size_t(m - 1)];
                FIRN_UNROLL
                for (int c = 0; c < channels; ++c) {
                    Real const value = part.value[c];
                    // The first spread is 1, and so is the derivative of the first power.
                    if constexpr (has_affine)
                        found.affine[c][axis] =
                            m == 1 ? value
                                   : found.affine[c][axis] + value * powers.spread[axis][std::size_t(m - 1)];
                    if constexpr (has_gradient)
                        found.gradient[c][axis] =
                            m == 1 ? value
                                   : found.gradient[c][axis] + value * powers.power[axis][std::size_t(m - 2)];
                    found.value[c] += value * power;
                    FIRN_UNROLL
                    for (int a = axis + 1; a < d; ++a) {
                        if constexpr (has_affine) found.affine[c][a] += part.affine[c][a] * power;
                        if constexpr (has_gradient) found.gradient[c][a] += part.gradient[c][a] * power;
                    }
                }
            }
        }
    }

    Real term_[std::size_t(channels)][std::size_t(terms)];
};

} // namespace firn

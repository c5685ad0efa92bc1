// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/transfer/node_fields.hpp>

#include <array>
#include <cstddef>

namespace firn
{

/// A node's channels where particles scatter an impulse of stress alone.
template <int d>
struct StressSums
{
    static constexpr bool forces_are_apart = false;
    static constexpr int momentum = 0, impulse = 0, channels = d;

    /// The axis of a vector's component.
    FIRN_HOST_DEVICE static constexpr int axis(int c) { return c; }
};

/// The scatter of an impulse S of stress without mass or momentum [N s per cell]:
///
///   f_i = sum_p S_p grad w_ip,    or for MLS-MPM    sum_p w_ip S_p (x_i - x_p)
///
/// It is otherwise as Scatter, whose form of the second sum it takes.
template <class Space, class Kernel, class Transfer>
struct ScatterStress
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = StressSums<d>;
    static constexpr bool by_gradient = Transfer::template by_gradient<Kernel>;
    static constexpr int channels = Sums::channels;
    static constexpr int width = Kernel::degree + 1, rows = d == 3 ? width * width : width; ///< of a stencil
    static constexpr int rows_of_layer = rows / width; ///< a layer is one place of the first axis

    // Scratch channels of a particle.
    static constexpr int position = 0, stress = d, scratch_channels = d + d * d;

    /// Stores S of particles whose position is in their scratch already.
    template <class Items, Lane Real>
    FIRN_HOST_DEVICE static void store(Items& items, Matrix<Real, d> const& S)
    {
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) FIRN_UNROLL
        for (int j = 0; j < d; ++j) items.set_scratch(stress + i * d + j, S(i, j));
    }

    /// What the rows of a particle's stencil have in common, by axis from the second on.
    template <class Real>
    struct Contribution
    {
        using OfAxis = std::array<Real, std::size_t(width)>;
        std::array<OfAxis, std::size_t(d - 1)> weight;
        std::array<OfAxis, std::size_t(by_gradient ? d - 1 : 0)> derivative;
        std::array<Vector<Real, d>, std::size_t(d - 1)> column; ///< of S
    };
    /// What belongs to one layer of the stencil: the weight along the first axis, and S times the gradient
    /// along it, or times the distance of the layer's first node.
    template <class Real>
    struct Layer
    {
        Real weight;
        Vector<Real, d> force;
    };
    /// The contribution and all layers.
    template <class Real>
    struct Spread : Contribution<Real>
    {
        Layer<Real> layer[std::size_t(width)];
    };

    /// Prepares the contributions of the row's particles, one per cell.
    template <class Row, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void make_ready(Row const& row_of_cells, Spread<Real>& spread)
    {
        Vector<Real, d> const x = position_of<Real>(row_of_cells);
        make_ready(row_of_cells, x, spread);
        Vector<Real, d> const first = column_of<Real>(row_of_cells, 0),
                              begin = first_distance<Real>(spread, x);
        auto const weights = Kernel::weights(x[0]), derivatives = Kernel::derivatives(x[0]);
        FIRN_UNROLL
        for (int i = 0; i < width; ++i) {
            auto& layer = spread.layer[i];
            layer.weight = weights[std::size_t(i)];
            if constexpr (by_gradient)
                layer.force = first * derivatives[std::size_t(i)];
            else
                layer.force = begin + first * distance(x[0], i);
        }
    }

    /// Adds the contributions to the nodes of one row of the stencils: to `nodes[k][channel]`.
    template <class Real, class NodesOfRow>
    FIRN_HOST_DEVICE static void scatter(Spread<Real> const& spread, int row, NodesOfRow&& nodes)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        scatter(spread, spread.layer[Nodes::index(row, 0)], Nodes::index(row, 1), nodes);
    }

    /// The same for all rows, one after the other: to `sums[k][row][channel]`.
    template <class Row, class SumsOfCells, class Real = typename Row::Real>
    FIRN_OPAQUE FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Spread<Real> spread;
        make_ready(row_of_cells, spread);
        FIRN_UNROLL_ON_DEVICE
        for (int row = 0; row < rows; ++row) scatter(spread, row, RowOfSums<SumsOfCells>{sums, row});
    }

    /// There is no momentum to be relative to.
    struct Frame
    {};
    template <class Row>
    FIRN_HOST_DEVICE static Frame frame_of(Row const&)
    {
        return {};
    }
    template <class SumsOfLayer>
    FIRN_HOST_DEVICE static void leave_frame(Frame, SumsOfLayer&)
    {}

    /// For one layer of the stencil: to `sums[k][row of the layer][channel]`.
    template <class Row, class SumsOfLayer, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void scatter_layer(Row const& row_of_cells, int which, Frame, SumsOfLayer& sums)
    {
        Vector<Real, d> const x = position_of<Real>(row_of_cells);
        Contribution<Real> contribution;
        make_ready(row_of_cells, x, contribution);
        Layer<Real> layer;
        Real slope;
        auto const weights = Kernel::weights(x[0]), derivatives = Kernel::derivatives(x[0]);
        FIRN_UNROLL
        for (int i = 0; i < width; ++i) // chosen one by one: an array with an index would lie in memory
            if (i == 0 || which == i) {
                layer.weight = weights[std::size_t(i)];
                slope = by_gradient ? derivatives[std::size_t(i)] : distance(x[0], i);
            }
        layer.force = column_of<Real>(row_of_cells, 0) * slope;
        if constexpr (!by_gradient) layer.force += first_distance<Real>(contribution, x);
        FIRN_UNROLL
        for (int row = 0; row < rows_of_layer; ++row)
            scatter(contribution, layer, row, RowOfSums<SumsOfLayer>{sums, row});
    }

private:
    template <class Row, class Real>
    FIRN_HOST_DEVICE static void make_ready(Row const& row_of_cells, Vector<Real, d> const& x,
                                            Contribution<Real>& contribution)
    {
        FIRN_UNROLL
        for (int a = 1; a < d; ++a) {
            contribution.column[std::size_t(a - 1)] = column_of<Real>(row_of_cells, a);
            auto const weights = Kernel::weights(x[a]), derivatives = Kernel::derivatives(x[a]);
            FIRN_UNROLL
            for (int i = 0; i < width; ++i) { // one by one: see copy_of()
                contribution.weight[std::size_t(a - 1)][std::size_t(i)] = weights[std::size_t(i)];
                if constexpr (by_gradient)
                    contribution.derivative[std::size_t(a - 1)][std::size_t(i)] = derivatives[std::size_t(i)];
            }
        }
    }
    /// Of a node from a particle, along an axis [cells]. Not from a Stencil, which packs would keep in
    /// memory.
    template <class Real>
    FIRN_HOST_DEVICE static Real distance(Real const& x, int i)
    {
        return Real(ScalarOf<Real>(i) - ScalarOf<Real>(0.5) * Kernel::degree) - x;
    }
    /// S times the distance of the first node, along all axes but the first.
    template <class Real>
    FIRN_HOST_DEVICE static Vector<Real, d> first_distance(Contribution<Real> const& contribution,
                                                           Vector<Real, d> const& x)
    {
        Vector<Real, d> sum = contribution.column[0] * distance(x[1], 0);
        if constexpr (d == 3) sum += contribution.column[1] * distance(x[2], 0);
        return sum;
    }

    /// A row of a layer.
    template <class Real, class NodesOfRow>
    FIRN_HOST_DEVICE static void scatter(Contribution<Real> const& spread, Layer<Real> const& layer,
                                         [[maybe_unused]] int second, NodesOfRow&& nodes)
    {
        constexpr std::size_t last = d - 2; // of the axes from the second on
        Real w_row = layer.weight;
        Vector<Real, d> force = layer.force;
        if constexpr (d == 3) {
            Real const w = spread.weight[0][std::size_t(second)];
            if constexpr (by_gradient)
                force = force * w + spread.column[0] * (w_row * spread.derivative[0][std::size_t(second)]);
            else
                force += spread.column[0] * Real(ScalarOf<Real>(second));
            w_row = w_row * w;
        }
        Vector<Real, d> along;
        if constexpr (by_gradient) along = spread.column[last] * w_row;
        FIRN_UNROLL
        for (int k = 0; k < width; ++k) {
            Real const w_k = spread.weight[last][std::size_t(k)];
            auto&& sums = nodes[k];
            if constexpr (by_gradient) {
                Real const dw_k = spread.derivative[last][std::size_t(k)];
                FIRN_UNROLL
                for (int a = 0; a < d; ++a) sums[a] += force[a] * w_k + along[a] * dw_k;
            }
            else {
                Real const w = w_row * w_k;
                FIRN_UNROLL
                for (int a = 0; a < d; ++a) sums[a] += force[a] * w;
                if (k + 1 < width) force += spread.column[last];
            }
        }
    }

    template <class SumsOfCells>
    struct RowOfSums
    {
        SumsOfCells& sums;
        int row;
        FIRN_HOST_DEVICE decltype(auto) operator[](int k) const { return sums[k][row]; }
    };

    template <class Real, class Row>
    FIRN_HOST_DEVICE static Vector<Real, d> position_of(Row const& row)
    {
        return make_vector<Real, d>([&](int a) { return row.scratch(position + a); });
    }
    template <class Real, class Row>
    FIRN_HOST_DEVICE static Vector<Real, d> column_of(Row const& row, int j)
    {
        return make_vector<Real, d>([&](int i) { return row.scratch(stress + i * d + j); });
    }
};

} // namespace firn

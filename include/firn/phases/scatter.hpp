// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/stencil.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/transfer/node_fields.hpp>
#include <firn/transfer/transfer.hpp>

namespace firn
{

/// The scatter (P2G).
///
///   m_i      = sum_p w_ip m_p
///   (m v)_i  = sum_p w_ip (m_p v_p + A_p (x_i - x_p))            A_p: the transfer's affine term
///   (dt f)_i = - dt sum_p V0_p tau_p grad w_ip                    or the transfer's own form of it
///   s_i      = sum_p (w_ip s_p + grad w_ip . g_p)                 the terms of what the transfer carries
///
/// (Stomakhin et al. 2013, eq. 6 with V^n sigma = V0 tau; Jiang et al. 2015, eq. 8). First each particle's
/// terms are computed by the scheme's own `scatter`, in G2p2g or ParticlesToGrid, and stored in scratch. Then
/// each cell sums its particles' contributions to each node of its stencil, and adds them to the grid once,
/// however many particles it has.
template <class Space, class Kernel, class Transfer>
struct Scatter
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    using CarriedTerms = typename CarriedBy<Transfer>::ScatteredTerms;
    using CarriedGradients = FieldsOfGradients<CarriedTerms>;
    static constexpr Terms terms = Transfer::template scatter_terms<Kernel>;
    static constexpr bool needs_derivatives = terms.gradient || CarriedGradients::components(d) > 0;
    static constexpr int channels = Sums::channels;
    static constexpr int width = Kernel::degree + 1, rows = d == 3 ? width * width : width; ///< of a stencil

    // Scratch channels of a particle.
    static constexpr int position = 0, mass = d, momentum = d + 1, affine = 2 * d + 1;
    static constexpr int gradient = affine + (terms.affine ? d * d : 0);
    static constexpr int carried = gradient + (terms.gradient ? d * d : 0);
    static constexpr int scratch_channels = carried + CarriedTerms::components(d);

    template <class Items, class Real>
    FIRN_HOST_DEVICE static void store(Items& items, Vector<Real, d> const& x, Real m,
                                       ParticleContribution<Real, d> const& contribution,
                                       Record<Real, d, CarriedTerms> const& carried_terms)
    {
        items.set_scratch(mass, m);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            items.set_scratch(position + i, x[i]);
            items.set_scratch(momentum + i, contribution.momentum[i]);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine) items.set_scratch(affine + i * d + j, contribution.affine(i, j));
                if constexpr (terms.gradient)
                    items.set_scratch(gradient + i * d + j, contribution.gradient(i, j));
            }
        }
        for_each_component_of<CarriedTerms, d>(
            carried_terms, [&](int c, Real const& value) { items.set_scratch(carried + c, value); });
    }

    /// A particle's contribution, in the form that the rows of its stencil use.
    template <class Real>
    struct Spread : Record<Real, d, CarriedTerms>
    {
        Real mass;
        Vector<Real, d> momentum;
        /// affine (x_i - x_p) is linear in the node's indices: its value at the first node of each layer
        /// across the first axis, and its change from node to node along the others. It is not added to the
        /// momentum, beside which small differences would be rounded away, in steady motion the same in every
        /// step.
        Vector<Real, d> affine[std::size_t(terms.affine ? width : 1)];
        Vector<Real, d> change[std::size_t(d)]; ///< along axis a: [a], from 1 on
        Vector<Real, d> gradient[std::size_t(terms.gradient ? d : 1)];
        std::array<Real, std::size_t(width)> weight[std::size_t(d)];
        std::array<Real, std::size_t(width)> derivative[std::size_t(needs_derivatives ? d : 1)];
    };

    /// Prepares the contributions of the row's particles, one per cell.
    template <class Row, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void make_ready(Row const& row_of_cells, Spread<Real>& spread)
    {
        Stencil<Kernel, Real, d> const nodes(scratch_vector<Real>(row_of_cells, position));
        spread.mass = row_of_cells.scratch(mass);
        spread.momentum = scratch_vector<Real>(row_of_cells, momentum);
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) FIRN_UNROLL
        for (int i = 0; i < width; ++i)
            spread.weight[a][std::size_t(i)] =
                nodes.weight[std::size_t(a)][std::size_t(i)]; // one by one: see copy_of()
        if constexpr (terms.affine) {
            Matrix<Real, d> const A = scratch_matrix<Real>(row_of_cells, affine);
            FIRN_UNROLL
            for (int i = 0; i < width; ++i) {
                spread.affine[i] = column<Real, d>(A, 0) * nodes.distance[0][std::size_t(i)];
                FIRN_UNROLL
                for (int a = 1; a < d; ++a)
                    spread.affine[i] += column<Real, d>(A, a) * nodes.distance[std::size_t(a)][0];
            }
            FIRN_UNROLL
            for (int a = 1; a < d; ++a) spread.change[a] = column<Real, d>(A, a);
        }
        if constexpr (terms.gradient) {
            Matrix<Real, d> const G = scratch_matrix<Real>(row_of_cells, gradient);
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) {
                spread.gradient[a] = column<Real, d>(G, a);
                FIRN_UNROLL
                for (int i = 0; i < width; ++i)
                    spread.derivative[a][std::size_t(i)] = nodes.derivative[std::size_t(a)][std::size_t(i)];
            }
        }
        else if constexpr (needs_derivatives) {
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) FIRN_UNROLL
            for (int i = 0; i < width; ++i)
                spread.derivative[a][std::size_t(i)] = nodes.derivative[std::size_t(a)][std::size_t(i)];
        }
        for_each_component_of<CarriedTerms, d>(
            spread, [&](int c, Real& value) { value = row_of_cells.scratch(carried + c); });
    }

    /// Adds the contributions to the nodes of one row of the stencils: to `nodes[k][channel]`.
    template <class Real, class NodesOfRow>
    FIRN_HOST_DEVICE static void scatter(Spread<Real> const& spread, int row, NodesOfRow&& nodes)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        int const first = Nodes::index(row, 0), second = Nodes::index(row, 1);
        Real w_row = spread.weight[0][std::size_t(first)];
        if constexpr (d == 3) w_row = w_row * spread.weight[1][std::size_t(second)];
        Vector<Real, d> affine, force, along;
        if constexpr (terms.affine) {
            affine = spread.affine[first];
            if constexpr (d == 3) affine += spread.change[1] * Real(ScalarOf<Real>(second));
        }
        if constexpr (terms.gradient) {
            if constexpr (d == 3)
                force =
                    spread.gradient[0] *
                        (spread.derivative[0][std::size_t(first)] * spread.weight[1][std::size_t(second)]) +
                    spread.gradient[1] *
                        (spread.weight[0][std::size_t(first)] * spread.derivative[1][std::size_t(second)]);
            else
                force = spread.gradient[0] * spread.derivative[0][std::size_t(first)];
            along = spread.gradient[Nodes::last] * w_row;
        }
        CarriedRow<Real> carried_row;
        if constexpr (needs_derivatives) carried_row = prepare_carried(spread, first, second, w_row);
        FIRN_UNROLL
        for (int k = 0; k < width; ++k) {
            Real const w_k = spread.weight[Nodes::last][std::size_t(k)], w = w_row * w_k;
            auto&& sums = nodes[k];
            sums[Sums::mass] += spread.mass * w;
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) {
                sums[Sums::momentum + a] += spread.momentum[a] * w;
                if constexpr (terms.affine) sums[Sums::momentum + a] += affine[a] * w;
                if constexpr (terms.gradient)
                    sums[Sums::impulse + a] +=
                        force[a] * w_k + along[a] * spread.derivative[Nodes::last][std::size_t(k)];
            }
            if constexpr (needs_derivatives)
                add_carried(spread, carried_row, w, w_k, spread.derivative[Nodes::last][std::size_t(k)],
                            sums);
            else
                add_carried(spread, carried_row, w, w_k, w_k, sums);
            if constexpr (terms.affine)
                if (k + 1 < width) affine += spread.change[Nodes::last];
        }
    }

    /// Adds the contributions of the row's particles, one per cell, to the sums of their cells: to
    /// `sums[k][row][channel]`.
    template <class Row, class SumsOfCells, class Real = typename Row::Real>
    FIRN_OPAQUE FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Spread<Real> spread;
        make_ready(row_of_cells, spread);
        FIRN_UNROLL_ON_DEVICE
        for (int row = 0; row < rows; ++row) scatter(spread, row, RowOfSums<SumsOfCells>{sums, row});
    }

private:
    /// Of the gradient terms of carried fields in one row: what goes with the weights of its nodes, and what
    /// goes with their derivatives along the row.
    template <class Real>
    struct CarriedRow
    {
        Record<Real, d, CarriedGradients> across, along;
    };

    template <class Real>
    FIRN_HOST_DEVICE static CarriedRow<Real> prepare_carried(Spread<Real> const& spread, int first,
                                                             [[maybe_unused]] int second, Real w_row)
    {
        constexpr int last = d - 1;
        Real slope[std::size_t(last)]; // of the row's weight, along all axes but its own
        slope[0] = spread.derivative[0][std::size_t(first)];
        if constexpr (d == 3) {
            slope[0] = slope[0] * spread.weight[1][std::size_t(second)];
            slope[1] = spread.weight[0][std::size_t(first)] * spread.derivative[1][std::size_t(second)];
        }
        CarriedRow<Real> row;
        for_each_field(CarriedGradients{}, [&](auto tag) {
            using Tag = decltype(tag);
            auto const& g = spread[GradientTerm<Tag>{}];
            for_each_component<Tag, d>(row.across[tag], [&](int c, Real& value) {
                value = gradient_of<Tag>(g, c, 0) * slope[0];
                if constexpr (d == 3) value += gradient_of<Tag>(g, c, 1) * slope[1];
            });
            for_each_component<Tag, d>(
                row.along[tag], [&](int c, Real& value) { value = gradient_of<Tag>(g, c, last) * w_row; });
        });
        return row;
    }

    /// Adds the terms of carried fields to a node of weight w = w_row w_k.
    template <class Real, class SumsOfNode>
    FIRN_HOST_DEVICE static void add_carried(Spread<Real> const& spread, CarriedRow<Real> const& row, Real w,
                                             Real w_k, Real dw_k, SumsOfNode& sums)
    {
        for_each_field(CarriedTerms{}, [&](auto term) {
            using Tag = FieldOfTerm<decltype(term)>;
            constexpr int channel = Sums::template channel<Tag>;
            if constexpr (std::is_same_v<Tag, decltype(term)>)
                for_each_component<Tag, d>(spread[term],
                                           [&](int c, Real const& value) { sums[channel + c] += value * w; });
            else {
                Real by_weight[std::size_t(component_count<Tag>(d))];
                for_each_component<Tag, d>(row.across[Tag{}],
                                           [&](int c, Real const& value) { by_weight[c] = value * w_k; });
                for_each_component<Tag, d>(row.along[Tag{}], [&](int c, Real const& value) {
                    sums[channel + c] += by_weight[c] + value * dw_k;
                });
            }
        });
    }

    /// One component of a scalar's gradient, or of the gradient of a vector's component.
    template <class Tag, class Gradient>
    FIRN_HOST_DEVICE static auto const& gradient_of(Gradient const& g, [[maybe_unused]] int component,
                                                    int axis)
    {
        if constexpr (Tag::shape == FieldShape::scalar)
            return g[axis];
        else
            return g(component, axis);
    }

    template <class SumsOfCells>
    struct RowOfSums
    {
        SumsOfCells& sums;
        int row;
        FIRN_HOST_DEVICE decltype(auto) operator[](int k) const { return sums[k][row]; }
    };

    template <class Real, class Row>
    FIRN_HOST_DEVICE static Vector<Real, d> scratch_vector(Row const& row, int channel)
    {
        Vector<Real, d> vector;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) vector[i] = row.scratch(channel + i);
        return vector;
    }
    template <class Real, class Row>
    FIRN_HOST_DEVICE static Matrix<Real, d> scratch_matrix(Row const& row, int channel)
    {
        Matrix<Real, d> matrix;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) FIRN_UNROLL
        for (int j = 0; j < d; ++j) matrix(i, j) = row.scratch(channel + i * d + j);
        return matrix;
    }
};

} // namespace firn

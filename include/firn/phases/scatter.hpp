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
    static constexpr int rows_of_layer =
        rows / width; ///< a layer is what lies at one place of the first axis

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

    /// A particle's contribution, in the form that the rows of its stencil use. Arrays by axis are of those
    /// from the second on, if they do not say otherwise.
    template <class Real>
    struct Contribution : Record<Real, d, CarriedTerms>
    {
        using OfAxis = std::array<Real, std::size_t(width)>;
        Real mass;
        Vector<Real, d> momentum;
        std::array<Vector<Real, d>, std::size_t(terms.affine ? d - 1 : 0)> change; ///< of the affine term
        std::array<Vector<Real, d>, std::size_t(terms.gradient ? d : 0)> gradient; ///< along all axes
        std::array<OfAxis, std::size_t(d - 1)> weight;
        std::array<OfAxis, std::size_t(needs_derivatives ? d : 0)> derivative; ///< along all axes
    };

    /// What belongs to one layer of the stencil.
    template <class Real>
    struct Layer
    {
        Real weight; ///< along the first axis
        /// affine (x_i - x_p) is linear in the node's indices: its value at the first node, from where it
        /// changes from node to node. It is not added to the momentum, beside which small differences would
        /// be rounded away, in steady motion the same in every step.
        Vector<Real, d> affine;
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
        Stencil<Kernel, Real, d> const nodes(scratch_vector<Real>(row_of_cells, position));
        auto const A = affine_term<Real>(row_of_cells);
        make_ready(row_of_cells, nodes, A, spread);
        FIRN_UNROLL
        for (int i = 0; i < width; ++i) {
            auto& layer = spread.layer[i];
            layer.weight = nodes.weight[0][std::size_t(i)];
            set_affine(A, nodes, nodes.distance[0][std::size_t(i)], layer);
        }
    }

    /// Adds the contributions to the nodes of one row of the stencils: to `nodes[k][channel]`.
    template <class Real, class NodesOfRow>
    FIRN_HOST_DEVICE static void scatter(Spread<Real> const& spread, int row, NodesOfRow&& nodes)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        int const first = Nodes::index(row, 0);
        Real derivative(0);
        if constexpr (needs_derivatives) derivative = spread.derivative[0][std::size_t(first)];
        scatter(spread, spread.layer[first], derivative, Nodes::index(row, 1), nodes);
    }

    /// The same for a layer with its derivative along the first axis, and a row of it. If `has_momentum`, the
    /// layer's affine term includes it.
    template <bool has_momentum = false, class Real, class NodesOfRow>
    FIRN_HOST_DEVICE static void scatter(Contribution<Real> const& spread, Layer<Real> const& layer,
                                         [[maybe_unused]] Real derivative, [[maybe_unused]] int second,
                                         NodesOfRow&& nodes)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        Real w_row = layer.weight;
        if constexpr (d == 3) w_row = w_row * spread.weight[0][std::size_t(second)];
        Vector<Real, d> affine, force, along;
        if constexpr (terms.affine) {
            affine = layer.affine;
            if constexpr (d == 3) affine += spread.change[0] * Real(ScalarOf<Real>(second));
        }
        if constexpr (terms.gradient) {
            if constexpr (d == 3)
                force = spread.gradient[0] * (derivative * spread.weight[0][std::size_t(second)]) +
                        spread.gradient[1] * (layer.weight * spread.derivative[1][std::size_t(second)]);
            else
                force = spread.gradient[0] * derivative;
            along = spread.gradient[Nodes::last] * w_row;
        }
        CarriedRow<Real> carried_row;
        if constexpr (needs_derivatives)
            carried_row = prepare_carried(spread, layer, derivative, second, w_row);
        FIRN_UNROLL
        for (int k = 0; k < width; ++k) {
            Real const w_k = spread.weight[Nodes::last - 1][std::size_t(k)], w = w_row * w_k;
            auto&& sums = nodes[k];
            sums[Sums::mass] += spread.mass * w;
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) {
                if constexpr (!has_momentum) sums[Sums::momentum + a] += spread.momentum[a] * w;
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
                if (k + 1 < width) affine += spread.change[Nodes::last - 1];
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

    /// A frame of reference that moves with a particle. In it the momentum of its neighbours is so small that
    /// the affine term may be added to it: one product for both.
    template <class Real>
    struct Frame
    {
        Vector<Real, d> velocity;
    };
    template <class Row, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static Frame<Real> frame_of(Row const& row_of_cells)
    {
        Real const m = row_of_cells.scratch(mass);
        return {scratch_vector<Real>(row_of_cells, momentum) * (m > Real(0) ? 1 / m : Real(0))};
    }

    /// The same for one layer of the stencil, and in a frame: to `sums[k][row of the layer][channel]`.
    template <class Row, class SumsOfLayer, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void scatter_layer(Row const& row_of_cells, int which, Frame<Real> const& frame,
                                               SumsOfLayer& sums)
    {
        Stencil<Kernel, Real, d> const nodes(scratch_vector<Real>(row_of_cells, position));
        Contribution<Real> contribution;
        auto const A = affine_term<Real>(row_of_cells);
        make_ready(row_of_cells, nodes, A, contribution);
        contribution.momentum -= frame.velocity * contribution.mass;
        Layer<Real> layer;
        Real distance, derivative;
        FIRN_UNROLL
        for (int i = 0; i < width; ++i) // chosen one by one: an array with an index would lie in memory
            if (i == 0 || which == i) {
                layer.weight = nodes.weight[0][std::size_t(i)];
                derivative = nodes.derivative[0][std::size_t(i)];
                distance = nodes.distance[0][std::size_t(i)];
            }
        set_affine(A, nodes, distance, layer);
        if constexpr (terms.affine) layer.affine += contribution.momentum;
        FIRN_UNROLL
        for (int row = 0; row < rows_of_layer; ++row)
            scatter<terms.affine>(contribution, layer, derivative, row, RowOfSums<SumsOfLayer>{sums, row});
    }

    /// Adds the frame's own momentum to the sums of a layer.
    template <class Real, class SumsOfLayer>
    FIRN_HOST_DEVICE static void leave_frame(Frame<Real> const& frame, SumsOfLayer& sums)
    {
        FIRN_UNROLL
        for (int row = 0; row < rows_of_layer; ++row) FIRN_UNROLL
        for (int k = 0; k < width; ++k) FIRN_UNROLL
        for (int a = 0; a < d; ++a)
            sums[k][row][Sums::momentum + a] += frame.velocity[a] * sums[k][row][Sums::mass];
    }

private:
    /// A particle's affine term, loaded once: what is written meanwhile might be the same memory. Unset if
    /// there is none.
    template <class Real, class Row>
    FIRN_HOST_DEVICE static Matrix<Real, d> affine_term([[maybe_unused]] Row const& row_of_cells)
    {
        Matrix<Real, d> A;
        if constexpr (terms.affine) A = scratch_matrix<Real>(row_of_cells, affine);
        return A;
    }

    template <class Row, class Real>
    FIRN_HOST_DEVICE static void make_ready(Row const& row_of_cells, Stencil<Kernel, Real, d> const& nodes,
                                            [[maybe_unused]] Matrix<Real, d> const& A,
                                            Contribution<Real>& contribution)
    {
        contribution.mass = row_of_cells.scratch(mass);
        contribution.momentum = scratch_vector<Real>(row_of_cells, momentum);
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) FIRN_UNROLL
        for (int i = 0; i < width; ++i) { // one by one: see copy_of()
            if (a > 0)
                contribution.weight[std::size_t(a - 1)][std::size_t(i)] =
                    nodes.weight[std::size_t(a)][std::size_t(i)];
            if constexpr (needs_derivatives)
                contribution.derivative[std::size_t(a)][std::size_t(i)] =
                    nodes.derivative[std::size_t(a)][std::size_t(i)];
        }
        if constexpr (terms.affine) {
            FIRN_UNROLL
            for (int a = 1; a < d; ++a) contribution.change[std::size_t(a - 1)] = column<Real, d>(A, a);
        }
        if constexpr (terms.gradient) {
            Matrix<Real, d> const G = scratch_matrix<Real>(row_of_cells, gradient);
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) contribution.gradient[std::size_t(a)] = column<Real, d>(G, a);
        }
        for_each_component_of<CarriedTerms, d>(
            contribution, [&](int c, Real& value) { value = row_of_cells.scratch(carried + c); });
    }

    /// Sets the layer's affine term, at a distance along the first axis.
    template <class Real>
    FIRN_HOST_DEVICE static void set_affine([[maybe_unused]] Matrix<Real, d> const& A,
                                            [[maybe_unused]] Stencil<Kernel, Real, d> const& nodes,
                                            [[maybe_unused]] Real distance,
                                            [[maybe_unused]] Layer<Real>& layer)
    {
        if constexpr (terms.affine) {
            layer.affine = column<Real, d>(A, 0) * distance;
            FIRN_UNROLL
            for (int a = 1; a < d; ++a)
                layer.affine += column<Real, d>(A, a) * nodes.distance[std::size_t(a)][0];
        }
    }

    /// Of the gradient terms of carried fields in one row: what goes with the weights of its nodes, and what
    /// goes with their derivatives along the row.
    template <class Real>
    struct CarriedRow
    {
        Record<Real, d, CarriedGradients> across, along;
    };

    template <class Real>
    FIRN_HOST_DEVICE static CarriedRow<Real> prepare_carried(Contribution<Real> const& spread,
                                                             Layer<Real> const& layer, Real derivative,
                                                             [[maybe_unused]] int second, Real w_row)
    {
        constexpr int last = d - 1;
        Real slope[std::size_t(last)]; // of the row's weight, along all axes but its own
        slope[0] = derivative;
        if constexpr (d == 3) {
            slope[0] = slope[0] * spread.weight[0][std::size_t(second)];
            slope[1] = layer.weight * spread.derivative[1][std::size_t(second)];
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
    FIRN_HOST_DEVICE static void add_carried(Contribution<Real> const& spread, CarriedRow<Real> const& row,
                                             Real w, Real w_k, Real dw_k, SumsOfNode& sums)
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

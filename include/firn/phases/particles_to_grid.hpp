// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/stencil.hpp>
#include <firn/models/response.hpp>
#include <firn/phases/table_view.hpp>
#include <firn/transfer/transfer.hpp>

namespace firn
{

/// What a node holds between the scatter and its update: mass, momentum, and the forces' impulse if kept
/// apart.
template <int d, bool forces_apart>
struct NodeSums
{
    static constexpr int mass = 0;
    static constexpr int momentum = 1;
    static constexpr int impulse =
        forces_apart ? 1 + d : momentum; ///< of the material's forces during the step
    static constexpr int channels = 1 + d + (forces_apart ? d : 0);
};

/// How particles give to the grid.
///
///   m_i      = sum_p w_ip m_p
///   (m v)_i  = sum_p w_ip (m_p v_p + A_p (x_i - x_p))            A_p: the transfer's affine term
///   (dt f)_i = - dt sum_p V0_p tau_p grad w_ip                    or the transfer's own form of it
///
/// (Stomakhin et al. 2013, eq. 6 with V^n sigma = V0 tau; Jiang et al. 2015, eq. 8). First each particle's
/// terms are found, particle by particle, and kept; then each cell sums what its particles give to each node
/// of its stencil, and adds that to the grid once, whatever the number of its particles.
template <class Space, class Kernel, class Transfer>
struct Giving
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Real;
    using Sums = NodeSums<d, Transfer::keeps_old_velocity>;
    static constexpr Terms terms = Transfer::template gives<Kernel>;
    static constexpr int channels = Sums::channels;

    // What is kept of a particle.
    static constexpr int position = 0, mass = d, momentum = d + 1, affine = 2 * d + 1;
    static constexpr int gradient = affine + (terms.affine ? d * d : 0);
    static constexpr int kept = gradient + (terms.gradient ? d * d : 0);

    template <class Real>
    using CellSums = Real[Stencil<Kernel, Real, d>::width][Stencil<Kernel, Real, d>::rows][channels];

    template <class Items, class Real>
    FIRN_HOST_DEVICE static void keep(Items& items, Vector<Real, d> const& x, Real m,
                                      Given<Real, d> const& given)
    {
        items.keep(mass, m);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            items.keep(position + i, x[i]);
            items.keep(momentum + i, given.momentum[i]);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine) items.keep(affine + i * d + j, given.affine(i, j));
                if constexpr (terms.gradient) items.keep(gradient + i * d + j, given.gradient(i, j));
            }
        }
    }

    /// Adds what the row's particles give, one per cell, to the sums of the cells: CellSums, or what stands
    /// for them.
    template <class Row, class SumsOfCells>
    FIRN_HOST_DEVICE static void give(Row const& row_of_cells, SumsOfCells& sums)
    {
        using Real = typename Row::Real;
        using Nodes = Stencil<Kernel, Real, d>;
        Vector<Real, d> x, p;
        Matrix<Real, d> A, G;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            x[i] = row_of_cells.kept(position + i);
            p[i] = row_of_cells.kept(momentum + i);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine) A(i, j) = row_of_cells.kept(affine + i * d + j);
                if constexpr (terms.gradient) G(i, j) = row_of_cells.kept(gradient + i * d + j);
            }
        }
        Real const m_p = row_of_cells.kept(mass);
        Nodes const nodes(x);

        FIRN_UNROLL_ON_DEVICE
        for (int row = 0; row < Nodes::rows; ++row) {
            // Along a row, what a node gets is constant * w + slope * (w distance) + gradient * dw: three
            // vectors a row.
            Real const w_row = nodes.row_weight(row);
            Real const m = m_p * w_row;
            Vector<Real, d> constant = p, force, slope, along;
            if constexpr (terms.affine) {
                FIRN_UNROLL
                for (int a = 0; a < Nodes::last; ++a) constant += A.col(a) * nodes.row_distance(row, a);
                slope = A.col(Nodes::last) * w_row;
            }
            constant = constant * w_row;
            if constexpr (terms.gradient) {
                force = G.col(0) * nodes.row_gradient(row, 0);
                for (int a = 1; a < Nodes::last; ++a) force += G.col(a) * nodes.row_gradient(row, a);
                along = G.col(Nodes::last) * w_row;
                if constexpr (Sums::impulse == Sums::momentum) constant += force;
            }
            FIRN_UNROLL
            for (int k = 0; k < Nodes::width; ++k) {
                Real const w = nodes.weight[Nodes::last][k], dw = nodes.derivative[Nodes::last][k];
                Real const reach = w * nodes.distance[Nodes::last][k];
                auto&& node = sums[k][row];
                node[Sums::mass] += m * w;
                FIRN_UNROLL
                for (int a = 0; a < d; ++a) {
                    Real sum = node[Sums::momentum + a] + constant[a] * w;
                    if constexpr (terms.affine) sum += slope[a] * reach;
                    if constexpr (terms.gradient && Sums::impulse == Sums::momentum) sum += along[a] * dw;
                    node[Sums::momentum + a] = sum;
                    if constexpr (Sums::impulse != Sums::momentum)
                        node[Sums::impulse + a] += force[a] * w + along[a] * dw;
                }
            }
        }
    }

    /// Adds the sums of the cells to the grid.
    template <class Cell, class Real>
    FIRN_HOST_DEVICE static void add(Cell const& cell, CellSums<Real> const& sums)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        // Neighbouring lanes share nodes, one place apart: going through all rows before the next place keeps
        // a write and the read that overlaps it far apart.
        FIRN_UNROLL
        for (int k = 0; k < Nodes::width; ++k) FIRN_UNROLL_ON_DEVICE
        for (int row = 0; row < Nodes::rows; ++row) FIRN_UNROLL
        for (int c = 0; c < channels; ++c) cell.add(c, row, k, sums[k][row][c]);
    }
};

/// Phase 1: particles give mass, momentum and the impulse of their stress to the nodes. The stress follows
/// from the state: a model's answer to no deformation.
///
/// A step that moves particles gives to the next one's grid in the same pass; what is left for this phase is
/// the first step, and the correction where a step gets another length than was guessed.
template <class Space, class Model, class Kernel, class TransferType, class StoredSet, class TakenSet>
struct ParticlesToGrid : Giving<Space, Kernel, TransferType>
{
    using Transfer = TransferType;
    using Gives = Giving<Space, Kernel, Transfer>;
    using Gives::d, Gives::kept;
    using Number = typename Space::Real;

    Model model;
    Transfer transfer;
    TableView<Number, d, StoredSet> particles;
    FieldsById<Number, d, TakenSet> velocities;
    Portions<Number> portions;
    Number dt;         ///< [s]; of the impulse alone: the difference to what was given
    Number cell_size;  ///< [m]
    bool impulse_only; ///< mass and momentum have been given

    /// Finds and keeps what some particles give.
    template <class Items>
    FIRN_HOST_DEVICE void prepare(Items& items) const
    {
        using Real = typename Items::Real;
        auto particle = Record<Real, d, Join<StoredSet, TakenSet>>::at_rest();
        particles.load(items, particle);
        if (!impulse_only) velocities.load(items, particles.id, particle);
        auto const [mass, volume] = portions.find(items, particles.id);
        Matrix<Real, d> L = Matrix<Real, d>::Zero();
        // Viscous stress is that of the last step's motion, as far as particles carry it.
        if constexpr (Viscous<Model> && Join<StoredSet, TakenSet>::template contains<AffineVelocity>)
            L = particle[AffineVelocity{}];
        auto const response = model.template respond<Real>(particle, L, Real(0));
        // dt f_i = -dt V0 tau grad w_i, with the gradient taken per cell
        Matrix<Real, d> const impulse = response.kirchhoff_stress * (volume * Real(-dt / cell_size));
        Real const given_mass = impulse_only ? Real(0) : mass;
        Gives::keep(items, particles.position(items), given_mass,
                    transfer.template give<Kernel, Real, d>(particle, given_mass, impulse, Real(cell_size)));
    }
};

} // namespace firn

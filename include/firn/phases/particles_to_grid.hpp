// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/stencil.hpp>
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

/// Phase 1: mass, momentum and the impulse of the material's forces go from the particles of a cell to its
/// nodes.
///
///   m_i      = sum_p w_ip m_p
///   (m v)_i  = sum_p w_ip (m_p v_p + A_p (x_i - x_p))            A_p: the transfer's affine term
///   (dt f)_i = - dt sum_p V0_p tau_p grad w_ip                    or the transfer's own form of it
///
/// (Stomakhin et al. 2013, eq. 6 with V^n sigma = V0 tau; Jiang et al. 2015, eq. 8). A cell adds its sums to
/// the grid once, whatever the number of its particles.
template <class Space, class Kernel, class Transfer, class Set>
struct ParticlesToGrid
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Real;
    using Sums = NodeSums<d, Transfer::keeps_old_velocity>;
    static constexpr int order = Kernel::order;
    static constexpr int channels = Sums::channels;

    Transfer transfer;
    TableView<Number, d, Set> particles;
    Portions<Number> portions;
    Number dt;        ///< [s]
    Number cell_size; ///< [m]

    template <class Cell>
    FIRN_HOST_DEVICE void operator()(Cell& cell) const
    {
        using Real = typename Cell::Real;
        using Nodes = Stencil<Kernel, Real, d>;
        Real sums[Nodes::width][Nodes::rows][channels];
        for (auto& column : sums)
            for (auto& node : column)
                for (Real& sum : node) sum = Real(0);

        for (int rank = 0, ranks = cell.ranks(); rank < ranks; ++rank) {
            cell.enter(rank);
            add_particles<Real>(cell, sums);
        }
        // Neighbouring lanes share nodes, one place apart: going through all rows before the next place keeps
        // a write and the read that overlaps it far apart.
        for (int k = 0; k < Nodes::width; ++k)
            for (int row = 0; row < Nodes::rows; ++row)
                for (int c = 0; c < channels; ++c) cell.add(c, row, k, sums[k][row][c]);
    }

private:
    template <class Real, class Cell, class Array>
    FIRN_HOST_DEVICE void add_particles(Cell const& cell, Array& sums) const
    {
        using Nodes = Stencil<Kernel, Real, d>;
        constexpr Terms terms = Transfer::template gives<Kernel>;
        using Wanted = Join<Fields<KirchhoffStress>, typename Transfer::State>;

        auto const particle = particles.load(cell, Wanted{});
        auto const [mass, volume] = portions.find(cell, particles.id);
        Nodes const nodes(particles.position(cell), cell.here());

        // dt f_i = -dt V0 tau grad w_i, with the gradient taken per cell
        Matrix<Real, d> const stress_impulse = particle[KirchhoffStress{}] * (volume * Real(-dt / cell_size));
        Given<Real, d> const given =
            transfer.template give<Kernel, Real, d>(particle, mass, stress_impulse, Real(cell_size));

        for (int row = 0; row < Nodes::rows; ++row) {
            // Along a row, what a node gets is constant * w + slope * (w distance) + gradient * dw: three
            // vectors a row.
            Real const w_row = nodes.row_weight(row);
            Real const m = mass * w_row;
            Vector<Real, d> constant = given.momentum, force, slope, gradient;
            if constexpr (terms.affine) {
                for (int a = 0; a < Nodes::last; ++a)
                    constant += given.affine.col(a) * nodes.row_distance(row, a);
                slope = given.affine.col(Nodes::last) * w_row;
            }
            constant = constant * w_row;
            if constexpr (terms.gradient) {
                force = given.gradient.col(0) * nodes.row_gradient(row, 0);
                for (int a = 1; a < Nodes::last; ++a)
                    force += given.gradient.col(a) * nodes.row_gradient(row, a);
                gradient = given.gradient.col(Nodes::last) * w_row;
                if constexpr (Sums::impulse == Sums::momentum) constant += force;
            }
            for (int k = 0; k < Nodes::width; ++k) {
                Real const w = nodes.weight[Nodes::last][k], dw = nodes.derivative[Nodes::last][k];
                Real const reach = w * nodes.distance[Nodes::last][k];
                Real(&node)[channels] = sums[k][row];
                node[Sums::mass] += m * w;
                for (int a = 0; a < d; ++a) {
                    Real p = constant[a] * w;
                    if constexpr (terms.affine) p += slope[a] * reach;
                    if constexpr (terms.gradient && Sums::impulse == Sums::momentum) p += gradient[a] * dw;
                    node[Sums::momentum + a] += p;
                    if constexpr (Sums::impulse != Sums::momentum)
                        node[Sums::impulse + a] += force[a] * w + gradient[a] * dw;
                }
            }
        }
    }
};

} // namespace firn

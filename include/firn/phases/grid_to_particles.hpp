// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/mishap.hpp>
#include <firn/models/response.hpp>
#include <firn/phases/update_grid.hpp>

#include <limits>

namespace firn
{

/// What a gather found out: the bounds of the next step, and what went wrong in this one.
template <int obstacles>
struct GatherResult
{
    double wave_modulus = 0; ///< largest rho_0 c^2 [Pa]
    double speed2 = 0;       ///< largest squared speed [m^2/s^2]
    double deformation = 0;  ///< largest Frobenius norm of the velocity gradient, squared [1/s^2]
    std::uint64_t capped = 0;
    std::uint64_t wrong = 0;      ///< particles with a mishap that rejects the step
    Mishap mishap = Mishap::none; ///< of the first of them
    std::uint32_t particle = 0;   ///< its id
    Reactions<obstacles> reactions{};

    void merge(GatherResult const& other)
    {
        wave_modulus = max(wave_modulus, other.wave_modulus);
        speed2 = max(speed2, other.speed2);
        deformation = max(deformation, other.deformation);
        capped += other.capped;
        if (wrong == 0) mishap = other.mishap, particle = other.particle;
        wrong += other.wrong;
        reactions.merge(other.reactions);
    }
};

/// Phase 3: particles take velocities from their nodes, move, and their material answers.
///
///   v_p, C_p by the transfer;  x_p += dt sum_i w_ip v_i;  F_p, state and tau by the model from L_p and dt
///
/// (Stomakhin et al. 2013, steps 7 to 10). Reads the old table and writes the new one: a step that goes wrong
/// leaves the old one as it was.
template <class Space, class Model, class Kernel, class Transfer, class Effects, class Set>
struct GridToParticles
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Real;
    using Velocities = NodeVelocities<d, Transfer::keeps_old_velocity>;
    using Result = GatherResult<Effects::obstacles>;
    static constexpr int order = Kernel::order;
    static constexpr int channels = Velocities::channels;

    Model model;
    Transfer transfer;
    Effects effects;
    TableView<Number, d, Set> before, after;
    Portions<Number> portions;
    Lattice lattice;
    Number dt;                  ///< [s]
    Number largest_deformation; ///< dt |L| beyond which the step is rejected

    template <class Cell>
    FIRN_HOST_DEVICE void operator()(Cell& cell, Result& result) const
    {
        using Real = typename Cell::Real;
        Real wave(0), speed2(0), deformation(0);
        for (int rank = 0, ranks = cell.ranks(); rank < ranks; ++rank) {
            cell.enter(rank);
            auto particle = before.load(cell);
            Vector<Real, d> const position = before.position(cell);
            Gathered<Real, d> const gathered = gather<Real>(cell, position);

            Real const inverse_h(static_cast<Number>(1 / lattice.cell_size));
            Matrix<Real, d> const L = transfer.template take<Kernel, Real, d>(particle, gathered, inverse_h);
            Vector<Real, d> displacement = gathered.velocity * Real(dt);
            touch_obstacles<Real>(cell, position, particle, displacement, result);
            displacement = displacement * inverse_h;

            Response<Real, d> const response = model.template respond<Real>(particle, L, Real(dt));
            particle[KirchhoffStress{}] = response.kirchhoff_stress;
            after.store(cell, particle);
            cell.copy(before.id, after.id);
            after.move(cell, before, within_a_cell<Real>(displacement));

            Real const rate2 = L.squaredNorm();
            wave = max(wave, response.wave_modulus);
            speed2 = max(speed2, particle[Velocity{}].squaredNorm());
            deformation = max(deformation, rate2);
            inspect<Real>(cell, particle, displacement, rate2, response, result);
        }
        result.wave_modulus = max(result.wave_modulus, double(largest(wave)));
        result.speed2 = max(result.speed2, double(largest(speed2)));
        result.deformation = max(result.deformation, double(largest(deformation)));
    }

private:
    /// The sums over the particle's stencil that the transfer takes.
    template <class Real, class Cell>
    FIRN_HOST_DEVICE Gathered<Real, d> gather(Cell const& cell, Vector<Real, d> const& offset) const
    {
        using Nodes = Stencil<Kernel, Real, d>;
        constexpr Terms terms = Transfer::template takes<Kernel>;
        Nodes const nodes(offset, cell.here());
        Gathered<Real, d> sum;
        sum.velocity.setZero();
        sum.old_velocity.setZero();
        sum.affine.setZero();
        sum.gradient.setZero();

        for (int row = 0; row < Nodes::rows; ++row) {
            Vector<Real, d> plain = Vector<Real, d>::Zero(), old = plain, reach = plain, slope = plain;
            for (int k = 0; k < Nodes::width; ++k) {
                Real const w = nodes.weight[Nodes::last][k];
                Real const w_distance = w * nodes.distance[Nodes::last][k],
                           dw = nodes.derivative[Nodes::last][k];
                for (int a = 0; a < d; ++a) {
                    Real const v = cell.node(Velocities::velocity + a, row, k);
                    plain[a] += v * w;
                    if constexpr (terms.affine) reach[a] += v * w_distance;
                    if constexpr (terms.gradient) slope[a] += v * dw;
                    if constexpr (Transfer::keeps_old_velocity)
                        old[a] += cell.node(Velocities::old_velocity + a, row, k) * w;
                }
            }
            Real const w_row = nodes.row_weight(row);
            sum.velocity += plain * w_row;
            if constexpr (Transfer::keeps_old_velocity) sum.old_velocity += old * w_row;
            for (int a = 0; a < Nodes::last; ++a) {
                if constexpr (terms.affine) sum.affine.col(a) += plain * (w_row * nodes.row_distance(row, a));
                if constexpr (terms.gradient) sum.gradient.col(a) += plain * nodes.row_gradient(row, a);
            }
            if constexpr (terms.affine) sum.affine.col(Nodes::last) += reach * w_row;
            if constexpr (terms.gradient) sum.gradient.col(Nodes::last) += slope * w_row;
        }
        return sum;
    }

    /// A displacement that can be stored: one beyond a cell, or not a number, rejects the step anyway.
    template <class Real>
    FIRN_HOST_DEVICE static Vector<Real, d> within_a_cell(Vector<Real, d> const& displacement)
    {
        Vector<Real, d> bounded;
        for (int a = 0; a < d; ++a) bounded[a] = min(max(Real(-1), displacement[a]), Real(1));
        return bounded;
    }

    /// Contact of the particles themselves, for obstacles that ask for it.
    template <class Real, class Cell, class Particle>
    FIRN_HOST_DEVICE void touch_obstacles(Cell const& cell, Vector<Real, d> const& position,
                                          Particle& particle, Vector<Real, d>& displacement,
                                          Result& result) const
    {
        if constexpr (Effects::obstacles > 0) {
            if (!effects_touch_particles()) return;
            Number const to_node = Number(0.5 - cell_shift(order));
            Vector<Real, d> where =
                position + displacement * Real(Number(1 / lattice.cell_size)) + cell.along();
            for (int a = 0; a < d; ++a) where[a] += Real(to_node);
            Place<Real, d> const place{lattice, cell.first(), where};
            displacement += apply_on_particles<Real, d>(effects, place, portions.find(cell, before.id).mass,
                                                        Real(dt), particle[Velocity{}], result.reactions);
        }
    }

    FIRN_HOST_DEVICE bool effects_touch_particles() const
    {
        bool wanted = false;
        effects.for_each([&](auto const& action) {
            if constexpr (std::decay_t<decltype(action)>::is_obstacle) wanted = wanted || action.on_particles;
        });
        return wanted;
    }

    /// Counts caps and mishaps, and keeps the first mishap's particle.
    template <class Real, class Cell, class Particle>
    FIRN_HOST_DEVICE void inspect(Cell const& cell, Particle& particle, Vector<Real, d> const& displacement,
                                  Real rate2, Response<Real, d> const& response, Result& result) const
    {
        // The sum of all magnitudes is finite if each of them is, and small if nothing is about to overflow.
        Real size(0), moved(0);
        particle.for_each([&](int, auto& value) { size += abs(value); });
        for (int a = 0; a < d; ++a) {
            moved = max(moved, abs(displacement[a]));
            size += abs(displacement[a]);
        }
        Mask<Real> const finite = size < Real(std::numeric_limits<Number>::max());
        Real const bound(largest_deformation * largest_deformation);
        Mask<Real> const calm = (moved < Real(1)) & (rate2 * Real(dt * dt) < bound);
        Mask<Real> wrong = cell.here() & ((!finite) | response.inverted | (!calm));
        if (cell.at_the_edge()) wrong = cell.here();
        Mask<Real> const capped = cell.here() & response.capped;
        if (!any(wrong | capped)) return;

        for (std::uint64_t rest = bits(capped); rest != 0; rest &= rest - 1) ++result.capped;
        for (std::uint64_t rest = bits(wrong), lane = 0; rest != 0; rest >>= 1, ++lane) {
            if ((rest & 1) == 0) continue;
            if (result.wrong++ > 0) continue;
            result.particle = cell.value(before.id, int(lane));
            auto const holds = [&](Mask<Real> const& mask) { return ((bits(mask) >> lane) & 1) != 0; };
            result.mishap = holds(!finite)             ? Mishap::not_finite
                            : holds(response.inverted) ? Mishap::inverted
                            : holds(calm)              ? Mishap::escaped
                                                       : Mishap::rejected;
        }
    }
};

} // namespace firn

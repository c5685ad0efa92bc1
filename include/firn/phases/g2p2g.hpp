// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/failure_cause.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/phases/gather.hpp>
#include <firn/phases/gather_shifts.hpp>
#include <firn/phases/scatter.hpp>

#include <cassert>
#include <limits>

namespace firn
{

/// The result of moving the particles: the bounds of the next step, and the failures of this one.
template <class Number, int obstacles>
struct G2p2gResult
{
    Number wave_modulus = 0; ///< largest rho_0 c^2 [Pa]
    Number speed2 = 0;       ///< largest squared speed [m^2/s^2]
    Number deformation = 0;  ///< largest Frobenius norm of the velocity gradient, squared [1/s^2]
    std::uint64_t capped = 0;
    std::uint64_t failed = 0;                ///< particles whose failure rejects the step
    FailureCause cause = FailureCause::none; ///< of the first of them
    std::uint32_t particle = 0;              ///< its row in the table
    Reactions<obstacles> reactions{};

    /// Whether it must be merged in its place among others: the first failure is told.
    FIRN_HOST_DEVICE bool has_a_place() const { return failed > 0 || reactions.has_a_place(); }
    FIRN_HOST_DEVICE void merge(G2p2gResult const& other)
    {
        wave_modulus = max(wave_modulus, other.wave_modulus);
        speed2 = max(speed2, other.speed2);
        deformation = max(deformation, other.deformation);
        capped += other.capped;
        if (failed == 0) cause = other.cause, particle = other.particle;
        failed += other.failed;
        reactions.merge(other.reactions);
    }
};

/// Phase 3: particles gather velocities, move and update their material state. In the same pass they scatter
/// to the grid of the next step, whose length is a good guess.
///
///   v_p, C_p by the transfer;  x_p += dt sum_i w_ip v_i;  F_p, state and tau by the model from L_p and dt
///
/// (Stomakhin et al. 2013, steps 7 to 10; one pass for both directions after Wang et al. 2020, *A massively
/// parallel and scalable multi-GPU material point method*). Reads the old table and writes the new one, so
/// that a failed step leaves the old one untouched.
///
/// The functions for each particle (`begin`, `update`) are separate from those for each cell (`gather`,
/// `scatter`), so that a backend may put different particles side by side in lanes for each.
template <class Space, class Model, class Kernel, class TransferType, class Effects, class PersistentFields,
          class DerivedFields>
struct G2p2g
{
    using Transfer = TransferType;
    using Scatter = firn::Scatter<Space, Kernel, Transfer>;
    using Gather = firn::Gather<Space, Kernel, Transfer>;
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Result = G2p2gResult<Number, Effects::touching>;
    static constexpr CellWork work{.gathers = true, .moves = true, .scatters_to = ScatterTarget::next_sums};
    static constexpr int degree = Kernel::degree;
    static constexpr int node_channels = Gather::node_channels, channels = Scatter::channels;
    static constexpr int scratch_channels = Gather::scratch_channels > Scatter::scratch_channels
                                                ? Gather::scratch_channels
                                                : Scatter::scratch_channels;
    /// Contact is called while all gathered values are live, so a device needs more registers there.
    static constexpr bool calls_amid_much =
        d == 3 && (Effects::touching > 1 || Effects::groups_on_particles > 0 ||
                   (Effects::lookups > 0 && !Transfer::moves_with_grid));
    template <class Real>
    using CellNodes = typename Gather::template CellNodes<Real>;

    Model model;
    Transfer transfer;
    StepContext<Number, Effects> const* now;
    TableView<Number const, d, PersistentFields> before;
    TableView<Number, d, PersistentFields> after;
    FieldsById<Number, d, DerivedFields> velocities; ///< written if present
    MassGroups<Number> mass_groups;
    Lattice lattice;
    Number cell_size;           ///< [m]: a device would round it for each particle
    Number inverse_cell_size;   ///< [1/m]: and divide
    Number largest_deformation; ///< dt |L| beyond which the step is rejected
    ShiftsOf<Model, Number, d> shifts{};

    /// Stores the particles' positions in scratch.
    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        auto const x = before.position(items);
        assert(inside_the_cell(x) && "a particle lies in the cell in whose order it is");
        Gather::template set_position<typename Items::Real>(items, x);
        before.expect_load(items);
        after.expect_store(items);
    }

    template <class Row>
    FIRN_HOST_DEVICE static void gather(Row& row_of_cells)
    {
        Gather::gather(row_of_cells);
    }

    /// Moves and deforms particles by what they gathered, and stores their contributions to the next step.
    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result& result) const
    {
        update(items, result, result);
    }

    /// The same, with the rare results (failures, reactions of obstacles) in a separate result. A device has
    /// that one in memory, so that its registers are left for the bounds. A processor's thread has one result
    /// of bounds for all its blocks.
    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result& result, Result& rare) const
    {
        using Real = typename Items::Real;
        Vector<Real, d> x = Gather::template position_of<Real>(items);
        Gathered<Real, d> const gathered = Gather::template gathered<Real>(items);
        auto const carried_terms = Gather::template carried_terms<Real>(items);
        Record<Real, d, Join<PersistentFields, DerivedFields>> particle;
        before.load(items, particle);

        Real const inverse_h(inverse_cell_size);
        Vector<Real, d> displacement = motion<Real>(particle, gathered) * Real(now->dt);
        Matrix<Real, d> const L = transfer.template gather<Kernel, Real, d>(particle, gathered, inverse_h);
        carried_by(transfer).template gather<Real, d>(particle, carried_terms, inverse_h);
        shift<Real>(items, displacement);
        touch_obstacles<Real>(items, x, particle, displacement, rare.reactions);
        displacement = displacement * inverse_h;

        Response<Real, d> const response = model.template respond<Real>(particle, L, Real(now->dt));
        after.store(items, particle);
        if (velocities.present) velocities.store(items, before.id, particle);
        items.copy(before.id, after.id);
        auto const stays = after.move(items, before, within_a_cell<Real>(displacement), x);

        Vector<Real, d> const& velocity = particle[Velocity{}];
        Real const speed2 = dot<Real, d>(velocity, velocity), rate2 = squared_norm<Real, d>(L);
        auto const most = [&](Number& bound, Real const& value) {
            Mask<Real> const more = items.here() & !(value <= Real(bound));
            if (any(more)) bound = max(bound, Number(largest(select(more, value, Real(0)))));
        };
        most(result.wave_modulus, response.wave_modulus);
        most(result.speed2, speed2);
        most(result.deformation, rate2);
        inspect<Real>(items, particle, displacement, rate2, response, rare);
        store_contribution<Real>(items, particle, x, response.kirchhoff_stress);
        // A particle that left its cell scatters from the new one, not here.
        Mask<Real> const left = items.here() & !stays;
        if (any(left)) items.leave(left, Scatter::mass, Scatter::scratch_channels);
    }

    template <class Row, class SumsOfCells>
    FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Scatter::scatter(row_of_cells, sums);
    }

private:
    /// The velocity by which particles move: the grid's, unless the transfer has its own.
    template <class Real, class Particle>
    FIRN_HOST_DEVICE Vector<Real, d> motion(Particle const& particle, Gathered<Real, d> const& gathered) const
    {
        if constexpr (Transfer::moves_with_grid)
            return gathered.velocity;
        else
            return transfer.template motion<Kernel, Real, d>(particle, gathered);
    }

    /// Adds what keeps a fluid's volume, in the steps that have it: see KeepsVolume.
    template <class Real, class Items>
    FIRN_HOST_DEVICE void shift([[maybe_unused]] Items const& items,
                                [[maybe_unused]] Vector<Real, d>& displacement) const
    {
        if constexpr (KeepsItsVolume<Model>)
            if (shifts.present) {
                Record<Real, d, Fields<VolumeShift>> own;
                shifts.load(items, before.id, own);
                displacement += own[VolumeShift{}] * Real(cell_size);
            }
    }

    /// Stores the particles' contributions to the next step.
    template <class Real, class Items, class Particle>
    FIRN_HOST_DEVICE void store_contribution(Items& items, Particle const& particle, Vector<Real, d> const& x,
                                             Matrix<Real, d> const& stress) const
    {
        auto const [mass, volume] = mass_groups.find(items, before.id);
        assert(all(mass >= Real(0)) && "the mass of a particle is not below 0");
        Matrix<Real, d> const impulse = stress * (volume * Real(-now->next_forces * inverse_cell_size));
        Record<Real, d, typename Scatter::CarriedTerms> carried_terms;
        carried_by(transfer).template scatter<Real, d>(particle, mass, Real(cell_size), carried_terms);
        Scatter::store(items, x, mass,
                       transfer.template scatter<Kernel, Real, d>(particle, mass, impulse, Real(cell_size)),
                       carried_terms);
    }

    template <class Real>
    FIRN_HOST_DEVICE static bool inside_the_cell(Vector<Real, d> const& x)
    {
        auto inside = abs(x[0]) <= Real(Number(0.5));
        for (int a = 1; a < d; ++a) inside = inside & (abs(x[a]) <= Real(Number(0.5)));
        return all(inside);
    }

    /// Clamps a displacement to what can be stored. One beyond a cell, or NaN, rejects the step anyway.
    template <class Real>
    FIRN_HOST_DEVICE static Vector<Real, d> within_a_cell(Vector<Real, d> const& displacement)
    {
        Vector<Real, d> bounded;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            Real way = displacement[a];
            if constexpr (finite_math_only) // then min and max may let NaN pass
                way = select(is_below(abs(way), Real(2)), way, Real(1));
            bounded[a] = min(max(Real(-1), way), Real(1));
        }
        return bounded;
    }

    /// Contact of the particles themselves, for obstacles that ask for it.
    template <class Real, class Items, class Particle>
    FIRN_HOST_DEVICE void touch_obstacles(Items const& items, Vector<Real, d> const& position,
                                          Particle& particle, Vector<Real, d>& displacement,
                                          Reactions<Effects::touching>& reactions) const
    {
        if constexpr (Effects::may_touch_particles) {
            if (!touches_particles(now->actions)) return;
            Number const to_node = Number(0.5 - cell_shift(degree));
            Vector<Real, d> where = position + displacement * Real(inverse_cell_size) + items.along();
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) where[a] += Real(to_node);
            LanePosition<Real, d> const place{lattice, items.first(), where, kernel_reach(degree)};
            Real const mass = mass_groups.find(items, before.id).mass, dt(now->dt);
            // Called out of line if the particle has a velocity of its own, or if contact is more than the
            // closed-form distance to one solid:
            if constexpr (Effects::obstacles > 1 || Effects::groups_on_particles > 0 || Effects::shells > 0 ||
                          Effects::lookups > 0 || !Transfer::moves_with_grid) {
                Vector<Real, d> const moved = displacement; // copies: see call_on_particles
                Vector<Real, d> velocity = particle[Velocity{}];
                displacement = moved + call_on_particles<Real, d>(now->actions, place, moved, items.here(),
                                                                  mass, dt, velocity, reactions);
                particle[Velocity{}] = velocity;
            }
            else
                displacement += apply_on_particles<Real, d>(now->actions, place, displacement, items.here(),
                                                            mass, dt, particle[Velocity{}], reactions);
        }
    }

    /// Whether an item of this cell, or of some cells behind it, might leave its world.
    FIRN_HOST_DEVICE bool at_edge_of_world(Coordinates<d> const& cell) const
    {
        if (lattice.half_world == 0) return false;
        bool is_near = false;
        for (int a = 0; a < d; ++a) {
            int const c = lattice.in_world(cell[a]), most = lattice.half_world - WorldLayout<d>::margin;
            is_near = is_near || c < -most || c >= most;
        }
        return is_near;
    }

    /// Counts capped particles and failures, and records the first failure.
    template <class Real, class Items, class Particle>
    FIRN_HOST_DEVICE void inspect(Items const& items, Particle& particle, Vector<Real, d> const& displacement,
                                  Real rate2, Response<Real, d> const& response, Result& result) const
    {
        // The sum of all magnitudes is finite if each of them is, and small if nothing is about to overflow.
        // It includes the stress: a NaN there would contaminate neighbours in the next step. Two sums,
        // because in one each addition waits for the one before.
        Real size(0), answered = abs(response.wave_modulus), moved(0);
        particle.for_each([&](int, auto& value) { size += abs(value); });
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            moved = max(moved, abs(displacement[a]));
            answered += abs(displacement[a]);
            FIRN_UNROLL
            for (int b = 0; b < d; ++b) answered += abs(response.kirchhoff_stress(a, b));
        }
        Mask<Real> const finite = is_below(size + answered, Real(std::numeric_limits<Number>::max()));
        Real const bound(largest_deformation * largest_deformation);
        Mask<Real> const calm = is_below(moved, Real(1)) & is_below(rate2 * Real(now->dt * now->dt), bound);
        Mask<Real> failed = items.here() & ((!finite) | response.inverted | (!calm));
        if (items.at_the_edge() || at_edge_of_world(items.first())) failed = items.here();
        Mask<Real> const capped = items.here() & response.capped;
        if (!any(failed | capped)) return;

        for (std::uint64_t rest = bits(capped); rest != 0; rest &= rest - 1) ++result.capped;
        for (std::uint64_t rest = bits(failed), lane = 0; rest != 0; rest >>= 1, ++lane) {
            if ((rest & 1) == 0) continue;
            if (result.failed++ > 0) continue;
            result.particle = items.value(before.id, int(lane));
            auto const holds = [&](Mask<Real> const& mask) { return ((bits(mask) >> lane) & 1) != 0; };
            result.cause = holds(!finite)             ? FailureCause::not_finite
                           : holds(response.inverted) ? FailureCause::inverted
                           : holds(calm)              ? FailureCause::escaped
                                                      : FailureCause::rejected;
        }
    }
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/transfer/pic.hpp>

namespace firn
{

/// The blend of PIC and FLIP (Brackbill & Ruppel 1986; Stomakhin et al. 2013, step 8): a particle gathers
/// `fraction` of the change of the grid's velocity, added to its own, and the rest as the velocity itself.
/// The PIC part damps per step, not per second.
struct Flip
{
    double fraction = 0.95; ///< beta: 1 is pure FLIP, 0 is PIC

    static constexpr auto name = "flip";
    using State = Fields<Velocity>;
    using Stored = Fields<Velocity>;

    template <class Kernel>
    static constexpr Terms scatter_terms{.gradient = true};
    template <class Kernel>
    static constexpr Terms gather_terms{.gradient = true};
    static constexpr bool keeps_old_velocity = true;
    static constexpr bool moves_with_grid = true;

    void for_each_parameter(auto const& use) const { use("fraction", fraction); }

    void validate() const
    {
        require(is_between(0, fraction, 1), "the FLIP fraction is outside [0, 1]", "Flip",
                "Pass the share of FLIP: 0.95 as in the snow paper, 1 for pure FLIP.");
    }

    /// m v, and separately the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        return Pic{}.scatter<Kernel, Real, d>(particle, mass, stress_impulse, cell_size);
    }

    /// v = (1 - beta) sum w v_i + beta (v + sum w (v_i - v_i^n)); returns L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        Vector<Real, d>& v = particle[Velocity{}];
        v = gathered.velocity + (v - gathered.old_velocity) * Real(ScalarOf<Real>(fraction));
        return gathered.gradient * inverse_cell_size;
    }
};

} // namespace firn

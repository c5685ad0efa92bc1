// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/parameters.hpp>
#include <firn/models/fluids/fluid.hpp>

namespace firn
{

/// A fluid whose particles fill the volume that their states say:
///
///     Solver<OpenMP, KeepsVolume<Fluid<Space>>> water(lattice(0.02), materials::water<Space>(2));
///
/// The volume ratio J of a particle and the room that it has among the others drift apart, since nodes do not
/// see all motions that bring particles closer: still water in a tank that lies across the cells sinks by a
/// tenth in some seconds, and sloshed water rises. So at intervals particles are moved until nodes have the
/// volume that belongs there: by the gradient of a potential whose sources are nodes with too much or too
/// little of it (Kugelstadt, Longva, Thürey and Bender 2019, *Implicit density projection for volume
/// conserving liquids*; here explicit sweeps). Velocities and states stay, and so does momentum.
///
/// A correction leads no particle into a solid or through an edge that two boards have in common, if these
/// are at rest or move alike, and brings one out that is inside by less than half a cell. One that is deeper,
/// or finds no way out, stays where the step moved it. Boards should be at least one cell thick: what is more
/// than half a cell inside may come out at the back.
///
/// Obstacles have to act at their surface (`Obstacles<Shape, ActsOn::surface>`), since the room beside one
/// counts; programs with other ones do not compile. A shell thinner than a cell takes no room.
template <class Model>
struct KeepsVolume : Model
{
    using Space = typename Model::Space;
    using Number = typename Space::Scalar;
    static constexpr auto name = "fluid_that_keeps_its_volume";
    static constexpr bool keeps_volume = true;

    /// How far sound comes from one correction to the next [cells]; a step goes some 0.4 cells.
    Number interval = 8;
    /// Of a correction. A deficit is corrected at once over about as many cells.
    int sweeps = 10;

    KeepsVolume() = default;
    KeepsVolume(Model const& model) : Model(model) {}

    void for_each_parameter(auto const& use) const
    {
        Model::for_each_parameter(use);
        use("interval", interval);
        use("sweeps", sweeps);
    }

    void validate() const
    {
        Model::validate();
        require(interval >= 0 && is_finite(interval), "the interval is not a finite number, 0 or above", name,
                "Pass cells that sound goes, e.g. 8; 0 corrects in every step.");
        require(sweeps >= 1 && sweeps <= 1000, "the sweeps are outside [1, 1000]", name,
                "Pass how many a correction has, e.g. 10.");
    }
};

} // namespace firn

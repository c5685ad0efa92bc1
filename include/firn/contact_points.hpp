// SPDX-License-Identifier: MIT
#pragma once

#include <firn/time_stepping/last_contacts.hpp>

namespace firn
{

/// Where the obstacles of the last call that act at their surface (`ActsOn::surface`) touched material, and
/// by what impulse, in the call's last step: points about a cell apart, without those that touched nothing.
/// None after a call without such obstacles, or whose last step failed. On a device this waits for the step
/// and copies the points to the host.
///
///     auto const last = firn::contact_points(solver);
///     for (auto const& point : last.points) hit(point.obstacle, point.position, point.impulse / last.dt);
///
/// Many worlds (Worlds) are asked in the same way: each point then says in which of them it lies, and has the
/// coordinates of that one and the number of the obstacle there. The impulses of an obstacle's points add up
/// to the Reaction::impulse of that step. Throws an Error as other calls do, for example after a call that
/// broke off.
template <class Solver>
ContactPoints<Solver::d> contact_points(Solver const& solver)
{
    if constexpr (requires { solver.solver(); }) // Worlds
        return solver.solver().last_contacts();
    else
        return solver.last_contacts();
}

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/math/product.hpp>
#include <firn/particles/readback.hpp>
#include <firn/time_stepping/step_controller.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/integrators.hpp>

#include <algorithm>
#include <cstdint>
#include <limits>

// What materials, effects and the state of a scene contribute to the length of time steps. `sets` are the
// scene's MaterialSets.
namespace firn::detail
{

/// The time step controller with the limits of the materials and of what the transfer carries alone. A
/// material without particles imposes no viscous limit.
template <class Kernel, class Transfer, class Sets>
TimeStepController<static_cast<int>(Sets::count)>
controller_of_materials(Sets const& sets, Transfer const& transfer, StepControl const& control,
                        double cell_size)
{
    TimeStepController<static_cast<int>(Sets::count)> controller{.control = control, .cell_size = cell_size};
    if (sets.template size<Sets::count>() > 0)
        controller.field = carried_by(transfer).template largest_step<Kernel>(cell_size);
    if constexpr (StepsImplicitly<Transfer>) {
        controller.waves_bound = false;
        controller.forces_act_throughout = true;
    }
    Sets::for_each([&](auto k) {
        auto const& model = sets.template model<k>();
        double expansion_ratio = Sets::d; // the largest possible, for models that do not declare one
        if constexpr (requires { model.expansion_ratio(Sets::d); })
            expansion_ratio = model.expansion_ratio(Sets::d);
        else if constexpr (requires { model.elasticity.expansion_ratio(Sets::d); })
            expansion_ratio = model.elasticity.expansion_ratio(Sets::d);
        MaterialLimits& limits = controller.limits[k];
        limits.wave = isolated_limit<Kernel, Transfer>(expansion_ratio);
        if constexpr (Viscous<typename Sets::template MaterialTraits<k>::Model>)
            if (sets.template particles<k>().size() > 0)
                limits.shear =
                    shear_limit(limits.wave, model.kinematic_viscosity(), cell_size, expansion_ratio);
    });
    return controller;
}

/// Adds the bounds of an effect in d dimensions to the controller.
template <int d, class Controller, class Effect>
void admit_effect(Controller& controller, Effect const& effect)
{
    if constexpr (requires { effect.largest_acceleration(); })
        controller.acceleration = std::max(controller.acceleration, effect.largest_acceleration());
    if constexpr (requires { effect.largest_speed(d); })
        controller.obstacle_speed = std::max(controller.obstacle_speed, effect.largest_speed(d));
    else if constexpr (requires { effect.largest_speed(); }) // the same in any dimension
        controller.obstacle_speed = std::max(controller.obstacle_speed, effect.largest_speed());
}

/// A modulus, or infinity in place of one that is no number.
inline double modulus_or_infinity(double modulus)
{
    return is_finite(modulus) ? modulus : std::numeric_limits<double>::infinity();
}

/// The largest wave modulus of a material's particles [Pa].
template <std::size_t k, class Sets>
double largest_modulus(Sets const& sets)
{
    double modulus = 0;
    for_each_particle(sets.template particles<k>(), [&](std::uint32_t, auto& particle) {
        modulus = std::max(modulus, modulus_or_infinity(sets.template response<k>(particle).wave_modulus));
    });
    return modulus;
}

/// The bounds of the next step after the state was set from outside. Only a step finds the deformation rate
/// and the speed of touched obstacles, so these stay those in `found` if particles are left; a known affine
/// velocity also bounds the deformation rate. `values(tag, k)` returns a field's values for a material, and
/// `modulus(k)` its largest wave modulus.
template <class Sets, class Controller, class Values, class Modulus>
FIRN_COLD StepBounds bounds_of(Sets const& sets, Controller const& controller, StepBounds const& found,
                               Values const& values, Modulus const& modulus)
{
    StepBounds bounds;
    Sets::for_each([&](auto k) {
        if (sets.template particles<k>().size() == 0) return;
        bounds.deformation_rate = std::max(bounds.deformation_rate, found.deformation_rate);
        bounds.obstacle_speed = found.obstacle_speed;
        controller.admit(bounds, static_cast<int>(k), sets.template wave_speed<k>(modulus(k)));
        for (auto const& velocity : values(Velocity{}, k))
            bounds.speed = std::max(bounds.speed, double(norm(velocity)));
        if constexpr (Sets::template MaterialTraits<k>::State::template contains<AffineVelocity>)
            for (auto const& rate : values(AffineVelocity{}, k))
                bounds.deformation_rate = std::max(bounds.deformation_rate, double(norm(rate)));
    });
    return bounds.finite();
}
template <class Sets, class Controller, class Values>
StepBounds bounds_of(Sets const& sets, Controller const& controller, StepBounds const& found,
                     Values const& values)
{
    return bounds_of(sets, controller, found, values, [&](auto k) { return largest_modulus<k>(sets); });
}

} // namespace firn::detail

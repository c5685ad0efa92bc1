// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/transfer/transfer.hpp>

#include <array>
#include <cmath>
#include <limits>

namespace firn
{

/// What bounds a time step.
enum class StepLimit
{
    wave,         ///< the fastest elastic wave in the current, hardened state
    viscosity,    ///< the decay of a viscous fluid's shear
    advection,    ///< the fastest particle
    deformation,  ///< the largest velocity gradient
    acceleration, ///< gravity
    obstacle,     ///< the fastest obstacle surface that touches something
    field,        ///< what the transfer carries beside mass and motion, such as heat that is conducted
    accuracy,     ///< the error of the step before: see Implicit::error
    convergence,  ///< how many linear systems the step before took: see Implicit::target
    growth,       ///< the step before: steps grow by StepControl::growth at most
    duration,     ///< what is left of the time asked for
};
/// How many kinds of StepLimit there are.
inline constexpr int step_limit_count = 11;

/// The limit in one word.
constexpr char const* describe(StepLimit limit)
{
    constexpr char const* names[]{"wave",         "viscosity", "advection", "deformation",
                                  "acceleration", "obstacle",  "field",     "accuracy",
                                  "convergence",  "growth",    "duration"};
    return names[static_cast<int>(limit)];
}

/// The safety factors of the automatic time step. The defaults hold for every kernel of degree two and three.
///
/// For steps of your own without rejection use Solver::step, which chooses none, with `rejection` infinite.
/// Phases find the bounds and check their results all the same, for less than five per cent of a step. A
/// result without meaning is never accepted, whatever the factors: a state or stress that is not finite, det
/// F <= 0 where there is no stress for it, a particle that moves by a cell or leaves the range of cells.
struct StepControl
{
    double wave = 0.9;        ///< share of the isolated-particle limit, see isolated_limit and shear_limit,
                              ///< and of what carried fields allow
    double advection = 0.3;   ///< cells a particle may move per step, at most 0.5
    double deformation = 0.2; ///< dt |L|
    double obstacle = 0.5;    ///< cells an obstacle's surface may move per step
    double growth = 1.1;      ///< largest ratio of a step to the one before
    double rejection = 0.5;   ///< dt |L| found after a step above which it is rejected; infinity: never
    double smallest = 1e-12;  ///< a step below this share of the duration asked for is an error
    int retries = 12;         ///< how often a failed step is halved before it is an error

    void validate() const
    {
        auto const keep = [](bool good, char const* what, char const* remedy) {
            require(good, what, "StepControl", remedy);
        };
        auto const is_above = [](double factor, double low) { return is_number(factor) && factor > low; };
        keep(is_above(wave, 0), "wave is not above 0", "Pass a share of the limit, e.g. 0.9.");
        keep(is_above(advection, 0) && advection <= 0.5, "advection is outside (0, 0.5]",
             "Pass cells, e.g. 0.3.");
        keep(is_above(deformation, 0), "deformation is not above 0", "Pass a change per step, e.g. 0.2.");
        keep(is_above(obstacle, 0), "obstacle is not above 0", "Pass cells, e.g. 0.5.");
        keep(is_above(growth, 1), "growth is not above 1", "Pass the ratio of two steps, e.g. 1.1.");
        keep(is_above(rejection, deformation) && (rejection < 1 || !is_finite(rejection)),
             "rejection is neither between deformation and 1 nor infinite",
             "Pass a change per step, e.g. 0.5, or infinity: then none is rejected for it.");
        keep(is_above(smallest, 0) && smallest < 1, "smallest is outside (0, 1)",
             "Pass a share of the duration asked for, e.g. 1e-12.");
        keep(retries >= 0, "retries is below 0", "Pass how often a step may be halved, e.g. 12.");
    }
};

/// What the time step depends on, in the current state.
struct StepBounds
{
    double wave_speed = 0;       ///< of the material whose wave bounds the step most [m/s]
    int material = 0;            ///< which one that is
    double speed = 0;            ///< of the fastest particle [m/s]
    double deformation_rate = 0; ///< largest |L| [1/s]
    double acceleration = 0;     ///< [m/s^2]
    double obstacle_speed = 0;   ///< [m/s]

    /// The same with values that are not finite replaced by the largest number, so that they can be saved and
    /// restored. No step is possible with them either.
    FIRN_HOST_DEVICE StepBounds finite() const
    {
        auto const within = [](double value) {
            return is_finite(value) ? value : std::numeric_limits<double>::max();
        };
        return {within(wave_speed),   material,
                within(speed),        within(deformation_rate),
                within(acceleration), within(obstacle_speed)};
    }
};

/// The largest c dt / h at which a particle with no neighbours is stable:
/// sqrt(2 / (e D^-1 (R - K/2))), with R the kernel's gradient bound over D^-1 (1 for MLS forces), K = 1 for
/// schemes with an affine matrix, else 0, and e the model's expansion ratio (derived from the linearised
/// step; the form of Bai & Schroeder 2022). It lies below the limit of the bulk for all pairs of kernel and
/// transfer.
template <class Kernel, class Transfer>
double isolated_limit(double expansion_ratio)
{
    // The tent has no constant inertia: 4/h^2 is that of a particle in the middle of its cell.
    double inverse_inertia = 4;
    if constexpr (HasConstantInertia<Kernel>) inverse_inertia = Kernel::inverse_inertia;
    double const R =
        Transfer::template scatter_terms<Kernel>.gradient ? Kernel::gradient_bound / inverse_inertia : 1.0;
    double const K = Transfer::template scatter_terms<Kernel>.affine ? 1.0 : 0.0;
    return std::sqrt(2.0 / (expansion_ratio * inverse_inertia * (R - K / 2)));
}

/// The largest step [s] at which the shear of a fluid of a kinematic viscosity [m^2/s] decays, were there
/// nothing else; `wave_limit` is MaterialLimits::wave.
///
/// The linearised step of a particle with no neighbours is that of a damped oscillator, v += -dt (w^2 u + c
/// v) and u += dt v, stable while (dt w / 2)^2 + dt c / 2 < 1. Shear alone, of stress eta (L + L^T), has w =
/// 0 and c / 2 = 2 nu / h^2 D^-1 (R - K/2), in the terms of isolated_limit.
inline double shear_limit(double wave_limit, double viscosity, double cell_size, double expansion_ratio)
{
    double const in_cells = wave_limit * cell_size;
    return viscosity > 0 ? 0.25 * expansion_ratio * in_cells * in_cells / viscosity
                         : std::numeric_limits<double>::infinity();
}

/// The largest step [s] where a wave's own limit is `wave` and that of the shear `shear` [s].
FIRN_HOST_DEVICE inline double damped_limit(double wave, double shear)
{
    return 1 / (0.5 / shear + std::sqrt(0.25 / (shear * shear) + 1 / (wave * wave)));
}

/// A step [s] and what bounds it.
struct ChosenStep
{
    double dt = std::numeric_limits<double>::infinity();
    StepLimit limit = StepLimit::duration;

    FIRN_HOST_DEVICE void bound(double other, StepLimit by)
    {
        if (other < dt) dt = other, limit = by;
    }
};

/// The limits of one material's step: `wave` is the largest stable c dt / h, see isolated_limit; `shear` in
/// s, see shear_limit, infinite without viscosity.
struct MaterialLimits
{
    double wave = 0;
    double shear = std::numeric_limits<double>::infinity();
};

/// The largest step that is stable for a material whose fastest wave has this speed [m/s].
FIRN_HOST_DEVICE inline ChosenStep stable_for_material(StepControl const& control, double wave_speed,
                                                       double cell_size, MaterialLimits const& limits)
{
    ChosenStep step;
    double const wave = limits.wave * cell_size / wave_speed;
    step.bound(control.wave * wave, StepLimit::wave);
    if (is_finite(limits.shear))
        step.bound(control.wave * damped_limit(wave, limits.shear), StepLimit::viscosity);
    return step;
}

/// The largest step that is stable in the current state, by the bounds of the material and the motion alone;
/// `limits` are those of the material that bounds it.
FIRN_HOST_DEVICE inline ChosenStep stable_time_step(StepControl const& control, StepBounds const& now,
                                                    double cell_size, MaterialLimits const& limits)
{
    double const h = cell_size;
    ChosenStep step = stable_for_material(control, now.wave_speed, h, limits);
    step.bound(control.advection * h / now.speed, StepLimit::advection);
    step.bound(control.deformation / now.deformation_rate, StepLimit::deformation);
    step.bound(std::sqrt(0.5 * h / now.acceleration), StepLimit::acceleration);
    step.bound(control.obstacle * h / now.obstacle_speed, StepLimit::obstacle);
    return step;
}

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include "input.hpp"

#include <firn/assign.hpp>
#include <firn/core/components.hpp>
#include <firn/firn.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/models/varied.hpp>
#include <firn/openmp.hpp>
#include <firn/transfer/loaded_surfaces.hpp>
#include <firn/transfer/marks.hpp>
#include <firn/transfer/with_fields.hpp>

#include <vector>

// Scenes that the harnesses drive, and what holds for each of them after whatever call.
namespace firn::fuzz
{

using Plane = Space<2, double>;
using PlaneFloat = Space<2, float>;
using SolidFloat = Space<3, float>;

/// What most harnesses have: single precision, a material that yields and hardens.
using Sheet = Solver<OpenMP, Snow<PlaneFloat>, QuadraticBSpline, Mls>;

/// A number of each particle that the host gives it.
struct Handle
{
    static constexpr auto name = "handle";
    static constexpr auto shape = FieldShape::integer;
    static constexpr std::uint32_t at_rest = 0xffffffff;
};

/// The same with all that particles may carry: marks, areas of loaded surfaces, moduli and a number of their
/// own. Velocities are stored, and forces act apart from momentum.
using MarkedSheet = Solver<OpenMP, Varied<Snow<PlaneFloat>, OwnShearModulus, OwnLambda>, QuadraticBSpline,
                           WithFields<Carrying<Flip, Marks<Mark>, LoadedSurfaces>, Handle>>;
template <class Solver>
inline constexpr bool has_marks = Solver::State::template contains<Mark>;

/// A liquid that keeps its volume: its obstacles act at their surface.
using Pool = Solver<OpenMP, KeepsVolume<Fluid<PlaneFloat>>, QuadraticBSpline, Mls>;
template <class Solver>
inline constexpr bool is_pool = requires
{
    requires Solver::Model::keeps_volume;
};

/// The sheet in space, where velocities are stored: with FIRN_FUZZ_ALL.
using SnowBall = Solver<OpenMP, Snow<SolidFloat>, CubicBSpline, Flip>;

/// All that is told of a scene's particles, by rising id.
template <class Solver>
struct Told
{
    static constexpr int d = Solver::d;
    double time = 0;
    std::vector<std::uint32_t> ids;
    std::vector<Vector<double, d>> positions;
    std::vector<Vector<typename Solver::Number, d>> velocities;
    std::vector<double> masses;

    explicit Told(Solver const& solver)
        : time(solver.time()), ids(solver.ids()), positions(solver.positions()),
          velocities(solver.template download<Velocity>()), masses(solver.masses())
    {}
    bool operator==(Told const&) const = default;

    double mass() const
    {
        double sum = 0;
        for (double const m : masses) sum += m;
        return sum;
    }
    Vector<double, d> momentum() const
    {
        Vector<double, d> sum = Vector<double, d>::Zero();
        for (std::size_t i = 0; i < masses.size(); ++i)
            sum += masses[i] * velocities[i].template cast<double>();
        return sum;
    }
    /// Of momenta that may cancel in the sum [kg m/s].
    double momenta() const
    {
        double sum = 0;
        for (std::size_t i = 0; i < masses.size(); ++i)
            sum += masses[i] * velocities[i].template cast<double>().norm();
        return sum;
    }
};

/// Every number of every particle is one, and there is one of each.
template <class Solver>
Told<Solver> expect_whole(Solver const& solver)
{
    Told<Solver> const told(solver);
    std::size_t const count = solver.size();
    expect(told.ids.size() == count && told.positions.size() == count && told.velocities.size() == count &&
               told.masses.size() == count,
           "not one value per particle");
    expect(std::isfinite(told.time), "time is not finite");
    for (std::size_t i = 1; i < count; ++i) expect(told.ids[i - 1] < told.ids[i], "ids do not rise");
    for (auto const& x : told.positions) expect(x.allFinite(), "a position is not finite");
    for (auto const& v : told.velocities) expect(v.allFinite(), "a velocity is not finite");
    for (double const m : told.masses) expect(std::isfinite(m) && m > 0, "a mass is not above 0");
    auto const& bounds = solver.bounds();
    expect(std::isfinite(bounds.wave_speed) && std::isfinite(bounds.speed) &&
               std::isfinite(bounds.deformation_rate),
           "a bound of the step is not finite");
    return told;
}

/// What obstacles received is a number, however little sense the scene makes.
inline void expect_finite(std::vector<Reaction> const& reactions)
{
    for (auto const& reaction : reactions)
        expect(reaction.impulse.allFinite() && reaction.angular_impulse.allFinite(),
               "a reaction is not finite");
}

/// Whether a call was refused, by an Error with all of its parts: any other exception ends the program.
template <class Call>
bool refused(Call const& call)
{
    try {
        call();
        return false;
    }
    catch (Error const& error) {
        expect(!error.what_is_wrong().empty() && !error.where().empty() && !error.remedy().empty(),
               "a part of an error is missing");
        return true;
    }
}

/// Whether some particle has a field that is not 0.
template <class Tag, class Solver>
bool is_marked(Solver const& solver)
{
    using Number = typename Solver::Number;
    bool any = false;
    for (auto& value : solver.template download<Tag>())
        for_each_component<Tag, Solver::d>(value,
                                           [&](int, Number& number) { any = any || std::abs(number) > 0; });
    return any;
}

/// Marks a particle where none is marked, or calls with effects on marks would all be refused.
template <class Solver>
void mark_one(Solver& solver)
{
    if (solver.size() == 0) return;
    std::vector const one{solver.ids().front()};
    if (!is_marked<Mark>(solver)) assign<Mark>(solver, one, 0.5);
    if (!is_marked<AreaPerMass>(solver))
        assign<AreaPerMass>(solver, one, 1e-3 * Vector<double, Solver::d>::Unit(0));
}

/// A call that is refused is to change nothing.
template <class Solver, class Call>
bool refused_whole(Solver& solver, Call const& call)
{
    Told<Solver> const before(solver);
    bool const was = refused(call);
    if (was) expect(Told<Solver>(solver) == before, "a call that was refused changed something");
    return was;
}

} // namespace firn::fuzz

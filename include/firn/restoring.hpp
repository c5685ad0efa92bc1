// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/models/response.hpp>
#include <firn/snapshot.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <sstream>
#include <string>

// Whether a state from outside is one that a scene can go on from. `parts` are its SceneParts.
namespace firn::detail
{

/// Says in a snapshot what the model of a material is.
template <std::size_t k, class Parts>
void name_material(Parts const& parts, MaterialSnapshot<typename Parts::Number, Parts::d>& material)
{
    material.name = name_of_policy<typename Parts::template Of<k>::Model>();
    material.density = double(parts.template model<k>().density);
    material.wave_modulus = double(parts.template response_at_rest<k>().wave_modulus);
}

/// Refuses the snapshot of another kind of solver.
template <class Kernel, class Transfer, class Parts, class Number, int d>
void require_fits(Snapshot<Number, d> const& from, Parts const& parts, Lattice const& lattice)
{
    auto const same = [](bool condition, std::string const& what, auto const& theirs, auto const& ours) {
        if (condition) return;
        std::ostringstream text;
        text.precision(17);
        text << "the snapshot has " << what << " " << theirs << ", this solver has " << ours;
        throw Error{text.str(), "Solver::restore",
                    "Restore into a solver that was made with the same lattice, policies and parameters."};
    };
    auto const compare = [&](std::string const& what, auto const& theirs, auto const& ours) {
        same(theirs == ours, what, theirs, ours);
    };
    compare("the kernel", from.kernel, name_of_policy<Kernel>());
    compare("a kernel of order", from.kernel_order, Kernel::order + 0);
    compare("the transfer", from.transfer, name_of_policy<Transfer>());
    compare("a cell size [m] of", from.lattice.cell_size, lattice.cell_size);
    same(from.lattice.origin == lattice.origin, "the origin [m]", from.lattice.origin.transpose(),
         lattice.origin.transpose());
    compare("this many materials:", from.materials.size(), Parts::count + 0);
    Parts::for_each([&](auto k) {
        MaterialSnapshot<Number, d> ours;
        name_material<k>(parts, ours);
        auto const& theirs = from.materials[k];
        std::string const place = "material " + std::to_string(k);
        compare("for " + place, theirs.name, ours.name);
        compare("for " + place + " the density [kg/m^3]", theirs.density, ours.density);
        // some processors' exponentials differ in the last bit
        same(std::abs(theirs.wave_modulus - ours.wave_modulus) <= 1e-5 * ours.wave_modulus,
             "for " + place + " the wave modulus at rest [Pa]", theirs.wave_modulus, ours.wave_modulus);
        Parts::template Of<k>::Table::require_same_fields(theirs, place + " (" + ours.name + ")");
    });
}

/// Whether the model of a material may object to a state from outside.
template <std::size_t k, class Parts>
inline constexpr bool may_object =
    ObjectsToStates<typename Parts::template Of<k>::Model,
                    Record<typename Parts::Number, Parts::d, typename Parts::template Of<k>::Stored>>;

/// Throws an Error if it does, for the particle of a row of a table: the scene's own, or one to come.
template <std::size_t k, class Parts, class Table, class Particle>
void require_bearable(Parts const& parts, Table const& table, std::uint32_t row, Particle const& particle,
                      char const* call)
{
    std::string const objection = parts.template model<k>().objection(particle);
    if (objection.empty()) return;
    throw Error{objection,
                std::string(call) + ", value " + std::to_string(row) + ", particle " +
                    std::to_string(table.id(row)) + Parts::name(k),
                "Pass a state that the material could have come to."};
}

} // namespace firn::detail

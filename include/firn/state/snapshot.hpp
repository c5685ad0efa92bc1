// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/parameters.hpp>
#include <firn/core/step_error.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/particles/table_snapshot.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace firn
{

/// All that the next steps of a solver depend on, except for the arguments of its constructor and its calls:
/// step control and effects. In memory of the host, whatever the backend.
///
/// It has the parameters of materials and transfer, too, so that Solver::restore refuses a solver that was
/// made with others. Parameters that it does not name are not compared.
///
/// See Solver::snapshot and Solver::restore, and io/checkpoint.hpp for one in a file.
template <class Number, int d>
struct Snapshot
{
    std::string kernel, transfer; ///< their names
    int kernel_degree = 0;
    std::vector<Parameter> transfer_parameters{};
    Lattice lattice{};
    double time = 0;     ///< [s]
    double previous = 0; ///< see TimeState::previous [s]; 0: none
    double last = 0;     ///< the last step [s]; 0: there was none
    StepBounds bounds{}; ///< of the next step
    MassScale masses{};
    std::uint32_t next_id = 0; ///< of the next particle that is added
    std::vector<MaterialSnapshot<Number, d>> materials{};
    std::vector<StepFailure> isolated{}; ///< particles removed from the scene: see Solver::quarantine

    /// Lets a solver of other parameters go on from here with its own, for example a steeper friction angle
    /// or a stiffer snow: restore() then finds the bounds of the next step anew. Densities must stay:
    /// particles keep their masses.
    void forget_parameters()
    {
        transfer_parameters.clear();
        for (auto& material : materials) material.forget_parameters();
    }
};

namespace detail
{
/// Refuses a snapshot that is inconsistent in itself, so that no solver can have made it.
template <class Number, int d>
void require_whole(MaterialSnapshot<Number, d> const& material, MassScale const& masses,
                   std::uint32_t next_id, double largest_coordinate, char const* call,
                   char const* remedy = "Pass what a solver of the same kind has returned.")
{
    auto const whole = [&](bool condition, char const* what) { require(condition, what, call, remedy); };
    std::size_t const count = material.ids.size();
    whole(material.cells.size() == count, "there is not one cell per particle");
    constexpr double block = 16; // cells: a step may lead this far beyond before the next one is refused
    for (auto const& cell : material.cells)
        for (int a = 0; a < d; ++a)
            whole(std::abs(double(cell[a])) <= largest_coordinate + block, "a cell is out of range");
    for (auto const& offset : material.offsets) {
        whole(offset.size() == count, "there is not one offset per particle");
        for (auto const value : offset)
            whole(CellOffset<Number>::possible(value), "a particle is not in its cell");
    }
    for (auto const& field : material.fields)
        for (auto const& component : field.components) {
            whole(component.size() == count, "a field has not one value per particle");
            for (Number const value : component) whole(is_finite(value), "a field is not finite");
        }
    for (auto const id : material.ids) whole(id < next_id, "an id was never given");
    whole(material.mass_groups.empty() == (count == 0), "there are particles without a mass");
    for (std::size_t i = 0; i < material.mass_groups.size(); ++i) {
        auto const& [first, mass, volume] = material.mass_groups[i];
        whole(i == 0 ? first == 0 : first > material.mass_groups[i - 1].first_row && first < count,
              "the mass groups of equal particles are out of order");
        whole(is_finite(mass) && mass >= Number(masses.smallest) && mass <= Number(masses.largest) &&
                  volume > 0 && is_finite(volume),
              "a mass or volume is out of range");
    }
}

/// The same of a whole scene, for a call that says what to do.
template <class Number, int d>
void require_whole(Snapshot<Number, d> const& snapshot, double largest_coordinate, char const* call,
                   char const* remedy)
{
    auto const whole = [&](bool condition, char const* what) { require(condition, what, call, remedy); };
    auto const not_negative = [](double value) { return is_finite(value) && value >= 0; };
    auto const& [wave_speed, material, speed, rate, acceleration, obstacle_speed] = snapshot.bounds;
    whole(is_finite(snapshot.time) && not_negative(snapshot.previous) && not_negative(snapshot.last),
          "a time is not finite");
    whole(not_negative(wave_speed) && not_negative(speed) && not_negative(rate) &&
              not_negative(acceleration) && not_negative(obstacle_speed) && material >= 0 &&
              static_cast<std::size_t>(material) < snapshot.materials.size(),
          "a bound of the next step is out of range");
    auto const& masses = snapshot.masses;
    whole(not_negative(masses.unit) && not_negative(masses.smallest) && not_negative(masses.largest) &&
              masses.smallest <= masses.largest && masses.largest <= std::numeric_limits<Number>::max() &&
              (masses.unit > 0) == (masses.smallest > 0) &&
              masses.largest <= masses.smallest * MassScale::range<Number>,
          "the masses are out of range");
    std::vector<std::uint32_t> ids;
    for (auto const& of : snapshot.materials) {
        whole(of.ids.empty() || masses.unit > 0, "the masses are out of range");
        require_whole(of, masses, snapshot.next_id, largest_coordinate, call, remedy);
        ids.insert(ids.end(), of.ids.begin(), of.ids.end());
    }
    for (auto const& gone : snapshot.isolated) {
        whole(gone.particle < snapshot.next_id && gone.material < snapshot.materials.size() &&
                  all_finite(gone.position) && is_finite(gone.time) && not_negative(gone.dt) &&
                  *describe(gone.cause) != 0,
              "a particle was taken out of the scene that was never there, or for no reason");
        ids.push_back(gone.particle);
    }
    std::sort(ids.begin(), ids.end());
    whole(std::adjacent_find(ids.begin(), ids.end()) == ids.end(),
          "two particles have the same id, or one that was taken out of the scene is there");
}
} // namespace detail

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/io/checkpoint_companions.hpp>
#include <firn/io/checkpoint_stream.hpp>
#include <firn/state/snapshot.hpp>

#include <algorithm>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

// A snapshot as values of a checkpoint, in the order of the format in checkpoint.hpp.
namespace firn::detail
{

inline void put_parameters(CheckpointWriter& out, std::vector<Parameter> const& parameters)
{
    out.values(static_cast<std::uint32_t>(parameters.size()));
    for (Parameter const& one : parameters) {
        out.text(one.name);
        out.values(one.value);
    }
}

inline std::vector<Parameter> get_parameters(CheckpointReader& in)
{
    std::uint32_t count = 0;
    in.values(count);
    in.expect(count, sizeof(std::uint32_t) + sizeof(double));
    std::vector<Parameter> parameters(count);
    for (Parameter& one : parameters) {
        one.name = in.text();
        in.values(one.value);
    }
    return parameters;
}

template <class Number, int d>
void put_material(CheckpointWriter& out, MaterialSnapshot<Number, d> const& material)
{
    out.text(material.name);
    put_parameters(out, material.parameters);
    out.values(material.density, material.wave_modulus, std::uint64_t(material.ids.size()),
               static_cast<std::uint32_t>(material.fields.size()),
               std::uint64_t(material.mass_groups.size()));
    for (auto const& field : material.fields) {
        out.text(field.name);
        out.values(static_cast<std::uint32_t>(field.components.size()));
    }
    for (auto const& group : material.mass_groups)
        out.values(group.first_row, double(group.mass), double(group.volume));
    out.all(material.ids);
    for (int a = 0; a < d; ++a) {
        std::vector<std::int32_t> along;
        along.reserve(material.cells.size());
        for (auto const& cell : material.cells) along.push_back(cell[a]);
        out.all(along);
    }
    for (auto const& offset : material.offsets) out.all(offset);
    for (auto const& field : material.fields)
        for (auto const& component : field.components) out.all(component);
}

template <class Number, int d>
MaterialSnapshot<Number, d> get_material(CheckpointReader& in)
{
    MaterialSnapshot<Number, d> material;
    using Offset = typename MaterialSnapshot<Number, d>::Offset;
    std::uint64_t particles = 0, mass_groups = 0;
    std::uint32_t fields = 0;
    material.name = in.text();
    material.parameters = get_parameters(in);
    in.values(material.density, material.wave_modulus, particles, fields, mass_groups);
    in.expect(fields, 8);
    for (std::uint32_t i = 0; i < fields; ++i) {
        std::uint32_t components = 0;
        material.fields.push_back({in.text(), {}});
        in.values(components);
        require(components <= d * d, "a field has more components than a matrix", "read_checkpoint",
                "The file was not written by this library: pass another one.");
        material.fields.back().components.resize(components);
    }
    in.expect(mass_groups, sizeof(std::uint32_t) + 2 * sizeof(double));
    for (std::uint64_t i = 0; i < mass_groups; ++i) {
        std::uint32_t first = 0;
        double mass = 0, volume = 0;
        in.values(first, mass, volume);
        constexpr double most = std::numeric_limits<Number>::max();
        require(is_finite(mass) && is_finite(volume) && mass <= most && volume <= most && mass > 0 &&
                    volume > 0,
                "a mass or volume is out of range", "read_checkpoint",
                "The file was not written by this library: pass another one.");
        material.mass_groups.push_back({first, static_cast<Number>(mass), static_cast<Number>(volume)});
    }
    material.ids = in.all<std::uint32_t>(particles);
    material.cells.resize(particles);
    for (int a = 0; a < d; ++a) {
        auto const along = in.all<std::int32_t>(particles);
        for (std::uint64_t i = 0; i < particles; ++i) material.cells[i][a] = along[i];
    }
    for (auto& offset : material.offsets) offset = in.all<Offset>(particles);
    for (auto& field : material.fields)
        for (auto& component : field.components) component = in.all<Number>(particles);
    return material;
}

inline void put_isolated(CheckpointWriter& out, std::vector<StepFailure> const& isolated)
{
    out.values(static_cast<std::uint32_t>(isolated.size()));
    for (auto const& gone : isolated)
        out.values(static_cast<std::uint8_t>(gone.cause), gone.particle,
                   static_cast<std::uint32_t>(gone.material), gone.position.x(), gone.position.y(),
                   gone.position.z(), gone.time, gone.dt, gone.count);
}

inline std::vector<StepFailure> get_isolated(CheckpointReader& in)
{
    std::uint32_t count = 0;
    in.values(count);
    in.expect(count, 57);
    std::vector<StepFailure> isolated(count);
    for (auto& gone : isolated) {
        std::uint8_t cause = 0;
        std::uint32_t material = 0;
        in.values(cause, gone.particle, material, gone.position.x(), gone.position.y(), gone.position.z(),
                  gone.time, gone.dt, gone.count);
        gone.cause = static_cast<FailureCause>(cause);
        gone.material = material;
    }
    return isolated;
}

/// The schema of a snapshot's checkpoint: the older one, which earlier versions read, where it has all.
template <class Number, int d>
std::uint32_t checkpoint_schema_of(Snapshot<Number, d> const& from)
{
    auto const& periods = from.lattice.periods;
    bool const is_periodic =
        std::any_of(periods.begin(), periods.end(), [](int cells) { return cells != 0; });
    return is_periodic ? newest_checkpoint_schema : checkpoint_schema;
}

template <class Number, int d, class... Companions>
void put_checkpoint(CheckpointWriter& out, Snapshot<Number, d> const& from, Companions const&... companions)
{
    out.values(std::uint32_t(d), std::uint32_t(sizeof(Number)));
    out.text(from.kernel);
    out.values(std::uint32_t(from.kernel_degree));
    out.text(from.transfer);
    put_parameters(out, from.transfer_parameters);
    auto const& origin = from.lattice.origin;
    auto const& bounds = from.bounds;
    out.values(from.lattice.cell_size, origin.x(), origin.y(), origin.z(), from.time, from.previous,
               from.last, bounds.wave_speed, std::uint32_t(bounds.material), bounds.speed,
               bounds.deformation_rate, bounds.acceleration, bounds.obstacle_speed, from.masses.unit,
               from.masses.largest, from.masses.smallest, from.next_id, std::uint32_t(sizeof...(Companions)));
    (put_companion(out, companions), ...);
    out.values(static_cast<std::uint32_t>(from.materials.size()));
    for (auto const& material : from.materials) put_material(out, material);
    put_isolated(out, from.isolated);
    if (checkpoint_schema_of(from) > checkpoint_schema) {
        auto const& periods = from.lattice.periods;
        out.values(std::uint32_t(periods[0]), std::uint32_t(periods[1]), std::uint32_t(periods[2]));
    }
}

/// Refuses a number other than the one that the solver was compiled for.
inline void require_compiled_for(char const* what, std::uint32_t theirs, std::uint32_t ours)
{
    if (theirs == ours) return;
    throw Error{"the file has " + std::to_string(theirs) + " " + what + ", not " + std::to_string(ours),
                "read_checkpoint",
                "Read it into a solver of the Space that wrote it, or as the snapshot of one."};
}

template <class... Companions, class Number, int d>
std::tuple<Companions...> get_checkpoint(CheckpointReader& in, Snapshot<Number, d>& to)
{
    std::uint32_t dimensions = 0, bytes = 0, degree = 0, material = 0, companions = 0, materials = 0;
    in.values(dimensions, bytes);
    require_compiled_for("dimensions", dimensions, d);
    require_compiled_for("bytes to a number", bytes, sizeof(Number));
    to.kernel = in.text();
    in.values(degree);
    to.transfer = in.text();
    to.transfer_parameters = get_parameters(in);
    auto& origin = to.lattice.origin;
    auto& bounds = to.bounds;
    in.values(to.lattice.cell_size, origin.x(), origin.y(), origin.z(), to.time, to.previous, to.last,
              bounds.wave_speed, material, bounds.speed, bounds.deformation_rate, bounds.acceleration,
              bounds.obstacle_speed, to.masses.unit, to.masses.largest, to.masses.smallest, to.next_id,
              companions);
    to.kernel_degree = static_cast<int>(degree);
    bounds.material = static_cast<int>(material);
    if (companions != sizeof...(Companions))
        throw Error{"the file has " + std::to_string(companions) + " companions, " +
                        std::to_string(sizeof...(Companions)) + " are asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
    std::tuple<Companions...> read{get_companion<Companions>(in)...}; // braces: one after the other
    in.values(materials);
    in.expect(materials, 44); // of a text, two reals and four counts
    for (std::uint32_t i = 0; i < materials; ++i) to.materials.push_back(get_material<Number, d>(in));
    to.isolated = get_isolated(in);
    if (in.schema() > checkpoint_schema)
        for (int& period : to.lattice.periods) {
            std::uint32_t cells = 0;
            in.values(cells);
            require(cells <= 1u << 20, "a period is out of range", "read_checkpoint",
                    "The file was not written by this library: pass another one.");
            period = static_cast<int>(cells);
        }
    in.expect_end();
    return read;
}

} // namespace firn::detail

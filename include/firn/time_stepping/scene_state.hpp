// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/parameters.hpp>
#include <firn/effects/mark_check.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/grid/periods.hpp>
#include <firn/particles/add_particles.hpp>
#include <firn/particles/material_sets.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/volumes.hpp>
#include <firn/time_stepping/grid_state.hpp>
#include <firn/time_stepping/observe.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// The particles of a scene and its grid, without time. Before particles change from outside, the fields that
/// they gather from the grid are cached beside them; after that they have to scatter afresh.
template <class BackendType, class SetsType, class KernelType, class TransferType>
class SceneState
{
public:
    using Backend = BackendType;
    using Sets = SetsType;
    using Kernel = KernelType;
    using Transfer = TransferType;
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    using GridStateType = GridState<Backend, Sets, Kernel, Transfer>;

    /// An empty scene with the materials of `list`.
    template <class List>
    SceneState(Lattice cells, List list, Transfer const& scheme, Backend runner)
        : lattice(require_whole_periods<typename Sets::CellOrder, d>(lattice_for<Number>(cells))),
          transfer(scheme), backend(detail::backend_of_scene(std::move(runner), lattice, d)),
          sets(std::move(list), lattice, Kernel::degree, backend), grid_state(lattice, transfer, backend)
    {
        if constexpr (spans_ranks<Backend>) detail::require_same_on_ranks(backend, "Solver", description());
    }

    Lattice lattice;
    Transfer transfer;
    Backend backend;
    Sets sets; ///< the materials and their particles
    GridStateType grid_state;
    MassScale masses{};
    std::uint32_t next_id = 0;       ///< of the next particle that is added
    bool calls_begin_afresh = false; ///< see begin_call()
    detail::KnownMarks known_marks;  ///< to forget where fields of particles are set

    /// Before the steps of a call: particles scatter afresh if it is asked for. What follows then depends on
    /// the particles alone, and not on what came or went before the call.
    void begin_call()
    {
        if (!calls_begin_afresh) return;
        cache_grid_fields();
        grid_state.forget();
    }

    /// The positions [m] and masses [kg] of a material's particles, by row.
    template <std::size_t k>
    auto positions(detail::Rows wanted = detail::Rows::all) const
    {
        return positions_of(particles<k>(), wanted);
    }
    template <std::size_t k>
    auto masses_of_particles() const
    {
        return masses_of(particles<k>(), masses.unit);
    }
    /// How many particles there are.
    std::size_t size() const { return sets.template size<Sets::count>(); }

    /// Runs work after which there is no state to go on from if it throws.
    template <class Work>
    void change(Work const& work)
    {
        half_changed_ = true;
        work();
        half_changed_ = false;
    }
    /// Whether a call broke off after changing a part of the scene, so that there is no state to go on from.
    bool is_half_changed() const
    {
        bool any = half_changed_;
        Sets::for_each([&](auto k) { any = any || particles<k>().is_half_changed(); });
        return any;
    }

    /// Adds particles of a material with volumes [m^3] and a velocity [m/s], at points of the world with this
    /// centre (see WorldLayout). Returns how many.
    template <std::size_t k, class Points>
    std::size_t add(Points const& points, Volumes const& volumes, Vector<double, d> const& velocity,
                    Coordinates<d> const& centre = zeros<Coordinates<d>>())
    {
        if constexpr (Sets::are_bodies)
            require(!volumes.have_densities(), "particles of bodies have no densities of their own",
                    "Solver::add", "Make bodies of different densities, or Materials without contact.");
        cache_grid_fields();
        if (size() == 0) masses = {}; // there are none to compare with
        std::size_t const added = add_particles(particles<k>(), sets.template model<k>(), points, volumes,
                                                velocity, next_id, masses, centre);
        if (added == 0) return 0;
        next_id += static_cast<std::uint32_t>(added);
        grid_state.forget();
        return added;
    }

    /// Removes the particles of a material, or of all, for which a predicate is true. Returns how many.
    template <std::size_t place, class Predicate>
    std::size_t remove_if(Predicate const& predicate)
    {
        if constexpr (!TellsByPosition<Predicate, d>) cache_grid_fields();
        return remove(sets.template find<place>(detail::with_images<d>(predicate, lattice), backend));
    }

    /// Removes the marked particles of each material. Returns how many.
    std::size_t remove(std::vector<RemovalMask<Backend>> const& masks)
    {
        std::size_t count = 0;
        for (auto const& mask : masks) count += mask.count;
        if (count == 0) return 0;
        cache_grid_fields();
        Sets::for_each([&](auto k) {
            remove_particles(particles<k>(), masks[k]);
            half_changed_ = half_changed_ || masks[k].count > 0;
        });
        grid_state.forget();
        half_changed_ = false;
        return count;
    }

    /// Sets a field of all particles of a material, by rising id.
    template <class Tag, std::size_t k>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        using Traits = typename Sets::template MaterialTraits<k>;
        detail::require_same_values(backend, "Solver::upload", Tag::name, by_id);
        require(by_id.size() == particles<k>().size(), "there is not one value per particle",
                "Solver::upload", "Pass size() values, by id.");
        for (std::size_t i = 0; i < by_id.size(); ++i)
            for_each_component<Tag, d>(by_id[i], [&](int, Number number) {
                require_valid<Tag>(
                    number, [&] { return "Solver::upload, value " + std::to_string(i); },
                    "Pass finite values that the field may have.");
            });
        cache_grid_fields();
        known_marks.forget();
        if constexpr (Traits::Stored::template contains<Tag>) {
            ColumnsOf<typename Traits::Table> changed;
            detail::on_all_ranks(backend, [&] {
                changed = changed_columns(particles<k>(), [&](std::uint32_t row, auto& particle) {
                    particle[Tag{}] = by_id[row];
                    if constexpr (Sets::template may_object<k> &&
                                  Traits::Model::State::template contains<Tag>)
                        sets.template require_bearable<k>(particles<k>(), row, particle, "Solver::upload");
                });
            });
            change([&] { set_columns(particles<k>(), changed); });
        }
        else
            change([&] { particles<k>().cached().template set<Tag>(by_id); });
        grid_state.forget();
    }

    /// Caches the gathered fields beside the particles, before the grid or the particles' positions change.
    void cache_grid_fields() { grid_state.cache_grid_fields(sets); }

    /// A function that returns a field's values for a material, by row. `of` are the sets of this scene or
    /// new ones.
    auto values(Sets const& of) const
    {
        return [this, &of]<class Tag, std::size_t k>(Tag, std::integral_constant<std::size_t, k>) {
            return grid_state.template download<Tag, k>(of, detail::Rows::all);
        };
    }

    /// Writes world positions of a material [m]; see Solver::write_positions.
    template <std::size_t k>
    void write_positions(Number* to, std::size_t stride) const
    {
        auto const& table = particles<k>();
        require_room(to, table.size(), stride, d, "Solver::write_positions");
        if (table.size() == 0) return;
        backend.for_each_place(table.cells(), position_writer(table, to, stride));
        write_rows_of_other_ranks(table, to, stride, d);
    }

    /// Writes a field of a material's particles; see Solver::write.
    template <class Tag, std::size_t k>
    void write(Number* to, std::size_t stride) const
    {
        constexpr std::size_t components = component_count<Tag>(d);
        detail::require_same_on_ranks(backend, "Solver::write", Tag::name);
        require_room(to, particles<k>().size(), stride, components, "Solver::write");
        if (particles<k>().size() == 0) return;
        if constexpr (ObservedField<Tag>)
            write_observed<Tag, k>(*this, to, stride);
        else
            grid_state.template write<Tag, k>(sets, to, stride);
        write_rows_of_other_ranks(particles<k>(), to, stride, components);
    }

    /// A field of a material's particles, by row: see GridState::download, and observe.hpp.
    template <class Tag, std::size_t k>
    std::vector<FieldValue<Tag, Number, d>> download(detail::Rows wanted = detail::Rows::all) const
    {
        if constexpr (ObservedField<Tag>)
            return download_observed<Tag, k>(*this, wanted);
        else
            return grid_state.template download<Tag, k>(sets, wanted);
    }

    /// The node mass [mass units] below which a node's momentum is rounding error alone.
    Number smallest_node_mass() const
    {
        return Number(masses.largest) * (std::is_same_v<Number, float> ? Number(1e-20) : Number(1e-40));
    }

    /// Whether the scene's precision can represent its masses in kg.
    bool bears_kilograms() const
    {
        constexpr double rounding = MassScale::range<Number>;
        double const lightest = masses.unit * masses.smallest, heaviest = masses.unit * masses.largest;
        return size() == 0 || (lightest >= std::numeric_limits<Number>::min() * rounding &&
                               heaviest <= std::numeric_limits<Number>::max() / rounding);
    }

    /// Bytes held by particles and grid.
    std::size_t memory() const
    {
        std::size_t bytes = grid_state.grid().memory();
        Sets::for_each([&](auto k) { bytes += particles<k>().memory(); });
        return bytes;
    }

private:
    /// What all ranks must have in common.
    std::string description() const
    {
        std::ostringstream text;
        text.precision(17);
        auto const add = [&](auto const& policy) {
            text << detail::name_of_policy<std::remove_cvref_t<decltype(policy)>>() << ' ';
            for (auto const& parameter : detail::parameters_of(policy))
                text << parameter.name << ' ' << parameter.value << ' ';
        };
        text << d << ' ' << sizeof(Number) << ' ' << lattice.cell_size << ' ' << lattice.origin.transpose();
        for (int const period : lattice.periods) text << ' ' << period;
        text << ' ' << detail::name_of_policy<Kernel>() << ' ';
        add(transfer);
        Sets::for_each([&](auto k) {
            add(sets.template model<k>());
            text << double(sets.template model<k>().density) << ' ';
        });
        return text.str();
    }

    template <std::size_t k>
    auto& particles()
    {
        return sets.template particles<k>();
    }
    template <std::size_t k>
    auto const& particles() const
    {
        return sets.template particles<k>();
    }

    /// Checks the caller's memory before something is written to it for `count` particles.
    void require_room(Number const* to, std::size_t count, std::size_t stride, std::size_t components,
                      char const* where) const
    {
        detail::on_all_ranks(backend, [&] { require_room_here(to, count, stride, components, where); });
    }
    void require_room_here(Number const* to, std::size_t count, std::size_t stride, std::size_t components,
                           char const* where) const
    {
        require(to != nullptr || count == 0, "there is no memory to write to", where,
                "Pass room for size() times stride numbers.");
        if (stride < components)
            throw Error{"what is written of one particle would overlap the next one's", where,
                        "Pass a stride, in numbers, of " + std::to_string(components) + " or more."};
        if constexpr (!Backend::reaches_host_memory)
            require(count == 0 || backend.reaches(to),
                    "the memory to write to is the host's, which the backend does not reach", where,
                    "Pass memory of the device, or take positions() or download() for the host.");
    }

    bool half_changed_ = false; ///< see is_half_changed()
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/periods.hpp>
#include <firn/particles/storage.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/phases/solve_particles.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

// The particles of a material as Solver::settle has displaced them, where loops work on them: one loop and a
// copy of one number a particle, where a snapshot would be tens of copies to the host and back.
namespace firn::detail
{

/// Where an offset in a cell comes to lie after a way [cells]: so many whole cells further, and the offset
/// there.
template <class Number, class Offset>
FIRN_HOST_DEVICE auto moved_by(Offset const& offset, double way)
{
    struct Moved
    {
        double cells;
        decltype(CellOffset<Number>::from(0.0)) offset;
    };
    double const to = CellOffset<Number>::exact(offset) + way, cells = std::floor(to + 0.5);
    return Moved{cells, CellOffset<Number>::from(to - cells)};
}

/// Where the new values of a set's components lie by row: what settle() has found of a model's state, and
/// nothing for velocities, which are 0. Other components keep their values.
template <class Number, int components>
struct NewValues
{
    enum class Is : unsigned char
    {
        kept,
        found,
        nothing
    };
    std::array<Number const*, std::size_t(components)> by_row{};
    std::array<Is, std::size_t(components)> is{};

    FIRN_HOST_DEVICE Number of(int c, std::uint32_t row, Number before) const
    {
        Is const now = is[std::size_t(c)];
        return now == Is::kept ? before : now == Is::found ? by_row[std::size_t(c)][row] : Number(0);
    }
};

/// Writes a particle at its place in the order of cells, moved and deformed.
template <class Number, int d, class Set>
struct DisplaceParticle
{
    TableView<Number const, d, Set> from;
    TableView<Number, d, Set> to;
    NewValues<Number, Set::components(d)> values;
    std::array<Number const*, std::size_t(d)> way; ///< by row [m]
    Number const* modulus;                         ///< by row [Pa]
    double cell_size, largest_coordinate;
    Coordinates<d>* cells;
    Number* found; ///< the modulus, infinity where that is not finite; `unfit` of what no scene may have

    static constexpr Number unfit = Number(-1);

    FIRN_HOST_DEVICE void operator()(std::size_t place, Coordinates<d> const& cell, std::size_t slot) const
    {
        std::uint32_t const row = from.id[place];
        bool fits = true;
        Coordinates<d> now = cell;
        for (int a = 0; a < d; ++a) {
            auto const moved = moved_by<Number>(from.offset[std::size_t(a)][place],
                                                double(way[std::size_t(a)][row]) / cell_size);
            bool const is_near = std::abs(cell[a] + moved.cells) <= largest_coordinate;
            if (is_near) now[a] += static_cast<int>(moved.cells);
            to.offset[std::size_t(a)][slot] = moved.offset;
            fits = fits && is_near;
        }
        for (int c = 0; c < Set::components(d); ++c) {
            Number const value = values.of(c, row, from.component[std::size_t(c)][place]);
            to.component[std::size_t(c)][slot] = value;
            fits = fits && is_finite(value);
        }
        to.id[slot] = row;
        cells[slot] = now;
        Number const stiff = is_finite(modulus[row]) ? modulus[row] : std::numeric_limits<Number>::infinity();
        found[slot] = fits ? max(stiff, Number(0)) : unfit;
    }
};

/// Writes the new values of fields that are cached by row.
template <class Number, int components>
struct PutNewValues
{
    NewValues<Number, components> values;
    std::array<Number*, std::size_t(components)> to;

    FIRN_HOST_DEVICE void operator()(std::size_t row) const
    {
        for (int c = 0; c < components; ++c) {
            Number& value = to[std::size_t(c)][row];
            value = values.of(c, static_cast<std::uint32_t>(row), value);
        }
    }
};

/// What displace() and set_particles() make of the particles of a material, where these lie in memory that
/// loops alone reach. Particles come to lie in the same order.
template <std::size_t k, class Scene>
class DisplacedThere
{
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Table = typename Traits::Table;
    using Number = typename Scene::Number;
    using Backend = typename Scene::Backend;
    using Stored = typename Table::PersistentFields;
    using Derived = typename Table::DerivedFields;
    static constexpr int d = Scene::d;

public:
    /// Finds where they are to lie. Allocates all that is needed.
    template <class Found>
    DisplacedThere(Scene& scene, Found const& found)
        : table_(scene.sets.template particles<k>()), cells_(scene.backend, periods_of<d>(scene.lattice))
    {
        table_.sort();
        table_.make_next();
        std::size_t const count = table_.places();
        typename Backend::template Array<Coordinates<d>> cells(scene.backend);
        typename Backend::template Array<Number> moduli(scene.backend);
        cells.resize(count), moduli.resize(count);
        std::array<Number const*, std::size_t(d)> way;
        for (int a = 0; a < d; ++a) way[std::size_t(a)] = found.template column_of<Velocity>(a).data();
        scene.backend.for_each_place(
            table_.cells(),
            DisplaceParticle<Number, d, Stored>{
                std::as_const(table_).current(), table_.next(), new_values<Stored>(found), way,
                found.template column_of<FoundModulus>(0).data(), scene.lattice.cell_size,
                double(Scene::Sets::CellOrder::largest_coordinate), cells.data(), moduli.data()});
        for (Number const modulus : downloaded(moduli)) {
            fits_ = fits_ && modulus >= Number(0);
            largest_ = std::max(largest_, double(modulus));
        }
        if (fits_ && count > 0) cells_.insert(cells.data(), count, 0);
    }

    /// The largest wave modulus of them [Pa].
    template <class Found>
    double largest_modulus(Found const&) const
    {
        return largest_;
    }
    /// Whether all are finite and in the range of cells, so that they can be set.
    bool fits() const { return fits_; }

    /// Sets the particles.
    template <class Found>
    void set(Found const& found)
    {
        table_.change([&] {
            auto& to = table_.contents();
            to.buffer[0].swap(to.buffer[1]);
            if constexpr (Derived::components(d) > 0) {
                PutNewValues<Number, Derived::components(d)> put{new_values<Derived>(found), {}};
                bool any = false;
                for (auto const is : put.values.is) any = any || is != decltype(put.values)::Is::kept;
                for (std::size_t c = 0; any && c < put.to.size(); ++c)
                    put.to[c] = table_.cached().column(int(c)).data();
                if (any) table_.backend().for_each(table_.size(), put);
            }
            to.cells = std::move(cells_);
        });
    }

private:
    /// What becomes of the fields of a set.
    template <class Set, class Found>
    static auto new_values(Found const& found)
    {
        NewValues<Number, Set::components(d)> values;
        using Is = typename decltype(values)::Is;
        for_each_tag(Set{}, [&](auto tag) {
            using Tag = decltype(tag);
            constexpr int first = Set::template first_component<Tag>(d);
            for (int c = 0; c < component_count<Tag>(d); ++c) {
                if constexpr (Traits::Model::State::template contains<Tag>) {
                    values.by_row[std::size_t(first + c)] = found.template column_of<Tag>(c).data();
                    values.is[std::size_t(first + c)] = Is::found;
                }
                else if (std::is_same_v<Tag, Velocity> || std::is_same_v<Tag, AffineVelocity>)
                    values.is[std::size_t(first + c)] = Is::nothing;
            }
        });
        return values;
    }

    Table& table_;
    typename Table::CellOrder cells_;
    double largest_ = 0;
    bool fits_ = true;
};

} // namespace firn::detail

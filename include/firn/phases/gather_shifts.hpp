// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/grid/cell_polynomial.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/phases/keep_out_of_solids.hpp>
#include <firn/transfer/node_fields.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace firn
{

/// How far a particle of a fluid is moved in a step to keep the fluid's volume [cells].
struct VolumeShift
{
    static constexpr auto name = "volume_shift";
    static constexpr auto shape = FieldShape::vector;
};

/// Of a model that needs none.
struct NoShifts
{};

/// The shifts of a model's particles, by row, as the step that moves them sees them.
template <class Model, class Number, int d>
using ShiftsOf =
    std::conditional_t<KeepsItsVolume<Model>, FieldsById<Number const, d, Fields<VolumeShift>>, NoShifts>;

/// Particles gather the gradient of the potential that nodes have in the first channel of their values, which
/// is how far they are moved, but into no solid: see KeepOutOfSolids.
template <class Space, class Kernel, class PersistentFields, class Effects>
struct GatherShifts
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true};
    static constexpr int node_channels = channels_at_once<Kernel, d>; ///< all but the first are 0
    static constexpr int scratch_channels = 2 * d + 1;
    /// The most that a particle is moved at once, along any axis [cells].
    static constexpr double most = 0.2;
    template <class Real>
    using CellNodes = CellPolynomial<Kernel, Real, d, channels_at_once<Kernel, d>>;
    using Result = NothingFound;

    StepContext<Number, Effects> const* now;
    Lattice lattice;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, Fields<VolumeShift>> shifts;

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        auto const x = particles.position(items);
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) items.set_scratch(a, x[a]);
    }

    /// The gather, by the two ways of firn::Gather.
    struct Gather
    {
        static constexpr int node_channels = GatherShifts::node_channels;

        template <class Row, class Real = typename Row::Real>
        FIRN_HOST_DEVICE static void gather(Row& row_of_cells, CellNodes<Real> const& nodes, int)
        {
            Monomials<Kernel, Real, d> const powers(position_of<Real>(row_of_cells));
            auto const of_cells = [&](Real const& term) { return row_of_cells.of_cells(term); };
            auto const found = nodes.template at<false, true>(powers, of_cells);
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) row_of_cells.set_scratch(d + a, found.gradient[0][a]);
            row_of_cells.set_scratch(2 * d, found.value[0]);
        }

        template <class Row, class Real = typename Row::Real>
        FIRN_HOST_DEVICE static void gather(Row& row_of_cells)
        {
            using Nodes = Stencil<Kernel, Real, d>;
            Nodes const nodes(position_of<Real>(row_of_cells));
            Vector<Real, d> slopes = zeros<Vector<Real, d>>();
            Real potential = row_of_cells.reference(0); // to which values of nodes are relative
            FIRN_UNROLL_ON_DEVICE
            for (int row = 0; row < Nodes::rows; ++row) {
                Real plain(0), slope(0);
                FIRN_UNROLL
                for (int k = 0; k < Nodes::width; ++k) {
                    Real const value = row_of_cells.node(0, row, k);
                    plain += value * nodes.weight[Nodes::last][std::size_t(k)];
                    slope += value * nodes.derivative[Nodes::last][std::size_t(k)];
                }
                FIRN_UNROLL
                for (int a = 0; a < Nodes::last; ++a) slopes[a] += plain * nodes.row_gradient(row, a);
                slopes[Nodes::last] += slope * nodes.row_weight(row);
                potential += plain * nodes.row_weight(row);
            }
            FIRN_UNROLL
            for (int a = 0; a < d; ++a) row_of_cells.set_scratch(d + a, slopes[a]);
            row_of_cells.set_scratch(2 * d, potential);
        }
    };

    template <class Row>
    FIRN_HOST_DEVICE static void gather(Row& row_of_cells)
    {
        Gather::gather(row_of_cells);
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        Real const bound(static_cast<Number>(most));
        Record<Real, d, Fields<VolumeShift>> found;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) found[VolumeShift{}][a] = min(max(items.scratch(d + a), -bound), bound);
        if constexpr (Effects::groups_at_surface > 0) keep_out<Real>(items, found[VolumeShift{}]);
        shifts.store(items, particles.id, found);
    }

private:
    /// Lanes that are near a solid are kept out of it, one by one: each looks up the obstacles near its own
    /// cell.
    template <class Real, class Items>
    FIRN_HOST_DEVICE void keep_out(Items const& items, Vector<Real, d>& shift) const
    {
        constexpr int width = lane_width<Real>;
        constexpr Number to_node = Number(0.5 - cell_shift(Kernel::degree));
        KeepOutOfSolids<Number, d, Effects> const solids{now};
        Number const cell = static_cast<Number>(lattice.cell_size);
        Vector<Real, d> const x = position_of<Real>(items), along = items.along();
        Coordinates<d> first = items.first();
        Vector<Real, d> where = x;
        for (int a = 0; a < d; ++a) {
            if constexpr (width == 1) // one lane looks there by its own cell, too: see room_for_nodes()
                first[a] += static_cast<int>(along[a]);
            else
                where[a] += along[a];
            where[a] += Real(to_node);
        }
        std::uint64_t const near =
            bits(items.here() &
                 solids.template are_near<Real>({lattice, first, where, kernel_reach(Kernel::degree)},
                                                Vector<Real, d>(shift * Real(cell))));
        if (near == 0) return;
        Number offsets[std::size_t(d)][std::size_t(width)], cells[std::size_t(d)][std::size_t(width)],
            ways[std::size_t(d)][std::size_t(width)], potentials[std::size_t(width)];
        for (int a = 0; a < d; ++a) {
            LaneTraits<Real>::store(x[a], offsets[a]);
            LaneTraits<Real>::store(along[a], cells[a]);
            LaneTraits<Real>::store(shift[a], ways[a]);
        }
        LaneTraits<Real>::store(items.scratch(2 * d), potentials);
        for_each_lane<width>(near, [&](int lane) {
            LanePosition<Number, d> place{lattice, items.first(), zeros<Vector<Number, d>>(),
                                          kernel_reach(Kernel::degree)};
            Vector<Number, d> way;
            for (int a = 0; a < d; ++a) {
                place.first[a] += static_cast<int>(cells[a][lane]);
                place.offset[a] = offsets[a][lane] + to_node;
                way[a] = ways[a][lane] * cell;
            }
            // the potential is 0 where no fluid is, so its amount grows towards the fluid
            Vector<Number, d> const inwards = way * (potentials[lane] < Number(0) ? Number(-1) : Number(1));
            way = solids(place, way, inwards, static_cast<Number>(most) * cell);
            for (int a = 0; a < d; ++a) ways[a][lane] = way[a] / cell;
        });
        for (int a = 0; a < d; ++a) shift[a] = LaneTraits<Real>::load(ways[a]);
    }

    template <class Real, class Items>
    FIRN_HOST_DEVICE static Vector<Real, d> position_of(Items const& items)
    {
        Vector<Real, d> x;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) x[a] = items.scratch(a);
        return x;
    }
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/observables.hpp>
#include <firn/phases/find_surface_points.hpp>
#include <firn/phases/gather_shifts.hpp>
#include <firn/phases/room_beside.hpp>
#include <firn/phases/scatter.hpp>

#include <cstddef>
#include <cstdint>

// How a fluid keeps its volume, in steps at intervals and before nodes are updated: see KeepsVolume. With V_p
// = J_p V0_p, nodes have
//
//   e_i = sum_p w_ip V_p / h^d - r_i         the volume that is too much
//
// where r_i is the share of the node's kernel outside obstacles, and e_i < 0 counts only where there is fluid
// on all sides. Sweeps bring the potential phi nearer to that of (sum over neighbours of phi_i - phi_j) =
// -e_i, with phi = 0 where there is no fluid, and particles are moved by its gradient.
namespace firn
{

/// A node with less room than this lies in an obstacle.
inline constexpr double least_room = 0.05;

/// A node with some volume.
template <class Number, int d>
struct NodeOfVolume
{
    static constexpr std::uint32_t none = ~std::uint32_t(0);
    Coordinates<d> node;
    std::uint32_t index; ///< see Grid::nodes_by_index()
    /// The numbers of its neighbours below and above along each axis; none: they have no volume.
    std::uint32_t beside[std::size_t(2 * d)];
    std::uint32_t in_obstacles; ///< bit by bit whether these have hardly any room
    Number volume;              ///< that particles bring [cells]
    Number room;                ///< the share of its kernel outside obstacles
    Number source;              ///< of the potential, over 2 d [cells^2]
    Number change;              ///< of the potential in the last sweep
    Number potential[2];        ///< after sweeps of odd and of even number [cells^2]
};

/// The nodes as loops see them.
template <class Number, int d>
struct NodesOfVolume
{
    NodeOfVolume<Number, d>* nodes;
    std::uint32_t* count; ///< those beyond `room` are not there
    std::uint32_t room;
    std::uint32_t* numbers; ///< by index of a node
};

/// All particles of a material scatter their volumes, in the place of masses.
template <class Space, class Model, class Kernel, class PersistentFields>
struct ScatterVolumes
{
    /// Of volumes alone; momentum stays 0.
    struct Transfer
    {
        template <class>
        static constexpr Terms scatter_terms{};
        static constexpr bool keeps_old_velocity = false;
    };
    using Scatter = firn::Scatter<Space, Kernel, Transfer>;
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Result = NothingFound;
    static constexpr CellWork work{.scatters_to = ScatterTarget::sums};
    static constexpr int channels = Scatter::channels, scratch_channels = Scatter::scratch_channels;

    Model model;
    TableView<Number const, d, PersistentFields> particles;
    MassGroups<Number> mass_groups;
    Number in_cells; ///< a unit of volume over that of a cell

    bool adds_to_sums() const { return false; }

    template <class Items>
    FIRN_HOST_DEVICE void prepare(Items& items) const
    {
        using Real = typename Items::Real;
        Real volume = mass_groups.find(items, particles.id).volume * Real(in_cells);
        if constexpr (KeepsItsVolume<Model>) {
            auto particle = Record<Real, d, PersistentFields>::at_rest();
            particles.load(items, particle);
            volume = volume * volume_ratio<Real, d>(model, particle);
        }
        ParticleContribution<Real, d> contribution;
        contribution.momentum.setZero();
        Scatter::store(items, particles.position(items), volume, contribution, {});
    }

    template <class Row, class SumsOfCells>
    FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Scatter::scatter(row_of_cells, sums);
    }
};

/// On nodes: lists those that have volume, and finds the room that obstacles leave them.
template <class Space, class Kernel, class Effects>
struct FindVolumes
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = NodeSums<d, Fields<NodeMass, NodeMomentum>>; ///< with volumes in the place of masses
    static constexpr bool looks_around = false;
    using Result = NothingFound;
    StepContext<Number, Effects> const* now;
    Lattice lattice;
    NodesOfVolume<Number, d> found;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        constexpr int width = lane_width<Real>;
        Real const volume = node.sum(Sums::mass);
        for (int a = 0; a < channels_at_once<Kernel, d>; ++a) node.set(a, Real(0));
        Mask<Real> const filled = volume > Real(0);
        if (!any(filled)) return;
        LanePosition<Real, d> const place{lattice, node.first(), node.offset(), kernel_reach(Kernel::degree)};
        Real room(1), beside[std::size_t(2 * d)];
        for (auto& of_neighbour : beside) of_neighbour = Real(1);
        for_each_solid(place, [&](std::uint32_t number, auto const& obstacle) {
            Mask<Real> counts = filled;
            bool covers_any = false;
            for_each_solid(place, [&](std::uint32_t other_number, auto const& other) {
                if (other_number == number) return;
                Mask<Real> covered = is_covered<Real>(place, obstacle, other);
                Mask<Real> const covers = is_covered<Real>(place, other, obstacle);
                covers_any = covers_any || any(covers);
                // of two that cover each other, as where they have one face, the first counts
                if (number < other_number) covered = covered & !covers;
                counts = counts & !covered;
            });
            if (!any(counts)) return;
            // an obstacle and what it covers are one solid
            auto const away = [&](Vector<Real, d> const& cells) {
                Vector<Real, d> const shift = cells * in_cells<Real>(1);
                Real distance = obstacle.template surface_at<Real>(place, shift).distance;
                if (covers_any)
                    for_each_solid(place, [&](std::uint32_t other_number, auto const& other) {
                        if (other_number == number) return;
                        Mask<Real> const covers = is_covered<Real>(place, other, obstacle);
                        if (!any(covers)) return;
                        Real const of_other = other.template surface_at<Real>(place, shift).distance;
                        distance = select(covers, min(distance, of_other), distance);
                    });
                return Real(distance / in_cells<Real>(1));
            };
            RoomBeside<Real, d> const left = room_beside<Kernel::degree, Real, d>(away);
            room = room * select(counts, left.own, Real(1));
            for (int b = 0; b < 2 * d; ++b)
                beside[b] = beside[b] * select(counts, left.of_neighbours[b], Real(1));
        });
        Number along[std::size_t(d)][std::size_t(width)], volumes[std::size_t(width)],
            rooms[std::size_t(width)];
        std::uint64_t in_obstacles[std::size_t(2 * d)];
        for (int a = 0; a < d; ++a) LaneTraits<Real>::store(place.offset[a], along[a]);
        LaneTraits<Real>::store(volume, volumes);
        LaneTraits<Real>::store(room, rooms);
        for (int b = 0; b < 2 * d; ++b)
            in_obstacles[b] = bits(beside[b] < Real(static_cast<Number>(least_room)));
        for_each_lane<width>(bits(filled), [&](int lane) {
            std::uint32_t const number = next_number_of_all(*found.count);
            if (number >= found.room) return; // the host makes room, and looks again
            NodeOfVolume<Number, d>& listed = found.nodes[number];
            for (int a = 0; a < d; ++a) listed.node[a] = place.first[a] + static_cast<int>(along[a][lane]);
            listed.volume = volumes[lane];
            listed.room = rooms[lane];
            listed.in_obstacles = 0;
            for (int b = 0; b < 2 * d; ++b)
                listed.in_obstacles |= static_cast<std::uint32_t>((in_obstacles[b] >> lane) & 1) << b;
        });
    }

private:
    template <Lane Real>
    FIRN_HOST_DEVICE Real in_cells(double cells) const
    {
        return Real(static_cast<Number>(cells * lattice.cell_size));
    }

    /// Calls `use(number, obstacle)` for each one that takes room near lanes of nodes: thin shells take none.
    template <Lane Real, class Use>
    FIRN_HOST_DEVICE void for_each_solid(LanePosition<Real, d> const& place, Use const& use) const
    {
        Real const reach = in_cells<Real>(0.5 * (Kernel::degree + 1) + 1);
        for_each_solid_at_surface(now->actions, place, reach, use);
    }

    /// Whether the place of an obstacle's surface nearest to a node lies in another one, out of which it does
    /// not come there. A wall comes out of the floor below it: these two have one corner, and each takes its
    /// share of the room. Nor does a tile cover the one beside it.
    template <Lane Real>
    FIRN_HOST_DEVICE Mask<Real> is_covered(LanePosition<Real, d> const& place, auto const& obstacle,
                                           auto const& other) const
    {
        Real const little = in_cells<Real>(0.1), half = in_cells<Real>(0.05);
        auto const at = obstacle.template surface_at<Real>(place, zeros<Vector<Real, d>>());
        Vector<Real, d> const foot = at.normal * -at.distance;
        auto const there = other.template surface_at<Real>(place, foot);
        Mask<Real> const inside = there.distance < in_cells<Real>(0.01);
        if (!any(inside)) return inside;
        Vector<Real, d> const below = foot - there.normal * little,
                              above = foot + there.normal * (little - min(there.distance, Real(0)));
        return inside & (other.template surface_at<Real>(place, below).distance < there.distance - half) &
               (obstacle.template surface_at<Real>(place, above).distance > half);
    }
};

/// Numbers the listed nodes by their indices.
template <class Number, int d, class Nodes>
struct NumberVolumes
{
    NodesOfVolume<Number, d> of;
    Nodes by_index;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        NodeOfVolume<Number, d>& node = of.nodes[i];
        node.index = by_index.find(node.node);
        of.numbers[node.index] = static_cast<std::uint32_t>(i);
    }
};

/// Finds the neighbours of nodes, and by them the source of the potential.
template <class Number, int d, class Nodes>
struct FindSources
{
    NodesOfVolume<Number, d> of;
    Nodes by_index;
    /// A node has fluid beside it if that fills so much of its room, and what is more than this too much or
    /// too little is corrected as if it were this.
    static constexpr double least_filled = 0.3, most = 0.2;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        NodeOfVolume<Number, d>& node = of.nodes[i];
        bool inside = is_filled(node) && node.room > Number(least_room);
        for (int b = 0; b < 2 * d; ++b) {
            Coordinates<d> there = node.node;
            there[b / 2] += b % 2 == 0 ? -1 : 1;
            std::uint32_t const index = by_index.find(there);
            std::uint32_t const number =
                index == Nodes::absent ? NodeOfVolume<Number, d>::none : of.numbers[index];
            node.beside[b] = number;
            bool const in_obstacle = ((node.in_obstacles >> b) & 1) != 0;
            inside = inside && (in_obstacle ||
                                (number != NodeOfVolume<Number, d>::none && is_filled(of.nodes[number])));
        }
        Number const bound = Number(most);
        Number const excess = min(max(node.volume - node.room, -bound), bound);
        node.source = excess > Number(0) || inside ? -excess / Number(2 * d) : Number(0);
        node.change = node.potential[0] = node.potential[1] = 0;
    }

private:
    FIRN_HOST_DEVICE static bool is_filled(NodeOfVolume<Number, d> const& node)
    {
        return node.volume > Number(least_filled) * node.room;
    }
};

/// A sweep of Chebyshev's iteration (Golub & Varga 1961) for the potential, with the factors of its change.
template <class Number, int d>
struct SweepPotential
{
    NodeOfVolume<Number, d>* nodes;
    int from; ///< which of the two potentials it reads
    Number of_change, of_residual;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        NodeOfVolume<Number, d>& node = nodes[i];
        Number around = 0;
        for (std::uint32_t const beside : node.beside)
            if (beside != NodeOfVolume<Number, d>::none) around += nodes[beside].potential[from];
        Number const residual = node.source - (node.potential[from] - around / Number(2 * d));
        node.change = of_change * node.change + of_residual * residual;
        node.potential[1 - from] = node.potential[from] + node.change;
    }
};

/// Gives the grid the potential, as the first value of nodes.
template <class Number, int d, class Nodes>
struct ReturnPotential
{
    NodeOfVolume<Number, d> const* nodes;
    Nodes by_index;
    int from;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        by_index.value(nodes[i].index, 0) = nodes[i].potential[from];
    }
};

} // namespace firn

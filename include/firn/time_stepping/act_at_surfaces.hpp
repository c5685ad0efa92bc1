// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/error.hpp>
#include <firn/effects/surface_memory.hpp>
#include <firn/phases/find_surface_points.hpp>
#include <firn/phases/nodes_at_surface.hpp>
#include <firn/phases/points_of_nodes.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/phases/surface_contact.hpp>
#include <firn/time_stepping/step_scene.hpp>
#include <firn/time_stepping/surface_over_ranks.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

// The part of a step that obstacles have which act at their surface: their points are found before nodes are
// updated, and their impulses afterwards. See phases/surface_contact.hpp.
namespace firn
{

/// How many sweeps a step has that starts from the impulses of the step before, and one that does not. If an
/// obstacle moves by more than so many cells in a step, the weights of its points change so much that
/// impulses lag behind with the fewer sweeps.
inline constexpr int sweeps_that_go_on = 2, sweeps_that_follow = 4, sweeps_from_nothing = 20;
inline constexpr double moves_far = 0.05;

/// The memory of the obstacles of a call that act at their surface: that of the first list, which the others
/// have joined.
template <class Backend, class Sets, class Kernel, class Transfer>
auto& surface_memory(StepScene<Backend, Sets, Kernel, Transfer> const& scene)
{
    SurfaceMemory<Backend, typename Sets::Space::Scalar, Sets::Space::dimension>* memory = nullptr;
    for (auto* const group : scene.groups)
        if (memory == nullptr) memory = group->surface();
    assert(memory != nullptr && "the list that acts at its surface has it");
    return *memory;
}

/// As for_each of a backend, in a step that may have been queued in vain.
template <class Backend, class Sets, class Kernel, class Transfer, class Body>
void loop_in_step(StepMemory<Backend, Sets, Transfer> const& memory,
                  StepScene<Backend, Sets, Kernel, Transfer> const& scene, std::size_t count,
                  Body const& body)
{
    if constexpr (Backend::queues)
        memory.backend.for_each_in_step(scene.sets.orders(), count, body);
    else
        memory.backend.for_each(count, body);
}

/// Whether candidates for points are found in the loop that updates nodes. Else a loop before that finds
/// them.
template <class Backend>
inline constexpr bool finds_candidates_along = Backend::queues && !spans_ranks<Backend>;

/// The phase that finds candidates for points in a step.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
auto candidates_phase(StepMemory<Backend, Sets, Transfer> const& memory,
                      StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                      StepContext<typename Sets::Space::Scalar, Actions> const* now)
{
    auto& surface = surface_memory(scene);
    surface.begin();
    return FindCandidates<typename Sets::Space, Kernel, Transfer, Actions>{
        now, memory.lattice, scene.smallest_node_mass, surface.view(), surface.finds_ahead()};
}

/// Queues a loop that looks at the candidates that have been found.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
void look_at_candidates(StepMemory<Backend, Sets, Transfer> const& memory,
                        StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                        StepContext<typename Sets::Space::Scalar, Actions> const* now)
{
    auto& surface = surface_memory(scene);
    loop_in_step(memory, scene, surface.looked_at(),
                 FindSurfacePoints<typename Sets::Space, Kernel, Transfer, Actions>{now, memory.lattice,
                                                                                    surface.view()});
}

/// Queues loops that look for the points of surfaces which nodes meet in a step.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
void look_for_points(StepMemory<Backend, Sets, Transfer> const& memory,
                     StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                     StepContext<typename Sets::Space::Scalar, Actions> const* now)
{
    memory.backend.for_each_node(scene.sets.orders(), scene.grid_state.grid(),
                                 candidates_phase(memory, scene, now));
    [[maybe_unused]] auto& surface = surface_memory(scene);
    if constexpr (spans_ranks<Backend>) {
        if (!surface.had_room(surface.counted()))
            return look_for_points(memory, scene, now); // this rank alone looks once more
        surface.share_candidates();
    }
    look_at_candidates(memory, scene, now);
}

/// Waits for these loops, and returns what they found.
template <class Surface>
SurfaceCounts counted_points(Surface& surface)
{
    SurfaceCounts const counts = surface.counted();
    require(counts.points < (std::uint32_t(1) << 26), "more than 6e7 points of surfaces meet material",
            "Obstacles", "Take larger cells, or obstacles that act on nodes.");
    return counts;
}

/// Updates the nodes of a step by a phase, and finds the points of surfaces that these meet. On a backend
/// that queues, loops still look for them when this returns: see found_points(). There the host takes part in
/// the first step of a batch alone: a later one in which anything is new stops the batch, and is the first of
/// the next one.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions, class Update>
auto find_points_and_update(StepMemory<Backend, Sets, Transfer> const& memory,
                            StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                            StepContext<typename Sets::Space::Scalar, Actions> const* now,
                            Update const& update, bool is_first)
{
    static_assert(Actions::walls == 0, "a ReflectingWall goes with no obstacles that act at their surface: "
                                       "make it a HalfSpace in their list");
    static_assert(!Sets::are_bodies, "Bodies know no obstacles that act at their surface: choose "
                                     "Obstacles<Shape>");
    auto& surface = surface_memory(scene);
    auto const orders = scene.sets.orders();
    auto& grid = scene.grid_state.grid();
    surface.begin_step(is_first);
    auto const note_counts = [&] {
        if constexpr (Backend::queues) {
            if (is_first) return surface.fetch_counts();
            if (!surface.can_go_on()) surface.stop();
            surface.stop_if_counted();
            memory.backend.stop_steps_if(orders, surface.counts_of_new(), 2, surface.stopped());
        }
        else
            while (!surface.had_room(counted_points(surface))) look_for_points(memory, scene, now);
    };
    if constexpr (finds_candidates_along<Backend>) {
        surface.note_candidates_of(grid.node_count(), grid.numbering());
        auto reactions = memory.backend.for_each_node(
            orders, grid, FindAndUpdate{update, candidates_phase(memory, scene, now)});
        if (surface.looks_at_candidates(is_first)) look_at_candidates(memory, scene, now);
        note_counts();
        return reactions;
    }
    else {
        look_for_points(memory, scene, now);
        note_counts();
        return memory.backend.for_each_node(orders, grid, update);
    }
}

/// Waits for the loops that look for points, and for none behind them. Returns how many points there are.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
std::uint32_t found_points(StepMemory<Backend, Sets, Transfer> const& memory,
                           StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                           StepContext<typename Sets::Space::Scalar, Actions> const* now)
{
    auto& surface = surface_memory(scene);
    for (;;) {
        SurfaceCounts const counts = counted_points(surface);
        if (surface.had_room(counts)) return surface.note(counts);
        look_for_points(memory, scene, now);
        surface.fetch_counts();
    }
}

/// Nodes that points of the step before reach take what they need from the grid. It is queued before the host
/// waits for points, so that a device does it in the meantime. Returns whether it is done for all nodes, if
/// there are no new points.
template <class Backend, class Sets, class Kernel, class Transfer>
bool begin_known_nodes(StepMemory<Backend, Sets, Transfer> const& memory,
                       StepScene<Backend, Sets, Kernel, Transfer> const& scene)
{
    using Number = typename Sets::Space::Scalar;
    constexpr int d = Sets::Space::dimension;
    auto& surface = surface_memory(scene);
    auto& grid = scene.grid_state.grid();
    if (!Backend::queues || !surface.have_nodes() || !surface.have_indices(grid.numbering())) return false;
    auto const nodes = grid.nodes_by_index();
    loop_in_step(memory, scene, surface.reached_at_most(),
                 BeginNodes<Number, d, std::remove_const_t<decltype(nodes)>>{
                     surface.view(), nodes, scene.smallest_node_mass, NodeSums<d, SumsOf<Transfer>>::mass,
                     NodeValues<d, ValuesOf<Transfer>>::velocity, false});
    return true;
}

/// A step that has points of surfaces.
template <class Number, class Actions>
struct StepWithPoints
{
    StepContext<Number, Actions> const* now;
    StepContext<Number, Actions> const* before; ///< the step before in the batch; null in the first one
    std::uint32_t points;                       ///< that have been found
};

/// The nodes that points of surfaces may reach.
template <class Nodes>
struct NodesInReach
{
    Nodes by_index;
    std::size_t count;
    std::uint64_t numbering; ///< of their indices
    bool have_begun = false; ///< see begin_known_nodes()
};
template <class Nodes>
NodesInReach(Nodes, std::size_t, std::uint64_t) -> NodesInReach<Nodes>;
template <class Nodes>
NodesInReach(Nodes, std::size_t, std::uint64_t, bool) -> NodesInReach<Nodes>;

/// Finds the impulses at the points of a step, and the velocities that nodes get from them. `share(most)` is
/// called when it is known which nodes points reach, at most so many, and before it is asked what these have.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions, class Nodes, class Share>
void find_impulses(StepMemory<Backend, Sets, Transfer> const& memory,
                   StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                   StepWithPoints<typename Sets::Space::Scalar, Actions> const& step,
                   NodesInReach<Nodes> const& in_reach, Share const& share)
{
    using Number = typename Sets::Space::Scalar;
    auto const* const before = step.before;
    std::uint32_t const points = step.points;
    auto const& by_index = in_reach.by_index;
    constexpr int d = Sets::Space::dimension;
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    using Loop = PointLoop<Kernel, Number, d>;
    auto const& backend = memory.backend;
    auto& surface = surface_memory(scene);
    double const seconds = scene.time_state.now.interval.length(); // of the first step of the batch
    bool const is_far = surface.largest_speed() * seconds > moves_far * memory.lattice.cell_size;
    int const sweeps = !surface.goes_on() ? sweeps_from_nothing
                       : is_far           ? sweeps_that_follow
                                          : sweeps_that_go_on;
    auto const length = static_cast<Number>(seconds),
               cell_size = static_cast<Number>(memory.lattice.cell_size);
    Lengths<Number> const lengths{before == nullptr ? nullptr : &step.now->dt,
                                  before == nullptr ? nullptr : &before->dt, length / surface.dt_before()};
    auto const run = [&](std::size_t count, auto const& body) { loop_in_step(memory, scene, count, body); };
    // a device has as many parts of a loop at once as it can have
    constexpr int rows_of_part = Backend::reaches_host_memory ? Loop::Cell::rows : 1;
    using Rows = RowLoop<Kernel, Number, d, rows_of_part>;
    constexpr auto nodes_of_each = std::size_t(Loop::nodes_of_each);
    // those without nodes are new, and where the grid has other nodes all may miss one that is there now
    std::size_t const first_without = surface.have_nodes() ? surface.first_new() : 0,
                      first = surface.have_indices(in_reach.numbering) ? first_without : 0,
                      most_new = std::min(in_reach.count, (points - first) * nodes_of_each);
    bool const may_change = points > first;
    if (may_change) {
        if (first == 0) run(surface.reached_before(), ForgetIndices<Number, d>{surface.view()});
        if (first_without == 0) surface.forget_nodes();
        surface.make_room(points, nodes_of_each, most_new, in_reach.count, in_reach.numbering);
    }
    Loop const loop{surface.view()};
    Rows const rows{loop, points};
    using FindNodes = FindNodesOfPoints<Kernel, Transfer, Number, d, rows_of_part, Nodes>;
    if (may_change && first == 0)
        run(surface.reached_before(), FindIndices<Number, d, Nodes>{loop.of, by_index});
    bool const may_move = surface.may_move();
    if (may_change || may_move)
        run(FindNodes::count(points, may_move ? 0 : first),
            FindNodes{rows, by_index, may_move ? 0 : first, first_without, may_move, first == 0});
    std::size_t const nodes =
        before == nullptr ? surface.most_reached(may_change ? most_new : 0) : surface.reached_at_most();
    share(nodes);
    if (may_change || !in_reach.have_begun)
        run(nodes, BeginNodes<Number, d, Nodes>{loop.of, by_index, scene.smallest_node_mass, Sums::mass,
                                                Values::velocity, may_change});
    run(points, BeginPoints<Kernel, Number, d>{loop, lengths, surface.first_new(), first_without, may_move,
                                               may_change});
    // mostly few points are listed: parts of a plane each, which only look whether there is anything to do
    constexpr int listed_at_once = Backend::reaches_host_memory ? Loop::Cell::rows : Loop::Cell::width;
    using Listed = RowLoop<Kernel, Number, d, listed_at_once>;
    run(Listed::count(points), ListPoints<Kernel, Number, d, listed_at_once>{Listed{loop, points}});
    if (may_change) run(nodes, SortPoints<Kernel, Number, d>{loop});
    GatherImpulses<Kernel, Number, d, Nodes> gather{loop, by_index, Values::velocity};
    run(nodes, gather);
    SweepPoints<Kernel, Number, d> sweep{loop, cell_size};
    double weight = 1;
    for (int i = 1; i <= sweeps; ++i) {
        double const next = (1 + std::sqrt(1 + 4 * weight * weight)) / 2;
        sweep.is_first = i == 1;
        gather.is_last = i == sweeps;
        sweep.ahead = gather.is_last ? Number(0) : static_cast<Number>((weight - 1) / next);
        if (gather.is_last && detail::is_first_rank(backend)) // all ranks have all impulses
            run(points, SweepAndBook<Kernel, Number, d, StepContext<Number, Actions>>{sweep, {step.now}});
        else
            run(points, sweep);
        run(nodes, gather);
        weight = next;
    }
}

/// Lets these obstacles act on nodes that have been updated, at the points that find_points_and_update()
/// found. `before` is the step before in the batch; null in the first one.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
void act_at_surfaces(StepMemory<Backend, Sets, Transfer> const& memory,
                     StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                     StepContext<typename Sets::Space::Scalar, Actions> const* now,
                     StepContext<typename Sets::Space::Scalar, Actions> const* before)
{
    auto& surface = surface_memory(scene);
    [[maybe_unused]] bool have_begun = false;
    if constexpr (!spans_ranks<Backend>) have_begun = begin_known_nodes(memory, scene);
    std::uint32_t const points = before == nullptr ? found_points(memory, scene, now) : surface.known();
    if (points > 0) {
        auto& grid = scene.grid_state.grid();
        constexpr int d = Sets::Space::dimension;
        using Values = NodeValues<d, ValuesOf<Transfer>>;
        [[maybe_unused]] constexpr int mass = NodeSums<d, SumsOf<Transfer>>::mass,
                                       velocity = Values::velocity;
        [[maybe_unused]] auto const& backend = memory.backend;
        [[maybe_unused]] auto const share_nothing = [](std::size_t) {};
        StepWithPoints<typename Sets::Space::Scalar, Actions> const step{now, before, points};
        if constexpr (spans_devices<Backend>) {
            auto& nodes = surface.nodes_of_ranks;
            find_impulses(
                memory, scene, step, NodesInReach{nodes.nodes(grid), grid.node_count(), grid.numbering()},
                [&](std::size_t most) { nodes.share(backend, grid, surface.view(), most, mass, velocity); });
        }
        else if constexpr (spans_ranks<Backend>) {
            auto& nodes = detail::share_nodes_at_surface<Kernel>(backend, grid, surface, points,
                                                                 memory.lattice, mass, velocity);
            find_impulses(memory, scene, step,
                          NodesInReach{nodes.list.nodes(velocity), nodes.list.size(), nodes.list.numbering()},
                          share_nothing);
            nodes.return_values(backend, grid, velocity, d, scene.smallest_node_mass);
        }
        else
            find_impulses(
                memory, scene, step,
                NodesInReach{grid.nodes_by_index(), grid.node_count(), grid.numbering(), have_begun},
                share_nothing);
    }
    surface.end_step(points);
}

} // namespace firn

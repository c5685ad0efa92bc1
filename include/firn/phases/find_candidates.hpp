// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/effects/chain.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/phases/scatter.hpp>
#include <firn/phases/step_context.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace firn
{

/// Calls `use(action, first)` for each action of the chain that acts at surfaces. Their obstacles are
/// numbered through, those of this one from `first` on.
template <class... Actions, class Use>
FIRN_HOST_DEVICE void for_each_at_surface(Chain<Actions...> const& chain, Use const& use)
{
    std::uint32_t first = 0;
    chain.for_each([&](auto const& action) {
        if constexpr (is_group_at_surface<std::decay_t<decltype(action)>>) {
            use(action, first);
            first += action.sums.obstacles;
        }
    });
}

/// Calls `use(action, i)` for the one of them that has an obstacle, whose number is `i` there.
template <class... Actions, class Use>
FIRN_HOST_DEVICE void with_surface_action(Chain<Actions...> const& chain, std::uint32_t obstacle,
                                          Use const& use)
{
    for_each_at_surface(chain, [&](auto const& action, std::uint32_t first) {
        if (obstacle - first < action.sums.obstacles) use(action, obstacle - first); // wraps if it is before
    });
}

/// Calls `use(number, obstacle)` for each of them, but thin shells, that may be as near as this [m] to lanes
/// of places.
template <class... Actions, Lane Real, int d, class Use>
FIRN_HOST_DEVICE void for_each_solid_at_surface(Chain<Actions...> const& chain,
                                                LanePosition<Real, d> const& place, Real distance,
                                                Use const& use)
{
    for_each_at_surface(chain, [&](auto const& action, std::uint32_t first) {
        action.for_each_within(place, distance, [&](std::uint32_t i, auto const& obstacle) {
            if (!obstacle.is_thin(place.lattice)) use(first + i, obstacle);
        });
    });
}

/// On nodes, before they are updated: finds those at which points of obstacles' surfaces may lie, since they
/// have mass and are near a surface, or that lie deep inside.
template <class Space, class Kernel, class Transfer, class Effects>
struct FindCandidates
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    static constexpr bool looks_around = false, keeps_values = true, says_which_concern = true,
                          takes_zero_sums = true; // where it finds ahead
    using Result = NothingFound;

    StepContext<Number, Effects> const* now;
    Lattice lattice;
    Number smallest_mass; ///< see UpdateGrid
    SurfacePoints<Number, d> found;
    /// Nodes that have no mass as yet are candidates, too, so that their points are known before material
    /// comes: else a device would wait for the host in each step in which it comes to another node.
    bool finds_ahead;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Mask<Real> const filled = node.sum(Sums::mass) > Real(smallest_mass);
        if (!any(filled) && !finds_ahead) return;
        if constexpr (HasIndex<Node>) {
            if (found.of_nodes != nullptr) {
                CandidatesOfNode& of_node = found.of_nodes[node.index()];
                CandidatesOfNode const noted = of_node;
                if (noted.noted[0] == not_noted)
                    of_node = find(node, filled);
                else if (any(filled))
                    for (std::uint32_t const one : noted.noted)
                        if (one != no_candidate) found.seen[one - first_candidate] = found.step;
                return;
            }
        }
        find(node, filled);
    }

    /// Whether any of these nodes is near an obstacle. The sums of others need not be added up.
    template <Lane Real>
    FIRN_HOST_DEVICE bool concerns(Coordinates<d> const& first, Vector<Real, d> const& offset) const
    {
        bool is_near = false;
        for_each_near(place_of<Real>(first, offset), [&](std::uint32_t, auto const&) { is_near = true; });
        return is_near;
    }

private:
    /// See CandidatesOfNode.
    static constexpr std::uint32_t not_noted = 0, no_candidate = 1, first_candidate = 2;
    static constexpr std::uint32_t never = 0; ///< no step has this number

    /// Finds the candidates that nodes are. Returns what is to be noted of a single node.
    template <class Node, class Filled>
    FIRN_HOST_DEVICE CandidatesOfNode find(Node& node, Filled const& filled) const
    {
        using Real = typename Node::Real;
        CandidatesOfNode of_node{{no_candidate, no_candidate}};
        bool is_noted = true;
        LanePosition<Real, d> const place = place_of<Real>(node.first(), node.offset());
        auto const in_cells = [&](double cells) {
            return Real(static_cast<Number>(cells * lattice.cell_size));
        };
        for_each_near(place, [&](std::uint32_t i, auto const& obstacle) {
            auto const at = obstacle.template surface_at<Real>(place, zeros<Vector<Real, d>>());
            auto const is_deep = -at.distance > deep_from<Real>(obstacle, place, at.normal),
                       is_near = abs(at.distance) * largest_component<Real, d>(at.normal) <=
                                 in_cells(nearly_half_a_cell);
            auto which = filled & (is_deep | is_near);
            if (finds_ahead) {
                auto const may_fill = -at.distance <= depth_of_reach<Real>(place, at.normal);
                which = which | is_near | (is_deep & may_fill);
                is_noted = is_noted && !any(is_deep & !which); // what comes there is inside, which is rare
            }
            if (!any(which)) return;
            std::uint32_t const number = add<Real>(place, i, which, filled);
            // those that are new get their numbers for good when the step has been taken
            is_noted = is_noted && number != KnownCandidates<d>::absent && of_node.noted[1] == no_candidate;
            of_node.noted[of_node.noted[0] == no_candidate ? 0 : 1] = first_candidate + number;
        });
        return is_noted ? of_node : CandidatesOfNode{};
    }

public:
    /// From which depth on [m] nodes are held: whatever sticks holds all that is inside. Others let
    /// particles lie a tenth of a cell inside before nodes that only these reach slow them down; across the
    /// cells kernels reach deeper. Thin shells have no inside.
    template <Lane Real>
    FIRN_HOST_DEVICE static Real deep_from(auto const& obstacle, LanePosition<Real, d> const& place,
                                           Vector<Real, d> const& normal)
    {
        if (obstacle.is_thin(place.lattice)) return Real(static_cast<Number>(1e9 * place.lattice.cell_size));
        return obstacle.contact.sticks ? Real(0) : depth_of_reach<Real>(place, normal);
    }
    /// How deep inside nodes are [m] that particles reach which lie outside, or inside by a tenth of a cell.
    template <Lane Real>
    FIRN_HOST_DEVICE static Real depth_of_reach(LanePosition<Real, d> const& place,
                                                Vector<Real, d> const& normal)
    {
        auto const in_cells = [&](double cells) {
            return Real(static_cast<Number>(cells * place.lattice.cell_size));
        };
        Real across(0);
        for (int a = 0; a < d; ++a) across += abs(normal[a]);
        return across * in_cells(place.kernel_reach) + in_cells(0.1);
    }
    static constexpr double nearly_half_a_cell = 0.52;

private:
    template <class Real>
    FIRN_HOST_DEVICE LanePosition<Real, d> place_of(Coordinates<d> const& first,
                                                    Vector<Real, d> const& offset) const
    {
        return {lattice, first, offset, kernel_reach(Kernel::degree)};
    }

    /// Calls `use(number, obstacle)` for each that is so near that a point of it may belong to one of the
    /// nodes: it lies at most half the diagonal of a cell from its node.
    template <class Real, class Use>
    FIRN_HOST_DEVICE void for_each_near(LanePosition<Real, d> const& place, Use const& use) const
    {
        for_each_at_surface(now->actions, [&](auto const& action, std::uint32_t first) {
            action.for_each_within(place, Real(static_cast<Number>(lattice.cell_size)),
                                   [&](std::uint32_t i, auto const& obstacle) { use(first + i, obstacle); });
        });
    }

    /// Adds nodes as candidates; those that are `filled` are seen. Returns the number of the last one if it
    /// was known before.
    template <class Real>
    FIRN_HOST_DEVICE std::uint32_t add(LanePosition<Real, d> const& place, std::uint32_t obstacle,
                                       Mask<Real> const& which, Mask<Real> const& filled) const
    {
        std::uint32_t last = KnownCandidates<d>::absent;
        constexpr int width = lane_width<Real>;
        Number along[std::size_t(d)][std::size_t(width)];
        for (int a = 0; a < d; ++a) LaneTraits<Real>::store(place.offset[a], along[a]);
        std::uint64_t const seen = bits(filled);
        for_each_lane<width>(bits(which), [&](int lane) {
            SurfaceCandidate<d> candidate;
            for (int a = 0; a < d; ++a) candidate.node[a] = place.first[a] + static_cast<int>(along[a][lane]);
            candidate.obstacle = obstacle;
            std::uint32_t number = last = found.known.find(candidate);
            if (number == KnownCandidates<d>::absent) {
                number = found.known.count + next_number_of_all(*found.new_candidates);
                if (number >= found.candidates_room) return; // the host makes room, and looks again
                found.candidates[number] = candidate;
                found.seen[number] = never;
            }
            if ((seen >> lane & 1) != 0) found.seen[number] = found.step;
        });
        return last;
    }
};

/// The same in the loop that updates nodes, so that their masses are added up once for both.
template <class Update, class Find>
struct FindAndUpdate : Update
{
    static constexpr bool takes_zero_sums = Find::takes_zero_sums;

    Find find;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, typename Update::Result& reactions) const
    {
        bool const has_mass = node.sum(Find::Sums::mass) > 0;
        typename Find::Result nothing;
        if (has_mass || find.finds_ahead) find(node, nothing);
        if (has_mass) Update::operator()(node, reactions);
    }
};
template <class Update, class Find>
FindAndUpdate(Update, Find) -> FindAndUpdate<Update, Find>;

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/broad_phase.hpp>
#include <firn/effects/groups.hpp>
#include <firn/effects/obstacle.hpp>
#include <firn/effects/reaction_sums.hpp>
#include <firn/effects/shapes/any_shape.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

template <class ShapeType>
struct PlainObstacles;
template <class Backend, class ShapeType, class Number, int d>
class StagedObstacles;

/// The world in which an obstacle acts alone.
struct OwnWorld
{
    std::array<int, 3> centre{}; ///< the cell that is its (0, 0, 0): see WorldLayout
    double begun = 0;            ///< when its own time was 0 [s]
};

/// Any number of obstacles, one argument of a call. They act one after the other as if each were an argument
/// of its own, and the report has one reaction for each, in their order. Obstacles may be added, changed and
/// removed between calls:
///
///     firn::Obstacles<> scene;
///     scene.list.push_back({.shape = firn::Box{{1, 0.1, 1}}, .contact = firn::Contact::coulomb(0.3)});
///     scene.list.push_back({.shape = firn::Sphere{0.2}, .motion = {.position = {0, 1, 0}}});
///     auto const report = solver.advance(frame, firn::Gravity{}, scene);
///
/// Nodes meet only those that are near: obstacles are sorted into cubes of some cells when a call begins,
/// by what they sweep during it. Shapes of your own are named in the type, Obstacles<AnyShape<Pillar>>, or
/// all are of one type, Obstacles<Sphere>. Obstacles that act on particles, and so shells, are arguments of
/// their own.
///
/// On a backend that queues steps the host waits for each step of a call with such obstacles.
template <class ShapeType = AnyShape<>>
struct Obstacles
{
    static_assert(!is_two_sided<ShapeType>,
                  "a Shell acts on particles, which Obstacles do not: pass it as an Obstacle of its own");

    std::vector<Obstacle<ShapeType>> list{};
    /// For each the world where it is; empty: they are in all worlds. Worlds sets this.
    std::vector<OwnWorld> own_worlds{};

    /// Throws an Error unless each of them makes sense; the error says which one does not.
    void validate() const
    {
        require(list.size() < std::numeric_limits<std::uint32_t>::max() / 32, "there are too many obstacles",
                "Obstacles", "Pass fewer than 1e8.");
        require(own_worlds.empty() || own_worlds.size() == list.size(), "there is not one world per obstacle",
                "Obstacles", "Leave own_worlds empty: Worlds sets them.");
        for_each([](auto const& obstacle) {
            obstacle.validate();
            require(!obstacle.on_particles, "it acts on particles, which Obstacles do not", "Obstacle",
                    "Pass it as an argument of its own.");
        });
    }
    /// Throws an Error if one of them leaves the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        for_each([](auto const& obstacle) { obstacle.validate_in_plane(); });
    }

    /// A bound on the speed of their surfaces [m/s]: see Obstacle.
    double largest_speed(int dimension) const
    {
        double largest = 0;
        for (auto const& obstacle : list) largest = std::max(largest, obstacle.largest_speed(dimension));
        return largest;
    }

    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    /// The memory of a call's obstacles: see Groups.
    template <class Backend, class Number, int d>
    using Staged = StagedObstacles<Backend, ShapeType, Number, d>;

    /// What steps know, without the obstacles, which Staged adds.
    PlainObstacles<detail::Plain<ShapeType>> plain() const { return {}; }

private:
    template <class Use>
    void for_each(Use const& use) const
    {
        for (std::size_t i = 0; i < list.size(); ++i) {
            try {
                use(list[i]);
            }
            catch (Error const& error) {
                throw Error{error.what_is_wrong(),
                            error.where() + ", number " + std::to_string(i) + " of Obstacles",
                            error.remedy()};
            }
        }
    }
};

namespace detail
{
/// The reach of obstacles is kept in single precision, and distances are rounded: a thousandth more is
/// searched.
inline constexpr double with_rounding = 1.001;
} // namespace detail

/// The action of many obstacles: what it gives to nodes is asked of each that is near.
template <class ShapeType, class Number, int d>
struct ObstaclesAction
{
    static constexpr bool is_group = true;
    static constexpr bool looks_up = is_sampled<ShapeType>;

    using One = typename Obstacle<ShapeType>::template Action<Number, d>;

    One const* obstacles; ///< at the end of the step
    float const* reach;   ///< of each [m]; 0: unbounded
    NearObstacles<d> near;
    bool have_own_worlds; ///< else they are in the same place in all worlds
    ReactionSums sums;

    /// Calls `use(action, receive)` for each obstacle that may touch lanes at a place; `receive(reaction)`
    /// adds to what it received.
    template <Lane Real, class Use>
    FIRN_HOST_DEVICE void for_each_near(LanePosition<Real, d> const& place, Use const& use) const
    {
        if (sums.obstacles == 0) return;
        Coordinates<d> cell = place.first;
        for (int a = 0; a < d; ++a) cell[a] = have_own_worlds ? cell[a] : place.lattice.in_world(cell[a]);
        near.for_each(cell, [&](std::uint32_t i) {
            if (is_far(place, i)) return;
            use(obstacles[i], [&](Reaction const& received) {
                std::uint32_t slot = 0;
                for (int a = 0; a < d; ++a) slot = 7 * slot + static_cast<std::uint32_t>(place.first[a]);
                sums.add(i, slot, received);
            });
        });
    }

private:
    /// Whether an obstacle is too far from all lanes to touch one of them.
    template <Lane Real>
    FIRN_HOST_DEVICE bool is_far(LanePosition<Real, d> const& place, std::uint32_t i) const
    {
        if (!(reach[i] > 0)) return false;
        Vector<Real, d> const away = place.relative_to(obstacles[i].position);
        Real const furthest(static_cast<Number>(reach[i] * float(detail::with_rounding)));
        return !any(dot<Real, d>(away, away) <= furthest * furthest);
    }
};

/// Places obstacles where they are at the end of a step.
template <class ShapeType, class Number, int d>
struct PlaceObstacles
{
    Obstacle<ShapeType> const* from;
    typename Obstacle<ShapeType>::template Action<Number, d>* to;
    Interval interval;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        to[place] = from[place].template over<Number, d>(interval);
    }
};

/// Obstacles as steps know them: a plain value.
template <class ShapeType>
struct PlainObstacles
{
    static constexpr bool is_group = true;

    void const* placed = nullptr; ///< their actions, of the scene's numbers and dimensions
    float const* reach = nullptr;
    NearObstacles<2> near_in_plane{};
    NearObstacles<3> near_in_space{};
    bool have_own_worlds = false;
    ReactionSums sums{};

    template <class Number, int d>
    FIRN_HOST_DEVICE ObstaclesAction<ShapeType, Number, d> over(Interval const&) const
    {
        auto const* const of_scene =
            static_cast<typename ObstaclesAction<ShapeType, Number, d>::One const*>(placed);
        if constexpr (d == 2)
            return {of_scene, reach, near_in_plane, have_own_worlds, sums};
        else
            return {of_scene, reach, near_in_space, have_own_worlds, sums};
    }
};

/// The memory in which a backend's loops find the obstacles of a call, kept for later calls.
template <class Backend, class ShapeType, class Number, int d>
class StagedObstacles : public GroupMemory
{
    using Plain = detail::Plain<ShapeType>;
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    explicit StagedObstacles(Backend const& backend)
        : backend_(backend), obstacles_(backend), placed_(backend), reach_(backend), table_(backend),
          lists_(backend), boxes_there_(backend), sums_(backend)
    {}

    /// Stores the obstacles of a call that takes a time [s] from `begin` on, and writes the addresses into
    /// the effect's plain value `to`.
    void stage(Obstacles<ShapeType> const& from, Lattice const& lattice, double begin, double duration,
               PlainObstacles<Plain>& to)
    {
        std::vector<Obstacle<Plain>> plain;
        std::vector<float> reach;
        std::vector<SweptBox<d>> boxes;
        for (std::size_t i = 0; i < from.list.size(); ++i) {
            auto const& obstacle = from.list[i];
            plain.push_back(obstacle.plain(begin));
            reach.push_back(static_cast<float>(detail::reach_of(obstacle.shape, d)));
            Motion& motion = plain.back().motion;
            if (!from.own_worlds.empty() && obstacle.motion.time) *motion.time += from.own_worlds[i].begun;
            boxes.push_back(box_of(motion, double(reach.back()), lattice, begin, begin + duration));
            for (std::size_t a = 0; a < std::size_t(d); ++a) // its images, too: wherever they may be
                if (int const period = lattice.periods[a]; period != 0 && boxes.back().is_bounded)
                    boxes.back().low[a] = -furthest_before, boxes.back().high[a] = period;
            if (!from.own_worlds.empty()) keep_in(from.own_worlds[i], lattice.half_world, boxes.back());
        }
        store(obstacles_, plain);
        store(reach_, reach);
        if (!is_sorted_ || boxes != boxes_) {
            is_sorted_ = false;
            BroadPhase<d> const sorted(boxes);
            store(table_, sorted.table);
            store(lists_, sorted.lists);
            store(boxes_there_, boxes);
            near_ = {table_.data(),     static_cast<std::uint32_t>(sorted.table.size() - 1),
                     lists_.data(),     boxes_there_.data(),
                     sorted.everywhere, sorted.shift};
            boxes_ = std::move(boxes);
            is_sorted_ = true;
        }
        placed_.resize(std::max<std::size_t>(plain.size(), 1));
        to.placed = placed_.data();
        to.reach = reach_.data();
        if constexpr (d == 2)
            to.near_in_plane = near_;
        else
            to.near_in_space = near_;
        to.have_own_worlds = !from.own_worlds.empty();
        to.sums.obstacles = static_cast<std::uint32_t>(plain.size());
        to.sums.slots = ReactionSums::slots_of(plain.size());
        sums_.resize(std::max<std::size_t>(to.sums.size(), 1));
        to.sums.memory = sums_.data();
        of_step_ = to.sums;
    }

    void begin(Interval const& interval) override
    {
        if (of_step_.obstacles == 0) return;
        backend_.for_each(of_step_.obstacles,
                          PlaceObstacles<Plain, Number, d>{obstacles_.data(), placed_.data(), interval});
        backend_.for_each(of_step_.size(), ClearReactionSums{of_step_.memory});
    }

    void append(std::vector<Reaction>& to, double factor) override
    {
        if (of_step_.obstacles == 0) return;
        std::int64_t const* const copy = sums_.read();
        for (std::uint32_t i = 0; i < of_step_.obstacles; ++i) to.push_back(of_step_.of(i, copy) * factor);
    }

private:
    template <class T>
    void store(Array<T>& to, std::vector<T> const& values)
    {
        to.resize(std::max<std::size_t>(values.size(), 1)); // so that it has an address
        to.upload(0, values);
    }

    /// The cells where a lane of nodes may begin if one of its nodes is to touch the obstacle.
    static SweptBox<d> box_of(Motion const& motion, double reach, Lattice const& lattice, double begin,
                              double end)
    {
        SweptBox<d> box;
        if (!(reach > 0)) return box;
        box.is_bounded = true;
        Eigen::Vector3d const from = motion.at(begin).position, to = motion.at(end).position;
        auto const cell = [&](int a, double x) {
            constexpr double furthest = 0x1p30;
            double const c = std::floor((x - lattice.origin[a]) / lattice.cell_size);
            return static_cast<int>(std::min(std::max(c, -furthest), furthest));
        };
        // lanes are a row along the last axis; images in a wall lie up to 2 cells beside it
        int const row = lane_width<typename Backend::template Lane<float>> - 1;
        for (int a = 0; a < d; ++a) {
            bool const is_along = a == d - 1;
            box.low[std::size_t(a)] =
                cell(a, std::min(from[a], to[a]) - detail::with_rounding * reach) - (is_along ? row + 2 : 0);
            box.high[std::size_t(a)] =
                cell(a, std::max(from[a], to[a]) + detail::with_rounding * reach) + (is_along ? 3 : 1);
        }
        return box;
    }

    static constexpr int furthest_before = 8; ///< the first node of a period lies less than this before it

    /// The part of a box that lies in a world, in cells of the lattice.
    static void keep_in(OwnWorld const& world, int half, SweptBox<d>& box)
    {
        for (std::size_t a = 0; a < std::size_t(d); ++a) {
            int const low = box.is_bounded ? std::max(box.low[a], -half) : -half,
                      high = box.is_bounded ? std::min(box.high[a], half - 1) : half - 1;
            box.low[a] = world.centre[a] + low;
            box.high[a] = world.centre[a] + high;
        }
        box.is_bounded = true;
    }

    Backend backend_;
    Array<Obstacle<Plain>> obstacles_;
    Array<typename ObstaclesAction<Plain, Number, d>::One> placed_; ///< at the end of a step
    Array<float> reach_;
    Array<ListOfCube<d>> table_;
    Array<std::uint32_t> lists_;
    Array<SweptBox<d>> boxes_there_;
    typename Backend::template ReadbackBuffer<std::int64_t> sums_;
    std::vector<SweptBox<d>> boxes_; ///< for which the lists are
    bool is_sorted_ = false;
    NearObstacles<d> near_{};
    ReactionSums of_step_{};
};

} // namespace firn

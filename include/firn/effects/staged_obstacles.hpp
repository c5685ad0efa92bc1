// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/broad_phase.hpp>
#include <firn/effects/groups.hpp>
#include <firn/effects/obstacle.hpp>
#include <firn/effects/obstacles_action.hpp>
#include <firn/effects/reaction_sums.hpp>
#include <firn/effects/surface_memory.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

// The memory of any number of obstacles: see Obstacles.
namespace firn
{

template <class ShapeType, ActsOn acts_on>
struct Obstacles;

/// The world in which an obstacle acts alone.
struct OwnWorld
{
    std::array<int, 3> centre{}; ///< the cell that is its (0, 0, 0): see WorldLayout
    double begun = 0;            ///< when its own time was 0 [s]
};

/// Places obstacles where they are at the end of a step, and says where what they receive is added. Each
/// obstacle has a place in the loop, and one for each of its integers in the sums, which are cleared there:
/// on a device obstacles then lie in different groups of lanes, and wait for memory at the same time.
template <class ShapeType, class Number, int d>
struct PlaceObstacles
{
    Obstacle<ShapeType> const* from;
    typename Obstacle<ShapeType>::template Action<Number, d>* to;
    BegunStep step;
    ReactionSums sums;
    std::uint32_t part, *part_of_step;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        if (step.taken != nullptr && *step.taken == 0) return;
        std::size_t const of_each = places_of_each(sums), i = place / of_each, k = place % of_each;
        if (k > 0)
            sums.clear(place - i - 1, part);
        else
            to[i] = from[i].template over<Number, d>(*step.interval);
        if (place > 0) return;
        *part_of_step = part;
        sums.clear(sums.sums(), part);
    }

    /// How many places of the loop an obstacle has.
    FIRN_HOST_DEVICE static std::size_t places_of_each(ReactionSums const& sums)
    {
        return 1 + std::size_t(sums.slots) * ReactionSums::numbers * ReactionSums::words;
    }
};

/// Adds up what obstacles received in each step of a batch.
struct AddUpReactions
{
    ReactionSums sums;
    Reaction* to; ///< step by step

    /// For each number of each reaction.
    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        int const i = static_cast<int>(place % ReactionSums::numbers);
        std::size_t const reaction = place / ReactionSums::numbers;
        double const number =
            sums.number(i, static_cast<std::uint32_t>(reaction % sums.obstacles), reaction / sums.obstacles);
        (i < 3 ? to[reaction].impulse[i] : to[reaction].angular_impulse[i - 3]) = number;
    }
};

namespace detail
{
/// The lists of obstacles by their boxes, in memory where loops read them; sorted anew only if the boxes
/// changed.
template <class Backend, int d>
class SortedBoxes
{
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    /// For places whose blocks begin `before` cells before those of cells.
    SortedBoxes(Backend const& backend, int before) : table_(backend), lists_(backend), before_(before) {}

    NearObstacles<d> const& sort(std::vector<SweptBox<d>> boxes)
    {
        if (is_sorted_ && boxes == boxes_) return near_;
        is_sorted_ = false;
        BroadPhase<d> const sorted(boxes, before_);
        store(table_, sorted.table);
        store(lists_, sorted.lists);
        near_ = {table_.data(), static_cast<std::uint32_t>(sorted.table.size() - 1),
                 lists_.data(), sorted.everywhere,
                 sorted.shift,  before_};
        boxes_ = std::move(boxes);
        is_sorted_ = true;
        return near_;
    }

    template <class T>
    static void store(Array<T>& to, std::vector<T> const& values)
    {
        to.resize(std::max<std::size_t>(values.size(), 1)); // so that it has an address
        to.upload(0, values);
    }

private:
    Array<ListOfCube<d>> table_;
    Array<ListedObstacle<d>> lists_;
    int before_;
    std::vector<SweptBox<d>> boxes_; ///< for which the lists are
    bool is_sorted_ = false;
    NearObstacles<d> near_{};
};
} // namespace detail

/// The memory in which a backend's loops find the obstacles of a call, kept for later calls.
template <class Backend, class ShapeType, ActsOn acts_on, class Number, int d>
class StagedObstacles : public GroupMemory<Backend, Number, d>
{
    using Plain = detail::Plain<ShapeType>;
    using Action = ObstaclesAction<Plain, acts_on, Number, d>;
    using Sorted = detail::SortedBoxes<Backend, d>;
    template <class T>
    using Array = typename Backend::template Array<T>;
    /// How many steps a batch has room for at most, and how many bytes the sums may take for more than one.
    static constexpr std::size_t most_steps_of_batch = Backend::queues ? 64 : 1;
    static constexpr std::size_t most_bytes = std::size_t(16) << 20;

public:
    explicit StagedObstacles(Backend const& backend)
        : backend_(backend), obstacles_(backend), placed_(backend), to_nodes_(backend, 1),
          to_particles_(backend, 0), part_(backend), sums_(backend), received_(backend)
    {
        if constexpr (acts_at_surface(acts_on)) surface_.emplace(backend);
    }

    /// Stores the obstacles of a call that takes a time [s] from `begin` on, and writes the addresses into
    /// the effect's plain value `to`.
    void stage(Obstacles<ShapeType, acts_on> const& from, Lattice const& lattice, double begin,
               double duration, PlainObstacles<Plain, acts_on>& to)
    {
        std::vector<Obstacle<Plain>> plain;
        std::vector<SweptBox<d>> of_nodes, of_particles; // the second is empty if none acts on particles
        to.acting = 0;
        to.have_own_worlds = !from.own_worlds.empty();
        if (surface_)
            surface_->begin_call(from.list.size(), are_at_rest(from.list), from.largest_speed(d),
                                 numbers_in(from.own_worlds));
        for (std::size_t i = 0; i < from.list.size(); ++i) {
            auto const& obstacle = from.list[i];
            OwnWorld const* const world = to.have_own_worlds ? &from.own_worlds[i] : nullptr;
            plain.push_back(obstacle.plain(begin));
            if (world != nullptr && obstacle.motion.time) *plain.back().motion.time += world->begun;
            auto const reach = static_cast<float>(reach_of(obstacle.shape, lattice));
            auto const box = [&](Room const& room) {
                auto swept = box_of(plain.back().motion, reach, lattice, begin, begin + duration, room);
                include_images(lattice, swept);
                if (world == nullptr)
                    cut(obstacle, plain.back().motion, lattice, begin, begin + duration, room, swept);
                else
                    keep_in(*world, lattice.half_world, swept);
                return swept;
            };
            of_nodes.push_back(box(room_for_nodes()));
            if (!plain.back().on_particles) continue;
            ++to.acting;
            of_particles.resize(from.list.size(), SweptBox<d>::nowhere());
            of_particles[plain.size() - 1] = box(room_for_particles());
        }
        Sorted::store(obstacles_, plain);
        NearbyObstacles<d> const near{to_nodes_.sort(std::move(of_nodes)),
                                      to_particles_.sort(std::move(of_particles))};
        placed_.resize(std::max<std::size_t>(plain.size(), 1));
        part_.resize(1);
        to.placed = placed_.data();
        if constexpr (d == 2)
            to.near_in_plane = near;
        else
            to.near_in_space = near;
        to.sums.obstacles = static_cast<std::uint32_t>(plain.size());
        to.sums.slots = ReactionSums::slots_of(plain.size());
        std::size_t const size = std::max<std::size_t>(to.sums.size(), 1),
                          fit = most_bytes / (size * sizeof(std::int64_t));
        most_steps_ = static_cast<int>(std::clamp<std::size_t>(fit, 1, most_steps_of_batch));
        sums_.resize((std::size_t(most_steps_) + 1) * size); // the last part does not count
        to.sums.memory = sums_.data();
        to.sums.part = part_.data();
        of_call_ = to.sums;
    }

    SurfaceMemory<Backend, Number, d>* surface() override { return surface_ ? &*surface_ : nullptr; }

    std::size_t size() const override { return of_call_.obstacles; }

    int most_steps() const override
    {
        return surface_ ? std::min(most_steps_, surface_->most_steps()) : most_steps_;
    }

    void expect(int steps) override { received_.resize(std::size_t(steps) * of_call_.obstacles); }

    void begin(BegunStep const& step) override { place(step, step.number); }

    void begin_again(BegunStep const& step) override { place(step, most_steps_); }

    void do_not_count() override
    {
        sums_.fill(std::size_t(most_steps_) * of_call_.size(), of_call_.size(), 0);
        count(most_steps_);
    }
    void count(int step) override { part_.fill(0, 1, static_cast<std::uint32_t>(step)); }

    void add_ranks([[maybe_unused]] int step) override
    {
        if constexpr (spans_ranks<Backend>) {
            std::vector<std::int64_t> sums(of_call_.size());
            std::size_t const first = std::size_t(step) * sums.size();
            sums_.download(first, sums);
            auto const of_ranks = detail::of_all_ranks(backend_, sums);
            std::fill(sums.begin(), sums.end(), 0);
            for (std::size_t i = 0; i < of_ranks.size(); ++i) sums[i % sums.size()] += of_ranks[i];
            sums_.upload(first, sums);
        }
    }

    void add_up(int steps) override
    {
        backend_.for_each(std::size_t(steps) * of_call_.obstacles * ReactionSums::numbers,
                          AddUpReactions{of_call_, received_.data()});
        received_.fetch();
        if (surface_ && steps > 1) surface_->fetch_counts();
    }
    bool has_stopped() override { return surface_ && surface_->has_stopped(); }
    void end(int taken, bool failed, double dt) override
    {
        if (surface_) surface_->end_batch(taken, failed, dt);
        appended_ = 0;
    }

    void append(std::vector<Reaction>& to, double factor) override
    {
        if (of_call_.obstacles == 0) return;
        if (appended_ == 0) read_ = received_.read();
        for (std::uint32_t i = 0; i < of_call_.obstacles; ++i) to.push_back(read_[appended_++] * factor);
    }

private:
    /// How far from its reference point an obstacle acts [m]; 0 if it is unbounded. A thin shell acts on
    /// nodes within half a cell of its middle.
    static double reach_of(ShapeType const& shape, Lattice const& lattice)
    {
        double const reach = detail::reach_of(shape, d);
        return reach > 0 && is_two_sided<ShapeType> ? reach + 0.5 * lattice.cell_size : reach;
    }

    void place(BegunStep const& step, int part)
    {
        using Place = PlaceObstacles<Plain, Number, d>;
        backend_.for_each(of_call_.obstacles * Place::places_of_each(of_call_),
                          Place{obstacles_.data(), placed_.data(), step, of_call_,
                                static_cast<std::uint32_t>(part), part_.data()});
    }

    /// How many cells before an obstacle, and behind it, lanes may begin if one of them is to touch it:
    /// along all axes, and how many more along the last one.
    struct Room
    {
        int before, behind, before_along, behind_along;
    };
    static constexpr int lanes = lane_width<typename Backend::template Lane<float>>;
    /// Lanes are a row along the last axis; images in a wall lie up to 2 cells beside it.
    static Room room_for_nodes()
    {
        // a node's points, and what else is near these; packs of particles look there, too
        if constexpr (acts_at_surface(acts_on))
            return {lanes > 1 ? 3 + 7 : 3, 4, lanes - 1 + 2, 2};
        else
            return {0, 1, lanes - 1 + 2, 2};
    }
    /// Lanes are of cells that lie as far from the first as the backend's loops may tell, see
    /// firn/backend.hpp; particles are up to a cell away from the centres of these, and then move.
    static Room room_for_particles()
    {
        int const moves = 1 + static_cast<int>(Action::reach_of_particles);
        return {moves + 7, moves, std::max(lanes - 8, 0), 0};
    }

    /// The cells where a lane may begin if one of its nodes or particles is to touch the obstacle.
    static SweptBox<d> box_of(Motion const& motion, float reach, Lattice const& lattice, double begin,
                              double end, Room const& room)
    {
        SweptBox<d> box;
        if (!(reach > 0)) return box;
        box.is_bounded = true;
        box.reach = reach;
        Eigen::Vector3d const from = motion.at(begin).position, to = motion.at(end).position;
        auto const cell = [&](int a, double x) {
            constexpr double furthest = 0x1p30;
            double const c = std::floor((x - lattice.origin[a]) / lattice.cell_size);
            return static_cast<int>(std::min(std::max(c, -furthest), furthest));
        };
        for (int a = 0; a < d; ++a) {
            int const along = a == d - 1 ? 1 : 0;
            box.low[std::size_t(a)] =
                cell(a, std::min(from[a], to[a]) - detail::with_rounding * double(reach)) - room.before -
                along * room.before_along;
            box.high[std::size_t(a)] =
                cell(a, std::max(from[a], to[a]) + detail::with_rounding * double(reach)) + room.behind +
                along * room.behind_along;
        }
        return box;
    }

    /// Cuts what is unbounded at the plane that it lies below, if it does not turn, and has no images.
    static void cut(Obstacle<ShapeType> const& obstacle, Motion const& motion, Lattice const& lattice,
                    double begin, double end, Room const& room, SweptBox<d>& box)
    {
        Eigen::Vector3d const side = detail::upper_side_of(obstacle.shape);
        if (box.is_bounded || !(norm(side) > 0) || norm(motion.angular_velocity) > 0 ||
            lattice.periods != std::array<int, 3>{})
            return;
        Eigen::Vector3d const normal = motion.rotation() * side, from = motion.at(begin).position,
                              to = motion.at(end).position;
        double at_begin = 0, at_end = 0, more = 1; // a cell more than lanes need, since all is rounded
        for (int a = 0; a < d; ++a) {
            int const along = a == d - 1 ? 1 : 0;
            at_begin += normal[a] * (from[a] - lattice.origin[a]) / lattice.cell_size;
            at_end += normal[a] * (to[a] - lattice.origin[a]) / lattice.cell_size;
            more += std::abs(normal[a]) * (std::max(room.before, room.behind) +
                                           along * std::max(room.before_along, room.behind_along));
            box.outward[std::size_t(a)] = normal[a];
        }
        box.furthest = std::max(at_begin, at_end) + more;
    }

    /// Along periodic axes images may be wherever there are cells, the first ones some before the origin.
    static void include_images(Lattice const& lattice, SweptBox<d>& box)
    {
        constexpr int most_before = 32;
        for (std::size_t a = 0; a < std::size_t(d); ++a)
            if (int const period = lattice.periods[a]; period != 0 && box.is_bounded)
                box.low[a] = -most_before, box.high[a] = period;
    }

    static bool are_at_rest(std::vector<Obstacle<ShapeType>> const& list)
    {
        return !is_deforming<Plain> && std::all_of(list.begin(), list.end(), [](auto const& obstacle) {
            return !(norm(obstacle.motion.velocity) > 0) && !(norm(obstacle.motion.angular_velocity) > 0);
        });
    }

    /// The number of each obstacle among those of its world, which follow one another.
    static std::vector<std::uint32_t> numbers_in(std::vector<OwnWorld> const& worlds)
    {
        std::vector<std::uint32_t> numbers(worlds.size());
        for (std::size_t i = 1; i < worlds.size(); ++i)
            if (worlds[i].centre == worlds[i - 1].centre) numbers[i] = numbers[i - 1] + 1;
        return numbers;
    }

    /// The part of a box that lies in a world, in cells of the lattice.
    static void keep_in(OwnWorld const& world, int half, SweptBox<d>& box)
    {
        for (std::size_t a = 0; a < std::size_t(d); ++a) {
            int const low = box.is_bounded ? std::max(box.low[a], -half) : -half,
                      high = box.is_bounded ? std::min(box.high[a], half - 1) : half - 1;
            if (low > high) { // it lies beyond the world
                box = SweptBox<d>::nowhere();
                return;
            }
            box.low[a] = world.centre[a] + low;
            box.high[a] = world.centre[a] + high;
        }
        box.is_bounded = true;
    }

    Backend backend_;
    Array<Obstacle<Plain>> obstacles_;
    Array<typename Action::One> placed_; ///< at the end of a step
    Sorted to_nodes_, to_particles_;
    Array<std::uint32_t> part_; ///< of the sums to which a step adds
    Array<std::int64_t> sums_;
    typename Backend::template ReadbackBuffer<Reaction> received_; ///< step by step
    Reaction const* read_ = nullptr;                               ///< the host's copy of it
    std::size_t appended_ = 0;                                     ///< of these, since the batch ended
    ReactionSums of_call_{};
    int most_steps_ = 1;
    std::optional<SurfaceMemory<Backend, Number, d>> surface_; ///< if they act there
};

} // namespace firn

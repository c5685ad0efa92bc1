// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/grid/world_layout.hpp>

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

namespace firn
{

/// The obstacles of each of many worlds, and what they received in the last call: see Worlds.
template <class ShapeType, ActsOn acts_on, int d>
class ObstaclesOfWorlds
{
public:
    /// Those of all worlds as one effect.
    using All = Obstacles<ShapeType, acts_on>;

    explicit ObstaclesOfWorlds(std::uint32_t worlds) : of_(worlds), reactions_(worlds) {}

    std::vector<Obstacle<ShapeType>>& of(std::uint32_t world) { return of_[world]; }
    std::vector<Reaction> const& reactions(std::uint32_t world) const { return reactions_[world]; }

    /// `begun` has the solver's time when that of each world was 0 [s]. Throws an Error that names the world
    /// of an obstacle that cannot be.
    All all(WorldLayout<d> const& layout, std::vector<double> const& begun) const
    {
        All together;
        for (std::uint32_t world = 0; world < of_.size(); ++world) {
            OwnWorld own{.begun = begun[world]};
            Coordinates<d> const centre = layout.centre(world);
            for (std::size_t a = 0; a < std::size_t(d); ++a) own.centre[a] = centre[int(a)];
            for (std::size_t i = 0; i < of_[world].size(); ++i) {
                try {
                    require_possible(of_[world][i]);
                }
                catch (Error const& error) {
                    throw Error{error.what_is_wrong(),
                                error.where() + ", number " + std::to_string(i) + " of world " +
                                    std::to_string(world),
                                error.remedy()};
                }
                together.list.push_back(of_[world][i]);
                together.own_worlds.push_back(own);
            }
        }
        return together;
    }

    /// Calls `run(receive)`, which calls the solver with `all`, calls `receive` with the reactions of every
    /// report, and returns the result. Where that throws, what was received until then is what counts.
    template <class Solver, class Run>
    auto act(Solver& solver, All const& all, Run const& run)
    {
        std::vector<std::vector<Reaction>> received(of_.size());
        for (std::size_t world = 0; world < of_.size(); ++world) received[world].resize(of_[world].size());
        auto const receive = [&](std::vector<Reaction>& reactions) {
            take(reactions, all.list.size(), received);
        };
        double const begin = solver.time();
        try {
            auto result = run(receive);
            reactions_.swap(received);
            return result;
        }
        catch (...) {
            if (solver.time() > begin) { // steps until then were taken
                auto reactions = solver.until_error().reactions;
                receive(reactions);
                reactions_.swap(received);
            }
            throw;
        }
    }

private:
    static void require_possible(Obstacle<ShapeType> const& obstacle)
    {
        obstacle.validate();
        if constexpr (d == 2) obstacle.validate_in_plane();
        require(!obstacle.on_particles || acts_on_particles_too(acts_on),
                "it is to act on particles, and the worlds' obstacles do not", "Obstacle",
                "Make them Worlds<Solver, Shape, ActsOn::particles>.");
    }

    /// Adds the last so many reactions to those of the worlds' obstacles, and takes them off.
    static void take(std::vector<Reaction>& all, std::size_t own, std::vector<std::vector<Reaction>>& to)
    {
        if (all.size() < own) return; // no step was taken
        auto next = std::prev(all.end(), static_cast<std::ptrdiff_t>(own));
        for (auto& of_world : to)
            for (auto& reaction : of_world) reaction += *next++;
        all.resize(all.size() - own);
    }

    std::vector<std::vector<Obstacle<ShapeType>>> of_; ///< by world
    std::vector<std::vector<Reaction>> reactions_;     ///< of the last call
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/obstacle.hpp>
#include <firn/effects/obstacles_action.hpp>
#include <firn/effects/shapes/any_shape.hpp>
#include <firn/effects/staged_obstacles.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace firn
{

/// Any number of obstacles, one argument of a call. They act one after the other as if each were an argument
/// of its own, and the report has one reaction for each, in their order. Obstacles may be added, changed and
/// removed between calls:
///
///     firn::Obstacles<> scene;
///     scene.list.push_back({.shape = firn::Box{{1, 0.1, 1}}, .contact = firn::Contact::coulomb(0.3)});
///     scene.list.push_back({.shape = firn::Sphere{0.2}, .motion = {.position = {0, 1, 0}}});
///     auto const report = solver.advance(frame, firn::Gravity{}, scene);
///
/// Nodes and particles meet only those that are near: obstacles are sorted into cubes of some cells when a
/// call begins, by what they sweep during it. Shapes of your own are named in the type,
/// Obstacles<AnyShape<Pillar>>, or all are of one type, Obstacles<Sphere>; shells are
/// Obstacles<Shell<AnyShape<>>>. Solids that act on particles, too, are
/// Obstacles<AnyShape<>, ActsOn::particles>: the type says so, since steps without them are faster on a
/// device. Obstacles<AnyShape<>, ActsOn::surface> act by impulses at points of their surface (SurfacePoint),
/// as one surface where they meet, those of several such lists, too.
template <class ShapeType = AnyShape<>,
          ActsOn acts_on = is_two_sided<ShapeType> ? ActsOn::particles : ActsOn::nodes>
struct Obstacles
{
    static_assert(
        !is_two_sided<ShapeType> || acts_on_particles_too(acts_on),
        "a Shell acts on particles: pass Obstacles<Shell<Shape>>, or ActsOn::surface_and_particles");

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
            require(!obstacle.on_particles || acts_on_particles_too(acts_on),
                    "it is to act on particles, and its list does not", "Obstacle",
                    "Make the list Obstacles<Shape, ActsOn::particles>, or ActsOn::surface_and_particles.");
        });
    }
    /// Throws an Error if one of them leaves the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        for_each([](auto const& obstacle) { obstacle.validate_in_plane(); });
    }

    /// Throws an Error if one of them makes no sense in a scene that is periodic along some axes.
    void validate_in(Lattice const& lattice, int dimension) const
    {
        for_each([&](auto const& obstacle) { obstacle.validate_in(lattice, dimension); });
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
    using Staged = StagedObstacles<Backend, ShapeType, acts_on, Number, d>;

    /// What steps know, without the obstacles, which Staged adds.
    PlainObstacles<detail::Plain<ShapeType>, acts_on> plain() const { return {}; }

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

} // namespace firn

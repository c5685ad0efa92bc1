// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/error.hpp>
#include <firn/effects/node_effect.hpp>
#include <firn/effects/obstacles_of_worlds.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/volumes.hpp>
#include <firn/solver.hpp>
#include <firn/state/reset_world.hpp>
#include <firn/state/world_state.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// Many copies of a small scene that never touch, in one solver, so that they fill a device together: for
/// example to train robots.
///
///     firn::Worlds<Solver> worlds(148, firn::lattice(0.02), sand);
///     for (std::uint32_t w = 0; w < worlds.count(); ++w) {
///         worlds.add(w, points, volume);
///         worlds.obstacles(w) = {{.shape = firn::Box{{0.1, 0.1, 0.1}}, .motion = arm(w)}};
///     }
///     auto const start = worlds.save(0);
///     worlds.advance(1.0 / 60, firn::Gravity{}, floor); // gravity and the floor act in all worlds
///     worlds.reset(3, start);                           // and nothing changes in the others
///
/// Every world has the whole lattice's coordinates to itself: positions are metres in the world, and
/// particles of two worlds may lie at the same place. Obstacles of a world act there alone, and effects that
/// are arguments act in all of them. A world has its own time, which is 0 where it begins and is set by
/// reset().
///
/// All worlds take steps of one length, the shortest that any of them needs. With steps() of a given length
/// the bits of a world depend on what was done in it and on the calls of steps(), and not on other worlds but
/// for what WORLDS.md names. For this, particles scatter to the grid afresh when a call begins, which takes
/// the time of about two steps.
///
/// `SolverType` is a Solver, which the worlds own; `ShapeType` is the shape of the worlds' own obstacles, and
/// `acts_on` what they act on, as in Obstacles. A particle that comes near the border of its world fails as
/// one does at the border of the lattice: that is at least 16 000 cells away, and 130 000 for up to 4096
/// worlds in space.
template <class SolverType, class ShapeType = AnyShape<>,
          ActsOn acts_on = is_two_sided<ShapeType> ? ActsOn::particles : ActsOn::nodes>
class Worlds
{
    using Sets = typename SolverType::Sets;
    static_assert(!is_deforming<ShapeType>, "a shape that changes its form does so in the solver's time, and "
                                            "obstacles of a world have the world's");

public:
    using Solver = SolverType;
    using Number = typename Solver::Number;
    static constexpr int d = Solver::d;
    using State = WorldState<Number, d>;

    /// So many empty worlds. The other arguments are those of a Solver. Throws an Error if there are to be
    /// none or more than 2^20, and where a Solver does.
    template <class... Arguments>
    explicit Worlds(std::uint32_t count, Lattice lattice, Arguments&&... arguments)
        : solver_(divided(lattice, layout_of(count)), std::forward<Arguments>(arguments)...),
          layout_(layout_of(count)), begun_(count), obstacles_(count)
    {
        solver_.scene_.calls_begin_afresh = true;
        if constexpr (spans_ranks<Backend>) {
            detail::require_same_on_ranks(solver_.backend(), "Worlds", detail::text_of(count));
            solver_.backend().share_worlds(count);
        }
    }

    /// How many there are.
    std::uint32_t count() const { return static_cast<std::uint32_t>(begun_.size()); }

    /// The solver of all worlds, for what only reads. Values of all particles are in the order of ids, and
    /// positions are those in their own worlds: see world_of_particles().
    Solver const& solver() const { return solver_; }

    /// The same of a solver, so that assign() and others take worlds: ids, positions and fields by rising id.
    template <class Which = EveryMaterial>
    std::vector<std::uint32_t> ids() const
    {
        return solver_.template ids<Which>();
    }
    template <class Which = EveryMaterial>
    auto positions() const
    {
        return solver_.template positions<Which>();
    }
    template <class Tag, class Which = EveryMaterial>
    auto download() const
    {
        return solver_.template download<Tag, Which>();
    }
    template <class Which = EveryMaterial>
    std::size_t size() const
    {
        return solver_.template size<Which>();
    }

    /// Adds particles to a world: see Solver::add.
    template <class Which = EveryMaterial, class Points>
    std::uint32_t add(std::uint32_t world, Points const& points, Volumes const& volumes,
                      Vector<double, d> const& velocity = zeros<Vector<double, d>>())
    {
        constexpr std::size_t k = Solver::template MaterialTraits<Which>::place;
        std::uint32_t first = 0;
        change("Worlds::add", {world}, [&] {
            auto& scene = solver_.scene_;
            first = scene.next_id;
            bool const are_first = scene.size() == 0;
            if (scene.template add<k>(points, volumes, velocity, layout_.centre(world)) > 0)
                solver_.time_loop_.next_step().template admit<k>(scene, norm(velocity), are_first);
        });
        return first;
    }

    /// The obstacles of a world, to be changed between calls. Their poses are those in the world. A motion
    /// that has a time has the world's.
    std::vector<Obstacle<ShapeType>>& obstacles(std::uint32_t world)
    {
        require_exists(world, "Worlds::obstacles");
        return obstacles_.of(world);
    }

    /// What the obstacles of a world received in the last call of advance(), step() or steps(), one for each
    /// that it had then.
    std::vector<Reaction> const& reactions(std::uint32_t world) const
    {
        require_exists(world, "Worlds::reactions");
        return obstacles_.reactions(world);
    }

    /// The time of a world [s]: since the worlds were made, or what it was reset to and since then.
    double time(std::uint32_t world) const
    {
        require_exists(world, "Worlds::time");
        return solver_.time() - begun_[world];
    }

    /// Advances all worlds by a duration [s], with the arguments of Solver::advance. The report's reactions
    /// are those of the effects that are arguments; see reactions() for the others.
    template <class... Arguments>
    AdvanceReport advance(double duration, Arguments const&... arguments)
    {
        require_no_walls<Arguments...>();
        auto const own = obstacles_.all(layout_, begun_);
        return obstacles_.act(solver_, own, [&](auto const& receive) {
            auto report = solver_.advance(duration, arguments..., own);
            receive(report.reactions);
            return report;
        });
    }

    /// Advances all worlds by `count` steps of length `dt` [s]: see Solver::steps.
    template <class... Effects>
    std::vector<StepReport> steps(std::size_t count, double dt, Effects const&... effects)
    {
        require_no_walls<Effects...>();
        auto const own = obstacles_.all(layout_, begun_);
        return obstacles_.act(solver_, own, [&](auto const& receive) {
            auto reports = solver_.steps(count, dt, effects..., own);
            for (auto& report : reports) receive(report.reactions);
            return reports;
        });
    }

    /// The same for one step: see Solver::step.
    template <class... Effects>
    StepReport step(double dt, Effects const&... effects)
    {
        return std::move(steps(1, dt, effects...).front());
    }

    /// See Solver::stable_step, with the effects that act in all worlds.
    template <class... Effects>
    double stable_step(Effects const&... effects) const
    {
        require_no_walls<Effects...>();
        return solver_.stable_step(effects..., obstacles_.all(layout_, begun_));
    }

    /// See Solver::quarantine: `most` particles in all worlds.
    void quarantine(std::size_t most) { solver_.quarantine(most); }

    /// Sets a field of all particles of a material, by rising id: see Solver::upload.
    template <class Tag, class Which = EveryMaterial>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        solver_.template upload<Tag, Which>(by_id);
    }

    /// Removes the particles of all worlds for which a predicate is true: see Solver::remove_if. They are
    /// gone for good: a reset does not bring them back, see there.
    template <class Which = EveryMaterial, class Predicate>
    std::size_t remove_if(Predicate const& predicate)
    {
        return solver_.template remove_if<Which>(predicate);
    }

    /// Removes all particles of a world, whose time and obstacles stay, and takes those that it lost off the
    /// list of the quarantine. Returns how many were removed.
    std::size_t clear(std::uint32_t world)
    {
        std::size_t count = 0;
        change("Worlds::clear", {world}, [&] {
            auto& scene = solver_.scene_;
            std::vector<RemovalMask<Backend>> masks;
            for (auto const& found : particles()) masks.push_back(found.mask(world, scene.backend));
            count = scene.remove(masks);
            std::vector<std::uint32_t> lost;
            for (auto const& failure : solver_.isolated())
                if (failure.world == world) lost.push_back(failure.particle);
            solver_.time_loop_.release(lost);
            if (count > 0) scene.change([&] { solver_.time_loop_.next_step().follow_removal(scene); });
        });
        return count;
    }

    /// The particles of a world as they are now, and its time, in memory of the host. Changes nothing.
    State save(std::uint32_t world)
    {
        State state;
        change("Worlds::save", {world}, [&] {
            auto& scene = solver_.scene_;
            scene.cache_grid_fields();
            sort();
            state.cell_size = scene.lattice.cell_size;
            state.origin = scene.lattice.origin;
            state.masses = scene.masses;
            state.kernel_degree = Solver::kernel::degree;
            state.time = time(world);
            state.bounds = solver_.bounds();
            auto const found = particles();
            Sets::for_each([&](auto k) {
                state.materials.push_back(particles_of_world(scene.sets.template particles<k>(), found[k],
                                                             world, layout_.centre(world)));
                detail::name_material<k>(scene.sets, state.materials.back());
            });
        });
        return state;
    }

    /// Brings a world's particles and its time back to those of a state, which save() returned for this or
    /// another world. The particles keep their ids: those of the same rank get the same values. Nothing
    /// changes in other worlds, bit by bit. Obstacles stay as they are.
    ///
    /// Particles that the world lost to the quarantine come back, the last ones first, if it misses them for
    /// the state. They leave the list of the quarantine, which Solver::isolated returns. Particles that
    /// remove_if() took do not come back, since their ids are gone, and the world is refused: clear() it, and
    /// add() as many particles of the same masses, which then get the values of the state.
    ///
    /// Throws an Error, and changes nothing, if the state is of other materials or cells, or unless the world
    /// has, or gets so, as many particles of each material, of the same masses.
    void reset(std::uint32_t world, State const& state) { reset(std::vector<std::uint32_t>{world}, state); }

    /// The same for several worlds in one call, which takes hardly longer. None of them may be listed twice.
    void reset(std::vector<std::uint32_t> const& worlds, State const& state)
    {
        char const* const where = "Worlds::reset";
        if (worlds.empty()) return;
        change(where, worlds, [&] {
            auto& scene = solver_.scene_;
            auto sorted = worlds;
            std::sort(sorted.begin(), sorted.end());
            require(std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end(),
                    "a world is listed twice", where, "List each world once.");
            detail::require_same_state(scene.backend, where, state);
            detail::require_state_fits(state, scene, layout_);
            MassScale scale = scene.size() > 0 ? scene.masses : state.masses;
            std::vector<std::vector<detail::Returning>> coming(Sets::count);
            std::vector<std::uint32_t> back;
            Sets::for_each([&](auto k) {
                auto const& all = rows_by_world<k>();
                for (auto const world : worlds) {
                    coming[k].push_back(missing<k>(world, all[world], state));
                    detail::require_same_particles<k>(state, scene, scale, all[world], coming[k].back());
                    auto const& ids = coming[k].back().ids;
                    back.insert(back.end(), ids.begin(), ids.end());
                }
            });
            scene.cache_grid_fields();
            sort();
            scene.known_marks.forget();
            scene.change([&] {
                if (!back.empty()) bring_back(coming, state, scale);
                solver_.time_loop_.release(back);
                Sets::for_each([&](auto k) {
                    auto const& all = rows_by_world<k>();
                    std::vector<std::vector<std::uint32_t> const*> rows;
                    for (auto const world : worlds) rows.push_back(&all[world]);
                    reset_particles(scene.sets.template particles<k>(), worlds, rows, state.materials[k],
                                    layout_);
                });
                solver_.time_loop_.next_step().admit(state.bounds);
                for (auto const world : worlds) begun_[world] = solver_.time() - state.time;
            });
        });
    }

    /// In which world each particle is, by rising id.
    template <class Which = EveryMaterial>
    std::vector<std::uint32_t> world_of_particles() const
    {
        return solver_.template by_id<Which, std::uint32_t>([&](auto k) {
            auto const found = particles_of_all_ranks<k>();
            std::vector<std::uint32_t> by_row(found.row_at.size());
            for (std::size_t place = 0; place < by_row.size(); ++place)
                by_row[found.row_at[place]] = found.world_at[place];
            return by_row;
        });
    }

private:
    using Backend = std::remove_cvref_t<decltype(std::declval<Solver const&>().backend())>;

    static WorldLayout<d> layout_of(std::uint32_t count)
    {
        require(count > 0 && count <= WorldLayout<d>::most, "the number of worlds is not from 1 to 1048576",
                "Worlds", "Pass as many as fit.");
        return WorldLayout<d>::of(count, Sets::CellOrder::largest_coordinate);
    }
    static Lattice divided(Lattice lattice, WorldLayout<d> const& layout)
    {
        require(std::ranges::all_of(lattice.periods, [](int cells) { return cells == 0; }),
                "the lattice is periodic", "Worlds", "Pass an unbounded one: each world has a part of it.");
        lattice.half_world = layout.half_world;
        lattice.world_bits = layout.bits;
        return lattice;
    }

    /// Whether an argument is a reflecting wall, the library's or one of a user's own.
    template <class Effect>
    static constexpr bool mirrors()
    {
        if constexpr (NodeEffect<Effect, typename Solver::Real, d>)
            return is_wall<detail::ActionOf<Effect, Number, d>>;
        else
            return false; // a budget, or what the solver refuses
    }

    template <class... Effects>
    static constexpr void require_no_walls()
    {
        static_assert(!(false || ... || mirrors<Effects>()),
                      "a ReflectingWall mirrors one plane of the lattice, which lies in some worlds alone: "
                      "pass an Obstacle<HalfSpace>");
    }

    void require_exists(std::uint32_t world, char const* where) const
    {
        if (world < count()) return;
        throw Error{"there is no world " + std::to_string(world), where,
                    "Pass a number below count(), which is " + std::to_string(count()) + "."};
    }

    /// Does what changes some worlds, or copies from them.
    template <class Work>
    void change(char const* where, std::vector<std::uint32_t> const& worlds, Work const& work)
    {
        solver_.change(where, [&] {
            detail::require_same_values(solver_.backend(), where, "worlds", worlds);
            for (auto const world : worlds) require_exists(world, where);
            work();
        });
    }

    /// In which worlds the particles that lie here are, of each material.
    std::vector<ParticlesOfWorlds> particles() const
    {
        std::vector<ParticlesOfWorlds> found;
        Sets::for_each([&](auto k) {
            found.push_back(ParticlesOfWorlds(solver_.scene_.sets.template particles<k>(), layout_));
        });
        return found;
    }
    template <std::size_t k>
    ParticlesOfWorlds particles_of_all_ranks() const
    {
        return ParticlesOfWorlds(solver_.scene_.sets.template particles<k>(), layout_)
            .of_all_ranks(solver_.backend());
    }
    /// The rows of a material's particles by world: looked for only if particles have come or gone.
    template <std::size_t k>
    std::vector<std::vector<std::uint32_t>> const& rows_by_world()
    {
        auto const& table = solver_.scene_.sets.template particles<k>();
        RowsByWorld& known = rows_[k];
        if (known.rows.empty() || !(known.mark == table.id_mark())) {
            known.rows = particles_of_all_ranks<k>().rows_by_world(count());
            known.mark = table.id_mark();
        }
        return known.rows;
    }
    /// The particles that a world has to get back for a state; its others are those of some rows.
    template <std::size_t k>
    detail::Returning missing(std::uint32_t world, std::vector<std::uint32_t> const& rows,
                              State const& state) const
    {
        std::size_t const wanted = state.materials[k].ids.size();
        std::vector<std::uint32_t> present;
        if (rows.size() >= wanted) return {world, {}, {}};
        present.reserve(rows.size());
        for (auto const row : rows) present.push_back(solver_.scene_.sets.template particles<k>().id(row));
        return detail::returning_to(world, k, present, wanted, solver_.isolated());
    }
    /// Brings particles back, of each material. Tables and grid are then new ones, as after a restore.
    void bring_back(std::vector<std::vector<detail::Returning>> const& coming, State const& state,
                    MassScale scale)
    {
        auto& scene = solver_.scene_;
        double const to_unit = state.masses.unit / scale.unit;
        Sets::for_each([&](auto k) {
            detail::return_particles(scene.sets.template particles<k>(), coming[k], state.materials[k],
                                     to_unit, scale, layout_);
        });
        scene.masses = scale;
        scene.grid_state = {scene.lattice, scene.transfer, scene.backend};
    }
    void sort()
    {
        Sets::for_each([&](auto k) { solver_.scene_.sets.template particles<k>().sort(); });
    }

    /// Which rows a world's particles have, as long as a table has the same particles.
    struct RowsByWorld
    {
        IdMark mark;
        std::vector<std::vector<std::uint32_t>> rows;
    };

    Solver solver_; ///< the first member: a move that it refuses has changed nothing
    WorldLayout<d> layout_;
    std::vector<double> begun_; ///< the solver's time when a world's was 0 [s]
    ObstaclesOfWorlds<ShapeType, acts_on, d> obstacles_;
    std::array<RowsByWorld, Sets::count> rows_;
};

} // namespace firn

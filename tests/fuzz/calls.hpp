// SPDX-License-Identifier: MIT
#pragma once

#include "frames.hpp"
#include "surroundings.hpp"

#include <firn/budget.hpp>
#include <firn/contact_points.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>
#include <firn/host_copies.hpp>
#include <firn/id_lookup.hpp>
#include <firn/initial_stress.hpp>
#include <firn/io/checkpoint.hpp>
#include <firn/mark_face.hpp>
#include <firn/sampling/fill.hpp>
#include <firn/sampling/polygon.hpp>
#include <firn/settle.hpp>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>

// Calls in any order: particles come and go, effects move, states are saved, uploaded and restored, and
// failing particles may go to the quarantine. Whatever can be asked of a scene is asked in between.
namespace firn::fuzz
{

constexpr std::size_t most = 300; // particles

/// What is on the left of a plane [m].
struct OnTheLeft
{
    double x;

    template <int d>
    bool operator()(Eigen::Matrix<double, d, 1> const& at) const
    {
        return at[0] < x;
    }
};

template <class Solver>
class Calls
{
    static constexpr int d = Solver::d;
    using Number = typename Solver::Number;
    using Model = typename Solver::Model;

public:
    /// Of `kinds` kinds of calls: a new kind comes behind the others, so that inputs keep their meaning.
    Calls(Input& input, Model const& model, int kinds)
        : input_(input), model_(model), kinds_(kinds),
          solver_(lattice(cell), model, {}, {.smallest = 1e-3, .retries = input.below(14)})
    {}

    void run()
    {
        for (int i = 0; i < 60 && !input_.empty(); ++i) {
            call();
            let_go();
            look();
        }
    }

private:
    void call()
    {
        switch (input_.below(kinds_)) {
        case 0:
        case 1:
            add();
            break;
        case 2:
            remove();
            break;
        case 3:
            upload<Velocity>();
            break;
        case 4:
            upload_state();
            break;
        case 5:
        case 6:
        case 7:
            step();
            break;
        case 8:
        case 9:
            advance();
            break;
        case 10:
            around_.move_ball(input_, solver_.time());
            break;
        case 11:
            save_or_restore();
            break;
        case 12:
            checkpoint();
            break;
        case 13:
            twin();
            break;
        case 14:
            around_.change_gravity(input_);
            if constexpr (has_marks<Solver>) mark();
            break;
        case 15:
            toggle();
            break;
        case 16:
        case 17:
            ask();
            break;
        case 18:
            add_filled();
            break;
        case 19:
            settle_down();
            break;
        case 20:
            around_.follow_path(input_, solver_.time());
            break;
        case 21:
            if constexpr (Solver::State::template contains<DisplacementGradient>) begin_at_rest();
            break;
        case 22:
            if constexpr (has_marks<Solver>) mark_surface();
            break;
        case 23:
            remove_by_shape();
            break;
        case 26:
            sample_on_grid();
            break;
        case 27:
            if (!frames_) frames_ = std::make_unique<FramesUnderWay>(input_.byte());
            frames_->call(solver_, input_);
            break;
        case 28:
            go_from_key_to_key();
            break;
        case 29:
            if constexpr (d == 2) add_polygon();
            break;
        case 30:
            if constexpr (!is_pool<Solver>) deform();
            break;
        default:
            around_.change_more(input_);
            break;
        }
    }

    /// Asks for what is computed on request: it is that of these particles, and changes nothing.
    void ask()
    {
        Told<Solver> const told(solver_);
        switch (input_.below(5)) {
        case 0:
            ask_for_totals(told);
            break;
        case 1:
            ask_for_samples();
            break;
        case 2:
            look_up();
            break;
        case 3:
            read_otherwise(told);
            break;
        default:
            longest_stable_step();
            break;
        }
        expect(Told<Solver>(solver_) == told, "a question changed something");
    }

    void ask_for_totals(Told<Solver> const& told)
    {
        Vector<double, d> about;
        Gravity gravity;
        for (int a = 0; a < d; ++a) about[a] = input_.any(1), gravity.acceleration[a] = input_.any(9.81);
        SceneTotals<d> totals;
        if (!refused([&] { totals = solver_.totals(about); })) {
            expect(std::abs(totals.mass - told.mass()) <= 1e-12 * told.mass(), "the mass is another one");
            expect((totals.momentum - told.momentum()).norm() <= 1e-12 * told.momenta(),
                   "the momentum is another one");
            expect(totals.centre_of_mass.allFinite() && totals.angular_momentum.allFinite(),
                   "the totals are not finite");
        }
        Energy energy;
        if (!refused([&] { energy = solver_.energy(gravity); })) {
            expect(energy.kinetic == solver_.totals().kinetic_energy, "there are two kinetic energies");
            expect(std::isfinite(energy.elastic) && std::isfinite(energy.gravitational),
                   "an energy is not finite");
        }
    }

    void ask_for_samples()
    {
        std::vector<Vector<double, d>> points(static_cast<std::size_t>(input_.below(6)));
        bool const anywhere = input_.below(4) == 0;
        for (auto& x : points)
            for (int a = 0; a < d; ++a) x[a] = anywhere ? input_.any(1) : input_.between(-1, 1);
        refused([&] {
            auto const samples = solver_.sample(points);
            expect(samples.size() == points.size(), "not one sample per point");
            for (auto const& at : samples)
                expect(std::isfinite(at.density) && at.density >= 0 && at.velocity.allFinite() &&
                           at.stress.allFinite(),
                       "a sample is not finite");
        });
    }

    /// Values are the same by whichever call they are read.
    void read_otherwise(Told<Solver> const& told)
    {
        of_some_material([&](auto k) {
            using One = Material<k>;
            auto const count = solver_.template size<One>(), components = std::size_t(d);
            std::vector<Number> positions(components * count), velocities(components * count);
            solver_.template write_positions<One>(positions.data());
            solver_.template write<Velocity, One>(velocities.data());
            auto const at = solver_.template positions<One>();
            auto const moving = solver_.template download<Velocity, One>();
            for (std::size_t i = 0; i < count; ++i)
                for (int a = 0; a < d; ++a) {
                    Number const x = positions[components * i + std::size_t(a)], expected = Number(at[i][a]);
                    expect(std::abs(x - expected) <=
                               2 * std::numeric_limits<Number>::epsilon() * std::abs(expected),
                           "another position is written than is read");
                    expect(velocities[components * i + std::size_t(a)] == moving[i][a],
                           "another velocity is written than is read");
                }
        });
        auto const count = told.ids.size();
        auto const occupied = solver_.occupancy();
        expect(occupied.particles == count, "cells have other particles than there are");
        expect(occupied.cells <= count && occupied.pieces <= occupied.cells && occupied.alone <= count,
               "there are more cells than particles");
        auto const touched = contact_points(solver_).points;
        expect(is_pool<Solver> || touched.empty(), "nothing acts at its surface, and was touched");
        for (auto const& point : touched)
            expect(point.position.allFinite() && point.impulse.allFinite() &&
                       std::abs(point.normal.norm() - 1) < 1e-3,
                   "a point of contact is not finite, or has no normal");
    }

    /// What a grid has is what its points have, and is written.
    void sample_on_grid()
    {
        bool const any = input_.below(4) == 0;
        Vector<double, d> low, high;
        Coordinates<d> points;
        double count = 1;
        for (int a = 0; a < d; ++a) {
            low[a] = any ? input_.any(0.5) : input_.between(-1, 0.5);
            high[a] = any ? input_.any(1) : low[a] + input_.between(0, 1);
            points[a] = input_.below(6);
            if (any) points[a] = static_cast<int>(std::clamp(input_.any(3), -1e9, 2e9));
            count *= points[a];
        }
        if (count > 4096 && count < 2147483648.0) points.setConstant(3); // else it takes for long
        Told<Solver> const told(solver_);
        SampledGrid<d> grid;
        if (!refused([&] { grid = sample_grid(solver_, low, high, points); })) {
            expect(grid.samples.size() == std::size_t(points.prod()), "a grid has another number of samples");
            std::vector<Vector<double, d>> places;
            for (std::size_t i = 0; i < grid.samples.size(); ++i) places.push_back(grid.place(i));
            auto const expected = solver_.sample(places);
            double mass = 0;
            for (std::size_t i = 0; i < places.size(); ++i) {
                auto const& at = grid.samples[i];
                expect(at.density == expected[i].density && at.velocity == expected[i].velocity &&
                           at.stress == expected[i].stress,
                       "a sample of a grid is not that of its point");
                expect(std::isfinite(at.density) && at.density >= 0 && at.velocity.allFinite() &&
                           at.stress.allFinite(),
                       "a sample of a grid is not finite");
                mass += at.density;
            }
            TemporaryFile const vti(".vti"), csv(".csv");
            double const time = any ? input_.any(1) : solver_.time();
            bool const was_refused = refused([&] { write_vti(vti.path(), grid, time); });
            expect(was_refused == !std::isfinite(time), "a time is written that is none, or the reverse");
            write_csv(csv.path(), grid);
            expect(std::size_t(std::ranges::count(csv.content(), '\n')) == places.size() + 1,
                   "a table of samples has not one row for each");
        }
        expect(Told<Solver>(solver_) == told, "a question changed something");
    }

    /// The ball follows a path, and no call spans a key of it.
    void go_from_key_to_key()
    {
        be_marked();
        PosePath path;
        std::vector<double> keys;
        bool const any = input_.below(4) == 0;
        double time = solver_.time();
        for (int i = input_.below(5); i >= 0; --i) {
            time += any ? input_.any(1e-4) : input_.between(0, 1e-3);
            Eigen::Vector3d const position(input_.between(-1, 1), input_.between(-0.2, 1), 0);
            if (!refused([&] { path.add(time, position); })) keys.push_back(time);
        }
        double const frame = any ? input_.any(1e-3) : input_.between(1e-5, 2e-3), begin = solver_.time();
        std::size_t calls = 0;
        for (double left = frame; left > 0; ++calls) {
            double const now = solver_.time();
            double part = 0;
            if (refused([&] { part = path.until_key(now, left); })) return;
            expect(part > 0 && part <= left, "it is no part of the frame to the next key");
            for (double const key : keys)
                expect(!(key > now + 1e-9 * left && key < now + part - 1e-9 * left), "a part spans a key");
            if (part > 1e-2) return; // one waits for long
            bool const was_refused = refused([&] {
                around_.ball.motion = path.during(now, part);
                around_.with([&](auto const&... effects) { solver_.advance(part, effects...); });
            });
            if (was_refused) return;
            left -= part;
        }
        expect(calls <= keys.size() + 1 || !(frame > 0), "there are more parts than keys make");
        expect(std::abs(solver_.time() - (begin + frame)) <= 1e-12 * (begin + frame) || !(frame > 0),
               "the parts are not the frame");
    }

    /// A polygon is refused, or it is filled, and its points lie inside and stand for its area.
    void add_polygon()
    {
        bool const any = input_.below(4) == 0;
        std::vector<Polygon::Loop> loops(1 + std::size_t(input_.below(3)));
        for (auto& loop : loops) {
            Eigen::Vector2d const centre(input_.between(-0.5, 0.5), input_.between(0, 0.8));
            double const radius = input_.between(0.02, 0.3);
            int const corners = 2 + input_.below(6);
            for (int i = 0; i < corners; ++i) {
                double const angle = 2 * M_PI * i / corners, share = any ? input_.between(0, 1) : 1;
                loop.push_back(centre + share * radius * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
            }
            if (any) loop[input_.byte() % loop.size()][input_.below(2)] = input_.any(0.5);
            if (input_.below(8) == 0) loop.push_back(loop[input_.byte() % loop.size()]);
        }
        std::optional<Polygon> polygon;
        Polygon::Loop const outline = loops.front();
        loops.erase(loops.begin());
        if (refused([&] { polygon.emplace(outline, loops); })) return;
        double const size = polygon->bounding_box().sizes().maxCoeff();
        expect(std::isfinite(size) && polygon->area() > 0 &&
                   polygon->area() <= 1.000001 * polygon->bounding_box().volume(),
               "a polygon is larger than its box");
        Filling how{.spacing = any ? input_.any(0.04) : input_.between(0.03, 0.06),
                    .pattern = static_cast<Pattern>(input_.below(3)),
                    .seed = input_.byte()};
        if (how.spacing > 0 && how.spacing < size / 40) how.spacing = size / 40; // else one waits for long
        Filled<2> filled;
        if (refused([&] { filled = fill<2>(*polygon, how); })) return;
        expect(!filled.points.empty(), "a filled polygon has no points");
        double const sum = filled.volume_per_point * double(filled.points.size());
        expect(std::abs(sum - polygon->area()) <= 1e-9 * polygon->area(), "points have another area");
        for (auto const& x : filled.points)
            expect(polygon->contains(x), "a point of a filled polygon lies outside");
        if constexpr (d == 2) put(filled.points, filled.volume_per_point, Vector<double, d>::Zero());
    }

    /// A solid that changes its form goes through the scene.
    void deform()
    {
        bool const any = input_.below(4) == 0;
        auto const number = [&](double low, double high) {
            return static_cast<Number>(any && input_.below(8) == 0 ? input_.any(high)
                                                                   : input_.between(low, high));
        };
        Eigen::Array<int, d, 1> const nodes = Eigen::Array<int, d, 1>::Constant(2 + input_.below(3));
        std::size_t const count = std::size_t(nodes.prod());
        Vector<Number, d> const origin = Vector<Number, d>::Constant(number(-0.5, 0));
        Number const apart = number(0.05, 0.3);
        std::vector<Number> before, after;
        std::vector<Vector<Number, d>> ways;
        for (std::size_t i = 0; i < count; ++i) {
            before.push_back(number(-0.2, 0.3));
            after.push_back(number(-0.2, 0.3));
            ways.emplace_back(Vector<Number, d>::Zero());
            ways.back()[0] = number(-0.1, 0.1);
        }
        if (input_.below(16) == 0) ways.pop_back();
        double const begin = solver_.time() + (any ? input_.any(1e-3) : input_.between(-1e-3, 1e-3)),
                     duration = any ? input_.any(1e-3) : input_.between(1e-5, 2e-3);
        Vector<double, 3> const position(input_.between(-1, 1), input_.between(-0.2, 1), 0);
        AdvanceReport report;
        bool const was_refused = refused([&] {
            SignedDistanceGrid<Number, d> const first(origin, apart, nodes, before),
                last(origin, apart, nodes, after);
            Obstacle<DeformingGrid<Number, d>> const glove{.shape = {first, last, ways, begin, duration},
                                                           .motion = {.position = position}};
            report = solver_.advance(1e-3, Budget{.steps = 20}, around_.gravity, glove, around_.left,
                                     around_.right);
        });
        if (!was_refused) expect_finite(report.reactions);
    }

    /// Particles are found by their ids, and no others.
    void look_up()
    {
        for (int i = 0; i < 4; ++i) {
            std::uint32_t const id = next_ + 3u - (input_.byte() * 256u + input_.byte()) % (next_ + 4u);
            auto const at = std::ranges::lower_bound(ids_, id);
            bool const exists = at != ids_.end() && *at == id;
            expect(lookup_.contains(solver_, id) == exists, "an id is known that is gone, or the reverse");
            std::size_t index = 0;
            bool const was_refused = refused([&] { index = lookup_.index_of(solver_, id); });
            expect(was_refused != exists, "an id that is gone has an index, or the reverse");
            if (exists) expect(index == std::size_t(at - ids_.begin()), "an id has another one's index");
        }
    }

    /// What holds after every call.
    void look() const
    {
        auto const told = expect_whole(solver_);
        expect(told.ids == ids_, "other ids than were given and not removed");
        expect(told.masses.size() == masses_.size(), "other masses than were added");
        for (std::size_t i = 0; i < masses_.size(); ++i)
            expect(std::abs(told.masses[i] - masses_[i]) <= 1e-6 * masses_[i], "a mass has changed");
        if constexpr (has_marks<Solver>) {
            auto const handles = solver_.template download<Handle>();
            for (std::size_t i = 0; i < ids_.size(); ++i)
                expect(integer_of(handles[i]) == handle_of(ids_[i]), "a particle has another one's handle");
        }
    }

    /// The number that the particle of an id is given.
    static std::uint32_t handle_of(std::uint32_t id) { return 2654435761u * (id + 1); }

    /// Removes the particles isolated since the last call from the books, too: each must have existed, and
    /// they must be no more than the quarantine allows.
    void let_go()
    {
        auto const& gone = solver_.isolated();
        expect(gone.size() >= isolated_, "a particle that was taken out is forgotten");
        if (gone.size() > isolated_) expect(gone.size() <= in_quarantine_, "more are gone than may be");
        for (; isolated_ < gone.size(); ++isolated_) {
            auto const& failure = gone[isolated_];
            auto const at = std::ranges::lower_bound(ids_, failure.particle);
            expect(at != ids_.end() && *at == failure.particle,
                   "a particle was taken out that was not there");
            expect(failure.position.allFinite() && failure.material < Solver::materials &&
                       failure.cause != FailureCause::none && failure.count > 0,
                   "the report lacks a particle that was taken out");
            masses_.erase(masses_.begin() + (at - ids_.begin()));
            ids_.erase(at);
        }
    }

    /// Calls `use` with a material's place as a constant.
    template <class Use>
    void of_some_material(Use const& use)
    {
        std::size_t const chosen = Solver::materials == 1 ? 0 : input_.byte() % Solver::materials;
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            ((k == chosen ? use(std::integral_constant<std::size_t, k>{}) : void()), ...);
        }
        (std::make_index_sequence<Solver::materials>{});
    }

    void add()
    {
        std::vector<Vector<double, d>> points(static_cast<std::size_t>(input_.below(32)));
        bool const anywhere = input_.below(8) == 0;
        for (auto& x : points)
            for (int a = 0; a < d; ++a)
                x[a] = anywhere ? input_.any(0.5) : input_.between(a == 0 ? -0.99 : 0, 0.99);
        double const volume = anywhere ? input_.any(1e-3) : input_.between(1e-4, 1e-3);
        Vector<double, d> velocity;
        for (int a = 0; a < d; ++a) velocity[a] = input_.between(-5, 5);
        put(points, volume, velocity);
    }

    /// Adds particles, and gives each its handle.
    void put(std::vector<Vector<double, d>> const& points, double volume, Vector<double, d> const& velocity)
    {
        if (ids_.size() + points.size() > most) return;
        of_some_material([&](auto k) {
            std::uint32_t first = 0;
            if (refused_whole(solver_,
                              [&] { first = solver_.template add<Material<k>>(points, volume, velocity); }))
                return;
            expect(first == next_, "an id was given twice, or left out");
            double const density = double(solver_.template model<Material<k>>().density);
            std::vector<std::uint32_t> handles;
            for (std::size_t i = 0; i < points.size(); ++i) {
                handles.push_back(handle_of(next_));
                ids_.push_back(next_++);
                masses_.push_back(density * volume);
            }
            if constexpr (has_marks<Solver>) upload_from<Handle>(solver_, first, handles);
        });
    }

    /// Fills a shape: it is refused, or has points that all lie inside and stand for its volume.
    void add_filled()
    {
        bool const any = input_.below(4) == 0;
        double const radius = any ? input_.any(0.1) : input_.between(0.05, 0.15);
        Filling how{.spacing = any ? input_.any(0.04) : input_.between(0.03, 0.06),
                    .pattern = static_cast<Pattern>(input_.below(3)),
                    .pose = {.position = {input_.between(-0.8, 0.8), input_.between(0, 0.8), 0}},
                    .jitter = any ? input_.any(0.5) : input_.between(0, 1),
                    .seed = input_.byte()};
        if (any) how.pose.orientation.z() = input_.any(0.1);
        double const least = std::max(std::abs(radius), 0.1) / 20; // with less one waits for long
        if (how.spacing > 0 && how.spacing < least) how.spacing = least;
        Sphere const ball{radius};
        Box const box{{0.1, radius, 0.1}}; // shapes without a formula are left out: they take seconds
        bool const is_ball = input_.below(2) == 0;
        Filled<d> filled;
        if (refused([&] { filled = is_ball ? fill<d>(ball, how) : fill<d>(box, how); })) return;
        double const reach = is_ball ? radius : box.reach(d);
        expect(!filled.points.empty() && std::isfinite(filled.volume_per_point) &&
                   filled.volume_per_point > 0,
               "a filled shape has no volume");
        for (auto const& x : filled.points)
            expect((x - how.pose.position.template head<d>()).norm() <= 1.000001 * reach,
                   "a point of a filled shape lies outside");
        put(filled.points, filled.volume_per_point, Vector<double, d>::Zero());
    }

    void remove()
    {
        OnTheLeft const left{input_.between(-1.1, 1.1)};
        Told<Solver> const before(solver_);
        if (input_.below(4) == 0) { // of one material: the others are told apart by their ids
            of_some_material([&](auto k) {
                auto const those = solver_.template ids<Material<k>>();
                std::size_t const count = solver_.template remove_if<Material<k>>(left);
                forget(before, count, [&](std::size_t i) {
                    return left(before.positions[i]) && std::ranges::binary_search(those, before.ids[i]);
                });
            });
            return;
        }
        std::size_t const count = solver_.remove_if(left);
        forget(before, count, [&](std::size_t i) { return left(before.positions[i]); });
    }

    /// Removes what is in a ball, outside of it, or fast.
    void remove_by_shape()
    {
        bool const any = input_.below(8) == 0;
        Sphere const ball{any ? input_.any(0.2) : input_.between(0.01, 0.5)};
        Motion pose{.position = {input_.between(-1, 1), input_.between(-0.2, 1), 0}};
        if (any) pose.orientation.z() = input_.any(0.1);
        Told<Solver> const before(solver_);
        auto const remove = [&](auto const& predicate, auto const& is_gone) {
            std::size_t count = 0;
            if (!refused_whole(solver_, [&] { count = solver_.remove_if(predicate); }))
                forget(before, count, is_gone);
        };
        Inside<Sphere> const inside{ball, pose};
        switch (input_.below(4)) {
        case 0:
        case 1:
            return remove(inside, [&](std::size_t i) { return inside(before.positions[i]); });
        case 2:
            return remove(Outside<Sphere>{ball, pose},
                          [&](std::size_t i) { return !inside(before.positions[i]); });
        default:
            Number const most(static_cast<Number>(input_.any(1)));
            return remove(
                [most](auto const&, auto const& particle) { return particle[Velocity{}][0] > most; },
                [&](std::size_t i) { return before.velocities[i][0] > most; });
        }
    }

    /// The particles that were to be removed, and no others, are gone; those that stay have changed no bit.
    template <class IsGone>
    void forget(Told<Solver> before, std::size_t count, IsGone const& is_gone)
    {
        std::size_t kept = 0;
        for (std::size_t i = 0; i < before.ids.size(); ++i) {
            if (is_gone(i)) continue;
            before.ids[kept] = before.ids[i];
            before.positions[kept] = before.positions[i];
            before.velocities[kept] = before.velocities[i];
            before.masses[kept] = before.masses[i];
            masses_[kept] = masses_[i];
            ++kept;
        }
        expect(before.ids.size() - kept == count, "another number was removed than was asked for");
        before.ids.resize(kept);
        before.positions.resize(kept);
        before.velocities.resize(kept);
        before.masses.resize(kept);
        masses_.resize(kept);
        ids_ = before.ids;
        expect(Told<Solver>(solver_) == before, "a particle that stays has changed");
    }

    template <class Tag>
    void upload()
    {
        of_some_material([&](auto k) {
            auto values = solver_.template download<Tag, Material<k>>();
            int const changed = input_.below(8);
            for (int i = 0; i < changed && !values.empty(); ++i) {
                auto& value = values[input_.byte() % values.size()];
                if constexpr (requires { value.coeffRef(0); })
                    value.coeffRef(input_.byte() % value.size()) = static_cast<Number>(input_.any(1));
                else
                    value = static_cast<Number>(input_.any(1));
            }
            if (input_.below(16) == 0 && !values.empty()) values.push_back(values[0]); // one too many
            bool const was_refused =
                refused_whole(solver_, [&] { solver_.template upload<Tag, Material<k>>(values); });
            if (!was_refused)
                expect((solver_.template download<Tag, Material<k>>() == values),
                       "other values than uploaded");
        });
    }
    void upload_state()
    {
        if constexpr (Solver::State::template contains<DisplacementGradient>)
            upload<DisplacementGradient>();
        else
            upload<Velocity>();
    }

    /// The stress of a body at rest, which the model's own response bears.
    void begin_at_rest()
    {
        bool const any = input_.below(4) == 0;
        AtRest rest{.surface = any ? input_.any(1) : input_.between(0, 2),
                    .load = any ? input_.any(1e3) : input_.between(0, 1e4)};
        if (any) rest.acceleration = {input_.any(5), input_.any(9.81), 0};
        if (input_.below(2) == 0) rest.k0 = any ? input_.any(0.5) : input_.between(0.1, 1.5);
        bool const is_hydrostatic = input_.below(4) == 0;
        of_some_material([&](auto k) {
            using Which = Material<k>;
            if constexpr (Solver::template MaterialTraits<Which>::Stored::template contains<
                              DisplacementGradient>) {
                auto values = solver_.template download<DisplacementGradient, Which>();
                auto const& model = solver_.template model<Which>();
                auto const positions = solver_.template positions<Which>();
                if (refused([&] {
                        values = is_hydrostatic ? hydrostatic(model, positions, rest)
                                                : k0_state(model, positions, rest);
                    }))
                    return;
                for (auto const& H : values) expect(H.allFinite(), "the state of rest is not finite");
                refused_whole(solver_, [&] { solver_.template upload<DisplacementGradient, Which>(values); });
            }
        });
    }

    /// Particles are marked, or get a modulus, and what acts on marked ones changes.
    void mark()
    {
        OnTheLeft const left{input_.between(-1.1, 1.1)};
        bool const any = input_.below(8) == 0;
        double const value = any ? input_.any(1) : input_.between(0, 1);
        switch (input_.below(8)) {
        case 0:
            assign_some<OwnShearModulus>(left, any ? value : 1e6 * value);
            break;
        case 1:
            assign_some<OwnLambda>(left, any ? value : 1e6 * value);
            break;
        case 2:
            upload<Mark>();
            break;
        case 3:
            around_.change_wind(input_);
            break;
        case 4:
            around_.change_grip(input_);
            break;
        default:
            assign_some<Mark>(left, value);
            break;
        }
    }
    /// Sets a field of the particles on the left, by place or by ids.
    template <class Tag>
    void assign_some(OnTheLeft const& left, double value)
    {
        auto expected = solver_.template download<Tag>();
        auto const positions = solver_.positions();
        std::vector<std::uint32_t> ids;
        for (std::size_t i = 0; i < positions.size(); ++i) {
            if (!left(positions[i])) continue;
            expected[i] = static_cast<Number>(value);
            ids.push_back(ids_[i]);
        }
        bool const by_ids = input_.below(2) == 0;
        bool const one_too_many = by_ids && input_.below(8) == 0;
        if (one_too_many) ids.push_back(next_ + input_.byte());
        bool const was_refused = refused_whole(solver_, [&] {
            if (by_ids)
                assign<Tag>(solver_, ids, value);
            else
                assign<Tag>(solver_, left, value);
        });
        if (ids.empty() || one_too_many) expect(was_refused, "what no particle gets was not refused");
        if (!was_refused)
            expect(solver_.template download<Tag>() == expected, "other values than were assigned");
    }

    /// A face is marked for a load, or marks are any numbers.
    void mark_surface()
    {
        if (input_.below(4) == 0) return upload<AreaPerMass>();
        bool const any = input_.below(4) == 0;
        Inside<Sphere> const region{
            .shape = {any ? input_.any(0.1) : input_.between(0.02, 0.3)},
            .pose = {.position = {input_.between(-1, 1), input_.between(-0.2, 1), 0}}};
        Vector<double, d> area;
        for (int a = 0; a < d; ++a) area[a] = any ? input_.any(0.1) : input_.between(-0.1, 0.1);
        std::size_t marked = 0;
        if (refused_whole(solver_, [&] { marked = mark_face(solver_, region, area); })) return;
        auto const inside = std::ranges::count_if(solver_.positions(), region);
        expect(marked == std::size_t(inside), "another number of particles is marked than is in the region");
    }

    /// The change of momentum equals the impulses of gravity and of the obstacles over that time, and no
    /// particle is behind a wall.
    template <class Reactions>
    void expect_balance(Told<Solver> const& before, StepBounds const& bounds, double steps, double elapsed,
                        double beyond, Reactions const& reactions)
    {
        Told<Solver> const after(solver_);
        auto const forces = around_.forces(solver_, before, elapsed);
        Vector<double, d> expected = before.momentum() + forces.sum;
        // the scale of rounding errors: momenta, impulses, and the stresses' exchange of momentum within the
        // body
        double scale =
            before.momenta() + after.momenta() + forces.scale +
            before.mass() * std::max(bounds.wave_speed, solver_.bounds().wave_speed) * steps * beyond;
        for (auto const& reaction : reactions) {
            expected -= reaction.impulse.template head<d>();
            scale += reaction.impulse.norm();
        }
        double const tolerance = std::is_same_v<Number, float> ? 1e-4 : 1e-10;
        if (!around_.has_secrets() && (after.momentum() - expected).norm() > tolerance * scale)
            broken("momentum is not that which was given",
                   std::to_string((after.momentum() - expected).norm()) + " of " + std::to_string(scale));
        for (auto const& x : after.positions)
            expect(is_pool<Solver> || std::abs(x[0]) <= wall_node * cell + 1e-3 * cell,
                   "a particle is behind a wall");
    }

    /// The longest stable step with all effects; 0 if these are refused.
    double longest_stable_step() const
    {
        double stable = 0;
        if (refused([&] {
                stable =
                    around_.with([&](auto const&... effects) { return solver_.stable_step(effects...); });
            }))
            return 0;
        expect(stable > 0, "no step is stable"); // it is not NaN either
        return stable;
    }

    /// Before steps with all effects: while no particle has a mark that one of them acts on, these are
    /// refused, and then a particle gets one. Steps without any particle are left to scenes without marks.
    void be_marked()
    {
        if constexpr (has_marks<Solver>) {
            if (is_marked<Mark>(solver_) && is_marked<AreaPerMass>(solver_)) return;
            bool const was_refused = refused_whole(solver_, [&] {
                around_.with([&](auto const&... effects) { solver_.steps(1, 1e-6, effects...); });
            });
            expect(was_refused, "effects act on a mark that no particle has");
            if (solver_.size() == 0) put({0.3 * Vector<double, d>::Unit(1)}, 5e-4, Vector<double, d>::Zero());
            mark_one(solver_);
        }
    }

    void step()
    {
        be_marked();
        double const dt = std::pow(10.0, input_.between(-7, -2));
        auto const count = static_cast<std::size_t>(1 + input_.below(4));
        Told<Solver> const before(solver_);
        StepBounds const bounds = solver_.bounds();
        std::vector<StepReport> reports;
        double const stable = longest_stable_step();
        bool const was_refused = refused([&] {
            reports =
                around_.with([&](auto const&... effects) { return solver_.steps(count, dt, effects...); });
        });
        std::size_t const gone = solver_.isolated().size() - isolated_;
        if (was_refused) { // each step is as if it had not been, or was made
            Told<Solver> const after(solver_);
            if (count == 1) expect(after.time == before.time, "a step that was refused took time");
            if (count == 1 && gone == 0)
                expect(after.positions == before.positions, "a step that was refused moved something");
            return;
        }
        expect(reports.size() == count, "not one report per step");
        std::size_t told_gone = 0;
        for (auto const& report : reports) told_gone += report.isolated.size();
        expect(told_gone == gone, "reports do not tell what was taken out");
        std::vector<Reaction> reactions;
        double beyond = 1, elapsed = 0;
        for (auto const& report : reports) {
            reactions.insert(reactions.end(), report.reactions.begin(), report.reactions.end());
            beyond = std::max(beyond, dt / report.stable_dt);
            elapsed += report.time_of_forces;
            bool const as_asked = std::abs(report.dt - dt) <= 1e-15 * (before.time + 10 * dt);
            expect(as_asked && report.reactions.size() == around_.reactions(), "a report is of another step");
        }
        if (gone == 0) expect(reports[0].stable_dt == stable, "another step was said to be stable");
        expect_finite(reactions);
        if (gone == 0) expect_balance(before, bounds, double(count), elapsed, beyond, reactions);
    }

    /// Damped steps until the scene is at rest, or the time is up.
    void settle_down()
    {
        be_marked();
        bool const any = input_.below(4) == 0;
        Settling how{.rate = any ? input_.any(100) : std::pow(10.0, input_.between(0, 5)),
                     .share = any ? input_.any(1e-6) : input_.between(1e-6, 1),
                     .longest = std::pow(10.0, input_.between(-6, is_pool<Solver> ? -4 : -3)),
                     .least = input_.below(2) * 1e-3};
        if (any) how.between = input_.any(1e-4), how.least = input_.any(1e-3);
        if (how.between < how.longest / 20) how.between = how.longest / 20; // else one waits for long
        double const before = solver_.time();
        SettleReport report;
        if (refused([&] {
                report =
                    around_.with([&](auto const&... effects) { return settle(solver_, how, effects...); });
            }))
            return;
        expect(report.is_at_rest || solver_.time() >= before + how.longest, "it ended before it was at rest");
        expect(report.steps.lost == 0 && report.steps.left == 0, "it lost particles, or a part of its time");
        expect(report.kinetic >= 0 && report.kinetic <= report.largest_kinetic,
               "the kinetic energy is above the largest one");
    }

    void advance()
    {
        be_marked();
        double const exponent = input_.between(-6, -2.5);
        double const duration = std::pow(10.0, exponent);
        Told<Solver> const before(solver_);
        StepBounds const bounds = solver_.bounds();
        // of four calls one has a budget; the input is not asked, so that what was found keeps its meaning
        int const kind = static_cast<int>(-1e4 * exponent) % 16;
        Budget budget;
        if (kind < 4) budget.steps = static_cast<std::uint64_t>(kind);
        if (kind == 4) budget.seconds = 0;
        if (kind == 5) budget.seconds = 1e-4; // the clock says how far it comes
        budget.cut_last_step = kind % 2 == 0;
        int asked = 0, told = 0;
        double time = before.time;
        if (kind == 6) budget.cancelled = [&] { return ++asked > 3; };
        if (kind == 6 || kind == 7)
            budget.progress = [&](Progress const& now) {
                expect(now.begin == before.time && now.time > time && now.end == before.time + duration,
                       "a call tells of another one's progress, or goes back in time");
                expect(now.steps == std::uint64_t(++told), "steps are told of twice, or not at all");
                time = now.time;
            };
        bool const has_budget = kind < 8;
        AdvanceReport report;
        if (refused([&] {
                report = around_.with([&](auto const&... effects) {
                    return has_budget ? solver_.advance(duration, budget, effects...)
                                      : solver_.advance(duration, effects...);
                });
            }))
            return;
        expect(report.lost == 0, "particles were lost");
        if (has_budget) {
            double const end = before.time + duration;
            expect(report.substeps <= budget.steps, "it took more steps than it may");
            expect(told == 0 || std::uint64_t(told) == report.substeps, "not all steps were told of");
            if (report.stopped_by == StoppedBy::cancel) expect(asked == 4, "it was cancelled and went on");
            expect(std::abs(solver_.time() + report.left - end) <= 1e-12 * end,
                   "what is left is not the rest of the duration");
        }
        else
            expect(report.left == 0 && solver_.time() == before.time + duration, "it ended at another time");
        std::size_t const gone = solver_.isolated().size() - isolated_;
        expect(report.isolated.size() == gone, "the report does not tell what was taken out");
        expect_finite(report.reactions);
        if (gone == 0)
            expect_balance(before, bounds, double(report.substeps), report.time_of_forces, 1,
                           report.reactions);
    }

    void toggle()
    {
        int const what = input_.byte();
        around_.change_contact(what);
        if (what & 32) {
            in_quarantine_ = what & 64 ? std::numeric_limits<std::size_t>::max()
                                       : static_cast<std::size_t>(input_.below(6));
            solver_.quarantine(in_quarantine_);
        }
        if (what & 128) around_.change_crates(input_);
    }

    void save_or_restore()
    {
        if (!saved_ || input_.below(2) == 0) {
            Told<Solver> const before(solver_);
            saved_.emplace(solver_.snapshot(), ids_, masses_, next_, isolated_, Told<Solver>(solver_));
            expect(saved_->told == before, "a snapshot changed something");
            return;
        }
        if (input_.below(4) == 0) { // one that does not fit
            auto wrong = saved_->snapshot;
            switch (input_.below(4)) {
            case 0:
                wrong.time = input_.any(1);
                break;
            case 1:
                wrong.lattice.cell_size = input_.any(cell);
                break;
            case 2:
                wrong.bounds.speed = input_.any(1);
                break;
            default:
                wrong.materials.clear();
                break;
            }
            if (refused_whole(solver_, [&] { solver_.restore(wrong); })) return;
        }
        solver_.restore(saved_->snapshot);
        ids_ = saved_->ids;
        masses_ = saved_->masses;
        next_ = saved_->next;
        isolated_ = saved_->isolated;
        expect(solver_.isolated().size() == isolated_, "others are taken out than were when it was saved");
        expect(Told<Solver>(solver_) == saved_->told, "what was restored is not what was saved");
    }

    /// A file is written, and read into another solver: both are the same. So are the bytes in memory, and
    /// those of a stream behind one another.
    void checkpoint()
    {
        TemporaryFile const file(".firn");
        int const frame = input_.byte();
        Motion const ball = around_.ball.motion;
        Solver other(lattice(cell), model_, {}, {.smallest = 1e-3});
        auto const expect_same = [&](auto const& read_into) {
            Motion motion;
            int read = -1;
            read_into(motion, read);
            expect(read == frame && motion.position == ball.position, "a companion has changed");
            expect(Told<Solver>(other) == Told<Solver>(solver_), "what was read is not what was written");
            expect(other.isolated().size() == isolated_,
                   "others are taken out than were when it was written");
        };
        write_checkpoint(file.path(), solver_, ball, frame);
        expect_same([&](auto&... to) { read_checkpoint(file.path(), other, to...); });
        if (kinds_ <= 16) return;
        std::string bytes = checkpoint_in_memory(solver_, ball, frame);
        expect(bytes == file.content(), "other bytes are in memory than in a file");
        expect_same([&](auto&... to) { restore_from_memory(bytes, other, to...); });
        std::stringstream stream;
        for (int i = 0; i < 2; ++i) write_checkpoint(stream, solver_, ball, frame);
        for (int i = 0; i < 2; ++i) expect_same([&](auto&... to) { read_checkpoint(stream, other, to...); });
        bytes[(input_.byte() * 256u + input_.byte()) % bytes.size()] ^=
            static_cast<char>(1 + input_.below(255));
        Motion motion;
        int read = -1;
        expect(refused_whole(other, [&] { restore_from_memory(bytes, other, motion, read); }),
               "a checkpoint with a byte that was changed is taken");
    }

    /// One that is restored from a snapshot makes the same step, bit by bit.
    void twin()
    {
        be_marked();
        Solver other(lattice(cell), model_, {}, {.smallest = 1e-3});
        other.restore(solver_.snapshot());
        other.quarantine(in_quarantine_);
        double const dt = std::pow(10.0, input_.between(-6, -3));
        auto const step = [&](Solver& solver) {
            return refused(
                [&] { around_.with([&](auto const&... effects) { solver.steps(1, dt, effects...); }); });
        };
        expect(step(solver_) == step(other), "one of two twins was refused");
        expect(Told<Solver>(solver_) == Told<Solver>(other), "twins differ");
        expect(solver_.isolated().size() == other.isolated().size(), "twins lost others");
    }

    struct Saved
    {
        Snapshot<Number, d> snapshot;
        std::vector<std::uint32_t> ids;
        std::vector<double> masses;
        std::uint32_t next;
        std::size_t isolated;
        Told<Solver> told;

        Saved(Snapshot<Number, d> s, std::vector<std::uint32_t> i, std::vector<double> m, std::uint32_t n,
              std::size_t gone, Told<Solver> t)
            : snapshot(std::move(s)), ids(std::move(i)), masses(std::move(m)), next(n), isolated(gone),
              told(std::move(t))
        {}
    };

    Input& input_;
    Model model_;
    int kinds_; ///< of calls
    Solver solver_;
    std::vector<std::uint32_t> ids_; ///< of the particles that exist, in rising order
    std::vector<double> masses_;     ///< [kg]
    std::uint32_t next_ = 0;
    std::size_t in_quarantine_ = 0; ///< as many may be
    std::size_t isolated_ = 0;      ///< how many of the isolated particles are gone from the books
    std::optional<Saved> saved_;
    Surroundings<Solver> around_;
    IdLookup<> lookup_;
    std::unique_ptr<FramesUnderWay> frames_;
};

/// The first byte says which scene it is.
inline void calls(Bytes bytes)
{
    Input input(bytes);
    int const scene = input.byte(), kinds = scene / 8 % 2 == 0 ? 16 : scene / 16 % 2 == 0 ? 26 : 31;
    if (scene % 32 == 31) {
        Calls<Pool>(input, materials::water<PlaneFloat>(2), kinds).run();
        return;
    }
#if defined(FIRN_FUZZ_FEW)
    Calls<MarkedSheet>(input, {materials::fresh_snow<PlaneFloat>()}, kinds).run();
#else
    if (scene % 8 == 5) {
        Calls<MarkedSheet>(input, {materials::fresh_snow<PlaneFloat>()}, kinds).run();
        return;
    }
#if defined(FIRN_FUZZ_ALL)
    if (scene % 4 == 1) {
        using Two = Materials<Sand<PlaneFloat>, Fluid<PlaneFloat>>;
        Calls<Solver<OpenMP, Two, CubicBSpline, Flip>>(
            input, {materials::dry_sand<PlaneFloat>(), materials::water<PlaneFloat>()}, kinds)
            .run();
        return;
    }
    if (scene % 4 == 2) {
        Calls<SnowBall>(input, materials::fresh_snow<SolidFloat>(), kinds).run();
        return;
    }
#endif
    Calls<Sheet>(input, materials::fresh_snow<PlaneFloat>(), kinds).run();
#endif
}

} // namespace firn::fuzz

// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/budget.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/io/checkpoint.hpp>

#include <algorithm>
#include <optional>

// Calls in any order: particles come and go, effects move, states are saved, uploaded and restored, and
// failing particles may go to the quarantine.
namespace firn::fuzz
{

constexpr double cell = 0.05;     // [m]
constexpr int wall_node = 20;     // walls at ±1 m
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
    Calls(Input& input, Model const& model)
        : input_(input), model_(model),
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
        switch (input_.below(16)) {
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
            move_ball();
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
            gravity_.acceleration = {input_.between(-20, 20), input_.between(-20, 20), 0};
            if constexpr (has_marks<Solver>) mark();
            break;
        default:
            toggle();
            break;
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
    }

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
        if (ids_.size() + points.size() > most) return;
        of_some_material([&](auto k) {
            std::uint32_t first = 0;
            if (refused_whole(solver_,
                              [&] { first = solver_.template add<Material<k>>(points, volume, velocity); }))
                return;
            expect(first == next_, "an id was given twice, or left out");
            double const density = double(solver_.template model<Material<k>>().density);
            for (std::size_t i = 0; i < points.size(); ++i) {
                ids_.push_back(next_++);
                masses_.push_back(density * volume);
            }
        });
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
            wind_.acceleration = {input_.between(-20, 20), input_.between(-20, 20), 0};
            break;
        case 4:
            grip_.motion.position = {input_.between(-1, 1), input_.between(-0.2, 1), 0};
            grip_.motion.velocity = {input_.between(-2, 2), input_.between(-2, 2), 0};
            grip_.motion.angular_velocity = {0, 0, input_.between(-5, 5)};
            grip_.beyond = input_.between(0, 0.99);
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

    /// Calls `use` with all effects.
    template <class Use>
    auto with_effects(Use const& use)
    {
        if constexpr (has_marks<Solver>)
            return with_others([&](auto const&... effects) { return use(wind_, grip_, effects...); });
        else
            return with_others(use);
    }
    template <class Use>
    auto with_others(Use const& use)
    {
        Obstacle<HalfSpace> const floor{.contact = contact_};
        ReflectingWall const left{.axis = 0, .node = -wall_node, .side = 1},
            right{.axis = 0, .node = wall_node, .side = -1};
#if defined(FIRN_FUZZ_FEW)
        return use(gravity_, floor, ball_, left, right);
#else
        return use(gravity_, floor, ball_, crates_, held_, left, right);
#endif
    }

    /// How many reactions these have.
    std::size_t reaction_count() const
    {
        std::size_t const of_marked = has_marks<Solver> ? 1 : 0;
#if defined(FIRN_FUZZ_FEW)
        return of_marked + 4;
#else
        return of_marked + 5 + crates_.list.size();
#endif
    }

    /// The change of momentum equals the impulses of gravity and of the obstacles over that time, and no
    /// particle is behind a wall.
    template <class Reactions>
    void expect_balance(Told<Solver> const& before, StepBounds const& bounds, double steps, double elapsed,
                        double beyond, Reactions const& reactions)
    {
        Told<Solver> const after(solver_);
        Vector<double, d> expected =
            before.momentum() + before.mass() * elapsed * gravity_.acceleration.template head<d>();
        // the scale of rounding errors: momenta, impulses, and the stresses' exchange of momentum within the
        // body
        double scale =
            before.momenta() + after.momenta() + before.mass() * elapsed * gravity_.acceleration.norm() +
            before.mass() * std::max(bounds.wave_speed, solver_.bounds().wave_speed) * steps * beyond;
        if constexpr (has_marks<Solver>) {
            double marked = 0; // mass
            auto const marks = solver_.template download<Mark>();
            for (std::size_t i = 0; i < marks.size(); ++i) marked += double(marks[i]) * before.masses[i];
            expected += marked * elapsed * wind_.acceleration.template head<d>();
            scale += marked * elapsed * wind_.acceleration.norm();
        }
        for (auto const& reaction : reactions) {
            expect(reaction.impulse.allFinite() && reaction.angular_impulse.allFinite(),
                   "a reaction is not finite");
            expected -= reaction.impulse.template head<d>();
            scale += reaction.impulse.norm();
        }
        double const tolerance = std::is_same_v<Number, float> ? 1e-4 : 1e-10;
        if ((after.momentum() - expected).norm() > tolerance * scale)
            broken("momentum is not that which was given",
                   std::to_string((after.momentum() - expected).norm()) + " of " + std::to_string(scale));
        for (auto const& x : after.positions)
            expect(std::abs(x[0]) <= wall_node * cell + 1e-3 * cell, "a particle is behind a wall");
    }

    void step()
    {
        double const dt = std::pow(10.0, input_.between(-7, -2));
        auto const count = static_cast<std::size_t>(1 + input_.below(4));
        Told<Solver> const before(solver_);
        StepBounds const bounds = solver_.bounds();
        std::vector<StepReport> reports;
        bool const was_refused = refused([&] {
            reports =
                with_effects([&](auto const&... effects) { return solver_.steps(count, dt, effects...); });
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
            expect(as_asked && report.reactions.size() == reaction_count(), "a report is of another step");
        }
        if (gone == 0) expect_balance(before, bounds, double(count), elapsed, beyond, reactions);
    }

    void advance()
    {
        double const exponent = input_.between(-6, -2.5);
        double const duration = std::pow(10.0, exponent);
        Told<Solver> const before(solver_);
        StepBounds const bounds = solver_.bounds();
        // of four calls one has a budget; the input is not asked, so that what was found keeps its meaning
        int const kind = static_cast<int>(-1e4 * exponent) % 16;
        Budget const budget{.steps = static_cast<std::uint64_t>(kind), .cut_last_step = kind % 2 == 0};
        bool const has_budget = kind < 4;
        AdvanceReport report;
        if (refused([&] {
                report = with_effects([&](auto const&... effects) {
                    return has_budget ? solver_.advance(duration, budget, effects...)
                                      : solver_.advance(duration, effects...);
                });
            }))
            return;
        expect(report.lost == 0, "particles were lost");
        if (has_budget) {
            double const end = before.time + duration;
            expect(report.substeps <= budget.steps, "it took more steps than it may");
            expect(std::abs(solver_.time() + report.left - end) <= 1e-12 * end,
                   "what is left is not the rest of the duration");
        }
        else
            expect(report.left == 0 && solver_.time() == before.time + duration, "it ended at another time");
        std::size_t const gone = solver_.isolated().size() - isolated_;
        expect(report.isolated.size() == gone, "the report does not tell what was taken out");
        if (gone == 0)
            expect_balance(before, bounds, double(report.substeps), report.time_of_forces, 1,
                           report.reactions);
    }

    void move_ball()
    {
        auto& motion = ball_.motion;
        if (input_.below(8) == 0)
            ball_.shape = Sphere{input_.any(0.2)};
        else
            ball_.shape = Sphere{input_.between(0.01, 0.4)};
        motion.position = {input_.between(-1, 1), input_.between(-0.2, 1), 0};
        motion.velocity = {input_.between(-10, 10), input_.between(-10, 10), 0};
        motion.angular_velocity = {0, 0, input_.between(-50, 50)};
        motion.time.reset();
        if (motion.velocity.x() > 0) motion.time = solver_.time(); // it goes on through all calls
    }

    void toggle()
    {
        int const what = input_.byte();
        ball_.on_particles = what & 1;
        ball_.contact = what & 2 ? Contact::sticky() : what & 4 ? Contact::coulomb(0.5) : Contact::slip();
        contact_ = what & 8 ? Contact::sticky() : what & 16 ? Contact::bound_slip() : Contact::coulomb(0.3);
        if (what & 32) {
            in_quarantine_ = what & 64 ? std::numeric_limits<std::size_t>::max()
                                       : static_cast<std::size_t>(input_.below(6));
            solver_.quarantine(in_quarantine_);
        }
        if (what & 128) change_crates();
    }

    /// Obstacles come, move and go, and a region is held or let go.
    void change_crates()
    {
        Motion motion{.position = {input_.between(-1, 1), input_.between(-0.2, 1), 0},
                      .velocity = {input_.between(-5, 5), input_.between(-5, 5), 0}};
        auto& list = crates_.list;
        switch (input_.below(5)) {
        case 0:
            if (list.size() < 20)
                list.push_back({.shape = Sphere{input_.between(0.01, 0.2)}, .motion = motion});
            break;
        case 1:
            if (list.size() < 20) list.push_back({.shape = Box{{0.1, 0.05, 0.1}}, .motion = motion});
            break;
        case 2:
            if (!list.empty()) list.erase(list.begin() + input_.below(int(list.size())));
            break;
        case 3:
            for (auto& crate : list) crate.motion.velocity = motion.velocity;
            break;
        default:
            held_.motion = motion;
            held_.shape.radius = input_.between(0.01, 0.1);
            break;
        }
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

    /// A file is written, and read into another solver: both are the same.
    void checkpoint()
    {
        TemporaryFile const file(".firn");
        int const frame = input_.byte();
        write_checkpoint(file.path(), solver_, ball_.motion, frame);
        Solver other(lattice(cell), model_, {}, {.smallest = 1e-3});
        Motion motion;
        int read = -1;
        read_checkpoint(file.path(), other, motion, read);
        expect(read == frame && motion.position == ball_.motion.position, "a companion has changed");
        expect(Told<Solver>(other) == Told<Solver>(solver_), "what was read is not what was written");
        expect(other.isolated().size() == isolated_, "others are taken out than were when it was written");
    }

    /// One that is restored from a snapshot makes the same step, bit by bit.
    void twin()
    {
        Solver other(lattice(cell), model_, {}, {.smallest = 1e-3});
        other.restore(solver_.snapshot());
        other.quarantine(in_quarantine_);
        double const dt = std::pow(10.0, input_.between(-6, -3));
        auto const step = [&](Solver& solver) {
            return refused(
                [&] { with_effects([&](auto const&... effects) { solver.steps(1, dt, effects...); }); });
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
    Solver solver_;
    std::vector<std::uint32_t> ids_; ///< of the particles that exist, in rising order
    std::vector<double> masses_;     ///< [kg]
    std::uint32_t next_ = 0;
    std::size_t in_quarantine_ = 0; ///< as many may be
    std::size_t isolated_ = 0;      ///< how many of the isolated particles are gone from the books
    std::optional<Saved> saved_;
    Gravity gravity_;
    MarkedForce<Mark> wind_;
    HeldMarked<Mark> grip_{.beyond = 0.9};
    Contact contact_ = Contact::coulomb(0.3);
    Obstacles<> crates_;
    Held<Sphere> held_{.shape = {1e-3}, .motion = {.position = {50, 50, 0}}}; // holds nothing yet
    Obstacle<Sphere> ball_{.shape = {0.2}, .motion = {.position = {0.3, 0.1, 0}}};
};

/// The first byte says which scene it is.
inline void calls(Bytes bytes)
{
    Input input(bytes);
    [[maybe_unused]] int const scene = input.byte();
#if defined(FIRN_FUZZ_FEW)
    Calls<MarkedSheet>(input, {materials::fresh_snow<PlaneFloat>()}).run();
#else
    if (scene % 8 == 5) {
        Calls<MarkedSheet>(input, {materials::fresh_snow<PlaneFloat>()}).run();
        return;
    }
#if defined(FIRN_FUZZ_ALL)
    if (scene % 4 == 1) {
        using Two = Materials<Sand<PlaneFloat>, Fluid<PlaneFloat>>;
        Calls<Solver<OpenMP, Two, CubicBSpline, Flip>>(
            input, {materials::dry_sand<PlaneFloat>(), materials::water<PlaneFloat>()})
            .run();
        return;
    }
    if (scene % 4 == 2) {
        Calls<SnowBall>(input, materials::fresh_snow<SolidFloat>()).run();
        return;
    }
#endif
    Calls<Sheet>(input, materials::fresh_snow<PlaneFloat>()).run();
#endif
}

} // namespace firn::fuzz

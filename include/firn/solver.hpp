// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/particle_table.hpp>
#include <firn/phases/conclude_step.hpp>
#include <firn/phases/move_particles.hpp>
#include <firn/report.hpp>
#include <firn/transfer/mls.hpp>

#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

namespace firn
{

/// An explicit Material Point Method solver for one material.
///
/// `Backend` says where it runs, `Model` what the material is (and with its Space the dimension and
/// precision), `Kernel` and `Transfer` how particles and grid exchange what they hold. All input in SI units.
/// Not to be called from two threads at once; two solvers are independent. One that was moved from may only
/// be destroyed or assigned.
template <class Backend, class ModelType, InterpolationKernel Kernel = QuadraticBSpline,
          class TransferType = Mls>
class Solver
{
public:
    using Model = ModelType;
    using Transfer = TransferType;
    using Space = typename Model::Space;
    using Number = typename Space::Real;
    using kernel = Kernel;
    static constexpr int d = Space::dimension;
    using Real = typename Backend::template Lane<Number>;
    static_assert(ConstitutiveModel<Model, Real>,
                  "the model lacks `Response<Real, d> respond(state&, velocity_gradient, dt) const`, "
                  "a density, a State or validate(): see firn/concepts.hpp");
    static_assert(TransferScheme<Transfer, Kernel, Real, d>,
                  "the transfer scheme lacks give or take: see firn/concepts.hpp");

    /// A particle's fields beside position and id: the union of what transfer and model declare.
    using State = Join<typename Transfer::State, typename Model::State>;
    /// Those that are stored from step to step, and those that particles take from the grid when asked for.
    using Stored = Join<typename Transfer::Stored, typename Model::State>;
    using Taken = Without<typename Transfer::State, Stored>;
    using Table = ParticleTable<Backend, Space, Stored, Taken>;

    /// The bytes of what is stored of one particle: its position, its fields and its permanent id.
    static constexpr std::size_t state_bytes_per_particle = Table::state_bytes;
    /// All resident bytes per particle: two buffers of that, and the index of the cell order.
    static constexpr std::size_t bytes_per_particle = Table::resident_bytes;

    explicit Solver(Lattice lattice, Model model = {}, Transfer transfer = {}, StepControl control = {},
                    Backend backend = {})
        : lattice_(firn::lattice(lattice.cell_size, lattice.origin)), model_(std::move(model)),
          transfer_(transfer), control_(control), backend_(std::move(backend)),
          particles_(lattice_, Kernel::order, backend_), grid_(backend_), now_(backend_), log_(backend_)
    {
        model_.validate();
        control_.validate();
        backend_.validate();
        if constexpr (requires { transfer_.validate(); }) transfer_.validate();
    }

    /// Adds particles at `points` [m] with the given volume each [m^3] and one velocity [m/s], at rest
    /// otherwise; their mass is the model's density times the volume. Returns the id of the first: ids are
    /// consecutive and permanent.
    ///
    /// `points` is any contiguous range of Eigen vectors of d components. Throws an Error, and adds none, if
    /// a point is not finite or out of the range of cell coordinates, or the volume is not above 0.
    template <class Points>
    std::uint32_t add(Points const& points, double volume_per_point,
                      Vector<double, d> const& velocity = Vector<double, d>::Zero())
    {
        hold_taken();
        auto const first = particles_.add(points, volume_per_point, double(model_.density), velocity);
        if (particles_.size() == first) return first;
        given_for_ = 0;
        auto at_rest = Record<Number, d, typename Model::State>::at_rest();
        auto const response = model_.template respond<Number>(at_rest, Matrix<Number, d>::Zero(), Number(0));
        course_.bounds.wave_speed = std::max(course_.bounds.wave_speed, wave_speed(response.wave_modulus));
        course_.bounds.speed = std::max(course_.bounds.speed, velocity.norm());
        return first;
    }

    /// Sets a field of all particles, by id: velocities, an affine velocity, or a part of the model's state.
    /// Throws an Error, and changes nothing, unless there is one finite value per particle.
    template <class Tag>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        static_assert(State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        require(by_id.size() == size(), "there is not one value per particle", "Solver::upload",
                "Pass size() values, by id.");
        for (auto value : by_id)
            for_each_component<Tag, d>(value, [](int, Number number) {
                require(std::isfinite(number), "a value is not finite", "Solver::upload",
                        "Pass finite values.");
            });
        hold_taken();
        if constexpr (Stored::template contains<Tag>)
            particles_.edit([&](std::uint32_t id, auto& particle) { particle[Tag{}] = by_id[id]; });
        else
            particles_.held().template set<Tag>(by_id);
        given_for_ = 0;
        find_bounds();
    }

    /// Advances the simulation by one time step of length `dt` [s].
    ///
    /// A `dt` above the stable one is taken, with a warning in the report. A step that goes wrong changes
    /// nothing and throws an Error that names particle, place, time and cause. (If it was within the stable
    /// one, velocities that are not stored, see Taken, are then taken anew from what particles gave to the
    /// grid: momentum and uniform or affine motion are exact, the rest is smoothed by one transfer.)
    template <NodeEffect<Number, d>... Effects>
    StepReport step(double dt, Effects const&... effects)
    {
        return std::move(steps(1, dt, effects...).front());
    }

    /// Advances the simulation by `count` time steps of length `dt` [s], one report each. The same as so many
    /// calls of step(), but a device need not wait for the host between them.
    template <NodeEffect<Number, d>... Effects>
    std::vector<StepReport> steps(std::size_t count, double dt, Effects const&... effects)
    {
        require(std::isfinite(dt) && dt > 0, "the time step is not a finite number above 0", "Solver::step",
                "Pass seconds.");
        (validate(effects), ...);
        StepRule rule = rule_for(effects...);
        rule.equal = dt;
        auto const plain = plain_effects(effects...);
        std::vector<StepReport> reports;
        while (reports.size() < count) {
            if (!course_.ready) choose(rule);
            bool const beyond_stable = dt > course_.stable;
            if (beyond_stable) hold_taken(); // it may go wrong
            std::size_t const most = beyond_stable ? 1 : count - reports.size();
            StepLog const& log = run(rule, most, plain, [&](auto const& record) {
                reports.push_back(report_of(record));
                reports.back().beyond_stable = dt > record.stable;
            });
            if (log.wrong > 0) fail(log, dt);
        }
        course_.ready = false;
        return reports;
    }

    /// Advances the simulation by `duration` [s] in as many stable steps as needed.
    ///
    /// A step that goes wrong is repeated with half its length; after StepControl::retries halvings that is
    /// an Error that names particle, place, time and cause, and the state is that of the last good step (but
    /// see step() for velocities).
    template <NodeEffect<Number, d>... Effects>
    AdvanceReport advance(double duration, Effects const&... effects)
    {
        require(std::isfinite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
                "Solver::advance", "Pass seconds, e.g. 1.0 / 24.");
        (validate(effects), ...);
        StepRule rule = rule_for(effects...);
        rule.duration = duration;
        rule.end = course_.time + duration;
        auto const plain = plain_effects(effects...);
        AdvanceReport report;
        while (rule.goes_on(course_)) {
            if (!course_.ready) choose(rule);
            require_progress(rule);
            double const tried = course_.now.interval.length();
            // as many as there would be if all were as long as this one
            auto const most = static_cast<std::size_t>(std::ceil((rule.end - course_.time) / tried));
            StepLog const& log = run(
                rule, most, plain, [&](auto const& record) { report.add(report_of(record), record.limit); });
            if (log.wrong == 0) continue;
            ++report.rejected;
            if (++course_.retries > control_.retries) fail(log, course_.now.interval.length());
        }
        course_.ready = false;
        return report;
    }

    double time() const { return course_.time; } ///< [s]
    std::size_t size() const { return particles_.size(); }
    Lattice const& lattice() const { return lattice_; }
    Model const& model() const { return model_; }
    Transfer const& transfer() const { return transfer_; }
    Backend const& backend() const { return backend_; }

    /// What the next time step depends on.
    StepBounds const& bounds() const { return course_.bounds; }

    /// World positions [m], by id.
    std::vector<Vector<double, d>> positions() const { return particles_.positions(); }

    /// A field's values, by id: `download<Velocity>()`.
    template <class Tag>
    std::vector<FieldValue<Tag, Number, d>> download() const
    {
        if constexpr (Stored::template contains<Tag>)
            return particles_.template download<Tag>();
        else if (particles_.holds_taken())
            return particles_.held().template by_id<Tag>(size());
        else {
            auto const taken = particles_.new_taken();
            take_again(taken.view());
            return taken.template by_id<Tag>(size());
        }
    }

    /// A stored field where it lies, in memory of the backend: `view<DisplacementGradient>()`. Nothing is
    /// copied; it holds until the next call that changes the scene.
    template <class Tag>
    auto view() const
    {
        static_assert(Stored::template contains<Tag>,
                      "this field is taken from the grid when asked for: use download, or write_positions");
        return particles_.template view<Tag>();
    }

    /// Writes world positions [m], by id, to memory that the backend's loops reach: axis a of particle i goes
    /// to `to[i * stride + a]`. On a device the work is queued in the backend's stream: a renderer's buffer
    /// that was mapped there needs no copy.
    void write_positions(Number* to, std::size_t stride = d) const
    {
        require(to != nullptr && stride >= d, "there is no place for positions, or they would overlap",
                "Solver::write_positions",
                "Pass room for size() times stride numbers, stride at least the dimension.");
        backend_.for_each_place(particles_.cells(), particles_.position_writer(to, stride));
    }

    /// Masses [kg], by id.
    std::vector<double> masses() const { return particles_.masses(); }

    /// Bytes held by particles and grid, spare capacity included.
    std::size_t memory() const { return particles_.memory() + grid_.memory(); }

private:
    using Grid = typename Backend::template Grid<Number, d, Kernel::order,
                                                 NodeSums<d, Transfer::keeps_old_velocity>::channels,
                                                 NodeVelocities<d, Transfer::keeps_old_velocity>::channels>;

    /// How the steps of a call with these effects are chosen.
    template <class... Effects>
    StepRule rule_for(Effects const&... effects)
    {
        course_.ready = false; // it was for other effects, and another end
        course_.retries = 0;
        double expansion_ratio = d; // the largest there is, for models that do not say
        if constexpr (requires { model_.elasticity.expansion_ratio(d); })
            expansion_ratio = model_.elasticity.expansion_ratio(d);
        StepRule rule{.control = control_,
                      .cell_size = lattice_.cell_size,
                      .wave_limit = isolated_limit<Kernel, Transfer>(expansion_ratio)};
        if constexpr (Viscous<Model>)
            rule.shear_limit = shear_limit(rule.wave_limit, model_.kinematic_viscosity(), lattice_.cell_size,
                                           expansion_ratio);
        [[maybe_unused]] auto const ask = [&](auto const& effect) {
            if constexpr (requires { effect.largest_acceleration(); })
                rule.acceleration = std::max(rule.acceleration, effect.largest_acceleration());
            if constexpr (requires { effect.largest_speed(); })
                rule.obstacle_speed = std::max(rule.obstacle_speed, effect.largest_speed());
        };
        (ask(effects), ...);
        return rule;
    }

    /// Chooses the next step, by what the host knows.
    void choose(StepRule const& rule)
    {
        if (course_.given.interval.length() != given_for_) course_.given = {};
        rule.choose(course_);
    }

    /// Takes the step that was chosen and those after it, `most` in all: as many as the backend queues, and
    /// as long as they go as planned. `visit` is called with the record of each. A step that goes wrong
    /// leaves the particles, and what they gave, as it was.
    template <class Effects, class Visit>
    StepLog const& run(StepRule const& rule, std::size_t most, Effects const& effects, Visit const& visit)
    {
        using Actions = decltype(effects.template during<Number, d>(Interval{}));
        using Now = StepNow<Number, Actions>;
        using Log = RunLog<Actions::obstacles>;
        static_assert(std::is_trivially_destructible_v<Now>, "an effect's action is a plain value");
        int const expected = static_cast<int>(
            std::min<std::size_t>(most, std::min(queue_, backend_.steps_to_queue(particles_.cells()))));
        using Rule = RunRule<Effects>;
        // an obstacle's quaternion is aligned more strictly than the two before it are long
        constexpr std::size_t rule_at = (2 * sizeof(Now) + alignof(Rule) - 1) / alignof(Rule) * alignof(Rule);
        now_.resize(std::max(now_.size(), rule_at + sizeof(Rule)));
        log_.resize(Log::bytes(expected));
        auto* const now = reinterpret_cast<Now*>(now_.data()); // of steps in turn
        Log const log = Log::over(log_.data(), expected);
        auto* const kept_rule = reinterpret_cast<Rule*>(now_.data() + rule_at);
        int const turn = now_turn_;

        auto& cells = particles_.cells();
        particles_.sort();   // into the order of cells
        grid_.follow(cells); // blocks of nodes under them
        give_for(course_.now.interval.length());
        backend_.for_each(Log::places(expected),
                          BeginSteps<Number, d, Effects, Actions>{
                              course_, {rule, double(model_.density), effects}, kept_rule, log, now + turn});
        // Only obstacles that push particles set what cannot be taken again.
        bool const held = particles_.holds_taken(),
                   pushed = Taken::components(d) > 0 && effects.touch_particles();
        using Update = UpdateGrid<Space, Transfer, Actions>;
        using Move = MoveParticles<Space, Model, Kernel, Transfer, Actions, Stored, Taken>;
        auto const update = [&](int step) {
            return backend_.for_each_node(cells, grid_,
                                          Update{now + (turn + step) % 2, lattice_, smallest_node_mass()});
        };
        auto const move = [&](int step) {
            return Move{model_,
                        transfer_,
                        now + (turn + step) % 2,
                        particles_.current(),
                        particles_.next(),
                        pushed ? particles_.next_taken() : typename Table::TakenView{},
                        particles_.portions(),
                        lattice_,
                        Number(control_.rejection)};
        };
        auto const conclude = [&](int step) {
            return ConcludeStep<Number, d, Effects, Actions>{kept_rule, log, step,
                                                             now + (turn + step + 1) % 2};
        };

        auto reacted = update(0);
        int queued = 1;
        for (;; reacted = update(queued++)) {
            backend_.move(cells, grid_, move(queued - 1), reacted, conclude(queued - 1));
            if (queued == expected) break;
            accept(pushed); // as is to be expected
            particles_.sort();
            backend_.template scatter_movers<Scatter>(cells, grid_);
        }
        Log heard = Log::over(const_cast<unsigned char*>(log_.fetch()), expected);
        bool lacked = false;
        if constexpr (Backend::queues)
            if (lacked = cells.listen(); lacked) { // a step lacked room, and those after it did nothing
                int const lacking = static_cast<int>(*heard.taken) - (wrong_after(heard) ? 0 : 1);
                take_back(queued - 1 - lacking, queued - 1 - lacking, pushed);
                queued = lacking + 1;
                do {
                    adopt(heard.at[lacking].course, lacking, true, pushed, held);
                    backend_.complete(cells, grid_, move(lacking), reacted, conclude(lacking));
                    heard = Log::over(const_cast<unsigned char*>(log_.fetch()), expected);
                } while (cells.listen());
            }
        int const taken = static_cast<int>(*heard.taken);
        spoiled_ = taken < queued && wrong_after(heard);
        if (taken == queued)
            accept(pushed);
        else if constexpr (Backend::queues)
            take_back(queued - 1 - taken, queued - 1 - taken + (spoiled_ ? 0 : 1), pushed);
        StepLog const& last = heard.at[taken + (spoiled_ ? 1 : 0)];
        adopt(last.course, taken, spoiled_, pushed, held);
        now_turn_ = (turn + taken) % 2;
        queue_ =
            taken == expected && !lacked ? std::max<std::size_t>(queue_, 2 * taken) : std::max(taken / 2, 1);
        for (int i = 0; i < taken; ++i) visit(heard.records[i]);
        return last;
    }

    /// Whether the step after those that were taken went wrong.
    template <class Log>
    static bool wrong_after(Log const& log)
    {
        return log.at[*log.taken + 1].wrong > 0;
    }

    /// Takes over what is known of the steps of a run; `begun` says whether one more was begun and not made.
    void adopt(Course const& course, int taken, bool begun, bool pushed, bool held)
    {
        course_ = course;
        particles_.set_held(taken > 0 ? pushed : held, held);
        if (taken == 0) return;
        given_for_ = course_.given.interval.length();
        movers_gave_ = begun;
    }

    /// Takes a step that was made, or soon will be, for done.
    void accept(bool pushed)
    {
        particles_.accept(pushed);
        grid_.accept();
    }

    /// Undoes that, and sort(), for steps that were queued and then not made.
    void take_back(int accepted, int sorted, bool pushed) requires Backend::queues
    {
        particles_.take_back(accepted, sorted, pushed);
        if (accepted % 2 != 0) grid_.accept(); // what was swapped is swapped back
    }

    template <class Record>
    StepReport report_of(Record const& record) const
    {
        StepReport report;
        report.dt = record.dt;
        report.stable_dt = record.stable;
        report.capped = record.capped;
        for (Reaction const& received : record.reactions.of)
            report.reactions.push_back({received.impulse * particles_.mass_unit(),
                                        received.angular_impulse * particles_.mass_unit()});
        return report;
    }

    using Scatter = ParticlesToGrid<Space, Model, Kernel, Transfer, Stored, Taken>;

    Scatter scatter(double dt, bool impulse_only)
    {
        return {{},
                model_,
                transfer_,
                particles_.current(),
                particles_.taken(),
                particles_.portions(),
                static_cast<Number>(dt),
                static_cast<Number>(lattice_.cell_size),
                impulse_only};
    }

    /// Brings the sums on the grid to what particles give to a step of this length [s]: they may have given
    /// already, and for another length.
    void give_for(double dt)
    {
        auto const& cells = particles_.cells();
        if (given_for_ == 0)
            backend_.scatter(cells, grid_, scatter(dt, false), true);
        else {
            if (!movers_gave_) backend_.template scatter_movers<Scatter>(cells, grid_);
            if (given_for_ != dt) backend_.scatter(cells, grid_, scatter(dt - given_for_, true), false);
        }
        movers_gave_ = true;
        given_for_ = dt;
    }

    /// The fields that particles take from the grid, as they took them in the last step.
    void take_again(typename Table::TakenView const& taken) const
    {
        if constexpr (Taken::components(d) > 0)
            backend_.take(
                particles_.cells(), grid_,
                TakeVelocities<Space, Kernel, Transfer, Stored, Taken>{
                    {}, transfer_, particles_.ordered(), taken, static_cast<Number>(lattice_.cell_size)});
    }

    /// Holds them beside the particles, before what they are taken from changes.
    void hold_taken()
    {
        if (particles_.holds_taken()) return;
        take_again(particles_.place_for_taken());
        particles_.hold_taken();
    }

    /// After a step that went wrong: the grid no longer has the velocities that particles took, but still
    /// what they gave. They take from that, without the forces of the step.
    void regain_velocities()
    {
        if (!spoiled_ || particles_.holds_taken()) return;
        auto& cells = particles_.cells();
        backend_.scatter(cells, grid_, scatter(-given_for_, true), false);
        given_for_ = 0;
        backend_.for_each_node(cells, grid_,
                               UpdateGrid<Space, Transfer, Chain<>>{
                                   reinterpret_cast<StepNow<Number, Chain<>> const*>(now_.data()), lattice_,
                                   smallest_node_mass()});
        hold_taken();
        spoiled_ = false;
    }

    /// The bounds of the next step, for states set from outside.
    void find_bounds()
    {
        course_.bounds = {};
        double modulus = 0;
        particles_.for_each([&](auto& particle) {
            modulus = std::max(
                modulus,
                double(model_.template respond<Number>(particle, Matrix<Number, d>::Zero(), Number(0))
                           .wave_modulus));
        });
        for (auto const& velocity : download<Velocity>())
            course_.bounds.speed = std::max(course_.bounds.speed, double(velocity.norm()));
        course_.bounds.wave_speed = wave_speed(modulus);
    }

    double wave_speed(double modulus) const { return std::sqrt(modulus / double(model_.density)); }

    /// Below this share of a particle's mass, a node's momentum is rounding alone.
    Number smallest_node_mass() const
    {
        return particles_.largest_mass() * (std::is_same_v<Number, float> ? Number(1e-20) : Number(1e-40));
    }

    template <class Effect>
    static void validate(Effect const& effect)
    {
        if constexpr (requires { Effect::in_host_memory; })
            static_assert(Backend::reaches_host_memory || !Effect::in_host_memory,
                          "the obstacle's shape lies in memory of the host: pass `shape.on(backend)`");
        effect.validate();
        if constexpr (d == 2 && requires { effect.validate_in_plane(); }) effect.validate_in_plane();
    }

    void require_progress(StepRule const& rule)
    {
        if (rule.gets_on(course_)) return;
        regain_velocities();
        std::ostringstream what, where, remedy;
        what << "the stable time step fell to " << course_.now.interval.length() << " s, bounded by "
             << describe(course_.now.limit);
        where << "Solver::advance at t = " << course_.time << " s";
        remedy << "Check masses, moduli and velocities of the scene: wave speed " << course_.bounds.wave_speed
               << " m/s, fastest particle " << course_.bounds.speed << " m/s.";
        throw Error{what.str(), where.str(), remedy.str()};
    }

    [[noreturn]] void fail(StepLog const log, double dt) // a copy: what follows is logged, too
    {
        regain_velocities();
        std::ostringstream what, where;
        what << "particle " << log.particle << " " << describe(log.mishap);
        if (log.wrong > 1) what << ", as did " << log.wrong - 1 << " more";
        where << "at (" << particles_.position(log.particle).transpose() << ") m, in a step of " << dt
              << " s at t = " << course_.time << " s";
        throw Error{what.str(), where.str(),
                    "The state is that of the last good step. Take a smaller step, or look at what drives "
                    "this particle: "
                    "obstacles that close in on it, or a material far too stiff or too soft for its speed."};
    }

    Lattice lattice_;
    Model model_;
    Transfer transfer_;
    StepControl control_;
    Backend backend_;
    Table particles_;
    Grid grid_;
    Course course_;
    typename Backend::template Array<unsigned char> now_;  ///< two StepNow and a RunRule, of whatever effects
    typename Backend::template Outbox<unsigned char> log_; ///< a RunLog
    int now_turn_ = 0;      ///< which of the two it is that the next step finds
    std::size_t queue_ = 1; ///< as many steps are worth while to queue: it went well with half as many
    double given_for_ = 0;  ///< the grid holds what particles give to a step of this length [s]; 0: nothing
    bool movers_gave_ = false; ///< so have those that changed their cells since
    bool spoiled_ = false;     ///< a step went wrong: nodes do not hold the velocities of the last good one
};

} // namespace firn

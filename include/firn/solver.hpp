// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/particle_table.hpp>
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
          particles_(lattice_, Kernel::order, backend_), grid_(backend_)
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
        bounds_.wave_speed = std::max(bounds_.wave_speed, wave_speed(response.wave_modulus));
        bounds_.speed = std::max(bounds_.speed, velocity.norm());
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
        require(std::isfinite(dt) && dt > 0, "the time step is not a finite number above 0", "Solver::step",
                "Pass seconds.");
        (validate(effects), ...);
        double const stable = stable_step(effects...).dt;
        Interval const now{time_, time_ + dt};
        if (dt > stable) hold_taken();              // it may go wrong
        Interval const next{now.end, now.end + dt}; // who takes equal steps is expected to go on so
        Attempt attempted = attempt(now, next.length(), effects...);
        if (attempted.wrong > 0) fail(attempted, dt);
        attempted.report.stable_dt = stable;
        attempted.report.beyond_stable = dt > stable;
        return std::move(attempted.report);
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
        AdvanceReport report;
        double const end = time_ + duration;
        for (int retries = 0; time_ < end;) {
            PlannedStep const chosen = choose(end, retries, effects...);
            require_progress(chosen, duration);
            PlannedStep const next =
                plan_after(chosen, chosen.interval.end < end ? end : end + duration, effects...);
            Attempt const attempted = attempt(chosen.interval, next.interval.length(), effects...);
            if (attempted.wrong > 0) {
                ++report.rejected;
                if (++retries > control_.retries) fail(attempted, chosen.interval.length());
                continue;
            }
            if (chosen.limit != StepLimit::duration || retries > 0) previous_dt_ = chosen.interval.length();
            retries = 0;
            planned_ = next;
            report.add(attempted.report, chosen.limit);
        }
        return report;
    }

    double time() const { return time_; } ///< [s]
    std::size_t size() const { return particles_.size(); }
    Lattice const& lattice() const { return lattice_; }
    Model const& model() const { return model_; }
    Transfer const& transfer() const { return transfer_; }
    Backend const& backend() const { return backend_; }

    /// What the next time step depends on.
    StepBounds const& bounds() const { return bounds_; }

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
        else
            return take_again().template by_id<Tag>(size());
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

    /// A step that was planned by the bounds of one step before may be so much longer than the bounds of now,
    /// for which StepControl's safety factors have room, and so much shorter: giving afresh costs more.
    static constexpr double longest_plan = 1.02, shortest_plan = 0.75;

    /// What became of a step that was tried.
    struct Attempt
    {
        StepReport report;
        std::uint64_t wrong = 0; ///< particles with a mishap; if any, nothing has changed
        Mishap mishap = Mishap::none;
        std::uint32_t particle = 0;
    };

    /// The step: to the grid, on the grid, back to the particles and at once to the grid of the next step,
    /// which should be `next_dt` long. One that goes wrong leaves the particles, and what they gave, as it
    /// was.
    template <class... Effects>
    Attempt attempt(Interval const& interval, double next_dt, Effects const&... effects)
    {
        auto const actions = chain<Number, d>(interval, effects...);
        using Actions = std::remove_const_t<decltype(actions)>;
        particles_.sort(); // into the order of cells
        auto& cells = particles_.cells();
        grid_.follow(cells); // blocks of nodes under them
        give_for(interval.length());
        using Update = UpdateGrid<Space, Transfer, Actions>;
        // What a backend returns here may only become the result once the step is through.
        auto const reactions =
            backend_.for_each_node(cells, grid_, Update{actions, lattice_, smallest_node_mass()});
        // Only obstacles that push particles set what cannot be taken again.
        std::optional<typename Table::Taken> velocities;
        bool const pushed = Taken::components(d) > 0 && touches_particles(actions);
        if (pushed) velocities = particles_.new_taken();
        using Move = MoveParticles<Space, Model, Kernel, Transfer, Actions, Stored, Taken>;
        auto const found =
            backend_.move(cells, grid_,
                          Move{model_, transfer_, actions, particles_.current(), particles_.next(),
                               pushed ? velocities->view() : typename Table::TakenView{},
                               particles_.portions(), lattice_, static_cast<Number>(interval.length()),
                               static_cast<Number>(next_dt), Number(control_.rejection)});
        spoiled_ = found.wrong > 0;
        if (!spoiled_) {
            particles_.accept();
            particles_.forget_taken();
            if (pushed) particles_.hold_taken(std::move(*velocities));
            grid_.accept();
            given_for_ = next_dt;
            movers_gave_ = false;
        }
        return finish<typename Update::Result>(interval, reactions, found);
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
    typename Table::Taken take_again() const
    {
        auto taken = particles_.new_taken();
        if constexpr (Taken::components(d) > 0)
            backend_.take(particles_.cells(), grid_,
                          TakeVelocities<Space, Kernel, Transfer, Stored, Taken>{
                              {},
                              transfer_,
                              particles_.ordered(),
                              taken.view(),
                              static_cast<Number>(lattice_.cell_size)});
        return taken;
    }

    /// Holds them beside the particles, before what they are taken from changes.
    void hold_taken()
    {
        if (!particles_.holds_taken()) particles_.hold_taken(take_again());
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
                               UpdateGrid<Space, Transfer, Chain<>>{{}, lattice_, smallest_node_mass()});
        hold_taken();
        spoiled_ = false;
    }

    /// Accepts the step unless something went wrong in it; keeps what bounds the next one.
    template <class Reacted, class Found>
    Attempt finish(Interval const& interval, Reacted const& reactions, Found const& found)
    {
        Attempt attempted;
        attempted.wrong = found.wrong;
        attempted.mishap = found.mishap;
        attempted.particle = found.particle;
        if (found.wrong > 0) return attempted;

        time_ = interval.end;
        bounds_.wave_speed = wave_speed(found.wave_modulus);
        bounds_.speed = std::sqrt(found.speed2);
        bounds_.deformation_rate = std::sqrt(found.deformation);
        bounds_.obstacle_speed = std::sqrt(reactions.largest_surface_speed2);

        attempted.report.dt = interval.length();
        attempted.report.capped = found.capped;
        for (std::size_t i = 0; i < reactions.of.size(); ++i) {
            Reaction both = reactions.of[i];
            both += found.reactions.of[i];
            attempted.report.reactions.push_back(
                {both.impulse * particles_.mass_unit(), both.angular_impulse * particles_.mass_unit()});
        }
        return attempted;
    }

    /// The bounds of the next step, for states set from outside.
    void find_bounds()
    {
        bounds_ = {};
        double modulus = 0;
        particles_.for_each([&](auto& particle) {
            modulus = std::max(
                modulus,
                double(model_.template respond<Number>(particle, Matrix<Number, d>::Zero(), Number(0))
                           .wave_modulus));
        });
        for (auto const& velocity : download<Velocity>())
            bounds_.speed = std::max(bounds_.speed, double(velocity.norm()));
        bounds_.wave_speed = wave_speed(modulus);
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

    template <class... Effects>
    ChosenStep stable_step(Effects const&... effects) const
    {
        StepBounds now = bounds_;
        [[maybe_unused]] auto const ask = [&](auto const& effect) {
            if constexpr (requires { effect.largest_acceleration(); })
                now.acceleration = std::max(now.acceleration, effect.largest_acceleration());
            if constexpr (requires { effect.largest_speed(); })
                now.obstacle_speed = std::max(now.obstacle_speed, effect.largest_speed());
        };
        (ask(effects), ...);
        if constexpr (requires { model_.kinematic_viscosity(); })
            now.viscosity = model_.kinematic_viscosity();
        double expansion_ratio = d; // the largest there is, for models that do not say
        if constexpr (requires { model_.elasticity.expansion_ratio(d); })
            expansion_ratio = model_.elasticity.expansion_ratio(d);
        return stable_time_step<Kernel, Transfer>(control_, now, lattice_.cell_size, expansion_ratio);
    }

    struct PlannedStep
    {
        Interval interval{};
        StepLimit limit = StepLimit::duration;
    };

    /// A stable step from `begin` that is not much longer than the one before and leaves no sliver before
    /// `end`; after `retries` failures, half as long each time.
    template <class... Effects>
    PlannedStep plan(double begin, double end, double previous, int retries, Effects const&... effects) const
    {
        ChosenStep step = stable_step(effects...);
        double const remaining = end - begin;
        if (previous > 0) step.bound(control_.growth * previous, StepLimit::growth);
        bool const last = step.dt >= remaining && retries == 0;
        if (step.dt >= remaining)
            step = {remaining, StepLimit::duration};
        else if (step.dt > remaining / 2)
            step = {remaining / 2, StepLimit::duration};
        step.dt =
            std::ldexp(step.dt, -retries); // half of what was tried, also where that was all that remained
        return {{begin, last ? end : begin + step.dt}, step.limit};
    }

    /// The next step: as planned one step ago, for which the particles have given already, unless the state
    /// has changed so that it would be too long or needlessly short.
    template <class... Effects>
    PlannedStep choose(double end, int retries, Effects const&... effects) const
    {
        PlannedStep const best = plan(time_, end, previous_dt_, retries, effects...);
        double const planned = planned_.interval.length(), stable = best.interval.length();
        bool const fits = planned_.interval.begin == time_ && planned_.interval.end <= end &&
                          given_for_ == planned && planned <= longest_plan * stable &&
                          planned >= shortest_plan * stable;
        return fits && retries == 0 ? planned_ : best;
    }

    /// The step after this one, as far as it can be told from the state before this one.
    template <class... Effects>
    PlannedStep plan_after(PlannedStep const& step, double end, Effects const&... effects) const
    {
        double const previous = step.limit != StepLimit::duration ? step.interval.length() : previous_dt_;
        return plan(step.interval.end, end, previous, 0, effects...);
    }

    void require_progress(PlannedStep const& step, double duration)
    {
        if (step.interval.length() > control_.smallest * duration && step.interval.end > time_) return;
        regain_velocities();
        std::ostringstream what, where, remedy;
        what << "the stable time step fell to " << step.interval.length() << " s, bounded by "
             << describe(step.limit);
        where << "Solver::advance at t = " << time_ << " s";
        remedy << "Check masses, moduli and velocities of the scene: wave speed " << bounds_.wave_speed
               << " m/s, fastest particle " << bounds_.speed << " m/s.";
        throw Error{what.str(), where.str(), remedy.str()};
    }

    [[noreturn]] void fail(Attempt const& attempted, double dt)
    {
        regain_velocities();
        std::ostringstream what, where;
        what << "particle " << attempted.particle << " " << describe(attempted.mishap);
        if (attempted.wrong > 1) what << ", as did " << attempted.wrong - 1 << " more";
        where << "at (" << particles_.position(attempted.particle).transpose() << ") m, in a step of " << dt
              << " s at t = " << time_ << " s";
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
    StepBounds bounds_;
    double time_ = 0;
    double previous_dt_ = 0;
    PlannedStep planned_;
    double given_for_ = 0; ///< the grid holds what particles give to a step of this length [s]; 0: nothing
    bool movers_gave_ = false; ///< so have those that changed their cells since
    bool spoiled_ = false;     ///< a step went wrong: nodes do not hold the velocities of the last good one
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/backend.hpp>
#include <firn/calls_of_solver.hpp>
#include <firn/checked_policies.hpp>
#include <firn/concepts.hpp>
#include <firn/core/access_guard.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/effects/validate_effects.hpp>
#include <firn/effects/wall_check.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/particles/material_sets.hpp>
#include <firn/particles/occupancy.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/sample_fields.hpp>
#include <firn/particles/volumes.hpp>
#include <firn/state/save_restore.hpp>
#include <firn/state/snapshot.hpp>
#include <firn/time_stepping/durations.hpp>
#include <firn/time_stepping/pace.hpp>
#include <firn/time_stepping/scene_state.hpp>
#include <firn/time_stepping/scene_totals.hpp>
#include <firn/time_stepping/time_loop.hpp>
#include <firn/transfer/mls.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// A Material Point Method solver.
///
/// `Backend` says where it runs, `Model` what the material is (and with its Space the dimension and
/// precision), `Kernel` and `Transfer` how particles and grid exchange mass and momentum, and `By` whether
/// steps are explicit or Implicit. All input is in SI units. One thread at a time may call a solver. With
/// OpenMP, calls that only read (const) may overlap one another. Solvers are independent: different ones may
/// be called from different threads at the same time. Unless NDEBUG is defined, a call that changes the
/// solver or copies from it while another call is under way throws an Error and changes nothing. A moved-from
/// solver may only be destroyed or assigned.
///
/// With Materials<...> as the model a scene has several materials, which share the grid and the time step.
/// `Which` then selects the material of a call, by the model's type or as Material<place>: add, upload, view,
/// write, write_positions and model need it; other calls are about all materials without it.
///
/// Values of many particles are passed and returned in the order of their permanent ids, see ids().
template <class Backend, class ModelType, InterpolationKernel KernelType = QuadraticBSpline,
          class TransferType = Mls, Integrator By = SymplecticEuler>
class Solver : public detail::CallsOfSolver<Solver<Backend, ModelType, KernelType, TransferType, By>, By>
{
    using Calls = detail::CallsOfSolver<Solver, By>;
    friend Calls;
    friend detail::CallsOfRank<Solver>;
    static_assert(detail::HasSpace<ModelType>,
                  "the model lacks 'using Space = firn::Space<d, number>', its dimension and precision");
    using List = typename detail::MaterialsOf<ModelType>::Type;
    using Every = EveryMaterial;
    using Kernel = typename detail::KernelFor<Backend, KernelType>::Type;
    using Scheme =
        SteppedBy<typename detail::TransferFor<Backend, ModelType, Kernel, TransferType>::Type, By>;
    using Sets = MaterialSets<Backend, List, Scheme>;

public:
    using Model = ModelType;                   ///< the material, or Materials<...>
    using Transfer = Scheme;                   ///< the transfer scheme between particles and grid
    using Space = typename Model::Space;       ///< dimension and precision
    using Number = typename Space::Scalar;     ///< float or double
    using kernel = Kernel;                     ///< the interpolation kernel
    static constexpr int d = Space::dimension; ///< 2 or 3
    static_assert(CompleteBackend<Backend, Number, d>, "the backend lacks a member: see firn/backend.hpp");
    using Real = typename Backend::template Lane<Number>; ///< the lane type: what a loop computes with
    static_assert(detail::are_materials<Real, List>,
                  "what is said to be a material is none: see ConstitutiveModel in firn/concepts.hpp");
    static_assert(detail::are_carried<Real, d>(static_cast<CarriedBy<Transfer>*>(nullptr)),
                  "what the transfer is to carry is no field: see CarriedField in firn/concepts.hpp");
    static constexpr std::size_t materials = Sets::count; ///< how many materials there are

    /// The types and sizes of one material: see MaterialSets::MaterialTraits.
    template <class Which = Every>
    struct MaterialTraits : Sets::template MaterialTraits<detail::PlaceOf<Which, List>::value>
    {
        static constexpr std::size_t place = detail::PlaceOf<Which, List>::value; ///< its index
    };

    using State = typename Sets::CommonState; ///< the fields that particles of all materials have
    /// MaterialTraits' bytes; of several materials, the largest.
    static constexpr std::size_t state_bytes_per_particle = Sets::state_bytes_per_particle;
    static constexpr std::size_t bytes_per_particle = Sets::bytes_per_particle; ///< both buffers, order

    /// An empty scene. Throws an Error if a parameter is outside its range, or if the backend cannot run on
    /// this machine.
    explicit Solver(Lattice lattice, Model model = {}, Transfer transfer = {}, StepControl control = {},
                    Backend backend = {})
        : scene_(lattice, List(std::move(model)), transfer, std::move(backend)), time_loop_(control, scene_)
    {
        scene_.sets.validate();
        control.validate();
        scene_.backend.validate();
        if constexpr (requires { transfer.validate(); }) transfer.validate();
    }

    /// Adds particles of a material at `points` [m] with the same velocity [m/s], otherwise at rest.
    /// `volumes` [m^3] is that of each, or an array of one for each; times the model's density it is the
    /// mass. Returns the id of the first: ids are permanent, and consecutive over all calls and materials.
    /// `points` are vectors of d components, Eigen's or a host's, or points_of() of an array. Throws an
    /// Error, and adds none, if a point is not finite or beyond all cells, or a volume is not above 0.
    template <class Which = Every, class Points>
    std::uint32_t add(Points const& points, Volumes const& volumes,
                      Vector<double, d> const& velocity = zeros<Vector<double, d>>())
    {
        constexpr std::size_t k = MaterialTraits<Which>::place;
        std::uint32_t first = 0;
        change("Solver::add", [&] {
            first = scene_.next_id;
            bool const are_first = size() == 0;
            if (scene_.template add<k>(points, volumes, velocity) == 0) return;
            walls_.forget();
            time_loop_.next_step().template admit<k>(scene_, norm(velocity), are_first);
        });
        return first;
    }

    /// Removes the particles for which a predicate is true: `predicate(position)` [m], or
    /// `predicate(position, particle)` with `particle[Velocity{}]` and its other fields. Returns how many.
    /// The others keep their ids and all their values, bit by bit.
    /// `predicate` is a function object that may be called where the backend's loops run: for example
    /// Inside{shape} or Outside{shape}, or for a device one of your own that is FIRN_HOST_DEVICE. It must not
    /// throw: exceptions cannot leave the loops.
    template <class Which = Every, class Predicate>
    std::size_t remove_if(Predicate const& predicate)
    {
        std::size_t count = 0;
        change("Solver::remove_if", [&] {
            detail::validate_predicate<Backend, d>(predicate);
            count = scene_.template remove_if<place_of<Which>>(predicate);
            if (count > 0) scene_.change([&] { time_loop_.next_step().follow_removal(scene_); });
        });
        return count;
    }

    /// Sets a field of all particles of a material, by rising id: velocities, an affine velocity, or a part
    /// of the model's state. Throws an Error, and changes nothing, unless there is one value per particle,
    /// each finite and in the field's range, and the model accepts all resulting states.
    template <class Tag, class Which = Every>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        static_assert(MaterialTraits<Which>::State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        change("Solver::upload", [&] {
            scene_.template upload<Tag, MaterialTraits<Which>::place>(by_id);
            scene_.change([&] { time_loop_.next_step().find_bounds(scene_); });
        });
    }

    /// From now on up to `most` particles in all may be removed from the scene, one after another, where a
    /// step fails because of them however short it is, or at the length passed to step(). The run goes on
    /// without them, and its report names them (see isolated()). All other particles keep all their values,
    /// bit by bit, as with remove_if(). One removal more than `most` is an error.
    /// The gathered fields are then cached beside the particles in every step. A snapshot, and so a
    /// checkpoint, has the list of removed particles. `most` stays the solver's own; removals on a restored
    /// list count towards it.
    void quarantine(std::size_t most)
    {
        change("Solver::quarantine", [&] {
            scene_.cache_grid_fields();
            time_loop_.quarantine(most);
        });
    }

    /// Advances the simulation by one time step of length `dt` [s].
    ///
    /// A `dt` above the stable one is taken, with a warning in the report. A failed step moves nothing and
    /// throws a StepError that names particle, place, time and cause; with quarantine() it is repeated
    /// without that particle.
    ///
    /// After a failed step within the stable length, velocities that are not stored (see
    /// MaterialTraits::Derived) are gathered again from what was scattered to the grid: momentum and uniform
    /// or affine motion are exact, the rest is smoothed by one transfer. The error says so.
    template <NodeEffect<Real, d>... Effects>
    StepReport step(double dt, Effects const&... effects)
    {
        return std::move(steps(1, dt, effects...).front());
    }

    /// Advances the simulation by `count` time steps of length `dt` [s], one report each. Equivalent to
    /// `count` calls of step(), but a device need not wait for the host between them.
    template <NodeEffect<Real, d>... Effects>
    std::vector<StepReport> steps(std::size_t count, double dt, Effects const&... effects)
    {
        std::vector<StepReport> reports;
        change("Solver::step", [&] {
            detail::validate_steps<Number>(time(), count, dt);
            accept("Solver::step", effects...);
            reports = time_loop_.steps(scene_, count, dt, effects...);
        });
        return reports;
    }

    using Calls::step, Calls::steps, Calls::advance; // which refuse arguments that are not effects

    /// Advances the simulation by exactly `duration` [s] in as many stable steps as needed. Many short calls
    /// take more: see Budget::cut_last_step. A step below StepControl::smallest of the duration is an error.
    ///
    /// A failed step is repeated with half its length. After StepControl::retries halvings it is a StepError
    /// that names particle, place, time and cause, and the state is that of the last good step (but see
    /// step() for velocities, and until_error() for the steps taken until then). A StepError is also thrown
    /// where the speed or the waves of a particle allow no step that advances time. Halvings count on across
    /// a successful step if the step was that short only because of the failures before it.
    ///
    /// With quarantine() the particle is removed from the scene instead, and the run goes on; a particle
    /// whose own state has no stress is removed at once.
    template <NodeEffect<Real, d>... Effects>
    AdvanceReport advance(double duration, Effects const&... effects)
    {
        return advance_by([](double) { return FullPace{}; }, duration, effects...);
    }

    /// The same within a Budget of seconds or steps (firn/budget.hpp). The report says what is left.
    template <StepBudget Budget, NodeEffect<Real, d>... Effects>
    AdvanceReport advance(double duration, Budget const& budget, Effects const&... effects)
    {
        budget.validate();
        return advance_by([&](double now) { return typename Budget::Pace(budget, now); }, duration,
                          effects...);
    }

    /// The longest stable step from the present state on with these effects [s]; infinity if nothing bounds
    /// it. See bounds() for what it depends on, and StepControl::growth for what steps keep to besides.
    template <NodeEffect<Real, d>... Effects>
    double stable_step(Effects const&... effects) const
    {
        auto const access = guard_.read("Solver::stable_step");
        detail::validate_effects("Solver::stable_step", scene_, effects...);
        return time_loop_.next_step().stable(scene_, effects...).dt;
    }

    /// What the last call of step(), steps() or advance() that ended in an exception, after its arguments
    /// were accepted, had done until then: its steps were taken, and their reactions are still to be applied
    /// to the obstacles.
    AdvanceReport const& until_error() const { return time_loop_.until_error(); }

    double time() const { return time_loop_.next_step().time_state.time; } ///< [s]
    Lattice const& lattice() const { return scene_.lattice; }              ///< position and size of the cells
    Transfer const& transfer() const { return scene_.transfer; }           ///< the scheme with its parameters
    Backend const& backend() const { return scene_.backend; }              ///< which runs its loops
    /// The parameters of a material.
    template <class Which = Every>
    typename MaterialTraits<Which>::Model const& model() const
    {
        return scene_.sets.template model<MaterialTraits<Which>::place>();
    }

    /// How many particles there are.
    template <class Which = Every>
    std::size_t size() const
    {
        return scene_.sets.template size<place_of<Which>>();
    }

    /// The particles removed from the scene by quarantine(), and why: since the solver was made or, if that
    /// was later, on top of the list in the restored snapshot.
    std::vector<StepFailure> const& isolated() const { return time_loop_.isolated(); }

    /// What bounds the next time step.
    StepBounds const& bounds() const { return time_loop_.next_step().time_state.bounds; }

    /// The permanent ids of the particles, in rising order: 0, 1, 2, … while none has been removed.
    template <class Which = Every>
    std::vector<std::uint32_t> ids() const
    {
        return by_id<Which, std::uint32_t>([&](auto k) { return scene_.sets.template particles<k>().ids(); });
    }

    /// What stays equal as long as ids() does, and is compared at once: see IdLookup.
    template <class Which = Every>
    auto id_marks() const
    {
        return scene_.sets.template id_marks<place_of<Which>>();
    }

    /// World positions [m], by rising id.
    template <class Which = Every>
    std::vector<Vector<double, d>> positions() const
    {
        return by_id<Which, Vector<double, d>>([&](auto k) { return scene_.template positions<k>(); });
    }

    /// A field's values, by rising id: `download<Velocity>()`, `download<Stress>()` (observables.hpp).
    template <class Tag, class Which = Every>
    std::vector<FieldValue<Tag, Number, d>> download() const
    {
        return by_id<Which, FieldValue<Tag, Number, d>>(
            [&](auto k) { return scene_.template download<Tag, k>(); });
    }

    /// A stored field in the backend's memory: `view<DisplacementGradient>()`. Nothing is copied; the view is
    /// valid until the next call that changes the scene.
    template <class Tag, class Which = Every>
    auto view() const
    {
        static_assert(MaterialTraits<Which>::Stored::template contains<Tag>,
                      "this field is not stored: ask download() for it, or write_positions() for positions");
        static_assert(!spans_ranks<Backend>,
                      "a rank has a part of the particles alone: ask view_here() for the values of these, or "
                      "download() for those of all");
        auto const access = guard_.read("Solver::view");
        return detail::view_here<Tag>(scene_.sets.template particles<MaterialTraits<Which>::place>());
    }

    /// Writes world positions [m], by rising id, to memory that the backend's loops reach: axis a of the i-th
    /// particle goes to `to[i * stride + a]`. On a device the work is queued in the backend's stream, so a
    /// mapped renderer's buffer needs no copy. Over ranks each has memory for all particles, and what lies on
    /// others goes through the host.
    template <class Which = Every>
    void write_positions(Number* to, std::size_t stride = d) const
    {
        auto const access = guard_.read("Solver::write_positions");
        scene_.template write_positions<MaterialTraits<Which>::place>(to, stride);
    }

    /// Writes what download() returns to such memory as for write_positions(): component c (of matrices row
    /// by row) of the i-th particle goes to `to[i * stride + c]`. Velocities that are not stored are gathered
    /// from the grid for it, which takes a part of a step's time.
    template <class Tag, class Which = Every>
    void write(Number* to, std::size_t stride = std::size_t(component_count<Tag>(d))) const
    {
        auto const access = guard_.read("Solver::write");
        static_assert(ObservedField<Tag> || MaterialTraits<Which>::State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        scene_.template write<Tag, MaterialTraits<Which>::place>(to, stride);
    }

    /// Masses [kg], by rising id.
    template <class Which = Every>
    std::vector<double> masses() const
    {
        return by_id<Which, double>([&](auto k) { return scene_.template masses_of_particles<k>(); });
    }

    /// Kinetic and elastic energy [J], of models that tell it, and with gravity that of height: see Energy.
    template <class Which = Every>
    Energy energy(Gravity const& gravity = {zeros<Eigen::Vector3d>()}) const
    {
        auto const access = guard_.read("Solver::energy");
        return energy_of<place_of<Which>>(scene_, gravity);
    }

    /// Mass, its centre, momentum, and angular momentum about a point [m], on the host: see SceneTotals.
    template <class Which = Every>
    SceneTotals<d> totals(Vector<double, d> const& about = zeros<Vector<double, d>>()) const
    {
        auto const access = guard_.read("Solver::totals");
        return totals_of<place_of<Which>>(scene_, about);
    }

    /// Density, velocity and stress at any points [m], on the host: see sample_fields().
    template <class Which = Every, class Points>
    auto sample(Points const& points) const
    {
        return sample_fields<Which>(*this, points);
    }

    /// How the particles of all materials lie in the cells now: too few per cell, separated into pieces,
    /// alone? Computed by the host on request, in the time of some steps; steps compute nothing for it.
    Occupancy occupancy() const
    {
        auto const access = guard_.read("Solver::occupancy");
        return detail::occupancy_of(cells_of(scene_.sets), Kernel::degree, lattice());
    }

    /// All that the next steps depend on, in memory of the host.
    ///
    /// This solver goes on exactly like one that restores the snapshot: both scatter afresh in their next
    /// step, as after add(), and from then on agree bit by bit if they get the same calls. The particles'
    /// values stay as they are; the steps that follow differ by a rounding from those without a snapshot.
    Snapshot<Number, d> snapshot()
    {
        Snapshot<Number, d> to;
        change("Solver::snapshot", [&] {
            to = detail::save(scene_, time_loop_);
            walls_.forget();
        });
        return to;
    }

    /// Replaces the state by that of a snapshot. The snapshot must come from a solver of the same lattice,
    /// kernel, transfer and materials, with the same parameters; backend and step control may differ. With
    /// the same backend, lanes and step control the steps that follow are those of the solver that made it,
    /// bit by bit. To go on with other parameters see Snapshot::forget_parameters.
    /// Throws an Error, and changes nothing, if the snapshot does not fit or is none that snapshot() can have
    /// returned, or if a call of this solver has broken off. Running out of memory or a device failure in the
    /// middle of a call may have left more than the particles half changed: restore into a new solver then.
    void restore(Snapshot<Number, d> const& from)
    {
        change("Solver::restore", [&] {
            detail::restore(from, scene_, time_loop_);
            walls_.forget();
        });
    }

    /// See contact_points() of firn/contact_points.hpp.
    auto last_contacts() const
    {
        auto const access = guard_.read("contact_points");
        return time_loop_.last_contacts(scene_);
    }

    /// Bytes held by particles and grid, and by what implicit steps keep, with spare capacity, without
    /// threads' scratch memory of some 10 kB.
    std::size_t memory() const { return scene_.memory() + time_loop_.memory(); }

private:
    /// The place of the material that a call names; the number of materials if it is about all.
    template <class Which>
    static constexpr std::size_t place_of = detail::PlaceOf<Which, List>::value;

    /// The values that `ask(place)` returns for one material, or for all merged, by rising id.
    template <class Which, class Value, class Ask>
    std::vector<Value> by_id(Ask const& ask) const
    {
        auto const access = guard_.read("Solver::download");
        return scene_.sets.template by_id<place_of<Which>, Value>(ask);
    }

    /// Runs the work of a call that changes the scene. If it breaks off with the scene half changed, or with
    /// velocities lost, there is no state to go on from, and all later calls refuse with that reason.
    template <class Work>
    void change(char const* call, Work const& work)
    {
        auto const access = guard_.write(call);
        guard_.or_break_off(
            [&] { detail::call_on_ranks(scene_.backend, call, work); },
            [&] { return scene_.is_half_changed() || time_loop_.has_lost_velocities(scene_); });
    }

    template <class Pace, class... Effects>
    AdvanceReport advance_by(Pace const& pace, double duration, Effects const&... effects)
    {
        AdvanceReport report;
        change("Solver::advance", [&] {
            detail::validate_duration<Number>(time(), duration);
            accept("Solver::advance", effects...);
            report = time_loop_.advance(scene_, duration, pace(time()), effects...);
        });
        return report;
    }

    /// Refuses invalid effects, those that act on a mark that no particle has, and walls that share nodes or
    /// have particles behind them; looks at particles only where these, or walls, are new.
    template <class... Effects>
    void accept(char const* call, Effects const&... effects)
    {
        detail::validate_effects(call, scene_, effects...);
        scene_.known_marks.look(call, scene_.sets, effects...);
        require_walls_apart(effects...);
        // with transfers in which particles move by velocities of their own they may overshoot by up to half
        // a cell, where their kernels still reach mirrored nodes only
        walls_.look(scene_.sets, scene_.lattice, Transfer::moves_with_grid ? 1e-3 : 0.5, effects...);
    }

    template <class, class, ActsOn>
    friend class Worlds;
    detail::AccessGuard<typename Backend::SharedCount> guard_;
    SceneState<Backend, Sets, Kernel, Transfer> scene_;
    TimeLoop<SceneState<Backend, Sets, Kernel, Transfer>> time_loop_;
    detail::WallCheck walls_; ///< walls with no particle behind them
};

} // namespace firn

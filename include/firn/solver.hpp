// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/core/access_guard.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/effects/wall_check.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/particles/material_sets.hpp>
#include <firn/particles/occupancy.hpp>
#include <firn/state/restore.hpp>
#include <firn/state/snapshot.hpp>
#include <firn/time_stepping/bounds.hpp>
#include <firn/time_stepping/failures.hpp>
#include <firn/time_stepping/report.hpp>
#include <firn/time_stepping/step_queue.hpp>
#include <firn/transfer/mls.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{
/// Whether all types of a scene's material list are materials, for this lane type.
template <class Real, class List>
inline constexpr bool are_materials = false;
template <class Real, class... Models>
inline constexpr bool are_materials<Real, Materials<Models...>> = (Complete<Models, Real>::value && ...);

/// Refuses a kernel of too high a degree for the backend with a sentence, and substitutes another one so that
/// the compiler reports nothing more.
template <class Backend, class Kernel>
struct KernelFor
{
    static constexpr bool fits = Kernel::degree <= Backend::largest_degree;
    static_assert(fits, "the kernel's degree is beyond what the backend's tiles take "
                        "(Backend::largest_degree): choose QuadraticBSpline, CubicBSpline or another one of "
                        "degree 3 or less");
    using Type = std::conditional_t<fits, Kernel, QuadraticBSpline>;
};
} // namespace detail

/// An explicit Material Point Method solver.
///
/// `Backend` says where it runs, `Model` what the material is (and with its Space the dimension and
/// precision), `Kernel` and `Transfer` how particles and grid exchange mass and momentum. All input is in SI
/// units. One thread at a time may call a solver. With OpenMP, calls that only read (const) may overlap one
/// another. Solvers are independent: different ones may be called from different threads at the same time.
/// Unless NDEBUG is defined, a call that changes the solver or copies from it while another call is under way
/// throws an Error and changes nothing. A moved-from solver may only be destroyed or assigned.
///
/// With Materials<...> as the model a scene has several materials, which share the grid and the time step.
/// `Which` then selects the material of a call, by the model's type or as Material<place>: add, upload, view,
/// write, write_positions and model need it; other calls are about all materials without it.
///
/// Values of many particles are passed and returned in the order of their permanent ids, see ids().
template <class Backend, class ModelType, InterpolationKernel KernelType = QuadraticBSpline,
          class TransferType = Mls>
class Solver
{
    static_assert(detail::HasSpace<ModelType>,
                  "the model lacks 'using Space = firn::Space<d, number>', its dimension and precision");
    using List = typename detail::MaterialsOf<ModelType>::Type;
    using Every = EveryMaterial;
    using Sets = MaterialSets<Backend, List, TransferType>;
    using Kernel = typename detail::KernelFor<Backend, KernelType>::Type;

public:
    /// The material, or Materials<...>.
    using Model = ModelType;
    /// The transfer scheme between particles and grid.
    using Transfer = TransferType;
    /// Dimension and precision.
    using Space = typename Model::Space;
    /// float or double.
    using Number = typename Space::Scalar;
    /// The interpolation kernel.
    using kernel = Kernel;
    /// 2 or 3.
    static constexpr int d = Space::dimension;
    /// The lane type: what a loop of the backend computes with at once.
    using Real = typename Backend::template Lane<Number>;
    static_assert(detail::are_materials<Real, List>,
                  "what is said to be a material is none: see ConstitutiveModel in firn/concepts.hpp");
    static_assert(TransferScheme<Transfer, Kernel, Real, d>,
                  "the transfer scheme lacks scatter or gather: see firn/concepts.hpp");

    /// How many materials there are.
    static constexpr std::size_t materials = Sets::count;

    /// The types and sizes of one material: see MaterialSets::MaterialTraits.
    template <class Which = Every>
    struct MaterialTraits : Sets::template MaterialTraits<detail::PlaceOf<Which, List>::value>
    {
        /// The material's index, from 0 on.
        static constexpr std::size_t place = detail::PlaceOf<Which, List>::value;
    };

private:
    using Places = std::make_index_sequence<materials>;
    template <std::size_t... k>
    static CommonToAll<typename MaterialTraits<Material<k>>::State...>
        common_state(std::index_sequence<k...>);
    template <std::size_t... k>
    static constexpr std::size_t most_state_bytes(std::index_sequence<k...>)
    {
        return std::max({MaterialTraits<Material<k>>::state_bytes_per_particle...});
    }
    template <std::size_t... k>
    static constexpr std::size_t most_bytes(std::index_sequence<k...>)
    {
        return std::max({MaterialTraits<Material<k>>::bytes_per_particle...});
    }

public:
    /// The fields that particles of all materials have in common.
    using State = typename decltype(common_state(Places{}))::Type;
    /// MaterialTraits' bytes; of several materials, the largest.
    static constexpr std::size_t state_bytes_per_particle = most_state_bytes(Places{});
    /// The same with both buffers and the cell order.
    static constexpr std::size_t bytes_per_particle = most_bytes(Places{});

    /// An empty scene. Throws an Error if a parameter is outside its range, or if the backend cannot run on
    /// this machine.
    explicit Solver(Lattice lattice, Model model = {}, Transfer transfer = {}, StepControl control = {},
                    Backend backend = {})
        : lattice_(lattice_for<Number>(lattice)), transfer_(transfer), control_(control),
          backend_(std::move(backend)), sets_(List(std::move(model)), lattice_, Kernel::degree, backend_),
          grid_state_(lattice_, transfer_, backend_), driver_(lattice_, transfer_, backend_)
    {
        for_each_material([&](auto k) { model_of<k>().validate(); });
        control_.validate();
        backend_.validate();
        if constexpr (requires { transfer_.validate(); }) transfer_.validate();
    }

    /// Adds particles of a material at `points` [m], each with the given volume [m^3] and the same velocity
    /// [m/s], otherwise at rest. Their mass is the model's density times the volume. Returns the id of the
    /// first: ids are permanent, and consecutive over all calls and materials.
    ///
    /// `points` is any contiguous range of Eigen vectors of d components. Throws an Error, and adds none, if
    /// a point is not finite or out of the range of cell coordinates, or the volume is not above 0.
    template <class Which = Every, class Points>
    std::uint32_t add(Points const& points, double volume_per_point,
                      Vector<double, d> const& velocity = zeros<Vector<double, d>>())
    {
        auto const access = guard_.write("Solver::add");
        constexpr std::size_t k = MaterialTraits<Which>::place;
        static_assert(std::remove_cvref_t<decltype(*std::begin(points))>::SizeAtCompileTime == d,
                      "points have as many coordinates as the scene has dimensions");
        cache_grid_fields();
        bool const is_first = size() == 0; // there are no masses to compare with
        if (is_first) masses_ = {};
        std::uint32_t const first = next_id_;
        auto const added = or_break_off(
            [&] {
                return particles<k>().add(points, volume_per_point, double(model_of<k>().density), velocity,
                                          first, masses_);
            },
            [&] { return is_half_changed(); });
        if (added == 0) return first;
        if (is_first) time_state_.previous = time_state_.last = 0; // earlier steps had no particles
        next_id_ += static_cast<std::uint32_t>(added);
        grid_state_.forget();
        walls_.forget();
        double const modulus = sets_.template response_at_rest<k>().wave_modulus;
        controller_of_materials().admit(time_state_.bounds, static_cast<int>(k),
                                        sets_.template wave_speed<k>(modulus));
        time_state_.bounds.speed = std::max(time_state_.bounds.speed, norm(velocity));
        time_state_.bounds = time_state_.bounds.finite();
        return first;
    }

    /// Removes the particles for which a predicate is true: `predicate(position)` [m], or
    /// `predicate(position, particle)` with `particle[Velocity{}]` and its other fields. Returns how many.
    /// The others keep their ids and all their values, bit by bit.
    ///
    /// `predicate` is a function object that may be called where the backend's loops run: for example
    /// Inside{shape} or Outside{shape}, or for a device one of your own that is FIRN_HOST_DEVICE. It must not
    /// throw: exceptions cannot leave the loops.
    template <class Which = Every, class Predicate>
    std::size_t remove_if(Predicate const& predicate)
    {
        auto const access = guard_.write("Solver::remove_if");
        if constexpr (requires { Predicate::in_host_memory; })
            static_assert(Backend::reaches_host_memory || !Predicate::in_host_memory,
                          "the shape lies in memory of the host: pass shape.on(backend)");
        if constexpr (requires { predicate.validate(); }) predicate.validate();
        if constexpr (d == 2 && requires { predicate.validate_in_plane(); }) predicate.validate_in_plane();
        if constexpr (!TellsByPosition<Predicate, d>) cache_grid_fields();
        std::vector<RemovalMask<Backend>> masks;
        std::size_t count = 0;
        for_each_material([&](auto k) {
            using Particle = Record<Number, d, typename MaterialTraits<Material<k>>::State>;
            if constexpr (is_about<Which, k>) {
                static_assert(
                    TellsByPosition<Predicate, d> || TellsByFields<Predicate, d, Particle>,
                    "predicate is to take a position, or a position and a particle, and tell yes or "
                    "no");
                masks.push_back(particles<k>().find(predicate));
            }
            else
                masks.push_back({typename Backend::template Array<unsigned char>(backend_)});
            count += masks.back().count;
        });
        if (count == 0) return 0;
        cache_grid_fields();
        bool has_begun = false;
        or_break_off(
            [&] {
                for_each_material([&](auto k) {
                    particles<k>().remove(masks[k]);
                    has_begun = has_begun || masks[k].count > 0;
                });
                grid_state_.forget();
                if (is_held_up() || !has_particles(time_state_.bounds.material))
                    find_bounds(); // of the remaining particles
            },
            [&] { return has_begun || is_half_changed(); });
        return count;
    }

    /// Sets a field of all particles of a material, by rising id: velocities, an affine velocity, or a part
    /// of the model's state. Throws an Error, and changes nothing, unless there is one value per particle,
    /// each finite and in the field's range, and the model accepts all resulting states.
    template <class Tag, class Which = Every>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        auto const access = guard_.write("Solver::upload");
        constexpr std::size_t k = MaterialTraits<Which>::place;
        static_assert(MaterialTraits<Which>::State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        require(by_id.size() == size<Material<k>>(), "there is not one value per particle", "Solver::upload",
                "Pass size() values, by id.");
        for (std::size_t i = 0; i < by_id.size(); ++i)
            for_each_component<Tag, d>(by_id[i], [&](int, Number number) {
                require_valid<Tag>(
                    number, [&] { return "Solver::upload, value " + std::to_string(i); },
                    "Pass finite values that the field may have.");
            });
        cache_grid_fields();
        auto const change = [&](auto const& set) {
            or_break_off([&] {
                set();
                grid_state_.forget();
                find_bounds();
            });
        };
        if constexpr (MaterialTraits<Which>::Stored::template contains<Tag>) {
            auto const changed = particles<k>().changed([&](std::uint32_t row, auto& particle) {
                particle[Tag{}] = by_id[row];
                if constexpr (detail::may_object<k, Sets> &&
                              MaterialTraits<Which>::Model::State::template contains<Tag>)
                    detail::require_bearable<k>(sets_, particles<k>(), row, particle, "Solver::upload");
            });
            change([&] { particles<k>().set(changed); });
        }
        else
            change([&] { particles<k>().cached().template set<Tag>(by_id); });
    }

    /// From now on up to `most` particles in all may be removed from the scene, one after another, where a
    /// step fails because of them however short it is, or at the length passed to step(). The run goes on
    /// without them, and its report names them (see isolated()). All other particles keep all their values,
    /// bit by bit, as with remove_if(). One removal more than `most` is an error.
    ///
    /// The gathered fields are then cached beside the particles in every step. A snapshot, and so a
    /// checkpoint, has the list of removed particles. `most` stays the solver's own; removals on a restored
    /// list count towards it.
    void quarantine(std::size_t most)
    {
        auto const access = guard_.write("Solver::quarantine");
        cache_grid_fields();
        quarantine_.most = most;
        isolate_ = &Solver::isolate;
    }

    /// Advances the simulation by one time step of length `dt` [s].
    ///
    /// A `dt` above the stable one is taken, with a warning in the report. A failed step changes nothing and
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
        auto const access = guard_.write("Solver::step");
        require(is_finite(dt) && dt > 0, "the time step is not a finite number above 0", "Solver::step",
                "Pass seconds.");
        require(count <= std::vector<StepReport>().max_size(),
                "the number of steps is below 0, or beyond what memory has room to report", "Solver::steps",
                "Pass how many there are to be, 0 or above.");
        require_to_last(dt, "Solver::step");
        validate_effects("Solver::step", effects...);
        require_walls_apart(effects...);
        require_before_walls(effects...);
        auto controller = controller_for(effects...);
        controller.equal = dt;
        auto const plain = plain_effects(time_state_.time, effects...);
        std::vector<StepReport> reports;
        std::vector<StepFailure> isolated;
        auto const take = [&] {
            require_to_last(dt, "Solver::step"); // again: the solver's time has advanced
            if (!time_state_.ready) choose(controller);
            bool const beyond_stable = dt > time_state_.stable;
            if (beyond_stable) cache_grid_fields(); // the step may fail
            std::size_t const most = beyond_stable ? 1 : count - reports.size();
            StepLog const& log = run(controller, most, plain, [&](auto const& record) {
                StepReport report;
                describe(record, report);
                reports.push_back(std::move(report)); // filled before it is added: allocation may fail
                reports.back().beyond_stable = dt > record.stable;
                std::swap(reports.back().isolated, isolated); // isolated before that step
            });
            if (log.failed == 0) return;
            if (!isolates(log, dt, true, isolated)) fail(log, dt);
            release(controller);
        };
        try {
            while (reports.size() < count) take();
        }
        catch (...) {
            until_error_ = {};
            for (auto const& report : reports) until_error_.add(report, StepLimit::duration);
            throw;
        }
        time_state_.ready = false;
        return reports;
    }

    // Arguments that are not effects are refused with a readable message.
    template <class... Others>
    StepReport step(double, Others const&...)
    {
        detail::require_effects<Real, d, Others...>();
        return {};
    }
    template <class... Others>
    std::vector<StepReport> steps(std::size_t, double, Others const&...)
    {
        detail::require_effects<Real, d, Others...>();
        return {};
    }
    template <class... Others>
    AdvanceReport advance(double, Others const&...)
    {
        detail::require_effects<Real, d, Others...>();
        return {};
    }

    /// Advances the simulation by `duration` [s] in as many stable steps as needed. These are at most 1e12:
    /// a step below StepControl::smallest (1e-12) of the duration is an error. Pass a larger share if you
    /// cannot wait that long for a material far too stiff, or an obstacle far too fast.
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
        auto const access = guard_.write("Solver::advance");
        require(is_finite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
                "Solver::advance", "Pass seconds, e.g. 1.0 / 24.");
        if (duration > 0) require_to_last(duration, "Solver::advance");
        validate_effects("Solver::advance", effects...);
        require_walls_apart(effects...);
        require_before_walls(effects...);
        auto controller = controller_for(effects...);
        controller.duration = duration;
        controller.end = time_state_.time + duration;
        auto const plain = plain_effects(time_state_.time, effects...);
        AdvanceReport all;
        StepReport of_step; // reused, so that its lists are allocated once
        StepLog failed;     // the step that is being repeated, if time_state_.retries > 0
        auto const get_on = [&] {
            if (!time_state_.ready) choose(controller);
            double const tried = time_state_.now.interval.length();
            if (!controller.gets_on(time_state_)) {
                // repeated halving did not prevent the failure, or a particle's own state allows no step
                bool const repeated = time_state_.retries > 0;
                auto const failure = repeated ? detail::failure_of(sets_, failed, time_state_.time, tried)
                                              : slowest(controller, tried);
                if (!repeated && !failure && forgets_bounds(controller)) return;
                if (!isolates(repeated ? failed : StepLog{}, tried, failure.has_value(), all.isolated,
                              failure))
                    fail_to_get_on(failure);
                release(controller);
                return;
            }
            // the number of steps if all were as long as this one, limited to what can be counted
            auto const most = static_cast<std::size_t>(
                std::min(std::ceil((controller.end - time_state_.time) / tried), 0x1p62));
            StepLog const& log = run(controller, most, plain, [&](auto const& record) {
                describe(record, of_step);
                all.add(of_step, record.limit);
            });
            if (log.failed == 0) return;
            failed = log;
            ++all.rejected;
            // Too many failures in a row, or a step that earlier failures have made as short. Without the
            // second test, single good steps between failing ones would keep the loop going for ever.
            bool const last = ++time_state_.retries > control_.retries ||
                              time_state_.now.longest <
                                  std::ldexp(std::min(time_state_.stable, duration), -control_.retries);
            double const dt = time_state_.now.interval.length();
            if (isolates(log, dt, last, all.isolated))
                release(controller);
            else if (last)
                fail(log, dt);
        };
        try {
            while (controller.goes_on(time_state_)) get_on();
        }
        catch (...) {
            until_error_ = std::move(all);
            throw;
        }
        time_state_.ready = false;
        return all;
    }

    /// What the last call of step(), steps() or advance() that ended in an exception, after its arguments
    /// were accepted, had done until then: its steps were taken, and their reactions are still to be applied
    /// to the obstacles.
    AdvanceReport const& until_error() const { return until_error_; }

    double time() const { return time_state_.time; } ///< [s]
    /// Position and size of the cells.
    Lattice const& lattice() const { return lattice_; }
    /// The transfer scheme with its parameters.
    Transfer const& transfer() const { return transfer_; }
    /// The backend that runs its loops.
    Backend const& backend() const { return backend_; }
    /// The parameters of a material.
    template <class Which = Every>
    typename MaterialTraits<Which>::Model const& model() const
    {
        return model_of<MaterialTraits<Which>::place>();
    }

    /// How many particles there are.
    template <class Which = Every>
    std::size_t size() const
    {
        std::size_t count = 0;
        for_each_material([&](auto k) {
            if constexpr (is_about<Which, k>) count += particles<k>().size();
        });
        return count;
    }

    /// The particles removed from the scene by quarantine(), and why: since the solver was made or, if that
    /// was later, on top of the list in the restored snapshot.
    std::vector<StepFailure> const& isolated() const { return quarantine_.isolated; }

    /// What bounds the next time step.
    StepBounds const& bounds() const { return time_state_.bounds; }

    /// The permanent ids of the particles, in rising order: 0, 1, 2, … while none has been removed.
    template <class Which = Every>
    std::vector<std::uint32_t> ids() const
    {
        return by_id<Which, std::uint32_t>([&](auto k) { return particles<k>().ids(); });
    }

    /// World positions [m], by rising id.
    template <class Which = Every>
    std::vector<Vector<double, d>> positions() const
    {
        return by_id<Which, Vector<double, d>>([&](auto k) { return particles<k>().positions(); });
    }

    /// A field's values, by rising id: `download<Velocity>()`.
    template <class Tag, class Which = Every>
    std::vector<FieldValue<Tag, Number, d>> download() const
    {
        return by_id<Which, FieldValue<Tag, Number, d>>(
            [&](auto k) { return grid_state_.template download<Tag, k>(sets_); });
    }

    /// A stored field in the backend's memory: `view<DisplacementGradient>()`. Nothing is copied; the view is
    /// valid until the next call that changes the scene.
    template <class Tag, class Which = Every>
    auto view() const
    {
        static_assert(MaterialTraits<Which>::Stored::template contains<Tag>,
                      "this field is not stored: ask for it with download(), and for positions with "
                      "write_positions()");
        auto const access = guard_.read("Solver::view");
        return particles<MaterialTraits<Which>::place>().template view<Tag>();
    }

    /// Writes world positions [m], by rising id, to memory that the backend's loops reach: axis a of the i-th
    /// particle goes to `to[i * stride + a]`. On a device the work is queued in the backend's stream, so a
    /// mapped renderer's buffer needs no copy.
    template <class Which = Every>
    void write_positions(Number* to, std::size_t stride = d) const
    {
        auto const access = guard_.read("Solver::write_positions");
        auto const& table = particles<MaterialTraits<Which>::place>();
        require_room(to, table.size(), stride, d, "Solver::write_positions");
        if (table.size() > 0) backend_.for_each_place(table.cells(), table.position_writer(to, stride));
    }

    /// Writes a field of all particles, by rising id, to such memory as for write_positions(): component c
    /// (of matrices row by row) of the i-th particle goes to `to[i * stride + c]`. Velocities that are not
    /// stored are gathered from the grid for it, which takes a part of a step's time.
    template <class Tag, class Which = Every>
    void write(Number* to, std::size_t stride = component_count<Tag>(d)) const
    {
        auto const access = guard_.read("Solver::write");
        static_assert(MaterialTraits<Which>::State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        constexpr std::size_t k = MaterialTraits<Which>::place;
        require_room(to, particles<k>().size(), stride, component_count<Tag>(d), "Solver::write");
        if (particles<k>().size() > 0) grid_state_.template write<Tag, k>(sets_, to, stride);
    }

    /// Masses [kg], by rising id.
    template <class Which = Every>
    std::vector<double> masses() const
    {
        return by_id<Which, double>([&](auto k) { return particles<k>().masses(masses_.unit); });
    }

    /// How the particles of all materials lie in the cells now: too few per cell, separated into pieces,
    /// alone? Computed by the host on request, in the time of some steps; steps compute nothing for it.
    Occupancy occupancy() const
    {
        auto const access = guard_.read("Solver::occupancy");
        std::vector<Coordinates<d>> cells;
        for_each_material([&](auto k) { particles<k>().add_cells(cells); });
        return detail::CellNeighbours<d>(std::move(cells), Kernel::degree).occupancy();
    }

    /// All that the next steps depend on, in memory of the host.
    ///
    /// This solver goes on exactly like one that restores the snapshot: both scatter afresh in their next
    /// step, as after add(), and from then on agree bit by bit if they get the same calls. The particles'
    /// values stay as they are; the steps that follow differ by a rounding from those without a snapshot.
    Snapshot<Number, d> snapshot()
    {
        auto const access = guard_.write("Solver::snapshot");
        cache_grid_fields();
        Snapshot<Number, d> to{.kernel = detail::name_of_policy<Kernel>(),
                               .transfer = detail::name_of_policy<Transfer>(),
                               .kernel_degree = Kernel::degree,
                               .transfer_parameters = detail::parameters_of(transfer_),
                               .lattice = lattice_,
                               .time = time_state_.time,
                               .previous = time_state_.previous,
                               .last = time_state_.last,
                               .bounds = time_state_.bounds,
                               .masses = masses_,
                               .next_id = next_id_,
                               .materials = {},
                               .isolated = quarantine_.isolated};
        or_break_off(
            [&] {
                for_each_material([&](auto k) {
                    to.materials.push_back(particles<k>().snapshot());
                    detail::name_material<k>(sets_, to.materials.back());
                });
            },
            [&] { return is_half_changed(); });
        std::vector<CellOrder> orders; // allocated before anything changes
        for_each_material([&](auto k) { orders.push_back(particles<k>().order_of(to.materials[k])); });
        GridStateType grid_state(lattice_, transfer_, backend_);
        or_break_off([&] {
            for_each_material([&](auto k) { particles<k>().restore(to.materials[k], std::move(orders[k])); });
            go_on_from(to, to.bounds, std::move(grid_state), to.isolated);
        });
        return to;
    }

    /// Replaces the state by that of a snapshot. The snapshot must come from a solver of the same lattice,
    /// kernel, transfer and materials, with the same parameters; backend and step control may differ. With
    /// the same backend, lanes and step control the steps that follow are those of the solver that made it,
    /// bit by bit. To go on with other parameters see Snapshot::forget_parameters.
    ///
    /// Throws an Error, and changes nothing, if the snapshot does not fit or is none that snapshot() can have
    /// returned, or if a call of this solver has broken off. Running out of memory or a device failure in the
    /// middle of a call may have left more than the particles half changed: restore into a new solver then.
    void restore(Snapshot<Number, d> const& from)
    {
        auto const access = guard_.write("Solver::restore");
        bool const same_bounds = detail::require_fits<Kernel>(from, sets_, lattice_, transfer_);
        detail::require_whole(from, CellOrder::largest_coordinate);
        Sets sets = sets_.emptied(lattice_, Kernel::degree, backend_);
        for_each_material([&](auto k) {
            auto& table = sets.template particles<k>();
            table.restore(from.materials[k]);
            if constexpr (detail::may_object<k, Sets>)
                table.for_each([&](std::uint32_t row, auto const& particle) {
                    detail::require_bearable<k>(sets, table, row, particle, "Solver::restore");
                });
        });
        StepBounds const bounds = same_bounds ? from.bounds : bounds_of(sets, from.bounds);
        auto isolated = from.isolated;
        GridStateType grid_state(lattice_, transfer_, backend_);
        sets_ = std::move(sets); // from here on nothing can fail
        go_on_from(from, bounds, std::move(grid_state), std::move(isolated));
    }

    /// Bytes held by particles and grid, spare capacity included. Threads' scratch memory, some tens of
    /// kilobytes each, is not counted.
    std::size_t memory() const
    {
        std::size_t bytes = grid_state_.grid().memory();
        for_each_material([&](auto k) { bytes += particles<k>().memory(); });
        return bytes;
    }

private:
    using GridStateType = GridState<Backend, Sets, Kernel, Transfer>;
    using Driver = StepsOn<Backend, Sets, Kernel, Transfer>;
    using CellOrder = typename Sets::CellOrder;
    using Controller = typename Driver::Controller;
    using Failures = std::vector<StepFailure>;

    /// Checks the caller's memory before something is written to it for `count` particles.
    void require_room(Number const* to, std::size_t count, std::size_t stride, std::size_t components,
                      char const* where) const
    {
        require(to != nullptr || count == 0, "there is no memory to write to", where,
                "Pass room for size() times stride numbers.");
        if (stride < components)
            throw Error{"what is written of one particle would overlap the next one's", where,
                        "Pass a stride, in numbers, of " + std::to_string(components) + " or more."};
        if constexpr (!Backend::reaches_host_memory)
            require(count == 0 || backend_.reaches(to),
                    "the memory to write to is the host's, which the backend does not reach", where,
                    "Pass memory of the device, or take positions() or download() for the host.");
    }

    /// Goes on from a snapshot whose particles are in place already: the grid, and the planned steps, begin
    /// afresh.
    void go_on_from(Snapshot<Number, d> const& from, StepBounds const& bounds, GridStateType grid_state,
                    Failures isolated)
    {
        grid_state_ = std::move(grid_state);
        masses_ = from.masses;
        next_id_ = from.next_id;
        quarantine_.isolated = std::move(isolated);
        time_state_ = {.time = from.time, .bounds = bounds, .previous = from.previous, .last = from.last};
        bounds_are_old_ = true;
        driver_.forget_spoiled_nodes();
        walls_.forget();
    }

    template <std::size_t k>
    auto& particles()
    {
        return sets_.template particles<k>();
    }
    template <std::size_t k>
    auto const& particles() const
    {
        return sets_.template particles<k>();
    }
    template <std::size_t k>
    auto const& model_of() const
    {
        return sets_.template model<k>();
    }
    template <class Use>
    static void for_each_material(Use const& use)
    {
        Sets::for_each(use);
    }

    /// Whether a call with `Which` is about this material.
    template <class Which, std::size_t k>
    static constexpr bool is_about =
        detail::PlaceOf<Which, List>::value == k || detail::PlaceOf<Which, List>::value == materials;

    /// The values that `ask(place)` returns for one material, or for all merged, by rising id.
    template <class Which, class Value, class Ask>
    std::vector<Value> by_id(Ask const& ask) const
    {
        auto const access = guard_.read("Solver::download");
        constexpr std::size_t place = detail::PlaceOf<Which, List>::value;
        if constexpr (place < materials)
            return ask(std::integral_constant<std::size_t, place>{});
        else {
            std::vector<std::pair<std::uint32_t, Value>> all;
            for_each_material([&](auto k) {
                std::vector<Value> const values = ask(k);
                for (std::size_t row = 0; row < values.size(); ++row)
                    all.emplace_back(particles<k>().id(row), values[row]);
            });
            std::sort(all.begin(), all.end(), [](auto const& a, auto const& b) { return a.first < b.first; });
            std::vector<Value> values;
            for (auto const& [id, value] : all) values.push_back(value);
            return values;
        }
    }

    Controller controller_of_materials() const { return controller_of(sets_); }
    Controller controller_of(Sets const& sets) const
    {
        return detail::controller_of_materials<Kernel, Transfer>(sets, control_, lattice_.cell_size);
    }

    /// After particles were removed: drops the limits that came from them.
    void release(Controller& controller) const
    {
        controller.limits = controller_of_materials().limits;
        if (size() == 0) controller.acceleration = controller.obstacle_speed = 0;
    }

    /// The time step controller of a call with these effects.
    template <class... Effects>
    Controller controller_for(Effects const&... effects)
    {
        time_state_.ready = false; // it was planned for other effects and another end
        time_state_.retries = 0;
        Controller controller = controller_of_materials();
        if (size() > 0) (detail::admit_effect<d>(controller, effects), ...); // else effects bound no step
        return controller;
    }

    /// Chooses the next step on the host.
    void choose(Controller const& controller)
    {
        if (!exactly_equal(time_state_.scattered.interval.forces, grid_state_.scattered_dt()))
            time_state_.scattered = {};
        controller.choose(time_state_);
    }

    /// Takes the chosen step and some after it: see StepDriver::take and StepQueue::take.
    template <class Effects, class Visit>
    StepLog const& run(Controller const& controller, std::size_t most, Effects const& effects,
                       Visit const& visit)
    {
        typename Driver::Scene const scene{sets_,        grid_state_,          time_state_,
                                           masses_.unit, smallest_node_mass(), quarantine_.most > 0};
        StepLog const& log =
            *or_break_off([&] { return &driver_.take(scene, controller, most, effects, visit); });
        if (log.failed == 0) bounds_are_old_ = false;
        return log;
    }

    /// Runs `work`. If it throws, and `is_half_done()` is then true, there is no state to go on from, and all
    /// later calls refuse with that reason.
    template <class Work, class IsHalfDone>
    auto or_break_off(Work const& work, IsHalfDone const& is_half_done)
    {
        try {
            return work();
        }
        catch (Error const& error) {
            if (is_half_done()) guard_.break_off(&error);
            throw;
        }
        catch (...) { // most likely std::bad_alloc
            if (is_half_done()) guard_.break_off(nullptr);
            throw;
        }
    }
    template <class Work>
    auto or_break_off(Work const& work)
    {
        return or_break_off(work, [] { return true; });
    }

    bool is_half_changed() const
    {
        bool any = false;
        for_each_material([&](auto k) { any = any || particles<k>().is_half_changed(); });
        return any;
    }

    /// Overwrites a report with a record; the report may have been another step's.
    template <class Record>
    void describe(Record const& record, StepReport& report) const
    {
        report.dt = record.dt;
        report.time_of_forces = record.forces;
        report.stable_dt = record.stable;
        report.capped_of.assign(record.capped.begin(), record.capped.end());
        report.capped = std::accumulate(record.capped.begin(), record.capped.end(), std::uint64_t(0));
        report.reactions.resize(record.reactions.of.size());
        for (std::size_t i = 0; i < report.reactions.size(); ++i)
            report.reactions[i] = record.reactions.of[i] * masses_.unit;
    }

    /// Caches the gathered fields beside the particles, before the grid or the particles' positions change.
    void cache_grid_fields() { grid_state_.cache_grid_fields(sets_); }

    /// After a failed step: see GridState::regain_velocities.
    [[gnu::cold]] void regain_velocities()
    {
        if (!driver_.has_spoiled_nodes()) return;
        if (sets_.has_grid_fields())
            // the sums contain the forces of the failed step, which may be too large to subtract without
            // rounding errors
            grid_state_.forget();
        else
            or_break_off([&] { grid_state_.regain_velocities(sets_, smallest_node_mass()); });
        driver_.forget_spoiled_nodes();
    }

    /// Finds the bounds of the next step after the state was set from outside.
    void find_bounds()
    {
        time_state_.bounds = bounds_of(sets_, time_state_.bounds);
        bounds_are_old_ = true;
    }
    /// The bounds for the particles of `sets`, this scene's or new ones; `found` are earlier bounds.
    StepBounds bounds_of(Sets const& sets, StepBounds const& found) const
    {
        return detail::bounds_of(sets, controller_of(sets), found, values(sets));
    }

    /// Drops stale limits (found before particles changed) if they alone prevent progress; the next step
    /// recomputes them.
    bool forgets_bounds(Controller const& controller)
    {
        if (!bounds_are_old_) return false;
        TimeState const kept = time_state_;
        for (int k = 0; k < 2 && !controller.gets_on(time_state_); ++k) {
            if (time_state_.now.limit == StepLimit::deformation)
                time_state_.bounds.deformation_rate = 0;
            else if (time_state_.now.limit == StepLimit::obstacle)
                time_state_.bounds.obstacle_speed = 0;
            find_bounds();
            choose(controller);
        }
        bool const gets_on = controller.gets_on(time_state_);
        if (!gets_on) time_state_ = kept;
        return gets_on;
    }

    /// Whether a material has particles.
    bool has_particles(int material) const
    {
        bool has = false;
        for_each_material(
            [&](auto k) { has = has || (k == std::size_t(material) && particles<k>().size() > 0); });
        return has;
    }

    /// Whether steps are less than half as long as for particles at rest.
    bool is_held_up() const
    {
        Controller const controller = controller_of_materials();
        StepBounds at_rest;
        for_each_material([&](auto k) {
            if (particles<k>().size() == 0) return;
            double const modulus = sets_.template response_at_rest<k>().wave_modulus;
            controller.admit(at_rest, static_cast<int>(k), sets_.template wave_speed<k>(modulus));
        });
        return controller.stable(time_state_.bounds).dt < 0.5 * controller.stable(at_rest).dt;
    }

    /// A function that returns a field's values for a material, by row.
    auto values() const { return values(sets_); }
    auto values(Sets const& sets) const
    {
        return [this, &sets]<class Tag, std::size_t k>(Tag, std::integral_constant<std::size_t, k>) {
            return grid_state_.template download<Tag, k>(sets);
        };
    }

    /// The particle whose own state bounds the chosen step, of length `dt` [s]; none if something else does.
    std::optional<StepFailure> slowest(Controller const& controller, double dt) const
    {
        if (time_state_.now.limit > StepLimit::deformation) return {}; // by effects, or earlier steps
        return detail::slowest_in(sets_, controller, values(), time_state_.stable, time_state_.time, dt);
    }

    /// The node mass [mass units] below which a node's momentum is rounding error alone.
    Number smallest_node_mass() const
    {
        return Number(masses_.largest) * (std::is_same_v<Number, float> ? Number(1e-20) : Number(1e-40));
    }

    /// Refuses invalid effects of a call; the error says which argument it is.
    template <class... Effects>
    void validate_effects([[maybe_unused]] char const* call, Effects const&... effects) const
    {
        [[maybe_unused]] int place = 0;
        (validate_effect(call, ++place, effects), ...);
    }
    template <class Effect>
    void validate_effect(char const* call, int place, Effect const& effect) const
    {
        if constexpr (requires { Effect::in_host_memory; })
            static_assert(Backend::reaches_host_memory || !Effect::in_host_memory,
                          "the obstacle's shape lies in memory of the host: pass shape.on(backend)");
        try {
            effect.validate();
            if constexpr (d == 2 && requires { effect.validate_in_plane(); }) effect.validate_in_plane();
            detail::validate_bounds<d>(effect);
            if constexpr (Chain<detail::ActionOf<Effect, Number, d>>::uses_kilograms) require_kilograms();
        }
        catch (Error const& error) {
            refuse_effect(error, place, call);
        }
    }
    /// Refuses masses that the scene's precision cannot represent in kg, for effects that ask for kilograms.
    void require_kilograms() const
    {
        constexpr double rounding = MassScale::range<Number>;
        double const lightest = masses_.unit * masses_.smallest, heaviest = masses_.unit * masses_.largest;
        require(size() == 0 || (lightest >= std::numeric_limits<Number>::min() * rounding &&
                                heaviest <= std::numeric_limits<Number>::max() / rounding),
                "it asks for masses in kg, and those of the scene are beyond its numbers", "an effect",
                "Compute in double, or let particles have 1e-27 to 1e28 kg.");
    }
    [[noreturn, gnu::cold]] static void refuse_effect(Error const& error, int place, char const* call)
    {
        throw Error{error.what_is_wrong(),
                    error.where() + ", effect " + std::to_string(place) + " of " + call, error.remedy()};
    }

    /// Refuses a time [s] that would be lost to rounding: a program that passed such times in a loop would
    /// never end.
    void require_to_last(double duration, char const* where) const
    {
        require(time_state_.time + duration > time_state_.time &&
                    static_cast<Number>(duration) >= std::numeric_limits<Number>::min(),
                "the time is too short: beside the solver's own, or in its precision, it is none", where,
                "Pass a longer one.");
        require(is_finite(time_state_.time + duration),
                "the time is too long: with the solver's own it is beyond all numbers", where,
                "Pass a shorter one.");
    }

    /// Refuses walls that have particles behind them; checks only where walls or particles are new.
    template <class... Effects>
    void require_before_walls(Effects const&... effects)
    {
        // with transfers in which particles move by velocities of their own they may overshoot by up to half
        // a cell, where their kernels still reach mirrored nodes only
        walls_.look(sets_, lattice_, Transfer::moves_with_grid ? 1e-3 : 0.5, effects...);
    }

    /// After a failed step, removes from the scene the particles whose own state has no stress; if there are
    /// none and the step is not to be retried (`last`), removes `failure` or, by default, the culprit. See
    /// quarantine(). Returns false and changes nothing if no particle qualifies, or if they would be too
    /// many.
    bool isolate(StepLog log, double dt, bool last, Failures& isolated,
                 std::optional<StepFailure> const& failure)
    {
        if (!quarantine_.has_room_for(1)) return false;
        Failures culprits;
        if (log.cause != FailureCause::rejected || last) // the search stops at one more than allowed
            culprits = detail::without_stress(sets_, quarantine_.most, time_state_.time, dt);
        if (culprits.empty() && last)
            culprits.push_back(failure ? *failure
                                       : detail::furthest_in(sets_, log, values(), lattice_.cell_size,
                                                             time_state_.time, dt));
        if (culprits.empty() || !quarantine_.has_room_for(culprits.size())) return false;
        auto& all = quarantine_.isolated;
        all.reserve(all.size() + culprits.size()); // first, so that no removal goes unreported
        isolated.reserve(isolated.size() + culprits.size());
        or_break_off([&] { sets_.remove(culprits); });
        all.insert(all.end(), culprits.begin(), culprits.end());
        isolated.insert(isolated.end(), culprits.begin(), culprits.end());
        grid_state_.forget();
        time_state_.retries = 0;
        time_state_.ready = false;
        find_bounds();
        return true;
    }

    /// The same if quarantine() was called. The call goes through a pointer so that isolate() is compiled
    /// only for programs that ask for it.
    bool isolates(StepLog const& log, double dt, bool last, Failures& isolated,
                  std::optional<StepFailure> const& failure = {})
    {
        return isolate_ != nullptr && (this->*isolate_)(log, dt, last, isolated, failure);
    }

    [[noreturn, gnu::cold]] void fail_to_get_on(std::optional<StepFailure> const& since)
    {
        regain_velocities();
        detail::throw_no_step(time_state_, since, since ? Sets::name(since->material) : "", d);
    }

    [[noreturn, gnu::cold]] void fail(StepLog const log, double dt) // a copy: later work overwrites the log
    {
        bool const cached = sets_.has_grid_fields();
        regain_velocities(); // first, because what follows may run out of memory
        std::string kept = "The state is that of the last good step";
        if (!cached) kept += ", but for velocities, which were taken anew (see Solver::step)";
        if (isolate_ != nullptr)
            kept += "; of " + std::to_string(quarantine_.most) +
                    " particles that may be in quarantine there are " +
                    std::to_string(quarantine_.isolated.size()) + ", which stay out (Solver::isolated)";
        StepFailure failure = detail::failure_of(sets_, log, time_state_.time, dt);
        auto const spoilers = detail::without_stress(sets_, 0, time_state_.time, dt);
        if (!spoilers.empty()) { // their missing stress makes other particles fail
            failure = spoilers.front();
            failure.count = log.failed;
        }
        detail::throw_step_error(failure, time_state_.stable, Sets::name(failure.material), kept, d);
    }

    detail::AccessGuard<typename Backend::SharedCount> guard_;
    Lattice lattice_;
    Transfer transfer_;
    StepControl control_;
    Backend backend_;
    Sets sets_;
    GridStateType grid_state_;
    Driver driver_;
    MassScale masses_;
    std::uint32_t next_id_ = 0;
    TimeState time_state_;
    bool bounds_are_old_ = false; ///< some bounds were found by a step before particles changed
    detail::Quarantine quarantine_;
    bool (Solver::*isolate_)(StepLog, double, bool, Failures&, std::optional<StepFailure> const&) = nullptr;
    detail::KnownWalls walls_;  ///< walls with no particle behind them: see require_before_walls
    AdvanceReport until_error_; ///< see until_error()
};

} // namespace firn

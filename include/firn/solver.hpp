// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/core/entrance.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/occupancy.hpp>
#include <firn/particle_table.hpp>
#include <firn/phases/conclude_step.hpp>
#include <firn/phases/extend_velocities.hpp>
#include <firn/phases/move_particles.hpp>
#include <firn/report.hpp>
#include <firn/snapshot.hpp>
#include <firn/step_error.hpp>
#include <firn/transfer/mls.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{
/// Whether all materials of a scene are some, for this lane type.
template <class Real, class List>
inline constexpr bool are_materials = false;
template <class Real, class... Models>
inline constexpr bool are_materials<Real, Materials<Models...>> = (Complete<Models, Real>::value && ...);

/// What a material is called.
template <class Model>
std::string name_of_material(std::size_t place)
{
    std::string const numbered = "material " + std::to_string(place);
    if constexpr (requires { std::string(Model::name); })
        return std::string(Model::name) + " (" + numbered + ")";
    else
        return numbered;
}
} // namespace detail

/// An explicit Material Point Method solver.
///
/// `Backend` says where it runs, `Model` what the material is (and with its Space the dimension and
/// precision), `Kernel` and `Transfer` how particles and grid exchange what they hold. All input in SI units.
/// One thread at a time calls a solver, whatever it calls; with OpenMP calls that only tell something (const)
/// may overlap one another. Solvers are independent: different ones may be called from different threads at
/// the same time. Unless NDEBUG is defined, a call that changes it or copies from it while another is under
/// way throws an Error and changes nothing. One that was moved from may only be destroyed or assigned.
///
/// With Materials<...> for its model a scene has several materials, which share the grid and the time step.
/// `Which` then says what a call is about, by the model's type or as Material<place>: add, upload, view,
/// write_positions and model need it, others are about all materials without it.
///
/// What is given and told of many particles comes in the order of their permanent ids, see ids().
template <class Backend, class ModelType, InterpolationKernel Kernel = QuadraticBSpline,
          class TransferType = Mls>
class Solver
{
    static_assert(detail::HasSpace<ModelType>,
                  "the model lacks 'using Space = firn::Space<d, number>', its dimension and precision");
    using List = typename detail::MaterialsOf<ModelType>::Type;
    using Every = EveryMaterial;

public:
    using Model = ModelType;
    using Transfer = TransferType;
    using Space = typename Model::Space;
    using Number = typename Space::Real;
    using kernel = Kernel;
    static constexpr int d = Space::dimension;
    using Real = typename Backend::template Lane<Number>;
    static_assert(detail::are_materials<Real, List>,
                  "what is said to be a material is none: see ConstitutiveModel in firn/concepts.hpp");
    static_assert(TransferScheme<Transfer, Kernel, Real, d>,
                  "the transfer scheme lacks give or take: see firn/concepts.hpp");

    /// How many materials there are.
    static constexpr std::size_t materials = std::tuple_size_v<decltype(List::of)>;

    /// What there is of one material.
    template <class Which = Every>
    struct Of
    {
        static constexpr std::size_t place = detail::PlaceOf<Which, List>::value;
        static_assert(place < materials, "say which material: its type, or Material<place>");
        using Model = std::tuple_element_t<place, decltype(List::of)>;
        /// A particle's fields beside position and id: the union of what transfer and model declare.
        using State = Join<typename Transfer::State, typename Model::State>;
        /// Those that are stored from step to step, and those that particles take from the grid when asked
        /// for.
        using Stored = Join<typename Transfer::Stored, typename Model::State>;
        using Taken = Without<typename Transfer::State, Stored>;
        using Table = ParticleTable<Backend, Space, Stored, Taken>;

        /// The bytes of what is stored of one particle: its position, its fields and its row.
        static constexpr std::size_t state_bytes_per_particle = Table::state_bytes;
        /// All resident bytes per particle: two buffers of that, and the index of the cell order. (The host
        /// keeps four more where ids are no rows.)
        static constexpr std::size_t bytes_per_particle = Table::resident_bytes;
    };

private:
    using Places = std::make_index_sequence<materials>;
    template <std::size_t... k>
    static CommonToAll<typename Of<Material<k>>::State...> common_state(std::index_sequence<k...>);
    template <std::size_t... k>
    static constexpr std::size_t most_state_bytes(std::index_sequence<k...>)
    {
        return std::max({Of<Material<k>>::state_bytes_per_particle...});
    }
    template <std::size_t... k>
    static constexpr std::size_t most_bytes(std::index_sequence<k...>)
    {
        return std::max({Of<Material<k>>::bytes_per_particle...});
    }

public:
    /// The fields that a particle of whatever material has.
    using State = typename decltype(common_state(Places{}))::Type;
    /// Of's bytes, of several materials those of the one that has most.
    static constexpr std::size_t state_bytes_per_particle = most_state_bytes(Places{});
    static constexpr std::size_t bytes_per_particle = most_bytes(Places{});

    explicit Solver(Lattice lattice, Model model = {}, Transfer transfer = {}, StepControl control = {},
                    Backend backend = {})
        : lattice_(firn::lattice(lattice.cell_size, lattice.origin)), transfer_(transfer), control_(control),
          backend_(std::move(backend)), parts_(parts_of(List(std::move(model)), Places{})), grid_(backend_),
          now_(backend_), log_(backend_)
    {
        for_each_material([&](auto k) { model_of<k>().validate(); });
        control_.validate();
        backend_.validate();
        if constexpr (requires { transfer_.validate(); }) transfer_.validate();
    }

    /// Adds particles of a material at `points` [m] with the given volume each [m^3] and one velocity [m/s],
    /// at rest otherwise; their mass is the model's density times the volume. Returns the id of the first:
    /// ids are permanent, and consecutive over all calls and materials.
    ///
    /// `points` is any contiguous range of Eigen vectors of d components. Throws an Error, and adds none, if
    /// a point is not finite or out of the range of cell coordinates, or the volume is not above 0.
    template <class Which = Every, class Points>
    std::uint32_t add(Points const& points, double volume_per_point,
                      Vector<double, d> const& velocity = Vector<double, d>::Zero())
    {
        auto const visit = entrance_.to_change("Solver::add");
        constexpr std::size_t k = Of<Which>::place;
        hold_taken();
        std::uint32_t const first = next_id_;
        auto const added = particles<k>().add(points, volume_per_point, double(model_of<k>().density),
                                              velocity, first, masses_);
        if (added == 0) return first;
        next_id_ += static_cast<std::uint32_t>(added);
        given_for_ = 0;
        walls_.clear();
        auto at_rest = Record<Number, d, typename Of<Which>::Model::State>::at_rest();
        auto const response =
            model_of<k>().template respond<Number>(at_rest, Matrix<Number, d>::Zero(), Number(0));
        rule_of_materials().admit(course_.bounds, static_cast<int>(k), wave_speed<k>(response.wave_modulus));
        course_.bounds.speed = std::max(course_.bounds.speed, velocity.norm());
        course_.bounds = course_.bounds.finite();
        return first;
    }

    /// Removes the particles of which a call says so: `is_doomed(position)` [m], or `is_doomed(position,
    /// particle)` with `particle[Velocity{}]` and what else it has. Returns how many. The others keep their
    /// ids and, bit by bit, all they have.
    ///
    /// `is_doomed` is a function object that may be called where the backend's loops run: Inside{shape} or
    /// Outside{shape}, for example, or for a device one of your own that is FIRN_HOST_DEVICE.
    template <class Which = Every, class IsDoomed>
    std::size_t remove_if(IsDoomed const& is_doomed)
    {
        auto const visit = entrance_.to_change("Solver::remove_if");
        if constexpr (requires { IsDoomed::in_host_memory; })
            static_assert(Backend::reaches_host_memory || !IsDoomed::in_host_memory,
                          "the shape lies in memory of the host: pass `shape.on(backend)`");
        if constexpr (requires { is_doomed.validate(); }) is_doomed.validate();
        if constexpr (!TellsByPosition<IsDoomed, d>) hold_taken();
        std::vector<Doomed<Backend>> doomed;
        std::size_t count = 0;
        for_each_material([&](auto k) {
            using Particle = Record<Number, d, typename Of<Material<k>>::State>;
            if constexpr (is_about<Which, k>) {
                static_assert(
                    TellsByPosition<IsDoomed, d> || TellsByFields<IsDoomed, d, Particle>,
                    "is_doomed is to take a position, or a position and a particle, and tell yes or "
                    "no");
                doomed.push_back(particles<k>().find(is_doomed));
            }
            else
                doomed.push_back({typename Backend::template Array<unsigned char>(backend_)});
            count += doomed.back().count;
        });
        if (count == 0) return 0;
        hold_taken();
        for_each_material([&](auto k) { particles<k>().remove(doomed[k]); });
        given_for_ = 0;
        return count;
    }

    /// Sets a field of all particles of a material, by rising id: velocities, an affine velocity, or a part
    /// of the model's state. Throws an Error, and changes nothing, unless there is one value per particle
    /// that is finite, in the field's range, and makes no state that the model objects to.
    template <class Tag, class Which = Every>
    void upload(std::vector<FieldValue<Tag, Number, d>> const& by_id)
    {
        auto const visit = entrance_.to_change("Solver::upload");
        constexpr std::size_t k = Of<Which>::place;
        static_assert(Of<Which>::State::template contains<Tag>,
                      "the scene's particles have no such field, or it follows from others");
        require(by_id.size() == size<Material<k>>(), "there is not one value per particle", "Solver::upload",
                "Pass size() values, by id.");
        for (std::size_t i = 0; i < by_id.size(); ++i)
            for_each_component<Tag, d>(by_id[i], [&](int, Number number) {
                require_valid<Tag>(
                    number, [&] { return "Solver::upload, value " + std::to_string(i); },
                    "Pass finite values that the field may have.");
            });
        hold_taken();
        if constexpr (Of<Which>::Stored::template contains<Tag>)
            particles<k>().edit([&](std::uint32_t row, auto& particle) {
                particle[Tag{}] = by_id[row];
                if constexpr (may_object<k> && Of<Which>::Model::State::template contains<Tag>)
                    require_bearable<k>(particles<k>(), row, particle, "Solver::upload");
            });
        else
            particles<k>().held().template set<Tag>(by_id);
        given_for_ = 0;
        find_bounds();
    }

    /// From now on up to `most` particles in all, one after another, may be taken out of the scene where a
    /// step goes wrong for them however short it is, or as long as step() was told: the run goes on without
    /// them, and its report names them (see isolated()). All others keep, bit by bit, all they have, as with
    /// remove_if(). One more is an error.
    ///
    /// What particles take from the grid is then kept beside them from step to step.
    void quarantine(std::size_t most)
    {
        auto const visit = entrance_.to_change("Solver::quarantine");
        hold_taken();
        quarantine_ = most;
        isolate_ = &Solver::isolate;
    }

    /// Advances the simulation by one time step of length `dt` [s].
    ///
    /// A `dt` above the stable one is taken, with a warning in the report. A step that goes wrong changes
    /// nothing and throws a StepError that names particle, place, time and cause; with quarantine()
    /// it is repeated without that particle. (If it was within the stable one,
    /// velocities that are not stored, see Taken, are then taken anew from what particles gave to the grid:
    /// momentum and uniform or affine motion are exact, the rest is smoothed by one transfer.)
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
        auto const visit = entrance_.to_change("Solver::step");
        require(std::isfinite(dt) && dt > 0, "the time step is not a finite number above 0", "Solver::step",
                "Pass seconds.");
        require_to_last(dt, "Solver::step");
        (validate(effects), ...);
        require_walls_apart(effects...);
        require_before_walls(effects...);
        auto rule = rule_for(effects...);
        rule.equal = dt;
        auto const plain = plain_effects(effects...);
        std::vector<StepReport> reports;
        std::vector<StepFailure> isolated;
        while (reports.size() < count) {
            if (!course_.ready) choose(rule);
            bool const beyond_stable = dt > course_.stable;
            if (beyond_stable) hold_taken(); // it may go wrong
            std::size_t const most = beyond_stable ? 1 : count - reports.size();
            StepLog const& log = run(rule, most, plain, [&](auto const& record) {
                reports.push_back(report_of(record));
                reports.back().beyond_stable = dt > record.stable;
                std::swap(reports.back().isolated, isolated); // before that step
            });
            if (log.wrong > 0 && !isolates(log, dt, true, isolated)) fail(log, dt);
        }
        course_.ready = false;
        return reports;
    }

    /// Advances the simulation by `duration` [s] in as many stable steps as needed.
    ///
    /// A step that goes wrong is repeated with half its length; after StepControl::retries halvings that is
    /// a StepError that names particle, place, time and cause, and the state is that of the last good step
    /// (but see step() for velocities). With quarantine() the particle is taken out of the scene
    /// instead, and the run goes on; so it does at once for one whose own state has no stress.
    template <NodeEffect<Number, d>... Effects>
    AdvanceReport advance(double duration, Effects const&... effects)
    {
        auto const visit = entrance_.to_change("Solver::advance");
        require(std::isfinite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
                "Solver::advance", "Pass seconds, e.g. 1.0 / 24.");
        if (duration > 0) require_to_last(duration, "Solver::advance");
        (validate(effects), ...);
        require_walls_apart(effects...);
        require_before_walls(effects...);
        auto rule = rule_for(effects...);
        rule.duration = duration;
        rule.end = course_.time + duration;
        auto const plain = plain_effects(effects...);
        AdvanceReport report;
        StepLog lately; // the last step that went wrong, until one as long as that did not
        double lately_tried = 0;
        while (rule.goes_on(course_)) {
            if (!course_.ready) choose(rule);
            if (!rule.gets_on(course_)) {
                bool const isolated =
                    isolates(lately, course_.now.interval.length(), lately.wrong > 0, report.isolated);
                if (!isolated) fail_to_get_on(lately);
                lately = {};
                continue;
            }
            double const tried = course_.now.interval.length();
            // as many as there would be if all were as long as this one
            auto const most = static_cast<std::size_t>(std::ceil((rule.end - course_.time) / tried));
            StepLog const& log = run(
                rule, most, plain, [&](auto const& record) { report.add(report_of(record), record.limit); });
            if (log.wrong == 0) {
                if (tried >= lately_tried) lately = {};
                continue;
            }
            lately = log;
            lately_tried = tried;
            ++report.rejected;
            bool const last = ++course_.retries > control_.retries;
            double const dt = course_.now.interval.length();
            if (isolates(log, dt, last, report.isolated))
                lately = {}; // rows are others now
            else if (last)
                fail(log, dt);
        }
        course_.ready = false;
        return report;
    }

    double time() const { return course_.time; } ///< [s]
    Lattice const& lattice() const { return lattice_; }
    Transfer const& transfer() const { return transfer_; }
    Backend const& backend() const { return backend_; }
    template <class Which = Every>
    typename Of<Which>::Model const& model() const
    {
        return model_of<Of<Which>::place>();
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

    /// Who was taken out of the scene for what went wrong, and why, since the solver was made; see
    /// quarantine().
    std::vector<StepFailure> const& isolated() const { return isolated_; }

    /// What the next time step depends on.
    StepBounds const& bounds() const { return course_.bounds; }

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
        return by_id<Which, FieldValue<Tag, Number, d>>([&](auto k) { return download_of<Tag, k>(); });
    }

    /// A stored field where it lies, in memory of the backend: `view<DisplacementGradient>()`. Nothing is
    /// copied; it holds until the next call that changes the scene.
    template <class Tag, class Which = Every>
    auto view() const
    {
        static_assert(Of<Which>::Stored::template contains<Tag>,
                      "this field is taken from the grid when asked for: use download, or write_positions");
        return particles<Of<Which>::place>().template view<Tag>();
    }

    /// Writes world positions [m], by rising id, to memory that the backend's loops reach: axis a of the i-th
    /// particle goes to `to[i * stride + a]`. On a device the work is queued in the backend's stream: a
    /// renderer's buffer that was mapped there needs no copy.
    template <class Which = Every>
    void write_positions(Number* to, std::size_t stride = d) const
    {
        auto const visit = entrance_.to_look("Solver::write_positions");
        require(to != nullptr && stride >= d, "there is no place for positions, or they would overlap",
                "Solver::write_positions",
                "Pass room for size() times stride numbers, stride at least the dimension.");
        auto const& table = particles<Of<Which>::place>();
        backend_.for_each_place(table.cells(), table.position_writer(to, stride));
    }

    /// Masses [kg], by rising id.
    template <class Which = Every>
    std::vector<double> masses() const
    {
        return by_id<Which, double>([&](auto k) { return particles<k>().masses(masses_.unit); });
    }

    /// How the particles of all materials lie in the cells now: too few to a cell, parted, alone? Found when
    /// it is asked for, by the host, in the time of some steps; steps compute nothing for it.
    Occupancy occupancy() const
    {
        auto const visit = entrance_.to_look("Solver::occupancy");
        std::vector<Coordinates<d>> cells;
        for_each_material([&](auto k) { particles<k>().add_cells(cells); });
        return detail::CellNeighbours<d>(std::move(cells), Kernel::order).occupancy();
    }

    /// All that the next steps depend on, in memory of the host.
    ///
    /// The solver goes on from it as one does that restores it: both give afresh in their next step, as after
    /// add(), and from then on are alike, bit by bit, with the same calls. What particles have stays as it
    /// is; steps that follow differ by a rounding from those without a snapshot.
    Snapshot<Number, d> snapshot()
    {
        auto const visit = entrance_.to_change("Solver::snapshot");
        hold_taken();
        Snapshot<Number, d> to{.kernel = detail::name_of_policy<Kernel>(),
                               .transfer = detail::name_of_policy<Transfer>(),
                               .kernel_order = Kernel::order,
                               .lattice = lattice_,
                               .time = course_.time,
                               .previous = course_.previous,
                               .last = course_.last,
                               .bounds = course_.bounds,
                               .masses = masses_,
                               .next_id = next_id_};
        for_each_material([&](auto k) {
            to.materials.push_back(particles<k>().snapshot());
            name_material<k>(to.materials.back());
        });
        for_each_material([&](auto k) { particles<k>().restore(to.materials[k]); });
        go_on_from(to);
        return to;
    }

    /// Takes the state of a snapshot, whatever was there before: of a solver of the same lattice, kernel,
    /// transfer and materials, whose backend and step control may differ. With the same backend, lanes and
    /// parameters the steps that follow are those of the solver that made it, bit by bit.
    ///
    /// Throws an Error, and changes nothing, if it does not fit, or is none that snapshot() can have
    /// returned.
    void restore(Snapshot<Number, d> const& from)
    {
        auto const visit = entrance_.to_change("Solver::restore");
        require_fits(from);
        detail::require_whole(from, Cells::largest_coordinate);
        Parts parts = parts_of(materials_of(Places{}), Places{});
        for_each_material([&](auto k) {
            auto& table = std::get<k>(parts).particles;
            table.restore(from.materials[k]);
            if constexpr (may_object<k>)
                table.for_each([&](std::uint32_t row, auto const& particle) {
                    require_bearable<k>(table, row, particle, "Solver::restore");
                });
        });
        parts_ = std::move(parts);
        go_on_from(from);
    }

    /// Bytes held by particles and grid, spare capacity included.
    std::size_t memory() const
    {
        std::size_t bytes = grid_.memory();
        for_each_material([&](auto k) { bytes += particles<k>().memory(); });
        return bytes;
    }

private:
    using Grid = typename Backend::template Grid<
        Number, d, Kernel::order, NodeSums<d, Transfer::keeps_old_velocity>::channels,
        NodeVelocities<d, Transfer::keeps_old_velocity>::channels, static_cast<int>(materials)>;
    using Cells = typename Of<Material<0>>::Table::Cells;
    using Rule = StepRule<static_cast<int>(materials)>;
    using Failures = std::vector<StepFailure>;

    /// A material of the scene: all materials have a layer of the grid each, in the same order.
    template <std::size_t k>
    struct Part
    {
        typename Of<Material<k>>::Model model;
        typename Of<Material<k>>::Table particles;
    };

    template <std::size_t... k>
    static std::tuple<Part<k>...> tuple_of_parts(std::index_sequence<k...>);
    using Parts = decltype(tuple_of_parts(Places{}));

    template <std::size_t... k>
    Parts parts_of(List list, std::index_sequence<k...>)
    {
        return Parts{Part<k>{std::move(std::get<k>(list.of)),
                             typename Of<Material<k>>::Table(lattice_, Kernel::order, backend_)}...};
    }

    template <std::size_t... k>
    List materials_of(std::index_sequence<k...>) const
    {
        return List{model_of<k>()...};
    }

    /// Says in a snapshot what the model of a material is.
    template <std::size_t k>
    void name_material(MaterialSnapshot<Number, d>& material) const
    {
        using Here = typename Of<Material<k>>::Model;
        auto at_rest = Record<Number, d, typename Here::State>::at_rest();
        auto const response =
            model_of<k>().template respond<Number>(at_rest, Matrix<Number, d>::Zero(), Number(0));
        material.name = detail::name_of_policy<Here>();
        material.density = double(model_of<k>().density);
        material.wave_modulus = double(response.wave_modulus);
    }

    /// Refuses the snapshot of another kind of solver.
    void require_fits(Snapshot<Number, d> const& from) const
    {
        auto const same = [](bool condition, std::string const& what, auto const& theirs, auto const& ours) {
            if (condition) return;
            std::ostringstream text;
            text.precision(17);
            text << "the snapshot has " << what << " " << theirs << ", this solver has " << ours;
            throw Error{
                text.str(), "Solver::restore",
                "Restore into a solver that was made with the same lattice, policies and parameters."};
        };
        auto const compare = [&](std::string const& what, auto const& theirs, auto const& ours) {
            same(theirs == ours, what, theirs, ours);
        };
        compare("the kernel", from.kernel, detail::name_of_policy<Kernel>());
        compare("a kernel of order", from.kernel_order, Kernel::order + 0);
        compare("the transfer", from.transfer, detail::name_of_policy<Transfer>());
        compare("a cell size [m] of", from.lattice.cell_size, lattice_.cell_size);
        same(from.lattice.origin == lattice_.origin, "the origin [m]", from.lattice.origin.transpose(),
             lattice_.origin.transpose());
        compare("this many materials:", from.materials.size(), materials + 0);
        for_each_material([&](auto k) {
            MaterialSnapshot<Number, d> ours;
            name_material<k>(ours);
            auto const& theirs = from.materials[k];
            std::string const place = "material " + std::to_string(k);
            compare("for " + place, theirs.name, ours.name);
            compare("for " + place + " the density [kg/m^3]", theirs.density, ours.density);
            // some processors' exponentials differ in the last bit
            same(std::abs(theirs.wave_modulus - ours.wave_modulus) <= 1e-5 * ours.wave_modulus,
                 "for " + place + " the wave modulus at rest [Pa]", theirs.wave_modulus, ours.wave_modulus);
            Of<Material<k>>::Table::require_same_fields(theirs, place + " (" + ours.name + ")");
        });
    }

    /// Whether the model of a material may object to a state from outside.
    template <std::size_t k>
    static constexpr bool may_object =
        ObjectsToStates<typename Of<Material<k>>::Model, Record<Number, d, typename Of<Material<k>>::Stored>>;

    /// Throws an Error if it does, for the particle of a row of a table.
    template <std::size_t k, class Particle>
    void require_bearable(typename Of<Material<k>>::Table const& table, std::uint32_t row,
                          Particle const& particle, char const* call) const
    {
        std::string const objection = model_of<k>().objection(particle);
        if (objection.empty()) return;
        std::string where = std::string(call) + ", value " + std::to_string(row) + ", particle " +
                            std::to_string(table.id(row));
        if (materials > 1) where += " of " + detail::name_of_material<typename Of<Material<k>>::Model>(k);
        throw Error{objection, where, "Pass a state that the material could have come to."};
    }

    /// Goes on from a snapshot whose particles are there already: grid, and what was planned, begin afresh.
    void go_on_from(Snapshot<Number, d> const& from)
    {
        grid_ = Grid(backend_);
        masses_ = from.masses;
        next_id_ = from.next_id;
        course_ = {.time = from.time, .bounds = from.bounds, .previous = from.previous, .last = from.last};
        given_for_ = 0;
        movers_gave_ = false;
        spoiled_ = false;
        walls_.clear();
    }

    template <std::size_t k>
    auto& particles()
    {
        return std::get<k>(parts_).particles;
    }
    template <std::size_t k>
    auto const& particles() const
    {
        return std::get<k>(parts_).particles;
    }
    template <std::size_t k>
    auto const& model_of() const
    {
        return std::get<k>(parts_).model;
    }

    /// Calls `use(place)` for every material, `place` being a constant.
    template <class Use>
    static void for_each_material(Use const& use)
    {
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (use(std::integral_constant<std::size_t, k>{}), ...);
        }
        (Places{});
    }

    /// Whether a call with `Which` is about this material.
    template <class Which, std::size_t k>
    static constexpr bool is_about =
        detail::PlaceOf<Which, List>::value == k || detail::PlaceOf<Which, List>::value == materials;

    /// What `ask(place)` says of one material by rising id, or of all.
    template <class Which, class Value, class Ask>
    std::vector<Value> by_id(Ask const& ask) const
    {
        auto const visit = entrance_.to_look("Solver::download");
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

    template <class Tag, std::size_t k>
    std::vector<FieldValue<Tag, Number, d>> download_of() const
    {
        auto const& table = particles<k>();
        if constexpr (Of<Material<k>>::Stored::template contains<Tag>)
            return table.template download<Tag>();
        else if (table.holds_taken())
            return table.held().template by_row<Tag>(table.size());
        else {
            auto const taken = table.new_taken();
            take_again<k>(taken.view());
            return taken.template by_row<Tag>(table.size());
        }
    }

    /// The cells of all materials.
    std::array<Cells*, materials> orders()
    {
        std::array<Cells*, materials> orders{};
        for_each_material([&](auto k) { orders[k] = &particles<k>().cells(); });
        return orders;
    }

    /// How steps are chosen, as far as the materials alone say.
    Rule rule_of_materials() const
    {
        Rule rule{.control = control_, .cell_size = lattice_.cell_size};
        for_each_material([&](auto k) {
            auto const& model = model_of<k>();
            double expansion_ratio = d; // the largest there is, for models that do not say
            if constexpr (requires { model.elasticity.expansion_ratio(d); })
                expansion_ratio = model.elasticity.expansion_ratio(d);
            MaterialLimits& limits = rule.limits[k];
            limits.wave = isolated_limit<Kernel, Transfer>(expansion_ratio);
            if constexpr (Viscous<typename Of<Material<k>>::Model>)
                limits.shear = shear_limit(limits.wave, model.kinematic_viscosity(), lattice_.cell_size,
                                           expansion_ratio);
        });
        return rule;
    }

    /// How the steps of a call with these effects are chosen.
    template <class... Effects>
    Rule rule_for(Effects const&... effects)
    {
        course_.ready = false; // it was for other effects, and another end
        course_.retries = 0;
        Rule rule = rule_of_materials();
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
    void choose(Rule const& rule)
    {
        if (course_.given.interval.forces != given_for_) course_.given = {};
        rule.choose(course_);
    }

    /// Takes the step that was chosen and those after it, `most` in all: as many as the backend queues, and
    /// as long as they go as planned. `visit` is called with the record of each. A step that goes wrong
    /// leaves the particles, and what they gave, as it was.
    ///
    /// With several materials one step is queued at a time.
    template <class Effects, class Visit>
    StepLog const& run(Rule const& rule, std::size_t most, Effects const& effects, Visit const& visit)
    {
        constexpr int count = static_cast<int>(materials);
        using Actions = decltype(effects.template during<Number, d>(Interval{}));
        using Now = StepNow<Number, Actions>;
        using Log = RunLog<Actions::obstacles, count>;
        static_assert(std::is_trivially_destructible_v<Now>, "an effect's action is a plain value");
        auto& cells = particles<0>().cells();
        int const expected = count > 1 ? 1
                                       : static_cast<int>(std::min<std::size_t>(
                                             most, std::min(queue_, backend_.steps_to_queue(cells))));
        using KeptRule = RunRule<Effects, count>;
        // an obstacle's quaternion is aligned more strictly than the two before it are long
        constexpr std::size_t rule_at =
            (2 * sizeof(Now) + alignof(KeptRule) - 1) / alignof(KeptRule) * alignof(KeptRule);
        now_.resize(std::max(now_.size(), rule_at + sizeof(KeptRule)));
        log_.resize(Log::bytes(expected));
        auto* const now = reinterpret_cast<Now*>(now_.data()); // of steps in turn
        Log const log = Log::over(log_.data(), expected);
        auto* const kept_rule = reinterpret_cast<KeptRule*>(now_.data() + rule_at);
        int const turn = now_turn_;

        for_each_material([&](auto k) { particles<k>().sort(); }); // into the order of cells
        grid_.follow(orders());                                    // blocks of nodes under them
        give_for(course_.now.interval.forces);
        backend_.for_each(Log::places(expected),
                          BeginSteps<Number, d, count, Effects, Actions>{
                              course_, {rule, densities(), effects}, kept_rule, log, now + turn});
        Sides const sides = sides_of(effects);
        using Update = UpdateGrid<Space, Kernel, Transfer, Actions>;
        auto const update = [&](int step) {
            extend_velocities();
            return backend_.for_each_node(
                cells, grid_, Update{now + (turn + step) % 2, lattice_, smallest_node_mass(), kept_share()});
        };
        auto const move = [&]<std::size_t k>(std::integral_constant<std::size_t, k>, int step) {
            using Here = Of<Material<k>>;
            auto& table = particles<k>();
            return MoveParticles<Space, typename Here::Model, Kernel, Transfer, Actions,
                                 typename Here::Stored, typename Here::Taken>{
                model_of<k>(),
                transfer_,
                now + (turn + step) % 2,
                table.current(),
                table.next(),
                sides.pushed[k] ? table.next_taken() : typename Here::Table::TakenView{},
                table.portions(),
                lattice_,
                Number(control_.rejection)};
        };
        auto const conclude = [&](int step) {
            return ConcludeStep<Number, d, count, Effects, Actions>{kept_rule, log, step,
                                                                    now + (turn + step + 1) % 2};
        };

        auto reacted = update(0);
        int queued = 1;
        bool lacked = false;
        Log heard{};
        if constexpr (count > 1) {
            [&]<std::size_t... k>(std::index_sequence<k...>)
            {
                backend_.move_each(orders(), std::array{grid_.layer(k)...},
                                   std::tuple{move(std::integral_constant<std::size_t, k>{}, 0)...}, reacted,
                                   conclude(0));
            }
            (Places{});
            heard = Log::over(const_cast<unsigned char*>(log_.fetch()), expected);
        }
        else {
            constexpr std::integral_constant<std::size_t, 0> only{};
            auto layer = grid_.layer(0);
            for (;; reacted = update(queued++)) {
                backend_.move(cells, layer, move(only, queued - 1), reacted, conclude(queued - 1));
                if (queued == expected) break;
                accept(sides); // as is to be expected
                particles<0>().sort();
                backend_.template scatter_movers<Scatter<0>>(cells, layer);
            }
            heard = Log::over(const_cast<unsigned char*>(log_.fetch()), expected);
            if constexpr (Backend::queues)
                if (lacked = cells.listen(); lacked) { // a step lacked room, and those after it did nothing
                    int const lacking = static_cast<int>(*heard.taken) - (wrong_after(heard) ? 0 : 1);
                    take_back(queued - 1 - lacking, queued - 1 - lacking, sides);
                    queued = lacking + 1;
                    do {
                        adopt(heard.at[lacking].course, lacking, true, sides);
                        backend_.complete(cells, layer, move(only, lacking), reacted, conclude(lacking));
                        heard = Log::over(const_cast<unsigned char*>(log_.fetch()), expected);
                    } while (cells.listen());
                }
        }
        int const taken = static_cast<int>(*heard.taken);
        spoiled_ = taken < queued && wrong_after(heard);
        if (taken == queued)
            accept(sides);
        else if constexpr (Backend::queues && count == 1)
            take_back(queued - 1 - taken, queued - 1 - taken + (spoiled_ ? 0 : 1), sides);
        StepLog const& last = heard.at[taken + (spoiled_ ? 1 : 0)];
        adopt(last.course, taken, spoiled_, sides);
        now_turn_ = (turn + taken) % 2;
        unstopped_ += static_cast<std::size_t>(taken);
        if (taken == expected && !lacked)
            queue_ = std::max<std::size_t>(queue_, 2 * taken);
        else {
            queue_ = std::max<std::size_t>(unstopped_ / 2, 1);
            unstopped_ = 0;
        }
        for (int i = 0; i < taken; ++i) visit(heard.records[i]);
        return last;
    }

    /// Of each material: whether what particles take from the grid was held beside them before a run, and
    /// whether its steps write it. Obstacles that push particles set what cannot be taken again, and where
    /// particles may be taken out after a step that went wrong, the grid is no longer there to take from.
    struct Sides
    {
        std::array<bool, materials> held{}, pushed{};
    };
    template <class Effects>
    Sides sides_of(Effects const& effects) const
    {
        Sides sides;
        for_each_material([&](auto k) {
            sides.held[k] = particles<k>().holds_taken();
            sides.pushed[k] =
                Of<Material<k>>::Taken::components(d) > 0 && (effects.touch_particles() || quarantine_ > 0);
        });
        return sides;
    }

    std::array<double, materials> densities() const
    {
        std::array<double, materials> densities{};
        for_each_material([&](auto k) { densities[k] = double(model_of<k>().density); });
        return densities;
    }

    /// Whether the step after those that were taken went wrong.
    template <class Log>
    static bool wrong_after(Log const& log)
    {
        return log.at[*log.taken + 1].wrong > 0;
    }

    /// Takes over what is known of the steps of a run; `begun` says whether one more was begun and not made.
    void adopt(Course const& course, int taken, bool begun, Sides const& sides)
    {
        course_ = course;
        for_each_material([&](auto k) {
            particles<k>().set_held(taken > 0 ? sides.pushed[k] : sides.held[k], sides.held[k]);
        });
        if (taken == 0) return;
        given_for_ = course_.given.interval.forces;
        movers_gave_ = begun;
    }

    /// Takes a step that was made, or soon will be, for done.
    void accept(Sides const& sides)
    {
        for_each_material([&](auto k) { particles<k>().accept(sides.pushed[k]); });
        grid_.accept();
    }

    /// Undoes that, and sort(), for steps that were queued and then not made.
    void take_back(int accepted, int sorted, Sides const& sides) requires Backend::queues
    {
        for_each_material([&](auto k) { particles<k>().take_back(accepted, sorted, sides.pushed[k]); });
        if (accepted % 2 != 0) grid_.accept(); // what was swapped is swapped back
    }

    template <class Record>
    StepReport report_of(Record const& record) const
    {
        StepReport report;
        report.dt = record.dt;
        report.time_of_forces = record.forces;
        report.stable_dt = record.stable;
        report.capped_of.assign(record.capped.begin(), record.capped.end());
        for (auto const capped : record.capped) report.capped += capped;
        for (Reaction const& received : record.reactions.of)
            report.reactions.push_back(
                {received.impulse * masses_.unit, received.angular_impulse * masses_.unit});
        return report;
    }

    template <std::size_t k>
    using Scatter = ParticlesToGrid<Space, typename Of<Material<k>>::Model, Kernel, Transfer,
                                    typename Of<Material<k>>::Stored, typename Of<Material<k>>::Taken>;

    /// All particles of a material give to the grid: all they have, or the impulse of a step alone.
    template <std::size_t k>
    void scatter(double dt, bool impulse_only)
    {
        auto& table = particles<k>();
        auto layer = grid_.layer(k);
        backend_.scatter(table.cells(), layer,
                         Scatter<k>{{},
                                    model_of<k>(),
                                    transfer_,
                                    table.current(),
                                    table.taken(),
                                    table.portions(),
                                    static_cast<Number>(dt),
                                    static_cast<Number>(lattice_.cell_size),
                                    impulse_only},
                         !impulse_only);
    }

    /// Brings the sums on the grid to what particles give to a step in which stresses act for so long [s]:
    /// they may have given already, and for another time.
    void give_for(double dt)
    {
        for_each_material([&](auto k) {
            if (given_for_ == 0)
                scatter<k>(dt, false);
            else {
                auto layer = grid_.layer(k);
                if (!movers_gave_)
                    backend_.template scatter_movers<Scatter<k>>(particles<k>().cells(), layer);
                if (given_for_ != dt) scatter<k>(dt - given_for_, true);
            }
        });
        movers_gave_ = true;
        given_for_ = dt;
    }

    /// Extends the velocities of nodes before their update, where the transfer does so: what particles give
    /// back lies where the next step's sums will, and those of this one come back.
    void extend_velocities()
    {
        if constexpr (ExtendsVelocities<Transfer>) {
            auto const on_nodes = [&](bool first) {
                backend_.for_each_node(particles<0>().cells(), grid_,
                                       ExtendVelocities<Space>{smallest_node_mass(), first});
            };
            on_nodes(true);
            for (int pass = 0; pass < transfer_.passes(); ++pass) {
                for_each_material([&](auto k) {
                    auto& table = particles<k>();
                    auto layer = grid_.layer(k);
                    backend_.give_back(table.cells(), layer,
                                       ReturnVelocities<Space, Kernel, typename Of<Material<k>>::Stored>{
                                           table.current(), table.portions()});
                });
                grid_.accept();
                on_nodes(false);
                grid_.accept();
            }
        }
    }

    /// The fields that particles take from the grid, as they took them in the last step.
    template <std::size_t k>
    void take_again(typename Of<Material<k>>::Table::TakenView const& taken) const
    {
        using Here = Of<Material<k>>;
        if constexpr (Here::Taken::components(d) > 0) {
            auto const layer = const_cast<Grid&>(grid_).layer(k); // it is only read
            backend_.take(
                particles<k>().cells(), layer,
                TakeVelocities<Space, Kernel, Transfer, typename Here::Stored, typename Here::Taken>{
                    {}, transfer_, particles<k>().ordered(), taken, static_cast<Number>(lattice_.cell_size)});
        }
    }

    /// Whether they are held beside the particles.
    bool holds_taken() const
    {
        bool holds = true;
        for_each_material([&](auto k) { holds = holds && particles<k>().holds_taken(); });
        return holds;
    }

    /// Holds them beside the particles, before what they are taken from changes.
    void hold_taken()
    {
        for_each_material([&](auto k) {
            if (particles<k>().holds_taken()) return;
            take_again<k>(particles<k>().place_for_taken());
            particles<k>().hold_taken();
        });
    }

    /// After a step that went wrong: the grid no longer has the velocities that particles took, but still
    /// what they gave. They take from that, without the forces of the step.
    void regain_velocities()
    {
        if (!spoiled_ || holds_taken()) return;
        for_each_material([&](auto k) { scatter<k>(-given_for_, true); });
        given_for_ = 0;
        extend_velocities();
        backend_.for_each_node(particles<0>().cells(), grid_,
                               UpdateGrid<Space, Kernel, Transfer, Chain<>>{
                                   reinterpret_cast<StepNow<Number, Chain<>> const*>(now_.data()), lattice_,
                                   smallest_node_mass(), kept_share()});
        hold_taken();
        spoiled_ = false;
    }

    /// The bounds of the next step, for states set from outside. How fast particles deform, and what they
    /// touch, is for a step to find: it stays what the last one found, an affine velocity aside.
    void find_bounds()
    {
        course_.bounds = {.deformation_rate = course_.bounds.deformation_rate,
                          .obstacle_speed = course_.bounds.obstacle_speed};
        Rule const rule = rule_of_materials();
        for_each_material([&](auto k) {
            double modulus = 0;
            particles<k>().for_each([&](std::uint32_t, auto& particle) {
                modulus = std::max(modulus, double(model_of<k>()
                                                       .template respond<Number>(
                                                           particle, Matrix<Number, d>::Zero(), Number(0))
                                                       .wave_modulus));
            });
            rule.admit(course_.bounds, static_cast<int>(k), wave_speed<k>(modulus));
            for (auto const& velocity : download_of<Velocity, k>())
                course_.bounds.speed = std::max(course_.bounds.speed, double(velocity.norm()));
            if constexpr (Of<Material<k>>::State::template contains<AffineVelocity>)
                for (auto const& rate : download_of<AffineVelocity, k>())
                    course_.bounds.deformation_rate =
                        std::max(course_.bounds.deformation_rate, double(rate.norm()));
        });
        course_.bounds = course_.bounds.finite();
    }

    template <std::size_t k>
    double wave_speed(double modulus) const
    {
        return std::sqrt(modulus / double(model_of<k>().density));
    }

    /// Below this share of a particle's mass, a node's momentum is rounding alone.
    Number smallest_node_mass() const
    {
        return Number(masses_.largest) * (std::is_same_v<Number, float> ? Number(1e-20) : Number(1e-40));
    }

    /// Of its own velocity that a particle keeps beside the grid's.
    Number kept_share() const
    {
        if constexpr (Transfer::keeps_old_velocity)
            return static_cast<Number>(transfer_.fraction);
        else
            return Number(0);
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

    /// Refuses a time [s] that would be lost to rounding: a host that passes such ones again and again would
    /// wait for ever.
    void require_to_last(double duration, char const* where) const
    {
        require(course_.time + duration > course_.time &&
                    static_cast<Number>(duration) >= std::numeric_limits<Number>::min(),
                "the time is too short: beside the solver's own, or in its precision, it is none", where,
                "Pass a longer one, or 0 to advance by nothing.");
    }

    /// Refuses walls that have particles behind them: looks where walls or particles are new.
    template <class... Effects>
    void require_before_walls(Effects const&... effects)
    {
        if constexpr ((std::is_same_v<Effects, ReflectingWall> || ...)) {
            // who moves by velocities of its own may swing a little beyond, where kernels still reach
            // mirrored nodes alone
            double const spared = Transfer::moves_with_grid ? 1e-3 : 0.5; // [cells]
            std::vector<ReflectingWall> walls;
            [[maybe_unused]] auto const look = [&](auto const& effect) {
                if constexpr (std::is_same_v<decltype(effect), ReflectingWall const&>) {
                    walls.push_back(effect);
                    if (std::ranges::find(walls_, effect) != walls_.end()) return;
                    for_each_material([&](auto k) {
                        auto const found = particles<k>().find(BehindWall(effect, lattice_, spared));
                        if (found.count > 0) fail_behind_wall<k>(found, effect);
                    });
                }
            };
            (look(effects), ...);
            walls_ = std::move(walls);
        }
        else
            walls_.clear();
    }

    template <std::size_t k>
    [[noreturn]] void fail_behind_wall(Doomed<Backend> const& found, ReflectingWall const& wall) const
    {
        auto const row = particles<k>().first_row(found);
        std::ostringstream what, where;
        what << "particle " << particles<k>().id(row);
        if (found.count > 1) what << " and " << found.count - 1 << " more";
        if (materials > 1) what << " of " << detail::name_of_material<typename Of<Material<k>>::Model>(k);
        what << (found.count > 1 ? " are" : " is") << " behind a reflecting wall";
        where << "at (" << particles<k>().position(row).transpose() << ") m, ReflectingWall across axis "
              << wall.axis << " at node " << wall.node;
        throw Error{
            what.str(), where.str(),
            "Put all particles on the wall's side before it is passed, or let it face the other way."};
    }

    /// What is wrong with a particle of a material, in a step that begins now.
    template <std::size_t k>
    StepFailure failure_of(std::uint32_t row, Mishap cause, double dt, std::uint64_t count) const
    {
        StepFailure failure{.cause = cause,
                            .particle = particles<k>().id(row),
                            .material = k,
                            .time = course_.time,
                            .dt = dt,
                            .count = count};
        failure.position.template head<d>() = particles<k>().position(row);
        return failure;
    }
    StepFailure failure_of(StepLog const& log, double dt) const
    {
        StepFailure failure;
        for_each_material([&](auto k) {
            if (static_cast<std::size_t>(log.material) == k)
                failure = failure_of<k>(log.particle, log.mishap, dt, log.wrong);
        });
        return failure;
    }

    /// Particles whose own state has no stress, at rest: they spoil what others take from the grid, so that
    /// the first one for which a step goes wrong may be another.
    Failures unusable(double dt) const
    {
        Failures found;
        for_each_material([&](auto k) {
            particles<k>().for_each([&](std::uint32_t row, auto& particle) {
                auto const response =
                    model_of<k>().template respond<Number>(particle, Matrix<Number, d>::Zero(), Number(0));
                bool const finite =
                    response.kirchhoff_stress.allFinite() && std::isfinite(double(response.wave_modulus));
                if ((response.inverted || !finite) && found.size() <= quarantine_) // one too many will do
                    found.push_back(
                        failure_of<k>(row, finite ? Mishap::inverted : Mishap::not_finite, dt, 1));
            });
        });
        for (auto& failure : found) failure.count = found.size();
        return found;
    }

    /// The particle that goes furthest in a step by itself, by its own velocity or by the waves in it, if
    /// that is more than a cell: by way of the grid others go wrong with it. Else the one that the log names.
    StepFailure culprit(StepLog const& log, double dt) const
    {
        StepFailure found = failure_of(log, dt);
        double furthest = lattice_.cell_size;
        for_each_material([&](auto k) {
            auto const velocities = download_of<Velocity, k>();
            std::optional<std::uint32_t> worst;
            particles<k>().for_each([&](std::uint32_t row, auto& particle) {
                auto const response =
                    model_of<k>().template respond<Number>(particle, Matrix<Number, d>::Zero(), Number(0));
                double const way = dt * std::max(double(velocities[row].norm()),
                                                 wave_speed<k>(double(response.wave_modulus)));
                if (!(way > furthest)) return;
                furthest = way;
                worst = row;
            });
            if (worst) found = failure_of<k>(*worst, log.mishap, dt, log.wrong);
        });
        return found;
    }

    /// Takes out of the scene, after a step that went wrong, whose own state has no stress or, if it is not
    /// to be tried once more (`last`), the culprit; see quarantine(). False, and nothing happens, if
    /// there is nobody, or they would be too many.
    bool isolate(StepLog log, double dt, bool last, Failures& isolated)
    {
        if (isolated_.size() >= quarantine_) return false;
        Failures culprits;
        if (log.mishap != Mishap::rejected || last) culprits = unusable(dt);
        if (culprits.empty() && last) culprits.push_back(culprit(log, dt));
        if (culprits.empty() || isolated_.size() + culprits.size() > quarantine_) return false;
        for_each_material([&](auto k) {
            std::vector<std::uint32_t> rows;
            for (auto const& failure : culprits)
                if (failure.material == k) rows.push_back(particles<k>().row(failure.particle));
            particles<k>().remove(particles<k>().doomed(rows));
        });
        given_for_ = 0;
        course_.retries = 0;
        course_.ready = false;
        find_bounds();
        isolated_.insert(isolated_.end(), culprits.begin(), culprits.end());
        isolated.insert(isolated.end(), culprits.begin(), culprits.end());
        return true;
    }

    /// The same where it is allowed. (By a pointer, so that only who asks for it waits for the compiler.)
    bool isolates(StepLog const& log, double dt, bool last, Failures& isolated)
    {
        return isolate_ != nullptr && (this->*isolate_)(log, dt, last, isolated);
    }

    [[noreturn]] void fail_to_get_on(StepLog const& lately)
    {
        regain_velocities();
        std::ostringstream what, where, remedy;
        what << "the stable time step fell to " << course_.now.interval.length() << " s, bounded by "
             << describe(course_.now.limit);
        where << "Solver::advance at t = " << course_.time << " s";
        remedy << "Check masses, moduli and velocities of the scene: wave speed " << course_.bounds.wave_speed
               << " m/s, fastest particle " << course_.bounds.speed << " m/s.";
        if (lately.wrong == 0) throw Error{what.str(), where.str(), remedy.str()};
        StepFailure const failure = failure_of(lately, course_.now.interval.length());
        what << ", since particle " << failure.particle << " " << describe(failure.cause);
        throw StepError{failure, what.str(), where.str(), remedy.str()};
    }

    [[noreturn]] void fail(StepLog const log, double dt) // a copy: what follows is logged, too
    {
        regain_velocities();
        StepFailure const failure = failure_of(log, dt);
        std::ostringstream what, where;
        what << "particle " << failure.particle;
        for_each_material([&](auto k) {
            if (materials > 1 && failure.material == k)
                what << " of " << detail::name_of_material<typename Of<Material<k>>::Model>(k);
        });
        what << " " << describe(failure.cause);
        if (failure.count > 1) what << ", as did " << failure.count - 1 << " more";
        where << "at (" << failure.position.template head<d>().transpose() << ") m, in a step of " << dt
              << " s at t = " << failure.time << " s";
        throw StepError{
            failure, what.str(), where.str(),
            "The state is that of the last good step. Take a smaller step, or look at what drives "
            "this particle: "
            "obstacles that close in on it, or a material far too stiff or too soft for its speed."};
    }

    detail::Entrance<typename Backend::SharedCount> entrance_;
    Lattice lattice_;
    Transfer transfer_;
    StepControl control_;
    Backend backend_;
    Parts parts_;
    Grid grid_;
    MassScale masses_;
    std::uint32_t next_id_ = 0;
    Course course_;
    std::size_t quarantine_ = 0; ///< how many may be taken out
    bool (Solver::*isolate_)(StepLog, double, bool, Failures&) = nullptr;
    Failures isolated_;                                   ///< who was taken out of the scene
    std::vector<ReflectingWall> walls_;                   ///< that nobody is behind: see require_before_walls
    typename Backend::template Array<unsigned char> now_; ///< two StepNow and a RunRule, of whatever effects
    typename Backend::template Outbox<unsigned char> log_; ///< a RunLog
    int now_turn_ = 0;          ///< which of the two it is that the next step finds
    std::size_t queue_ = 1;     ///< as many steps are worth while to queue: it went well with half as many
    std::size_t unstopped_ = 0; ///< steps since queued ones were stopped
    double given_for_ = 0;      ///< the grid holds what particles give, stresses for so long [s]; 0: nothing
    bool movers_gave_ = false;  ///< so have those that changed their cells since
    bool spoiled_ = false;      ///< a step went wrong: nodes do not hold the velocities of the last good one
};

} // namespace firn

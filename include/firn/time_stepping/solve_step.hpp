// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/cell_work.hpp>
#include <firn/core/components.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/phases/begin_solve.hpp>
#include <firn/phases/estimate_error.hpp>
#include <firn/phases/solve_nodes.hpp>
#include <firn/phases/solve_particles.hpp>
#include <firn/phases/solve_search.hpp>
#include <firn/phases/update_contact.hpp>
#include <firn/time_stepping/log_solve.hpp>
#include <firn/time_stepping/solve_loops.hpp>
#include <firn/time_stepping/solve_memory.hpp>
#include <firn/time_stepping/solve_report.hpp>
#include <firn/time_stepping/step_scene.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

// The velocities of nodes at the end of an implicit step, by Newton's method.
namespace firn
{

/// The solve of one step, from the sums that particles scattered to the velocities that they gather.
///
///   begin       v from the velocity without stress; what obstacles leave free
///   residual    particles try v and scatter the impulse of their stress; r, |r| and the preconditioner
///   search      H dv = -r by conjugate gradients: each product is one pass to the particles and back
///   try         v + a dv, a = 1 and halved until the incremental energy falls; then the residual again
///   conclude    effects act once more, with the impulse of stress, and obstacles receive their reactions
///
/// H = M + dt^2 K is symmetric, and K is that of the state at v (Gast et al. 2015, section 5). The change of
/// the incremental energy along a dv is found by its slopes at both ends, a (r(v) + r(v + a dv)) dv / 2:
/// differences of energies would be rounding errors in single precision near the solution.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
class SolveStep
{
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    using Scene = StepScene<Backend, Sets, Kernel, Transfer>;
    using Memory = StepMemory<Backend, Sets, Transfer>;
    using Context = StepContext<Number, Actions>;
    using Sums = SolveSums<d>;
    using Kept = KeptDirections<Backend, Space>;
    template <std::size_t k>
    using MaterialTraits = typename Sets::template MaterialTraits<k>;
    template <std::size_t k, template <class, class, class, class, class> class Pass>
    using PassOf = Pass<Space, typename MaterialTraits<k>::Model, Kernel, typename Transfer::Explicit,
                        typename MaterialTraits<k>::Stored>;

    static_assert(
        []<std::size_t... k>(std::index_sequence<k...>) {
            return (
                AnswersProduct<typename MaterialTraits<k>::Model, typename Backend::template Lane<Number>> &&
                ...);
        }(typename Sets::Places{}),
        "a material answers no product with its tangent, which implicit steps ask for: choose Fluid or a "
        "solid of firn/models, add a member product(state, change), see IMPLICIT.md, or choose "
        "SymplecticEuler");
    static_assert(!Sets::are_bodies,
                  "implicit steps know no Bodies that touch: choose Materials, or SymplecticEuler");
    static_assert(Actions::groups_at_surface == 0,
                  "implicit steps know no obstacles that act at their surface: let them act on nodes, or "
                  "choose SymplecticEuler");
    static_assert(!Actions::changes_impulse,
                  "LocalDamping, and any action with on_impulse, needs forces that an implicit step has not "
                  "found yet: choose Damping, or SymplecticEuler");

public:
    SolveStep(Memory& memory, Scene const& scene, Context const* now)
        : memory_(memory), scene_(scene), loops_(memory, scene), now_(now), by_(memory.transfer.integrator),
          own_(memory.solve), report_(memory.solve.report), at_rest_(memory.solve.at_rest),
          part_(at_rest_ ? 1 : Transfer::Integrator::part_of_step),
          dt_(scene.time_state.now.interval.length() * part_)
    {}

    /// Whether the velocities at the end of the step were found: nodes hold them as their solution, and the
    /// impulse of stress that goes with them.
    bool solve()
    {
        report_.begin_step();
        own_.refused = own_.loose = nullptr;
        own_.is_everywhere = false;
        Sums const start =
            loops_.sums_on_nodes(BesideWalls<BeginSolve<Space, Kernel, Transfer, Actions>, Actions>{
                {update(), at_rest_, static_cast<Number>(part_)}, now_});
        mass_ = start.first;
        if (!(mass_ > 0)) return report_.converged = true;
        if (start.refused > 0) {
            report_.where = place_of(start.where);
            return refuse(not_contact());
        }
        own_.is_everywhere = at_rest_ && start.held + start.touching == 0;
        if (own_.is_everywhere)
            return refuse("nothing holds the scene, so there is no state of rest to find");
        own_.coarse.clear();
        own_.kept.clear();
        touches_ = start.touching > 0;
        outside_ = std::sqrt(start.second / mass_);
        speed_ = at_rest_ ? 0 : std::sqrt(start.third / mass_);
        Sums at = residual();
        if (at_rest_)
            leave_load(at);
        else if (at.inverted > 0 || std::sqrt(at.first / mass_) > outside_ + speed_)
            start_nearer(at);
        if (!update_contact(start, at)) return false;
        if (at_rest_) outside_ = std::max(outside_, std::sqrt(at.first / mass_));
        while (!is_solved(at)) {
            if (!is_finite(report_.tolerance)) return false;
            if (report_.newton_of_step >= most_systems()) {
                if (!by_.fixed || !is_possible(at)) return false;
                break;
            }
            if (report_.newton_of_step == 0 && (at_rest_ || at.stiffest > stiff)) make_coarse_grids();
            search();
            if (!step_along(at) || !update_contact(start, at)) return false;
        }
        loops_.on_nodes(AcceptVelocities<Space, Kernel, Transfer>{});
        report_.converged = report_.residual <= report_.tolerance;
        return true;
    }

    /// Of a step that was solved: how long the next one may be, by the error and by how many linear systems
    /// it took. Errors go with the square of the length, and a tenth less of it is for those that grow. For
    /// systems it is the root of their ratio, as Ramm (1981) chooses load steps. Of fewer of them than the
    /// target it says nothing: a short step at the end of a call tells little of longer ones, and
    /// StepControl::growth lets them grow.
    ChosenStep longest_next()
    {
        constexpr double careful = 0.9;
        ChosenStep longest;
        if (at_rest_ || !(mass_ > 0)) return longest;
        double const length = dt_ / part_;
        int const systems = report_.newton_of_step;
        if (by_.target > 0 && !by_.fixed && systems > by_.target)
            longest.bound(length * std::sqrt(double(by_.target) / systems), StepLimit::convergence);
        if (by_.error > 0) {
            Sums const found = found_of_change();
            report_.error = std::sqrt(found.first / mass_);
            if (!is_accurate()) report_.where = place_of(found.where);
            longest.bound(careful * length * std::sqrt(by_.error / report_.error), StepLimit::accuracy);
        }
        return longest;
    }
    /// Whether the step can be taken: with up to twice the error that is asked for, else many would be
    /// repeated.
    bool is_accurate() const { return !(by_.error > 0 && report_.error > 2 * by_.error); }

    /// The grid update that ends this step of a batch. Returns the reactions of obstacles.
    auto conclude([[maybe_unused]] int step) const
    {
        ConcludeSolve<Space, Kernel, Transfer, Actions> const phase{update(), at_rest_,
                                                                    static_cast<Number>(1 / part_)};
        auto const found = memory_.backend.for_each_node(scene_.sets.orders(), grid(), phase);
        if constexpr (spans_ranks<Backend>) {
            for (auto* const group : scene_.groups) group->do_not_count();
            memory_.backend.for_each_other_node(scene_.sets.orders(), grid(), phase);
            for (auto* const group : scene_.groups) group->count(step);
        }
        return found;
    }

private:
    /// Of a node's stiffness: about the mean square of the kernel's gradient [1/cells^2].
    static constexpr double stiffness_of_kernel = 0.5;
    /// The stiffness of a node over its mass from which on coarse grids help: a wave through 4 or 5 cells.
    static constexpr double stiff = 10;

    auto& grid() const { return scene_.grid_state.grid(); }
    UpdateGrid<Space, Kernel, Transfer, Actions> update() const
    {
        return scene_.grid_state.grid_update(scene_.sets, now_, scene_.smallest_node_mass, scene_.mass_unit,
                                             false);
    }

    /// A pass from nodes to particles and back.
    template <template <class, class, class, class, class> class Pass>
    void pass()
    {
        Sets::for_each([&](auto k) {
            auto& table = scene_.sets.template particles<k>();
            auto layer = grid().layer(k);
            using Phase = PassOf<k, Pass>;
            Phase phase;
            phase.model = scene_.sets.template model<k>();
            phase.particles = table.current();
            auto const trial = own_.template trial<k>(table.size());
            phase.offset = trial.part(Fields<KeptOffset>{});
            phase.tangent = trial.part(typename CachedTangent<typename MaterialTraits<k>::Model>::Kept{});
            phase.mass_groups = table.mass_groups();
            phase.dt = static_cast<Number>(dt_);
            phase.inverse_cell_size = static_cast<Number>(1 / memory_.lattice.cell_size);
            phase.at_rest = at_rest_;
            memory_.backend.for_each_cell(table.cells(), layer, phase);
        });
    }

    /// The residual of the velocities to try.
    Sums residual()
    {
        pass<TryVelocities>();
        ++report_.passes;
        double const in_cells = dt_ / memory_.lattice.cell_size;
        FindResidual<Space, Kernel, Transfer> const find{
            {}, at_rest_, static_cast<Number>(stiffness_of_kernel * in_cells * in_cells)};
        return loops_.on_passed([&] {
            return loops_.sums_on_nodes(BesideWalls<decltype(find), Actions>{find, now_});
        });
    }

    /// Finds anew which nodes obstacles hold, and how they rub, at the velocities that were tried. `at`
    /// becomes the residual of what they leave. False if the scene is to rest and they let go of all of it.
    bool update_contact(Sums const& start, Sums& at)
    {
        if (start.touching == 0) return true;
        auto const found =
            loops_.on_nodes(BesideWalls<UpdateContact<Space, Kernel, Transfer, Actions>, Actions>{
                {{update(), at_rest_, static_cast<Number>(part_)}, static_cast<Number>(weight_of_contact())},
                now_});
        if (at_rest_) {
            std::uint64_t const held = merged_result(memory_.backend, own_.sums, found).held;
            if (start.held + held == 0) {
                own_.loose = "the load lifts the scene off all that it touches, and nothing else holds it";
                own_.is_everywhere = true;
                return false;
            }
            changes_ += held != held_ ? 1 : 0;
            held_ = held;
        }
        at = residual();
        return true;
    }
    /// By which stiffness of nodes contact is found, over their own. A node may stick and slide by turns at
    /// one weight, and seldom does at several.
    double weight_of_contact() const
    {
        constexpr int usual = 8;
        constexpr double others[]{4, 0.25, 16, 0.0625, 1};
        int const more = report_.newton_of_step - usual;
        return more < 0 ? 1 : others[more % 5];
    }
    /// The most linear systems. At rest three times as many: a beam that hangs down by two thirds of its
    /// length takes 27 of them in one load step, where four load steps take 98. Nor do those count after
    /// which obstacles hold other nodes: the end of a contact moves by a cell in each, so it takes as many as
    /// it moves by cells.
    int most_systems() const
    {
        return at_rest_ ? 3 * by_.newton + std::min(changes_, 10 * by_.newton) : by_.newton;
    }
    /// Leaves a share of the load for other load steps, if there are any.
    void leave_load(Sums& at)
    {
        if (!(own_.left_out > 0)) return;
        loops_.on_nodes(BesideWalls<LeaveLoad<Space, Kernel, Transfer, Actions>, Actions>{
            {{update(), at_rest_, static_cast<Number>(part_)}, static_cast<Number>(own_.left_out)}, now_});
        at = residual();
    }
    /// Where outside forces alone would take nodes too far for a start: starts from what obstacles prescribe,
    /// if the residual is less there. A load on a stiff body would shear it without bounds, for example.
    void start_nearer(Sums& at)
    {
        auto const start_from = [&](Number share) {
            loops_.on_nodes(ChooseVelocities<Space, Kernel, Transfer>{{}, share});
            at = residual();
        };
        double const before = at.inverted > 0 ? std::numeric_limits<double>::infinity() : at.first;
        start_from(-1);
        if (!(at.first <= before)) start_from(0);
    }

    /// Solves for the change by conjugate gradients, preconditioned by the nodes' diagonal and by coarse
    /// grids.
    void search()
    {
        ++report_.newton, ++report_.newton_of_step;
        if constexpr (Kept::possible) own_.kept.template begin_system<Kernel, Transfer>();
        if (own_.coarse.are_there())
            own_.coarse.template weigh<Kernel, Transfer>(grid(), at_rest_, stiffness_of_kernel);
        own_.search.resize(1);
        SearchState* const search = own_.search.data();
        own_.progress.begin();
        precondition(BesideWalls<AcceptVelocities<Space, Kernel, Transfer>, Actions>{{}, now_},
                     BeginSearch{search, forcing(), own_.coarse.added(), own_.progress.there()});
        if constexpr (Backend::queues) {
            for (int queued = 0; queued < by_.linear && goes_on(queued); ++queued) iterate(search);
            own_.search.fetch(); // the host does not wait before it has queued the residual, too
        }
        else
            for (int i = 0; i < by_.linear; ++i) {
                iterate(search);
                if (own_.search.read()->has_ended) break;
            }
    }
    /// Counts the products of the last search. Returns the slope of the incremental energy along the change,
    /// r dv, which is below 0.
    double slope_of_search()
    {
        SearchState const found = *own_.search.read();
        report_.products += found.products;
        report_.passes += found.products;
        return found.slope;
    }
    /// Whether to queue another iteration behind so many: waits until the one before the last has finished.
    /// So the device always has the next one, and one at most is queued in vain.
    bool goes_on(int queued)
    {
        constexpr int ahead = 2;
        if (queued < ahead || by_.fixed) return true;
        auto const now = own_.progress.look([&](std::uint32_t number) {
            SearchProgress const so_far{number};
            return so_far.has_ended() || so_far.products() > queued - ahead;
        });
        return !SearchProgress{now}.has_ended();
    }
    /// The share of its residual at which a search ends. Where directions are kept those of a longer search
    /// are of use to the next ones, so this takes fewer systems and no more products.
    double forcing() const
    {
        if (by_.fixed) return 0;
        return own_.kept.are_kept() ? 0.3 * by_.forcing : by_.forcing;
    }
    /// An iteration of conjugate gradients.
    void iterate(SearchState* search)
    {
        loops_.on_nodes(TurnSearch<Space, Kernel, Transfer>{{}, search});
        pass<ProductOfStress>();
        [[maybe_unused]] auto const curvature = loops_.on_passed([&] {
            return loops_.on_nodes(
                BesideWalls<FindCurvature<Space, Kernel, Transfer>, Actions>{{{}, at_rest_}, now_},
                ChooseLength{search, own_.progress.there()});
        });
        if constexpr (Kept::possible)
            if (own_.kept.are_kept()) own_.kept.template keep<Kernel, Transfer>(curvature.sum);
        precondition(BesideWalls<AdvanceSearch<Space, Kernel, Transfer>, Actions>{{{}, search}, now_},
                     ChooseDirection{search, own_.coarse.added(), own_.progress.there()});
    }
    /// Calls a phase that preconditions the residual of nodes, completes that by what coarse grids find, or
    /// earlier searches have found, and calls `body(r z)` where loops run, without what coarse grids add.
    template <class Phase, class Body>
    void precondition(Phase const& phase, Body const& body)
    {
        if (own_.coarse.are_there())
            return own_.coarse.template correct<Kernel, Transfer>(grid(), loops_.on_nodes(phase), body);
        if constexpr (Kept::possible)
            if (own_.kept.are_there()) {
                auto found = loops_.on_nodes(phase);
                found.sum = own_.kept.template condition<Kernel, Transfer>(touches_);
                return call_with(memory_.backend, found, body);
            }
        loops_.on_nodes(phase, body);
    }
    /// Makes the coarse grids under the particles. They know no ends of a periodic lattice.
    void make_coarse_grids()
    {
        bool is_periodic = false;
        for (int const period : memory_.lattice.periods) is_periodic = is_periodic || period != 0;
        if (!by_.coarse || is_periodic) return;
        own_.coarse.template begin<Kernel, Transfer>(scene_.sets, now_, grid(), scene_.smallest_node_mass);
        if constexpr (Kept::possible)
            if (auto const& extent = own_.coarse.extent(); extent.is_small())
                own_.kept.template begin<Kernel, Transfer>(
                    grid(), extent.first_node(), extent.last_node(), [&] {
                        loops_.on_nodes(BesideWalls<MarkCounted<Space, Kernel, Transfer>, Actions>{{}, now_});
                    });
    }

    /// Tries the change and, while the incremental energy does not fall enough, half of it. `at` becomes the
    /// residual there. In a step of a fixed number of iterations an eighth is the last that is tried, and
    /// taken unless it turns a particle inside out. So it has three residuals more for each system at most.
    bool step_along(Sums& at)
    {
        constexpr double armijo = 1e-4, least = 0x1p-3;
        std::optional<double> slope;
        for (double share = 1; share > 0x1p-13; share /= 2) {
            loops_.on_nodes(ChooseVelocities<Space, Kernel, Transfer>{{}, static_cast<Number>(share)});
            at = residual();
            if (!slope) slope = slope_of_search();
            if (drifts(at)) return false;
            bool const falls = at.second <= (1 - 2 * armijo) * -*slope;
            if (is_possible(at) && (falls || (by_.fixed && share <= least))) return true;
            ++report_.halvings;
            if (by_.fixed && share <= least) break;
        }
        note(at);
        return false;
    }
    /// Whether a step with the velocities that were tried leaves a state.
    static bool is_possible(Sums const& at) { return at.inverted == 0 && is_finite(at.first); }
    /// Whether the residual is small enough; says so in the report. Where stiffness is beyond all numbers, so
    /// is the tolerance, and nothing is solved.
    bool is_solved(Sums const& at)
    {
        note(at);
        return is_finite(report_.tolerance) &&
               report_.residual <= (by_.fixed ? rounding_ : report_.tolerance);
    }
    /// Whether the scene is to go so far in one load step that nothing can hold it along that way.
    bool drifts(Sums const& at)
    {
        constexpr double farthest = 1e3; // [cells]
        if (!at_rest_ || std::sqrt(at.third / mass_) < farthest * memory_.lattice.cell_size) return false;
        own_.loose = "the scene is free to slide or to turn, and the load drives it there";
        // where it goes furthest, beside which velocities that it had are nothing
        loops_.on_nodes(AcceptVelocities<Space, Kernel, Transfer>{});
        report_.where = place_of(found_of_change().where);
        return true;
    }
    /// What EstimateError finds of the change of velocities.
    Sums found_of_change() const
    {
        return loops_.sums_on_nodes(BesideWalls<EstimateError<Space, Kernel, Transfer>, Actions>{
            {{}, static_cast<Number>(dt_)}, now_});
    }
    void note(Sums const& at)
    {
        double const speed = std::sqrt(at.third / mass_),
                     scale = at_rest_ ? 1e-2 * outside_ : std::max(outside_, 1e-2 * std::max(speed_, speed));
        report_.residual = std::sqrt(at.first / mass_);
        report_.tolerance = by_.tolerance > 0 ? by_.tolerance : by_.share * scale;
        // velocities are rounded, and so is the stress by which nodes resist their differences
        rounding_ = double(std::numeric_limits<Number>::epsilon()) * speed * (1 + 2 * at.stiffest);
        report_.tolerance = std::max(report_.tolerance, rounding_);
        report_.largest = std::sqrt(at.most);
        report_.where = place_of(at.where);
    }
    Eigen::Vector3d place_of(Coordinates<d> const& node) const
    {
        Vector<double, d> place;
        for (int a = 0; a < d; ++a)
            place[a] = memory_.lattice.origin[a] + memory_.lattice.cell_size * node[a];
        return in_space<d>(place);
    }

    bool refuse(char const* why)
    {
        own_.refused = why;
        return false;
    }
    char const* not_contact() const
    {
        return at_rest_ ? "at rest obstacles stand still: one of the effects moves, or it changes velocities "
                          "in another way than to prescribe some of their components or to touch as an "
                          "obstacle does"
                        : "an effect does more to velocities of nodes than to prescribe some of their "
                          "components or to touch as an obstacle does, which implicit steps do not know";
    }

    Memory& memory_;
    Scene const& scene_;
    SolveLoops<Memory, Scene> loops_;
    Context const* now_;
    Implicit const by_;
    SolveMemory<Backend, Sets>& own_;
    SolveReport& report_;
    bool at_rest_;
    bool touches_ = false;                      ///< obstacles may let go of nodes, or rub
    double part_;                               ///< of the step, after which stress acts
    double dt_;                                 ///< until then [s]
    std::uint64_t held_ = 0;                    ///< nodes that obstacles hold which may let go, at rest
    int changes_ = 0;                           ///< how often that changed
    double mass_ = 0, outside_ = 0, speed_ = 0; ///< [mass units], [m/s], [m/s]
    double rounding_ = 0;                       ///< of the residual [m/s]
};

} // namespace firn

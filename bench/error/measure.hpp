// SPDX-License-Identifier: MIT
#pragma once

#include "settings.hpp"
#include "timing.hpp"

#include "problems/column.hpp"
#include "problems/disks.hpp"
#include "problems/manufactured.hpp"
#include "problems/sand_column.hpp"
#include "problems/snow_block.hpp"
#include "problems/stiff_beam.hpp"
#include "problems/water_tank.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace firn::bench
{

namespace detail
{
template <class Backend>
Backend backend_of(Patience const& patience)
{
    if constexpr (requires(Backend backend) { backend.threads; })
        return {patience.threads};
    else
        return {};
}
} // namespace detail

/// Solves a problem with a setting until enough runs have been timed. The clock runs while time advances, but
/// not during the set-up or the comparison of states.
///
/// A run that fails is a row like others, with its status.
template <template <class> class Problem, class Scene>
Row measure(Setting const& setting, Patience const& patience, typename Scene::Transfer const& transfer)
{
    using Clock = std::chrono::steady_clock;
    Row row;
    row.model = Scene::Model::name;
    row.dimensions = Scene::d;
    row.bytes_per_particle = Problem<Scene>::Solver::bytes_per_particle;
    try {
        StepControl control;
        control.wave = setting.cfl_fraction;
        control.smallest = 1e-5; // with the tent some runs reach steps so short that they would never end
        Problem<Scene> problem(setting.cells, setting.per_cell, transfer, control,
                               detail::backend_of<typename Scene::Backend>(patience));
        auto const start = problem.solver.snapshot();
        std::vector<double> seconds;
        double all = 0;
        row.cpu_seconds = std::numeric_limits<double>::infinity();
        do {
            double wall = 0, processor = 0;
            AdvanceReport report;
            for (int piece = 0; piece < Problem<Scene>::pieces; ++piece) {
                double const processor_before = processor_seconds();
                auto const before = Clock::now();
                report.merge(problem.advance(piece));
                wall += std::chrono::duration<double>(Clock::now() - before).count();
                processor += processor_seconds() - processor_before;
                if (row.runs == 0) problem.observe(piece);
            }
            if (row.runs == 0) {
                row.error = problem.error();
                if constexpr (requires { problem.energy_lost(); }) row.energy_lost = problem.energy_lost();
                row.steps = report.substeps;
                row.rejected = report.rejected;
                row.particle_steps =
                    double(report.substeps + report.rejected) * double(problem.solver.size());
            }
            all += wall;
            ++row.runs;
            seconds.push_back(wall);
            row.cpu_seconds = std::min(row.cpu_seconds, processor);
            problem.solver.restore(start);
        } while (patience.asks_for_more(row.runs, all));
        if (seconds.size() > 1) seconds.erase(seconds.begin()); // the warm-up
        std::sort(seconds.begin(), seconds.end());
        row.seconds = seconds[seconds.size() / 2];
        row.spread = 0.5 * (seconds[(3 * seconds.size()) / 4] - seconds[seconds.size() / 4]) / row.seconds;
        row.status = !std::isfinite(row.error) ? "failed: not finite"
                     : row.error > 1           ? "failed: no solution"
                                               : "ok";
    }
    catch (Error const& error) {
        row.status = std::string("failed: ") + error.what();
        row.cpu_seconds = 0;
    }
    return row;
}

namespace detail
{
template <class Kernel, class Transfer, class Number>
void offer(Offer& offers, std::string const& transfer_name, Transfer const& transfer)
{
    using Plane = Space<2, Number>;
    using Elastic = test::Scene<NeoHookean<Plane>, Kernel, Transfer>;
    using Grains = test::Scene<Sand<Plane>, Kernel, Transfer>;
    using Snows = test::Scene<Snow<Plane>, Kernel, Transfer>;
    std::string const rest = std::string("/") + Kernel::name + "/" + transfer_name + "/" +
                             (std::is_same_v<Number, float> ? "float" : "double");
    auto const by = [&](std::string const& problem, auto const& run, std::string const& acts_on = "") {
        offers[problem + rest + acts_on] = [=](Setting const& setting, Patience const& patience) {
            return run(setting, patience, transfer);
        };
    };
    by("P1", measure<test::ManufacturedSolution, Elastic>);
    by("P2", measure<test::Column, Elastic>);
    if constexpr (Kernel::degree > 1 && (std::is_same_v<Transfer, Mls> || std::is_same_v<Transfer, Apic>)) {
        using Backend = test::TestedBackend;
        by("P9", measure<test::StiffBeam, Elastic>);
        if constexpr (!Backend::queues || std::is_same_v<Number, float>) { // both take nvcc long
            using Settled = test::Scene<NeoHookean<Plane>, Kernel, Transfer, Backend, Implicit>;
            by("P2", measure<test::Column, Settled>, "/settle");
            by("P9", measure<test::StiffBeam, Settled>, "/settle");
        }
    }
    by("P3", measure<test::CollidingDisks, Elastic>);
    by("P4", measure<test::SandColumn, Grains>);
    by("P5", measure<test::SnowBlock, Snows>);
    if constexpr (std::is_same_v<Number, float> && Kernel::degree > 1)
        by("P6",
           measure<test::ManufacturedSolution, test::Scene<NeoHookean<Space<3, Number>>, Kernel, Transfer>>);
    if constexpr (std::is_same_v<Transfer, Mls> && Kernel::degree > 1) {
        using Water = test::Scene<Fluid<Plane>, Kernel, Transfer>;
        using KeptWater = test::Scene<KeepsVolume<Fluid<Plane>>, Kernel, Transfer>;
        by("P7", measure<test::StillWater, Water>, "/nodes");
        by("P7", measure<test::StillWater, KeptWater>, "/surface");
        by("P8", measure<test::HalfImmersedDisk, Water>, "/nodes");
        by("P8", measure<test::HalfImmersedDisk, KeptWater>, "/surface");
    }
}
} // namespace detail

template <class Kernel, class Transfer>
void offer(Offer& offers)
{
    auto const with = [&](std::string const& name, Transfer const& transfer) {
        detail::offer<Kernel, Transfer, float>(offers, name, transfer);
        detail::offer<Kernel, Transfer, double>(offers, name, transfer);
    };
    if constexpr (std::is_same_v<Transfer, Flip>) {
        with("flip_0.95", Flip{});
        with("flip_1", Flip{.fraction = 1});
    }
    else
        with(Transfer::name, Transfer{});
}

} // namespace firn::bench

// SPDX-License-Identifier: MIT
#include "step.hpp"

#include <chrono>
#include <map>
#include <memory>

// The phases of a step, each by itself.
namespace firn::bench
{
namespace
{

using Clock = std::chrono::steady_clock;

/// Seconds by phase.
struct Times
{
    std::map<std::string, double> of;

    template <class Work>
    auto take(std::string const& phase, Work const& work)
    {
        struct Watch
        {
            double& sum;
            Clock::time_point start = Clock::now();
            ~Watch() { sum += std::chrono::duration<double>(Clock::now() - start).count(); }
        } const watch{of[phase]};
        return work();
    }
};

/// The OpenMP backend, with a watch on what a solver asks of it.
struct TimedOpenMP : OpenMP
{
    std::shared_ptr<Times> times = std::make_shared<Times>();

    template <class Number, int d>
    struct CellOrder : OpenMP::CellOrder<Number, d>
    {
        using Base = OpenMP::CellOrder<Number, d>;
        explicit CellOrder(TimedOpenMP const& backend) : Base(backend), times(backend.times) {}

        /// Times all of the rebinning here, so that it is separate from the scatter of the leavers.
        template <class Offsets>
        void begin_rebin(Offsets const& offsets)
        {
            times->take("order", [&] { Base::rebin(offsets); });
        }

        std::shared_ptr<Times> times;
    };

    template <class Order, class LayerType, class Phase>
    auto for_each_cell(Order& cells, LayerType& layer, Phase const& phase) const
    {
        auto const loop = [&] { return OpenMP::for_each_cell(cells, layer, phase); };
        if constexpr (!Phase::work.gathers) return times->take("scatter", loop);
        if constexpr (Phase::work.moves) {
            // These tiles are about to be cleared anyway.
            times->take("clear", [&] {
                for (std::size_t b = 0; b < cells.blocks().size(); ++b)
                    openmp::detail::clear_rows<LayerType, Phase::channels>(
                        layer.next_tile(b), openmp::detail::touched_by_items<LayerType>(cells, b));
            });
            return times->take("gather_and_scatter", loop);
        }
        return loop();
    }

    template <class Phase, class Order, class GridType>
    void scatter_leavers(Order& cells, GridType& grid) const
    {
        times->take("scatter_leavers", [&] { OpenMP::scatter_leavers<Phase>(cells, grid); });
    }

    template <class CellOrders, class GridType, class Phase>
    auto for_each_node(CellOrders const& cells, GridType& grid, Phase const& phase) const
    {
        return times->take("grid", [&] { return OpenMP::for_each_node(cells, grid, phase); });
    }
};

/// Times one phase of a step. `scatter` is what remains to be done where each step has another length than
/// the one before: particles have scattered for a wrong length and correct that.
template <class Model, class Kernel, class Transfer>
void phase(benchmark::State& run, std::string const& name, bool equal_steps, Layout layout, int count,
           int threads)
{
    TimedOpenMP backend;
    backend.threads = threads;
    Scene<Solver<TimedOpenMP, Model, Kernel, Transfer>> scene(layout, count, backend);
    double sum = 0;
    bool odd = false;
    for (auto _ : run) {
        double const before = backend.times->of[name];
        scene.step(equal_steps || (odd = !odd) ? scene.dt : 0.999 * scene.dt);
        double const took = backend.times->of[name] - before;
        run.SetIterationTime(took);
        sum += took;
    }
    run.counters["ns_per_particle"] = 1e9 * sum / double(run.iterations()) / double(scene.solver.size());
}

template <class Model, class Kernel, class Transfer>
void add(int threads)
{
    for (Layout layout : {Layout::lattice, Layout::random, Layout::splash})
        for (auto [name, equal_steps] : {std::pair{"clear", true},
                                         {"order", true},
                                         {"scatter_leavers", true},
                                         {"grid", true},
                                         {"gather_and_scatter", true},
                                         {"scatter", false}}) {
            int const count = 100000;
            std::string const entry = std::string("phase/") + name + "/openmp/" + Model::name + "/" +
                                      Kernel::name + "/" + Transfer::name + "/float/" +
                                      layout_names[int(layout)] + "/" + std::to_string(count);
            benchmark::RegisterBenchmark(
                entry.c_str(),
                [=, name = std::string(name), equal_steps = equal_steps](benchmark::State& run) {
                    phase<Model, Kernel, Transfer>(run, name, equal_steps, layout, count, threads);
                })
                ->Unit(benchmark::kMillisecond)
                ->UseManualTime();
        }
}

} // namespace

void add_phases(int threads)
{
    using S = Space<3, float>;
    add<NeoHookean<S>, QuadraticBSpline, Mls>(threads);
    add<Snow<S>, CubicBSpline, Flip>(threads);
}

} // namespace firn::bench

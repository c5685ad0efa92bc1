// SPDX-License-Identifier: MIT
// The cost of launching loops one behind another on a device, without work in them: as the backend does, and
// in a CUDA graph.
#include "step_cuda.hpp"

#include <chrono>
#include <utility>

namespace firn::bench
{
namespace
{

/// As many as a queue of 16 steps of a small scene has.
constexpr int loops_at_once = 16 * 5;

/// Counts, so that each loop needs what the one before wrote.
__global__ void count(unsigned* counter)
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    cudaTriggerProgrammaticLaunchCompletion();
    cudaGridDependencySynchronize();
#endif
    if (blockIdx.x == 0 && threadIdx.x == 0) ++*counter;
}

struct Loops
{
    cudaStream_t own = [] {
        cudaStream_t stream = nullptr;
        cuda::check(cudaStreamCreate(&stream), "cudaStreamCreate");
        return stream;
    }();
    cuda::Queue queue{0, own};
    cuda::Array<unsigned> counter{queue};

    Loops()
    {
        counter.renew(1);
        counter.fill_bytes(0, 1, 0);
    }
    ~Loops() { static_cast<void>(cudaStreamDestroy(own)); }

    /// Queues them; more than cuda::few_groups of `groups` are not made ready early.
    void start(unsigned groups) const
    {
        for (int i = 0; i < loops_at_once; ++i)
            cuda::launch_behind("count", queue, count, groups, 64, 0, const_cast<unsigned*>(counter.data()));
    }
};

/// The same loops as a graph.
class Graph
{
public:
    Graph(Loops const& loops, unsigned groups)
    {
        cuda::check(cudaStreamBeginCapture(loops.own, cudaStreamCaptureModeThreadLocal),
                    "cudaStreamBeginCapture");
        loops.start(groups);
        cuda::check(cudaStreamEndCapture(loops.own, &graph_), "cudaStreamEndCapture");
        cuda::check(cudaGraphInstantiate(&ready_, graph_, 0), "cudaGraphInstantiate");
    }
    ~Graph()
    {
        static_cast<void>(cudaGraphExecDestroy(ready_));
        static_cast<void>(cudaGraphDestroy(graph_));
    }
    Graph(Graph const&) = delete;
    Graph& operator=(Graph const&) = delete;

    void start(cudaStream_t stream) const { cuda::check(cudaGraphLaunch(ready_, stream), "cudaGraphLaunch"); }

private:
    cudaGraph_t graph_ = nullptr;
    cudaGraphExec_t ready_ = nullptr;
};

enum class Way
{
    queued,     ///< one by one
    graph,      ///< the same graph every time
    fresh_graph ///< one that is made for each call, as steps would need that read and write by turns
};

void launches(benchmark::State& run, Way way, unsigned groups)
{
    try {
        Loops const loops;
        Graph const graph(loops, groups);
        using Clock = std::chrono::steady_clock;
        std::chrono::duration<double> host{}, all{};
        for (auto _ : run) {
            auto const start = Clock::now();
            if (way == Way::queued)
                loops.start(groups);
            else if (way == Way::graph)
                graph.start(loops.own);
            else
                Graph(loops, groups).start(loops.own);
            host += Clock::now() - start;
            loops.queue.wait();
            all += Clock::now() - start;
        }
        double const each = 1e6 / (double(run.iterations()) * loops_at_once);
        run.counters["host_us_per_loop"] = host.count() * each;
        run.counters["us_per_loop"] = all.count() * each;
    }
    catch (Error const& error) {
        run.SkipWithError(error.what());
    }
}

} // namespace

void add_launches()
{
    for (auto [name, way] : {std::pair{"queued", Way::queued}, std::pair{"graph", Way::graph},
                             std::pair{"fresh_graph", Way::fresh_graph}})
        for (unsigned groups : {32u, 4096u})
            benchmark::RegisterBenchmark(
                ("launches/" + std::string(name) + "/" + std::to_string(groups)).c_str(),
                [=](benchmark::State& run) { launches(run, way, groups); })
                ->Unit(benchmark::kMicrosecond)
                ->Iterations(200)
                ->UseRealTime();
}

} // namespace firn::bench

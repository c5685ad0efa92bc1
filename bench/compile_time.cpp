// SPDX-License-Identifier: MIT
#include <benchmark/benchmark.h>

#include <cstdlib>

// How long a host engine waits for the compiler: one translation unit, optimised.
namespace firn::bench
{

void add_compile_time()
{
    benchmark::RegisterBenchmark("compile/minimal_host",
                                 [](benchmark::State& run) {
                                     for (auto _ : run)
                                         if (std::system(FIRN_BENCH_COMPILE) != 0)
                                             run.SkipWithError("the compiler failed: " FIRN_BENCH_COMPILE);
                                 })
        ->Unit(benchmark::kSecond)
        ->Iterations(1)
        ->UseRealTime();
}

} // namespace firn::bench

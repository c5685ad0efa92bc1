// SPDX-License-Identifier: MIT
// All benchmarks: `benchmarks [threads] [options of Google Benchmark]`.
#include "step.hpp"

#include <cstdlib>

int main(int argc, char** argv)
{
    using namespace firn;
    int threads = 1;
    if (argc > 1 && argv[1][0] != '-') {
        threads = std::max(1, std::atoi(argv[1]));
        argv[1] = argv[0];
        ++argv, --argc;
    }
    using S = Space<3, float>;
    bench::add_steps<NeoHookean<S>, QuadraticBSpline, Mls>(threads);
    bench::add_steps<FixedCorotated<S>, QuadraticBSpline, Mls>(threads);
    bench::add_steps<Snow<S>, QuadraticBSpline, Mls>(threads);
    bench::add_steps<Snow<S>, QuadraticBSpline, Apic>(threads);
    bench::add_steps<Snow<S>, CubicBSpline, Mls>(threads);
    bench::add_steps<Snow<S>, CubicBSpline, Flip>(threads);
    bench::add_material_steps(threads);
    bench::add_double_steps(threads);
    bench::add_phases(threads);
    bench::add_safety(threads);
#if FIRN_BENCH_SAMPLING
    bench::add_sampling(threads);
#endif
    bench::add_compile_time();
    benchmark::AddCustomContext("firn", openmp_info());
    benchmark::AddCustomContext("threads", std::to_string(threads));
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
}

// SPDX-License-Identifier: MIT
// Every material and transfer on a device, a million particles each: `benchmarks_cuda_materials [options of
// Google Benchmark]`.
#include "step_cuda.hpp"

int main(int argc, char** argv)
{
    using namespace firn;
    using S = Space<3, float>;
    bench::add_million<NeoHookean<S>>(); // what the others are compared with
    bench::add_million<FixedCorotated<S>>();
    bench::add_million<Hencky<S>>();
    bench::add_million<SplitNeoHookean<S>>();
    bench::add_million<Fluid<S>>();
    bench::add_plastic_materials();
    bench::add_transfers();
    return bench::run_steps(argc, argv);
}

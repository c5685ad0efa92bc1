// SPDX-License-Identifier: MIT
// Every material and transfer on a device, a million particles each: `benchmarks_cuda_materials [options of
// Google Benchmark]`.
#include "lists.hpp"
#include "step_cuda.hpp"

int main(int argc, char** argv)
{
    using namespace firn;
    using S = Space<3, float>;
    bench::for_each_type<ElasticModels<S>>([]<class Model>() { bench::add_million<Model>(); });
    bench::for_each_type<FluidModels<S>>([]<class Model>() { bench::add_million<Model>(); });
    bench::add_plastic_materials();
    bench::add_transfers();
    return bench::run_steps(argc, argv);
}

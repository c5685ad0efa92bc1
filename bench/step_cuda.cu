// SPDX-License-Identifier: MIT
// Whole substeps on a device: `benchmarks_cuda [options of Google Benchmark]`.
#include "step_cuda.hpp"

int main(int argc, char** argv)
{
    using namespace firn;
    using S = Space<3, float>;
    bench::add_layouts<NeoHookean<S>, QuadraticBSpline, Mls>();
    bench::add_layouts<FixedCorotated<S>, QuadraticBSpline, Mls>();
    bench::add_layouts<Snow<S>, QuadraticBSpline, Mls>();
    bench::add_cubic_and_double();
    bench::add_launches();
    return bench::run_steps(argc, argv);
}

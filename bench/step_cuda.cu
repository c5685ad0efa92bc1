// SPDX-License-Identifier: MIT
// Whole substeps on a device: `benchmarks_cuda [options of Google Benchmark]`.
#include "step_cuda.hpp"

namespace firn::bench
{
namespace
{

/// All layouts in some sizes, and for 1 million random particles also step/…/random/COURANT/PARTICLES: cells
/// per step.
template <class Model, class Kernel, class Transfer>
void add()
{
    for (Layout layout : {Layout::lattice, Layout::jittered, Layout::random, Layout::splash})
        for (int count : {10000, 125000, 1000000, 8000000, 64000000})
            if (layout != Layout::splash || count <= 1000000)
                add_step<Model, Kernel, Transfer>(layout_names[int(layout)], layout, count);
    for (int count : {10000, 125000, 1000000, 8000000}) // twice as long, so that as many leave their cells
        add_step<Model, Kernel, Transfer>("jittered/advance", Layout::jittered, count, courant / 2,
                                          Length::automatic);
    for (double number : {0.03, 0.29}) // 0.3 is where a step is beyond the stable one
        add_step<Model, Kernel, Transfer>("random/" + std::to_string(number).substr(0, 4), Layout::random,
                                          1000000, number);
}

} // namespace
} // namespace firn::bench

int main(int argc, char** argv)
{
    using namespace firn;
    using S = Space<3, float>;
    bench::add<NeoHookean<S>, QuadraticBSpline, Mls>();
    bench::add<FixedCorotated<S>, QuadraticBSpline, Mls>();
    bench::add<Snow<S>, QuadraticBSpline, Mls>();
    bench::add<Snow<S>, CubicBSpline, Mls>();
    bench::add<Snow<S>, CubicBSpline, Flip>();
    bench::add<NeoHookean<Space<3, double>>, QuadraticBSpline, Mls>();
    bench::add_launches();
    return bench::run_steps(argc, argv);
}

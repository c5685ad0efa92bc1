// SPDX-License-Identifier: MIT
#include "step_cuda.hpp"

void firn::bench::add_cubic_and_double()
{
    using S = Space<3, float>;
    add_layouts<Snow<S>, CubicBSpline, Mls>();
    add_layouts<Snow<S>, CubicBSpline, Flip>();
    add_layouts<NeoHookean<Space<3, double>>, QuadraticBSpline, Mls>();
}

// SPDX-License-Identifier: MIT
#include "step.hpp"

namespace firn::bench
{

void add_double_steps(int threads)
{
    using S = Space<3, double>;
    add_steps<NeoHookean<S>, QuadraticBSpline, Mls>(threads);
    add_steps<FixedCorotated<S>, QuadraticBSpline, Mls>(threads);
    add_steps<Snow<S>, QuadraticBSpline, Mls>(threads);
}

} // namespace firn::bench

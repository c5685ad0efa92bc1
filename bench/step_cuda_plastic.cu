// SPDX-License-Identifier: MIT
#include "step_cuda.hpp"

void firn::bench::add_plastic_materials()
{
    using S = Space<3, float>;
    add_million<Snow<S>>();
    add_million<VonMises<S>>();
    add_million<HardeningVonMises<S>>();
    add_million<Sand<S>>();
    add_million<CamClay<S>>();
    add_million<HerschelBulkley<S>>();
}

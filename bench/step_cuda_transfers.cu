// SPDX-License-Identifier: MIT
#include "step_cuda.hpp"

void firn::bench::add_transfers()
{
    using S = Space<3, float>;
    add_million<NeoHookean<S>, Pic>();
    add_million<NeoHookean<S>, Flip>();
    add_million<NeoHookean<S>, Apic>();
    add_million<NeoHookean<S>, Tpic>();
    add_million<NeoHookean<S>, Asflip>();
    add_million<NeoHookean<S>, Xpic>();
}

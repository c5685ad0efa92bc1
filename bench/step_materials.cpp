// SPDX-License-Identifier: MIT
#include "step.hpp"

namespace firn::bench
{

namespace
{

/// One size, in flight and splashed: in flight nothing yields.
template <class Model, class Transfer = Mls>
void add_one(int threads)
{
    add_steps<Model, QuadraticBSpline, Transfer>(threads, {Layout::random, Layout::splash}, {100000});
}

} // namespace

void add_material_steps(int threads)
{
    using S = Space<3, float>;
    add_one<Hencky<S>>(threads);
    add_one<SplitNeoHookean<S>>(threads);
    add_one<VonMises<S>>(threads);
    add_one<HardeningVonMises<S>>(threads);
    add_one<Sand<S>>(threads);
    add_one<CamClay<S>>(threads);
    add_one<HerschelBulkley<S>>(threads);
    add_one<Fluid<S>>(threads);
    add_one<NeoHookean<S>, Tpic>(threads);
    add_one<NeoHookean<S>, Asflip>(threads);
    add_one<NeoHookean<S>, Xpic>(threads);
}

} // namespace firn::bench

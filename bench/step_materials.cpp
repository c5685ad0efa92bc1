// SPDX-License-Identifier: MIT
#include "carried.hpp"
#include "lists.hpp"
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
    for_each_type<AllModels<S>>([=]<class Model>() {
        // benchmarks.cpp has these at all sizes
        if constexpr (!is_one_of<Model, NeoHookean<S>, FixedCorotated<S>, Snow<S>>) add_one<Model>(threads);
    });
    for_each_type<AllTransfers>([=]<class Transfer>() {
        if constexpr (!is_one_of<Transfer, Mls>) add_one<NeoHookean<S>, Transfer>(threads);
    });
    for_each_type<CarryingTransfers>([=]<class Transfer>() { add_one<NeoHookean<S>, Transfer>(threads); });
}

} // namespace firn::bench

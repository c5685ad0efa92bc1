// SPDX-License-Identifier: MIT
#include "carried.hpp"
#include "lists.hpp"
#include "step_cuda.hpp"

void firn::bench::add_transfers()
{
    for_each_type<AllTransfers>([]<class Transfer>() {
        if constexpr (!is_one_of<Transfer, Mls>) // which the materials are measured with
            add_million<NeoHookean<Space<3, float>>, Transfer>();
    });
    for_each_type<CarryingTransfers>(
        []<class Transfer>() { add_million<NeoHookean<Space<3, float>>, Transfer>(); });
}

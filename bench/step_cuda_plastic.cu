// SPDX-License-Identifier: MIT
#include "lists.hpp"
#include "step_cuda.hpp"

void firn::bench::add_plastic_materials()
{
    for_each_type<PlasticModels<Space<3, float>>>([]<class Model>() { add_million<Model>(); });
}

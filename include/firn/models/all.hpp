// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elasticity/fixed_corotated.hpp>
#include <firn/models/elasticity/hencky.hpp>
#include <firn/models/elasticity/mooney_rivlin.hpp>
#include <firn/models/elasticity/neo_hookean.hpp>
#include <firn/models/elasticity/split_neo_hookean.hpp>
#include <firn/models/fluids/fluid.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/models/plasticity/cam_clay.hpp>
#include <firn/models/plasticity/drucker_prager.hpp>
#include <firn/models/plasticity/herschel_bulkley.hpp>
#include <firn/models/plasticity/snow.hpp>
#include <firn/models/plasticity/von_mises.hpp>

#include <tuple>
#include <utility>

// The one list of constitutive models, for code that is to cover all of them.
namespace firn
{

/// Solids that do not yield.
template <class Space>
using ElasticModels = std::tuple<NeoHookean<Space>, FixedCorotated<Space>, Hencky<Space>,
                                 SplitNeoHookean<Space>, MooneyRivlin<Space>>;

/// Solids that yield.
template <class Space>
using PlasticModels = std::tuple<Snow<Space>, VonMises<Space>, HardeningVonMises<Space>, Sand<Space>,
                                 CamClay<Space>, HerschelBulkley<Space>>;

/// Fluids, which remember their volume alone. KeepsVolume<Fluid> is none of the list: it goes with obstacles
/// at their surface alone, and code that covers all models meets others, too.
template <class Space>
using FluidModels = std::tuple<Fluid<Space>>;

/// All of them.
template <class Space>
using AllModels =
    decltype(std::tuple_cat(std::declval<ElasticModels<Space>>(), std::declval<PlasticModels<Space>>(),
                            std::declval<FluidModels<Space>>()));

} // namespace firn

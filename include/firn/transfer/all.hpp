// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/apic.hpp>
#include <firn/transfer/asflip.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/conduction.hpp>
#include <firn/transfer/flip.hpp>
#include <firn/transfer/mls.hpp>
#include <firn/transfer/pic.hpp>
#include <firn/transfer/tpic.hpp>
#include <firn/transfer/with_fields.hpp>
#include <firn/transfer/xpic.hpp>

#include <tuple>

namespace firn
{

/// The one list of transfer schemes: what is to be done for each of them goes over it.
using AllTransfers = std::tuple<Pic, Flip, Apic, Mls, Tpic, Asflip, Xpic>;

} // namespace firn

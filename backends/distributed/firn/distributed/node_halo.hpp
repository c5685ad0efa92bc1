// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/node_halo.hpp>

namespace firn::distributed
{

/// Nodes of other ranks around those of this one, on a backend.
template <class Local, class Number, int d>
struct NodeHalo : firn::NodeHalo<Number, d>
{
    using firn::NodeHalo<Number, d>::NodeHalo;
};

} // namespace firn::distributed

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <cstdint>

namespace firn
{

/// Which obstacles touch lanes of nodes, noted when they are met first: where they meet again, the others
/// need not be looked for. A place with more than `most` is one where all are asked again.
struct TouchingObstacles
{
    static constexpr std::uint32_t most = 4;
    std::uint32_t count = 0;
    std::uint32_t number[most];

    FIRN_HOST_DEVICE void note(std::uint32_t i)
    {
        if (count < most) number[count] = i;
        ++count;
    }
    FIRN_HOST_DEVICE bool are_all() const { return count <= most; }
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

namespace firn::cuda::detail
{

/// Memory that a group of threads shares, as much as its loop was started with.
__device__ inline unsigned char* shared_memory()
{
    extern __shared__ __align__(16) unsigned char memory[];
    return memory;
}

} // namespace firn::cuda::detail

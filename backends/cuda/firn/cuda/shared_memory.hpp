// SPDX-License-Identifier: MIT
#pragma once

namespace firn::cuda::detail
{

/// The shared memory of a group of threads, as much as its loop was launched with.
__device__ inline unsigned char* shared_memory()
{
    extern __shared__ __align__(16) unsigned char memory[];
    return memory;
}

} // namespace firn::cuda::detail

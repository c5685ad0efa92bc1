// SPDX-License-Identifier: MIT
#pragma once

#include <cuda_runtime.h>

namespace firn::cuda::detail
{

/// In place of the backend's: `extern` memory of a group is nothing that a processor's compiler knows.
inline unsigned char* shared_memory() { return on_processor::Worker::one().shared(); }

} // namespace firn::cuda::detail

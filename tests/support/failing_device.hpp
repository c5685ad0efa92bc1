// SPDX-License-Identifier: MIT
#pragma once

// For tests on the processor that stands in for a device, whose memory ends when it is told to.
#include <cuda_runtime.h>

namespace
{
int& allowed = on_processor::Memory::one().allocations_left;
}

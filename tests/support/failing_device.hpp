// SPDX-License-Identifier: MIT
#pragma once

// For tests on the processor that stands in for a device: its memory ends when a test says so.
#include <cuda_runtime.h>

namespace
{
int& allowed = on_processor::Memory::one().allocations_left;
}

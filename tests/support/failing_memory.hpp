// SPDX-License-Identifier: MIT
#pragma once

// For a program of its own, in which memory ends when a test says so: the host's, or that of the processor
// that stands in for a device.
#if defined(__CUDACC__)
#include "support/failing_device.hpp"
#else
#include "support/failing_new.hpp"
#endif

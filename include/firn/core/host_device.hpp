// SPDX-License-Identifier: MIT
#pragma once

/// Marks what runs both on the host and on a device: the only macro of the library.
#if defined(__CUDACC__)
#define FIRN_HOST_DEVICE __host__ __device__
#else
#define FIRN_HOST_DEVICE
#endif

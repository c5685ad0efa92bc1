// SPDX-License-Identifier: MIT
#pragma once

// What `Distributed<Cuda, …>` needs beside firn/distributed.hpp: the CUDA backend on several ranks, each with
// a device, or several with one.
#include <firn/cuda.hpp>
#include <firn/distributed/grid_on_cuda.hpp>
#include <firn/distributed/halo_on_cuda.hpp>
#include <firn/distributed/order_on_cuda.hpp>

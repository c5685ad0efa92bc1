// SPDX-License-Identifier: MIT
#pragma once

#if !defined(__CUDACC__)
#error "firn/cuda.hpp is compiled by nvcc: give the file the ending .cu and link the target firn::cuda."
#endif

#include <firn/core/error.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cuda_runtime.h>
#include <string>

namespace firn::cuda
{

/// What the caller can do about an error that a CUDA call returned.
inline char const* remedy_for(cudaError_t status)
{
    switch (status) {
    case cudaErrorMemoryAllocation:
        return "Take a smaller scene or larger cells, or free memory.";
    case cudaErrorInvalidDevice:
    case cudaErrorInvalidValue:
    case cudaErrorInvalidResourceHandle:
        return "Pass a device that is there, and a stream of that device.";
    case cudaErrorNoKernelImageForDevice:
    case cudaErrorInvalidDeviceFunction:
        return "Compile for this device: with CMAKE_CUDA_ARCHITECTURES=native, for example.";
    case cudaErrorUnsupportedPtxVersion:
    case cudaErrorInsufficientDriver:
    case cudaErrorSystemDriverMismatch:
    case cudaErrorCompatNotSupportedOnDevice:
    case cudaErrorCallRequiresNewerDriver:
    case cudaErrorStubLibrary:
        return "Install a driver, or a newer one.";
    case cudaErrorDevicesUnavailable:
        return "Wait for the process that has the device to itself, or change the device's compute mode.";
    case cudaErrorInitializationError:
    case cudaErrorSystemNotReady:
        return "Look whether the driver runs: nvidia-smi lists its devices. (A process that was forked from "
               "one that used them cannot.)";
    case cudaErrorIllegalAddress:
    case cudaErrorMisalignedAddress:
    case cudaErrorInvalidAddressSpace:
    case cudaErrorInvalidPc:
    case cudaErrorIllegalInstruction:
    case cudaErrorHardwareStackError:
    case cudaErrorAssert:
    case cudaErrorLaunchTimeout:
    case cudaErrorLaunchFailure:
    case cudaErrorECCUncorrectable:
        return "After a fault in a kernel the device serves this process no more: what was computed is lost, "
               "and only a new process can use it.";
    default:
        return "Look the error up among those of the CUDA runtime; the scene may be lost.";
    }
}

/// Throws an Error that names the call if it failed.
inline void check(cudaError_t status, char const* call)
{
    if (status == cudaSuccess) return;
    static_cast<void>(cudaGetLastError()); // or the next call would report it again
    throw Error{std::string(call) + " failed: " + cudaGetErrorString(status), "CUDA", remedy_for(status)};
}

/// Where work is queued: a stream of a device.
struct Queue
{
    int device = 0;
    cudaStream_t stream = nullptr;

    Queue const& queue() const { return *this; }
    void wait() const;
};

/// Loops of at most this many groups of threads may launch while the one before still runs. In larger ones,
/// waiting groups would take the place of working ones.
inline constexpr unsigned few_groups = 128;

/// How many groups of threads a loop has.
struct Groups
{
    unsigned count;
    bool early; ///< the loop may launch while the one before still runs

    Groups(unsigned all) : Groups(all, all <= few_groups) {}
    Groups(unsigned all, bool are_early) : count(all), early(are_early) {}
};

static __global__ void any_loop() {} ///< to ask which code of this program a device was given

/// Whether this device runs code in which loops wait for the one before (compute capability 9.0). A device
/// given PTX of an older architecture translates that, and its loops do not wait. All loops are compiled
/// alike.
inline bool loops_wait_by_themselves(int device)
{
    static std::array<std::atomic<signed char>, 64> known{}; // 0: not known yet
    bool const is_kept = device >= 0 && static_cast<std::size_t>(device) < known.size();
    if (is_kept && known[device] != 0) return known[device] > 0;
    cudaFuncAttributes loop{};
    check(cudaFuncGetAttributes(&loop, any_loop), "cudaFuncGetAttributes");
    bool const waits = loop.ptxVersion >= 90;
    if (is_kept) known[device] = waits ? 1 : -1;
    return waits;
}

/// Launches a loop that starts when those before have finished; an Error names it. After <<<>>> one would
/// have to ask for the last error, which may stem from an earlier call of another library.
template <class... Parameters, class... Arguments>
void launch_after(char const* name, Queue const& queue, void (*loop)(Parameters...), unsigned groups,
                  unsigned threads, Arguments const&... arguments)
{
    cudaLaunchConfig_t how{};
    how.gridDim = groups;
    how.blockDim = threads;
    how.stream = queue.stream;
    check(cudaLaunchKernelEx(&how, loop, static_cast<Parameters>(arguments)...), name);
}

/// Launches a loop. Where the device can, a loop that launches early waits for the one before by itself (see
/// Signal).
template <class... Parameters, class... Arguments>
void launch_behind(char const* name, Queue const& queue, void (*loop)(Parameters...), Groups groups,
                   unsigned threads, std::size_t shared, Arguments const&... arguments)
{
    cudaLaunchAttribute attribute{};
    attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
    attribute.val.programmaticStreamSerializationAllowed =
        groups.early && loops_wait_by_themselves(queue.device);
    cudaLaunchConfig_t how{};
    how.gridDim = groups.count;
    how.blockDim = threads;
    how.dynamicSmemBytes = shared;
    how.stream = queue.stream;
    how.attrs = &attribute;
    how.numAttrs = 1;
    check(cudaLaunchKernelEx(&how, loop, static_cast<Parameters>(arguments)...), name);
}

/// Makes a device current until the end of the scope, then the previous one.
class OnDevice
{
public:
    explicit OnDevice(int device)
    {
        check(cudaGetDevice(&before_), "cudaGetDevice");
        changed_ = before_ != device;
        if (changed_) check(cudaSetDevice(device), "cudaSetDevice");
    }
    explicit OnDevice(Queue const& queue) : OnDevice(queue.device) {}
    ~OnDevice()
    {
        if (changed_) static_cast<void>(cudaSetDevice(before_));
    }
    OnDevice(OnDevice const&) = delete;
    OnDevice& operator=(OnDevice const&) = delete;

private:
    int before_ = 0;
    bool changed_ = false;
};

inline void Queue::wait() const
{
    OnDevice const here(*this); // otherwise the default stream would be that of another device
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
}

/// Bytes of a device's memory that this program's arrays hold.
inline std::atomic<std::size_t>& held_on(int device)
{
    static std::array<std::atomic<std::size_t>, 64> held{}; // the last entry counts all further devices
    return held[std::min(static_cast<std::size_t>(device), held.size() - 1)];
}

/// Memory of the current device; an Error says how much was needed and how much is available.
inline void* allocate(int device, std::size_t bytes)
{
    void* memory = nullptr;
    cudaError_t const status = cudaMalloc(&memory, bytes);
    if (status == cudaErrorMemoryAllocation) {
        static_cast<void>(cudaGetLastError());
        std::size_t available = 0, total = 0;
        check(cudaMemGetInfo(&available, &total), "cudaMemGetInfo");
        throw Error{"the device's memory is short: " + std::to_string(bytes) +
                        " bytes more were needed, and " + std::to_string(available) + " of " +
                        std::to_string(total) + " are available, beside the " +
                        std::to_string(held_on(device)) + " that this program's scenes hold",
                    "CUDA", "Take a smaller scene or larger cells, or a device with more memory."};
    }
    check(status, "cudaMalloc");
    held_on(device) += bytes;
    return memory;
}

/// Returns memory of a device, and counts it as free.
inline void free_memory(int device, void* memory, std::size_t bytes) noexcept
{
    static_cast<void>(cudaFree(memory));
    held_on(device) -= bytes;
}

/// How many groups of threads cover this many items.
constexpr unsigned groups_of(std::size_t items, unsigned threads)
{
    return static_cast<unsigned>((items + threads - 1) / threads);
}

} // namespace firn::cuda

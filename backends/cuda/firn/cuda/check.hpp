// SPDX-License-Identifier: MIT
#pragma once

#if !defined(__CUDACC__)
#error "firn/cuda.hpp is compiled by nvcc: give the file the ending .cu and link the target firn::cuda."
#endif

#include <firn/core/error.hpp>

#include <cstddef>
#include <cuda_runtime.h>
#include <string>

namespace firn::cuda
{

/// Throws an Error that names the call unless it went well.
inline void check(cudaError_t status, char const* call)
{
    if (status == cudaSuccess) return;
    static_cast<void>(cudaGetLastError()); // or the next call would report it again
    throw Error{
        std::string(call) + " failed: " + cudaGetErrorString(status), "CUDA",
        "After a fault in a kernel the device serves this process no more: what was computed is lost, and "
        "only a new process can use it."};
}

/// Throws an Error that names the loop unless it could be started.
inline void check_launch(char const* loop) { check(cudaGetLastError(), loop); }

/// Where work is queued: a stream of a device.
struct Queue
{
    int device = 0;
    cudaStream_t stream = nullptr;

    Queue const& queue() const { return *this; }
    void wait() const { check(cudaStreamSynchronize(stream), "cudaStreamSynchronize"); }
};

/// Loops of so few groups of threads may be made ready while the ones before are still at work. In larger
/// ones those that wait would take the place of those that work.
inline constexpr unsigned few_groups = 128;

/// Whether every device that lets loops be made ready early (compute capability 9.0) is given code that waits
/// by itself: not the code of an older kind, which it would translate.
inline constexpr bool loops_wait_by_themselves = [] {
    bool for_the_first = false, for_no_older = true;
    for (int const architecture : {__CUDA_ARCH_LIST__}) {
        for_the_first = for_the_first || architecture == 900;
        for_no_older = for_no_older && architecture >= 900;
    }
    return for_the_first || for_no_older;
}();

/// Starts a loop; a small one may be made ready while the one before is still at work, and waits for that
/// itself (see Signal), where the device can do so.
template <class... Parameters, class... Arguments>
void launch_behind(char const* name, Queue const& queue, void (*loop)(Parameters...), unsigned groups,
                   unsigned threads, std::size_t shared, Arguments const&... arguments)
{
    cudaLaunchAttribute attribute{};
    attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
    attribute.val.programmaticStreamSerializationAllowed = loops_wait_by_themselves && groups <= few_groups;
    cudaLaunchConfig_t how{};
    how.gridDim = groups;
    how.blockDim = threads;
    how.dynamicSmemBytes = shared;
    how.stream = queue.stream;
    how.attrs = &attribute;
    how.numAttrs = 1;
    check(cudaLaunchKernelEx(&how, loop, static_cast<Parameters>(arguments)...), name);
}

/// Makes a device the current one, and the one before current again at the end of the scope.
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

/// Memory of the current device; an Error says how much was needed and how much there was.
inline void* allocate(std::size_t bytes)
{
    void* memory = nullptr;
    cudaError_t const status = cudaMalloc(&memory, bytes);
    if (status == cudaErrorMemoryAllocation) {
        static_cast<void>(cudaGetLastError());
        std::size_t available = 0, total = 0;
        check(cudaMemGetInfo(&available, &total), "cudaMemGetInfo");
        throw Error{"the device's memory is short: " + std::to_string(bytes) +
                        " bytes more were needed, and " + std::to_string(available) + " of " +
                        std::to_string(total) + " are available",
                    "CUDA", "Take a smaller scene or larger cells, or a device with more memory."};
    }
    check(status, "cudaMalloc");
    return memory;
}

/// As many groups of threads as cover a number of items.
constexpr unsigned groups_of(std::size_t items, unsigned threads)
{
    return static_cast<unsigned>((items + threads - 1) / threads);
}

} // namespace firn::cuda

// SPDX-License-Identifier: MIT
#pragma once

#include <boost/context/fiber.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <queue>
#include <random>
#include <sanitizer/asan_interface.h>
#include <thread>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// The part of the CUDA runtime that Firn calls, and of CUDA's C++ in which its loops are written, on a
// processor: it tests what they compute where there is no device, under the compiler's sanitizers.
//
// The threads of a group are fibers, which one thread of the processor runs from one barrier to the next
// (__syncthreads, a vote, a shuffle), in random order. This exposes reads of values that other threads have
// yet to write. Reads of memory that was never written show up too, since memory is filled with ones. Groups
// run one after the other, also in random order. Loops are queued, and a thread of their own runs them while
// the host goes on, those of several streams in random order, too, unless one waits for an event of another.
// What this cannot show: groups that run concurrently, how memory is ordered between them, registers, time.
//
// ON_PROCESSOR_SEED=number selects another order.

#define __host__
#define __device__
#define __global__
#define __shared__ static
#define __forceinline__ inline
#define __noinline__ // GNU's library has __attribute__((__noinline__))
#define __launch_bounds__(...)
#define __align__(bytes) __attribute__((aligned(bytes)))

struct dim3
{
    unsigned x = 1, y = 1, z = 1;
    dim3(unsigned along = 1) : x(along) {}
};
inline dim3 threadIdx, blockIdx, blockDim, gridDim; ///< of the thread at work

enum cudaError_t
{
    cudaSuccess = 0,
    cudaErrorInvalidValue = 1,
    cudaErrorMemoryAllocation = 2,
    cudaErrorInitializationError = 3,
    cudaErrorInsufficientDriver = 35,
    cudaErrorStubLibrary = 34,
    cudaErrorCallRequiresNewerDriver = 36,
    cudaErrorDevicesUnavailable = 46,
    cudaErrorInvalidDeviceFunction = 98,
    cudaErrorNoDevice = 100,
    cudaErrorInvalidDevice = 101,
    cudaErrorNoKernelImageForDevice = 209,
    cudaErrorECCUncorrectable = 214,
    cudaErrorUnsupportedPtxVersion = 222,
    cudaErrorInvalidResourceHandle = 400,
    cudaErrorIllegalAddress = 700,
    cudaErrorLaunchTimeout = 702,
    cudaErrorAssert = 710,
    cudaErrorHardwareStackError = 714,
    cudaErrorIllegalInstruction = 715,
    cudaErrorMisalignedAddress = 716,
    cudaErrorInvalidAddressSpace = 717,
    cudaErrorInvalidPc = 718,
    cudaErrorLaunchFailure = 719,
    cudaErrorPeerAccessAlreadyEnabled = 704,
    cudaErrorTooManyPeers = 711,
    cudaErrorSystemNotReady = 802,
    cudaErrorSystemDriverMismatch = 803,
    cudaErrorCompatNotSupportedOnDevice = 804
};
enum cudaMemcpyKind
{
    cudaMemcpyHostToDevice = 1,
    cudaMemcpyDeviceToHost,
    cudaMemcpyDeviceToDevice,
    cudaMemcpyDefault
};

#define CUDART_VERSION 13000

namespace on_processor
{

[[noreturn]] inline void stop(char const* what)
{
    std::fprintf(stderr, "on_processor: %s\n", what);
    std::abort();
}

/// What lanes of a warp wait for each other in.
enum class Call
{
    vote,
    match,
    shuffle
};

/// 32 threads, and what they tell each other.
struct Warp
{
    std::uint32_t alive = 0, arrived = 0;
    Call call{}; ///< the call of the threads that have arrived at the barrier
    std::uint64_t brought[32], seen[32];
    std::uint32_t seen_from = 0;
};

/// Where chance begins.
inline std::uint32_t seed()
{
    char const* const given = std::getenv("ON_PROCESSOR_SEED");
    return given ? static_cast<std::uint32_t>(std::atoi(given)) : 1u;
}

struct Thread
{
    boost::context::fiber fiber; ///< to go on from where it left off
    dim3 index;
    Warp* warp = nullptr;
    std::uint32_t lane = 0;
};

/// Room for the stacks of fibers, used again and again.
class Stacks
{
public:
    boost::context::stack_context allocate()
    {
        static constexpr std::size_t size = 256 * 1024;
        void* memory = nullptr;
        if (free_.empty())
            memory = std::aligned_alloc(4096, size);
        else {
            memory = free_.back();
            free_.pop_back();
        }
        ASAN_UNPOISON_MEMORY_REGION(memory, size); // what those before have left there
        boost::context::stack_context stack;
        stack.size = size;
        stack.sp = static_cast<char*>(memory) + size;
        return stack;
    }
    void deallocate(boost::context::stack_context& stack)
    {
        free_.push_back(static_cast<char*>(stack.sp) - stack.size);
    }
    ~Stacks()
    {
        for (void* memory : free_) std::free(memory);
    }

private:
    std::vector<void*> free_;
};
struct StacksOf // boost copies what it allocates with
{
    Stacks* stacks;
    boost::context::stack_context allocate() { return stacks->allocate(); }
    void deallocate(boost::context::stack_context& stack) { stacks->deallocate(stack); }
};

/// A group of threads at work; there is one at a time.
class Group
{
public:
    /// Runs `work` in each of its threads.
    template <class Work>
    void run(unsigned threads, Work const& work)
    {
        threads_ = std::vector<Thread>(threads);
        warps_ = std::vector<Warp>((threads + 31) / 32);
        alive_ = threads;
        arrived_ = 0;
        any_ = false;
        for (unsigned i = 0; i < threads; ++i) {
            Thread& thread = threads_[i];
            thread.index = dim3(i);
            thread.index.y = thread.index.z = 0;
            thread.warp = &warps_[i / 32];
            thread.lane = i % 32;
            thread.warp->alive |= 1u << thread.lane;
            thread.fiber = boost::context::fiber(std::allocator_arg, StacksOf{&stacks_},
                                                 [&](boost::context::fiber&& before) {
                                                     came_from_->fiber = std::move(before);
                                                     work();
                                                     leave(thread);
                                                     return std::move(next().fiber);
                                                 });
            ready_.push_back(&thread);
        }
        now_ = &caller_;
        go_on();
        if (alive_ > 0) stop("threads of a group wait for others that never come");
    }

    /// All threads that are still there come together; whether one brought true.
    bool meet_all(bool value)
    {
        any_ = any_ || value;
        if (++arrived_ == alive_)
            release();
        else {
            waiting_.push_back(now_);
            go_on();
        }
        return result_;
    }

    /// The lanes that still run bring a value each; it calls `use(lane, mask of the lanes with values,
    /// values)`.
    template <class Use>
    auto meet(Call call, std::uint32_t mask, std::uint64_t value, Use const& use)
    {
        Warp& warp = *now_->warp;
        std::uint32_t const lane = now_->lane, me = 1u << lane;
        if (mask == me) {
            std::uint64_t alone[32]{};
            alone[lane] = value;
            return use(lane, me, alone);
        }
        if (mask != ~0u) stop("a warp's call with a part of its lanes");
        if (warp.arrived != 0 && warp.call != call)
            stop("lanes of a warp wait for each other in different calls");
        warp.call = call;
        warp.brought[lane] = value;
        warp.arrived |= me;
        if (warp.arrived == warp.alive)
            release(warp);
        else
            go_on();
        return use(lane, warp.seen_from, warp.seen);
    }

private:
    /// The thread to run next: a random one of those that need not wait; if there are none, the caller's.
    Thread& next()
    {
        came_from_ = now_;
        if (ready_.empty())
            now_ = &caller_;
        else {
            chance_ = chance_ * 1664525u + 1013904223u;
            std::swap(ready_[(std::uint64_t(chance_) * ready_.size()) >> 32], ready_.back());
            now_ = ready_.back();
            ready_.pop_back();
            threadIdx = now_->index;
        }
        return *now_;
    }
    /// Lets others work until it is this thread's turn again.
    void go_on()
    {
        Thread* const me = now_;
        Thread& other = next();
        if (&other == me) return;
        boost::context::fiber before = std::move(other.fiber).resume();
        if (before) came_from_->fiber = std::move(before); // else its work is done
    }
    void release()
    {
        ready_.insert(ready_.end(), waiting_.begin(), waiting_.end());
        waiting_.clear();
        arrived_ = 0;
        result_ = any_;
        any_ = false;
    }
    void release(Warp& warp)
    {
        std::memcpy(warp.seen, warp.brought, sizeof warp.seen);
        warp.seen_from = warp.arrived;
        Thread* const first = &threads_[static_cast<std::size_t>(&warp - warps_.data()) * 32];
        for (std::uint32_t lane = 0; lane < 32; ++lane)
            if (((warp.arrived >> lane) & 1) != 0 && first + lane != now_) ready_.push_back(first + lane);
        warp.arrived = 0;
    }
    void leave(Thread& thread)
    {
        Warp& warp = *thread.warp;
        warp.alive &= ~(1u << thread.lane);
        if (warp.arrived != 0 && warp.arrived == warp.alive) release(warp);
        --alive_;
        if (arrived_ > 0 && arrived_ == alive_) release();
    }

    Stacks stacks_;
    std::vector<Thread> threads_;
    std::vector<Warp> warps_;
    std::vector<Thread*> ready_, waiting_;
    Thread caller_;
    Thread *now_ = nullptr, *came_from_ = nullptr;
    unsigned alive_ = 0, arrived_ = 0;
    bool any_ = false, result_ = false;
    std::uint32_t chance_ = seed();
};

/// Where in a stream something has been queued.
struct Place
{
    std::size_t stream = 0, count = 0; ///< count: of all that has been queued there by then
};

/// Runs what is queued, behind the host: one thing after the other, of streams in random order.
class Worker
{
public:
    static Worker& one()
    {
        static Worker worker;
        return worker;
    }
    /// Queues work in a stream, to run when what is at another place has been done.
    void queue(std::size_t stream, std::function<void()> work, Place const& after = {})
    {
        {
            std::lock_guard const lock(mutex_);
            auto& to = streams_[stream];
            to.queue.push({std::move(work), after});
            ++to.queued;
        }
        changed_.notify_all();
    }
    /// Waits for what has been queued in all streams until now; other threads of the host may queue more.
    void wait()
    {
        std::unique_lock lock(mutex_);
        std::vector<Place> all;
        for (auto const& [stream, of] : streams_) all.push_back({stream, of.queued});
        changed_.wait(lock, [&] {
            return std::all_of(all.begin(), all.end(), [&](Place const& place) { return is_done(place); });
        });
    }
    void wait(Place const& place)
    {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return is_done(place); });
    }
    /// What has been queued in a stream until now.
    Place queued(std::size_t stream)
    {
        std::lock_guard const lock(mutex_);
        return {stream, streams_[stream].queued};
    }

    template <class Work>
    void run_groups(dim3 groups, dim3 threads, std::size_t shared, Work const& work)
    {
        std::vector<unsigned> order(groups.x);
        for (unsigned i = 0; i < groups.x; ++i) order[i] = i;
        std::shuffle(order.begin(), order.end(), chance_);
        gridDim = groups;
        blockDim = threads;
        shared_.resize(shared + 16);
        for (unsigned i : order) {
            blockIdx = dim3(i);
            blockIdx.y = blockIdx.z = 0;
            std::memset(shared_.data(), 0xff, shared_.size());
            group_.run(threads.x, work);
        }
    }
    unsigned char* shared()
    {
        return reinterpret_cast<unsigned char*>((reinterpret_cast<std::uintptr_t>(shared_.data()) + 15) / 16 *
                                                16);
    }
    Group& group() { return group_; }

private:
    Worker() : thread_([this] { work(); }) {}
    ~Worker()
    {
        {
            std::lock_guard const lock(mutex_);
            ends_ = true;
        }
        changed_.notify_all();
        thread_.join();
    }
    struct Work
    {
        std::function<void()> run;
        Place after;
    };
    struct Stream
    {
        std::queue<Work> queue;           ///< the first may be at work
        std::size_t queued = 0, done = 0; ///< how much was queued until now, and how much of it is done
    };
    bool is_done(Place const& place) { return streams_[place.stream].done >= place.count; }
    /// A random one of the streams whose first work need not wait; if there are none, nothing.
    Stream* next()
    {
        Stream* found = nullptr;
        std::size_t ready = 0;
        for (auto& [stream, of] : streams_)
            if (!of.queue.empty() && is_done(of.queue.front().after) && chance_() % ++ready == 0) found = &of;
        return found;
    }
    void work()
    {
        std::unique_lock lock(mutex_);
        for (;;) {
            Stream* stream = nullptr;
            changed_.wait(lock, [&] { return (stream = next()) != nullptr || ends_; });
            if (stream == nullptr) return;
            auto const& run = stream->queue.front().run;
            lock.unlock();
            run();
            lock.lock();
            stream->queue.pop();
            ++stream->done;
            changed_.notify_all();
        }
    }

    std::mutex mutex_;
    std::condition_variable changed_;
    std::map<std::size_t, Stream> streams_;
    bool ends_ = false;
    Group group_;
    std::vector<unsigned char> shared_;
    std::minstd_rand chance_{seed()};
    std::thread thread_;
};

/// What devices hold.
struct Memory
{
    static constexpr int devices = 2;
    static inline cudaError_t driver = cudaSuccess; ///< what it says when it is asked for devices
    static inline bool are_peers = true;            ///< whether devices can reach each other's memory
    static constexpr std::size_t total = std::size_t(4) << 30;

    std::mutex mutex;
    std::map<void*, std::pair<int, std::size_t>> held;
    std::map<void*, std::size_t> mapped; ///< of the host, for devices to reach
    std::size_t used[devices]{}, peak[devices]{};
    bool reached[devices][devices]{}; ///< whether a device reaches the memory of another one
    int allocations_left = -1;        ///< so many more may succeed, on devices and of the host; below 0: all
    std::map<void const*, std::size_t> allowed; ///< shared memory of loops

    static Memory& one()
    {
        static Memory memory;
        return memory;
    }

    bool may_allocate() { return allocations_left != 0 && (allocations_left < 0 || allocations_left-- > 0); }
};

inline thread_local int current_device = 0;
inline thread_local cudaError_t last_error = cudaSuccess;
inline cudaError_t tell(cudaError_t status)
{
    if (status != cudaSuccess) last_error = status;
    return status;
}

template <class T>
T lane_value(std::uint64_t const& bits)
{
    T value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
}
template <class T>
std::uint64_t bits_of(T const& value)
{
    static_assert(sizeof value <= 8);
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof value);
    return bits;
}
/// What another lane brought; where there is none, one's own.
template <class T, class From>
T shuffle(std::uint32_t mask, T value, From const& from)
{
    return Worker::one().group().meet(
        Call::shuffle, mask, bits_of(value),
        [&](std::uint32_t lane, std::uint32_t whose, std::uint64_t const* values) {
            int const other = from(static_cast<int>(lane));
            bool const is_there = other >= 0 && other < 32 && ((whose >> other) & 1) != 0;
            return lane_value<T>(values[is_there ? other : static_cast<int>(lane)]);
        });
}

} // namespace on_processor

// CUDA's C++

inline void __syncthreads() { on_processor::Worker::one().group().meet_all(false); }
inline int __syncthreads_or(int value) { return on_processor::Worker::one().group().meet_all(value != 0); }
inline std::uint32_t __ballot_sync(std::uint32_t mask, int value)
{
    return on_processor::Worker::one().group().meet(
        on_processor::Call::vote, mask, value != 0,
        [](std::uint32_t, std::uint32_t whose, std::uint64_t const* values) {
            std::uint32_t found = 0;
            for (std::uint32_t i = 0; i < 32; ++i)
                if (((whose >> i) & 1) != 0 && values[i] != 0) found |= 1u << i;
            return found;
        });
}
inline int __any_sync(std::uint32_t mask, int value) { return __ballot_sync(mask, value) != 0; }
inline void __syncwarp(std::uint32_t mask = ~0u) { static_cast<void>(__ballot_sync(mask, 0)); }
/// Those that are at one with this thread: fibers never are.
inline std::uint32_t __activemask() { return 1u << threadIdx.x % 32; }
template <class T>
std::uint32_t __match_any_sync(std::uint32_t mask, T value)
{
    return on_processor::Worker::one().group().meet(
        on_processor::Call::match, mask, on_processor::bits_of(value),
        [](std::uint32_t lane, std::uint32_t whose, std::uint64_t const* values) {
            std::uint32_t same = 0;
            for (std::uint32_t i = 0; i < 32; ++i)
                if (((whose >> i) & 1) != 0 && values[i] == values[lane]) same |= 1u << i;
            return same;
        });
}
template <class T>
T __shfl_sync(std::uint32_t mask, T value, int from)
{
    return on_processor::shuffle(mask, value, [&](int) { return from & 31; });
}
template <class T>
T __shfl_up_sync(std::uint32_t mask, T value, unsigned by)
{
    return on_processor::shuffle(mask, value, [&](int lane) { return lane - static_cast<int>(by); });
}
template <class T>
T __shfl_down_sync(std::uint32_t mask, T value, unsigned by)
{
    return on_processor::shuffle(mask, value, [&](int lane) { return lane + static_cast<int>(by); });
}

inline int __popc(std::uint32_t value) { return __builtin_popcount(value); }
inline int __ffs(int value) { return __builtin_ffs(value); }
/// The 32 bits from a place in two words on.
inline unsigned __funnelshift_r(unsigned low, unsigned high, unsigned place)
{
    return static_cast<unsigned>((std::uint64_t(high) << 32 | low) >> (place % 32));
}
template <class T>
T __ldcg(T const* from)
{
    return *from;
}
template <class T>
T __ldg(T const* from)
{
    return *from;
}
inline void __threadfence() {}

// Fibers yield at a barrier only.
template <class T>
T atomicOr(T* to, std::type_identity_t<T> value)
{
    T const before = *to;
    *to = before | value;
    return before;
}
template <class T>
T atomicAdd(T* to, std::type_identity_t<T> value)
{
    T const before = *to;
    *to = before + value;
    return before;
}
template <class T>
T atomicMax(T* to, std::type_identity_t<T> value)
{
    T const before = *to;
    if (before < value) *to = value;
    return before;
}
template <class T>
T atomicExch(T* to, std::type_identity_t<T> value)
{
    T const before = *to;
    *to = value;
    return before;
}
template <class T>
T atomicCAS(T* to, std::type_identity_t<T> expected, std::type_identity_t<T> value)
{
    T const before = *to;
    if (before == expected) *to = value;
    return before;
}

// The runtime

struct CUstream_st
{
    int device;
    std::size_t number; ///< of all streams that there have been, behind the devices' own
};
using cudaStream_t = CUstream_st*;
constexpr unsigned cudaStreamNonBlocking = 1;

struct cudaDeviceProp
{
    char name[256];
    std::size_t totalGlobalMem;
    int major, minor;
};
struct cudaFuncAttributes
{
    int ptxVersion;
};
enum cudaFuncAttribute
{
    cudaFuncAttributeMaxDynamicSharedMemorySize
};
enum cudaLaunchAttributeID
{
    cudaLaunchAttributeProgrammaticStreamSerialization
};
struct cudaLaunchAttribute
{
    cudaLaunchAttributeID id;
    struct
    {
        int programmaticStreamSerializationAllowed;
    } val;
};
struct cudaLaunchConfig_t
{
    dim3 gridDim, blockDim;
    std::size_t dynamicSmemBytes;
    cudaStream_t stream;
    cudaLaunchAttribute* attrs;
    unsigned numAttrs;
};

inline char const* cudaGetErrorString(cudaError_t status)
{
    switch (status) {
    case cudaSuccess:
        return "no error";
    case cudaErrorMemoryAllocation:
        return "out of memory";
    case cudaErrorInvalidDevice:
        return "invalid device ordinal";
    case cudaErrorInvalidResourceHandle:
        return "invalid resource handle";
    default:
        return "invalid argument";
    }
}
inline cudaError_t cudaGetLastError() { return std::exchange(on_processor::last_error, cudaSuccess); }
inline cudaError_t cudaPeekAtLastError() { return on_processor::last_error; }

inline cudaError_t cudaGetDeviceCount(int* count)
{
    *count = on_processor::Memory::driver == cudaSuccess ? on_processor::Memory::devices : 0;
    return on_processor::tell(on_processor::Memory::driver);
}
inline cudaError_t cudaGetDevice(int* device)
{
    *device = on_processor::current_device;
    return cudaSuccess;
}
inline cudaError_t cudaSetDevice(int device)
{
    if (device < 0 || device >= on_processor::Memory::devices)
        return on_processor::tell(cudaErrorInvalidDevice);
    on_processor::current_device = device;
    return cudaSuccess;
}
inline cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int device)
{
    if (device < 0 || device >= on_processor::Memory::devices)
        return on_processor::tell(cudaErrorInvalidDevice);
    *properties = {"a processor", on_processor::Memory::total, 9, 0};
    return cudaSuccess;
}

inline cudaError_t cudaDeviceCanAccessPeer(int* can, int device, int other)
{
    if (device < 0 || device >= on_processor::Memory::devices || other < 0 ||
        other >= on_processor::Memory::devices)
        return on_processor::tell(cudaErrorInvalidDevice);
    *can = device != other && on_processor::Memory::are_peers;
    return cudaSuccess;
}
inline cudaError_t cudaDeviceEnablePeerAccess(int other, unsigned)
{
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    if (other == on_processor::current_device) return on_processor::tell(cudaErrorInvalidDevice);
    bool& reached = memory.reached[on_processor::current_device][other];
    if (std::exchange(reached, true)) return on_processor::tell(cudaErrorPeerAccessAlreadyEnabled);
    return cudaSuccess;
}

inline cudaError_t cudaMemGetInfo(std::size_t* available, std::size_t* total)
{
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    *total = on_processor::Memory::total;
    *available = *total - memory.used[on_processor::current_device];
    return cudaSuccess;
}
template <class T>
cudaError_t cudaMalloc(T** to, std::size_t bytes)
{
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    int const device = on_processor::current_device;
    *to = nullptr;
    if (bytes == 0) return cudaSuccess;
    if (bytes > on_processor::Memory::total - memory.used[device] || !memory.may_allocate())
        return on_processor::tell(cudaErrorMemoryAllocation);
    void* const there = std::aligned_alloc(256, (bytes + 255) / 256 * 256);
    if (there == nullptr) return on_processor::tell(cudaErrorMemoryAllocation);
    if (bytes <= std::size_t(64) << 20) std::memset(there, 0xff, bytes); // no test reads more
    memory.held[there] = {device, bytes};
    memory.used[device] += bytes;
    memory.peak[device] = std::max(memory.peak[device], memory.used[device]);
    *to = static_cast<T*>(there);
    return cudaSuccess;
}
inline cudaError_t cudaFree(void* there)
{
    if (there == nullptr) return cudaSuccess;
    on_processor::Worker::one().wait();
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    auto const held = memory.held.find(there);
    if (held == memory.held.end()) return on_processor::tell(cudaErrorInvalidValue);
    memory.used[held->second.first] -= held->second.second;
    memory.held.erase(held);
    std::free(there);
    return cudaSuccess;
}
enum cudaMemoryType
{
    cudaMemoryTypeUnregistered = 0,
    cudaMemoryTypeHost = 1,
    cudaMemoryTypeDevice = 2
};
struct cudaPointerAttributes
{
    cudaMemoryType type;
    int device;
    void* devicePointer;
};
inline cudaError_t cudaPointerGetAttributes(cudaPointerAttributes* about, void const* there)
{
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    *about = {cudaMemoryTypeUnregistered, 0, nullptr};
    for (auto const& [begin, held] : memory.held) {
        auto* const first = static_cast<char const*>(begin);
        if (there >= first && there < first + held.second)
            *about = {cudaMemoryTypeDevice, held.first, const_cast<void*>(there)};
    }
    for (auto const& [begin, bytes] : memory.mapped) {
        auto* const first = static_cast<char const*>(begin);
        if (there >= first && there < first + bytes)
            *about = {cudaMemoryTypeHost, on_processor::current_device, const_cast<void*>(there)};
    }
    return cudaSuccess;
}
enum cudaDeviceAttr
{
    cudaDevAttrPageableMemoryAccess = 88
};
inline cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr, int)
{
    *value = 0;
    return cudaSuccess;
}
inline cudaError_t cudaMallocHost(void** to, std::size_t bytes)
{
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    *to = memory.may_allocate() ? std::malloc(bytes) : nullptr;
    if (*to != nullptr) memory.mapped[*to] = bytes;
    return on_processor::tell(*to == nullptr ? cudaErrorMemoryAllocation : cudaSuccess);
}
inline cudaError_t cudaFreeHost(void* there)
{
    on_processor::Worker::one().wait();
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    memory.mapped.erase(there);
    std::free(there);
    return cudaSuccess;
}

inline cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned)
{
    static std::atomic<std::size_t> streams = on_processor::Memory::devices;
    *stream = new CUstream_st{on_processor::current_device, streams++};
    return cudaSuccess;
}
inline cudaError_t cudaStreamDestroy(cudaStream_t stream)
{
    on_processor::Worker::one().wait();
    delete stream;
    return cudaSuccess;
}
inline cudaError_t cudaDeviceGetStreamPriorityRange(int* least, int* greatest)
{
    *least = *greatest = 0;
    return cudaSuccess;
}
inline cudaError_t cudaStreamCreateWithPriority(cudaStream_t* stream, unsigned flags, int)
{
    return cudaStreamCreateWithFlags(stream, flags);
}

inline bool is_elsewhere(cudaStream_t stream)
{
    return stream != nullptr && stream->device != on_processor::current_device;
}
namespace on_processor
{
/// How often the host has waited for a stream.
inline std::atomic<std::size_t> waits = 0;

inline std::size_t number_of(cudaStream_t stream)
{
    return stream != nullptr ? stream->number : static_cast<std::size_t>(current_device);
}
} // namespace on_processor
inline cudaError_t cudaStreamSynchronize(cudaStream_t stream)
{
    ++on_processor::waits;
    auto& worker = on_processor::Worker::one();
    worker.wait(worker.queued(on_processor::number_of(stream)));
    return cudaSuccess;
}
inline cudaError_t cudaMemcpy(void* to, void const* from, std::size_t bytes, cudaMemcpyKind)
{
    on_processor::Worker::one().wait();
    std::memcpy(to, from, bytes);
    return cudaSuccess;
}
inline cudaError_t cudaMemcpyAsync(void* to, void const* from, std::size_t bytes, cudaMemcpyKind kind,
                                   cudaStream_t stream)
{
    if (is_elsewhere(stream)) return on_processor::tell(cudaErrorInvalidResourceHandle);
    bool const waits = [&] { // as where the host's memory is not mapped
        if (kind == cudaMemcpyDeviceToDevice) return false;
        auto& memory = on_processor::Memory::one();
        std::lock_guard const lock(memory.mutex);
        return kind != cudaMemcpyDeviceToHost || memory.mapped.count(to) == 0;
    }();
    auto& worker = on_processor::Worker::one();
    std::size_t const number = on_processor::number_of(stream);
    worker.queue(number, [=] { std::memcpy(to, from, bytes); });
    if (waits) worker.wait(worker.queued(number));
    return cudaSuccess;
}
struct CUevent_st
{
    int device;
    on_processor::Place at{}; ///< when all until there is done, it happens
};
using cudaEvent_t = CUevent_st*;
constexpr unsigned cudaEventDisableTiming = 2;
inline cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned)
{
    *event = new CUevent_st{on_processor::current_device};
    return cudaSuccess;
}
inline cudaError_t cudaEventDestroy(cudaEvent_t event)
{
    delete event;
    return cudaSuccess;
}
inline cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream)
{
    if (is_elsewhere(stream) || event->device != on_processor::current_device)
        return on_processor::tell(cudaErrorInvalidResourceHandle);
    event->at = on_processor::Worker::one().queued(on_processor::number_of(stream));
    return cudaSuccess;
}
inline cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned)
{
    if (is_elsewhere(stream)) return on_processor::tell(cudaErrorInvalidResourceHandle);
    on_processor::Worker::one().queue(
        on_processor::number_of(stream), [] {}, event->at);
    return cudaSuccess;
}
inline cudaError_t cudaEventSynchronize(cudaEvent_t event)
{
    ++on_processor::waits;
    on_processor::Worker::one().wait(event->at);
    return cudaSuccess;
}
inline cudaError_t cudaMemsetAsync(void* to, int byte, std::size_t bytes, cudaStream_t stream)
{
    if (is_elsewhere(stream)) return on_processor::tell(cudaErrorInvalidResourceHandle);
    on_processor::Worker::one().queue(on_processor::number_of(stream), [=] { std::memset(to, byte, bytes); });
    return cudaSuccess;
}

template <class... Parameters>
cudaError_t cudaFuncGetAttributes(cudaFuncAttributes* attributes, void (*)(Parameters...))
{
    attributes->ptxVersion = 90;
    return cudaSuccess;
}
template <class... Parameters>
cudaError_t cudaFuncSetAttribute(void (*loop)(Parameters...), cudaFuncAttribute, int value)
{
    if (value > 227 * 1024) return on_processor::tell(cudaErrorInvalidValue);
    auto& memory = on_processor::Memory::one();
    std::lock_guard const lock(memory.mutex);
    memory.allowed[reinterpret_cast<void const*>(loop)] = static_cast<std::size_t>(value);
    return cudaSuccess;
}
template <class... Parameters, class... Arguments>
cudaError_t cudaLaunchKernelEx(cudaLaunchConfig_t const* how, void (*loop)(Parameters...),
                               Arguments&&... arguments)
{
    if (is_elsewhere(how->stream)) return on_processor::tell(cudaErrorInvalidResourceHandle);
    if (how->gridDim.x == 0 || how->blockDim.x == 0 || how->blockDim.x > 1024)
        return on_processor::tell(cudaErrorInvalidValue);
    {
        auto& memory = on_processor::Memory::one();
        std::lock_guard const lock(memory.mutex);
        auto const allowed = memory.allowed.find(reinterpret_cast<void const*>(loop));
        if (how->dynamicSmemBytes > (allowed == memory.allowed.end() ? 48 * 1024 : allowed->second))
            return on_processor::tell(cudaErrorInvalidValue);
    }
    on_processor::Worker::one().queue(
        on_processor::number_of(how->stream),
        [loop, groups = how->gridDim, threads = how->blockDim, shared = how->dynamicSmemBytes,
         given = std::tuple<Parameters...>(static_cast<Parameters>(arguments)...)] {
            on_processor::Worker::one().run_groups(groups, threads, shared, [&] { std::apply(loop, given); });
        });
    return cudaSuccess;
}

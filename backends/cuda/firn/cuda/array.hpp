// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/check.hpp>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

namespace firn::cuda
{

namespace detail
{
template <class T>
__global__ void fill(T* to, std::size_t count, T value)
{
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) to[i] = value;
}
} // namespace detail

/// Queues the copying of plain values from or to a device. Memory of the host had best be HostMemory: the
/// copy of any other may be waited for.
template <class T>
void copy_queued(Queue const& queue, T* to, T const* from, std::size_t count)
{
    if (count == 0) return;
    OnDevice const here(queue);
    check(cudaMemcpyAsync(static_cast<void*>(to), static_cast<void const*>(from), count * sizeof(T),
                          cudaMemcpyDefault, queue.stream),
          "cudaMemcpyAsync");
}

/// A growing array of plain values in a device's memory; new elements are not initialised.
template <class T>
class Array
{
    // Eigen's types are plain values, too, although they are not trivially copyable.
    static_assert(std::is_trivially_destructible_v<T>);

public:
    using Value = T;

    /// `backend` says on which device the elements lie and in which queue they are copied.
    template <class Backend>
    explicit Array(Backend const& backend) : queue_(backend.queue())
    {}
    Array(Array&& other) noexcept : queue_(other.queue_) { *this = std::move(other); }
    Array& operator=(Array&& other) noexcept
    {
        swap(other);
        return *this;
    }
    /// std::swap would do this three times.
    void swap(Array& other) noexcept
    {
        std::swap(queue_, other.queue_);
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }
    Array(Array const&) = delete;
    Array& operator=(Array const&) = delete;
    ~Array() { release(); }

    /// Changes the size and keeps the elements that fit.
    void resize(std::size_t size)
    {
        if (size > capacity_) grow(size_ == 0 ? size : with_spare(size), size_);
        size_ = size;
    }
    /// The same, keeping only the first `kept` elements. If memory is short, nothing has changed. Such arrays
    /// are many and large, and seldom grow: little of them is spare.
    void resize(std::size_t size, std::size_t kept)
    {
        if (size > capacity_) grow(size_ == 0 ? size : with_spare(size, 128), std::min(kept, size_));
        size_ = size;
    }

    /// Changes the size and drops the elements; frees their memory before allocating more.
    void renew(std::size_t size) { renew_with_room(size, capacity_ == 0 ? size : with_spare(size)); }
    /// The same, but with twice the room, for arrays that are small beside others and often grow: each growth
    /// waits for the device.
    void renew_amply(std::size_t size) { renew_with_room(size, 2 * size); }

    /// Frees the memory.
    void clear()
    {
        if (data_) queue_.wait();
        release();
    }

    /// Sets existing elements from `first` on.
    void upload(std::size_t first, std::span<T const> values)
    {
        copy(data_ + first, values.data(), values.size(), cudaMemcpyHostToDevice);
    }
    void fill(std::size_t first, std::size_t count, T const& value)
    {
        if (count == 0) return;
        OnDevice const here(queue_);
        launch_after("Array::fill", queue_, detail::fill<T>, groups_of(count, 256), 256, data_ + first, count,
                     value);
    }
    /// Sets all bytes of some elements.
    void fill_bytes(std::size_t first, std::size_t count, int byte)
    {
        if (count == 0) return;
        OnDevice const here(queue_);
        check(cudaMemsetAsync(data_ + first, byte, count * sizeof(T), queue_.stream), "cudaMemsetAsync");
    }

    /// Copies elements from `first` on.
    void download(std::size_t first, std::span<T> values) const
    {
        copy(values.data(), data_ + first, values.size(), cudaMemcpyDeviceToHost);
    }

    T* data() { return data_; }
    T const* data() const { return data_; }
    std::size_t size() const { return size_; }
    std::size_t memory() const { return capacity_ * sizeof(T); }

private:
    void renew_with_room(std::size_t size, std::size_t room)
    {
        if (size > capacity_) {
            queue_.wait();
            release();
            grow(room, 0);
        }
        size_ = size;
    }

    /// Makes repeated growth cheap: 3 % more, or another fraction, and as much again while the array is
    /// small.
    static std::size_t with_spare(std::size_t size, std::size_t fraction = 32)
    {
        std::size_t const little = (std::size_t(1) << 20) / sizeof(T);
        return size + std::max(size / fraction, std::min(size, little));
    }

    void grow(std::size_t capacity, std::size_t kept)
    {
        OnDevice const here(queue_);
        auto* const bigger = static_cast<T*>(allocate(queue_.device, capacity * sizeof(T)));
        if (kept > 0) copy(bigger, data_, kept, cudaMemcpyDeviceToDevice);
        std::size_t const size = size_;
        release();
        data_ = bigger;
        size_ = size;
        capacity_ = capacity;
    }

    void copy(T* to, T const* from, std::size_t count, cudaMemcpyKind kind) const
    {
        if (count == 0) return;
        OnDevice const here(queue_);
        check(cudaMemcpyAsync(to, from, count * sizeof(T), kind, queue_.stream), "cudaMemcpyAsync");
        queue_.wait();
    }

    void release()
    {
        if (data_) free_memory(queue_.device, data_, memory());
        data_ = nullptr;
        size_ = capacity_ = 0;
    }

    Queue queue_;
    T* data_ = nullptr;
    std::size_t size_ = 0, capacity_ = 0;
};

/// Memory of the host that devices can write to.
class HostMemory
{
public:
    explicit HostMemory(Queue const& queue) : queue_(queue) {}
    HostMemory(HostMemory&& other) noexcept : queue_(other.queue_) { *this = std::move(other); }
    HostMemory& operator=(HostMemory&& other) noexcept
    {
        std::swap(queue_, other.queue_);
        std::swap(memory_, other.memory_);
        std::swap(bytes_, other.bytes_);
        return *this;
    }
    ~HostMemory() { release(); }

    /// Room for this many values. They are zero at first, and again whenever the memory grows.
    template <class T>
    T* as(std::size_t count = 1)
    {
        if (count * sizeof(T) > bytes_) {
            OnDevice const here(queue_);
            release();
            std::size_t const bytes = count * sizeof(T);
            cudaError_t const status = cudaMallocHost(&memory_, bytes);
            if (status == cudaErrorMemoryAllocation) {
                static_cast<void>(cudaGetLastError());
                memory_ = nullptr;
                throw Error{"the host's memory is short: " + std::to_string(bytes) +
                                " bytes more were needed that devices can write to",
                            "CUDA", "Queue fewer steps at a time (Cuda::batch), or free memory of the host."};
            }
            check(status, "cudaMallocHost");
            bytes_ = bytes;
            std::memset(memory_, 0, bytes_);
        }
        return static_cast<T*>(memory_);
    }
    /// The memory as it is, without growing it.
    template <class T>
    T* get() const
    {
        return static_cast<T*>(memory_);
    }

private:
    void release()
    {
        if (memory_) static_cast<void>(cudaFreeHost(memory_));
        memory_ = nullptr;
        bytes_ = 0;
    }

    Queue queue_;
    void* memory_ = nullptr;
    std::size_t bytes_ = 0;
};

/// Values that loops write and the host reads when they are finished.
template <class T>
class ReadbackBuffer
{
public:
    template <class Backend>
    explicit ReadbackBuffer(Backend const& backend)
        : queue_(backend.queue()), there_(backend), here_(backend.queue())
    {}
    ReadbackBuffer(ReadbackBuffer&& other) noexcept
        : queue_(other.queue_), there_(std::move(other.there_)), here_(std::move(other.here_)),
          copied_(std::exchange(other.copied_, nullptr)), is_fetched_(other.is_fetched_)
    {}
    ~ReadbackBuffer()
    {
        if (copied_) static_cast<void>(cudaEventDestroy(copied_));
    }

    /// Makes room for at least this many values; zero until loops write them.
    void resize(std::size_t size)
    {
        std::size_t const before = there_.size();
        if (size <= before) return;
        there_.resize(size);
        there_.fill_bytes(before, size - before, 0);
    }
    T* data() { return there_.data(); }
    /// Sets existing values from `first` on, behind the loops that are queued.
    void fill(std::size_t first, std::size_t count, T const& value) { there_.fill(first, count, value); }

    /// Queues a copy of what loops have written by now: read() waits for this alone, and not for what is
    /// queued behind it.
    void fetch()
    {
        T* const here = here_.template as<T>(there_.size());
        if (there_.size() == 0) return;
        OnDevice const with(queue_);
        if (!copied_)
            check(cudaEventCreateWithFlags(&copied_, cudaEventDisableTiming), "cudaEventCreateWithFlags");
        check(cudaMemcpyAsync(here, there_.data(), there_.size() * sizeof(T), cudaMemcpyDeviceToHost,
                              queue_.stream),
              "cudaMemcpyAsync");
        check(cudaEventRecord(copied_, queue_.stream), "cudaEventRecord");
        is_fetched_ = true;
    }
    /// Waits for the loops and returns a copy of what they wrote, in host memory.
    T const* read()
    {
        if (!is_fetched_) fetch();
        OnDevice const with(queue_);
        if (is_fetched_) check(cudaEventSynchronize(copied_), "cudaEventSynchronize");
        is_fetched_ = false;
        return here_.template get<T>();
    }

private:
    Queue queue_;
    Array<T> there_;
    HostMemory here_;
    cudaEvent_t copied_ = nullptr; ///< has happened when the copy is there
    bool is_fetched_ = false;      ///< since it was read
};

} // namespace firn::cuda

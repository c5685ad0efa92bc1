// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <span>
#include <type_traits>
#include <utility>

namespace firn::openmp
{

/// A growing array of plain values, aligned to a cache line; new elements are not initialised.
template <class T>
class Array
{
    // Eigen's types are plain values, too, although they are not trivially copyable.
    static_assert(std::is_trivially_destructible_v<T>);
    static constexpr std::size_t alignment = 64, page = 4096;

public:
    /// Bytes behind the last element that may be read, but not used: packs are loaded whole.
    static constexpr std::size_t padding = 256;

    using Value = T;

    Array() = default;
    /// The backend does not matter: there is only one memory.
    template <class Backend>
    explicit Array(Backend const&)
    {}
    Array(Array&& other) noexcept { *this = std::move(other); }
    Array& operator=(Array&& other) noexcept
    {
        swap(other);
        return *this;
    }
    /// std::swap would do this three times.
    void swap(Array& other) noexcept
    {
        std::swap(block_, other.block_);
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }
    Array(Array const&) = delete;
    Array& operator=(Array const&) = delete;
    ~Array() { release(); }

    /// Changes the size and keeps the elements that fit; grows by half, so that repeated growth is cheap.
    void resize(std::size_t size) { resize(size, size_); }
    /// The same, keeping only the first `kept` elements. If memory is short, nothing has changed.
    void resize(std::size_t size, std::size_t kept)
    {
        if (size > capacity_) {
            std::size_t const capacity = size_ == 0 ? size : std::max(size, size_ + size_ / 2);
            // It is aligned here, since small scenes allocate often, and aligned allocation takes twice as
            // long.
            auto* const block =
                static_cast<char*>(::operator new(capacity * sizeof(T) + padding + page + alignment));
            std::size_t const beyond = reinterpret_cast<std::uintptr_t>(block) % alignment;
            auto* const bigger = reinterpret_cast<T*>(block + (alignment - beyond) % alignment + colour());
            kept = std::min(kept, size_);
            if (kept > 0) std::memcpy(static_cast<void*>(bigger), data_, kept * sizeof(T));
            release();
            block_ = block;
            data_ = bigger;
            capacity_ = capacity;
        }
        size_ = size;
    }

    /// Sets existing elements from `first` on.
    void upload(std::size_t first, std::span<T const> values)
    {
        std::copy(values.begin(), values.end(), data_ + first);
    }
    /// Out of line: adding items fills a dozen components, and each would inline a loop over packs.
    [[gnu::noinline]] void fill(std::size_t first, std::size_t count, T const& value)
    {
        std::fill_n(data_ + first, count, value);
    }

    /// Copies elements from `first` on.
    void download(std::size_t first, std::span<T> values) const
    {
        std::copy_n(data_ + first, values.size(), values.begin());
    }

    T* data() { return data_; }
    T const* data() const { return data_; }
    std::size_t size() const { return size_; }
    std::size_t memory() const { return capacity_ * sizeof(T); }
    T& operator[](std::size_t i)
    {
        assert(i < size_ && "an element is in its array");
        return data_[i];
    }
    T const& operator[](std::size_t i) const
    {
        assert(i < size_ && "an element is in its array");
        return data_[i];
    }

private:
    void release()
    {
        ::operator delete(block_);
        block_ = nullptr;
        data_ = nullptr;
    }

    /// Where in a page the next array begins [bytes]. Large blocks begin on a page boundary, so without
    /// this the elements of one item in several arrays would compete for the same few lines of the cache.
    static std::size_t colour()
    {
        static std::atomic<std::size_t> arrays = 0;
        return arrays++ * 5 * alignment % page;
    }

    char* block_ = nullptr;
    T* data_ = nullptr;
    std::size_t size_ = 0;
    std::size_t capacity_ = 0;
};

/// Values that loops write and the host reads when they have finished; here both use one memory.
template <class T>
class ReadbackBuffer : public Array<T>
{
public:
    using Array<T>::Array;
    void fetch() const {}
    T const* read() const { return this->data(); }
};

} // namespace firn::openmp

// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>
#include <type_traits>
#include <vector>

namespace firn
{
struct Reference;
}

namespace firn::reference
{

/// A growing array of plain values. All bits of a new element are set, so that a number that is read before
/// it was written is NaN, and an index lies beyond every array.
template <class T>
class Array
{
    // Eigen's types are plain values, too, although they are not trivially copyable.
    static_assert(std::is_trivially_destructible_v<T>);

    /// The memory of an element: T may have no default constructor.
    struct alignas(T) Element
    {
        Element() { std::fill_n(byte, sizeof(T), static_cast<unsigned char>(0xff)); }
        unsigned char byte[sizeof(T)];
    };

public:
    using Value = T;

    explicit Array(Reference const&) {}
    Array(Array&&) noexcept = default;
    Array& operator=(Array&&) noexcept = default;
    void swap(Array& other) noexcept { elements_.swap(other.elements_); }

    void resize(std::size_t size, std::size_t kept)
    {
        elements_.reserve(size); // if memory is short, nothing has changed
        elements_.resize(std::min(kept, elements_.size()));
        elements_.resize(size);
    }
    void resize(std::size_t size) { resize(size, size); }
    void upload(std::size_t first, std::span<T const> values)
    {
        assert(first + values.size() <= size() && "elements that are set exist");
        std::copy(values.begin(), values.end(), data() + first);
    }
    void fill(std::size_t first, std::size_t count, T const& value)
    {
        assert(first + count <= size() && "elements that are set exist");
        std::fill_n(data() + first, count, value);
    }
    void download(std::size_t first, std::span<T> values) const
    {
        assert(first + values.size() <= size() && "elements that are copied exist");
        std::copy_n(data() + first, values.size(), values.begin());
    }

    T* data() { return reinterpret_cast<T*>(elements_.data()); }
    T const* data() const { return reinterpret_cast<T const*>(elements_.data()); }
    std::size_t size() const { return elements_.size(); }
    std::size_t memory() const { return elements_.capacity() * sizeof(T); }

private:
    std::vector<Element> elements_;
};

/// Values that loops write and the host reads when they have finished; here both use one memory.
template <class T>
struct ReadbackBuffer : Array<T>
{
    using Array<T>::Array;
    void fetch() const {}
    T const* read() const { return this->data(); }
};

} // namespace firn::reference

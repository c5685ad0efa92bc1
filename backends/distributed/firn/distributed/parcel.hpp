// SPDX-License-Identifier: MIT
#pragma once

#include <firn/distributed/communicator.hpp>

#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>

// How plain values are written to parcels, and read from them.
namespace firn::distributed
{

/// Appends values to a parcel, one behind the other.
template <class T>
void put(Parcel& to, T const* values, std::size_t count)
{
    static_assert(std::is_trivially_destructible_v<T>, "what is sent is a plain value");
    std::size_t const before = to.size();
    to.resize(before + count * sizeof(T));
    if (count > 0) std::memcpy(to.data() + before, static_cast<void const*>(values), count * sizeof(T));
}
template <class T>
void put(Parcel& to, T const& value)
{
    put(to, &value, 1);
}

/// Reads a parcel from its beginning.
class Reader
{
public:
    explicit Reader(std::span<std::byte const> from) : rest_(from) {}

    bool at_end() const { return rest_.empty(); }
    template <class T>
    void get(T* to, std::size_t count)
    {
        std::size_t const bytes = count * sizeof(T);
        if (count > 0) std::memcpy(static_cast<void*>(to), rest_.data(), bytes);
        rest_ = rest_.subspan(bytes);
    }
    void skip(std::size_t bytes) { rest_ = rest_.subspan(bytes); }
    template <class T>
    T get()
    {
        T value;
        get(&value, 1);
        return value;
    }

private:
    std::span<std::byte const> rest_;
};

} // namespace firn::distributed

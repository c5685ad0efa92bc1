// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <utility>
#include <vector>

namespace firn
{

/// Arrays of plain values that loops write and the host reads, one per type of value. The effects of a call
/// determine what a step stores, so the types are known by calls only; an array stays for later calls of the
/// same type.
template <class Backend>
class TypedStorage
{
public:
    explicit TypedStorage(Backend const& backend) : backend_(backend) {}
    TypedStorage(TypedStorage&&) = default; // a copy would share the arrays
    TypedStorage& operator=(TypedStorage&&) = default;

    /// The array of this type of value; initially empty.
    template <class T>
    auto& of()
    {
        using Buffer = typename Backend::template ReadbackBuffer<T>;
        for (auto const& [type, buffer] : buffers_)
            if (type == &identity<T>) return *static_cast<Buffer*>(buffer.get());
        buffers_.emplace_back(&identity<T>, std::make_shared<Buffer>(backend_));
        return *static_cast<Buffer*>(buffers_.back().second.get());
    }

private:
    template <class T>
    static inline char identity = 0; ///< its address stands for the type: host programs may have no RTTI

    Backend backend_;
    std::vector<std::pair<char const*, std::shared_ptr<void>>> buffers_;
};

} // namespace firn

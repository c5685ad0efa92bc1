// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/objects_by_type.hpp>

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

    /// The array of this type of value; initially empty.
    template <class T>
    auto& of()
    {
        return buffers_.of<typename Backend::template ReadbackBuffer<T>>(backend_);
    }

private:
    Backend backend_;
    ObjectsByType buffers_;
};

} // namespace firn

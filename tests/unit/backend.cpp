// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/backend.hpp>
#include <firn/core/serial.hpp>
#include <firn/openmp.hpp>
#include <firn/reference.hpp>

using namespace firn;

namespace
{

template <class Backend>
constexpr bool is_complete = CompleteBackend<Backend, float, 2>&& CompleteBackend<Backend, float, 3>&&
    CompleteBackend<Backend, double, 2>&& CompleteBackend<Backend, double, 3>;

// Backends that lack one member each.
struct WithoutLane : Reference
{
    template <class>
    struct Lane;
};
struct WithoutValidate : Reference
{
    void validate() const = delete;
};
struct WithoutReach : Reference // which is needed where loops do not reach the host's memory
{
    static constexpr bool reaches_host_memory = false;
};
struct WithoutQueue : Reference
{
    static constexpr bool queues = true;
};
template <class T>
struct ShortArray : reference::Array<T>
{
    using reference::Array<T>::Array;
    void swap(ShortArray&) = delete;
};
struct WithoutSwap : Reference
{
    template <class T>
    using Array = ShortArray<T>;
};
struct WithoutOrder : Reference
{
    template <class Number, int d>
    using CellOrder = reference::Array<Number>;
};
struct WithoutGrid : Reference
{
    template <class Number, int, int, int, int, int>
    using Grid = reference::Array<Number>;
};
struct WithoutBuffer : Reference
{
    template <class T>
    using ReadbackBuffer = reference::Array<T>;
};
struct WithoutLoop : Reference
{
    void for_each(std::size_t, int) const;
};

} // namespace

TEST_CASE("a backend that lacks a member is known as incomplete")
{
    STATIC_REQUIRE(is_complete<Reference>);
    STATIC_REQUIRE(is_complete<OpenMP>);
    STATIC_REQUIRE_FALSE(is_complete<Serial>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutLane>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutValidate>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutReach>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutQueue>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutSwap>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutOrder>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutGrid>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutBuffer>);
    STATIC_REQUIRE_FALSE(is_complete<WithoutLoop>);
}

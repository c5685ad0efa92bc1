// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <thread>

/// A loop of two threads that runs the second half backwards: an order that no caller may rely on.
struct TwoThreads
{
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        std::thread first([&] {
            for (std::size_t i = 0; i < count / 2; ++i) body(i);
        });
        for (std::size_t i = count; i > count / 2; --i) body(i - 1);
        first.join();
    }
};

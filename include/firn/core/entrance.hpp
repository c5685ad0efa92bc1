// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

namespace firn::detail
{

/// Counts who is inside an object: nobody, one call that changes it, or some that only look. Whoever comes
/// between gets an Error; with NDEBUG defined nobody looks.
///
/// `Count` is the backend's: an integer that may be changed from several sides at the same time.
template <class Count>
class Entrance
{
public:
    /// Lasts as long as a call does.
    class Visit
    {
    public:
        Visit(Count* inside, int as) : inside_(inside), as_(as) {}
        Visit(Visit const&) = delete;
        Visit& operator=(Visit const&) = delete;
        ~Visit()
        {
            if (inside_) inside_->fetch_sub(as_); // the same where only some files define NDEBUG
        }

    private:
        Count* inside_;
        int as_;
    };

    Entrance() = default;
    Entrance(Entrance&&) noexcept {} // who is inside one is not inside the other
    Entrance& operator=(Entrance&&) noexcept { return *this; }

    [[nodiscard]] Visit to_change([[maybe_unused]] char const* where) const
    {
#ifdef NDEBUG
        return {nullptr, 0};
#else
        int nobody = 0;
        if (!inside_.compare_exchange_strong(nobody, changing)) refuse(where);
        return {&inside_, changing};
#endif
    }

    [[nodiscard]] Visit to_look([[maybe_unused]] char const* where) const
    {
#ifdef NDEBUG
        return {nullptr, 0};
#else
        int looking = inside_.load();
        do
            if (looking == changing) refuse(where);
        while (!inside_.compare_exchange_weak(looking, looking + 1));
        return {&inside_, 1};
#endif
    }

private:
    static constexpr int changing = -1;

    [[noreturn]] static void refuse(char const* where)
    {
        throw Error{"another call of the same object is under way", where,
                    "One thread at a time calls a solver: let the others wait, or give each its own."};
    }

    mutable Count inside_{0};
};

} // namespace firn::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <cassert>
#include <optional>
#include <string>
#include <utility>

namespace firn::detail
{

/// Counts the calls inside an object: none, one that changes it, or some that only read. A call that comes
/// between gets an Error. With NDEBUG defined nothing is counted, but a call that comes from inside of one
/// that changes the object, such as from its callback, gets an Error all the same, and so does a move of the
/// object to another one, or of another one to it. A call to an object that was moved from, or in which a
/// call broke off in the middle, always gets an Error.
///
/// Be it the first member that is moved, so that nothing has changed when a move is refused. `Count` is the
/// backend's: an integer that several threads may change at the same time.
template <class Count>
class AccessGuard
{
public:
    /// Lasts as long as a call does.
    class Access
    {
    public:
        Access(Count* inside, int as, bool* changes = nullptr) : inside_(inside), as_(as), changes_(changes)
        {
            if (changes_) *changes_ = true;
        }
        Access(Access const&) = delete;
        Access& operator=(Access const&) = delete;
        ~Access()
        {
            if (inside_) inside_->fetch_sub(as_); // the same where only some files define NDEBUG
            if (changes_) *changes_ = false;
        }

    private:
        Count* inside_;
        int as_;
        bool* changes_;
    };

    AccessGuard() = default;
    AccessGuard(AccessGuard&& other)
        : state_(std::exchange(other.at_rest().state_, State::moved_away)), why_(std::move(other.why_))
    {}
    AccessGuard& operator=(AccessGuard&& other)
    {
        at_rest();
        state_ = std::exchange(other.at_rest().state_, State::moved_away);
        why_ = std::move(other.why_);
        return *this;
    }
    ~AccessGuard() { assert(!is_changing_ && "a call was under way as its object was destroyed"); }

    /// Refuses all calls from now on, since this one leaves the object in an unknown state; `why` may be
    /// null.
    [[gnu::cold]] void break_off(Error const* why) noexcept
    {
        state_ = State::broken_off;
        try {
            if (why) why_ = *why;
        }
        catch (...) { // no memory left even for that
        }
    }

    /// Runs the work of a call. If it throws, and `is_half_done()` is then true, there is no state to go on
    /// from: breaks off.
    template <class Work, class IsHalfDone>
    auto or_break_off(Work const& work, IsHalfDone const& is_half_done)
    {
        try {
            return work();
        }
        catch (Error const& error) {
            if (is_half_done()) break_off(&error);
            throw;
        }
        catch (...) { // most likely std::bad_alloc
            if (is_half_done()) break_off(nullptr);
            throw;
        }
    }

    [[nodiscard]] Access write(char const* where) const
    {
        if (state_ != State::sound) refuse_for_good(where);
#ifdef NDEBUG
        if (is_changing_) refuse(where);
        return {nullptr, 0, &is_changing_};
#else
        int none = 0;
        if (!inside_.compare_exchange_strong(none, changing)) refuse(where);
        return {&inside_, changing, &is_changing_};
#endif
    }

    [[nodiscard]] Access read(char const* where) const
    {
        if (state_ != State::sound) refuse_for_good(where);
#ifdef NDEBUG
        if (is_changing_) refuse(where);
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

    enum class State
    {
        sound,
        broken_off,
        moved_away
    };

    /// This object if no call is inside: another one would go on with what was moved away.
    AccessGuard& at_rest()
    {
        bool is_inside = is_changing_;
#ifndef NDEBUG
        is_inside = is_inside || inside_.load() != 0;
#endif
        require(!is_inside, "a call of an object is under way that is to be moved, or assigned to",
                "a move of a solver",
                "Do it after the call, and not in a callback such as Budget::progress.");
        return *this;
    }

    [[noreturn, gnu::cold]] static void refuse(char const* where)
    {
        throw Error{
            "another call of the same object is under way", where,
            "One thread at a time calls a solver: let the others wait, or give each its own. A callback, "
            "such as Budget::progress, does not call it: do that after the call."};
    }

    [[noreturn, gnu::cold]] void refuse_for_good(char const* where) const
    {
        if (state_ == State::moved_away)
            throw Error{"this object was moved to another", where,
                        "Call that one, or assign another to this one first."};
        throw Error{
            "a call before broke off in the middle: " +
                (why_ ? why_->what_is_wrong()
                      : std::string("there was no memory left, or what it was given threw an exception")),
            where,
            (why_ ? why_->remedy()
                  : std::string("Free memory, or look into shapes, effects and models of your own.")) +
                " This object has no state to go on from: make a new one, from a snapshot or a "
                "checkpoint if there is one."};
    }

    mutable Count inside_{0};
    mutable bool is_changing_ = false; ///< a call that changes the object is under way
    State state_ = State::sound;
    std::optional<Error> why_;
};

} // namespace firn::detail

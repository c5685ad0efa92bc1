// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/phases/solve_phase.hpp>

#include <cstddef>
#include <cstdint>

// The numbers of a search by conjugate gradients, which lie where loops run: phases read them, so that a
// backend can queue iterations before the host knows how those before went.
namespace firn
{

/// How far a search is. r is the residual, z the preconditioned one, p the direction.
struct SearchState
{
    double rz = 0, before = 0, first = 0; ///< r z; that of the iteration before, and of the beginning
    double enough = 0;                    ///< where the search ends
    double along = 0;                     ///< how far to go along p
    double share = 0;                     ///< of p, in the next direction
    double slope = 0;                     ///< of the incremental energy, along all that was found: below 0
    int products = 0;                     ///< H p in all
    bool falls = true;                    ///< p H p was above 0
    bool has_ended = false;               ///< phases leave nodes alone
};

/// How far a search is, as the host may look at it while later iterations are at work. One number, so that
/// all of it is of one time: twice the products, and 1 more once the search has ended.
struct SearchProgress
{
    std::uint32_t number = 0;

    bool has_ended() const { return number % 2 != 0; }
    int products() const { return static_cast<int>(number / 2); }

    /// Called where loops run. `to` may be null.
    FIRN_HOST_DEVICE static void tell(std::uint32_t* to, SearchState const& now)
    {
        if (to == nullptr) return;
        *static_cast<std::uint32_t volatile*>(to) =
            2 * static_cast<std::uint32_t>(now.products) + (now.has_ended ? 1 : 0);
    }
};

/// What coarse grids add to r z, in parts.
struct CoarsePartsOfSum
{
    double const* parts = nullptr;
    std::size_t count = 0;

    FIRN_HOST_DEVICE double operator()() const
    {
        double sum = 0;
        FIRN_UNROLL
        for (std::size_t i = 0; i < count; ++i) sum += parts[i];
        return sum;
    }
};

/// Begins a search, with r z.
struct BeginSearch
{
    SearchState* state;
    double forcing; ///< the share of the residual at which the search ends
    CoarsePartsOfSum coarse;
    std::uint32_t* told; ///< of SearchProgress

    FIRN_HOST_DEVICE void operator()(SearchSum const& found) const
    {
        SearchState now;
        now.rz = now.first = found.sum + coarse();
        now.enough = forcing * forcing * now.rz;
        now.has_ended = !(now.rz > 0);
        *state = now;
        SearchProgress::tell(told, now);
    }
};

/// Chooses how far to go along a direction, with p H p. What was found before one along which the energy does
/// not rise is a descent; the first direction is one, too.
struct ChooseLength
{
    SearchState* state;
    std::uint32_t* told; ///< of SearchProgress

    FIRN_HOST_DEVICE void operator()(SearchSum const& found) const
    {
        if (state->has_ended) return;
        double const curvature = found.sum;
        state->falls = curvature > 0 && is_finite(curvature);
        state->along = state->falls ? state->rz / curvature : 1;
        state->has_ended = !state->falls && state->products > 0;
        ++state->products;
        if (state->has_ended) SearchProgress::tell(told, *state);
    }
};

/// Chooses the next direction, with r z of what is left.
struct ChooseDirection
{
    SearchState* state;
    CoarsePartsOfSum coarse;
    std::uint32_t* told; ///< of SearchProgress

    FIRN_HOST_DEVICE void operator()(SearchSum const& found) const
    {
        if (state->has_ended) return;
        state->slope -= state->along * state->rz;
        state->before = state->rz;
        state->rz = found.sum + coarse();
        state->share = state->rz / state->before;
        state->has_ended = !state->falls || !(state->rz > state->enough);
        SearchProgress::tell(told, *state);
    }
};

/// Stores the merged results of a loop where the host reads them.
template <class Result>
struct StoreResult
{
    Result* to;

    FIRN_HOST_DEVICE void operator()(Result const& result) const { *to = result; }
};

/// Calls `body(merged results)` where loops run, for what a loop over nodes returned.
template <class Backend, class Found, class Body>
void call_with(Backend const& backend, Found const& found, Body const& body)
{
    if constexpr (Backend::queues || spans_devices<Backend>)
        backend.call_with(found, body);
    else
        body(found);
}

/// The merged results of a loop over nodes, once it has finished; `buffer` is where loops write them.
template <class Backend, class Buffer, class Found>
auto merged_result(Backend const& backend, [[maybe_unused]] Buffer& buffer, Found const& found)
{
    if constexpr (Backend::queues || spans_devices<Backend>) {
        buffer.resize(1);
        backend.call_with(found, StoreResult{buffer.data()});
        return *buffer.read();
    }
    else
        return found;
}

} // namespace firn

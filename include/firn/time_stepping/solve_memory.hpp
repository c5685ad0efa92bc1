// SPDX-License-Identifier: MIT
#pragma once

#include <firn/particles/storage.hpp>
#include <firn/phases/solve_particles.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/solve_search.hpp>
#include <firn/time_stepping/coarse_grids.hpp>
#include <firn/time_stepping/kept_directions.hpp>
#include <firn/time_stepping/solve_report.hpp>
#include <firn/transfer/integrators.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>

namespace firn
{

/// In place of a number at which the host looks: where loops have finished when a call returns, there is
/// none.
struct NotWatched
{
    explicit NotWatched(auto const&) {}
    void begin() const {}
    std::uint32_t* there() const { return nullptr; }
};

namespace detail
{
template <class Backend>
struct WatchedOf
{
    using Type = NotWatched;
};
template <class Backend>
requires Backend::queues struct WatchedOf<Backend>
{
    using Type = typename Backend::WatchedNumber;
};
} // namespace detail

/// What a backend that queues calls WatchedNumber: a number that loops write, and at which the host looks.
template <class Backend>
using WatchedBy = typename detail::WatchedOf<Backend>::Type;

/// The memory of implicit steps: what particles cache while one is solved, and how the last one went.
template <class Backend, class Sets>
class SolveMemory
{
    template <std::size_t k>
    using Trial = DerivedStorage<Backend, typename Sets::Space,
                                 TrialFields<typename Sets::template MaterialTraits<k>::Model>>;

public:
    static constexpr int d = Sets::Space::dimension;

    explicit SolveMemory(Backend const& backend)
        : coarse(backend), kept(backend), search(backend), progress(backend), sums(backend), backend_(backend)
    {}

    CoarseGrids<Backend, typename Sets::Space> coarse;             ///< that precondition
    KeptDirections<Backend, typename Sets::Space> kept;            ///< by which small scenes precondition
    typename Backend::template ReadbackBuffer<SearchState> search; ///< where loops run
    WatchedBy<Backend> progress;                                   ///< of the search, as the host sees it
    typename Backend::template ReadbackBuffer<SolveSums<d>> sums;  ///< what the host reads of nodes

    SolveReport report{};          ///< of the last step; its counts are those of the call
    char const* refused = nullptr; ///< why the last step cannot be solved at all, if so
    char const* loose = nullptr;   ///< why nothing held the scene in the last load step, if so
    bool is_everywhere = false;    ///< the last step failed in all of the scene, not at the report's place
    bool at_rest = false;          ///< the scene is brought to rest
    double left_out = 0;           ///< the share of the load that is left for another load step

    /// The cached fields of a material's `count` particles.
    template <std::size_t k>
    auto trial(std::size_t count)
    {
        auto& own = std::get<k>(trials_);
        if (!own)
            own.emplace(backend_, count);
        else if (sizes_[k] != count)
            own->resize(count);
        sizes_[k] = count;
        return own->view();
    }

    /// Bytes held.
    std::size_t memory() const
    {
        return std::apply(
            [&](auto const&... own) {
                return ((coarse.memory() + kept.memory()) + ... + (own ? own->memory() : 0));
            },
            trials_);
    }

private:
    template <std::size_t... k>
    static std::tuple<std::optional<Trial<k>>...> storage_of(std::index_sequence<k...>);

    Backend backend_;
    decltype(storage_of(typename Sets::Places{})) trials_;
    std::array<std::size_t, Sets::count> sizes_{};
};

/// Where steps are explicit.
struct NoSolveMemory
{
    explicit NoSolveMemory(auto const&) {}
};

namespace detail
{
template <class Backend, class Sets, class Transfer>
struct SolveMemoryOf
{
    using Type = NoSolveMemory;
};
template <class Backend, class Sets, StepsImplicitly Transfer>
struct SolveMemoryOf<Backend, Sets, Transfer>
{
    using Type = SolveMemory<Backend, Sets>;
};
} // namespace detail

/// The memory that the steps of a transfer scheme need.
template <class Backend, class Sets, class Transfer>
using SolveMemoryFor = typename detail::SolveMemoryOf<Backend, Sets, Transfer>::Type;

} // namespace firn

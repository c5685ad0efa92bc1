// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <new>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

// A backend may be one of several ranks, each with a part of the particles. What is about all particles is
// then put together here, in calls that all ranks make in the same order. On other backends these do nothing.
namespace firn
{

/// Whether a backend has a part of the particles alone.
template <class Backend>
inline constexpr bool spans_ranks = false;
template <class Backend>
    requires requires { requires Backend::spans_ranks; }
inline constexpr bool spans_ranks<Backend> = true;
/// Whether loops of these ranks run on devices. Each then knows all blocks of the grid and all of its nodes,
/// by the same indices.
template <class Backend>
inline constexpr bool spans_devices = false;
template <class Backend>
    requires spans_ranks<Backend>
inline constexpr bool spans_devices<Backend> = !Backend::reaches_host_memory;

namespace detail
{
/// The backend that a scene on a lattice along so many axes keeps. Ranks divide space for each scene by
/// itself.
template <class Backend, class Lattice>
Backend backend_of_scene(Backend backend, [[maybe_unused]] Lattice const& lattice, [[maybe_unused]] int axes)
{
    if constexpr (spans_ranks<Backend>) backend.begin_scene(lattice, axes);
    return backend;
}

/// Refuses a call that ranks make with other arguments, or while another rank makes another one.
[[noreturn]] inline void throw_other_call(std::string const& where)
{
    throw Error{"not all ranks make the same call with the same arguments", where,
                "Run the same program on all ranks, and let it decide by what it has in common: not by rank, "
                "nor by time."};
}

/// The values of all ranks, one rank's behind the other's.
template <class Backend, class T>
std::vector<T> of_all_ranks([[maybe_unused]] Backend const& backend, std::vector<T> values)
{
    if constexpr (spans_ranks<Backend>) {
        static_assert(std::is_trivially_destructible_v<T>, "what ranks send is a plain value");
        std::vector<std::byte> own(values.size() * sizeof(T));
        if (!own.empty()) std::memcpy(own.data(), static_cast<void const*>(values.data()), own.size());
        auto const all = backend.all_gather(own);
        std::size_t bytes = 0;
        for (auto const& of_rank : all) {
            if (of_rank.size() % sizeof(T) != 0) throw_other_call("a call about all particles");
            bytes += of_rank.size();
        }
        values.resize(bytes / sizeof(T));
        bytes = 0;
        for (auto const& of_rank : all) {
            if (of_rank.empty()) continue;
            std::memcpy(reinterpret_cast<std::byte*>(values.data()) + bytes, of_rank.data(), of_rank.size());
            bytes += of_rank.size();
        }
    }
    return values;
}

/// Whether this rank does what all know and one is to do.
template <class Backend>
bool is_first_rank([[maybe_unused]] Backend const& backend)
{
    if constexpr (spans_ranks<Backend>)
        return backend.rank() == 0;
    else
        return true;
}

/// The sum of a number over all ranks.
template <class Backend>
std::size_t sum_of_ranks([[maybe_unused]] Backend const& backend, std::size_t number)
{
    if constexpr (spans_ranks<Backend>) {
        std::size_t sum = 0;
        for (auto const of_rank : of_all_ranks(backend, std::vector<std::uint64_t>{number})) sum += of_rank;
        return sum;
    }
    else
        return number;
}

/// What the first rank has found, for all of them: by a clock, for example.
template <class Backend, class T>
T of_first_rank([[maybe_unused]] Backend const& backend, T const& own)
{
    if constexpr (spans_ranks<Backend>)
        return of_all_ranks(backend, std::vector<T>{own}).front();
    else
        return own;
}

/// Which particles' values a list by row is to have. Rows of other ranks are there in either case.
enum class Rows
{
    all,
    here ///< those on this rank
};

/// Completes a list by row, of which each rank has the values in the rows that it lists.
template <class Backend, class T>
void share_rows([[maybe_unused]] Backend const& backend, [[maybe_unused]] std::vector<std::uint32_t> rows,
                [[maybe_unused]] std::vector<T>& by_row, [[maybe_unused]] Rows wanted)
{
    if constexpr (spans_ranks<Backend>) {
        if (wanted == Rows::here) return;
        std::vector<T> values;
        values.reserve(rows.size());
        for (auto const row : rows) values.push_back(by_row[row]);
        rows = of_all_ranks(backend, std::move(rows));
        bool const are_all = rows.size() == by_row.size() &&
                             std::ranges::all_of(rows, [&](auto row) { return row < by_row.size(); });
        if (!are_all) throw_other_call("a call about all particles");
        values = of_all_ranks(backend, std::move(values));
        for (std::size_t i = 0; i < rows.size(); ++i) by_row[rows[i]] = values[i];
    }
}

/// What an exception says, for other ranks to throw the same: its parts, each behind a 0.
inline std::vector<char> parts_of(std::exception const& thrown)
{
    std::vector<char> parts;
    auto const add = [&](std::string const& part) {
        parts.insert(parts.end(), part.begin(), part.end());
        parts.push_back(0);
    };
    auto const* const error = dynamic_cast<Error const*>(&thrown);
    add(error ? error->what_is_wrong() : thrown.what());
    add(error ? error->where() : "a rank");
    add(error ? error->remedy() : "See what its system says.");
    return parts;
}

/// Does a part of the work of a call that may throw on one rank alone. All ranks then throw the same Error,
/// that of the first rank that has one.
template <class Backend, class Work>
void on_all_ranks([[maybe_unused]] Backend const& backend, Work const& work)
{
    if constexpr (spans_ranks<Backend>) {
        std::vector<char> own;
        try {
            work();
        }
        catch (std::exception const& thrown) {
            own = parts_of(thrown);
        }
        std::vector<char> const all = of_all_ranks(backend, std::move(own));
        if (all.empty()) return;
        std::array<std::string, 3> parts;
        char const* from = all.data();
        for (auto& part : parts) {
            part = from;
            from += part.size() + 1;
        }
        throw Error{parts[0], parts[1], parts[2]};
    }
    else
        work();
}

/// Does work that one rank does for all, such as writing a file. All ranks wait for it, and throw its Error.
template <class Backend, class Work>
void on_first_rank([[maybe_unused]] Backend const& backend, Work const& work)
{
    if constexpr (spans_ranks<Backend>)
        on_all_ranks(backend, [&] {
            if (backend.rank() == 0) work();
        });
    else
        work();
}

/// Refuses a call that other ranks do not make, or with other arguments.
template <class Backend>
void require_same_on_ranks([[maybe_unused]] Backend const& backend, [[maybe_unused]] char const* call,
                           [[maybe_unused]] std::string const& what)
{
    if constexpr (spans_ranks<Backend>) {
        std::string const own = call + (": " + what);
        std::uint64_t hash = 0xcbf29ce484222325u; // Fowler, Noll and Vo
        for (char const c : own) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
        for (auto const other : of_all_ranks(backend, std::vector<std::uint64_t>{hash}))
            if (other != hash) throw_other_call(own);
    }
}

/// Numbers as a text that tells them apart.
template <class... Numbers>
std::string text_of(Numbers const&... numbers)
{
    std::ostringstream text;
    text.precision(17);
    ((text << numbers << ' '), ...);
    return text.str();
}

/// A number that tells values apart by their bits.
template <class T>
std::uint64_t hash_of(std::vector<T> const& values)
{
    static_assert(std::is_trivially_destructible_v<T>, "what is compared is a plain value");
    std::uint64_t hash = 0;
    for (T const& value : values)
        for (std::size_t first = 0; first < sizeof(T); first += sizeof hash) {
            std::uint64_t bits = 0;
            std::memcpy(&bits, reinterpret_cast<std::byte const*>(&value) + first,
                        std::min(sizeof bits, sizeof(T) - first));
            hash = (hash ^ bits) * 0x9e3779b97f4a7c15u;
        }
    return hash;
}

/// Refuses values of which other ranks pass others.
template <class Backend, class T>
void require_same_values([[maybe_unused]] Backend const& backend, [[maybe_unused]] char const* call,
                         [[maybe_unused]] char const* name, [[maybe_unused]] std::vector<T> const& values)
{
    if constexpr (spans_ranks<Backend>)
        require_same_on_ranks(backend, call, text_of(values.size(), name, hash_of(values)));
}

/// Does the work of a call that changes a scene. Where a rank runs out of memory, or its device fails, the
/// others must not wait.
template <class Backend, class Work>
void call_on_ranks([[maybe_unused]] Backend const& backend, [[maybe_unused]] char const* call,
                   Work const& work)
{
    if constexpr (spans_ranks<Backend>) {
        require_same_on_ranks(backend, call, "");
        try {
            work();
        }
        catch (std::bad_alloc const&) {
            backend.abort("it has run out of memory");
            throw;
        }
        catch (Error const& error) {
            if (backend.is_own(error)) backend.abort(error.what());
            throw;
        }
    }
    else
        work();
}
} // namespace detail

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/particles/storage.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

// Particles that have moved to cells of another rank travel there with all their fields. The backend's order
// of cells says which do, and sorts them in; their values are packed and unpacked here. `Contents` are a
// ParticleTable's.
namespace firn::detail
{

/// Appends the elements of some arrays at the same places to bytes.
template <class Backend>
class PackListed
{
    using Word = std::uint64_t; // what is stored of a particle has no larger numbers

public:
    PackListed(Backend const& backend, std::vector<std::uint32_t> const& places, std::vector<std::byte>& to)
        : backend_(backend), count_(places.size()), places_(array_of(backend, places)), picked_(backend),
          to_(to)
    {
        picked_.resize(std::max<std::size_t>(count_, 1));
    }

    template <class Array>
    void operator()(Array const& from)
    {
        using T = typename Array::Value;
        static_assert(sizeof(T) <= sizeof(Word));
        if (count_ == 0) return;
        auto* const picked = reinterpret_cast<T*>(picked_.data());
        backend_.for_each(count_, GatherValues<T>{from.data(), places_.data(), picked});
        words_.resize((count_ * sizeof(T) + sizeof(Word) - 1) / sizeof(Word));
        picked_.download(0, words_);
        auto const* const bytes = reinterpret_cast<std::byte const*>(words_.data());
        to_.insert(to_.end(), bytes, bytes + count_ * sizeof(T));
    }

private:
    Backend const& backend_;
    std::size_t count_;
    typename Backend::template Array<std::uint32_t> places_;
    typename Backend::template Array<Word> picked_;
    std::vector<Word> words_;
    std::vector<std::byte>& to_;
};

/// Takes so many values from the front of bytes.
template <class T>
std::vector<T> unpack(std::span<std::byte const>& from, std::size_t count)
{
    std::vector<T> values(count);
    if (count > 0) std::memcpy(values.data(), from.data(), count * sizeof(T));
    from = from.subspan(count * sizeof(T));
    return values;
}

/// Calls `use(array)` for all arrays of a buffer.
template <class Buffer, class Use>
void for_each_array(Buffer& buffer, Use&& use)
{
    for (auto& array : buffer.offset) use(array);
    for (auto& array : buffer.component) use(array);
    use(buffer.id);
}

/// Whether particles take cached fields with them: not if these are the same for all.
template <class Contents>
bool sends_cached(Contents const& contents)
{
    return contents.gathered.is_cached() && !contents.gathered.same();
}

/// All particles for one other rank, or from it: how many, the order's notes about them, their fields, and
/// those that are cached beside them.
template <class Contents, class Backend, class Departure>
std::vector<std::byte> pack_particles(Contents const& from, Backend const& backend,
                                      Departure const& departure)
{
    std::vector<std::byte> bytes;
    std::uint64_t const head[2]{departure.places.size(), departure.notes.size()};
    bytes.resize(sizeof head);
    std::memcpy(bytes.data(), head, sizeof head);
    bytes.insert(bytes.end(), departure.notes.begin(), departure.notes.end());
    if (departure.places.empty()) return bytes;
    for_each_array(from.buffer[0], PackListed<Backend>(backend, departure.places, bytes));
    if (sends_cached(from)) {
        auto const all = downloaded(from.buffer[0].id);
        std::vector<std::uint32_t> rows;
        for (auto const place : departure.places) rows.push_back(all[place]);
        auto const& cached = from.gathered.rows();
        PackListed<Backend> pack(backend, rows, bytes);
        for (std::size_t c = 0; c < cached.columns(); ++c) pack(cached.column(static_cast<int>(c)));
    }
    return bytes;
}

/// Sets the listed rows of cached fields to the values that come next in bytes.
template <class Cached, class Backend>
void put_rows(Cached& cached, Backend const& backend, std::vector<std::uint32_t> const& rows,
              std::span<std::byte const>& bytes)
{
    auto const rows_there = array_of(backend, rows);
    for (std::size_t c = 0; c < cached.columns(); ++c) {
        auto& column = cached.column(static_cast<int>(c));
        using T = typename std::remove_cvref_t<decltype(column)>::Value;
        auto const values = array_of(backend, unpack<T>(bytes, rows.size()));
        backend.for_each(rows.size(), PutValues<T>{values.data(), rows_there.data(), column.data()});
    }
}

/// Called when particles have left and come.
template <class Contents, class Backend>
void end_exchange(Contents& to, Backend const& backend)
{
    to.places = to.cells.size();
    to.resize_buffers(backend, to.places);
    to.buffer[1].resize_like(to.buffer[0]); // a step has begun
}

/// Lets particles leave for other ranks and come from them. `arrive(notes, first, move)` sorts those that
/// came into the order: they lie at `first` and behind it, and `move(from, to)` moves particles by their
/// places.
template <class Contents, class Backend, class Departures, class Arrive>
void exchange_particles(Contents& to, Backend const& backend, Departures const& departures,
                        Arrive const& arrive)
{
    auto& buffer = to.buffer[0];
    std::vector<std::vector<std::byte>> parcels;
    for (auto const& departure : departures) parcels.push_back(pack_particles(to, backend, departure));
    parcels[static_cast<std::size_t>(backend.rank())].clear(); // nothing stays by leaving
    auto const came = backend.exchange(parcels);

    std::size_t const first = to.places;
    std::size_t place = first;
    for (auto const& parcel : came)
        if (!parcel.empty()) {
            std::span<std::byte const> bytes(parcel);
            place += static_cast<std::size_t>(unpack<std::uint64_t>(bytes, 1)[0]);
        }
    for_each_array(buffer, [&](auto& array) { array.resize(place, first); });
    std::vector<std::vector<std::byte>> notes(came.size());
    place = first;
    for (std::size_t rank = 0; rank < came.size(); ++rank) {
        if (came[rank].empty()) continue;
        std::span<std::byte const> bytes(came[rank]);
        auto const head = unpack<std::uint64_t>(bytes, 2);
        auto const count = static_cast<std::size_t>(head[0]);
        notes[rank] = unpack<std::byte>(bytes, static_cast<std::size_t>(head[1]));
        for_each_array(buffer, [&]<class Array>(Array& array) {
            array.upload(place, unpack<typename Array::Value>(bytes, count));
        });
        if (sends_cached(to) && count > 0) {
            std::vector<std::uint32_t> rows(count);
            buffer.id.download(place, rows);
            put_rows(to.gathered.values(), backend, rows, bytes);
        }
        place += count;
    }
    arrive(notes, static_cast<std::uint32_t>(first), [&](auto const& from, auto const& behind) {
        if (from.empty()) return;
        auto const from_there = array_of(backend, from), to_there = array_of(backend, behind);
        for_each_array(buffer, [&]<class Array>(Array& array) {
            backend.for_each(from.size(), MoveValues<typename Array::Value>{array.data(), from_there.data(),
                                                                            to_there.data()});
        });
    });
    end_exchange(to, backend);
}

/// Makes room in all arrays for particles that come from other ranks behind the first ones, where they may
/// lie already. Where an array has to grow it grows by a sixteenth more: all ranks wait while one allocates,
/// and a rank has hardly more than that beyond its share before space is divided anew. There is also room for
/// as many as may come in the next step.
template <class Contents>
void make_room_for_coming(Contents& to, std::size_t first, std::size_t coming)
{
    if (coming == 0) return;
    std::size_t const places = first + coming, then = places + coming / 4 + 64;
    auto const make_room = [&](auto& array, bool keeps) {
        auto const has_room = [&](std::size_t count) {
            return count * sizeof(*array.data()) <= array.memory();
        };
        std::size_t const kept = !keeps ? 0 : has_room(places) ? places : first;
        array.resize(has_room(places) ? places : array.size(), kept);
        if (!has_room(then)) array.resize(then + then / 16, kept);
        array.resize(places, kept);
    };
    for_each_array(to.buffer[0], [&](auto& array) { make_room(array, true); });
    for_each_array(to.buffer[1], [&](auto& array) { make_room(array, false); });
}

/// The arrays of particles that travel from device to device with them.
template <class Contents, int buffer = 0>
struct TravellingFields
{
    Contents& contents;

    template <class Use>
    void by_place(Use&& use) const
    {
        for_each_array(contents.buffer[buffer], use);
    }
    /// Those of fields that are cached: their rows are found by ids.
    template <class Use>
    void by_id(Use&& use) const
    {
        if (!sends_cached(contents)) return;
        auto& cached = contents.gathered.values();
        for (std::size_t c = 0; c < cached.columns(); ++c) use(cached.column(static_cast<int>(c)));
    }
    auto& ids() const { return contents.buffer[0].id; }
};

/// Called when a step has been queued: what particles have in the next buffer travels, if they change their
/// rank in it; unless more does, which it writes beside that.
template <class Contents>
void tell_what_travels(Contents& contents, bool wrote_derived)
{
    if (wrote_derived)
        contents.cells.will_not_swap();
    else
        contents.cells.will_swap(TravellingFields<Contents, 1>{contents});
}

/// Lets particles lie at the first places of their arrays again, which rebin_over_ranks() may have left to
/// do.
template <class Contents>
void fill_holes_of_ranks(Contents& contents)
{
    if constexpr (requires { contents.cells.fill_holes(TravellingFields<Contents>{contents}); })
        contents.cells.fill_holes(TravellingFields<Contents>{contents});
}

/// ParticleTable::begin_sort() where particles may leave for other ranks, and come from them.
template <class Contents, class Backend>
void rebin_over_ranks(Contents& to, Backend const& backend)
{
    auto const offset = [&] { return to.buffer[0].view().offset; }; // arrays grow
    if constexpr (Backend::shares_results) {
        std::size_t const first = to.places;
        make_room_for_coming(to, first, to.cells.coming());
        to.cells.swap_items(static_cast<std::uint32_t>(first), offset(), TravellingFields<Contents>{to});
        end_exchange(to, backend);
    }
    else
        exchange_particles(to, backend, to.cells.depart(offset()),
                           [&](auto const& notes, std::uint32_t first, auto const& move) {
                               to.cells.arrive(notes, first, offset(), move);
                           });
}

/// Hands particles over to other ranks where these have come to have very different shares. All particles
/// are sorted, and have scattered to the grid; what they scattered goes with them.
template <class Sets, class Grid, class Backend>
void balance_ranks(Sets& sets, Grid& grid, Backend const& backend)
{
    if (!backend.divides_anew(sets.orders())) return;
    Sets::for_each([&](auto k) {
        auto& table = sets.template particles<k>();
        table.finish_sort();
        auto& to = table.contents();
        using Contents = std::remove_reference_t<decltype(to)>;
        auto const layer = grid.layer(k);
        table.change([&] {
            if constexpr (Backend::shares_results) {
                std::size_t const first = to.places;
                to.cells.prepare_to_swap_blocks();
                make_room_for_coming(to, first, to.cells.coming());
                to.cells.swap_blocks(static_cast<std::uint32_t>(first), layer,
                                     TravellingFields<Contents>{to});
                end_exchange(to, backend);
            }
            else
                exchange_particles(to, backend, to.cells.hand_over(layer),
                                   [&](auto const& notes, std::uint32_t first, auto const& move) {
                                       to.cells.take_over(notes, first, layer, move);
                                   });
        });
    });
    grid.activate(sets.orders());
    Sets::for_each([&](auto k) { sets.template particles<k>().cells().take_tiles(grid.layer(k)); });
}

} // namespace firn::detail

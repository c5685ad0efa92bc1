// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/copy_elements.hpp>
#include <firn/cuda/pack_strays.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/exchange_on_cuda.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <type_traits>
#include <vector>

namespace firn::distributed
{

/// Copies elements of many arrays in few loops.
class CopyOfArrays
{
public:
    CopyOfArrays(cuda::Queue const& queue, cuda::detail::CopiedPlaces const& places)
        : queue_(queue), places_(places)
    {}
    template <class T>
    void add(T const* from, T* to, std::size_t each = 1)
    {
        arrays_.of[count_++] = {reinterpret_cast<unsigned char const*>(from),
                                reinterpret_cast<unsigned char*>(to),
                                static_cast<std::uint32_t>(each * sizeof(T))};
        if (count_ == cuda::detail::CopiedArrays::most) start();
    }
    /// Queues what has been added; it also calls `also(i)` for the number of each element.
    template <class Also = cuda::detail::NothingAlso>
    void start(Also const& also = {})
    {
        unsigned const groups = cuda::groups_of(places_.most, 256),
                       parts = count_ + (std::is_same_v<Also, cuda::detail::NothingAlso> ? 0 : 1);
        if (parts > 0 && groups > 0)
            cuda::launch_after("copy_elements", queue_, cuda::detail::copy_elements<Also>, groups * parts,
                               256, arrays_, places_, groups, count_, also);
        count_ = 0;
    }

private:
    cuda::Queue queue_;
    cuda::detail::CopiedPlaces places_;
    cuda::detail::CopiedArrays arrays_{};
    unsigned count_ = 0;
};

/// Swaps the items that leave for other ranks' devices and come from there, without the host. A message has,
/// for all of its items, what their new cells must know, then what they scatter, then one array behind the
/// other.
///
/// `Fields` has by_place(use), which calls `use(array)` with each array of the items, and by_id(use) with
/// each array whose elements are found by ids() of the items.
template <class Number, int d>
class SwapOfItems
{
    using Stray = cuda::detail::Stray;

public:
    /// An array of items that travel.
    struct TravellingArray
    {
        unsigned char* elements;
        std::size_t bytes; ///< of an element
    };

    explicit SwapOfItems(cuda::Queue const& queue)
        : queue_(queue), begins_(queue), blocks_(queue), rows_(queue), begins_there_(queue), gone_(queue),
          packed_gone_(queue), sorted_(queue), out_(queue), in_(queue), is_gone_(queue), holes_(queue),
          place_(queue), from_(queue), to_(queue), messages_here_(queue), messages_(queue), exchange_(queue)
    {}

    /// Sends so many `strays` to each rank, and receives what comes: see came().
    template <class C, class Fields>
    void operator()(C const& communicator, cuda::Array<Stray> const& strays, std::uint32_t const* owners,
                    cuda::detail::Leavers<Number> const& leavers, std::vector<std::uint32_t> const& leaving,
                    std::vector<std::uint32_t> const& coming, Fields const& fields)
    {
        list(strays, owners, leaving);
        channels_ = static_cast<std::size_t>(leavers.channels);
        std::vector<DeviceMessage> to, from;
        add_messages(to, out_, leaving, fields);
        add_messages(from, in_, coming, fields);
        std::uint32_t begin = 0;
        for (auto const& message : to) {
            std::uint32_t const count = leaving[static_cast<std::size_t>(message.rank)];
            pack({begin, count}, message.data, leavers, fields);
            begin += count;
        }
        exchange_(communicator, to, from);
        came_ = from;
        room_of_came_ = coming;
    }

    /// Queues packing of strays that have just been found, before the host knows how many there are: their
    /// `arrays`, and messages that have room for so many items by rank, which are added to others. Those that
    /// come are unpacked as if they had been swapped later.
    void pack_early(cuda::Array<Stray> const& strays, std::uint32_t const* count, std::uint32_t const* owners,
                    cuda::detail::Leavers<Number> const& leavers, std::vector<TravellingArray> const& arrays,
                    std::vector<std::uint32_t> const& room_out, std::vector<std::uint32_t> const& room_in,
                    std::vector<DeviceMessage>& to, std::vector<DeviceMessage>& from)
    {
        using cuda::detail::MessageOfItems, cuda::detail::PackedArrays;
        channels_ = static_cast<std::size_t>(leavers.channels);
        auto const [packed, parts, bytes] = parts_of_items(leavers, arrays);
        std::vector<MessageOfItems> messages;
        auto const add_messages = [&](cuda::Array<std::byte>& buffer, std::vector<std::uint32_t> const& rooms,
                                      std::vector<DeviceMessage>& all, bool goes) {
            std::size_t const items = std::accumulate(rooms.begin(), rooms.end(), std::size_t{0});
            buffer.renew_amply(items * bytes);
            auto* next = buffer.data();
            for (std::size_t rank = 0; rank < rooms.size(); ++rank) {
                std::size_t const of_message = rooms[rank] * bytes;
                if (goes) messages.push_back({next, rooms[rank]});
                if (of_message > 0) all.push_back({static_cast<int>(rank), next, of_message});
                next += of_message;
            }
            return static_cast<std::uint32_t>(items);
        };
        std::size_t const before = from.size();
        add_messages(in_, room_in, from, false);
        came_.assign(from.begin() + static_cast<std::ptrdiff_t>(before), from.end());
        room_of_came_ = room_in;
        std::uint32_t const items = add_messages(out_, room_out, to, true);
        if (items == 0) return;
        packed_gone_.renew_amply(items);
        auto const is_told = std::ranges::equal(messages, told_, [](auto const& a, auto const& b) {
            return a.data == b.data && a.room == b.room;
        });
        if (!is_told) {
            told_ = messages;
            auto* const here = messages_here_.template as<MessageOfItems>(messages.size());
            std::ranges::copy(messages, here); // the host has waited since they were copied last
            messages_.renew_amply(messages.size());
            cuda::copy_queued(queue_, messages_.data(), static_cast<MessageOfItems const*>(here),
                              messages.size());
        }
        unsigned const groups = cuda::groups_of(items, 256);
        cuda::launch_after("pack_strays", queue_, cuda::detail::pack_strays<d, Number>, groups * (1 + parts),
                           256,
                           cuda::detail::StraysToPack{strays.data(), count, owners, messages_.data(),
                                                      packed_gone_.data(), items},
                           packed, groups);
    }
    /// Queues that what has come so is taken in, from `place` on, unless `are_left` is not 0; see unpack().
    void take_in_early(std::uint32_t const* are_left, cuda::detail::ToldOfStrays const& told,
                       std::uint32_t place, std::vector<TravellingArray> const& arrays,
                       cuda::detail::LeaversOfDevices<Number> const& leavers, std::uint64_t* origins,
                       cuda::detail::Changes const& changes) const
    {
        auto const [packed, parts, bytes] = parts_of_items(leavers, arrays);
        for (auto const& message : came_) {
            std::uint32_t const room = room_of_came_[static_cast<std::size_t>(message.rank)];
            unsigned const groups = cuda::groups_of(room, 256);
            cuda::launch_after("take_in", queue_, cuda::detail::take_in<Number>, groups * (1 + parts), 256,
                               are_left, told, static_cast<std::uint32_t>(message.rank),
                               cuda::detail::MessageOfItems{message.data, room}, leavers, changes, origins,
                               place, packed, groups);
        }
    }
    /// Whether so many arrays of items can be packed so.
    static constexpr bool has_room_for(std::size_t arrays)
    {
        return arrays < cuda::detail::PackedArrays::most;
    }

    /// What is known of the items of whole blocks.
    struct Items
    {
        std::uint32_t const* begin; ///< of each cell's items, in the order
        std::uint32_t const* order; ///< null: they lie at their slots
        std::uint32_t* block_stay;  ///< per block: how many stay, which is none where they leave
    };
    /// The same for all items of blocks: `blocks[r]` go to rank r, and each block has so many `items`. These
    /// scatter nothing. `beside` has messages of its own, which travel with them.
    template <class C, class Fields, class Beside>
    void operator()(C const& communicator, Items const& of,
                    std::vector<std::vector<std::uint32_t>> const& blocks,
                    std::vector<std::uint32_t> const& items, std::vector<std::uint32_t> const& leaving,
                    std::vector<std::uint32_t> const& coming, Fields const& fields, Beside& beside)
    {
        channels_ = 0;
        std::vector<DeviceMessage> to, from;
        add_messages(to, out_, leaving, fields);
        add_messages(from, in_, coming, fields);
        std::vector<cuda::detail::BlockOfItems> list;
        std::uint32_t gone = 0;
        for (auto const& of_rank : blocks)
            for (auto const block : of_rank) {
                list.push_back({block, gone});
                gone += items[block];
            }
        gone_.renew_amply(gone);
        blocks_.renew_amply(list.size());
        blocks_.upload(0, list);
        std::size_t message = 0, begin = 0;
        std::uint32_t before = 0;
        for (std::size_t rank = 0; rank < blocks.size(); ++rank) {
            auto const count = static_cast<unsigned>(blocks[rank].size());
            if (count == 0) continue;
            bool const is_sent = leaving[rank] > 0; // else all of the blocks are empty
            Sections next{is_sent ? to[message++].data : nullptr, leaving[rank]};
            auto* const origins = next.template take<std::uint64_t>();
            cuda::launch_after("list_items_of_blocks", queue_, cuda::detail::list_items_of_blocks, count, 64,
                               blocks_.data() + begin, of.begin, of.order, before, gone_.data(), origins,
                               next.template take<std::uint32_t>(), of.block_stay);
            begin += count;
            if (is_sent) pack_fields({before, leaving[rank]}, next, fields);
            before += leaving[rank];
        }
        came_ = from;
        room_of_came_ = coming;
        beside.add_messages(to, from);
        exchange_(communicator, to, from);
    }

    /// Called when the step in which strays were packed has succeeded.
    void accept_packed() { gone_.swap(packed_gone_); }
    /// Forgets what has come.
    void forget() { came_.clear(); }
    /// Copies what has come to its arrays, from `place` on, and lets it into its cells: it is listed among
    /// `leavers`, and `origins` are of what has come.
    template <class Fields>
    void unpack(std::vector<std::uint32_t> const& coming, std::uint32_t place, Fields const& fields,
                cuda::detail::LeaversOfDevices<Number> const& leavers, std::uint64_t* origins,
                cuda::detail::Changes const& changes)
    {
        std::uint32_t before = 0;
        for (auto const& message : came_) {
            auto const rank = static_cast<std::size_t>(message.rank);
            std::uint32_t const count = coming[rank];
            Sections next{message.data, room_of_came_[rank]};
            CopyOfArrays copy(queue_, {nullptr, nullptr, nullptr, count});
            auto const* const from = next.template take<std::uint64_t>();
            auto const* const cells = next.template take<std::uint32_t>();
            if (channels_ > 0)
                copy.add(next.template take<Number>(channels_),
                         leavers.contribution + (leavers.first + before) * channels_, channels_);
            fields.by_place([&]<class Array>(Array& array) {
                copy.add(next.template take<typename Array::Value>(), array.data() + place + before);
            });
            copy.start(
                cuda::detail::Admit<Number>{leavers, changes, from, cells, origins, before, place + before});
            CopyOfArrays by_id(queue_, {nullptr, fields.ids().data() + place + before, nullptr, count});
            fields.by_id([&]<class Array>(Array& array) {
                by_id.add(next.template take<typename Array::Value>(), array.data());
            });
            by_id.start();
            before += count;
        }
        came_.clear();
    }

    /// Lets the last of `all` items fill the places of those that have left: `count` are left. Calls
    /// `relocate(place)`: items that lay at `count + i` lie at `place[i]` then.
    template <class Fields, class Relocate>
    void fill_holes(std::uint32_t all, std::uint32_t count, Fields const& fields, Relocate const& relocate)
    {
        std::uint32_t const gone = all - count;
        if (gone == 0) return;
        for (auto* const array : {&holes_, &place_, &from_, &to_}) array->renew_amply(gone);
        is_gone_.renew_amply(gone + 2);
        is_gone_.fill_bytes(0, gone + 2, 0);
        auto* const counts = is_gone_.data() + gone;
        unsigned const groups = cuda::groups_of(gone, 256);
        cuda::launch_after("find_holes", queue_, cuda::detail::find_holes, groups, 256, gone_.data(), gone,
                           count, is_gone_.data(), holes_.data(), counts);
        cuda::launch_after("fill_holes", queue_, cuda::detail::fill_holes, groups, 256, is_gone_.data(), gone,
                           count, holes_.data(), place_.data(), from_.data(), to_.data(), counts + 1);
        relocate(place_.data());
        CopyOfArrays copy(queue_, {from_.data(), to_.data(), counts + 1, gone});
        fields.by_place([&](auto& array) { copy.add(array.data(), array.data()); });
        copy.start();
    }

    std::size_t memory() const
    {
        std::size_t bytes = blocks_.memory() + rows_.memory() + begins_there_.memory() + gone_.memory() +
                            packed_gone_.memory() + sorted_.memory() + out_.memory() + in_.memory() +
                            messages_.memory();
        for (auto const* const array : {&is_gone_, &holes_, &place_, &from_, &to_}) bytes += array->memory();
        return bytes;
    }

private:
    /// Goes through the parts of a message, each of so many values that are aligned for any type.
    struct Sections
    {
        std::byte* next;
        std::size_t count;

        template <class T>
        T* take(std::size_t each = 1)
        {
            auto* const here = reinterpret_cast<T*>(next);
            next += bytes<T>(each);
            return here;
        }
        template <class T>
        std::size_t bytes(std::size_t each = 1) const
        {
            constexpr std::size_t alignment = 16;
            return (count * each * sizeof(T) + alignment - 1) / alignment * alignment;
        }
    };
    template <class Fields>
    std::size_t bytes_of(std::size_t count, Fields const& fields) const
    {
        if (count == 0) return 0;
        Sections const of{nullptr, count};
        std::size_t bytes = of.template bytes<std::uint64_t>() + of.template bytes<std::uint32_t>() +
                            of.template bytes<Number>(channels_);
        auto const add = [&]<class Array>(Array const&) {
            bytes += of.template bytes<typename Array::Value>();
        };
        fields.by_place(add);
        fields.by_id(add);
        return bytes;
    }

    /// Adds a message for each rank to which items leave, or from which they come: so many.
    template <class Fields>
    void add_messages(std::vector<DeviceMessage>& all, cuda::Array<std::byte>& buffer,
                      std::vector<std::uint32_t> const& counts, Fields const& fields) const
    {
        std::size_t bytes = 0;
        for (auto const count : counts) bytes += bytes_of(count, fields);
        buffer.renew_amply(bytes);
        auto* next = buffer.data();
        for (std::size_t rank = 0; rank < counts.size(); ++rank)
            if (counts[rank] > 0) {
                all.push_back({static_cast<int>(rank), next, bytes_of(counts[rank], fields)});
                next += all.back().bytes;
            }
    }

    struct PartsOfItems
    {
        cuda::detail::PackedArrays arrays{};
        unsigned count = 0;
        std::size_t bytes = sizeof(std::uint64_t) + sizeof(std::uint32_t); ///< of an item
    };
    /// The parts of messages that are packed early, behind the first two: what items scatter, and their
    /// arrays.
    PartsOfItems parts_of_items(cuda::detail::Leavers<Number> const& leavers,
                                std::vector<TravellingArray> const& arrays) const
    {
        PartsOfItems parts;
        auto const add = [&](unsigned char* elements, std::size_t of_element) {
            parts.arrays.of[parts.count++] = {elements, static_cast<std::uint32_t>(of_element),
                                              static_cast<std::uint32_t>(parts.bytes)};
            parts.bytes += of_element;
        };
        add(reinterpret_cast<unsigned char*>(leavers.contribution), channels_ * sizeof(Number));
        for (auto const& array : arrays) add(array.elements, array.bytes);
        return parts;
    }

    /// Some of the strays that are listed.
    struct Range
    {
        std::uint32_t begin, count;
    };

    /// Lists strays rank by rank.
    void list(cuda::Array<Stray> const& strays, std::uint32_t const* owners,
              std::vector<std::uint32_t> const& leaving)
    {
        // the host has waited since it was copied last
        auto* const begins = begins_.template as<std::uint32_t>(leaving.size());
        std::exclusive_scan(leaving.begin(), leaving.end(), begins, std::uint32_t{0});
        std::uint32_t const count = begins[leaving.size() - 1] + leaving.back();
        if (count == 0) return;
        begins_there_.renew_amply(leaving.size());
        cuda::copy_queued(queue_, begins_there_.data(), static_cast<std::uint32_t const*>(begins),
                          leaving.size());
        sorted_.renew_amply(count);
        gone_.renew_amply(count);
        cuda::launch_after("list_by_rank", queue_, cuda::detail::list_by_rank, cuda::groups_of(count, 256),
                           256, strays.data(), count, owners, begins_there_.data(), sorted_.data(),
                           gone_.data());
    }
    template <class Fields>
    void pack(Range const& range, std::byte* to, cuda::detail::Leavers<Number> const& leavers,
              Fields const& fields)
    {
        Sections next{to, range.count};
        unsigned const groups = cuda::groups_of(range.count, 256);
        auto* const origins = next.template take<std::uint64_t>();
        auto* const cells = next.template take<std::uint32_t>();
        cuda::launch_after("note_strays", queue_, cuda::detail::note_strays<d, Number>, groups, 256,
                           sorted_.data() + range.begin, range.count, leavers, origins, cells,
                           next.template take<Number>(channels_));
        pack_fields(range, next, fields);
    }
    template <class Fields>
    void pack_fields(Range const& range, Sections next, Fields const& fields)
    {
        CopyOfArrays copy(queue_, {gone_.data() + range.begin, nullptr, nullptr, range.count});
        fields.by_place([&]<class Array>(Array& array) {
            copy.add(array.data(), next.template take<typename Array::Value>());
        });
        copy.start();
        bool are_any = false;
        fields.by_id([&](auto const&) { are_any = true; });
        if (!are_any) return;
        rows_.renew_amply(range.count);
        copy.add(fields.ids().data(), rows_.data());
        copy.start();
        CopyOfArrays by_id(queue_, {rows_.data(), nullptr, nullptr, range.count});
        fields.by_id([&]<class Array>(Array& array) {
            by_id.add(array.data(), next.template take<typename Array::Value>());
        });
        by_id.start();
    }

    cuda::Queue queue_;
    std::size_t channels_ = 0;
    cuda::HostMemory begins_;
    cuda::Array<cuda::detail::BlockOfItems> blocks_;
    cuda::Array<std::uint32_t> rows_, begins_there_;
    cuda::Array<std::uint32_t> gone_,
        packed_gone_; ///< where those lie that leave, or will if a step succeeds
    cuda::Array<Stray> sorted_;
    cuda::Array<std::byte> out_, in_;
    cuda::Array<std::uint32_t> is_gone_, holes_, place_, from_, to_; ///< is_gone: two counts are behind it
    std::vector<DeviceMessage> came_;
    std::vector<std::uint32_t> room_of_came_; ///< by rank: for so many items
    cuda::HostMemory messages_here_;          ///< on the way to the device
    cuda::Array<cuda::detail::MessageOfItems> messages_;
    std::vector<cuda::detail::MessageOfItems> told_; ///< the same
    DeviceExchange exchange_;
};

} // namespace firn::distributed

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/distributed/communicator.hpp>

#include <cstddef>
#include <cstring>
#include <span>
#include <vector>

namespace firn::distributed
{

/// Lets ranks swap parts of their devices' memory, behind what is queued: see DeviceCommunicator.
class DeviceExchange
{
public:
    explicit DeviceExchange(cuda::Queue const& queue) : queue_(queue), out_(queue), in_(queue) {}

    /// Whether a communicator does so without the host, and in any stream.
    template <class C>
    static constexpr bool is_on_device = DeviceCommunicator<C, cudaStream_t>;

    template <class C>
    void operator()(C const& communicator, std::span<DeviceMessage const> to,
                    std::span<DeviceMessage const> from)
    {
        in(queue_, communicator, to, from);
    }
    /// The same in another queue of the device; if the host takes part, in its own.
    template <class C>
    void in(cuda::Queue const& queue, C const& communicator, std::span<DeviceMessage const> to,
            std::span<DeviceMessage const> from)
    {
        if constexpr (is_on_device<C>) {
            cuda::OnDevice const here(queue);
            communicator.exchange_on_device(queue.stream, to, from);
        }
        else
            by_host(communicator, to, from);
    }

    /// Lets each rank have what all of them have, as many bytes of each, one rank's behind the other's.
    /// Beside that they may swap messages, if the communicator does so without the host: `are_swapped` says
    /// on all ranks whether some do so, since those without messages take part, too.
    template <class C>
    void gather(C const& communicator, unsigned char const* own, std::size_t bytes, unsigned char* all,
                bool are_swapped = false, std::span<DeviceMessage const> to = {},
                std::span<DeviceMessage const> from = {})
    {
        if constexpr (is_on_device<C>) {
            cuda::OnDevice const here(queue_);
            cudaStream_t const stream = queue_.stream;
            if constexpr (requires { communicator.gather_beside(stream, own, bytes, all, to, from); })
                communicator.gather_beside(stream, own, bytes, all, to, from);
            else {
                communicator.gather_on_device(stream, own, bytes, all);
                if (are_swapped) communicator.exchange_on_device(stream, to, from);
            }
        }
        else {
            auto* const out = out_.as<unsigned char>(bytes);
            cuda::copy_queued(queue_, out, own, bytes);
            queue_.wait();
            Parcel parcel(bytes);
            std::memcpy(parcel.data(), out, bytes);
            auto const came = communicator.all_gather(parcel);
            auto* const in = in_.as<unsigned char>(bytes * came.size());
            for (std::size_t rank = 0; rank < came.size(); ++rank)
                std::memcpy(in + rank * bytes, came[rank].data(), bytes);
            cuda::copy_queued(queue_, all, static_cast<unsigned char const*>(in), bytes * came.size());
        }
    }

private:
    template <class C>
    void by_host(C const& communicator, std::span<DeviceMessage const> to,
                 std::span<DeviceMessage const> from)
    {
        std::byte* out = out_.as<std::byte>(bytes_of(to));
        for (auto const& message : to) {
            cuda::copy_queued(queue_, out, message.data, message.bytes);
            out += message.bytes;
        }
        queue_.wait();
        std::vector<Parcel> parcels(static_cast<std::size_t>(communicator.size()));
        std::byte const* next = out_.get<std::byte>();
        for (auto const& message : to) {
            auto& parcel = parcels[static_cast<std::size_t>(message.rank)];
            parcel.insert(parcel.end(), next, next + message.bytes);
            next += message.bytes;
        }
        auto const came = communicator.exchange(parcels);
        std::vector<std::size_t> read(came.size(), 0);
        std::byte* in = in_.as<std::byte>(bytes_of(from));
        for (auto const& message : from) {
            auto const rank = static_cast<std::size_t>(message.rank);
            std::memcpy(in, came[rank].data() + read[rank], message.bytes);
            read[rank] += message.bytes;
            cuda::copy_queued(queue_, message.data, in, message.bytes);
            in += message.bytes;
        }
    }

    static std::size_t bytes_of(std::span<DeviceMessage const> messages)
    {
        std::size_t bytes = 0;
        for (auto const& message : messages) bytes += message.bytes;
        return bytes;
    }

    cuda::Queue queue_;
    cuda::HostMemory out_, in_;
};

} // namespace firn::distributed

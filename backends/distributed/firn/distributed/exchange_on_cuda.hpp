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

    template <class C>
    void operator()(C const& communicator, std::span<DeviceMessage const> to,
                    std::span<DeviceMessage const> from)
    {
        if constexpr (DeviceCommunicator<C, cudaStream_t>) {
            cuda::OnDevice const here(queue_);
            communicator.exchange_on_device(queue_.stream, to, from);
        }
        else
            by_host(communicator, to, from);
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

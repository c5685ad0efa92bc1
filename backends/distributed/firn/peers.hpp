// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/cuda/check.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/copies_on_cuda.hpp>
#include <firn/distributed/rank_threads.hpp>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace firn
{

/// A communicator of ranks that are threads of one process, and whose devices copy from one another's memory,
/// behind what is in the solver's stream. What the host has to say goes by RankThreads:
///
///     run_ranks(devices, [](RankThreads const& threads) {
///         Peers const communicator(threads, threads.rank());
///         Distributed<Cuda, Peers> const backend{{.device = communicator.device()}, communicator};
///     });
///
/// Several ranks may have the same device. From then on devices reach each other's memory wherever they can,
/// see is_direct(); where they cannot, the driver copies by way of the host's memory.
///
/// Threads meet while they queue a copy. So no device ever waits for one whose rank has ended by an error,
/// and the other ranks throw as they do with RankThreads.
///
/// All ranks make it at the same time. Throws an Error if there is no such device, or if it fails.
class Peers
{
public:
    Peers(RankThreads threads, int device) : threads_(std::move(threads))
    {
        cuda::OnDevice const here(device);
        auto const own = std::make_shared<Side>(device);
        threads_.show(own, [&](auto const& of) {
            for (int rank = 0; rank < size(); ++rank) sides_.push_back(of(rank));
        });
        for (auto const& side : sides_) is_direct_ = reach(side->device) && is_direct_;
    }

    int rank() const { return threads_.rank(); }
    int size() const { return threads_.size(); }
    int device() const { return own().device; } ///< of this rank
    /// Whether this device reaches the memory of all others, so that copies do not go through the host's.
    bool is_direct() const { return is_direct_; }
    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const { return threads_.exchange(to); }
    std::vector<Parcel> all_gather(Parcel const& own) const { return threads_.all_gather(own); }
    void abort(char const* why) const { threads_.abort(why); }

    /// See DeviceCommunicator.
    void exchange_on_device(cudaStream_t stream, std::span<DeviceMessage const> to,
                            std::span<DeviceMessage const> from) const
    {
        copy(stream, to, from);
    }
    void gather_on_device(cudaStream_t stream, void const* own, std::size_t bytes, void* all) const
    {
        // a device that copies from it only reads
        DeviceMessage const sent{all_ranks, static_cast<std::byte*>(const_cast<void*>(own)), bytes};
        std::vector<DeviceMessage> from;
        for (int rank = 0; rank < size(); ++rank)
            from.push_back(
                {rank, static_cast<std::byte*>(all) + static_cast<std::size_t>(rank) * bytes, bytes});
        copy(stream, {&sent, 1}, from);
    }

private:
    static constexpr int all_ranks = -1; ///< in a message: to each of them

    /// What a rank has on its device. Copies that the driver makes have a stream of their own: one between
    /// devices in the default stream would wait for all that both have begun.
    struct Side
    {
        int device;
        cudaStream_t stream = nullptr;
        cudaEvent_t ready = nullptr;  ///< when what it sends is there, and what comes may be overwritten
        cudaEvent_t copied = nullptr; ///< when it has copied what came

        explicit Side(int of) : device(of)
        {
            int least = 0, greatest = 0;
            cuda::check(cudaDeviceGetStreamPriorityRange(&least, &greatest),
                        "cudaDeviceGetStreamPriorityRange");
            cuda::check(cudaStreamCreateWithPriority(&stream, cudaStreamNonBlocking, greatest),
                        "cudaStreamCreateWithPriority");
            for (auto* const event : {&ready, &copied})
                cuda::check(cudaEventCreateWithFlags(event, cudaEventDisableTiming),
                            "cudaEventCreateWithFlags");
        }
        ~Side()
        {
            int before = 0; // this may be the end of an error of the device: nothing is checked
            static_cast<void>(cudaGetDevice(&before));
            static_cast<void>(cudaSetDevice(device));
            for (auto const event : {ready, copied})
                if (event) static_cast<void>(cudaEventDestroy(event));
            if (stream) static_cast<void>(cudaStreamDestroy(stream));
            static_cast<void>(cudaSetDevice(before));
        }
        Side(Side const&) = delete;
        Side& operator=(Side const&) = delete;
    };

    Side const& own() const { return side_of(rank()); }
    Side const& side_of(int rank) const { return *sides_[static_cast<std::size_t>(rank)]; }

    /// Lets the current device, which is this rank's, reach the memory of another one; whether it does.
    bool reach(int other) const
    {
        if (other == device()) return true;
        int can = 0;
        cuda::check(cudaDeviceCanAccessPeer(&can, device(), other), "cudaDeviceCanAccessPeer");
        if (can == 0) return false;
        cudaError_t const status = cudaDeviceEnablePeerAccess(other, 0);
        if (status == cudaErrorPeerAccessAlreadyEnabled || status == cudaErrorTooManyPeers)
            static_cast<void>(cudaGetLastError()); // or the next call would report it
        else
            cuda::check(status, "cudaDeviceEnablePeerAccess");
        return status != cudaErrorTooManyPeers;
    }

    static void wait_for(cudaEvent_t event, cudaStream_t stream)
    {
        cuda::check(cudaStreamWaitEvent(stream, event, 0), "cudaStreamWaitEvent");
    }

    /// Queues copies of what others send to here, and lets the stream go on when they are there and when the
    /// others have copied what this rank sends.
    void copy(cudaStream_t stream, std::span<DeviceMessage const> to,
              std::span<DeviceMessage const> from) const
    {
        bool const takes_part = !to.empty() || !from.empty();
        if (!takes_part && size() == 1) return;
        cuda::Queue const copies{device(), is_direct_ ? stream : own().stream};
        if (takes_part) cuda::check(cudaEventRecord(own().ready, stream), "cudaEventRecord");
        threads_.show(to, [&](auto const& of) {
            if (!takes_part) return;
            if (!is_direct_) wait_for(own().ready, copies.stream);
            distributed::CopiesOnDevice loop(copies);
            for (int k = 1; k <= size(); ++k) { // each begins with another one
                int const other = (rank() + k) % size();
                copy_from(other, of(other), from, copies, loop);
            }
            loop.start();
            cuda::check(cudaEventRecord(own().copied, copies.stream), "cudaEventRecord");
        });
        if (takes_part && !is_direct_) wait_for(own().copied, stream);
        for (int other = 0; other < size(); ++other)
            if (other != rank() && std::ranges::any_of(to, [&](auto const& message) {
                    return message.rank == other || message.rank == all_ranks;
                }))
                wait_for(side_of(other).copied, stream);
    }

    void copy_from(int other, std::span<DeviceMessage const> sent, std::span<DeviceMessage const> from,
                   cuda::Queue const& copies, distributed::CopiesOnDevice& loop) const
    {
        auto next = sent.begin();
        bool waits = other != rank();
        for (auto const& message : from) {
            if (message.rank != other) continue;
            next = std::find_if(next, sent.end(),
                                [&](auto const& one) { return one.rank == rank() || one.rank == all_ranks; });
            require(next != sent.end() && next->bytes == message.bytes,
                    "a rank does not send what another one expects", "Peers",
                    "Run the same program on all ranks.");
            if (std::exchange(waits, false)) wait_for(side_of(other).ready, copies.stream);
            if (is_direct_)
                loop.add(message.data, next->data, message.bytes);
            else // addresses say on which devices they are
                cuda::check(cudaMemcpyAsync(message.data, next->data, message.bytes, cudaMemcpyDeviceToDevice,
                                            copies.stream),
                            "cudaMemcpyAsync");
            ++next;
        }
    }

    RankThreads threads_;
    std::vector<std::shared_ptr<Side>> sides_; ///< by rank: one that has ended may still be waited for
    bool is_direct_ = true;
};

} // namespace firn

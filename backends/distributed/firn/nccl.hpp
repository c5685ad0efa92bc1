// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/cuda/check.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/parcel.hpp>

#include <nccl.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// A communicator whose ranks have a device each, and whose devices send to one another by NCCL, in the
/// solver's stream and without the host. What the host has to say goes by another communicator, such as Mpi
/// between processes or RankThreads within one, which also starts NCCL:
///
///     Nccl const communicator(Mpi(), device);
///     Distributed<Cuda, Nccl<Mpi>> const backend{{.device = device}, communicator};
///
/// All ranks make it at the same time. Throws an Error if two ranks have one device, or if NCCL fails. Where
/// ranks are threads and one of them ends by an error, the messages that others wait for end too, and they
/// throw.
template <Communicator Host>
class Nccl
{
public:
    Nccl(Host host, int device) : host_(std::move(host)), device_(device)
    {
        cuda::OnDevice const here(device);
        require_device_each(device);
        ncclUniqueId id{};
        if (rank() == 0) check(ncclGetUniqueId(&id), "ncclGetUniqueId");
        Parcel parcel;
        distributed::put(parcel, id);
        distributed::Reader(host_.all_gather(parcel).front()).get(&id, 1);
        link_ = std::make_shared<Link>(device);
        check(ncclCommInitRank(&link_->comm, size(), id, rank()), "ncclCommInitRank");
        if constexpr (requires { host_.when_one_ends([] {}); })
            host_.when_one_ends([of = std::weak_ptr(link_)] {
                if (auto const link = of.lock()) link->abort();
            });
    }

    int rank() const { return host_.rank(); }
    int size() const { return host_.size(); }
    int device() const { return device_; } ///< of this rank
    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const { return host_.exchange(to); }
    std::vector<Parcel> all_gather(Parcel const& own) const { return host_.all_gather(own); }
    void abort(char const* why) const { host_.abort(why); }
    /// Throws an Error if a rank has ended: what came from it then is not what it sent.
    void require_all() const
    {
        if constexpr (requires { host_.require_all(); }) host_.require_all();
    }

    /// See DeviceCommunicator.
    void exchange_on_device(cudaStream_t stream, std::span<DeviceMessage const> to,
                            std::span<DeviceMessage const> from) const
    {
        if (to.empty() && from.empty()) return;
        std::unique_lock const lock = use();
        check(ncclGroupStart(), "ncclGroupStart");
        swap(stream, to, from);
        check(ncclGroupEnd(), "ncclGroupEnd");
    }
    void gather_on_device(cudaStream_t stream, void const* own, std::size_t bytes, void* all) const
    {
        std::unique_lock const lock = use();
        check(ncclAllGather(own, all, bytes, ncclChar, link_->comm, stream), "ncclAllGather");
    }
    /// Both at once, in one loop of NCCL.
    void gather_beside(cudaStream_t stream, void const* own, std::size_t bytes, void* all,
                       std::span<DeviceMessage const> to, std::span<DeviceMessage const> from) const
    {
        std::unique_lock const lock = use();
        check(ncclGroupStart(), "ncclGroupStart");
        check(ncclAllGather(own, all, bytes, ncclChar, link_->comm, stream), "ncclAllGather");
        swap(stream, to, from);
        check(ncclGroupEnd(), "ncclGroupEnd");
    }

private:
    void swap(cudaStream_t stream, std::span<DeviceMessage const> to,
              std::span<DeviceMessage const> from) const
    {
        for (auto const& message : to)
            check(ncclSend(message.data, message.bytes, ncclChar, message.rank, link_->comm, stream),
                  "ncclSend");
        for (auto const& message : from)
            check(ncclRecv(message.data, message.bytes, ncclChar, message.rank, link_->comm, stream),
                  "ncclRecv");
    }

    /// NCCL's communicator of this rank.
    struct Link
    {
        int device;
        ncclComm_t comm = nullptr;
        std::timed_mutex mutex;
        std::atomic<bool> is_aborted = false;

        explicit Link(int of) : device(of) {}
        Link(Link const&) = delete;
        Link& operator=(Link const&) = delete;
        ~Link()
        {
            // where an error ends the rank, the others are no longer waited for
            end(std::uncaught_exceptions() > 0 ? ncclCommAbort : ncclCommDestroy);
        }
        /// Ends its messages; called by any thread. If the rank is in a call of NCCL, which may wait for a
        /// rank that has ended, that is waited for only so long.
        void abort()
        {
            std::unique_lock const lock(mutex, std::chrono::seconds(2));
            is_aborted = true;
            end(ncclCommAbort);
        }

    private:
        void end(ncclResult_t (*how)(ncclComm_t))
        {
            if (ncclComm_t const one = std::exchange(comm, nullptr)) {
                int before = 0; // this may be the end of an error of the device: nothing is checked
                static_cast<void>(cudaGetDevice(&before));
                static_cast<void>(cudaSetDevice(device));
                static_cast<void>(how(one));
                static_cast<void>(cudaSetDevice(before));
            }
        }
    };
    /// For calls of NCCL. Throws an Error if it has been aborted.
    std::unique_lock<std::timed_mutex> use() const
    {
        std::unique_lock lock(link_->mutex);
        if (link_->is_aborted) {
            require_all();
            throw Error{"the messages of this rank have been ended", "NCCL",
                        "See the error of the rank that ended; go on from the last checkpoint."};
        }
        return lock;
    }

    /// Refuses ranks that share a device, which NCCL does not say in words.
    void require_device_each(int device) const
    {
        cudaDeviceProp about{};
        cuda::check(cudaGetDeviceProperties(&about, device), "cudaGetDeviceProperties");
        Parcel own;
        distributed::put(own, about.uuid);
        auto const all = host_.all_gather(own);
        for (std::size_t r = 0; r < all.size(); ++r)
            for (std::size_t other = 0; other < r; ++other)
                if (all[r] == all[other])
                    throw Error{"ranks " + std::to_string(other) + " and " + std::to_string(r) +
                                    " have the same device",
                                "Nccl",
                                "Give each rank a device of its own, or use the communicator without NCCL."};
    }

    static void check(ncclResult_t code, char const* call)
    {
        if (code == ncclSuccess) return;
        throw Error{std::string(call) + " failed: " + ncclGetErrorString(code), "NCCL",
                    "See what NCCL says with NCCL_DEBUG=WARN; go on from the last checkpoint."};
    }

    Host host_;
    int device_;
    std::shared_ptr<Link> link_;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/cuda/check.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/parcel.hpp>

#include <nccl.h>

#include <cstddef>
#include <cstdint>
#include <memory>
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
/// All ranks make it at the same time. Throws an Error if two ranks have one device, or if NCCL fails.
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
        ncclComm_t comm = nullptr;
        check(ncclCommInitRank(&comm, size(), id, rank()), "ncclCommInitRank");
        comm_ = {comm, [device](ncclComm_t one) {
                     cuda::OnDevice const there(device);
                     static_cast<void>(ncclCommDestroy(one));
                 }};
    }

    int rank() const { return host_.rank(); }
    int size() const { return host_.size(); }
    int device() const { return device_; } ///< of this rank
    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const { return host_.exchange(to); }
    std::vector<Parcel> all_gather(Parcel const& own) const { return host_.all_gather(own); }
    void abort(char const* why) const { host_.abort(why); }

    /// See DeviceCommunicator.
    void exchange_on_device(cudaStream_t stream, std::span<DeviceMessage const> to,
                            std::span<DeviceMessage const> from) const
    {
        if (to.empty() && from.empty()) return;
        check(ncclGroupStart(), "ncclGroupStart");
        for (auto const& message : to)
            check(ncclSend(message.data, message.bytes, ncclChar, message.rank, comm_.get(), stream),
                  "ncclSend");
        for (auto const& message : from)
            check(ncclRecv(message.data, message.bytes, ncclChar, message.rank, comm_.get(), stream),
                  "ncclRecv");
        check(ncclGroupEnd(), "ncclGroupEnd");
    }
    void gather_on_device(cudaStream_t stream, void const* own, std::size_t bytes, void* all) const
    {
        check(ncclAllGather(own, all, bytes, ncclChar, comm_.get(), stream), "ncclAllGather");
    }

private:
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
    std::shared_ptr<ncclComm> comm_;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/check.hpp>

#include <memory>

namespace firn::cuda
{

/// A stream beside that of a queue, for what may run while the queue's loops do.
class SideQueue
{
public:
    explicit SideQueue(Queue const& main) : main_(main) {}

    /// What is queued in the result runs behind what is in the main queue by now.
    Queue begin()
    {
        OnDevice const here(main_);
        if (!side_) side_ = std::make_shared<Side>(main_.device);
        check(cudaEventRecord(side_->begin, main_.stream), "cudaEventRecord");
        check(cudaStreamWaitEvent(side_->stream, side_->begin, 0), "cudaStreamWaitEvent");
        return {main_.device, side_->stream};
    }
    /// What is queued in the main queue from now on runs behind that.
    void end()
    {
        OnDevice const here(main_);
        check(cudaEventRecord(side_->end, side_->stream), "cudaEventRecord");
        check(cudaStreamWaitEvent(main_.stream, side_->end, 0), "cudaStreamWaitEvent");
    }

private:
    /// The stream goes first where groups of threads wait for room, since other devices wait for it.
    struct Side
    {
        int device;
        cudaStream_t stream = nullptr;
        cudaEvent_t begin = nullptr, end = nullptr;

        explicit Side(int of) : device(of)
        {
            int least = 0, greatest = 0;
            check(cudaDeviceGetStreamPriorityRange(&least, &greatest), "cudaDeviceGetStreamPriorityRange");
            check(cudaStreamCreateWithPriority(&stream, cudaStreamNonBlocking, greatest),
                  "cudaStreamCreateWithPriority");
            for (auto* const event : {&begin, &end})
                check(cudaEventCreateWithFlags(event, cudaEventDisableTiming), "cudaEventCreateWithFlags");
        }
        ~Side()
        {
            OnDevice const here(device);
            for (auto const event : {begin, end})
                if (event) static_cast<void>(cudaEventDestroy(event));
            if (stream) static_cast<void>(cudaStreamDestroy(stream));
        }
        Side(Side const&) = delete;
        Side& operator=(Side const&) = delete;
    };

    Queue main_;
    std::shared_ptr<Side> side_;
};

} // namespace firn::cuda

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/distributed.hpp>

#include <mpi.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// The communicator of ranks that are processes, by the Message Passing Interface. The program calls MPI_Init
/// before it makes one, and MPI_Finalize after all solvers with it are gone; the library does neither. It
/// works on a duplicate of the program's communicator, so that their messages never meet. One thread of a
/// rank calls it at a time: MPI_THREAD_FUNNELED is enough if that is the main thread.
class Mpi
{
public:
    explicit Mpi(MPI_Comm of = MPI_COMM_WORLD) : handle_(duplicate(of))
    {
        check(MPI_Comm_rank(comm(), &rank_), "MPI_Comm_rank");
        check(MPI_Comm_size(comm(), &size_), "MPI_Comm_size");
    }

    int rank() const { return rank_; }
    int size() const { return size_; }

    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const
    {
        std::vector<std::uint64_t> sizes(to.size()), coming(to.size());
        for (std::size_t r = 0; r < to.size(); ++r) sizes[r] = to[r].size();
        check(MPI_Alltoall(sizes.data(), 1, MPI_UINT64_T, coming.data(), 1, MPI_UINT64_T, comm()),
              "MPI_Alltoall");
        std::vector<Parcel> came(to.size());
        std::vector<MPI_Request> requests;
        for (std::size_t r = 0; r < to.size(); ++r) {
            if (r == static_cast<std::size_t>(rank_)) {
                came[r] = to[r];
                continue;
            }
            came[r].resize(coming[r]);
            for_each_piece(came[r].size(), [&](std::size_t first, int bytes) {
                requests.emplace_back();
                check(MPI_Irecv(came[r].data() + first, bytes, MPI_BYTE, static_cast<int>(r), tag, comm(),
                                &requests.back()),
                      "MPI_Irecv");
            });
        }
        for (std::size_t r = 0; r < to.size(); ++r)
            if (r != static_cast<std::size_t>(rank_))
                for_each_piece(to[r].size(), [&](std::size_t first, int bytes) {
                    requests.emplace_back();
                    check(MPI_Isend(to[r].data() + first, bytes, MPI_BYTE, static_cast<int>(r), tag, comm(),
                                    &requests.back()),
                          "MPI_Isend");
                });
        check(MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE),
              "MPI_Waitall");
        return came;
    }

    std::vector<Parcel> all_gather(Parcel const& own) const
    {
        auto const ranks = static_cast<std::size_t>(size_);
        std::vector<std::uint64_t> sizes(ranks);
        std::uint64_t const bytes = own.size();
        check(MPI_Allgather(&bytes, 1, MPI_UINT64_T, sizes.data(), 1, MPI_UINT64_T, comm()), "MPI_Allgather");
        std::uint64_t all = 0;
        for (auto const size : sizes) all += size;
        if (all > largest_piece) // counts of MPI are of type int
            return exchange(std::vector<Parcel>(ranks, own));
        std::vector<int> counts, begins;
        int begin = 0;
        for (auto const size : sizes) {
            counts.push_back(static_cast<int>(size));
            begins.push_back(begin);
            begin += static_cast<int>(size);
        }
        Parcel together(all);
        check(MPI_Allgatherv(own.data(), counts[static_cast<std::size_t>(rank_)], MPI_BYTE, together.data(),
                             counts.data(), begins.data(), MPI_BYTE, comm()),
              "MPI_Allgatherv");
        std::vector<Parcel> came;
        for (std::size_t r = 0; r < ranks; ++r)
            came.emplace_back(together.begin() + begins[r], together.begin() + begins[r] + counts[r]);
        return came;
    }

    /// Ends all processes of the program's communicator.
    void abort(char const*) const { MPI_Abort(comm(), 1); }

private:
    static constexpr int tag = 0;
    static constexpr std::size_t largest_piece = std::size_t{1} << 30; // bytes

    /// Calls `use(first byte, bytes)` for pieces whose sizes MPI can count.
    template <class Use>
    static void for_each_piece(std::size_t bytes, Use const& use)
    {
        for (std::size_t first = 0; first < bytes; first += largest_piece)
            use(first, static_cast<int>(std::min(largest_piece, bytes - first)));
    }

    static void check(int code, char const* call)
    {
        if (code == MPI_SUCCESS) return;
        char text[MPI_MAX_ERROR_STRING];
        int length = 0;
        if (MPI_Error_string(code, text, &length) != MPI_SUCCESS) length = 0;
        throw Error{"MPI failed: " + std::string(text, static_cast<std::size_t>(length)), call,
                    "Go on from the last checkpoint, in a new run."};
    }

    static std::shared_ptr<MPI_Comm> duplicate(MPI_Comm of)
    {
        int has_begun = 0, has_ended = 0;
        MPI_Initialized(&has_begun);
        MPI_Finalized(&has_ended);
        require(has_begun != 0 && has_ended == 0, "MPI is not at work", "Mpi",
                "Call MPI_Init before, and MPI_Finalize once all solvers are gone.");
        require(of != MPI_COMM_NULL, "this process is no member of the communicator", "Mpi",
                "Make solvers on the processes that have a part in it alone.");
        auto const close = [](MPI_Comm* comm) {
            int ended = 0;
            MPI_Finalized(&ended);
            if (ended == 0 && *comm != MPI_COMM_NULL) MPI_Comm_free(comm);
            delete comm;
        };
        std::shared_ptr<MPI_Comm> comm(new MPI_Comm(MPI_COMM_NULL), close);
        check(MPI_Comm_dup(of, comm.get()), "MPI_Comm_dup");
        check(MPI_Comm_set_errhandler(*comm, MPI_ERRORS_RETURN), "MPI_Comm_set_errhandler");
        return comm;
    }

    MPI_Comm comm() const { return *handle_; }

    std::shared_ptr<MPI_Comm> handle_;
    int rank_ = 0, size_ = 1;
};

} // namespace firn

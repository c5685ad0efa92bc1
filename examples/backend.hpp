// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif
#if defined(FIRN_EXAMPLE_ON_RANKS)
#include <firn/mpi.hpp>
#if defined(__CUDACC__)
#include <firn/distributed/on_cuda.hpp>
#endif
#if defined(FIRN_EXAMPLE_BY_NCCL)
#include <firn/nccl.hpp>
#endif
#endif

#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <unistd.h>

// The backend of an example: its one file is compiled once for each backend, into NAME and NAME_cuda, and for
// ranks into NAME_ranks and NAME_cuda_ranks.
namespace firn::examples
{

#if defined(FIRN_EXAMPLE_ON_RANKS)
/// The processes, by MPI: from the first call on until the program ends.
inline Mpi const& processes()
{
    struct Session
    {
        Session() { MPI_Init(nullptr, nullptr); }
        ~Session() { MPI_Finalize(); }
    };
    static Session const session;
    static Mpi const all;
    return all;
}
inline bool is_first_rank() { return processes().rank() == 0; }
#else
inline bool is_first_rank() { return true; }
#endif

#if defined(__CUDACC__) && defined(FIRN_EXAMPLE_ON_RANKS)
inline constexpr char const* backend_name = "cuda_ranks";
inline std::string backend_info() { return cuda_info() + " on each rank"; }
/// Processes take the devices of their machine by turns.
inline int device_of_rank()
{
    int devices = 0;
    if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) return 0; // which the solver refuses
    MPI_Comm machine = MPI_COMM_NULL;
    int number = 0;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, processes().rank(), MPI_INFO_NULL, &machine);
    MPI_Comm_rank(machine, &number);
    MPI_Comm_free(&machine);
    return number % devices;
}
#if defined(FIRN_EXAMPLE_BY_NCCL)
using Backend = Distributed<Cuda, Nccl<Mpi>>;
inline Backend backend_with(int /*threads*/)
{
    int const device = device_of_rank();
    return {.local = {.device = device}, .communicator = Nccl<Mpi>(processes(), device)};
}
#else
using Backend = Distributed<Cuda, Mpi>;
inline Backend backend_with(int /*threads*/)
{
    return {.local = {.device = device_of_rank()}, .communicator = processes()};
}
#endif
#elif defined(__CUDACC__)
using Backend = Cuda;
inline constexpr char const* backend_name = "cuda";
inline std::string backend_info() { return cuda_info(); }
inline Backend backend_with(int /*threads*/) { return {}; }
#elif defined(FIRN_EXAMPLE_ON_RANKS)
using Backend = Distributed<OpenMP, Mpi>;
inline constexpr char const* backend_name = "ranks";
inline std::string backend_info() { return openmp_info() + " on each rank"; }
inline Backend backend_with(int threads)
{
    return {.local = {.threads = threads}, .communicator = processes()};
}
#else
using Backend = OpenMP;
inline constexpr char const* backend_name = "openmp";
inline std::string backend_info() { return openmp_info(); }
inline Backend backend_with(int threads) { return {threads}; }
#endif

/// Of several ranks only the first one prints.
inline void let_first_rank_speak()
{
    if (is_first_rank()) return;
    static_cast<void>(std::freopen("/dev/null", "w", stdout));
    static_cast<void>(std::freopen("/dev/null", "w", stderr));
}

/// Says why a program stops, and returns its exit code. A rank that stops ends the others, which would wait.
inline int stopped_by(std::exception const& error)
{
    std::fprintf(stderr, "error: %s\n", error.what());
#if defined(FIRN_EXAMPLE_ON_RANKS)
    if (!is_first_rank()) sleep(1); // the first rank, which prints, usually has the same error
    processes().abort(error.what());
#endif
    return 1;
}

/// Continues in the program that was compiled for the wanted backend, "openmp", "cuda", "ranks" or
/// "cuda_ranks" (OpenMP or CUDA on several ranks, to be started by mpirun), unless this is it. Throws an
/// Error if there is no such backend or program.
inline void change_backend(std::string const& wanted, char** argv)
{
    if (wanted == backend_name) return;
    if (wanted != "openmp" && wanted != "cuda" && wanted != "ranks" && wanted != "cuda_ranks")
        throw Error{"there is no backend '" + wanted + "'", "--backend",
                    "Choose openmp, cuda, ranks or cuda_ranks."};
    std::string const own_name = backend_name, own_end = own_name == "openmp" ? "" : "_" + own_name;
    std::string other = argv[0];
    if (other.ends_with(own_end)) other.resize(other.size() - own_end.size());
    if (wanted != "openmp") other += "_" + wanted;
    execvp(other.c_str(), argv);
    throw Error{"this example was not built for the backend " + wanted, "--backend",
                "Build " + std::filesystem::path(other).filename().string() +
                    (wanted == "cuda"    ? ": CMake has it where it found the CUDA toolkit, 12.8 or newer."
                     : wanted == "ranks" ? ": CMake has it for the snow scenes, where it found MPI."
                     : wanted == "cuda_ranks"
                         ? ": CMake has it for the snow scenes, where it found the CUDA toolkit and MPI."
                         : ".")};
}

} // namespace firn::examples

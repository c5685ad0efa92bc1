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
#endif

#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <unistd.h>

// The backend of an example: its one file is compiled once for each backend, into NAME and NAME_cuda.
namespace firn::examples
{

#if defined(__CUDACC__)
using Backend = Cuda;
inline constexpr char const* backend_name = "cuda";
inline std::string backend_info() { return cuda_info(); }
inline Backend backend_with(int /*threads*/) { return {}; }
inline bool is_first_rank() { return true; }
#elif defined(FIRN_EXAMPLE_ON_RANKS)
using Backend = Distributed<OpenMP, Mpi>;
inline constexpr char const* backend_name = "ranks";
/// MPI, from the first call on until the program ends.
inline Mpi const& communicator()
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
inline std::string backend_info() { return openmp_info() + " on each rank"; }
inline Backend backend_with(int threads)
{
    return {.local = {.threads = threads}, .communicator = communicator()};
}
inline bool is_first_rank() { return communicator().rank() == 0; }
#else
using Backend = OpenMP;
inline constexpr char const* backend_name = "openmp";
inline std::string backend_info() { return openmp_info(); }
inline Backend backend_with(int threads) { return {threads}; }
inline bool is_first_rank() { return true; }
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
    communicator().abort(error.what());
#endif
    return 1;
}

/// Continues in the program that was compiled for the wanted backend, "openmp", "cuda" or "ranks" (OpenMP on
/// several ranks, to be started by mpirun), unless this is it. Throws an Error if there is no such backend or
/// program.
inline void change_backend(std::string const& wanted, char** argv)
{
    if (wanted == backend_name) return;
    if (wanted != "openmp" && wanted != "cuda" && wanted != "ranks")
        throw Error{"there is no backend '" + wanted + "'", "--backend", "Choose openmp, cuda or ranks."};
    std::string const own_name = backend_name, own_end = own_name == "openmp" ? "" : "_" + own_name;
    std::string other = argv[0];
    if (other.ends_with(own_end)) other.resize(other.size() - own_end.size());
    if (wanted != "openmp") other += "_" + wanted;
    execvp(other.c_str(), argv);
    throw Error{"this example was not built for the backend " + wanted, "--backend",
                "Build " + std::filesystem::path(other).filename().string() +
                    (wanted == "cuda"    ? ": CMake has it where it found the CUDA toolkit, 12.8 or newer."
                     : wanted == "ranks" ? ": CMake has it for the snow scenes, where it found MPI."
                                         : ".")};
}

} // namespace firn::examples

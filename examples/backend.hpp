// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif

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
#else
using Backend = OpenMP;
inline constexpr char const* backend_name = "openmp";
inline std::string backend_info() { return openmp_info(); }
inline Backend backend_with(int threads) { return {threads}; }
#endif

/// Continues in the program that was compiled for the wanted backend, "openmp" or "cuda", unless this is it.
/// Throws an Error if there is no such backend or program.
inline void change_backend(std::string const& wanted, char** argv)
{
    if (wanted == backend_name) return;
    if (wanted != "openmp" && wanted != "cuda")
        throw Error{"there is no backend '" + wanted + "'", "--backend", "Choose openmp or cuda."};
    std::string const here = argv[0], end = "_cuda";
    std::string const other = wanted == "cuda"      ? here + end
                              : here.ends_with(end) ? here.substr(0, here.size() - end.size())
                                                    : "";
    execvp(other.c_str(), argv);
    throw Error{
        "this example was not built for the backend " + wanted, "--backend",
        "Build " + std::filesystem::path(other).filename().string() +
            (wanted == "cuda" ? ": CMake has it where it found the CUDA toolkit, 12.8 or newer." : ".")};
}

} // namespace firn::examples

// SPDX-License-Identifier: MIT
#include "settings.hpp"

#include "support/policies.hpp"

#include <algorithm>
#include <fstream>

namespace firn::bench
{

#if defined(__CUDACC__)
std::string backend_name() { return "cuda"; }
std::string hardware(int) { return cuda_info(); }
#else
std::string backend_name() { return "openmp"; }

std::string hardware(int threads)
{
    std::string processor = "an unknown processor", line;
    std::ifstream about("/proc/cpuinfo");
    while (std::getline(about, line))
        if (line.starts_with("model name")) {
            processor = line.substr(line.find(':') + 2);
            break;
        }
    return processor + ", " + std::to_string(threads) + (threads == 1 ? " thread, " : " threads, ") +
           std::to_string(lane_width<openmp::NativeLane<float>>) + " float lanes";
}
#endif

} // namespace firn::bench

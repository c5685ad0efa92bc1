// SPDX-License-Identifier: MIT
// Runs tests that need a device, or says that there is none: 77 is ctest's word for a test that was skipped.
#include <cstdio>
#include <cstring>
#include <cuda_runtime_api.h>

extern bool tests_need_a_device;      ///< each program says so
int run_tests(int argc, char** argv); ///< see runner.cpp

int main(int argc, char** argv)
{
    bool lists = false;
    for (int i = 1; i < argc; ++i) lists = lists || std::strncmp(argv[i], "--list", 6) == 0;
    int devices = 0;
    cudaError_t const status = cudaGetDeviceCount(&devices);
    if (tests_need_a_device && !lists && (status != cudaSuccess || devices == 0)) {
        std::printf("skipped: %s\n", status != cudaSuccess ? cudaGetErrorString(status) : "no CUDA device");
        return 77;
    }
#ifdef FIRN_TESTS_NEED_CAPABILITY // what these programs were compiled for
    if (tests_need_a_device && !lists) {
        cudaDeviceProp device{};
        static_cast<void>(cudaGetDeviceProperties(&device, 0));
        if (10 * device.major + device.minor < FIRN_TESTS_NEED_CAPABILITY) {
            std::printf("skipped: compiled for devices of capability 9.0 or above, and this is %d.%d: see "
                        "tests/run.sh --gpu\n",
                        device.major, device.minor);
            return 77;
        }
    }
#endif
    return run_tests(argc, argv);
}

// SPDX-License-Identifier: MIT
// What libFuzzer calls: FIRN_FUZZ_HARNESS is the name of a harness and of its header.
#define FIRN_FUZZ_TEXT_OF(name) #name
#define FIRN_FUZZ_HEADER(name) FIRN_FUZZ_TEXT_OF(name.hpp)
#include FIRN_FUZZ_HEADER(FIRN_FUZZ_HARNESS)

extern "C" int LLVMFuzzerTestOneInput(std::uint8_t const* data, std::size_t size)
{
    firn::fuzz::FIRN_FUZZ_HARNESS({data, size});
    return 0;
}

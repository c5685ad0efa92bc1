// SPDX-License-Identifier: MIT
#include "blocks.hpp"

using namespace firn::test;

std::vector<AgreementCase> firn::test::cuda_blocks_in_the_plane() { return block_cases_in_the_plane<Cuda>(); }
std::vector<RestartCase> firn::test::cuda_restarts() { return restart_cases<Cuda>(); }

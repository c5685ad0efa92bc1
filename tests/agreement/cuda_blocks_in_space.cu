// SPDX-License-Identifier: MIT
#include "blocks.hpp"

using namespace firn::test;

std::vector<AgreementCase> firn::test::cuda_blocks_in_space() { return block_cases_in_space<Cuda>(); }

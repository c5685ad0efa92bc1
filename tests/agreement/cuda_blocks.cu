// SPDX-License-Identifier: MIT
#include "blocks.hpp"

std::vector<firn::test::AgreementCase> firn::test::cuda_blocks() { return block_cases<Cuda>(); }
std::vector<firn::test::RestartCase> firn::test::cuda_restarts() { return restart_cases<Cuda>(); }

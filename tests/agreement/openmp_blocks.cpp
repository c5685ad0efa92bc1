// SPDX-License-Identifier: MIT
#include "blocks.hpp"

std::vector<firn::test::AgreementCase> firn::test::openmp_blocks() { return block_cases<OpenMP>(); }
std::vector<firn::test::RestartCase> firn::test::openmp_restarts() { return restart_cases<OpenMP>(); }

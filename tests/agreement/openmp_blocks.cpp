// SPDX-License-Identifier: MIT
#include "blocks.hpp"

using namespace firn::test;

std::vector<AgreementCase> firn::test::openmp_blocks_in_space() { return block_cases_in_space<OpenMP>(); }
std::vector<AgreementCase> firn::test::openmp_blocks_in_the_plane()
{
    return block_cases_in_the_plane<OpenMP>();
}
std::vector<RestartCase> firn::test::openmp_restarts() { return restart_cases<OpenMP>(); }

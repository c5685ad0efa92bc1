// SPDX-License-Identifier: MIT
#include "scenes.hpp"

std::vector<firn::test::AgreementCase> firn::test::openmp_cases() { return agreement_cases<OpenMP>(); }
std::vector<firn::test::RestartCase> firn::test::openmp_restarts() { return restart_cases<OpenMP>(); }

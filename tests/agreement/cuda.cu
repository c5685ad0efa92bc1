// SPDX-License-Identifier: MIT
#include "scenes.hpp"

std::vector<firn::test::AgreementCase> firn::test::cuda_cases() { return agreement_cases<Cuda>(); }
std::vector<firn::test::RestartCase> firn::test::cuda_restarts() { return restart_cases<Cuda>(); }

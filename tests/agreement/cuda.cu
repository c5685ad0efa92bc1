// SPDX-License-Identifier: MIT
#include "scenes.hpp"

std::vector<firn::test::AgreementCase> firn::test::cuda_cases() { return agreement_cases<Cuda>(); }

// SPDX-License-Identifier: MIT
#include "scenes.hpp"

std::vector<firn::test::AgreementCase> firn::test::openmp_cases() { return agreement_cases<OpenMP>(); }

// SPDX-License-Identifier: MIT
#include "encounters.hpp"

std::vector<firn::test::AgreementCase> firn::test::openmp_encounters() { return encounter_cases<OpenMP>(); }

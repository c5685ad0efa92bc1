// SPDX-License-Identifier: MIT
#include "encounters.hpp"

std::vector<firn::test::AgreementCase> firn::test::cuda_encounters() { return encounter_cases<Cuda>(); }

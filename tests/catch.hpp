// SPDX-License-Identifier: MIT
#pragma once

// One include for Catch2 2 (Debian 12) and 3 (Ubuntu 24.04).
#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
using Catch::Approx;
#else
#include <catch2/catch.hpp>
#endif

// SPDX-License-Identifier: MIT
#pragma once

// One include, and one set of names, for Catch2 2 (Debian 12) and 3 (Ubuntu 24.04, Debian 13).
#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
using Catch::Approx;
using Catch::Matchers::EndsWith;
using Catch::Matchers::StartsWith;
inline auto Contains(std::string const& part) { return Catch::Matchers::ContainsSubstring(part); }
#else
#include <catch2/catch.hpp>
using Catch::Contains;
using Catch::EndsWith;
using Catch::StartsWith;
#endif

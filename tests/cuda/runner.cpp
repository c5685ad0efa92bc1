// SPDX-License-Identifier: MIT
// What of Catch2 runs tests: most of it, so programs with a main of their own share it.
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"

int run_tests(int argc, char** argv);
int run_tests(int argc, char** argv) { return Catch::Session().run(argc, argv); }

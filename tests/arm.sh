#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Passes the tests of packs on a processor of ARM's with NEON, 64 bits, which is emulated here: some minutes, most of them
# the compiler's. Packs there have four floats or two doubles.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh
need_packages g++-aarch64-linux-gnu qemu-user-static libeigen3-dev libxsimd-dev catch2

folder=build/arm
mkdir -p $folder/include
for headers in eigen3 xsimd catch2; do ln -sfn /usr/include/$headers $folder/include/$headers; done
flags=(-std=c++20 -O1 -w -fopenmp -static -Iinclude -Ibackends/openmp -Itests -isystem $folder/include/eigen3 -isystem $folder/include)
printf '#define CATCH_CONFIG_MAIN\n#include "catch.hpp"\n' >$folder/main.cpp
pass() { # UNIT [TESTS]
    local program=$folder/$(tr / _ <<<"${1%.cpp}")
    aarch64-linux-gnu-g++ "${flags[@]}" $folder/main.cpp "tests/$1" -o "$program"
    echo "$1"
    OMP_NUM_THREADS=2 OMP_WAIT_POLICY=passive qemu-aarch64-static "$program" "${@:2}"
}
pass unit/lanes.cpp
pass unit/singular_values.cpp
pass unit/principal_axes.cpp
pass physics/conservation.cpp "packs of lanes*"

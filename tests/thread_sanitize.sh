#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Looks for data races of the OpenMP backend: thread_sanitize.sh [test file]..., limits/load.cpp and limits/races.cpp if none is named. With clang's
# ThreadSanitizer and Archer, the tool of LLVM's OpenMP that tells it what a barrier is. (g++'s OpenMP tells it nothing, and
# all would be a race.) Builds each file of tests (minutes) in build/thread_sanitize and runs it with four threads. The exit
# status is 1 if there is a race, or a test fails.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh

version=${CLANG_VERSION:-16}
need_packages "clang-$version" "libclang-rt-$version-dev" "libomp-$version-dev" "llvm-$version" libeigen3-dev libxsimd-dev catch2
archer=$(find "/usr/lib/llvm-$version/lib" -name libarcher.so -print -quit)
[ -n "$archer" ] || stop "libarcher.so of LLVM $version was not found."

[ $# -gt 0 ] || set -- limits/load.cpp limits/races.cpp
folder=build/thread_sanitize
mkdir -p $folder
failed=0
for unit in "$@"; do
    program=$folder/$(tr / _ <<<"${unit%.cpp}")
    echo "building $unit"
    "clang++-$version" -std=c++20 -O1 -gline-tables-only -fsanitize=thread -fopenmp -DFIRN_COMPILE_SOON -Iinclude \
        -Ibackends/openmp -Itests -isystem /usr/include/eigen3 "tests/$unit" -o "$program" -lCatch2WithMain
    # A child of fork() has no threads of its own under the sanitizer: that test is left out.
    OMP_NUM_THREADS=4 OMP_WAIT_POLICY=passive OMP_TOOL_LIBRARIES=$archer ARCHER_OPTIONS=verbose=1 \
        TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=0 exitcode=66" "$program" "~a child of fork*" >"$program.log" 2>&1 || failed=1
    grep -q '^Archer detected' "$program.log" || stop "Archer did not start: what follows would be no races."
    echo "$unit: $(grep -c 'WARNING: ThreadSanitizer' "$program.log" || true) warnings, $(tail -n 2 "$program.log" | head -n 1)"
    grep -m 3 -A 12 'WARNING: ThreadSanitizer' "$program.log" || true
done
exit $failed

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Flags by which a compiler assumes that there is no NaN are refused with a sentence; where that is silenced, and with
# those that do not, checks of input and of steps hold: fast_math.sh COMPILER SOURCE EIGEN [CLANG]. CLANG, of any
# version that has C++20's library, compiles lanes alone.
set -euo pipefail
compiler=$1 source=$2 eigen=$3 clang=${4:-}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
flags=(-std=c++20 -fopenmp -DNDEBUG -DFIRN_COMPILE_SOON -DFIRN_ANY_COMPILER -I"$source/include" -I"$source/backends/openmp" -isystem "$eigen")

# refuses <compiler> <flag>...: so does the header that everything includes
refuses() {
    local said
    if said=$("$1" "${flags[@]}" -E -x c++ "${@:2}" "$source/include/firn/core/finite.hpp" 2>&1 >/dev/null); then
        echo "$* is taken."
        exit 1
    fi
    grep -q -- '-ffinite-math-only .*Add -fno-finite-math-only .*FIRN_ALLOW_FAST_MATH' <<<"$said" ||
        { echo "$said"; echo "$*: it is not said what is refused, and what to do."; exit 1; }
}

# holds <program> <compiler> <flag>...: what it compiles to finds nothing that does not hold
holds() {
    "$2" "${flags[@]}" "${@:3}" "$source/tests/refusal/$1.cpp" -o "$work/program"
    "$work/program" || { echo "$* does not hold."; exit 1; }
}

for each in "$compiler" $clang; do
    for flag in -ffast-math -Ofast -ffinite-math-only; do refuses "$each" "$flag"; done
    # without SSE4.1 on x86, where xsimd does by additions what -ffast-math simplifies
    holds fast_math_lanes "$each" -O1 -ffast-math -DFIRN_ALLOW_FAST_MATH
done
holds fast_math_lanes "$compiler" -O1 -ffast-math -fno-finite-math-only
OMP_NUM_THREADS=1 holds fast_math "$compiler" -Ofast -O1 -march=native -DFIRN_ALLOW_FAST_MATH
echo "flags that assume that there is no NaN are refused, and where they are not, checks hold"

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A model that forgets a member is refused by the compiler, with a sentence: incomplete_model.sh COMPILER SOURCE EIGEN.
set -euo pipefail
compiler=$1 source=$2 eigen=$3
said=$(mktemp)
trap 'rm -f "$said"' EXIT

# compiles <macro>: the model with this macro defined
compiles() {
    "$compiler" -std=c++20 -fopenmp -fsyntax-only -I"$source/include" -I"$source/backends/openmp" -isystem "$eigen" \
        "-D$1" "$source/tests/refusal/incomplete_model.cpp" >"$said" 2>&1
}

compiles COMPLETE || { cat "$said"; echo "a complete model is refused."; exit 1; }
for member in STATE DENSITY VALIDATE RESPOND; do
    if compiles "WITHOUT_$member"; then echo "a model without $member compiles."; exit 1; fi
    grep -q 'the model lacks `Response<Real, d> respond(state&, velocity_gradient, dt) const`' "$said" ||
        { cat "$said"; echo "nobody is told that the model lacks $member."; exit 1; }
done
echo "a model without its State, density, validate() or respond() is refused with a sentence"

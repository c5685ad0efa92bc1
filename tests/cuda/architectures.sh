#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Whether a scene in the plane and one in space compile, warnings being errors, for every kind of device since 7.5:
# architectures.sh NVCC SOURCE EIGEN CODE...
# They never run, so they are optimised as little as the compiler can.
set -euo pipefail
nvcc=$1 source=$2 eigen=$3
shift 3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
known=$("$nvcc" --list-gpu-code)
quickly=(-O1)
[[ $("$nvcc" --help) != *--Ofast-compile* ]] || quickly+=(-Ofc=min)
targets=()
for code in "$@"; do
    grep -qx "$code" <<<"$known" || { echo "this nvcc does not know $code."; exit 1; }
    targets+=(-gencode "arch=compute_${code#sm_},code=$code")
done
"$nvcc" -std=c++20 "${quickly[@]}" --expt-relaxed-constexpr -diag-suppress=1675,20012 -Werror=all-warnings \
    -Werror=cross-execution-space-call -Xcompiler -Wall,-Werror --threads 0 "${targets[@]}" -I"$source/include" -I"$source/backends/cuda" \
    -isystem "$eigen" -c "$source/tests/cuda/architectures.cu" -o "$work/scene.o" 2>&1
echo "compiled for ${targets[*]}"

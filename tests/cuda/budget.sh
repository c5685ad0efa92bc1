#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# What the compiler made of the loops of a step: budget.sh NVCC SOURCE EIGEN. Fails if a loop with quadratic kernels
# spills registers on sm_90, or if anything in device code became a trap: Eigen's calls that a device has not do so.
set -euo pipefail
nvcc=$1 source=$2 eigen=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$nvcc" -std=c++20 -O3 -DNDEBUG --expt-relaxed-constexpr -diag-suppress=1675,20012 -arch=sm_90 -Xptxas -v --keep --keep-dir "$work" \
    -I"$source/include" -I"$source/backends/cuda" -isystem "$eigen" -cubin "$source/tests/cuda/budget.cu" -o "$work/budget.cubin" \
    2>"$work/said" || { cat "$work/said"; exit 1; }

traps=$(cat "$work"/*.ptx | grep -c 'trap;' || true)
[ "$traps" -eq 0 ] || { echo "$traps traps in device code."; exit 1; }

# one line for each loop: what it spills, its registers, and its name
awk '/Compiling entry function/ { match($0, /'\''[^'\'']*'\''/); name = substr($0, RSTART + 1, RLENGTH - 2) }
     /bytes stack frame/ { spilt = $5 }
     /Used [0-9]+ registers/ { for (i = 1; i < NF; ++i) if ($i == "Used") print spilt, $(i + 1), name }' "$work/said" |
    sort -u >"$work/loops"
[ -s "$work/loops" ] || { echo "the compiler said nothing about registers."; exit 1; }
# Where several obstacles may touch particles, some registers are saved around the call that few particles make.
called=$(awk '$1 > 0 && /QuadraticBSpline/ && /Shell/ { if ($1 > most) most = $1 } END { print most + 0 }' "$work/loops")
spilling=$(awk -v called="$called" '$1 > 0 && /QuadraticBSpline/ && !(/Shell/ && called <= 64)' "$work/loops")
[ -z "$spilling" ] || { echo "spilt bytes, registers and loops:"; echo "$spilling"; exit 1; }
most=$(awk '$2 > most { most = $2 } END { print most }' "$work/loops")
echo "$(wc -l <"$work/loops") loops, at most $most registers; none with quadratic kernels spills, but for $called bytes around" \
    "a call where several obstacles touch particles; no traps"

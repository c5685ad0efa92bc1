#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# What the compiler made of the loops of a step: budget.sh NVCC SOURCE EIGEN [FLAG...]. Fails if a loop with quadratic kernels
# spills registers on sm_90, or if anything in device code became a trap: Eigen's calls that a device has not do so. The loop
# that moves items may spill some: with more registers and fewer threads it is slower (bench/notes/2026-11-29-two-phases.md).
set -euo pipefail
nvcc=$1 source=$2 eigen=$3
shift 3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$nvcc" -std=c++20 -O3 -DNDEBUG "$@" --expt-relaxed-constexpr -diag-suppress=1675,20012 -arch=sm_90 -Xptxas -v --keep --keep-dir "$work" \
    -I"$source/include" -I"$source/backends/cuda" -isystem "$eigen" -cubin "$source/tests/cuda/budget.cu" -o "$work/budget.cubin" \
    2>"$work/said" || { cat "$work/said"; exit 1; }

traps=$(cat "$work"/*.ptx | grep -c 'trap;' || true)
[ "$traps" -eq 0 ] || { echo "$traps traps in device code."; exit 1; }

# One line for each loop, and each function that is called in one: what it spills, registers, and its name. The
# properties of what is called follow those of the loop.
awk '/Function properties for/ { name = $NF }
     /Compiling entry function/ { match($0, /'\''[^'\'']*'\''/); loop = substr($0, RSTART + 1, RLENGTH - 2) }
     /bytes stack frame/ { spilt[name] = $5 }
     /Used [0-9]+ registers/ { for (i = 1; i < NF; ++i) if ($i == "Used") registers[loop] = $(i + 1) }
     END { for (name in spilt) print spilt[name], name in registers ? registers[name] : 0, name }' "$work/said" |
    sort -u >"$work/loops"
[ -s "$work/loops" ] || { echo "the compiler said nothing about registers."; exit 1; }
# All but loops of wider stencils, and what one thread does to finish a step.
grep -vE 'CubicBSpline|FinishStep' "$work/loops" >"$work/hot"
grep -q rearrange "$work/hot" || { echo "the order of cells is not among what was compiled."; exit 1; }
spilling=$(awk '$1 > ($3 ~ /detail4moveI/ ? 640 : 0)' "$work/hot")
[ -z "$spilling" ] || { echo "spilt bytes, registers and functions:"; echo "$spilling"; exit 1; }
most=$(awk '$2 > most { most = $2 } END { print most }' "$work/loops")
spilt=$(awk '$3 ~ /detail4moveI/ && $1 > most { most = $1 } END { print most + 0 }' "$work/hot")
echo "$(awk '$2 > 0' "$work/loops" | wc -l) loops, at most $most registers; those that move items spill at most $spilt bytes, of others" \
    "only cubic ones' and the end of a step; no traps"

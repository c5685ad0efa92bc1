#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# What steps on several ranks cost beside those of one backend alone: runs the scenes of ranks.cpp without ranks and on
# several, by turns, each rank with a block of particles of its own, and prints a table. On a machine with GPUs and NCCL
# each rank has one of these:
#
#     bash bench/ranks.sh [--ranks "2 4"] [--rounds N] [--steps N] [--program FILE] [--processors]
#
#   --ranks LIST    numbers of ranks; as many as there are GPUs if nothing is said, and 2 on processors
#   --rounds N      runs each pair so many times, 3 if nothing is said: the table has medians of them
#   --steps N       so many steps of each scene, 200 if nothing is said
#   --program FILE  what the build has made elsewhere: ranks, or ranks_cuda
#   --processors    on processors although there are GPUs: two ranks of one thread beside two threads
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

ranks="" rounds=3 steps=200 program="" processors=""
while [ $# -gt 0 ]; do
    case $1 in
        --ranks | --rounds | --steps | --program) [ $# -ge 2 ] || stop "$1 needs a value."; declare "${1#--}=$2"; shift ;;
        --processors) processors=yes ;;
        --help | -h) sed -n '/^# What/,/^#   --processors/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/ranks.sh --help." ;;
    esac
    shift
done
[[ "$rounds $steps" =~ ^[1-9][0-9]*\ [1-9][0-9]*$ ]] || stop "--rounds and --steps need numbers above 0."
[[ $ranks =~ ^[0-9\ ]*$ ]] || stop "--ranks needs numbers, not '$ranks'."
gpus=0
[ -n "$processors" ] || gpus=$(nvidia-smi -L 2>/dev/null | grep -c GPU || true)
[ -n "$ranks" ] || ranks=$([ "$gpus" -gt 1 ] && echo "$gpus" || echo 2)

if [ -z "$program" ]; then
    need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev libopenmpi-dev openmpi-bin
    preset=$([ "$gpus" -gt 0 ] && echo cuda || echo bench)
    program=$root/build/$preset/bench/ranks$([ "$gpus" -gt 0 ] && echo _cuda || true)
    (cd "$root" && cmake --preset "$preset" && cmake --build "build/$preset" --target "$(basename "$program")") >"$root/build/ranks.log" 2>&1 ||
        stop "the program could not be built: see build/ranks.log."
fi
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 NCCL_NVLS_ENABLE=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
run() { # RANKS ARGUMENTS...: the lines of the program
    mpirun --bind-to none -n "$1" "$program" --steps "$steps" "${@:2}" || stop "the program failed: $program ${*:2}."
}
median() { sort -g | awk '{ of[NR] = $1 } END { print of[int(NR / 2) + 1] }'; }
value() { # FILE BEFORE [BEHIND]: the median of what stands between these texts in the lines of a file
    sed -n "s/.*$2\([0-9.e+-]*\)${3-}.*/\1/p" "$1" | median
}
row() { # NAME KIND WANTED RANKS ALONE TOGETHER: KIND is "share" (alone / together) or "times" (together / alone)
    awk -v name="$1" -v kind="$2" -v wanted="$3" -v ranks="$4" \
        -v a="$(value "$5" ': ' ' ms a step')" -v am="$(value "$5" 'mean ')" \
        -v b="$(value "$6" ': ' ' ms a step')" -v bm="$(value "$6" 'mean ')" \
        -v messages="$(value "$6" 'calls, ')" -v kb="$(value "$6" 'messages, ')" -v anew="$(value "$6" 'divided anew ')" '
        BEGIN {
            median = kind == "share" ? a / b : b / a; mean = kind == "share" ? am / bm : bm / am
            printf "| %s | %d | %.3f (%.3f) | %.3f (%.3f) | %.3f (%.3f) | %s %s | %.1f | %.0f | %d |\n", name, ranks,
                a, am, b, bm, median, mean, kind == "share" ? "at least" : "at most", wanted, messages, kb, anew
        }'
}
pair() { # NAME KIND WANTED RANKS SCENE PARTICLES: each rank has so many
    local name=$1 kind=$2 wanted=$3 n=$4 scene=$5 particles=$6 alone=$work/alone together=$work/together
    : >"$alone"
    : >"$together"
    for ((round = 0; round < rounds; ++round)); do
        if [ "$gpus" -gt 0 ]; then
            run 1 --nccl --particles "$particles" "$scene" | grep "no ranks" >>"$alone"
            run "$n" --nccl --particles "$particles" "$scene" >>"$together"
        else # the same blocks on as many threads of one process
            run 1 --blocks "$n" --threads "$n" --particles "$particles" "$scene" | grep "no ranks" >>"$alone"
            run "$n" --particles "$particles" "$scene" >>"$together"
        fi
    done
    [ "$gpus" -gt 0 ] || [ "$(value "$alone" 'the end ')" = "$(value "$together" 'the end ')" ] ||
        stop "$scene does not end in the same state on $n ranks as without."
    row "$name" "$kind" "$wanted" "$n" "$alone" "$together"
}

echo "Medians of calls of ten steps, and means of all $steps in brackets [ms a step]; messages are those of rank 0."
echo "| scene | ranks | without | with | ratio | must | messages a step | kB a step | divided anew |"
echo "|---|---|---|---|---|---|---|---|---|"
for n in $ranks; do
    if [ "$gpus" -gt 0 ]; then
        pair "8 million elastic for each" share "$([ "$n" -gt 2 ] && echo 0.92 || echo 0.95)" "$n" elastic 8e6
        pair "8 million splashing for each" share 0.85 "$n" splash 8e6
        pair "8 million elastic in all" times 1.12 "$n" elastic $((8000000 / n))
        pair "1 million elastic in all" times "$([ "$n" -gt 2 ] && echo - || echo 1.35)" "$n" elastic $((1000000 / n))
    else
        pair "125 000 elastic for each" share 0.95 "$n" elastic 125000
        pair "125 000 splashing for each" share 0.85 "$n" splash 125000
    fi
done

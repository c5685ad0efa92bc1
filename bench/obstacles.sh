#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# What lists of obstacles cost: steps of many_obstacles, and the compiler's time for obstacles_host.cpp with two
# obstacles as arguments and with a list, by turns. Prints figures, one to a line, which results.py reads:
#
#     bash bench/obstacles.sh [--rounds N] [--out FILE] [--record ID]
#
#   --rounds N      compiles each program so many times, 5 if nothing is said: a third of a minute a round
#   --record ID     appends the results to bench/results, as of the machine with this id in machines.csv
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

rounds=5 out=$root/build/obstacles.txt record=""
while [ $# -gt 0 ]; do
    case $1 in
        --rounds | --out | --record) [ $# -ge 2 ] || stop "$1 needs a value."; declare "${1#--}=$2"; shift ;;
        --help | -h) sed -n '/^# What/,/^#   --record/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/obstacles.sh --help." ;;
    esac
    shift
done
case $rounds in '' | *[!0-9]* | 0) stop "--rounds needs a number above 0, not '$rounds'." ;; esac
[ -z "$record" ] || python3 "$root/bench/results.py" --machine "$record" || stop "the results cannot be recorded."

need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev libbenchmark-dev
(cd "$root" && cmake --preset bench && cmake --build --preset bench --target many_obstacles) ||
    stop "the benchmark could not be built."
OMP_NUM_THREADS=1 "$root/build/bench/bench/many_obstacles" | tee "$out"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
compile() { # NAME FLAGS...: adds the compiler's seconds of processor time to the file of that name
    local name=$1 TIMEFORMAT=%U
    shift
    { time "${CXX:-g++}" -std=c++20 -O3 -DNDEBUG -march=native -fopenmp "-I$root/include" "-I$root/backends/openmp" \
        -isystem /usr/include/eigen3 "$@" -c "$root/bench/obstacles_host.cpp" -o "$work/o" 2>"$work/said"; } 2>>"$work/$name" ||
        stop "the compiler failed: $(cat "$work/said")"
}
for ((i = 0; i < rounds; ++i)); do
    compile two_arguments
    compile list -DFIRN_BENCH_LIST
done
python3 - "$work" <<'PY' | tee -a "$out"
import pathlib, statistics, sys
of = {}
for name in ("two_arguments", "list"):
    seconds = [float(line) for line in pathlib.Path(sys.argv[1], name).read_text().split()]
    of[name] = statistics.median(seconds)
    print(f"figure obstacles/compile/{name} {of[name]:.3f} s {(max(seconds) - min(seconds)) / 2 / of[name]:.3f}")
print(f"figure obstacles/compile/list_over_two {of['list'] / of['two_arguments']:.3f} x")
PY
echo "results in $out"
[ -z "$record" ] || python3 "$root/bench/results.py" --machine "$record" "$out" || stop "the results cannot be recorded."

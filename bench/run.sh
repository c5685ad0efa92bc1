#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# Sets the machine up, builds the benchmarks and writes bench.json (Google Benchmark's format):
#
#     bash bench/run.sh --short | --long [--threads N] [--out FILE]
#
#   --short   100 000 particles and the phases of one step, about 4 minutes
#   --long    up to 10 million particles, about an hour
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

size="" threads=1 out="$root/bench.json"
while [ $# -gt 0 ]; do
    case $1 in
        --short | --long) size=${1#--} ;;
        --threads) [ $# -ge 2 ] || stop "--threads needs a number."; threads=$2; shift ;;
        --out) [ $# -ge 2 ] || stop "--out needs a file."; out=$2; shift ;;
        --help | -h) sed -n '/^# Sets/,/^#   --long/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/run.sh --short or --long." ;;
    esac
    shift
done
[ -n "$size" ] || stop "choose --short (4 minutes) or --long (an hour)."
case $threads in '' | *[!0-9]* | 0) stop "--threads needs a number above 0, not '$threads'." ;; esac

need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev libcgal-dev libbenchmark-dev
(cd "$root" && cmake --preset bench && cmake --build --preset bench) || stop "the benchmarks could not be built."

filter='.*' seconds=1
[ "$size" = long ] || {
    filter='^step.*/(lattice|random|splash)/100000$|^step/openmp/neo_hookean.*/10000$|^phase.*neo_hookean.*lattice|sampling/openmp/lattice|^compile'
    seconds=0.3
}
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-passive}"
"$root/build/bench/bench/benchmarks" "$threads" --benchmark_filter="$filter" --benchmark_min_time="$seconds" \
    --benchmark_out="$out" --benchmark_out_format=json --benchmark_counters_tabular=true ||
    stop "the benchmark failed."
echo "results in $out"

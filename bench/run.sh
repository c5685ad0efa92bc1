#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# Sets the machine up, builds the benchmarks and writes bench.json (Google Benchmark's format) or a table of errors and
# their costs, speed_against_error.csv, with its drawings beside it:
#
#     bash bench/run.sh --short | --long [--threads N] [--out FILE] [--record ID]
#     bash bench/run.sh --error short | --error long | --error gate [--threads N] [--out FILE] [--record ID]
#
#   --short         100 000 particles and the phases of one step, 3 minutes after building
#   --long          up to 10 million particles, about an hour
#   --error short   nine problems by kernels, transfers and precisions, four to six minutes after building
#   --error long    the same, finer, with more lengths of steps and numbers of particles, half an hour
#   --error gate    P1 and P2 of the short one, once each, and stops with 1 where an error is 2 % above error/gate.csv
#   --record ID     appends the results to bench/results, as of the machine with this id in machines.csv
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

size="" error="" threads=1 out="" record=""
while [ $# -gt 0 ]; do
    case $1 in
        --short | --long) size=${1#--} ;;
        --error)
            [[ "${2:-}" =~ ^(short|long|gate)$ ]] || stop "--error needs 'short' (5 minutes), 'long' (half an hour) or 'gate' (two minutes)."
            error=$2
            shift
            ;;
        --threads) [ $# -ge 2 ] || stop "--threads needs a number."; threads=$2; shift ;;
        --out) [ $# -ge 2 ] || stop "--out needs a file."; out=$2; shift ;;
        --record) [ $# -ge 2 ] || stop "--record needs the id of a machine."; record=$2; shift ;;
        --help | -h) sed -n '/^# Sets/,/^#   --record/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/run.sh --short or --long." ;;
    esac
    shift
done
[ -n "$size$error" ] || stop "choose --short (3 minutes), --long (an hour), --error short (5 minutes), --error long (half an hour) or --error gate (two minutes)."
[ -z "$size" ] || [ -z "$error" ] || stop "choose speeds (--$size) or errors (--error $error), not both."
case $threads in '' | *[!0-9]* | 0) stop "--threads needs a number above 0, not '$threads'." ;; esac

record() { # [FILE]: appends its results, if --record is given; without FILE only the id is checked
    [ -z "$record" ] || python3 "$root/bench/results.py" --machine "$record" "$@" || stop "the results cannot be recorded."
}
[ -z "$record" ] || [ "$error" != gate ] || stop "--error gate compares errors, and records none."
record

packages=(g++ cmake ninja-build libeigen3-dev libxsimd-dev libcgal-dev libbenchmark-dev)
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-passive}"

if [ -n "$error" ]; then
    out=${out:-$root/speed_against_error.csv}
    need_packages "${packages[@]}" python3-matplotlib
    (cd "$root" && cmake --preset bench && cmake --build --preset bench --target speed_against_error) ||
        stop "the benchmark could not be built."
    if [ "$error" = gate ]; then
        "$root/build/bench/bench/speed_against_error" --grid short --only '^P[12]/' --runs 1 --threads "$threads" --out "$out" ||
            stop "the benchmark failed."
        exec /usr/bin/python3 "$root/bench/error/gate.py" "$out"
    fi
    commit=$(git -C "$root" describe --always --dirty 2>/dev/null) || commit=unknown
    "$root/build/bench/bench/speed_against_error" --grid "$error" --threads "$threads" --commit "$commit" --out "$out" ||
        stop "the benchmark failed."
    /usr/bin/python3 "$root/bench/plot.py" "$out" --out "$(dirname "$out")" || stop "the drawings failed."
    echo "results in $out"
    record "$out"
    exit
fi

out=${out:-$root/bench.json}
need_packages "${packages[@]}"
(cd "$root" && cmake --preset bench && cmake --build --preset bench) || stop "the benchmarks could not be built."

filter='.*' seconds=1
[ "$size" = long ] || {
    filter='^step.*/(lattice|random|splash)/100000$|^step/openmp/neo_hookean.*/10000$|^phase.*neo_hookean.*lattice|sampling/openmp/lattice|^compile'
    seconds=0.3
}
"$root/build/bench/bench/benchmarks" "$threads" --benchmark_filter="$filter" --benchmark_min_time="$seconds" \
    --benchmark_out="$out" --benchmark_out_format=json --benchmark_counters_tabular=true ||
    stop "the benchmark failed."
echo "results in $out"
record "$out"

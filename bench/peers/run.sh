#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# Sets the machine up, builds, runs Firn and its peers in turns and writes peers.json:
#
#     bash bench/peers/run.sh [--only CASE] [--particles N] [--steps K] [--rounds R] [--threads T] [--double]
#                             [--patience S] [--out FILE] [--record ID]
#     bash bench/peers/run.sh --waves [--threads T] [--rounds R] [--record ID]
#
#   --only CASE     neo_hookean_early, neo_hookean, fixed_corotated, snow_early, snow_packed or snow_cubic, instead of all
#   --particles N   about so many (125000)
#   --steps K       timed steps (50), after those that bring the body into its state
#   --rounds R      turns of every program (3); medians are printed
#   --threads T     of the runs with several threads (2)
#   --double        compares the peers in double precision, too
#   --patience S    waits up to S seconds before a run for other programs to leave the machine alone (0)
#
#   --record ID     appends the results to bench/results, as of the machine with this id in machines.csv
#
#   --waves         instead of the scenes, errors and times of standing waves (P1 of speed_against_error), on one thread
#                   or T of them: waves.csv and its drawing, P1_peers.svg, or waves_T.csv and P1_peers_T.svg; 5 minutes
#
# Without options half an hour on a quiet machine; with --particles 10000 --rounds 1 about 5 minutes.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
source "$root/examples/set_up.sh"

arguments=() waves="" out="$root/peers.json" threads=1 record="" given=""
while [ $# -gt 0 ]; do
    case $1 in
        --only | --particles | --steps | --rounds | --threads | --patience | --out | --record)
            [ $# -ge 2 ] || stop "$1 needs a value."
            case $1 in
                --out) out=$2 given=yes ;;
                --record) record=$2 ;;
                --threads) threads=$2 arguments+=("$1" "$2") ;;
                *) arguments+=("$1" "$2") ;;
            esac
            shift ;;
        --double) arguments+=("$1") ;;
        --waves) waves=yes ;;
        --help | -h) sed -n '/^# Sets/,/^# Without/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/peers/run.sh --help." ;;
    esac
    shift
done

record() { # [FILE]: appends its results, if --record is given; without FILE only the id is checked
    [ -z "$record" ] || python3 "$root/bench/results.py" --machine "$record" "$@" || stop "the results cannot be recorded."
}
record

need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev libbenchmark-dev python3 python3-venv
python3 -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' ||
    stop "Taichi 1.7.4 and Warp 1.19.0 are published for Python 3.10 to 3.13, and python3 here is $(python3 -V 2>&1).
Put one of those first on the PATH."
[ "$(uname -m)" = x86_64 ] || stop "Taichi 1.7.4 is published for x86-64 alone, and this machine is $(uname -m)."
mkdir -p "$root/build"
(need_python "$root/build/venv-peers" taichi==1.7.4 warp-lang==1.19.0 numpy matplotlib) 2> >(grep -v FIRN_NO_RENDER >&2) ||
    stop "without Taichi and Warp there is nothing to compare with."

if [ -n "$waves" ]; then
    [ -z "$given" ] || stop "--out is for the scenes: waves are written to waves.csv, or waves_T.csv."
    table="$root/waves.csv"
    [ "$threads" = 1 ] || table="$root/waves_$threads.csv"
    (cd "$root" && cmake --preset bench && cmake --build --preset bench --target firn_waves) ||
        stop "Firn's program of the waves could not be built."
    python="$root/build/venv-peers/bin/python"
    "$python" "$root/bench/peers/waves.py" all --firn "$root/build/bench/bench/firn_waves" --out "$table" \
        ${arguments[@]+"${arguments[@]}"} || stop "a program of the waves failed."
    record "$table"
    exec "$python" "$root/bench/plot.py" "$table" --out "$root"
fi

(cd "$root" && cmake --preset bench && cmake --build --preset bench --target firn_scene) ||
    stop "Firn's program of the scenes could not be built."

"$root/build/venv-peers/bin/python" "$root/bench/peers/compare.py" \
    --firn "$root/build/bench/bench/firn_scene" --out "$out" ${arguments[@]+"${arguments[@]}"}
record "$out"

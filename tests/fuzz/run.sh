#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Fuzzes the library: run.sh [seconds each] [harness]... With clang 16 or newer, its libFuzzer and sanitizers, and
# its OpenMP; builds the harnesses (minutes) in build/fuzz and lets each run for so long, one after the other.
# FIRN_FUZZ_FLAGS=-DFIRN_FUZZ_ALL: with more materials and policies, which takes several times as long to build.
#
# What it found is in build/fuzz/found/<harness>: a file for each input that broke an invariant, crashed, hung, leaked or
# tripped a sanitizer. Mend the cause, and put the file into tests/fuzz/corpus/<harness>: the test "fuzz corpus" keeps it
# mended. The exit status is 1 if there is one, faults of the mesh importer's own left out.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
source examples/set_up.sh

clang=${CLANG:-clang++-16}
need_packages "${clang/clang++/clang}" "libclang-rt-${clang##*-}-dev" "libomp-${clang##*-}-dev" "llvm-${clang##*-}" \
    libeigen3-dev libxsimd-dev libassimp-dev

seconds=${1:-60}
shift || true
[ $# -gt 0 ] || set -- calls checkpoint parameters worlds mesh
folder=build/fuzz
mkdir -p $folder
export OMP_NUM_THREADS=1 # one input is one small scene
broken=0
for harness in "$@"; do
    libraries=()
    options=(-detect_leaks=1)
    sanitizer=quarantine_size_mb=32
    case $harness in
    mesh)
        # the importer crashes, hangs and leaks: the fuzzer goes on in another child process
        libraries=(-lassimp)
        options=(-fork=1 -ignore_crashes=1 -ignore_timeouts=1 -ignore_ooms=1 -detect_leaks=0 -max_len=4000)
        sanitizer+=:detect_leaks=0:allocator_may_return_null=1
        ;;
    parameters) options+=(-max_len=120) ;;
    checkpoint) options+=(-max_len=1600) ;;
    calls | worlds) options+=(-max_len=800) ;;
    *) stop "there is no harness '$harness'" ;;
    esac
    echo "building $harness"
    "$clang" -std=c++20 -O1 -gline-tables-only -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=undefined \
        -fopenmp -DFIRN_COMPILE_SOON -DFIRN_FUZZ_HARNESS="$harness" ${FIRN_FUZZ_FLAGS:-} -Iinclude -Ibackends/openmp \
        -Itests/fuzz -isystem /usr/include/eigen3 tests/fuzz/fuzzer.cpp -o "$folder/$harness" "${libraries[@]}"
    mkdir -p "$folder/corpus/$harness" "$folder/found/$harness"
    echo "fuzzing $harness for $seconds s"
    ASAN_OPTIONS=$sanitizer "$folder/$harness" "${options[@]}" -timeout=60 -rss_limit_mb=2500 -print_final_stats=1 \
        -max_total_time="$seconds" -artifact_prefix="$folder/found/$harness/" "$folder/corpus/$harness" \
        "tests/fuzz/corpus/$harness" >"$folder/$harness.log" 2>&1 || true
    grep -E '^#[0-9]+' "$folder/$harness.log" | tail -n 1 || true
    faults=0
    for input in "$folder/found/$harness"/*; do
        [ -f "$input" ] || continue
        # again, by itself: where does it happen?
        log=$(ASAN_OPTIONS=$sanitizer timeout 70 "$folder/$harness" -timeout=60 "$input" 2>&1) && [ "$harness" = mesh ] && {
            faults=$((faults + 1)) # reads what is not there, and is not always caught
            continue
        }
        # the innermost frame that is no sanitizer's or fuzzer's, and not of the C library
        if [ "$harness" = mesh ] && grep -m 1 -E '^ +#[0-9]+ .*(firn::|Assimp|libassimp)' <<<"$log" | grep -q -i assimp; then
            faults=$((faults + 1))
        else
            echo "found: $input"
            grep -m 3 -E '^broken|runtime error|^SUMMARY' <<<"$log" || true
            broken=1
        fi
    done
    [ $faults -eq 0 ] || echo "faults of the importer's own: $faults"
done
exit $broken

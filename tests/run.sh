#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs what the tests need, builds them and passes them all:
#     bash tests/run.sh [--gpu] [--all] [--full] [arguments of ctest]
# With --gpu: the tests of the CUDA backend, on a machine with a GPU, its driver and the CUDA toolkit.
# With --all: what is slow to compile and proves little beyond the others, too (FIRN_TESTS_ALL).
# With --full: then the tests that are too long for every day, too, those with the tag [.full] in all programs.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh

# full_tests <folder>: runs the tests with the tag [.full] of all programs in the folder, on all cores.
full_tests() {
    local program threads programs=() failed=()
    for program in "$1"/*; do
        [ -f "$program" ] && [ -x "$program" ] || continue
        # Catch2 3 calls it an error where there are none
        { "$program" --list-tests '[.full]' 2>/dev/null || true; } | grep -q '^[1-9][0-9]* matching test case' &&
            programs+=("$program")
    done
    [ ${#programs[@]} -gt 0 ] || stop "no program in $1 has a test with the tag [.full]."
    for program in "${programs[@]}"; do
        echo "full tests of $program"
        threads=${OMP_NUM_THREADS:-$(nproc)}
        [ "${program##*/}" != conservation ] || threads=1 # a million steps of few particles: two threads take ten times as long
        OMP_NUM_THREADS=$threads OMP_WAIT_POLICY=passive "$program" '[.full]' --durations yes || failed+=("$program")
    done
    [ ${#failed[@]} -eq 0 ] || stop "full tests failed: ${failed[*]}"
}

preset=release all=OFF full=no
while true; do
    case "${1:-}" in
    --gpu) preset=cuda ;;
    --all) all=ON ;;
    --full) full=yes ;;
    *) break ;;
    esac
    shift
done

if [ $preset = cuda ]; then
    PATH=$PATH:/usr/local/cuda/bin
    command -v nvcc >/dev/null || stop "the CUDA toolkit is not installed: there is no nvcc."
    [[ $(nvidia-smi -L 2>/dev/null) == *GPU* ]] || stop "this machine has no NVIDIA GPU, or no driver for it."
    need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev catch2 libbenchmark-dev
else
    need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev catch2 libcgal-dev libassimp-dev libcli11-dev \
        libbenchmark-dev libboost-context-dev libopenmpi-dev openmpi-bin git
fi

cmake --preset $preset -DFIRN_TESTS_ALL=$all
cmake --build --preset $preset
if [ $preset$all = cudaON ]; then
    cmake --build --preset cuda --target cuda_proofs cuda_implicit cuda_over_ranks
elif [ $preset = cuda ]; then # those of an earlier run with --all may be older than the code
    rm -f build/cuda/tests/cuda_{proofs,implicit,over_ranks}{,-*_tests.cmake,_tests-*.cmake}
fi
ctest --preset $preset --parallel "$(nproc)" "$@"
[ $full = no ] || full_tests build/$preset/tests

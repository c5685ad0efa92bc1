#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs what the tests need, builds them and passes them all: bash tests/run.sh [--gpu] [arguments of ctest]
# With --gpu: the tests of the CUDA backend, on a machine with a GPU, its driver and the CUDA toolkit.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh

preset=release
if [ "${1:-}" = --gpu ]; then
    preset=cuda
    shift
    PATH=$PATH:/usr/local/cuda/bin
    command -v nvcc >/dev/null || stop "the CUDA toolkit is not installed: there is no nvcc."
    nvidia-smi -L 2>/dev/null | grep -q GPU || stop "this machine has no NVIDIA GPU, or no driver for it."
    need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev catch2 libbenchmark-dev
else
    need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev catch2 libcgal-dev libassimp-dev libcli11-dev \
        libbenchmark-dev git
fi

cmake --preset $preset
cmake --build --preset $preset
ctest --preset $preset --parallel "$(nproc)" "$@"

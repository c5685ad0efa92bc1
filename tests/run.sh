#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs what the tests need, builds them and passes them all: bash tests/run.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh

need_packages g++ cmake ninja-build libeigen3-dev libxsimd-dev catch2 libcgal-dev libassimp-dev libcli11-dev libbenchmark-dev git

cmake --preset release
cmake --build --preset release
ctest --preset release --parallel "$(nproc)" "$@"

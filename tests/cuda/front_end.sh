#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# front_end.sh NVCC FILE FLAG...: lets the front end of nvcc check a file, in a tenth of the time that it takes to compile it:
# types and all that it instantiates. That device code calls what is for the host alone is seen by a whole compilation only.
set -euo pipefail
nvcc=$1 file=$2
shift 2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
unit=$scratch/$(basename "${file%.*}").cu
echo "#include \"$file\"" >"$unit"
# what nvcc would do, as far as its front end: of the commands that it prints the first one and the next
commands=$(cd "$scratch" && "$nvcc" "$@" -std=c++20 --keep --dryrun -gencode arch=compute_90,code=compute_90 -c "$unit" 2>&1 |
    sed -n 's/^#\$ \(\(gcc\|g++\|cudafe++\) .*\)/\1/p' | sed -n 1,2p)
[[ $commands == *cudafe++* ]] || { echo "nvcc --dryrun did not say how it calls its front end:" >&2; echo "$commands" >&2; exit 1; }
cd "$scratch"
PATH=$(dirname "$(readlink -f "$(command -v "$nvcc")")"):$PATH
eval "$commands"

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# Sets the machine up, builds an example, runs it and renders it:
#
#     bash examples/run.sh [--scene NAME] [arguments of the example]
#
#   --scene NAME   snow_on_moving_ball (default) or torus_against_wall
#   --out DIR      where the results go (default: out/NAME in the project)
#   --ranks N      on N processes, which MPI connects, each with its share of the threads; with --backend cuda each has
#                  a GPU of its own if NCCL is installed, or else they take them by turns
#   --help         this text and the example's own options
#
#   FIRN_NO_RENDER=1   in the environment: no pictures, and no Python
#   FIRN_RENDER="..."  in the environment: options of render.py, such as "--quality best --size 1920x1080"
#
# It installs Debian packages (as root or with sudo) and, for the pictures, Python packages from PyPI under build/.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

scene=snow_on_moving_ball out="" help="" ranks="" arguments=()
while [ $# -gt 0 ]; do
    case $1 in
        --scene) [ $# -ge 2 ] || stop "--scene needs a name."; scene=$2; shift ;;
        --scene=*) scene=${1#*=} ;;
        --out) [ $# -ge 2 ] || stop "--out needs a folder."; out=$2; shift ;;
        --out=*) out=${1#*=} ;;
        --ranks) [ $# -ge 2 ] || stop "--ranks needs a number."; ranks=$2; shift ;;
        --ranks=*) ranks=${1#*=} ;;
        --help | -h) help=yes ;;
        *) arguments+=("$1") ;;
    esac
    shift
done
[ -n "$out" ] || out="$root/out/$scene"
case $scene in
    snow_on_moving_ball | torus_against_wall) ;;
    *) stop "there is no scene '$scene': choose snow_on_moving_ball or torus_against_wall." ;;
esac
[[ $ranks =~ ^([1-9][0-9]*)?$ ]] || stop "--ranks needs a number above 0, not '$ranks'."
on_gpu=""
[[ " ${arguments[*]-} " != *" --backend"[\ =]"cuda "* ]] || on_gpu=yes
[ -z "$on_gpu" ] || [ -n "$help" ] || [[ $(nvidia-smi -L 2>/dev/null) == *GPU* ]] ||
    stop "this machine has no NVIDIA GPU, or no driver for it: leave out --backend cuda."
[ -z "$ranks" ] || [ -n "$on_gpu" ] || [[ " ${arguments[*]-} " != *" --backend"* ]] ||
    stop "--ranks knows no backend but cuda: leave out --backend for processors."
program_ends=${on_gpu:+_cuda}${ranks:+_ranks} # of its name
render=yes
[ -z "$help" ] && [ "${FIRN_NO_RENDER:-0}" != 1 ] || render=""

need_packages_of_examples "$render"
[ -z "$ranks" ] || need_packages libopenmpi-dev openmpi-bin
need_room 500 "$root"

echo "building: $root/build/examples"
# Builds the example that is run here, and meshes to try; for a GPU, which takes nvcc minutes, only if that is asked for.
# Without the CUDA toolkit there is no such target, and the example says so.
build_example() {
    local targets=(generate_meshes "$scene")
    cd "$root" && cmake --preset examples || return
    if [ -n "$on_gpu" ] && cmake --build --preset examples --target help | grep "^$scene$program_ends:" >/dev/null; then
        targets+=("$scene$program_ends")
    fi
    [ -z "$ranks" ] || [ -n "$on_gpu" ] || targets+=("${scene}_ranks")
    cmake --build --preset examples --target "${targets[@]}"
}
(build_example) || stop "the example could not be built."
program="$root/build/examples/examples/$scene"
[ -x "$program" ] || stop "the build left no program $program."

if [ -n "$help" ]; then
    sed -n '/^# Sets/,/^# It installs/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"
    echo
    exec "$program" --help
fi

[ $scene != snow_on_moving_ball ] || [ -n "$on_gpu" ] ||
    echo "with its defaults $scene takes about two minutes of two quiet cores"
echo "how long this run will take is said after its first frame"
run=("$program")
if [ -n "$ranks" ]; then
    [ -x "$program$program_ends" ] || stop "the example was not built for ranks with GPUs: CMake found no CUDA toolkit."
    cores=$(nproc)
    # Open MPI would bind each of a few processes to one core, whatever its threads
    run=(mpirun --bind-to none -n "$ranks" "$program$program_ends")
    if [ -n "$on_gpu" ]; then # the program has its backend already
        kept=() is_its_value=""
        for argument in "${arguments[@]}"; do
            [ "$argument" = --backend ] || [[ $argument == --backend=* ]] || [ -n "$is_its_value" ] || kept+=("$argument")
            is_its_value=""
            [ "$argument" != --backend ] || is_its_value=yes
        done
        arguments=("${kept[@]}")
    fi
    [[ " ${arguments[*]-} " == *" --threads"[\ =]* ]] || run+=(--threads $((cores > ranks ? cores / ranks : 1)))
    # in a container one is root, and may have fewer cores than ranks
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 \
        OMPI_MCA_btl_vader_single_copy_mechanism=none
fi
echo "running: ${run[*]} --out $out ${arguments[*]-}"
mkdir -p "$out" || stop "the folder $out cannot be made."
"${run[@]}" --out "$out" "${arguments[@]}" || stop "the example did not run to its end (exit code $?); bash examples/run.sh --help lists its options."

if [ -n "$render" ]; then
    need_renderer "$root"
    echo "rendering: $out"
    # shellcheck disable=SC2086 # several options
    "$root/build/venv/bin/python" "$root/examples/render.py" "$out" ${FIRN_RENDER:-} ||
        stop "the pictures failed; the frames of the simulation are in $out."
fi

echo
echo "results in $out"
for result in pictures video.mp4 report.json particles.pvd; do
    [ ! -e "$out/$result" ] || echo "  $out/$result"
done

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# Makes the pictures of examples/README.md anew: builds the small examples, runs them and renders their frames.
#
#     bash examples/pictures.sh [NAME...]     (default: all of them)
#
# Frames go to out/NAME, pictures to examples/pictures/NAME.png. It installs what examples/run.sh does.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "$root/examples/set_up.sh"

# which frames of each example are shown, and how: options of render.py
declare -A shown=(
    [sand_column]="--frames -1 --size 640x440"
    [dam_break]="--frames 8,16,24,32,40,48 --columns 2 --size 640x400"
    [jelly_cubes]="--frames 10 --size 640x400"
    [snowball_on_wedge]="--frames 9 --size 640x400"
    [snow_sand_water]="--frames 0,6,14,-1 --columns 2 --size 640x400"
    [waterfall]="--frames -1 --size 640x340"
    [own_material]="--frames 0,-1 --columns 2 --size 400x400"
    [ball_into_snow]="--frames 8 --size 640x400"
    [snow_on_mesh]="--frames 8 --size 600x360"
)
names=("$@")
[ $# -gt 0 ] || mapfile -t names < <(printf '%s\n' "${!shown[@]}" | sort)
for name in "${names[@]}"; do
    [ -n "${shown[$name]:-}" ] || stop "there is no picture of '$name': choose from $(printf '%s\n' "${!shown[@]}" | sort | xargs)."
done

need_packages_of_examples pictures
need_room 500 "$root"
(cd "$root" && cmake --preset examples && cmake --build --preset examples --target "${names[@]}") ||
    stop "the examples could not be built."
need_renderer "$root"

for name in "${names[@]}"; do
    out="$root/out/$name"
    "$root/build/examples/examples/$name" "$out" || stop "$name did not run to its end."
    folders=("$out")
    [ "$name" != sand_column ] || folders=("$out"/height_*)
    # shellcheck disable=SC2086 # several options
    "$root/build/venv/bin/python" "$root/examples/render.py" "${folders[@]}" ${shown[$name]} \
        --sheet "$root/examples/pictures/$name.png" || stop "the picture of $name failed; its frames are in $out."
done

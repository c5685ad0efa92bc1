#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# arguments_of_examples.sh PROGRAM...: examples refuse what they do not understand before they compute, with a sentence that
# names it, and with --backend go on in the program that was built for that backend.
set -euo pipefail
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

fail() { cat said; echo "$1"; exit 1; }

# refuses <words> <argument>...: the program fails, and these words are in what it says; it leaves no file
refuses() {
    local words=$1 files
    shift
    files=$(find . ! -name said)
    ! timeout 60 "./$name" "$@" >said 2>&1 || fail "$name takes: $*"
    grep -qF -- "$words" said || fail "$name $*: it does not say '$words'."
    [ "$(find . ! -name said)" = "$files" ] || fail "$name $*: it left files."
}

# Three sides of a tetrahedron.
printf '%s\n' 'v 0 0 0' 'v 1 0 0' 'v 0 1 0' 'v 0 0 1' 'f 1 3 2' 'f 1 2 4' 'f 1 4 3' >open.obj

for program in "$@"; do
    name=$(basename "$program")
    ln -s "$program" "$name"
    refuses vulkan --backend vulkan
    refuses --backend --backend
    refuses --backwards --backwards
    refuses "second folder" "first folder" "second folder"
    refuses "Build ${name}_cuda" --backend cuda
    refuses "found the CUDA toolkit" --backend=cuda
    timeout 60 "./$name" --help >said 2>&1 || fail "$name --help fails."
    grep -q -- --backend said || fail "$name --help does not say that there is a choice of backends."
    if grep -q -- --repair said; then
        grep -qE -- "--kernel .*quadratic" said || fail "$name --help does not say that the kernel is quadratic."
        grep -qE -- "--transfer .*mls" said || fail "$name --help does not say that the transfer is MLS."
        for other in "--kernel quadratic" "--transfer mls" "--flip 0.9"; do
            # shellcheck disable=SC2086 # an option and its value
            refuses "${other% *} contradicts --as-in-the-report" --as-in-the-report $other
        done
        refuses "--flip would be without effect: the transfer is mls" --flip 0.9
        refuses "--flip would be without effect: the transfer is apic" --transfer apic --flip 0.9
        refuses "--repair passes Repair::fill" --as-in-the-report --kernel cubic --transfer flip --flip 0.95 --mesh open.obj
        refuses "--repair passes Repair::fill" --mesh open.obj
    fi

    printf '%s\n' '#!/usr/bin/env bash' 'echo "goes on: $*"' >"${name}_cuda"
    chmod +x "${name}_cuda"
    timeout 60 "./$name" --backend cuda >said 2>&1 || fail "$name --backend cuda fails."
    [ "$(<said)" = "goes on: --backend cuda" ] || fail "$name --backend cuda does not go on in ${name}_cuda."
done

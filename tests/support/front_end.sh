#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Whether a file compiles: front_end.sh COMPILER [ARGUMENT]... The compiler's front end alone reads it, in half the time.
# The object is an empty file. Of nvcc it is the front end for the host's part.
set -euo pipefail
object="" dependencies=""
for ((i = 1; i < $#; ++i)); do
    next=$((i + 1))
    case ${!i} in
    -o) object=${!next} ;;
    -MF) dependencies=${!next} ;;
    esac
done
case $object in *.gch | *.pch) exec "$@" ;; esac # what is precompiled is read later
if [[ $(basename "$1") == nvcc* ]]; then
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    # what nvcc would do: of the commands that it prints those that preprocess for the host, and read what that gave
    commands=$("$@" --keep --keep-dir "$scratch" --dryrun 2>&1 |
        sed -n 's/^#\$ \(\(gcc\|g++\|cudafe++\) .*\)/\1/p' | grep -E '^cudafe\+\+ | -E .*\.cpp4\.ii"? *$')
    [[ $commands == *cudafe++* ]] || { echo "nvcc --dryrun did not say how it calls its front end:" >&2; echo "$commands" >&2; exit 1; }
    (PATH=$(dirname "$(readlink -f "$(command -v "$1")")"):$PATH && eval "$commands")
    [ -z "$dependencies" ] || # what was included: the preprocessor names it
        { echo "$object: \\"; sed -n 's/^# [0-9]* "\(\/[^"]*\)".*/ \1 \\/p' "$scratch"/*.cpp4.ii | sort -u; } >"$dependencies"
else
    "$@" -fsyntax-only
fi
[ -z "$object" ] || : >"$object"

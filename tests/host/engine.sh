#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The example of a host engine, as a project of its own: engine.sh SOURCE WORK [cmake arguments]
# Configures, builds and runs it, and looks at what it says. An interrupt ends it with its snow saved.
set -euo pipefail
source=$1 work=$2
shift 2
cmake=${CMAKE_COMMAND:-cmake}

fail() { cat "$work/said" 2>/dev/null || true; echo "FAILED: $*" >&2; exit 1; }
quietly() { "$@" >"$work/said" 2>&1 || fail "$*"; }

rm -rf "$work"
mkdir -p "$work"
if grep -nE '#include.*(firn|Eigen)' "$source"/examples/engine/{snow.hpp,main.cpp}; then fail "the engine sees Firn or Eigen"; fi
quietly "$cmake" -S "$source/examples/engine" -B "$work/build" -DENGINE_FIRN_SOURCE="$source" -DCMAKE_BUILD_TYPE=Soon \
    "-DCMAKE_CXX_FLAGS=-O0 -DNDEBUG -DFIRN_COMPILE_SOON -Wall -Wextra" "$@"
quietly "$cmake" --build "$work/build"
cd "$work"
quietly build/engine --as-fast-as-possible --frames 12 --cell 0.2
for sentence in 'a pause changes nothing: yes' 'the snow goes on after the pause: yes' 'what was saved is loaded: yes' \
    'after a load all goes on bit by bit as before: yes' "what is left belongs to the snowman: yes" 'no particle with the id 0'; do
    grep -qF "$sentence" said || fail "the engine does not say: $sentence"
done
build/engine --frames 1000000 --cell 0.2 --save interrupted.snow >said 2>&1 &
engine=$!
for _ in $(seq 60); do # until it listens
    sleep 0.5
    kill -INT "$engine" 2>/dev/null || break
done
wait "$engine" || fail "an interrupt is no clean end"
grep -qF 'interrupted, and saved in interrupted.snow' said || fail "an interrupt does not save"
[ -s interrupted.snow ] && [ ! -e interrupted.snow.part ] || fail "what was saved is not there"
echo "the engine builds on its own, plays, pauses, saves, loads and ends"

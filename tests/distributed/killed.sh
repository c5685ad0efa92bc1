#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# killed.sh MPIRUN PROGRAM: where one of two processes is killed, the run ends within 30 seconds and says so.
set -euo pipefail
mpirun=$1 program=$2
# in a container one is root, may have fewer cores than ranks, and no process reads another one's memory
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 \
    OMPI_MCA_btl_vader_single_copy_mechanism=none
said=$(mktemp)

# The numbers of the processes that run the program as it is started here.
ranks() {
    local of
    for of in /proc/[0-9]*; do
        [ "$(readlink "$of/exe" 2>/dev/null)" = "$(readlink -f "$program")" ] || continue
        [[ $(tr '\0' ' ' 2>/dev/null <"$of/cmdline") != *" forever "* ]] || basename "$of"
    done
}

"$mpirun" -n 2 "$program" forever >"$said" 2>&1 &
run=$!
trap 'kill $run 2>/dev/null || true; rm -f "$said"' EXIT
for _ in $(seq 100); do
    running=$(ranks)
    [ "$(wc -w <<<"$running")" -lt 2 ] || break
    sleep 0.1
done
[ "$(wc -w <<<"$running")" -eq 2 ] || { echo "there are no two processes: $running"; cat "$said"; exit 1; }
sleep 2 # they step by then
kill -9 "${running%%[[:space:]]*}"
for _ in $(seq 300); do
    kill -0 $run 2>/dev/null || break
    sleep 0.1
done
if kill -0 $run 2>/dev/null; then echo "the run goes on 30 s after a process was killed."; exit 1; fi
if wait $run; then echo "the run ended as if all were well."; exit 1; fi
grep -qi 'signal 9\|killed' "$said" || { echo "nothing says that a process was killed:"; cat "$said"; exit 1; }
echo "the run ended, and says that a process was killed."

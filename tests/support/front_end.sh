#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Whether a file compiles: front_end.sh COMPILER [ARGUMENT]... The compiler's front end alone reads it, in half the time.
# The object is an empty file.
set -euo pipefail
"$@" -fsyntax-only
while [ $# -gt 1 ]; do
    [ "$1" != -o ] || : >"$2"
    shift
done

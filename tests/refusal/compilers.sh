#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# compilers.sh COMPILER SOURCE: what cannot compile the library is told so by the first line that the compiler prints.
set -euo pipefail
compiler=$1 source=$2

# refuses <sentence> <flag>...: the compiler, with these flags, is refused by an #error that says so
refuses() {
    local sentence=$1 said
    shift
    ! said=$("$compiler" -fsyntax-only -I"$source/include" "$@" -x c++ "$source/include/firn/core/error.hpp" 2>&1) ||
        { echo "this compiles: $*"; exit 1; }
    said=$(grep -m 1 '#error' <<<"$said")
    [[ $said == *"#error"*"$sentence"* || $said == *"error: "*"$sentence"* ]] || { echo "$*: $said"; exit 1; }
}

refuses "throws errors, which -fno-exceptions forbids" -std=c++20 -fno-exceptions
refuses "written in C++20" -std=c++17
# another compiler, as the headers see it
refuses "this g++ is too old" -std=c++20 -U__clang__ -U__GNUC__ -D__GNUC__=11 -w
refuses "MSVC is not supported" -std=c++20 -U__clang__ -D_MSC_VER=1940
"$compiler" -fsyntax-only -w -std=c++20 -I"$source/include" -D_MSC_VER=1940 -DFIRN_ANY_COMPILER -x c++ \
    "$source/include/firn/core/error.hpp" || { echo "FIRN_ANY_COMPILER does not lift it"; exit 1; }

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs doxygen and builds the reference of the API in build/doc/html. A warning stops it, and so does a class,
# a function or a type of a namespace that has no comment:
#     bash .github/doc.sh
# With --undocumented: lists the members of classes that have none.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source examples/set_up.sh

# undocumented: all warnings of what has no comment.
undocumented() {
    { cat .github/Doxyfile && printf '%s\n' GENERATE_HTML=NO WARN_AS_ERROR=NO WARN_IF_UNDOCUMENTED=YES; } |
        doxygen - 2>&1 | sed "s|^$PWD/||"
}

need_packages doxygen
FIRN_VERSION=$(awk '/^#define FIRN_VERSION_/ { printf "%s%s", dot, $3; dot = "." }' include/firn/version.hpp)
export FIRN_VERSION
mkdir -p build/doc
[ "${1:-}" != --undocumented ] || { undocumented; exit; }
if undocumented | grep -E 'Compound|\((function|typedef|enumeration)\) of namespace'; then
    stop "the reference lacks these."
fi
doxygen .github/Doxyfile
echo "the reference is in build/doc/html/index.html"

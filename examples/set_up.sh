# SPDX-License-Identifier: MIT
# Sourced by examples/run.sh and tests/run.sh: installs what a fresh Debian 12 or Ubuntu 24.04 lacks, and says so.

stop() { echo "stop: $*" >&2; exit 1; }

# need_packages <package>...: installs the Debian packages that are missing, as root or with sudo.
need_packages() {
    command -v dpkg-query >/dev/null && command -v apt-get >/dev/null ||
        stop "this script installs packages with apt-get (Debian 12, Ubuntu 24.04). Elsewhere install by hand: $*"
    local missing=() package
    for package in "$@"; do
        dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && { echo "packages: all of them are installed ($*)"; return; }
    echo "packages: installing ${missing[*]}"
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || stop "root or sudo is needed to install: ${missing[*]}"
        as_root=(sudo)
    fi
    "${as_root[@]}" apt-get update -qq || stop "apt-get update failed: is there a network?"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
        stop "apt-get could not install: ${missing[*]}"
}

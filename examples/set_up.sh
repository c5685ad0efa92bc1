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
        # asks for the password now, if there is a terminal
        sudo -n true 2>/dev/null || { [ -t 0 ] && command -v sudo >/dev/null && sudo -v; } ||
            stop "root or sudo is needed to install: ${missing[*]}"
        as_root=(sudo)
    fi
    local patience=(-o DPkg::Lock::Timeout=120) # another installation may be running
    "${as_root[@]}" apt-get "${patience[@]}" update -qq || stop "apt-get update failed: is there a network?"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get "${patience[@]}" install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
        stop "apt-get could not install: ${missing[*]}"
}

# need_room <megabytes> <folder>: stops unless that much is free where the folder is.
need_room() {
    local free
    free=$(df -Pm "$2" | awk 'NR == 2 { print $4 }')
    [ "$free" -ge "$1" ] || stop "$1 MB of disk are needed at $2, and $free MB are free."
}

# need_python <folder> <requirement>...: a virtual environment in that folder with these packages from PyPI.
need_python() {
    local folder=$1 log
    shift
    if [ -x "$folder/bin/python" ] && [ "$(cat "$folder/installed" 2>/dev/null)" = "$*" ]; then
        echo "python: $folder has what is needed ($*)"
        return
    fi
    echo "python: installing $* from PyPI into $folder (about 600 MB)"
    need_room 800 "$(dirname "$folder")"
    python3 -m venv --clear "$folder" >/dev/null || stop "python3 -m venv failed: is the package python3-venv installed?"
    log="$folder/pip.log"
    "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$@" >"$log" 2>&1 || {
        tail -n 5 "$log" >&2
        stop "pip could not install $*: is there a network, and are its certificates trusted? (all of its output: $log)
FIRN_NO_RENDER=1 runs the example without pictures and without Python."
    }
    echo "$*" >"$folder/installed"
}

# need_packages_of_examples [pictures]: what all examples are built with and, if asked, drawn with.
need_packages_of_examples() {
    local packages=(g++ cmake ninja-build libeigen3-dev libxsimd-dev libcgal-dev libassimp-dev libcli11-dev)
    # Python, and what VTK draws with where there is no screen
    [ -z "${1:-}" ] || packages+=(python3 python3-venv libegl1 libgl1 libgl1-mesa-dri)
    need_packages "${packages[@]}"
}

# need_renderer <project>: the virtual environment of render.py under the project's build/.
need_renderer() {
    need_python "$1/build/venv" 'pyvista>=0.44,<1' 'vtk>=9.3,<10' 'matplotlib>=3.7,<4' 'numpy>=1.26,<3' 'pillow>=10' \
        'imageio>=2.34,<3' 'imageio-ffmpeg>=0.5,<1'
}

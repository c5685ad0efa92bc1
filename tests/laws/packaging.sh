#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# One way for a host project to take firn: packaging.sh CASE SOURCE WORK COMPONENTS [cmake arguments]
# CASE: installed, subdirectory, fetched, untouched, missing, names, by_hand. COMPONENTS: those that can be had here, separated by ;
set -euo pipefail
case=$1 source=$2 work=$3 components=$4
shift 4
cmake=${CMAKE_COMMAND:-cmake}

fail() { echo "FAILED: $*" >&2; exit 1; }
quietly() { "$@" >"$work/log" 2>&1 || { cat "$work/log" >&2; fail "$*"; }; }

# expect <sentence> <command>...: the command fails and says so, in whatever lines.
expect() {
    local sentence=$1 said
    shift
    if "$@" >"$work/log" 2>&1; then fail "this should have been refused: $*"; fi
    said=$(tr -s ' \n' '  ' <"$work/log")
    [[ $said == *"$sentence"* ]] || { cat "$work/log" >&2; fail "the message lacks: $sentence"; }
    echo "refused as it should be: $sentence"
}

install_firn() { # install_firn <prefix> [cmake arguments]: as a packager would, into an empty prefix
    local prefix=$1
    shift
    quietly "$cmake" -S "$source" -B "$prefix-build" -DFIRN_BUILD_TESTS=OFF -DFIRN_BUILD_EXAMPLES=OFF "$@"
    quietly "$cmake" --install "$prefix-build" --prefix "$prefix"
}

host() { # host <way> [cmake arguments]: configures the host project
    local way=$1
    shift
    "$cmake" -S "$source/tests/host" -B "$work/host" -DHOST_TAKES_FIRN="$way" -DHOST_FIRN_SOURCE="$source" "$@"
}

build_and_run() {
    quietly "$cmake" --build "$work/host"
    quietly "$work/host/host"
    echo "the host project builds and runs with: ${components//;/ }"
}

rm -rf "$work"
mkdir -p "$work"
own=(-DCMAKE_BUILD_TYPE=Debug "-DHOST_COMPONENTS=$components")
case $case in
    installed)
        install_firn "$work/prefix" "$@"
        mv "$work/prefix" "$work/moved" # an installation can be moved
        quietly host installed "${own[@]}" -DCMAKE_PREFIX_PATH="$work/moved" "$@"
        build_and_run
        ;;
    subdirectory | fetched)
        quietly host "$case" "${own[@]}" "$@"
        # what is fetched is a subdirectory, of which the host is built: once is enough, unless all is asked for
        [[ $case = fetched && ${FIRN_TESTS_ALL:-OFF} = OFF ]] || build_and_run
        quietly "$cmake" --install "$work/host" --prefix "$work/installed"
        [ -z "$(find "$work/installed" -name '*firn*' 2>/dev/null)" ] || fail "what the host installs has Firn in it"
        ;;
    untouched)
        install_firn "$work/prefix" "$@"
        for way in installed subdirectory fetched; do
            for type in "" RelWithDebInfo; do
                rm -rf "$work/host"
                quietly host "$way" -DHOST_STAYS_AS_IT_IS=ON -DCMAKE_BUILD_TYPE="$type" "-DHOST_COMPONENTS=$components" \
                    -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_CXX_FLAGS=-DHOST_FLAG -DCMAKE_CUDA_ARCHITECTURES=90 \
                    -DCMAKE_EXPORT_COMPILE_COMMANDS=ON "$@"
                if grep -E -- '-march|-mtune|-W[a-z]|-fsanitize|-ffast' "$work/host/compile_commands.json"; then
                    fail "firn's own flags reached the host project ($way)"
                fi
            done
        done
        echo "build type, flags, architectures and directories of the host are what they were, in all three ways"
        ;;
    missing)
        install_firn "$work/prefix" -DFIRN_WITH_SAMPLING=OFF -DFIRN_WITH_IO=OFF "$@"
        for component in sampling io no_such_thing; do
            rm -rf "$work/host"
            expect "firn: the component '$component' is unavailable: it was not installed (this installation has: firn" \
                host installed -DHOST_COMPONENTS="$component" -DCMAKE_PREFIX_PATH="$work/prefix" "$@"
        done
        rm -rf "$work/host"
        expect "firn: FIRN_WITH_IO is ON, but assimp 5 was not found. Install it or set FIRN_WITH_IO=OFF." \
            host subdirectory -DFIRN_WITH_IO=ON -DCMAKE_DISABLE_FIND_PACKAGE_assimp=ON "$@"
        rm -rf "$work/host"
        expect "firn: FIRN_WITH_SAMPLING is ON, but CGAL 5.4 or newer was not found." \
            host fetched -DFIRN_WITH_SAMPLING=ON -DCMAKE_DISABLE_FIND_PACKAGE_CGAL=ON "$@"
        if [[ ";$components;" == *";io;"* ]]; then # installed with it, used where its package is gone
            install_firn "$work/with_io" "$@"
            rm -rf "$work/host"
            expect "firn: the component 'io' is unavailable: assimp was not found." \
                host installed -DHOST_COMPONENTS=io -DCMAKE_PREFIX_PATH="$work/with_io" \
                -DCMAKE_DISABLE_FIND_PACKAGE_assimp=ON "$@"
        fi
        ;;
    names) # of components: in whatever case, and what comes when none is named
        install_firn "$work/prefix" "$@"
        prefix=(-DCMAKE_PREFIX_PATH="$work/prefix")
        quietly host installed "-DHOST_COMPONENTS=${components^^}" "${prefix[@]}" "$@"
        rm -rf "$work/host"
        quietly host installed "-DHOST_EXPECTS=$components" "${prefix[@]}" "$@"
        if [[ ";$components;" == *";io;"* ]]; then # its package is missing: left out, with a message unless QUIET
            rm -rf "$work/host"
            gone=(-DCMAKE_DISABLE_FIND_PACKAGE_assimp=ON "${prefix[@]}")
            quietly host installed "-DHOST_EXPECTS=$(sed 's/;\?\<io\>//' <<<"$components")" "${gone[@]}" "$@"
            grep -q "firn: the component io is left out: assimp was not found." "$work/log" || fail "nothing is said of io"
            rm -rf "$work/host"
            quietly host installed -DHOST_IS_QUIET=ON "${gone[@]}" "$@"
            ! grep "firn: the component" "$work/log" || fail "QUIET is not quiet"
        fi
        echo "components have their names in any case, and all of them come unless some are named"
        ;;
    by_hand) # the lines in examples/README.md that begin with g++ -std, with the host's program
        for tool in g++ pkg-config; do
            command -v "$tool" >/dev/null || { echo "skipped: there is no $tool"; exit 77; }
        done
        for component in openmp sampling io; do
            [[ ";$components;" == *";$component;"* ]] || { echo "skipped: there is no $component"; exit 77; }
        done
        install_firn "$work/prefix" "$@"
        mv "$work/prefix" "$work/P" # an installation can be moved
        cd "$work"
        ln -s "$source" firn
        { echo '#define HOST_HAS_IO'; cat "$source/tests/host/main.cpp"; } >meshes.cpp
        { echo '#define HOST_HAS_OPENMP'; cat "$source/tests/host/main.cpp"; } >engine.cpp
        count=0
        while read -r line; do
            rm -f engine meshes
            PKG_CONFIG_PATH=$work/P/share/pkgconfig bash -euc "${line/-O3/-O0}" >log 2>&1 || { cat log; fail "$line"; }
            [ ! -x engine ] || quietly ./engine
            [ ! -x meshes ] || quietly ./meshes
            count=$((count + 1))
        done < <(grep '^g++ -std' "$source/examples/README.md")
        [ "$count" -ge 4 ] || fail "examples/README.md has $count lines for g++, and not four"
        export PKG_CONFIG_PATH=$work/P/share/pkgconfig
        version=$(printf '#include <firn/version.hpp>\nFIRN_VERSION_MAJOR.FIRN_VERSION_MINOR.FIRN_VERSION_PATCH' |
            g++ -E -P $(pkg-config --cflags firn) -x c++ - | tr -d ' \n')
        [ "$version" = "$(pkg-config --modversion firn)" ] || fail "pkg-config and the header have other versions: $version"
        if [[ ";$components;" == *";cuda;"* ]]; then
            flags=$(pkg-config --cflags firn-cuda)
            [[ $flags == *--expt-relaxed-constexpr* && $flags == *"$work/P"* ]] || fail "firn-cuda has the flags: $flags"
        fi
        echo "the lines for g++ in examples/README.md compile, $count of them"
        ;;
    *) fail "there is no case '$case'" ;;
esac
rm -rf "$work"

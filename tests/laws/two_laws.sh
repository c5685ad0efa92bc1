#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The laws of the house: two_laws.sh LAW FOLDER. Prints what breaks one and exits with 1; with 77 where it cannot be judged.
# LAW: no_threads, no_physics, top_level, headers, format, quotes; can_fail breaks each of them in a copy.
set -euo pipefail
law=$1 folder=$2
self=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/two_laws.sh
cd "$folder"

# grep_code <perl pattern> <folder> [left out]: where the code, comments aside, matches.
grep_code() {
    find "$2" -type f \( -name '*.hpp' -o -name '*.cuh' -o -name '*.h' -o -name '*.cpp' -o -name '*.cu' \) \
        ! -path "${3:-none}" -print0 | sort -z | xargs -0 -r perl -e '
        my ($pattern, $found) = (shift, 0);
        for my $file (@ARGV) {
            open my $in, "<", $file or die "$file: $!";
            my $code = do { local $/; <$in> };
            $code =~ s{("(?:\\.|[^"\\\n])*")|//[^\n]*|/\*.*?\*/}{ defined $1 ? $1 : "\n" x ($& =~ tr/\n//) }gse;
            my $number = 0;
            for my $line (split /\n/, $code) {
                ++$number;
                next unless $line =~ /$pattern/;
                print "$file:$number: $line\n";
                $found = 1;
            }
        }
        exit $found' "$1"
}

case $law in
    no_threads)
        # `omp` on its own or at the start of a name: not computed, not component
        words='(?i:cuda|xsimd|openmp|(?<![a-z])omp(?![a-z]))|__(?:global|shared|device|host)__|threadIdx|blockIdx'
        words+='|(?<![a-z])(?:[Ww]arp|[Aa]tomic)(?!ed)|std::j?thread|<(?:thread|mutex|omp\.h)>'
        grep_code "$words" include include/firn/core/host_device.hpp ||
            { echo "include/ knows of threads."; exit 1; }
        ;;
    no_physics)
        stems='particle|mass|stress|velocit|momentum'
        grep_code "(?i:(?<![a-z])(?:$stems))|[a-z](?:Particle|Mass|Stress|Velocit|Momentum)" backends ||
            { echo "backends/ knows of physics."; exit 1; }
        ;;
    top_level)
        allowed='CMakeLists.txt include backends examples tests bench README.md LICENSE CMakePresets.json'
        if [ -e .git ]; then
            there=$(git -c safe.directory='*' ls-files | cut -d/ -f1 | sort -u)
        else
            there=$(find . -mindepth 1 -maxdepth 1 ! -name build ! -name out -printf '%f\n')
        fi
        broken=0
        for name in $there; do
            [[ $name == .* || " $allowed " == *" $name "* ]] || { echo "top level: $name does not belong there."; broken=1; }
        done
        for name in ${allowed/ bench/}; do
            grep -qxF "$name" <<<"$there" || { echo "top level: $name is missing."; broken=1; }
        done
        exit $broken
        ;;
    headers)
        broken=0
        while IFS= read -r -d '' header; do
            head -n 1 "$header" | grep -q '^// SPDX-License-Identifier: ' || { echo "$header: the first line names no licence."; broken=1; }
            grep -qx '#pragma once' "$header" || { echo "$header: no #pragma once."; broken=1; }
        done < <(find include backends examples tests -name '*.hpp' -print0)
        exit $broken
        ;;
    format)
        version=$(clang-format --version 2>/dev/null | grep -oE '[0-9]+' | head -n 1) || true
        [ "${version:-0}" -ge 14 ] || { echo "clang-format 14 or newer is not installed."; exit 77; }
        find include backends examples tests -type f \( -name '*.hpp' -o -name '*.cpp' -o -name '*.cu' -o -name '*.cuh' \) -print0 |
            xargs -0 -r clang-format --dry-run --Werror
        ;;
    quotes)
        # from the first line of their code on, these are what the guides show
        for quoted in soft_foam:models rising_wind:effects; do
            header=examples/${quoted%:*}.hpp guide=include/firn/${quoted#*:}/README.md
            code=$(sed -n '/^\(template\|struct\)/,$p' "$header")
            [ -n "$code" ] && [[ $(<"$guide") == *$'\n```cpp\n'"$code"$'\n```\n'* ]] ||
                { echo "$guide shows other code than $header."; exit 1; }
        done
        ;;
    can_fail)
        copy=$(mktemp -d)
        trap 'rm -rf "$copy"' EXIT
        # breaks <law> <file> <text>: a small house that obeys all laws obeys this one no more with the text in that file
        breaks() {
            local law=$1 file=$2 text=$3 name
            rm -rf "${copy:?}"/*
            mkdir -p "$copy"/{include/firn/{core,models,effects},backends/openmp,examples,tests}
            for name in CMakeLists.txt README.md LICENSE CMakePresets.json; do touch "$copy/$name"; done
            cp .clang-format "$copy/"
            for name in include/firn/core/host_device.hpp include/firn/lawful.hpp backends/openmp/lawful.hpp examples/lawful.hpp \
                tests/lawful.hpp; do
                printf '%s\n' '// SPDX-License-Identifier: MIT' '#pragma once' '' '// omp, atomic: mass' 'int computed_component;' >"$copy/$name"
            done
            printf '%s\n' '// SPDX-License-Identifier: MIT' '#pragma once' '' 'template <class T>' 'struct Foam;' >"$copy/examples/soft_foam.hpp"
            printf '%s\n' '// SPDX-License-Identifier: MIT' '#pragma once' '' 'struct Wind;' >"$copy/examples/rising_wind.hpp"
            printf '%s\n' 'Text.' '' '```cpp' 'template <class T>' 'struct Foam;' '```' 'Text.' >"$copy/include/firn/models/README.md"
            printf '%s\n' 'Text.' '```cpp' 'struct Wind;' '```' 'Text.' >"$copy/include/firn/effects/README.md"
            bash "$self" "$law" "$copy" >/dev/null || { echo "$law refuses a lawful house."; exit 1; }
            mkdir -p "$(dirname "$copy/$file")"
            printf '%s\n' "$text" >>"$copy/$file"
            if bash "$self" "$law" "$copy" >/dev/null 2>&1; then echo "$law does not see: $text in $file"; exit 1; fi
        }
        for text in '#include <cuda_runtime.h>' '#pragma omp parallel' 'int omp_x;' '__global__ void f();' '__shared__ int x;' \
            '#ifdef __CUDA_ARCH__' 'int i = threadIdx.x;' 'int warp_size;' '#include <atomic>' 'void atomicAdd();' \
            '#include <xsimd/xsimd.hpp>' 'std::thread t;' '#include <firn/openmp.hpp>' 'f("/*"); int atomic_x; /* */'; do
            breaks no_threads include/firn/lawful.hpp "$text"
        done
        for text in 'int particle;' 'int node_mass;' 'int NodeMass;' 'float stresses[3];' 'int velocities;' 'int Momentum;'; do
            breaks no_physics backends/openmp/lawful.hpp "$text"
        done
        breaks top_level docs/README.md 'one more folder'
        breaks top_level CMakeCache.txt 'a stray file'
        breaks headers include/firn/late.hpp '#pragma once'
        breaks headers tests/late.hpp '// SPDX-License-Identifier: MIT'
        breaks quotes examples/soft_foam.hpp 'int more;'
        breaks quotes examples/rising_wind.hpp 'int more;'
        if command -v clang-format >/dev/null; then breaks format examples/lawful.hpp 'int  x ;'; fi
        echo "each law can be broken and says so"
        ;;
    *) echo "there is no law '$law'"; exit 2 ;;
esac

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# programs.sh FOLDER COMPILER [flags]: compiles every whole program of the guides, which is each block of C++ that has a main.
# Names the first that does not compile and exits with 1. With FIRN_HAS_MPI in the environment, those that include MPI, too.
set -euo pipefail
folder=$1
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$folder"
find README.md include backends examples -name '*.md' -print0 | sort -z | xargs -0 -r perl -e '
    my $work = shift;
    my %units;
    for my $file (@ARGV) {
        open my $in, "<", $file or die "$file: $!";
        my $text = do { local $/; <$in> };
        while ($text =~ /^```cpp\n(.*?)^```$/gms) {
            my ($program, $line) = ($1, 2 + (substr($text, 0, $-[0]) =~ tr/\n//));
            next unless $program =~ /^int main\(/m;
            next if $program =~ m{<firn/mpi\.hpp>} && ! $ENV{FIRN_HAS_MPI}; # it needs what is not here
            (my $name = "$file-$line") =~ s{[/.-]}{_}g;
            open my $out, ">", "$work/$name.cpp" or die;
            print $out "#line $line \"$file\"\n$program";
            # those that include the same are one unit, each in a namespace of its own
            my $includes = join "", sort $program =~ /^#include .*\n/gm;
            $program =~ s/^#include .*//gm;
            $program =~ s/^(int main\(.*?)^\}/$1return 0; }/ms; # which main alone may leave out
            push @{$units{$includes}}, ["$work/$name.cpp", "namespace $name\n{\n#line $line \"$file\"\n$program}\n"];
        }
    }
    my $count = 0;
    for my $includes (sort keys %units) {
        my @programs = @{$units{$includes}};
        open my $out, ">", "$work/" . ++$count . ".unit" or die;
        print $out "// program $_->[0]\n" for @programs;
        print $out $includes, map { $_->[1] } @programs;
    }' "$work"
# What a program includes itself is read once for all of them: that hides no include that one lacks.
read_once=$work/library.hpp
printf '#include <firn/%s.hpp>\n' firn openmp >"$read_once"
header=()
for argument in "$@"; do [ "$argument" = -fsyntax-only ] || header+=("$argument"); done
"${header[@]}" -x c++-header "$read_once" -o "$read_once.gch" 2>/dev/null || read_once=

# read_once_for <file>: sets `flags`
read_once_for() {
    flags=()
    if [ -n "$read_once" ] && grep -q '^#include <firn/firn.hpp>' "$1" && grep -q '^#include <firn/openmp.hpp>' "$1"; then
        flags=(-include "$read_once")
    fi
}
# compiles <file>: a program, or several
compiles() {
    local flags
    read_once_for "$1"
    "${compiler[@]}" "${flags[@]}" -x c++ "$1"
}
# reads <file>: the compiler knows all names in a unit. It ends at an error behind the last line, before it compiles
# templates, which takes most of its time.
reads() {
    local flags said
    read_once_for "$1"
    { cat "$1" && echo 'static_assert(false, "read to the end");'; } >"$work/read.cpp"
    said=$("${compiler[@]}" "${flags[@]}" -Wfatal-errors -x c++ "$work/read.cpp" 2>&1 || true)
    [[ $said == *"read to the end"* ]] || { echo "$said"; return 1; }
}
compiler=("$@")
units=("$work"/*.unit)
[ -e "${units[0]}" ] || units=()
mapfile -t programs < <(cat "${units[@]}" </dev/null | sed -n 's,^// program ,,p')
[ "${#programs[@]}" -ge 5 ] || { echo "the guides have ${#programs[@]} whole programs, and not five"; exit 1; }
# Each by its own includes is read, and all of them together are compiled.
together=$work/together.cpp
{ cat "${units[@]}" | grep '^#include ' | sort -u && cat "${units[@]}" | grep -v '^#include '; } >"$together"
good=yes
for unit in "${units[@]}"; do reads "$unit" || good=no; done
[ $good = no ] || compiles "$together" || good=no
if [ $good = no ]; then
    for program in "${programs[@]}"; do
        compiles "$program" 2>/dev/null ||
            { echo "this program of the guides does not compile: $(sed -n '1s/#line //p' "$program")"; exit 1; }
    done
    echo "programs of the guides compile each by itself, and not one behind the other: ${programs[*]}"
    exit 1
fi
echo "the guides' programs compile, ${#programs[@]} of them"

#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# programs.sh FOLDER COMPILER [flags]: compiles every whole program of the guides, which is each block of C++ that has a main.
# Names the first that does not compile and exits with 1.
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

# compiles <file>: a unit or a program
compiles() {
    local flags=()
    if [ -n "$read_once" ] && grep -q '^#include <firn/firn.hpp>' "$1" && grep -q '^#include <firn/openmp.hpp>' "$1"; then
        flags=(-include "$read_once")
    fi
    "${compiler[@]}" "${flags[@]}" -x c++ "$1"
}
compiler=("$@")
count=0
for unit in "$work"/*.unit; do
    [ -e "$unit" ] || break
    mapfile -t programs < <(sed -n 's,^// program ,,p' "$unit")
    count=$((count + ${#programs[@]}))
    compiles "$unit" && continue
    for program in "${programs[@]}"; do
        compiles "$program" 2>/dev/null ||
            { echo "this program of the guides does not compile: $(sed -n '1s/#line //p' "$program")"; exit 1; }
    done
    echo "programs of the guides compile each by itself, and not one behind the other: ${programs[*]}"
    exit 1
done
[ "$count" -ge 5 ] || { echo "the guides have $count whole programs, and not five"; exit 1; }
echo "the guides' programs compile, $count of them"

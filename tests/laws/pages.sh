#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Pages for readers: pages.sh LAW FOLDER. Prints what breaks a law and exits with 1; with 77 where it cannot be judged.
# LAW: figures (the tables of bench/README.md and the guides are those of bench/results), results (what benchmarks write becomes rows),
# lines (of Markdown are short), links (of Markdown lead to files), rows (the guides' tables of policies have
# those of the library's lists, and that of report.json its keys); can_fail breaks some of them in a copy.
set -euo pipefail
law=$1 folder=$2
self=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/pages.sh
cd "$folder"

need_python() {
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 9))' 2>/dev/null || { echo "there is no python3 of 3.9 or newer."; exit 77; }
    export PYTHONDONTWRITEBYTECODE=1
}

pages() { # all that are tracked, with a 0 behind each
    if [ -e .git ]; then
        git -c safe.directory='*' ls-files -z '*.md'
    else
        find . \( -name build -o -name out \) -prune -o -name '*.md' -printf '%P\0' | sort -z
    fi
}

case $law in
    figures)
        need_python
        python3 bench/tables.py --check
        ;;
    results)
        need_python
        work=$(mktemp -d)
        trap 'rm -rf "$work"' EXIT
        fail() { echo "FAILED: $*"; exit 1; }
        cp bench/results/machines.csv "$work/"
        cat >"$work/bench.json" <<'JSON'
{"context": {"date": "2026-01-02T03:04:05+00:00", "threads": "2"},
 "benchmarks": [
  {"name": "step/openmp/snow/cubic/mls/float/random/1000", "run_name": "step/openmp/snow/cubic/mls/float/random/1000",
   "run_type": "iteration", "real_time": 1.0, "time_unit": "ms", "particle_steps_per_second": 1.0e7,
   "per_second_of_user_time": 6.0e6, "memory_per_particle": 150.4},
  {"name": "step/openmp/snow/cubic/mls/float/random/1000", "run_name": "step/openmp/snow/cubic/mls/float/random/1000",
   "run_type": "iteration", "real_time": 1.0, "time_unit": "ms", "particle_steps_per_second": 1.2e7,
   "per_second_of_user_time": 6.0e6, "memory_per_particle": 150.4},
  {"name": "step/openmp/snow/cubic/mls/float/random/1000_mean", "run_name": "step/openmp/snow/cubic/mls/float/random/1000",
   "run_type": "aggregate", "real_time": 1.0, "time_unit": "ms", "particle_steps_per_second": 1.1e7},
  {"name": "step/openmp/sand/cubic/mls/float/random/1000", "error_occurred": true, "error_message": "failed"},
  {"name": "compile/minimal_host/iterations:1/real_time", "run_type": "iteration", "real_time": 6.5, "time_unit": "s"}]}
JSON
        cat >"$work/bench_cuda.json" <<'JSON'
{"context": {"date": "2026-01-02T03:04:05+00:00"},
 "benchmarks": [{"name": "step/cuda/snow/cubic/mls/float/random/1000/iterations:25/real_time", "run_type": "iteration",
  "real_time": 1.0, "time_unit": "ms", "particle_steps_per_second": 4.5e9, "ms_per_step": 0.0265}]}
JSON
        {
            echo "problem,backend,model,kernel,transfer,precision,cfl_fraction,cells,ppc,deterministic,error,seconds,particle_steps,bytes_per_particle,status,spread,cpu_seconds,runs,steps,rejected,threads,hardware,compiler,commit,date,energy_lost,acts_on"
            echo "P1,openmp,neo_hookean,cubic,mls,float,0.9,16,4,yes,0.0092,0.002,1e5,100,ok,0.031,0.00086,5,30,0,1,a,b,1234567,2026-01-03,,"
            echo "P1,openmp,neo_hookean,cubic,mls,float,0.9,32,4,yes,nan,0,0,100,it failed,0,0,5,30,0,1,a,b,1234567,2026-01-03,,"
            echo "P8,openmp,fluid,cubic,mls,float,0.9,8,4,yes,0.02,0.002,1e5,100,ok,0.031,0.25,5,30,0,1,a,b,1234567,2026-01-03,,nodes"
        } >"$work/errors.csv.new"
        {
            echo "problem,backend,kernel,cells,error,seconds,status,spread,cpu_seconds,runs,threads,commit,date"
            echo "P1,taichi,cubic,16,0.0092,0.004,ok,0.1,0.005,5,2,,2026-01-03"
            echo "P1,taichi_private,cubic,16,0.0092,0.003,ok,0.2,0.005,5,2,,2026-01-03"
            echo "P1,warp,cubic,16,0.0092,0.002,ok,0.2,0.005,5,1,,2026-01-03"
        } >"$work/waves.csv.new"
        cat >"$work/peers.json" <<'JSON'
{"date": "2026-01-04", "threads": 2, "rounds": 3, "cases": [{"case": "snow_packed",
 "programs": [{"program": "firn", "threads": 1, "user_ns": 50, "user_ns_range": [45, 55], "wall_ns": 51, "wall_ns_range": [45, 55]}],
 "summary": {"wall_best": {"peer": "warp", "ratio": 8.25}}}]}
JSON
        {
            echo "busy  particles  calls/frame  one [M/s]  default [M/s]  default/one (least, median, most)  processors"
            echo "   1       2197           16       4.90           4.75   0.91   0.97   1.03                     1.02"
        } >"$work/busy.txt"
        {
            echo "material   kernel      cells  particles  steps/frame  median [ms]  slowest [ms]"
            echo "snow       cubic          16      32768     14.9    40.53    47.94"
        } >"$work/real_time.txt"
        {
            echo "figure obstacles/step/list_of_2 1.2345 ms 0.021"
            echo "figure obstacles/step/list_of_2_over_two 1.0123 x"
        } >"$work/obstacles.txt"
        python3 bench/results.py --machine h200 --commit abcdef0 --date 2026-01-05 --results "$work" \
            "$work"/{bench.json,bench_cuda.json,errors.csv.new,waves.csv.new,peers.json,busy.txt,real_time.txt,obstacles.txt} >/dev/null || fail "results.py stopped"
        expect() { # FILE LINES: all of its rows
            local rows
            rows=$(tail -n +2 "$work/$1")
            [ "$rows" = "$2" ] || fail "$1 has other rows:"$'\n'"$rows"
            [ "$(head -n 1 "$work/$1")" = "date,commit,machine,entry,value,unit,spread" ] || fail "$1 has another head"
        }
        expect steps.csv '2026-01-02,abcdef0,h200,step/openmp/snow/cubic/mls/float/random/1000/threads:2,11,M/s,0.091
2026-01-02,abcdef0,h200,step/openmp/snow/cubic/mls/float/random/1000/threads:2,6,M/s/core,0
2026-01-02,abcdef0,h200,step/openmp/snow/cubic/mls/float/random/1000/threads:2,150,B,0
2026-01-02,abcdef0,h200,compile/minimal_host/threads:2,6.5,s,'
        expect steps_cuda.csv '2026-01-02,abcdef0,h200,step/cuda/snow/cubic/mls/float/random/1000,4.5,G/s,
2026-01-02,abcdef0,h200,step/cuda/snow/cubic/mls/float/random/1000,26.5,us,'
        expect errors.csv '2026-01-03,1234567,h200,P1/openmp/cubic/mls/float/0.9/16/4,0.92,%,
2026-01-03,1234567,h200,P1/openmp/cubic/mls/float/0.9/16/4,0.86,ms,0.031
2026-01-03,1234567,h200,P8/openmp/cubic/mls/float/0.9/8/4/nodes,2,%,
2026-01-03,1234567,h200,P8/openmp/cubic/mls/float/0.9/8/4/nodes,250,ms,0.031'
        expect waves.csv '2026-01-03,abcdef0,h200,waves/cubic/taichi/16/threads:2,0.92,%,
2026-01-03,abcdef0,h200,waves/cubic/taichi/16/threads:2,4,ms,0.1
2026-01-03,abcdef0,h200,waves/cubic/taichi_private/16/threads:2,0.92,%,
2026-01-03,abcdef0,h200,waves/cubic/taichi_private/16/threads:2,3,ms,0.2
2026-01-03,abcdef0,h200,waves/cubic/warp/16/threads:2,0.92,%,
2026-01-03,abcdef0,h200,waves/cubic/warp/16/threads:2,2,ms,0.2
2026-01-03,abcdef0,h200,waves/cubic/taichi_cheaper/16/threads:2,3,ms,0.2'
        expect peers.csv '2026-01-04,abcdef0,h200,peers/snow_packed/firn,50,ns,0.1
2026-01-04,abcdef0,h200,peers/snow_packed/wall_best/threads:2,8.25,x,'
        expect busy_cores.csv '2026-01-05,abcdef0,h200,busy_cores/1/2197/16,4.9,M/s,
2026-01-05,abcdef0,h200,busy_cores/1/2197/16,0.97,x,0.062'
        expect real_time.csv '2026-01-05,abcdef0,h200,real_time/snow/cubic/16,40.5,ms,
2026-01-05,abcdef0,h200,real_time/snow/cubic/16/slowest,47.9,ms,
2026-01-05,abcdef0,h200,real_time/snow/cubic/16,14.9,steps,'
        expect obstacles.csv '2026-01-05,abcdef0,h200,obstacles/step/list_of_2,1.23,ms,0.021
2026-01-05,abcdef0,h200,obstacles/step/list_of_2_over_two,1.01,x,'
        refuses() { # SENTENCE ARGUMENTS...
            local sentence=$1 said
            shift
            if said=$(python3 bench/results.py --results "$work" "$@" 2>&1); then fail "this should have been refused: $*"; fi
            [[ $said == *"$sentence"* ]] || fail "the message lacks '$sentence': $said"
        }
        refuses "machines.csv has no machine 'abacus'" --machine abacus
        refuses "is of no benchmark" --machine h200 "$work/machines.csv"
        echo "what benchmarks write becomes rows, and other files are refused"
        ;;
    lines)
        found=$(pages | perl -0 -CSD -ne '
            chomp;
            next unless -f;
            open my $in, "<:encoding(UTF-8)", $_ or die "$_: $!";
            my ($fenced, $number) = (0, 0);
            local $/ = "\n";
            while (my $line = <$in>) {
                ++$number;
                chomp $line;
                $fenced = !$fenced if $line =~ /^\s*```/;
                next if $fenced || length $line <= 120 || $line =~ /^\|/ || $line =~ /^!?\[[^\]]*\]\([^)]*\)$/;
                print "$_:$number: ", length $line, " characters\n";
            }')
        [ -z "$found" ] || { echo "Lines of Markdown longer than 120 characters:"; echo "$found"; exit 1; }
        ;;
    links)
        found=$(pages | perl -0 -ne '
            chomp;
            next unless -f;
            open my $in, "<", my $page = $_ or die "$_: $!";
            my ($folder) = $page =~ m{^(.*/)};
            my $fenced = 0;
            local $/ = "\n";
            while (my $line = <$in>) {
                $fenced = !$fenced if $line =~ /^\s*```/;
                next if $fenced;
                $line =~ s/`[^`]*`//g; # lambdas of C++ look like links
                for my $link ($line =~ /\]\(([^)#]+)(?:#[^)]*)?\)/g) {
                    next if $link =~ /^https?:/ || -e ($folder // "") . $link;
                    print "$page links to $link, which is not there.\n";
                }
            }')
        [ -z "$found" ] || { echo "$found"; exit 1; }
        ;;
    rows)
        perl -e '
            sub text { open my $in, "<", $_[0] or die "$_[0]: $!"; local $/; <$in> }
            sub list { # FOLDER NAME: the types on the list of all.hpp
                my ($types) = text("include/firn/$_[0]/all.hpp") =~ /$_[1] = std::tuple<([^>]*)>/;
                die "$_[0]/all.hpp has no list $_[1]\n" unless $types;
                $types =~ /\w+/g;
            }
            my @models = grep { !/Models$/ } text("include/firn/models/all.hpp") =~ /(\w+)<Space>/g;
            my $broken = 0;
            # each table of the guide whose first column has this title
            for (["models", "model", @models], ["models", "material", @models], ["transfer", "transfer", list("transfer", "AllTransfers")],
                 ["transfer", "kernel", list("interpolation", "AllKernels")], ["effects", "shape", list("effects/shapes", "AllPlainShapes")]) {
                my ($folder, $title, @listed) = @$_;
                my $guide = "include/firn/$folder/README.md";
                my @tables = text($guide) =~ /^\| \Q$title\E \|.*\n\|[-|]+\n((?:\|.*\n)+)/mg;
                @tables or ++$broken, print "$guide has no table of each $title.\n";
                for my $table (@tables) {
                    my %row = map { $_ => 1 } $table =~ /^\| `(\w+)/mg;
                    for (@listed) { delete $row{$_} or ++$broken, print "$guide: a table has no row for the $title $_.\n" }
                    for (sort keys %row) { ++$broken, print "$guide: a table has a row for $_, which is on no list.\n" }
                }
            }
            # what a report of a run has, and what its table says
            my %key = map { $_ => 1 } text("examples/snow_scene.hpp") =~ /\\"(\w+)\\":/g;
            my ($table) = text("examples/README.md") =~ /^\| key \|.*\n\|[-|]+\n((?:\|.*\n)+)/m;
            my %said = map { $_ => 1 } ($table // "") =~ /`(\w+)`/g;
            for (sort keys %key) { $said{$_} or ++$broken, print "examples/README.md: the table of report.json lacks $_.\n" }
            for (($table // "") =~ /^\| (`.*?) \|/mg) {
                for (/`(\w+)`/g) { $key{$_} or ++$broken, print "examples/README.md: there is no $_ in report.json.\n" }
            }
            exit($broken > 0)'
        ;;
    can_fail)
        need_python
        copy=$(mktemp -d)
        trap 'rm -rf "$copy"' EXIT
        # breaks <law> <file> <text> [lawful text]: the house obeys the law, and no more with the text at the end of that file
        breaks() {
            rm -rf "${copy:?}"/* "$copy/.github"
            cp -r .github CMakePresets.json LICENSE README.md backends bench examples include tests "$copy/" # pages link to them
            printf '%s' "${4:-}" >>"$copy/$2"
            bash "$self" "$1" "$copy" >/dev/null || { echo "$1 refuses a lawful house."; exit 1; }
            printf '%s\n' "$3" >>"$copy/$2"
            if bash "$self" "$1" "$copy" >/dev/null 2>&1; then echo "$1 does not see: $3 in $2"; exit 1; fi
        }
        longest=$(printf 'ä%.0s' {1..120}) # characters, not bytes
        printf -v table '%s\n' "$longest" '```' "$longest$longest" '```' "| $longest$longest |" "![$longest]($longest)"
        breaks lines bench/README.md "$longest!" "$table"
        breaks lines bench/notes/2099-01-01-late.md "a [link](to.md), and more $longest"
        breaks links bench/README.md "[a page](notes/none.md)"
        breaks links bench/peers/README.md "[a part](none.md#of-it)"
        breaks links README.md "[a guide](include/firn/none.md)" 'a lambda, `[](int none) {}`'
        breaks links backends/openmp/README.md "[a header](firn/openmp/none.hpp)" $'\n```\nauto const f = [](int none) {};\n```\n'
        breaks links .github/CONTRIBUTING.md "[tests](tests/README.md)"
        breaks rows include/firn/models/all.hpp 'using MoreModels = std::tuple<Late<Space>>;'
        breaks rows include/firn/transfer/README.md $'| kernel | use |\n|---|---|\n| `CubicBSpline` | waves |\n| `Linear` | none |'
        breaks rows include/firn/effects/README.md $'| shape |\n|---|\n| `HalfSpace` |\n| `Sphere` |\n| `Capsule` |\n| `Box` |\n| `Cone` |' \
            $'\n| shape |\n|---|\n| `Box` |\n| `Sphere` |\n| `Capsule` |\n| `HalfSpace` |\n\n'
        breaks rows examples/README.md '| `of_none` | integer | |'
        breaks rows examples/snow_scene.hpp '// "\"of_none\":"'
        breaks figures bench/results/steps_cuda.csv \
            "2999-01-01,abcdef0,h200,step/cuda/neo_hookean/quadratic/mls/float/jittered/1000000,0.01,G/s,"
        breaks figures bench/results/steps.csv "2026-11-28,abcdef0,abacus,step/openmp/one,1,M/s,"
        breaks figures bench/results/steps.csv "2026-11-28,abcdef0,h200,step/openmp/one,fast,M/s,"
        breaks figures bench/results/steps.csv "2026-11-28,abcdef0,h200,step/openmp/one"
        breaks figures bench/README.md '<!-- table: steps -->'
        echo "each law of the pages can be broken and says so"
        ;;
    *) echo "there is no law '$law'"; exit 2 ;;
esac

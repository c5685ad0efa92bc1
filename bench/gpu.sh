#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
#
# On a machine with a GPU: builds the CUDA backend's tests and benchmarks, passes the tests (agreement with the
# processor included), runs compute-sanitizer on a step of every kind, and times steps; in less than nine minutes with
# 16 cores, most of which are nvcc's. The last lines are a table of the timings; if a test failed, one that says so.
#
#     bash bench/gpu.sh [--out FOLDER] [--prefix FOLDER] [--all] [--large] [--materials] [--errors] [--record ID]
#
#   --out FOLDER      where logs and bench_cuda.json go (build/cuda)
#   --prefix FOLDER   where Eigen, Catch2 and Google Benchmark are, if not in the usual places
#   --all             the scenes of implicit steps and of several ranks, and what proves physics by loops which others
#                     run, too: minutes of nvcc more (tests/notes/2026-11-28-what-all-adds.md)
#   --large           64 million particles too: 60 GB of memory of the machine, two minutes more
#   --materials       every material and transfer too, a million particles each, in a table relative to neo-Hookean
#   --errors          and what an error costs: speed_against_error.csv of the short grid, five minutes more
#   --record ID       appends the results to bench/results, as of the machine with this id in machines.csv
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
stop() { echo "stop: $*" >&2; exit 1; }

out="$root/build/cuda" prefix="" all="" materials="" errors="" record="" without=64000000
while [ $# -gt 0 ]; do
    case $1 in
        --out) [ $# -ge 2 ] || stop "--out needs a folder."; out=$2; shift ;;
        --prefix) [ $# -ge 2 ] || stop "--prefix needs a folder."; prefix=$2; shift ;;
        --all) all="cuda_proofs cuda_implicit cuda_over_ranks" ;;
        --large) without=random/64000000 ;;
        --materials) materials=benchmarks_cuda_materials ;;
        --errors) errors=speed_against_error_cuda ;;
        --record) [ $# -ge 2 ] || stop "--record needs the id of a machine."; record=$2; shift ;;
        --help | -h) sed -n '/^# On a machine/,/^#   --record/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;;
        *) stop "unknown argument '$1': bash bench/gpu.sh [--out FOLDER] [--prefix FOLDER] [--all] [--large] [--materials] [--errors] [--record ID]." ;;
    esac
    shift
done
PATH=$PATH:/usr/local/cuda/bin
command -v nvcc >/dev/null || stop "the CUDA toolkit is not installed: there is no nvcc."
nvidia-smi -L 2>/dev/null | grep GPU || stop "this machine has no NVIDIA GPU, or no driver for it."
mkdir -p "$out"
out=$(cd "$out" && pwd)
cd "$root"
command -v compute-sanitizer >/dev/null || stop "there is no compute-sanitizer: it comes with the CUDA toolkit."

record() { # [FILE]: appends its results, if --record is given; without FILE only the id is checked
    [ -z "$record" ] || python3 "$root/bench/results.py" --machine "$record" "$@" || stop "the results cannot be recorded."
}
record

cmake --preset cuda -DFIRN_TESTS_IN_TURN=ON -DFIRN_TESTS_ALL="$([ -n "$all" ] && echo ON || echo OFF)" ${prefix:+-DCMAKE_PREFIX_PATH="$prefix"} >"$out/configure.log" || { cat "$out/configure.log"; exit 1; }
tests=$root/build/cuda/tests
rm -f "$tests/hard_cases.csv"
failed="" build=""
leave() { # no background job outlives the script; how long nvcc took for each unit lies beside the logs
    local status=$?
    cp "$root/build/cuda/.ninja_log" "$out/ninja_log" 2>/dev/null || true
    [ -z "$build" ] || kill "$build" 2>/dev/null || true
    wait
    [ -z "$failed" ] || { echo "stop: a test failed: see above." >&2; status=1; }
    exit $status
}
trap leave EXIT
not_built() { tail -n 40 "$out/build.log"; stop "the programs could not be built."; }
# Ninja itself, which ends its compilers when it is ended. What runs beside them, above all compute-sanitizer, goes first.
programs="cuda_device cuda_devices cuda_fault cuda_hard_cases cuda_surfaces cuda_models cuda_agreement cuda_scenes cuda_physics $all"
for program in cuda_every_loop $programs; do rm -f "$tests/$program"; done # or those of an earlier run would be tested
nice ninja -C build/cuda cuda_every_loop $programs host_engine benchmarks_cuda $materials $errors \
    >"$out/build.log" 2>&1 &
build=$!
built() { # PROGRAM: waits for it; GNU's linker makes it executable when it is complete
    [ ! -x "$tests/$1" ] || return 0
    until [ -x "$tests/$1" ]; do
        kill -0 "$build" 2>/dev/null || [ -x "$tests/$1" ] || not_built
        sleep 1
    done
    echo "$1: built at $SECONDS s"
}
part() { # NAME COMMAND...: one line of what it found, or its last lines
    local name=$1 summary since=$SECONDS
    shift
    if ! "$@" >"$out/$name.log" 2>&1; then
        tail -n 60 "$out/$name.log"
        echo "$name: FAILED"
        return 1
    fi
    summary=$(grep -E '^All tests passed|(ERROR|RACECHECK) SUMMARY' "$out/$name.log" | tail -n 1) || summary="passed"
    echo "$name: ${summary#=*= } ($((SECONDS - since)) s, at $SECONDS s)"
}
# Programs themselves, not ctest: that starts one anew for each of 500 tests, 0.3 s of the device's each. What can be
# watched soon is, while nvcc has the processor; the first programs share the device with racecheck and take turns.
# In $tests, as ctest does, so that all find the same hard_cases.csv.
cd "$tests"
built cuda_every_loop
# Compute-sanitizer takes some milliseconds of one thread of the host for each loop that is launched, racecheck most. So
# several parts of the program are watched beside one another.
beside=()
watch() { # TOOL COUNT: in so many parts
    local shard
    for ((shard = 0; shard < $2; ++shard)); do
        part $1_$shard compute-sanitizer --tool $1 --error-exitcode 1 ./cuda_every_loop --shard-count $2 --shard-index $shard &
        beside+=($!)
    done
}
watch racecheck 4
watch memcheck 2
watch initcheck 2
part cuda_every_loop ./cuda_every_loop & beside+=($!)
# Programs that are complete run beside one another, as these do: small scenes leave most of the device idle. One whose
# tests take long is divided. cuda_fault runs by itself, once all others are through.
at_once=6
running=()
finish() { # COUNT: waits until fewer than so many run, whichever end first
    local pid others
    while [ ${#running[@]} -ge "$1" ]; do
        others=()
        for pid in "${running[@]}"; do
            if kill -0 "$pid" 2>/dev/null; then others+=("$pid"); else wait "$pid" || failed=yes; fi
        done
        running=(${others[@]+"${others[@]}"})
        [ ${#running[@]} -lt "$1" ] || sleep 0.5
    done
}
begin() { # NAME COMMAND...: see part
    finish $at_once
    part "$@" & running+=($!)
}
for program in $programs; do
    built $program
    case $program in
        cuda_fault) ;;
        cuda_surfaces | cuda_models | cuda_physics)
            for shard in 0 1 2 3 4 5; do
                begin ${program}_$shard ./$program '~[memory]' --shard-count 6 --shard-index $shard
            done ;;
        *) begin $program ./$program '~[memory]' ;;
    esac
done
finish 1
for sanitizer in "${beside[@]}"; do wait "$sanitizer" || failed=yes; done
part cuda_fault ./cuda_fault || failed=yes
wait "$build" || { build=""; not_built; }
build=""
echo "all is built and run at $SECONDS s"
part memory ./cuda_device '[memory]' || failed=yes # by itself: it fills the device's
part hard_cases bash "$root/tests/limits/table.sh" hard_cases.csv || failed=yes
part host_engine ../examples/host_engine || failed=yes
cd "$root"

bench=build/cuda/bench/benchmarks_cuda
most='neo_hookean/.*/float/|(fixed_corotated|snow/quadratic)/.*/(lattice|jittered|random)/1000000/|/random/1000000/'
most+='|fixed_corotated/.*/(lattice|jittered)/8000000/|snow/quadratic/.*/random/0|^launches/'
entries=$($bench --benchmark_list_tests=true | grep -E "$most" | grep -vE "$without" | paste -sd'|') || stop "no benchmark is called so."
$bench --benchmark_filter="^($entries)\$" --benchmark_out="$out/bench_cuda.json" \
    --benchmark_out_format=json >"$out/bench.log" 2>&1 || { tail -n 20 "$out/bench.log"; stop "the benchmark failed."; }

echo "$SECONDS s in all$([ $SECONDS -le 540 ] || echo ": more than the nine minutes that it should take with 16 cores")"
python3 - "$out/bench_cuda.json" <<'PYTHON'
import json, sys
entries = json.load(open(sys.argv[1]))["benchmarks"]
print("empty loops one behind another, microseconds each (the host's share):",
      ", ".join(f"{entry['name'].split('/')[1]} of {entry['name'].split('/')[2]} groups {entry['us_per_loop']:.2f}"
                f" ({entry['host_us_per_loop']:.2f})" for entry in entries if entry["name"].startswith("launches/")))
print("deterministic: always; 0 to 1 % of a step, measured on 2026-11-23 (bench/notes/2026-11-23-fixed-order-on-a-gpu.md)")
print(f"{'step/cuda/…':66}{'ms/step':>9}{'G/s':>7}{'B/p':>6}{'leave':>7}{'momentum':>10}")
for entry in entries:
    if entry["name"].startswith("launches/"):
        continue
    name = entry["name"].removeprefix("step/cuda/").split("/iterations")[0]
    if entry.get("error_occurred"):
        print(f"{name:66} {entry['error_message'][:60]}")
        continue
    leavers = f"{entry['leaver_share']:.3f}" if "leaver_share" in entry else ""
    print(f"{name:66}{entry['ms_per_step']:9.4f}{entry['particle_steps_per_second'] * 1e-9:7.2f}"
          f"{entry['memory_per_particle']:6.0f}{leavers:>7}{entry['momentum_error']:10.1e}")
PYTHON

record "$out/bench_cuda.json"
if [ -n "$errors" ]; then
    commit=$(git describe --always --dirty 2>/dev/null) || commit=unknown
    "build/cuda/bench/$errors" --grid short --runs 2 --commit "$commit" --out "$out/speed_against_error.csv" || stop "the errors were not measured."
    echo "python3 bench/plot.py $out/speed_against_error.csv draws it."
    record "$out/speed_against_error.csv"
fi

[ -n "$materials" ] || exit 0
"build/cuda/bench/$materials" --benchmark_out="$out/bench_materials.json" --benchmark_out_format=json \
    >"$out/bench_materials.log" 2>&1 || { tail -n 20 "$out/bench_materials.log"; stop "the benchmark of materials failed."; }

record "$out/bench_materials.json"
python3 - "$out/bench_materials.json" <<'PYTHON'
import json, sys
entries = json.load(open(sys.argv[1]))["benchmarks"]
failed = [entry for entry in entries if entry.get("error_occurred")]
steps = {} # (material, transfer) -> scene -> ms
for entry in entries:
    _, _, material, _, transfer, _, scene, _ = entry["name"].split("/iterations")[0].split("/")
    steps.setdefault((material, transfer), {})[scene] = entry.get("ms_per_step")
one = steps["neo_hookean", "mls"]
print(f"\n{'1 million particles, float, quadratic':38}" + "".join(f"{f'{scene}, ms':>12}{'relative':>9}" for scene in one))
for (material, transfer), took in steps.items():
    told = lambda scene: f"{took[scene]:12.4f}{took[scene] / one[scene]:9.2f}" if took[scene] and one[scene] else f"{'':21}"
    print(f"{material + ', ' + transfer:38}" + "".join(told(scene) for scene in one))
for entry in failed:
    print(entry["name"], entry["error_message"], file=sys.stderr)
sys.exit(len(failed) > 0)
PYTHON

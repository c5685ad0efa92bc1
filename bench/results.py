# SPDX-License-Identifier: MIT
"""Appends what a benchmark has written to the figures in bench/results: `results.py --machine ID FILE...`.

A FILE is the JSON of Google Benchmark, the table of speed_against_error, peers.json or waves.csv of peers/run.sh, the
text that busy_cores or real_time prints, or lines `figure ENTRY VALUE UNIT [SPREAD]`. Each becomes rows of one CSV with
the columns date, commit, machine, entry, value, unit and spread. The machine is an id of results/machines.csv. The
spread is half the range of the runs over the value; it is empty where a value is of one run. The newest row of an entry
is the one that tables.py shows.
"""

import argparse
import collections
import csv
import datetime
import json
import pathlib
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
RESULTS = HERE / "results"
COLUMNS = ["date", "commit", "machine", "entry", "value", "unit", "spread"]
PROGRAMS = ("firn", "firn_advance", "taichi", "taichi_private", "warp")  # of waves.csv

# Counters of Google Benchmark that are kept: (factor, unit)
COUNTERS = {
    "openmp": {"particle_steps_per_second": (1e-6, "M/s"), "per_second_of_user_time": (1e-6, "M/s/core"),
               "memory_per_particle": (1, "B"), "user_nanoseconds_per_particle": (1, "ns"),
               "ns_per_particle": (1, "ns")},
    "cuda": {"particle_steps_per_second": (1e-9, "G/s"), "ms_per_step": (1e3, "us"),
             "memory_per_particle": (1, "B"), "us_per_loop": (1, "us")},
}
TO_SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1}


def stop(text):
    sys.exit(f"stop: {text}")


def number(value):
    value = float(value)
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def row(entry, value, unit, spread="", date="", commit=""):
    return {"date": date, "commit": commit, "entry": entry, "value": number(value), "unit": unit,
            "spread": "" if spread == "" else f"{float(spread):.2g}"}


def with_threads(entry, threads):
    return entry if int(threads) == 1 else f"{entry}/threads:{threads}"


def of_benchmarks(found):
    """Rows of Google Benchmark's JSON, the median of each entry's repetitions; and the file they belong to."""
    threads = found.get("context", {}).get("threads", 1)
    date = found.get("context", {}).get("date", "")[:10]
    runs = collections.defaultdict(list)
    for entry in found["benchmarks"]:
        if entry.get("run_type", "iteration") == "iteration" and not entry.get("error_occurred"):
            name = entry.get("run_name", entry["name"]).split("/iterations:")[0].removesuffix("/real_time")
            runs[name].append(entry)
    cuda = any(name.startswith(("step/cuda/", "launches/")) for name in runs)
    rows = []
    for name, entries in runs.items():
        of = collections.defaultdict(list)
        for counter, (factor, unit) in COUNTERS["cuda" if cuda else "openmp"].items():
            of[unit] += [factor * entry[counter] for entry in entries if counter in entry]
        if not any(of.values()):  # nothing is counted but time
            of["s"] = [entry["real_time"] * TO_SECONDS[entry.get("time_unit", "ns")] for entry in entries]
        for unit, values in of.items():
            if values:
                median = statistics.median(values)
                spread = (max(values) - min(values)) / 2 / median if len(values) > 1 and median else ""
                rows.append(row(with_threads(name, threads), median, unit, spread, date))
    return "steps_cuda.csv" if cuda else "steps.csv", rows


def of_errors(lines):
    """Rows of speed_against_error or of the waves of several programs."""
    waves = any(line["backend"] in PROGRAMS for line in lines)
    # Warp has one thread, and is compared with as many as the others have.
    most = max((int(line["threads"]) for line in lines), default=1)
    rows, cheaper = [], {}
    for line in lines:
        if line["status"] != "ok":
            continue
        if waves:
            entry = "/".join(["waves", line["kernel"], line["backend"], line["cells"]])
        else:
            keys = "problem,backend,kernel,transfer,precision,cfl_fraction,cells,ppc".split(",")
            entry = "/".join(line[key] for key in keys)
            if line.get("acts_on"):
                entry += "/" + line["acts_on"]
        threads = most if waves else int(line["threads"])
        entry, about = with_threads(entry, threads), (line["date"], line["commit"].replace("unknown", ""))
        by_clock = line["backend"] == "cuda" or threads > 1
        spread = line["spread"] if int(line["runs"]) > 1 else ""
        rows.append(row(entry, 100 * float(line["error"]), "%", "", *about))
        milliseconds = 1000 * float(line["seconds" if by_clock else "cpu_seconds"])
        rows.append(row(entry, milliseconds, "ms", spread, *about))
        if threads > 1 and line["backend"] in ("taichi", "taichi_private"):
            name = entry.replace(f"/{line['backend']}/", "/taichi_cheaper/")
            if name not in cheaper or milliseconds < cheaper[name][0]:
                cheaper[name] = milliseconds, row(name, milliseconds, "ms", spread, *about)
        if line.get("energy_lost"):
            rows.append(row(f"{entry}/energy_lost", 100 * float(line["energy_lost"]), "%", "", *about))
    rows += [found for _, found in cheaper.values()]
    return "waves.csv" if waves else "errors.csv", rows


def of_peers(found):
    """Rows of peers.json: nanoseconds per particle-step, and how many times as long the best peer takes."""
    rows = []
    for case in found["cases"]:
        for program in case["programs"]:
            clock = "user_ns" if program["threads"] == 1 else "wall_ns"
            least, most = program[clock + "_range"]
            spread = (most - least) / 2 / program[clock] if found["rounds"] > 1 else ""
            entry = with_threads(f"peers/{case['case']}/{program['program']}", program["threads"])
            rows.append(row(entry, program[clock], "ns", spread, found["date"]))
        for key, best in case["summary"].items():
            threads = 1 if key.startswith("per_core") else found["threads"]
            entry = with_threads(f"peers/{case['case']}/{key}", threads)
            rows.append(row(entry, best["ratio"], "x", "", found["date"]))
    return "peers.csv", rows


def of_busy_cores(text):
    """Rows of what busy_cores prints: M/s of one thread, and how many times as fast the default is."""
    rows = []
    for line in text.splitlines():
        words = line.split()
        if len(words) != 9 or not words[0].isdigit():
            continue
        busy, particles, calls, one, _, least, median, most, _ = words
        entry = f"busy_cores/{busy}/{particles}/{calls}"
        rows.append(row(entry, one, "M/s"))
        rows.append(row(entry, median, "x", (float(most) - float(least)) / 2 / float(median)))
    return "busy_cores.csv", rows


def of_real_time(text):
    """Rows of what real_time prints: of frames of a sixtieth of a second, the median and the slowest, and steps."""
    rows = []
    for line in text.splitlines():
        words = line.split()
        if len(words) != 7 or not words[2].isdigit():
            continue
        material, kernel, cells, _, steps, median, slowest = words
        entry = f"real_time/{material}/{kernel}/{cells}"
        rows += [row(entry, median, "ms"), row(entry + "/slowest", slowest, "ms"), row(entry, steps, "steps")]
    return "real_time.csv", rows


def of_figures(text):
    """Rows of lines `figure ENTRY VALUE UNIT [SPREAD]`: a file for the first part of their entries."""
    rows = []
    for line in text.splitlines():
        words = line.split()
        if len(words) in (4, 5) and words[0] == "figure":
            rows.append(row(*words[1:]))
    return rows[0]["entry"].split("/")[0] + ".csv", rows


def rows_of(path):
    if not path.is_file():
        stop(f"there is no {path}.")
    text = path.read_text()
    if text.lstrip().startswith("{"):
        found = json.loads(text)
        if "benchmarks" in found:
            return of_benchmarks(found)
        if "cases" in found:
            return of_peers(found)
    elif text.startswith("problem,"):
        return of_errors(list(csv.DictReader(text.splitlines())))
    elif "calls/frame" in text:
        return of_busy_cores(text)
    elif "steps/frame" in text:
        return of_real_time(text)
    elif text.startswith("figure "):
        return of_figures(text)
    stop(f"{path} is of no benchmark that is known here.")


def read(path):
    with path.open(newline="") as lines:
        return list(csv.DictReader(lines))


def head(folder):
    """The commit of a checkout, `-dirty` behind it where files differ."""
    git = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(git, capture_output=True, text=True).stdout.strip()


def append(path, rows):
    is_new = not path.exists()
    with path.open("a", newline="") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if is_new:
            table.writeheader()
        table.writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=pathlib.Path, help="none: checks the machine alone")
    parser.add_argument("--machine", required=True, help="its id in results/machines.csv")
    parser.add_argument("--commit", help="what was measured, where the file does not say it; else this folder's")
    parser.add_argument("--date", help="the same; else today's")
    parser.add_argument("--results", type=pathlib.Path, default=RESULTS, help="folder of the CSVs")
    options = parser.parse_args()
    known = [machine["id"] for machine in read(options.results / "machines.csv")]
    if options.machine not in known:
        stop(f"machines.csv has no machine '{options.machine}', only {', '.join(known)}: add a line for it.")
    about = {"date": options.date or datetime.date.today().isoformat(), "commit": options.commit or head(HERE)}
    for path in options.files:
        name, rows = rows_of(path)
        if not rows:
            stop(f"{path} has no result.")
        for line in rows:
            line |= {"machine": options.machine} | {key: line[key] or value for key, value in about.items()}
        append(options.results / name, rows)
        print(f"{len(rows)} rows of {path} in {options.results / name}")


if __name__ == "__main__":
    main()

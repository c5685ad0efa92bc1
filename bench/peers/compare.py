# SPDX-License-Identifier: MIT
"""Runs Firn and its peers alternately on the same scenes, prints costs as ratios, and compares the final states.

Called by run.sh, with its options. Exits with 1 if a program's final state is not that of the others.
"""

import argparse
import dataclasses
import datetime
import json
import os
import pathlib
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version

import numpy as np

import scene as scenes

HERE = pathlib.Path(__file__).resolve().parent

# How many times faster than the best peer Firn wants to be: per core, and by the clock with all threads.
AIMS = {"neo_hookean_early": (3, 4), "neo_hookean": (3, 4), "fixed_corotated": (6, 4), "snow_packed": (6, 4)}

# A run is disturbed if other programs take more than this share of the machine.
DISTURBED = 0.05

# Largest differences from the run in double precision that rounding accounts for: see README.md, "Agreement".
LIMITS = {
    "float": {"centre": 2e-4, "positions": 5e-4, "kinetic": 2e-4, "elastic": 5e-4, "volume": 5e-5},
    "double": {"centre": 1e-9, "positions": 1e-6, "kinetic": 1e-8, "elastic": 1e-7, "volume": 1e-8},
}


@dataclasses.dataclass(frozen=True)
class Program:
    """One way to step a scene."""

    name: str
    threads: int
    command: tuple
    written: bool = False  # with decompositions that are not the package's own

    @property
    def is_firn(self):
        return self.name == "firn"


def programs(case, threads, firn):
    """All programs of a case, in the order in which they take turns."""

    def taichi(name, count, scatter, decomposition):
        arguments = ("--threads", str(count), "--scatter", scatter, "--decomposition", decomposition)
        command = (sys.executable, str(HERE / "taichi_mpm.py"), *arguments)
        return Program(name, count, command, decomposition == "written")

    def warp(name, decomposition):
        command = (sys.executable, str(HERE / "warp_mpm.py"), "--decomposition", decomposition)
        return Program(name, 1, command, decomposition == "written")

    decomposes = scenes.CASES[case].model != "neo_hookean"
    found = [Program("firn", 1, (str(firn), "--threads", "1")), taichi("taichi serial", 1, "serial", "builtin")]
    if decomposes:
        found += [taichi("taichi serial, written", 1, "serial", "written"), warp("warp, written", "written")]
    found.append(warp("warp", "builtin"))
    if threads > 1:
        found.append(Program("firn", threads, (str(firn), "--threads", str(threads))))
        for scatter in ("serial", "atomic", "private"):
            found.append(taichi(f"taichi {scatter}", threads, scatter, "builtin"))
        if decomposes:
            found.append(taichi("taichi private, written", threads, "private", "written"))
    return found


def busy_seconds():
    """The processor time that all programs of this machine have had since it started, and this program's children."""
    ticks = [int(word) for word in pathlib.Path("/proc/stat").read_text().split("\n")[0].split()[1:9]]
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    idle = ticks[3] + ticks[4]
    return (sum(ticks) - idle) / os.sysconf("SC_CLK_TCK"), children.ru_utime + children.ru_stime


def wait_for_quiet(patience):
    """Waits until other programs leave the machine alone for a second, `patience` seconds at most."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        before, _ = busy_seconds()
        time.sleep(1)
        if busy_seconds()[0] - before < DISTURBED * os.cpu_count():
            return


def run(program, folder, state=None, precision="float", patience=0):
    """Runs a program on the scene in a folder; returns what it cost and, if asked for, its final state.

    With patience [s] it waits for a quiet machine, and once more if others came in between, three times at most.
    """
    for _ in range(3 if patience else 1):
        wait_for_quiet(patience)
        (busy, own), start = busy_seconds(), time.perf_counter()
        cost, final = run_once(program, folder, state, precision)
        (busy_after, own_after), wall = busy_seconds(), time.perf_counter() - start
        cost["others"] = max(0.0, ((busy_after - busy) - (own_after - own)) / (wall * os.cpu_count()))
        if cost["others"] < DISTURBED:
            break
    return cost, final


def run_once(program, folder, state, precision):
    command = [*program.command, str(folder), "--precision", precision]
    if state:
        command += ["--state", str(state)]
    environment = {**os.environ, "OMP_WAIT_POLICY": "passive"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or not lines:
        print((done.stdout + done.stderr)[-3000:], file=sys.stderr)
        sys.exit(f"stop: {program.name} failed: {' '.join(command)}")
    return json.loads(lines[-1]), np.fromfile(state).reshape(-1, scenes.FIELDS) if state else None


def quantities(scene, state):
    """What is compared of a final state: places [cells], energies [J], and the mean volume ratio."""
    x, v = state[:, :3], state[:, 3:6]
    F, J_P = state[:, 6:15].reshape(-1, 3, 3), state[:, 15]
    J = np.linalg.det(F)
    sigma = np.linalg.svd(F, compute_uv=False)
    mu, lam = scene.mu, scene.lambda_
    if scene.model == "neo_hookean":
        density = mu / 2 * ((sigma**2).sum(1) - 3) - mu * np.log(J) + lam / 2 * np.log(J) ** 2
    else:
        density = mu * ((sigma - 1) ** 2).sum(1) + lam / 2 * (J - 1) ** 2
    if scene.model == "snow":
        within = np.clip(J_P, scene.smallest_plastic_ratio, scene.largest_plastic_ratio)
        density *= np.exp(scene.hardening * (1 - within))
    return {
        "positions": x / scene.cell,
        "centre": x.mean(0) / scene.cell,
        "kinetic": scene.mass / 2 * (v**2).sum(),
        "elastic": scene.volume * density.sum(),
        "volume": (J * J_P).mean(),
    }


def differences(found, reference):
    """Places in cells (their root mean square over the particles; the centre), the rest relative."""
    apart = {key: abs(found[key] / reference[key] - 1) for key in ("kinetic", "elastic", "volume")}
    apart["centre"] = float(np.linalg.norm(found["centre"] - reference["centre"]))
    apart["positions"] = float(np.sqrt(((found["positions"] - reference["positions"]) ** 2).sum(1).mean()))
    return {key: float(value) for key, value in apart.items()}


def agreement_row(name, apart, precision):
    """Prints a program's differences; returns whether they are within the limits."""
    limits = LIMITS[precision]
    bad = [key for key in limits if not apart[key] <= limits[key]]
    cells = "".join(f"{apart[key]:>11.1e}{'!' if key in bad else ' '}" for key in limits)
    print(f"  {name:<28}{cells}{'   DISAGREES: ' + ', '.join(bad) if bad else ''}", flush=True)
    return not bad


def compare_case(case, options, folder):
    """Measures and compares the programs on a case; returns what there is to say about it."""
    wanted = scenes.CASES[case]
    if options.steps:
        wanted = dataclasses.replace(wanted, steps=options.steps)
    scene = scenes.write(wanted, options.particles, folder)
    everyone = programs(case, options.threads, options.firn)
    print(
        f"\n{case}: {scene.particles} particles, {scene.kernel}, steps {scene.warm_up + 1} to "
        f"{scene.warm_up + scene.steps} of {scene.dt:g} s",
        flush=True,
    )

    state = folder / "state.bin"
    _, exact = run(everyone[0], folder, state, "double")
    reference = quantities(scene, exact)
    agrees, apart, costs = True, {}, {program: [] for program in everyone}
    print("  differences from double:    " + "".join(f"{key:>11} " for key in LIMITS["float"]))
    for turn in range(options.rounds):
        for program in everyone:
            cost, final = run(program, folder, state if turn == 0 else None, patience=options.patience)
            costs[program].append(cost)
            if final is not None:
                apart[program] = differences(quantities(scene, final), reference)
                agrees &= agreement_row(f"{program.name} ({program.threads})", apart[program], "float")
    if options.double:
        peers = [program for program in everyone if not program.is_firn and program.threads == 1]
        for program in peers:
            _, final = run(program, folder, state, "double")
            there = differences(quantities(scene, final), reference)
            agrees &= agreement_row(f"{program.name}, double", there, "double")
    return {"case": case, "scene": dataclasses.asdict(scene), "agrees": agrees, **report(case, costs, apart)}


def report(case, costs, apart):
    """Prints the table of costs and the ratios to the best peers; returns them."""
    rows = []
    for program, runs in costs.items():
        runs = [cost for cost in runs if cost["others"] < DISTURBED] or runs
        row = {"program": program.name, "threads": program.threads, "written": program.written, "runs": runs}
        row |= apart[program]
        for clock in ("user_ns", "wall_ns"):
            values = [cost[clock] for cost in runs]
            row[clock] = statistics.median(values)
            row[clock + "_range"] = [min(values), max(values)]
        rows.append(row)
    ours = {row["threads"]: row for row in rows if row["program"] == "firn"}
    print(
        "  ns per particle-step".ljust(32)
        + "threads   "
        + "user (range)".ljust(24)
        + "wall (range)".ljust(24)
        + "user x   wall x   others"
    )
    for row in rows:
        row["others"] = max(cost["others"] for cost in row.pop("runs"))
        of_us = ours[row["threads"]]
        row["user_ratio"], row["wall_ratio"] = (row[clock] / of_us[clock] for clock in ("user_ns", "wall_ns"))
        cells = "".join(
            f"{row[clock]:>8.1f} ({row[clock + '_range'][0]:.1f}-{row[clock + '_range'][1]:.1f})".ljust(24)
            for clock in ("user_ns", "wall_ns")
        )
        print(
            f"  {row['program']:<28}{row['threads']:>7}  {cells}{row['user_ratio']:>7.2f}{row['wall_ratio']:>9.2f}"
            f"{row['others']:>8.0%}"
        )

    peers = [row for row in rows if row["program"] != "firn"]
    threads = max(ours)
    summary = {}
    for key, clock, count, aim in (("per_core", "user_ns", 1, 0), ("wall", "wall_ns", threads, 1)):
        if key == "wall" and threads == 1:
            continue
        for kind, candidates in (("package", [row for row in peers if not row["written"]]), ("best", peers)):
            best = min((row for row in candidates if row["threads"] == count), key=lambda row: row[clock])
            summary[f"{key}_{kind}"] = {"peer": best["program"], "ratio": best[clock] / ours[count][clock]}
        package, best = summary[f"{key}_package"], summary[f"{key}_best"]
        what = "one thread, user time" if key == "per_core" else f"by the clock, {threads} threads"
        target = f"; aim {AIMS[case][aim]}" if case in AIMS else ""
        print(
            f"  {what}: {package['ratio']:.2f} times as fast as {package['peer']}"
            + (f", {best['ratio']:.2f} times as {best['peer']}" if best["peer"] != package["peer"] else "")
            + target,
            flush=True,
        )
    return {"programs": rows, "summary": summary}


def processor():
    try:
        return re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text()).group(1)
    except (OSError, AttributeError):
        return platform.processor()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--firn", type=pathlib.Path, required=True, help="the program firn_scene")
    parser.add_argument("--particles", type=int, default=125000)
    parser.add_argument("--steps", type=int, help="timed ones; each case has its own number")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--patience", type=int, default=0, help="seconds to wait for a quiet machine before a run")
    parser.add_argument("--only", choices=scenes.CASES, help="one case")
    parser.add_argument("--double", action="store_true", help="let the peers agree in double precision, too")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("peers.json"))
    options = parser.parse_args()
    for name, least in (("particles", 1000), ("rounds", 1), ("threads", 1), ("steps", 1)):
        value = getattr(options, name)
        if value is not None and value < least:
            sys.exit(f"stop: --{name} needs {least} or more, not {value}.")

    results = {
        "date": datetime.date.today().isoformat(),
        "processor": processor(),
        "threads": options.threads,
        "rounds": options.rounds,
        "versions": {name: version(name) for name in ("taichi", "warp-lang", "numpy")}
        | {"python": platform.python_version()},
        "limits": LIMITS,
        "cases": [],
    }
    print(f"{results['processor']}, {', '.join(f'{k} {v}' for k, v in results['versions'].items())}")
    with tempfile.TemporaryDirectory(prefix="firn-peers-") as folder:
        for case in [options.only] if options.only else scenes.CASES:
            results["cases"].append(compare_case(case, options, pathlib.Path(folder)))
            options.out.write_text(json.dumps(results, indent=1) + "\n")
    print(f"\nresults in {options.out}")
    wrong = [case["case"] for case in results["cases"] if not case["agrees"]]
    if wrong:
        sys.exit(f"stop: the programs do not agree on {', '.join(wrong)}: see DISAGREES above.")


if __name__ == "__main__":
    main()

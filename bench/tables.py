# SPDX-License-Identifier: MIT
"""Writes the tables of bench/README.md and of the guides from bench/results: `tables.py [--check]`.

A table stands between the lines `<!-- table: NAME -->` and `<!-- end -->`, and shows the newest row of each entry. With
`--check` nothing is written, and the exit is 1 if a page and the CSVs differ. A row without a machine or a commit is
kept in the CSVs and not shown.
"""

import argparse
import difflib
import pathlib
import re
import sys

from results import COLUMNS, HERE, RESULTS, read, stop

BLOCK = re.compile(r"^<!-- table: (\w+) -->\n(.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)
UNITS = {"%": " %", "ms": " ms", "us": " µs", "ns": " ns", "s": " s", "x": " times", "B": " bytes"}


class Figures:
    """All rows of the CSVs, and what a table has asked for."""

    def __init__(self, folder):
        self.machines = read(folder / "machines.csv")
        ids = {machine["id"] for machine in self.machines}
        self.newest = {}
        for path in sorted(folder.glob("*.csv")):
            if path.name == "machines.csv":
                continue
            for number, row in enumerate(read(path), start=2):
                if list(row) != COLUMNS or None in row.values():
                    stop(f"{path}, line {number}: the columns are to be {', '.join(COLUMNS)}.")
                if row["machine"] not in ids | {""}:
                    stop(f"{path}, line {number}: machines.csv has no '{row['machine']}'.")
                try:
                    float(row["value"])
                except ValueError:
                    stop(f"{path}, line {number}: '{row['value']}' is no number.")
                key = row["entry"], row["unit"], row["machine"]
                if not row["machine"] or not row["commit"]:
                    continue
                if key not in self.newest or self.newest[key]["date"] <= row["date"]:
                    self.newest[key] = row
        self.sources = []

    def get(self, entry, unit, machine):
        """The value of an entry as text, empty where there is none; where it is from is kept for source()."""
        row = self.newest.get((entry, unit, machine))
        if row is None:
            return ""
        about = f"{row['machine']}, {row['commit']}, {row['date']}"
        if about not in self.sources:
            self.sources.append(about)
        return row["value"]

    def need(self, entry, unit, machine):
        return self.get(entry, unit, machine) or stop(f"no figure of {entry} [{unit}] on {machine}.")

    def source(self):
        """Machine, commit and date of all figures since the last call."""
        told, self.sources = "; ".join(self.sources), []
        return told


def table(head, rows):
    lines = ["|" + "---|" * len(head)]
    for row in [head, *rows]:
        lines.append("|" + "".join(f" {cell} |" if cell else " |" for cell in row))
    return "\n".join([lines[1], lines[0], *lines[2:]]) + "\n"


def at_a_glance(figures):
    cuda, openmp = "step/cuda/neo_hookean/quadratic/mls/float/", "step/openmp/"
    rows = []

    def tell(what, machine, *parts):
        """Parts are texts, and figures as (entry, unit)."""
        text = "".join(part if isinstance(part, str) else figures.need(*part, machine) + UNITS.get(part[1], "")
                       for part in parts)
        rows.append([what, text, figures.source()])

    tell("One core: million particle-steps per second, neo-Hookean, snow", "epyc-26-2",
         (openmp + "neo_hookean/quadratic/mls/float/lattice/1000000", "M/s/core"), ", ",
         (openmp + "snow/quadratic/mls/float/lattice/1000000", "M/s/core"))
    tell("One GPU: billion particle-steps per second, 1 and 8 million particles", "h200",
         (cuda + "jittered/1000000", "G/s"), ", ", (cuda + "jittered/8000000", "G/s"))
    tell("Memory of a particle, grid included: 8 million on a GPU", "h200", (cuda + "jittered/8000000", "B"))
    tell("Waves solved to 1 % and to 0.1 % on one core", "epyc-25-17",
         ("P1/openmp/cubic/mls/float/0.9/16/4", "%"), " in ", ("P1/openmp/cubic/mls/float/0.9/16/4", "ms"), ", ",
         ("P1/openmp/cubic/mls/float/0.9/64/4", "%"), " in ", ("P1/openmp/cubic/mls/float/0.9/64/4", "ms"))
    tell("The best peer's time over Firn's on one core: packed snow, deformed neo-Hookean", "epyc-26-2",
         ("peers/snow_packed/per_core_package", "x"), ", ", ("peers/neo_hookean/per_core_package", "x"))
    tell("The compiler's time for a minimal program, -O3", "epyc-26-2", ("compile/minimal_host -O3", "s"))
    return table(["", "", "measured on"], rows)


def grid(figures, head, columns, lines):
    """Lines are (label, machine, entry, unit), whose {} takes each column."""
    rows = []
    for label, machine, entry, unit in lines:
        values = [figures.get(entry.format(column), unit, machine) for column in columns]
        if not any(values):
            stop(f"no figure of {entry} [{unit}] on {machine}.")
        rows.append([label, *values, figures.source()])
    return table([*head, "measured on"], rows)


SCHEMES = [("neo-Hookean, quadratic, MLS", "neo_hookean/quadratic/mls/float"),
           ("fixed corotated, quadratic, MLS", "fixed_corotated/quadratic/mls/float"),
           ("snow, quadratic, MLS", "snow/quadratic/mls/float"),
           ("snow, cubic, MLS", "snow/cubic/mls/float"),
           ("neo-Hookean, quadratic, MLS, double", "neo_hookean/quadratic/mls/double")]


def steps(figures):
    lines = [(name, "epyc-26-2", f"step/openmp/{scheme}/{{}}/1000000", "M/s/core") for name, scheme in SCHEMES]
    lines += [(name, "xeon-6-167", f"step/openmp/{scheme}/{{}}/1000000", "M/s/core") for name, scheme in SCHEMES[:1]]
    lines += [("bytes of a neo-Hookean particle, grid included", "epyc-26-2",
               "step/openmp/neo_hookean/quadratic/mls/float/{}/1000000", "B")]
    return grid(figures, ["one core, a million particles", "lattice", "random", "splash"],
                ["lattice", "random", "splash"], lines)


def steps_cuda(figures):
    of = "step/cuda/neo_hookean/quadratic/mls/float/"
    scenes = ("lattice", "jittered", "random")
    lines = [(f"neo-Hookean, {scene}", "h200", of + scene + "/{}", "G/s") for scene in scenes]
    lines += [("neo-Hookean, jittered, steps of `advance`", "h200", of + "jittered/advance/{}", "G/s"),
              ("fixed corotated, jittered", "h200", "step/cuda/fixed_corotated/quadratic/mls/float/jittered/{}", "G/s"),
              ("snow, jittered", "h200", "step/cuda/snow/quadratic/mls/float/jittered/{}", "G/s"),
              ("neo-Hookean, jittered: µs per step", "h200", of + "jittered/{}", "us"),
              ("neo-Hookean, jittered", "h100", of + "jittered/{}", "G/s")]
    counts = {"10000": "10 000", "125000": "125 000", "1000000": "1 million", "8000000": "8 million",
              "64000000": "64 million"}
    return grid(figures, ["quadratic, MLS, float", *counts.values()], list(counts), lines)


def busy_cores(figures):
    rows = []
    for busy in (0, 1, 2):
        of = [figures.need(f"busy_cores/{busy}/{count}/16", "x", "xeon-16") for count in (2197, 8000, 125000)]
        rows.append([str(busy), *of, figures.source()])
    return table(["busy programs", "2 197 particles", "8 000", "125 000", "measured on"], rows)


def errors(figures):
    sizes = ["8", "16", "32", "64", "128"]
    settings = [
        ("P1", "openmp", "cubic", "mls", 4, "epyc-25-17"),
        ("P1", "openmp", "quadratic", "mls", 4, "epyc-25-17"),
        ("P1", "cuda", "cubic", "mls", 4, "h200"),
        ("P1", "cuda", "quadratic", "mls", 4, "h200"),
        ("P2", "openmp", "cubic", "mls", 4, "epyc-25-17"),
        ("P2", "openmp", "quadratic", "mls", 4, "epyc-25-17"),
        ("P4", "cuda", "quadratic", "flip_1", 4, "h100"),
        ("P6", "cuda", "quadratic", "mls", 8, "h200"),
        *((problem, backend, "cubic", "mls", 4, machine, rule) for problem in ("P7", "P8")
          for backend, machine in (("openmp", "epyc-25-17"), ("cuda", "h200")) for rule in ("nodes", "surface")),
    ]
    rows = []
    for problem, backend, kernel, transfer, ppc, machine, *rule in settings:
        cells = []
        for size in sizes:
            entry = "/".join([f"{problem}/{backend}/{kernel}/{transfer}/float/0.9/{size}/{ppc}", *rule])
            error, ms = figures.get(entry, "%", machine), figures.get(entry, "ms", machine)
            cells.append(f"{error} %, {ms} ms" if error and ms else "")
        name = transfer.upper().replace("_", " ")
        where = {"nodes": ", on nodes", "surface": ", at the surface"}[rule[0]] if rule else ""
        rows.append([f"{problem}, {kernel} {name}{where}", *cells, figures.source()])
    return table(["cells", *sizes, "measured on"], rows)


def settled(figures):
    """What it costs to come to rest by damped explicit steps and by an implicit solve."""
    core, gpu = ("openmp", "epyc-25-17"), ("cuda", "h200")
    cases = [  # what, backend and machine, the explicit setting and its cells, the implicit one
        ("P2 to 1 %", core, "P2", "cubic/mls", 8, "cubic/mls", 8),
        ("P2 to 0.1 %", core, "P2", "cubic/mls", 32, "cubic/mls", 32),
        ("P2 in the same 128 cells", core, "P2", "quadratic/apic", 128, "quadratic/apic", 128),
        ("P9 to 1 %", core, "P9", "quadratic/apic", 16, "quadratic/mls", 12),
        ("P9 in the same 12 cells", core, "P9", "quadratic/apic", 12, "quadratic/apic", 12),
        ("P2 to 1 % on a GPU", gpu, "P2", "cubic/mls", 8, "cubic/mls", 8),
        ("P2 to 0.1 % on a GPU", gpu, "P2", "cubic/mls", 32, "cubic/mls", 32),
        ("P2 in the same 128 cells on a GPU", gpu, "P2", "cubic/mls", 128, "cubic/mls", 128),
        ("P9 in the same 12 cells on a GPU", gpu, "P9", "quadratic/mls", 12, "quadratic/mls", 12),
    ]
    rows = []
    for name, (backend, machine), problem, by_steps, cells, by_solve, fewer in cases:
        entries = [f"{problem}/{backend}/{setting}/float/0.9/{size}/4{end}" for setting, size, end in (
            (by_steps, cells, ""), (by_solve, fewer, "/settle"))]
        found = [(figures.need(entry, "%", machine), figures.need(entry, "ms", machine)) for entry in entries]
        ratio = float(found[0][1]) / float(found[1][1])
        rows.append([name, *(f"{setting.replace('/', ' ').replace('mls', 'MLS').replace('apic', 'APIC')}, {error} %, {ms} ms"
                             for setting, (error, ms) in zip((by_steps, by_solve), found)),
                     f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.1f}", figures.source()])
    return table(["float, on one core or a GPU", "damped explicit steps", "`settle`", "times less", "measured on"], rows)


CASES = {
    "neo_hookean_early": "neo-Hookean, at the start",
    "neo_hookean": "neo-Hookean, deformed",
    "fixed_corotated": "fixed corotated, deformed",
    "snow_early": "snow, at the start",
    "snow_packed": "snow, packed",
}


def peers(figures):
    rows = []
    for case, name in CASES.items():
        of, on = f"peers/{case}/", "epyc-26-2"
        values = [figures.need(of + entry, unit, on) for entry, unit in (
            ("firn", "ns"), ("per_core_package", "x"), ("per_core_best", "x"), ("firn/threads:2", "ns"),
            ("wall_package/threads:2", "x"), ("wall_best/threads:2", "x"))]
        rows.append([name, *values, figures.source()])
    return table(["", "Firn, one core [ns]", "best peer", "rewritten peer", "Firn, two threads [ns]", "best peer",
                  "rewritten peer", "measured on"], rows)


def waves(figures):
    sizes, machine = ["8", "16", "32", "64", "128"], "xeon-6-167"
    lines = [("error of all [%]", machine, "waves/quadratic/firn/{}", "%")]
    for name, program in (("Taichi", "taichi"), ("Warp", "warp"), ("Firn", "firn_advance")):
        lines.append((f"{name}, one thread [ms]", machine, f"waves/quadratic/{program}/{{}}", "ms"))
        program = program.replace("taichi", "taichi_cheaper")
        if name != "Warp":  # it has one thread
            lines.append((f"{name}, two threads [ms]", machine, f"waves/quadratic/{program}/{{}}/threads:2", "ms"))
    return grid(figures, ["P1, quadratic MLS, cells", *sizes], sizes, lines)


def machines(figures):
    return table(["id", "processor or GPU", "cores", "compiler"],
                 [[machine[key] for key in ("id", "processor", "cores", "compiler")] for machine in figures.machines])


def obstacles(figures):
    """What a list of obstacles costs over two that are arguments of their own."""
    machine, rows = "epyc-25-17", []
    for name, kind, first, unit, others in (
            ("a step of 131 072 particles on a floor, beside a ball", "step", "two_arguments", "ms",
             ("list_of_2_over_two", "list_of_200_over_two")),
            ("the compiler's time for the least program with two, -O3", "compile", "two_arguments", "s",
             ("list_over_two",))):
        of = f"obstacles/{kind}/"
        cells = [figures.need(of + first, unit, machine) + UNITS[unit]]
        cells += [figures.need(of + other, "x", machine) + " times" for other in others]
        rows.append([name, *cells, *[""] * (3 - len(cells)), figures.source()])
    return table(["one core", "two arguments", "a list of these", "a list of 200, of which a cell meets two or three",
                  "measured on"], rows)


def real_time(figures):
    """Of each material and kernel, the finest cells whose slowest frame took no more than it may."""
    rows = []
    for machine in ("epyc-25-1", "h200"):
        for material, name in (("water", "water that flows at 3 m/s at most"), ("water_1.5", "the same, at 1.5 m/s"),
                               ("jelly", "jelly"), ("snow", "fresh snow")):
            for kernel in ("quadratic", "cubic"):
                finest = 0
                for cells in (8, 12, 16, 24, 32, 48, 64, 96, 128):
                    slowest = figures.newest.get((f"real_time/{material}/{kernel}/{cells}/slowest", "ms", machine))
                    if slowest is not None and float(slowest["value"]) <= 1000 / 60:
                        finest = cells
                if finest == 0:
                    stop(f"{machine} holds no {material} with {kernel} kernels.")
                entry = f"real_time/{material}/{kernel}/{finest}"
                of = [figures.need(entry, "steps", machine), figures.need(entry, "ms", machine),
                      figures.need(entry + "/slowest", "ms", machine)]
                particles = f"{8 * finest ** 3:,}".replace(",", " ")
                rows.append([name, kernel, str(finest), particles, *of, figures.source()])
    return table(["a cube of 1 m", "kernel", "cells per metre", "particles", "steps per frame", "median frame [ms]",
                  "slowest [ms]", "measured on"], rows)


PAGES = {HERE / "README.md": (at_a_glance, steps, steps_cuda, busy_cores, errors, settled, peers, waves, machines),
         HERE.parent / "include" / "firn" / "REAL_TIME.md": (real_time,),
         HERE.parent / "include" / "firn" / "effects" / "README.md": (obstacles,)}


def rewritten(page, text, figures):
    """The page with every table anew."""
    tables = {make.__name__: make for make in PAGES[page]}
    there = [match[1] for match in BLOCK.finditer(text)]
    if sorted(there) != sorted(tables) or text.count("<!-- table:") != len(there):
        stop(f"{page} is to have one table each of {', '.join(tables)}, and has {', '.join(there) or 'none'}.")
    return BLOCK.sub(lambda match: f"<!-- table: {match[1]} -->\n{tables[match[1]](figures)}<!-- end -->", text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="writes nothing; exits with 1 if a page would change")
    parser.add_argument("--results", type=pathlib.Path, default=RESULTS, help="folder of the CSVs")
    options = parser.parse_args()
    figures = Figures(options.results)
    for page in PAGES:
        before = page.read_text(encoding="utf-8")
        after = rewritten(page, before, figures)
        if not options.check:
            page.write_text(after, encoding="utf-8")
        elif after != before:
            lines = before.splitlines(True), after.splitlines(True)
            sys.stdout.writelines(difflib.unified_diff(*lines, str(page), "the CSVs"))
            stop(f"the tables of {page} are not those of the CSVs: python3 bench/tables.py writes them.")


if __name__ == "__main__":
    main()

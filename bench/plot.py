# SPDX-License-Identifier: MIT
"""Error against cost, and error against cell size, as drawings: `plot.py TABLE.csv [TABLE.csv ...] [--out FOLDER]`.

Of each problem in the tables (of speed_against_error, see notes/2026-11-23-how-it-is-measured.md) two SVGs:
`P1_cost.svg`, every setting a point, those that failed as crosses on top, the Pareto front a line; and
`P1_convergence.svg`. What no other setting beats, what is beaten, and how far float is from double are printed.
"""

import argparse
import collections
import csv
import io
import itertools
import math
import pathlib
import re
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402

MIDDLE = "#7f8894"  # legible on white and on black
COLOURS = {"linear": "#b08a2e", "quadratic": "#3d8fd1", "cubic": "#d1553d"}
MARKS = {"pic": "v", "flip_0.95": "s", "flip_1": "D", "apic": "^", "mls": "o"}
RULES = {"nodes": "s", "surface": "o", "settle": "*"}  # marks by what acts, for the problems solved in two ways
TITLES = {
    "P1": "P1: large standing waves, error of positions over the amplitude",
    "P2": "P2: column under its weight, error of stress over that at the foot",
    "P3": "P3: colliding disks, error of a disk's centre over its radius",
    "P4": "P4: column of sand, error of the centre of mass over its way",
    "P7": "P7: still water in a tilted tank, rms speed over sqrt(g H)",
    "P8": "P8: floating disk, error of its depth over its diameter",
    "P9": "P9: stiff cantilever at rest, error of the sinking of its end",
    "P6": "P6: large standing waves in a cube, error of positions over the amplitude",
    "P5": "P5: block of snow on a floor, difference of the centre's height from a fine run over the side",
}
PROGRAMS = {
    "firn": ("Firn, equal steps", "#3d8fd1", "o"),
    "firn_advance": ("Firn, advance", "#3d8fd1", "s"),
    "taichi": ("Taichi", "#d1553d", "^"),
    "taichi_private": ("Taichi, a grid per thread", "#d1553d", "v"),
    "warp": ("Warp, one thread", "#b08a2e", "D"),
}
OURS = ("firn", "firn_advance")
COSTS = {
    "cpu": ("cpu_seconds", "processor time of the time loop [s]"),
    "wall": ("seconds", "time of the time loop by the clock [s]"),
    "steps": ("particle_steps", "particle-steps"),
}


class Row:
    """A line of a table."""

    def __init__(self, line):
        self.problem, self.backend, self.status = line["problem"], line["backend"], line["status"]
        self.kernel, self.transfer, self.precision = line["kernel"], line["transfer"], line["precision"]
        self.cells, self.ppc, self.fraction = int(line["cells"]), int(line["ppc"]), float(line["cfl_fraction"])
        self.acts_on = line.get("acts_on") or ""
        self.error, self.threads = float(line["error"]), int(line["threads"])
        self.line = line
        self.ok = self.status == "ok"

    def cost(self, of):
        return float(self.line[COSTS[of][0]])

    @property
    def series(self):
        """All that is chosen but the cell size."""
        return self.backend, self.kernel, self.scheme, self.precision, self.fraction, self.ppc

    @property
    def scheme(self):
        """The transfer, and by which rule obstacles act where a problem has both."""
        return f"{self.transfer} {self.acts_on}".strip()

    @property
    def mark(self):
        return RULES.get(self.acts_on) or MARKS.get(self.transfer, "*")

    def __str__(self):
        return (
            f"{self.kernel} {self.scheme} {self.precision}, {self.fraction:g} of the limit, "
            f"{self.ppc} per cell, {self.cells} cells"
        )


def front(rows, cost):
    """Those rows of which none is both cheaper and as accurate, within one per cent; by rising cost."""
    best, found = math.inf, []
    for row in sorted(rows, key=lambda row: (row.cost(cost), row.error)):
        if row.error < 0.99 * best:
            best = row.error
            found.append(row)
    return found


def axes(title, across):
    plt.rcParams.update(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "firn",
            "font.size": 9,
            "font.family": "sans-serif",
            "text.color": MIDDLE,
            "axes.labelcolor": MIDDLE,
            "axes.edgecolor": MIDDLE,
            "xtick.color": MIDDLE,
            "ytick.color": MIDDLE,
            "path.simplify": True,
        }
    )
    figure, place = plt.subplots(figsize=(7, 4.2), layout="constrained")
    place.set(xscale="log", yscale="log", xlabel=across, ylabel="error", title=title)
    place.title.set_fontsize(9)
    place.grid(True, color=MIDDLE, alpha=0.2, linewidth=0.6)
    return figure, place


def save(figure, path):
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    plt.close(figure)
    # a third of the size: a hundredth of a point is invisible
    text = re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), drawn.getvalue())
    text = re.sub(r"<!--.*?-->|; stroke-linejoin: miter|; stroke-linecap: square", "", text)
    path.write_text("\n".join(line.strip() for line in text.splitlines() if line.strip()) + "\n")
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def draw_cost(problem, rows, cost, path):
    """Error against cost; returns the front."""
    figure, place = axes(TITLES.get(problem, problem), COSTS[cost][1])
    good = [row for row in rows if row.ok and row.cost(cost) > 0]
    groups = collections.defaultdict(list)
    for row in good:
        groups[row.kernel, row.scheme, row.precision].append(row)
    for (kernel, _, precision), group in sorted(groups.items()):
        colour = COLOURS.get(kernel, MIDDLE)
        place.plot(
            [row.cost(cost) for row in group],
            [row.error for row in group],
            group[0].mark,
            markersize=4,
            markeredgecolor=colour,
            markeredgewidth=0.8,
            markerfacecolor=colour if precision == "float" else "none",
        )
    best = front(good, cost)
    place.plot([row.cost(cost) for row in best], [row.error for row in best], color=MIDDLE, linewidth=1.6, zorder=1)
    failed = [row for row in rows if not row.ok]
    top = 2 * max([row.error for row in good], default=1)
    for row in failed:  # those that were refused before the end have no time: at the left
        at = row.cost(cost) or min((other.cost(cost) for other in good), default=1)
        place.plot(at, top, "x", markersize=5, color=COLOURS.get(row.kernel, MIDDLE))
    marks = [
        plt.Line2D([], [], linestyle="", marker="o", markersize=5, color=colour, label=kernel)
        for kernel, colour in COLOURS.items()
        if any(row.kernel == kernel for row in rows)
    ]
    marks += [
        plt.Line2D([], [], linestyle="", marker=mark, markersize=5, color=MIDDLE, label=label)
        for label, mark in {**MARKS, **RULES}.items()
        if any(label in (row.transfer, row.acts_on) for row in rows)
    ]
    marks += [
        plt.Line2D([], [], linestyle="", marker="o", markersize=5, color=MIDDLE, mfc="none", label="hollow: double"),
        plt.Line2D([], [], color=MIDDLE, label="front"),
    ]
    if failed:
        marks.append(plt.Line2D([], [], linestyle="", marker="x", color=MIDDLE, label="failed"))
    place.legend(handles=marks, fontsize=7, ncols=2, framealpha=0, labelcolor=MIDDLE, loc="best")
    save(figure, path)
    return best


def lines_of(rows):
    """Of each program and kernel what it found, by rising number of cells."""
    lines = collections.defaultdict(list)
    for row in sorted(rows, key=lambda row: row.cells):
        if row.ok:
            lines[row.backend, row.kernel].append(row)
    return lines


def draw_programs(problem, rows, cost, threads, path):
    """Error against cost of several programs with the same method, a line for each and its kernel."""
    title = f"{problem} by several programs: MLS, float, {threads} thread{'s' if threads > 1 else ''}"
    figure, place = axes(title, COSTS[cost][1])
    for (program, kernel), line in sorted(lines_of(rows).items()):
        if program == "firn":
            continue  # within a few per cent of advance
        name, colour, mark = PROGRAMS[program]
        place.plot(
            [row.cost(cost) for row in line],
            [row.error for row in line],
            marker=mark,
            color=colour,
            markersize=5,
            linewidth=1,
            markerfacecolor="none" if kernel == "cubic" else colour,
            linestyle="--" if kernel == "cubic" else "-",
            label=f"{name}, {kernel}",
        )
        if (program, kernel) == ("firn_advance", "quadratic"):
            for row in line:
                place.annotate(f"{row.cells} cells", (row.cost(cost), row.error), fontsize=7, ha="right",
                               xytext=(-5, -8), textcoords="offset points")
    place.legend(fontsize=7, framealpha=0, labelcolor=MIDDLE)
    save(figure, path)


def cost_at(error, line, cost):
    """What a program pays for an error: what it paid for one as large within 2 %, or between two of its own, on straight
    lines of the drawing; None beyond them."""
    for row in line:
        if abs(row.error / error - 1) < 0.02:
            return row.cost(cost)
    for coarse, fine in zip(line, line[1:]):
        if fine.error <= error <= coarse.error:
            share = math.log(coarse.error / error) / math.log(coarse.error / fine.error)
            return coarse.cost(cost) ** (1 - share) * fine.cost(cost) ** share
    return None


def least(error, lines, programs, cost):
    """The least that some programs pay for an error, with whatever kernel, and which of them pays it."""
    paid = [(cost_at(error, line, cost), program) for program, line in lines.items() if program[0] in programs]
    return min((pair for pair in paid if pair[0]), default=None)


def say_programs(problem, rows, cost):
    """The cost of other programs over Firn's at equal error: with the same kernel, and of the best of both."""
    lines = lines_of(rows)
    theirs = sorted(set(PROGRAMS) - set(OURS))
    print(f"\n{problem}, {COSTS[cost][1]} over that of Firn at equal error:")
    for ours, other, kernel in itertools.product(OURS, theirs, ("quadratic", "cubic")):
        ratios = [(row, cost_at(row.error, lines[ours, kernel], cost)) for row in lines.get((other, kernel), [])]
        told = [f"{row.cost(cost) / at:.2f} ({row.cells} cells, {100 * row.error:.3g} %)" for row, at in ratios if at]
        if told:
            print(f"  {PROGRAMS[other][0]} over {PROGRAMS[ours][0]}, {kernel}: {', '.join(told)}")
    print("  the best of the others over the best of Firn, whatever their kernels:")
    told = math.inf
    for error in sorted({row.error for program, line in lines.items() if program[0] in theirs for row in line}, reverse=True):
        if error > 0.99 * told:
            continue  # another program's, and the same
        told = error
        best, own = least(error, lines, theirs, cost), least(error, lines, OURS, cost)
        if best and own:
            (paid, (program, kernel)), (at, (_, our_kernel)) = best, own
            print(
                f"    {100 * error:8.3g} %: {paid / at:5.2f} "
                f"({PROGRAMS[program][0]}, {kernel}: {1000 * paid:.3g} ms; Firn, {our_kernel}: {1000 * at:.3g} ms)"
            )


def say_energy(problem, rows):
    """What is lost of the energy at the start, where a problem tells."""
    told = [row for row in rows if row.ok and row.line.get("energy_lost") and row.fraction == 0.9 and row.ppc == 4]
    if not told:
        return
    sizes = sorted({row.cells for row in told})
    print(f"\n{problem}, energy lost in the end [% of that at the start], at {', '.join(map(str, sizes))} cells:")
    lines = collections.defaultdict(dict)
    for row in told:
        lines[row.kernel, row.transfer, row.precision][row.cells] = f"{100 * float(row.line['energy_lost']):.2f}"
    for (kernel, transfer, precision), line in sorted(lines.items()):
        print(f"  {kernel} {transfer} {precision}: {', '.join(line.get(size, '-') for size in sizes)}")


def draw_convergence(problem, rows, path):
    """Error against cell size at the library's step with the fewest particles per cell, in the highest precision."""
    figure, place = axes(TITLES.get(problem, problem), "cells")
    lines = collections.defaultdict(list)
    chosen = [row for row in rows if row.ok and row.fraction == 0.9]
    precision = min((row.precision for row in chosen), default="double")  # "double" comes before "float"
    fewest = min((row.ppc for row in chosen), default=4)
    for row in chosen:
        if row.precision == precision and row.ppc == fewest:
            lines[row.kernel, row.scheme].append(row)
    for (kernel, scheme), line in sorted(lines.items()):
        line.sort(key=lambda row: row.cells)
        place.plot(
            [row.cells for row in line],
            [row.error for row in line],
            marker=line[0].mark,
            color=COLOURS.get(kernel, MIDDLE),
            markersize=4,
            linewidth=1,
            label=f"{kernel} {scheme}",
        )
    every = [row for line in lines.values() for row in line]
    if every:
        sizes = sorted({row.cells for row in every})
        place.set_xticks(sizes, [str(size) for size in sizes])
        place.minorticks_off()
        # triangles of slope, below all lines: error falls with the first and second power of the cell size
        y, left, right = 0.7 * min(row.error for row in every), sizes[0], sizes[0] * 2
        for order in (1, 2):
            place.plot([left, right, left, left], [y, y / 2**order, y / 2**order, y], color=MIDDLE, linewidth=1)
            place.annotate(f"{order}", (left * 1.05, y / 2**order * 1.06), fontsize=7)
            y /= 2.6
    place.legend(fontsize=7, framealpha=0, labelcolor=MIDDLE, bbox_to_anchor=(1, 1), loc="upper left")
    save(figure, path)


def say(problem, rows, best, cost):
    """The front, what it leaves behind, and what fails."""
    good, failed = [row for row in rows if row.ok], [row for row in rows if not row.ok]
    print(f"\n{problem}: {len(good)} settings solved it, {len(failed)} failed. The front, by {COSTS[cost][1]}:")
    for row in best:
        print(f"  {row.cost(cost):10.4g}  error {row.error:.2e}  {row}")
    on_front = {row.series for row in best}
    beaten = collections.Counter(row.series for row in good if row.series not in on_front)
    print(f"  never on it, at any size ({len(beaten)} of {len({row.series for row in rows})} series):")
    names = collections.defaultdict(list)
    for backend, kernel, scheme, precision, fraction, ppc in beaten:
        names[kernel, scheme].append(f"{precision} {fraction:g}/{ppc}")
    for (kernel, scheme), which in sorted(names.items()):
        print(f"    {kernel} {scheme}: {', '.join(sorted(which))}")
    for row in failed:
        print(f"  failed: {row}: {row.status[:100]}")
    for wanted in (0.01, 0.001):
        near = [row for row in good if row.error <= wanted]
        if near:
            row = min(near, key=lambda row: row.cost(cost))
            print(f"  cheapest at {100 * wanted:g} %: {row} ({row.cost(cost):.3g}, error {row.error:.2e})")
        else:
            print(f"  nothing comes to {100 * wanted:g} %")


def compare_precisions(rows):
    """The error of float over that of double, wherever both were measured with all else alike."""
    pairs = collections.defaultdict(dict)
    for row in rows:
        key = row.problem, row.backend, row.kernel, row.scheme, row.fraction, row.ppc, row.cells
        pairs[key][row.precision] = row
    ratios = []
    for pair in pairs.values():
        if len(pair) == 2 and all(row.ok for row in pair.values()):
            ratios.append((pair["float"].error / pair["double"].error, pair["float"]))
    print("\nError in float over that in double (aim: at most 1.1):")
    for problem in sorted({row.problem for _, row in ratios}):
        of = sorted((ratio, str(row)) for ratio, row in ratios if row.problem == problem)
        beyond = [(ratio, name) for ratio, name in of if ratio > 1.1]
        median = of[len(of) // 2][0]
        print(f"  {problem}: {len(of)} pairs, median {median:.4f}, largest {of[-1][0]:.3f}, beyond 1.1: {len(beyond)}")
        for ratio, name in reversed(beyond):
            print(f"    {ratio:.3f}  {name}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("tables", nargs="+", type=pathlib.Path)
    arguments.add_argument("--out", type=pathlib.Path, default=pathlib.Path("."), help="folder of the drawings")
    arguments.add_argument("--cost", choices=COSTS,
                           help="by default processor time; for a GPU, whose work takes none, and threads the clock")
    options = arguments.parse_args()
    rows = []
    for table in options.tables:
        if not table.is_file():
            sys.exit(f"stop: there is no {table}: see bench/README.md for what writes it.")
        with table.open(newline="") as lines:
            rows += [Row(line) for line in csv.DictReader(lines)]
    if not rows:
        sys.exit("stop: the tables are empty.")
    options.out.mkdir(parents=True, exist_ok=True)
    of_programs = [row for row in rows if row.backend in PROGRAMS]
    for problem in sorted({row.problem for row in of_programs}):
        threads = max(row.threads for row in of_programs)
        if any(row.threads != threads for row in of_programs if row.backend != "warp"):
            sys.exit("stop: the tables are of different numbers of threads: draw one at a time.")
        cost = options.cost or ("cpu" if threads == 1 else "wall")
        name = f"{problem}_peers.svg" if threads == 1 else f"{problem}_peers_{threads}.svg"
        draw_programs(problem, of_programs, cost, threads, options.out / name)
        say_programs(problem, of_programs, cost)
    rows = [row for row in rows if row.backend not in PROGRAMS]
    if not rows:
        return
    for problem, backend in sorted({(row.problem, row.backend) for row in rows}):
        of = [row for row in rows if (row.problem, row.backend) == (problem, backend)]
        name = problem if backend == "openmp" else f"{problem}_{backend}"
        cost = options.cost or ("cpu" if backend == "openmp" else "wall")
        best = draw_cost(problem, of, cost, options.out / f"{name}_cost.svg")
        draw_convergence(problem, of, options.out / f"{name}_convergence.svg")
        say(name, of, best, cost)
        say_energy(name, of)
    compare_precisions(rows)


if __name__ == "__main__":
    main()

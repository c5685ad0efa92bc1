# SPDX-License-Identifier: MIT
"""Problem P1 of speed_against_error by Taichi and Warp: `waves.py taichi|warp [--kernel KERNEL] [--out TABLE]`,
and by them and Firn in turns: `waves.py all --firn PROGRAM [--threads N] [--rounds N] [--out TABLE]`, see run.sh.

Large standing waves in a unit square between smooth walls, with an exact solution: see StandingWaves and Driven in
tests/problems/manufactured.hpp. MLS-MPM with quadratic or cubic kernels in float on a dense grid; walls mirror the
nodes behind them. As many steps as Firn takes. Rows are those of speed_against_error; plot.py draws all programs in
one drawing.

With several threads Taichi's scatter has one of them (`serial`), or each adds to a grid of its own (`private`); atomic
additions, what one gets without asking, take several times as long. Warp has one thread on a processor.
"""

import argparse
import csv
import datetime
import itertools
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

A, K, SPEED, YOUNG, DENSITY = 0.05, 2 * np.pi, 100.0, 1e7, 1000.0
MU, LAMBDA = YOUNG / 2.6, YOUNG * 0.3 / (1.3 * 0.4)
HALF_PERIOD, PIECES = 1 / SPEED, 5
STEPS = {  # Firn's, to a multiple of PIECES
    "quadratic": {8: 15, 16: 30, 32: 55, 64: 110, 128: 215},
    "cubic": {8: 15, 16: 25, 32: 50, 64: 95, 128: 190},
}
WIDTH = {"quadratic": 3, "cubic": 4}  # nodes along an axis
INVERSE_INERTIA = {"quadratic": 4, "cubic": 3}  # of a kernel, in cells
PAD = 1  # nodes behind each wall


def problem(cells):
    """Reference positions, velocities, their gradients' diagonals and the largest strains."""
    middles = (np.arange(2 * cells) + 0.5) / (2 * cells)
    X = np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1).reshape(-1, 2)
    sign = np.array([1, -1])
    strain = A * K * np.cos(K * X) * sign
    return X, A * SPEED * np.pi * np.sin(K * X) * sign, SPEED * np.pi * strain, strain


def error(X, x, piece):
    u = A * np.sin(np.pi * (piece + 1) / PIECES)
    exact = X + u * np.sin(K * X) * np.array([1, -1])
    return np.sqrt(((x - exact) ** 2).sum(axis=1).mean()) / A


class WithTaichi:
    """The loops in one kernel per step."""

    def __init__(self, kernel, threads, scatter):
        import taichi as ti

        self.ti, self.name, self.kernel = ti, "taichi " + ".".join(map(str, ti.__version__)), kernel
        self.grids = threads if scatter == "private" else 1
        ti.init(arch=ti.cpu, cpu_max_num_threads=threads, default_fp=ti.f32, fast_math=False, log_level=ti.ERROR)

    def set_up(self, cells):
        ti, grids = self.ti, self.grids
        N, size, h = cells, cells + 1 + 2 * PAD, 1 / cells
        n, volume = 4 * N * N, (h / 2) ** 2
        mass, dt = DENSITY * volume, HALF_PERIOD / STEPS[self.kernel][cells]
        width, inverse_inertia = WIDTH[self.kernel], INVERSE_INERTIA[self.kernel]
        vec2, mat2 = ti.types.vector(2, ti.f32), ti.types.matrix(2, 2, ti.f32)
        x, v, strain = (ti.Vector.field(2, ti.f32, n) for _ in range(3))
        C, F, given = (ti.Matrix.field(2, 2, ti.f32, n) for _ in range(3))
        grid = ti.Vector.field(3, ti.f32, (grids, size, size))
        velocity = ti.Vector.field(2, ti.f32, (size, size))
        self.x, self.v, self.C, self.F, self.strain, self.n = x, v, C, F, strain, n

        @ti.func
        def give(p, s):  # what a particle scatters beside m v: (m C - dt V0 D^-1 tau) h
            G = F[p]
            J = G.determinant()
            tau = MU * (G @ G.transpose())
            e = strain[p] * s
            log_wanted = ti.log((1.0 + e[0]) * (1.0 + e[1]))
            for a in ti.static(range(2)):
                f = 1.0 + e[a]
                driving = 0.25 * YOUNG * e[a] - (MU * (f - 1.0 / f) + LAMBDA * log_wanted / f)
                tau[a, a] += LAMBDA * ti.log(J) - MU + driving * G[a, a]
            given[p] = (mass * h) * C[p] - (dt * volume * inverse_inertia / h) * tau

        @ti.kernel
        def begin():
            for p in range(n):
                give(p, 0.0)

        @ti.func
        def weights(p):  # of the nodes from the first on, and how far from that the particle is
            at = x[p] * N
            base = ti.floor(at - 0.5 * (width - 2))
            t = at - base
            w = ti.Matrix.zero(ti.f32, 2, width)
            if ti.static(width == 3):
                w = ti.Matrix.cols([0.5 * (1.5 - t) ** 2, 0.75 - (t - 1.0) ** 2, 0.5 * (t - 0.5) ** 2])
            else:
                s = t - 1.0
                r = 1.0 - s
                inner_s = (0.5 * s - 1.0) * s**2 + 2.0 / 3.0
                inner_r = (0.5 * r - 1.0) * r**2 + 2.0 / 3.0
                w = ti.Matrix.cols([r**3 / 6.0, inner_s, inner_r, s**3 / 6.0])
            return ti.cast(base, ti.i32) + PAD, t, w

        @ti.func
        def scatter(p, part):
            base, t, w = weights(p)
            for i, j in ti.static(ti.ndrange(width, width)):
                q = mass * v[p] + given[p] @ ti.Vector([i - t[0], j - t[1]])
                node = ti.Vector([q[0], q[1], mass])
                if ti.static(grids > 1):  # no atomic additions
                    grid[part, base[0] + i, base[1] + j] = grid[part, base[0] + i, base[1] + j] + w[0, i] * w[1, j] * node
                else:
                    grid[0, base[0] + i, base[1] + j] += w[0, i] * w[1, j] * node

        @ti.kernel
        def step(s: ti.f32):
            for part, i, j in grid:
                grid[part, i, j] = ti.Vector([0.0, 0.0, 0.0])
            if ti.static(grids > 1):
                # Taichi deals loops out in blocks, and one of few turns to one thread: most turns are idle.
                for turn in range(grids * 512):
                    if turn % 512 == 0:
                        part = turn // 512
                        for p in range(part * n // grids, (part + 1) * n // grids):
                            scatter(p, part)
                for i, j in velocity:
                    for part in ti.static(range(1, grids)):
                        grid[0, i, j] += grid[part, i, j]
            else:
                ti.loop_config(serialize=True)
                for p in range(n):
                    scatter(p, 0)
            for i, j in velocity:
                total = ti.Vector([0.0, 0.0, 0.0])
                across = ti.Vector([PAD + PAD - i, PAD + PAD - j])  # the images behind the lower walls
                if i > size // 2:
                    across[0] = 2 * (N + PAD) - i
                if j > size // 2:
                    across[1] = 2 * (N + PAD) - j
                for a, b in ti.static(ti.ndrange(2, 2)):
                    k = across[0] if ti.static(a == 1) else i
                    l = across[1] if ti.static(b == 1) else j
                    if 0 <= k < size and 0 <= l < size and (a == 0 or k != i) and (b == 0 or l != j):
                        node = grid[0, k, l]
                        total += ti.Vector([(1 - 2 * a) * node[0], (1 - 2 * b) * node[1], node[2]])
                u = ti.Vector([0.0, 0.0])
                if total[2] > 1e-20 * mass:
                    u = ti.Vector([total[0], total[1]]) / total[2]
                if i == PAD or i == N + PAD:
                    u[0] = 0.0
                if j == PAD or j == N + PAD:
                    u[1] = 0.0
                velocity[i, j] = u
            for p in range(n):
                base, t, w = weights(p)
                u = vec2(0.0)
                B = mat2(0.0)
                for i, j in ti.static(ti.ndrange(width, width)):
                    part = w[0, i] * w[1, j] * velocity[base[0] + i, base[1] + j]
                    u += part
                    B += part.outer_product(ti.Vector([i - t[0], j - t[1]]))
                v[p] = u
                C[p] = (float(inverse_inertia) * N) * B
                x[p] += dt * u
                F[p] += dt * C[p] @ F[p]
                give(p, s)

        self.begin, self.step = begin, step

    def start(self, X, v, gradient, strain):
        self.x.from_numpy(X.astype(np.float32))
        self.v.from_numpy(v.astype(np.float32))
        C = np.zeros((self.n, 2, 2), np.float32)
        C[:, 0, 0], C[:, 1, 1] = gradient.T
        self.C.from_numpy(C)
        self.F.from_numpy(np.tile(np.eye(2, dtype=np.float32), (self.n, 1, 1)))
        self.strain.from_numpy(strain.astype(np.float32))
        self.begin()

    def wait(self):
        self.ti.sync()

    def positions(self):
        return self.x.to_numpy()


class WithWarp:
    """Three launches per step."""

    def __init__(self, kernel):
        import warp as wp

        self.wp, self.name, self.kernel = wp, f"warp {wp.__version__}", kernel
        wp.config.quiet = True
        wp.config.enable_backward = False
        wp.init()

    def set_up(self, cells):
        wp = self.wp
        N, size, h = cells, cells + 1 + 2 * PAD, 1 / cells
        self.n, self.size = 4 * N * N, size
        volume = (h / 2) ** 2
        dt = HALF_PERIOD / STEPS[self.kernel][cells]
        N_, size_, pad = wp.constant(N), wp.constant(size), wp.constant(PAD)
        h_, dt_ = wp.constant(h), wp.constant(dt)
        mass = wp.constant(DENSITY * volume)
        mu, lam, quarter = wp.constant(MU), wp.constant(LAMBDA), wp.constant(0.25 * YOUNG)
        impulse = wp.constant(dt * volume * INVERSE_INERTIA[self.kernel] / h)
        width, shift = wp.constant(WIDTH[self.kernel]), wp.constant(0.5 * (WIDTH[self.kernel] - 2))
        inverse_inertia = wp.constant(float(INVERSE_INERTIA[self.kernel]))

        if self.kernel == "quadratic":

            @wp.func
            def weight(t: float, i: int):
                w = 0.75 - (t - 1.0) * (t - 1.0)
                if i == 0:
                    w = 0.5 * (1.5 - t) * (1.5 - t)
                if i == 2:
                    w = 0.5 * (t - 0.5) * (t - 0.5)
                return w

        else:

            @wp.func
            def weight(t: float, i: int):
                s = t - 1.0
                if i >= 2:
                    s = 2.0 - t
                r = 1.0 - s
                w = (0.5 * s - 1.0) * s * s + 2.0 / 3.0
                if i == 0 or i == 3:
                    w = r * r * r / 6.0
                return w

        @wp.func
        def first_node(at: wp.vec2):
            return wp.vec2(wp.floor(at[0] - shift), wp.floor(at[1] - shift))

        @wp.func
        def answer(C: wp.mat22, G: wp.mat22, e: wp.vec2):
            tau = mu * (G * wp.transpose(G))
            pressure = lam * wp.log(wp.determinant(G)) - mu
            wanted = lam * wp.log((1.0 + e[0]) * (1.0 + e[1]))
            f0 = 1.0 + e[0]
            f1 = 1.0 + e[1]
            d0 = quarter * e[0] - (mu * (f0 - 1.0 / f0) + wanted / f0)
            d1 = quarter * e[1] - (mu * (f1 - 1.0 / f1) + wanted / f1)
            tau = tau + wp.mat22(pressure + d0 * G[0, 0], 0.0, 0.0, pressure + d1 * G[1, 1])
            return mass * h_ * C - impulse * tau

        @wp.kernel
        def begin(C: wp.array(dtype=wp.mat22), F: wp.array(dtype=wp.mat22), given: wp.array(dtype=wp.mat22)):
            p = wp.tid()
            given[p] = answer(C[p], F[p], wp.vec2(0.0, 0.0))

        @wp.kernel
        def scatter(
            x: wp.array(dtype=wp.vec2),
            v: wp.array(dtype=wp.vec2),
            given: wp.array(dtype=wp.mat22),
            grid: wp.array2d(dtype=wp.vec3),
        ):
            p = wp.tid()
            at = x[p] * float(N_)
            first = first_node(at)
            t = at - first
            A_p = given[p]
            u = v[p]
            for i in range(width):
                for j in range(width):
                    w = weight(t[0], i) * weight(t[1], j)
                    q = mass * u + A_p * wp.vec2(float(i) - t[0], float(j) - t[1])
                    wp.atomic_add(grid, int(first[0]) + pad + i, int(first[1]) + pad + j, w * wp.vec3(q[0], q[1], mass))

        @wp.kernel
        def update(grid: wp.array2d(dtype=wp.vec3), velocity: wp.array2d(dtype=wp.vec2)):
            i, j = wp.tid()
            k = 2 * pad - i
            if i > size_ / 2:
                k = 2 * (N_ + pad) - i
            l = 2 * pad - j
            if j > size_ / 2:
                l = 2 * (N_ + pad) - j
            beside_x = k >= 0 and k < size_ and k != i
            beside_y = l >= 0 and l < size_ and l != j
            total = grid[i, j]
            if beside_x:
                node = grid[k, j]
                total = total + wp.vec3(-node[0], node[1], node[2])
            if beside_y:
                node = grid[i, l]
                total = total + wp.vec3(node[0], -node[1], node[2])
            if beside_x and beside_y:
                node = grid[k, l]
                total = total + wp.vec3(-node[0], -node[1], node[2])
            ux = float(0.0)
            uy = float(0.0)
            if total[2] > 1.0e-20 * mass:
                ux = total[0] / total[2]
                uy = total[1] / total[2]
            if i == pad or i == N_ + pad:
                ux = 0.0
            if j == pad or j == N_ + pad:
                uy = 0.0
            velocity[i, j] = wp.vec2(ux, uy)

        @wp.kernel
        def gather(
            x: wp.array(dtype=wp.vec2),
            v: wp.array(dtype=wp.vec2),
            C: wp.array(dtype=wp.mat22),
            F: wp.array(dtype=wp.mat22),
            strain: wp.array(dtype=wp.vec2),
            velocity: wp.array2d(dtype=wp.vec2),
            s: float,
            given: wp.array(dtype=wp.mat22),
        ):
            p = wp.tid()
            at = x[p] * float(N_)
            first = first_node(at)
            t = at - first
            u = wp.vec2(0.0, 0.0)
            B = wp.mat22(0.0, 0.0, 0.0, 0.0)
            for i in range(width):
                for j in range(width):
                    part = (weight(t[0], i) * weight(t[1], j)) * velocity[int(first[0]) + pad + i, int(first[1]) + pad + j]
                    u = u + part
                    B = B + wp.outer(part, wp.vec2(float(i) - t[0], float(j) - t[1]))
            L = (inverse_inertia / h_) * B
            G = F[p] + dt_ * (L * F[p])
            v[p] = u
            C[p] = L
            x[p] = x[p] + dt_ * u
            F[p] = G
            given[p] = answer(L, G, s * strain[p])

        self.kernels = begin, scatter, update, gather

    def start(self, X, v, gradient, strain):
        wp, n = self.wp, self.n
        of = lambda values, kind: wp.array(np.ascontiguousarray(values, np.float32), dtype=kind, device="cpu")
        C = np.zeros((n, 2, 2))
        C[:, 0, 0], C[:, 1, 1] = gradient.T
        self.x, self.v, self.strain = of(X, wp.vec2), of(v, wp.vec2), of(strain, wp.vec2)
        self.C, self.F, self.given = of(C, wp.mat22), of(np.tile(np.eye(2), (n, 1, 1)), wp.mat22), of(C, wp.mat22)
        self.grid = wp.zeros((self.size, self.size), dtype=wp.vec3, device="cpu")
        self.velocity = wp.zeros((self.size, self.size), dtype=wp.vec2, device="cpu")
        wp.launch(self.kernels[0], n, [self.C, self.F, self.given], device="cpu")

    def step(self, s):
        wp, (_, scatter, update, gather) = self.wp, self.kernels
        self.grid.zero_()
        wp.launch(scatter, self.n, [self.x, self.v, self.given, self.grid], device="cpu")
        wp.launch(update, (self.size, self.size), [self.grid, self.velocity], device="cpu")
        wp.launch(
            gather,
            self.n,
            [self.x, self.v, self.C, self.F, self.strain, self.velocity, float(s), self.given],
            device="cpu",
        )

    def wait(self):
        pass

    def positions(self):
        return self.x.numpy()


def measure(program, cells, runs):
    """The largest error, and the times of some runs after one that compiles."""
    program.set_up(cells)
    X, v, gradient, strain = problem(cells)
    steps, worst, wall, processor = STEPS[program.kernel][cells], 0.0, [], []
    heights = [float(np.sin(np.pi * (step + 1) / steps)) for step in range(steps)]
    for run in range(runs + 1):
        program.start(X, v, gradient, strain)
        program.wait()
        spent_wall = spent_processor = 0.0
        for piece in range(PIECES):
            before_wall, before_processor = time.perf_counter(), time.process_time()
            for step in range(piece * steps // PIECES, (piece + 1) * steps // PIECES):
                program.step(heights[step])
            program.wait()
            spent_wall += time.perf_counter() - before_wall
            spent_processor += time.process_time() - before_processor
            worst = float(np.maximum(worst, error(X, program.positions(), piece)))  # keeps what is no number
        if run > 0:
            wall.append(spent_wall)
            processor.append(spent_processor)
    return worst, wall, processor


def in_turns(firn, threads, rounds, out):
    """Every program once a round, which compiles or warms up and is timed once; medians of all rounds."""
    programs = ["firn", "taichi", "warp"] if threads == 1 else ["firn", "taichi", "taichi_private", "warp"]
    found = {}
    for number in range(rounds):
        print(f"round {number + 1} of {rounds}", file=sys.stderr)
        for program, kernel in itertools.product(programs, WIDTH):
            with tempfile.TemporaryDirectory() as folder:
                table = pathlib.Path(folder) / "rows.csv"
                command = [str(firn)] if program == "firn" else [sys.executable, __file__, program]
                subprocess.run(
                    command + ["--kernel", kernel, "--threads", str(threads), "--runs", "1", "--out", str(table)],
                    check=True,
                    env=os.environ | {"OMP_NUM_THREADS": str(threads)},
                    stdout=subprocess.DEVNULL,
                )
                with table.open(newline="") as lines:
                    for row in csv.DictReader(lines):
                        found.setdefault((row["backend"], kernel, int(row["cells"])), []).append(row)
    with out.open("w", newline="") as file:
        table = csv.DictWriter(file, next(iter(found.values()))[0].keys(), lineterminator="\n")
        table.writeheader()
        for _, rows in sorted(found.items()):
            of = lambda column: [float(row[column]) for row in rows]
            wall = of("seconds")
            spread = (np.percentile(wall, 75) - np.percentile(wall, 25)) / 2 / np.median(wall)
            table.writerow(
                rows[0]
                | {"seconds": f"{np.median(wall):.6g}", "cpu_seconds": f"{np.median(of('cpu_seconds')):.6g}"}
                | {"spread": f"{spread:.3g}", "runs": len(rows)}
                | {"status": next((row["status"] for row in rows if row["status"] != "ok"), "ok")}
            )
    cost = "cpu_seconds" if threads == 1 else "seconds"
    print(f"{'cells':>6} {'kernel':>10} {'program':>14} {'error':>10}   {cost.replace('_', ' ')}, in ms")
    for (program, kernel, cells), rows in sorted(found.items(), key=lambda item: item[0][::-1]):
        milliseconds = 1000 * np.median([float(row[cost]) for row in rows])
        print(f"{cells:6} {kernel:>10} {program:>14} {float(rows[0]['error']):10.4g} {milliseconds:13.3g}")


def above_0(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return number


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("program", choices=("taichi", "taichi_private", "warp", "all"))
    arguments.add_argument("--kernel", choices=tuple(WIDTH), default="quadratic", help="of a program; all have both")
    arguments.add_argument("--threads", type=above_0, default=1)
    arguments.add_argument("--runs", type=above_0, default=5)
    arguments.add_argument("--out", type=pathlib.Path, default=None, help="table; the screen, if there is none")
    arguments.add_argument("--firn", type=pathlib.Path, help="the program firn_waves, for all")
    arguments.add_argument("--rounds", type=above_0, default=5, help="turns that every program takes, for all")
    options = arguments.parse_args()
    if options.program == "all":
        if options.firn is None:
            arguments.error("all needs --firn")
        return in_turns(options.firn, options.threads, options.rounds, options.out or pathlib.Path("waves.csv"))
    kernel, threads = options.kernel, options.threads
    if options.program == "warp":
        program, threads = WithWarp(kernel), 1
    else:
        program = WithTaichi(kernel, threads, "private" if options.program == "taichi_private" else "serial")
    columns = (
        "problem,backend,model,kernel,transfer,precision,cfl_fraction,cells,ppc,deterministic,error,seconds,particle_steps,"
        "bytes_per_particle,status,spread,cpu_seconds,runs,steps,rejected,threads,hardware,compiler,commit,date"
    ).split(",")
    file = options.out.open("w", newline="") if options.out else sys.stdout
    table = csv.writer(file)
    table.writerow(columns)
    for cells, steps in STEPS[kernel].items():
        worst, wall, processor = measure(program, cells, options.runs)
        spread = (np.percentile(wall, 75) - np.percentile(wall, 25)) / 2 / np.median(wall)
        table.writerow(
            ["P1", options.program, "neo_hookean", kernel, "mls", "float", 0.9, cells, 4, "yes", f"{worst:.6g}"]
            + [f"{np.median(wall):.6g}", 4 * cells * cells * steps, 76, "ok" if worst < 1 else "failed: no solution"]
            + [f"{spread:.3g}", f"{min(processor):.6g}", options.runs, steps, 0, threads, "this machine", program.name, ""]
            + [datetime.date.today()]
        )
        file.flush()


if __name__ == "__main__":
    main()

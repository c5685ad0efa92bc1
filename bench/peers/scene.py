# SPDX-License-Identifier: MIT
"""The scenes that all programs step: what README.md describes, written once, so that they start from the same bits.

A scene is a folder with `scene.txt`, lines of a name and a value, and `particles.bin`, per particle three float32 of
position [m] and three of velocity [m/s], in the order of cells.
"""

import dataclasses
import json
import math
import pathlib
import resource
import sys
import time

import numpy as np

CELL = 0.01  # h [m]
FIELDS = 16  # of a final state: position, velocity, F or F_E by rows, J_P; float64


@dataclasses.dataclass
class Scene:
    case: str
    model: str  # neo_hookean, fixed_corotated or snow
    kernel: str  # quadratic or cubic
    density: float  # [kg/m^3]
    young: float  # [Pa]
    poisson: float
    dt: float  # [s]
    warm_up: int  # steps before the clock starts: they compile, and bring the body into the state to be timed
    steps: int  # steps that are timed
    motion: str  # deform or converge
    rate: float  # of the initial velocity field [1/s]
    particles: int = 0
    nodes: int = 0  # per axis of a dense grid
    cell: float = CELL
    volume: float = (CELL / 2) ** 3  # of a particle [m^3]: eight per cell
    # of snow (Stomakhin et al. 2013, table 2), and the range in which J_P hardens
    critical_compression: float = 2.5e-2
    critical_stretch: float = 7.5e-3
    hardening: float = 10.0
    smallest_plastic_ratio: float = 0.6
    largest_plastic_ratio: float = 20.0

    @property
    def mass(self):
        return self.density * self.volume

    @property
    def mu(self):
        return self.young / (2 * (1 + self.poisson))

    @property
    def lambda_(self):
        return self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson))


def _jelly(case, model, **more):
    return Scene(case, model, "quadratic", density=1000, young=1e5, poisson=0.3, dt=1e-4, motion="deform", **more)


def _snow(case, kernel, **more):
    return Scene(case, "snow", kernel, density=400, young=1.4e5, poisson=0.2, dt=4e-5, motion="converge", **more)


CASES = {
    scene.case: scene
    for scene in (
        _jelly("neo_hookean_early", "neo_hookean", rate=1, warm_up=10, steps=50),
        _jelly("neo_hookean", "neo_hookean", rate=40, warm_up=100, steps=50),
        _jelly("fixed_corotated", "fixed_corotated", rate=40, warm_up=100, steps=50),
        _snow("snow_early", "quadratic", rate=2.5, warm_up=10, steps=50),
        _snow("snow_packed", "quadratic", rate=50, warm_up=100, steps=50),
        _snow("snow_cubic", "cubic", rate=50, warm_up=100, steps=50),
    )
}


def positions(side, centre):
    """A cube of side^3 particles, half a cell apart, jittered by a tenth of that, in the order of cells [m]."""
    jitter = np.random.Generator(np.random.PCG64(7)).random((side**3, 3))
    place = np.stack(np.meshgrid(*3 * [np.arange(side)], indexing="ij"), axis=-1).reshape(-1, 3)
    x = centre + (place - side / 2 + 0.45 + 0.1 * jitter) * (CELL / 2)
    cell = np.floor(x / CELL - 0.5).astype(np.int64)
    return x[np.lexsort((cell[:, 2], cell[:, 1], cell[:, 0]))]


def velocities(scene, x, centre, half):
    """The initial velocities [m/s] as a formula of the positions; u is 1 on the faces of the cube."""
    u, v, w = ((x - centre) / half).T
    if scene.motion == "deform":  # stretched, sheared and twisted
        shape = (
            u + 0.7 * np.sin(np.pi * v) + v * w,
            -0.6 * v + 0.5 * np.sin(np.pi * w),
            -0.3 * w + 0.4 * np.sin(np.pi * u) - v * u,
        )
    else:  # towards the centre, unevenly
        shape = (
            -1.2 * u + 0.2 * np.sin(np.pi * v),
            -0.9 * v + 0.2 * np.sin(np.pi * w) * u,
            -w + 0.1 * np.sin(np.pi * u),
        )
    drift = 0.01 * CELL / scene.dt * np.array([1, -0.6, 0.4])  # cells per step
    return drift + scene.rate * half * np.stack(shape, axis=-1)


def write(scene, particles, folder):
    """Writes the scene with about that many particles; returns it as written."""
    side = max(2, round(particles ** (1 / 3)))
    cells = math.ceil(side / 2)
    nodes = 8 * math.ceil((2 * cells + 14) / 8)
    scene = dataclasses.replace(scene, particles=side**3, nodes=nodes)
    centre = np.full(3, nodes * CELL / 2)
    x = positions(side, centre)
    v = velocities(scene, x, centre, side * CELL / 4)
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    np.concatenate([x, v], axis=1).astype("<f4").tofile(folder / "particles.bin")
    lines = [f"{field.name} {getattr(scene, field.name)!r}" for field in dataclasses.fields(scene)]
    lines += [f"{name} {getattr(scene, name)!r}" for name in ("mass", "mu", "lambda_")]
    (folder / "scene.txt").write_text("\n".join(lines).replace("'", "") + "\n")
    return scene


def read(folder):
    """The scene in a folder, its positions and its velocities."""
    folder = pathlib.Path(folder)
    words = dict(line.split() for line in (folder / "scene.txt").read_text().splitlines())
    fields = {field.name: field.type(words[field.name]) for field in dataclasses.fields(Scene)}
    both = np.fromfile(folder / "particles.bin", "<f4").reshape(-1, 6)
    return Scene(**fields), both[:, :3], both[:, 3:]


def measure(scene, advance, wait):
    """Takes the steps of the warm-up, times the others; returns what they cost."""

    def user():
        return resource.getrusage(resource.RUSAGE_SELF).ru_utime

    for _ in range(scene.warm_up):
        advance()
    wait()
    user_start, wall_start = user(), time.perf_counter()
    for _ in range(scene.steps):
        advance()
    wait()
    wall, user_spent = time.perf_counter() - wall_start, user() - user_start
    particle_steps = scene.particles * scene.steps
    return {"user_ns": 1e9 * user_spent / particle_steps, "wall_ns": 1e9 * wall / particle_steps}


def report(scene, result, state, path):
    """Prints what a run cost as a line of JSON, and writes its final state for the comparison."""
    at = np.asarray(state)[:, :3] / scene.cell
    if not (np.isfinite(at).all() and at.min() > 2 and at.max() < scene.nodes - 3):
        sys.exit("stop: particles left the dense grid, which nothing checks in the loops: give the scene more nodes.")
    if path:
        np.asarray(state, dtype="<f8").tofile(path)
    print(json.dumps(result), flush=True)

# SPDX-License-Identifier: MIT
"""A scene stepped by Taichi on the CPU: `taichi_mpm.py FOLDER [--threads N] [--scatter WAY] [--decomposition WAY]`.

MLS-MPM (Hu et al. 2018) on a dense grid, four loops in one kernel: clear, scatter, grid, gather. The gather ends with
the material, so that the scatter, the one loop in which particles meet, is short; between the two a particle keeps
only its velocity and the matrix that it gives to its nodes.
"""

import argparse
import pathlib
import sys

import numpy as np
import taichi as ti

import scene as scenes

arguments = argparse.ArgumentParser(description="Steps a scene with Taichi on the CPU.")
arguments.add_argument("folder", help="of the scene")
arguments.add_argument("--threads", type=int, default=1)
arguments.add_argument(
    "--scatter",
    choices=("serial", "atomic", "private"),
    default="serial",
    help="one thread; all threads with atomic additions; all threads, each with a grid of its own",
)
arguments.add_argument(
    "--decomposition",
    choices=("builtin", "written"),
    default="builtin",
    help="ti.svd; or Newton's polar decomposition (fixed corotated) and one-sided Jacobi (snow), written here",
)
arguments.add_argument("--precision", choices=("float", "double"), default="float")
arguments.add_argument("--state", help="file for the final state")
options = arguments.parse_args()

scene, start_x, start_v = scenes.read(options.folder)
real = ti.f32 if options.precision == "float" else ti.f64
ti.init(
    arch=ti.cpu,
    default_fp=real,
    default_ip=ti.i32,
    cpu_max_num_threads=options.threads,
    fast_math=False,
    offline_cache_file_path=str(pathlib.Path(sys.prefix) / "taichi-kernels"),
    log_level=ti.ERROR,
)

N, n = scene.nodes, scene.particles
h, dt, mass = scene.cell, scene.dt, scene.mass
mu, lam = scene.mu, scene.lambda_
width = 3 if scene.kernel == "quadratic" else 4
inverse_inertia = 4.0 if scene.kernel == "quadratic" else 3.0  # D^-1 h^2 (Jiang et al. 2015)
low, high = 1 - scene.critical_compression, 1 + scene.critical_stretch
smallest, largest = scene.smallest_plastic_ratio, scene.largest_plastic_ratio
written = options.decomposition == "written"
grids = options.threads if options.scatter == "private" else 1
serial = options.scatter == "serial" or options.threads == 1 and options.scatter == "private"

vec3 = ti.types.vector(3, real)
x = ti.Vector.field(3, real, shape=n)
v = ti.Vector.field(3, real, shape=n)
F = ti.Matrix.field(3, 3, real, shape=n)
given = ti.Matrix.field(3, 3, real, shape=n)  # m C - dt V0 D^-1 tau, per cell of distance
J_P = ti.field(real, shape=n)
grid = ti.Vector.field(4, real, shape=grids * N**3)  # momentum, then velocity; mass


@ti.func
def weights(t):
    """The weights of the nodes along three axes, for the distances t in cells from the first of them."""
    w = ti.Matrix.zero(real, width, 3)
    for a in ti.static(range(3)):
        if ti.static(width == 3):
            w[0, a] = 0.5 * (1.5 - t[a]) ** 2
            w[1, a] = 0.75 - (t[a] - 1.0) ** 2
            w[2, a] = 0.5 * (t[a] - 0.5) ** 2
        else:
            s = t[a] - 1.0  # from the second node
            r = 1.0 - s
            w[0, a] = r**3 / 6.0
            w[1, a] = (0.5 * s - 1.0) * s**2 + 2.0 / 3.0
            w[2, a] = (0.5 * r - 1.0) * r**2 + 2.0 / 3.0
            w[3, a] = s**3 / 6.0
    return w


@ti.func
def locate(p):
    """The number of the first node of a particle's stencil, and the distance from it in cells."""
    at = x[p] * (1.0 / h)
    first = ti.floor(at - (0.5 if ti.static(width == 3) else 1.0), ti.i32)
    return (first[0] * N + first[1]) * N + first[2], at - ti.cast(first, real)


@ti.func
def column(A, i: ti.template()):
    return vec3(A[0, i], A[1, i], A[2, i])


@ti.func
def make_orthogonal(a, b):
    """Turns two vectors in their plane until they are orthogonal: a step of one-sided Jacobi (Hestenes 1958)."""
    difference = b.dot(b) - a.dot(a)
    twice = 2.0 * a.dot(b)
    total = ti.abs(difference) + ti.sqrt(difference * difference + twice * twice) + 1e-18
    opposite = -twice if difference < 0.0 else twice
    length = 1.0 / ti.sqrt(total * total + opposite * opposite)
    c, s = total * length, opposite * length
    return c * a - s * b, s * a + c * b


@ti.func
def left_singular_vectors(A):
    """U and the singular values of A with det A > 0; V is not needed, and not computed."""
    a, b, c = column(A, 0), column(A, 1), column(A, 2)
    for _ in ti.static(range(4)):
        a, b = make_orthogonal(a, b)
        a, c = make_orthogonal(a, c)
        b, c = make_orthogonal(b, c)
    sigma = vec3(a.norm(), b.norm(), c.norm())
    return ti.Matrix.cols([a / sigma[0], b / sigma[1], c / sigma[2]]), sigma


@ti.func
def rotation(A, J):
    """The rotation R of A = R S by Newton's iteration; near or beyond inversion by the singular values."""
    R = A
    if J > 0.05:
        for _ in range(12):
            a, b, c = column(R, 0), column(R, 1), column(R, 2)
            cofactors = ti.Matrix.cols([b.cross(c), c.cross(a), a.cross(b)])
            better = 0.5 * R + (0.5 / a.dot(b.cross(c))) * cofactors
            change = (better - R).norm_sqr()
            R = better
            if change < 1e-10:
                break
    else:
        U, S, V = ti.svd(A)
        R = U @ V.transpose()
    return R


@ti.func
def corotated(U, sigma, hardness):
    """The Kirchhoff stress of the fixed corotated law (Stomakhin et al. 2012) by the singular values of F."""
    J = sigma[0] * sigma[1] * sigma[2]
    principal = hardness * (2.0 * mu * (sigma - 1.0) * sigma + lam * (J - 1.0) * J)
    return stretched(U, principal) @ U.transpose()


@ti.func
def stretched(U, sigma):
    A = U
    for i, j in ti.static(ti.ndrange(3, 3)):
        A[i, j] *= sigma[j]
    return A


@ti.func
def answer(p, trial):
    """Stores the deformation gradient, for snow as it returns to the yield surface; returns the Kirchhoff stress."""
    F[p] = trial
    tau = ti.Matrix.zero(real, 3, 3)
    if ti.static(scene.model == "neo_hookean"):
        tau = mu * (trial @ trial.transpose())
        pressure = lam * ti.log(trial.determinant()) - mu
        for i in ti.static(range(3)):
            tau[i, i] += pressure
    elif ti.static(scene.model == "fixed_corotated" and written):
        J = trial.determinant()
        tau = 2.0 * mu * ((trial - rotation(trial, J)) @ trial.transpose())
        for i in ti.static(range(3)):
            tau[i, i] += lam * (J - 1.0) * J
    elif ti.static(scene.model == "fixed_corotated"):
        U, S, V = ti.svd(trial)
        tau = corotated(U, vec3(S[0, 0], S[1, 1], S[2, 2]), 1.0)
    else:
        U = ti.Matrix.zero(real, 3, 3)
        V = ti.Matrix.zero(real, 3, 3)
        sigma = vec3(0.0)
        if ti.static(written):
            U, sigma = left_singular_vectors(trial)
        else:
            U, S, V = ti.svd(trial)
            sigma = vec3(S[0, 0], S[1, 1], S[2, 2])
        elastic = ti.min(ti.max(sigma, low), high)
        ratio = sigma / elastic
        if (elastic != sigma).any():
            if ti.static(written):
                F[p] = stretched(U, 1.0 / ratio) @ (U.transpose() @ trial)
            else:
                F[p] = stretched(U, elastic) @ V.transpose()
        J_P[p] = ti.min(ti.max(J_P[p] * ratio[0] * ratio[1] * ratio[2], smallest / 100.0), largest * 100.0)
        within = ti.min(ti.max(J_P[p], smallest), largest)
        tau = corotated(U, elastic, ti.exp(scene.hardening * (1.0 - within)))
    return tau


@ti.func
def deform(p, C):
    trial = F[p] + dt * (C @ F[p])
    given[p] = (mass * h) * C - (dt * scene.volume * inverse_inertia / h) * answer(p, trial)


@ti.kernel
def begin():
    for p in range(n):
        F[p] = ti.Matrix.identity(real, 3)
        J_P[p] = 1.0
        deform(p, ti.Matrix.zero(real, 3, 3))


@ti.func
def scatter(p, grid_start):
    first, t = locate(p)
    w = weights(t)
    A = given[p]
    plane = mass * v[p] - A @ t  # what the first node gets of momentum before it is weighted
    for i in ti.static(range(width)):
        row = plane
        for j in ti.static(range(width)):
            w_row = w[i, 0] * w[j, 1]
            q = row
            for k in ti.static(range(width)):
                node = grid_start + first + ((i * N + j) * N + k)
                part = (w_row * w[k, 2]) * ti.Vector([q[0], q[1], q[2], mass])
                if ti.static(options.scatter == "private"):
                    grid[node] = grid[node] + part
                else:
                    grid[node] += part  # atomic, unless the loop is serial
                q += column(A, 2)
            row += column(A, 1)
        plane += column(A, 0)


@ti.kernel
def step():
    for i in range(grids * N**3):
        grid[i] = ti.Vector.zero(real, 4)

    if ti.static(grids > 1):
        # Taichi deals loops out in blocks, and one of few turns to one thread: most turns of this one are idle.
        for turn in range(grids * 512):
            if turn % 512 == 0:
                part = turn // 512
                for p in range(part * n // grids, (part + 1) * n // grids):
                    scatter(p, part * N**3)
    else:
        ti.loop_config(serialize=serial)
        for p in range(n):
            scatter(p, 0)

    for i in range(N**3):
        node = grid[i]
        for part in ti.static(range(1, grids)):
            node += grid[part * N**3 + i]
        if node[3] > 1e-20 * mass:
            for a in ti.static(range(3)):
                node[a] /= node[3]
            grid[i] = node

    for p in range(n):
        first, t = locate(p)
        w = weights(t)
        velocity = vec3(0.0)
        B = ti.Matrix.zero(real, 3, 3)
        for i in ti.static(range(width)):
            for j in ti.static(range(width)):
                row = vec3(0.0)
                last = vec3(0.0)
                for k in ti.static(range(width)):
                    node = grid[first + ((i * N + j) * N + k)]
                    part = w[k, 2] * vec3(node[0], node[1], node[2])
                    row += part
                    last += (k - t[2]) * part
                w_row = w[i, 0] * w[j, 1]
                row *= w_row
                velocity += row
                for a in ti.static(range(3)):
                    B[a, 0] += row[a] * (i - t[0])
                    B[a, 1] += row[a] * (j - t[1])
                    B[a, 2] += w_row * last[a]
        v[p] = velocity
        x[p] += dt * velocity
        deform(p, B * (inverse_inertia / h))


x.from_numpy(start_x)
v.from_numpy(start_v)
begin()
result = scenes.measure(scene, step, ti.sync)
state = np.concatenate([field.to_numpy().reshape(n, -1) for field in (x, v, F, J_P)], axis=1)
scenes.report(scene, result, state, options.state)

# SPDX-License-Identifier: MIT
"""A scene stepped by NVIDIA Warp on the CPU: `warp_mpm.py FOLDER [--decomposition WAY]`.

MLS-MPM (Hu et al. 2018) on a dense grid, three launches: scatter, grid, gather with the material. Warp uses one
thread on the CPU, so that its atomic additions are plain ones.
"""

import argparse
import pathlib
import sys

import numpy as np
import warp as wp

import scene as scenes

arguments = argparse.ArgumentParser(description="Steps a scene with Warp on the CPU.")
arguments.add_argument("folder", help="of the scene")
arguments.add_argument(
    "--decomposition",
    choices=("builtin", "written"),
    default="builtin",
    help="wp.svd3; or Newton's polar decomposition (fixed corotated) and one-sided Jacobi (snow), written here",
)
arguments.add_argument("--precision", choices=("float", "double"), default="float")
arguments.add_argument("--state", help="file for the final state")
options = arguments.parse_args()

scene, start_x, start_v = scenes.read(options.folder)
real, number = (wp.float32, np.float32) if options.precision == "float" else (wp.float64, np.float64)
wp.config.log_level = wp.LOG_ERROR
wp.config.enable_backward = False
wp.config.kernel_cache_dir = str(pathlib.Path(sys.prefix) / "warp-kernels")
# Without the limit to the vectorisation of straight code that is Warp's default: neo-Hookean 170 ns, like this 140.
wp.config.cpu_compiler_flags = "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
wp.init()

vec3, vec4, mat3 = wp.types.vector(3, real), wp.types.vector(4, real), wp.types.matrix((3, 3), real)

quadratic = scene.kernel == "quadratic"
N = wp.constant(scene.nodes)
n = scene.particles
width = 3 if quadratic else 4
written = options.decomposition == "written"
WIDTH = wp.constant(width)
inverse_inertia = 4.0 if quadratic else 3.0  # D^-1 h^2 (Jiang et al. 2015)
INVERSE_H = wp.constant(real(1 / scene.cell))
FIRST = wp.constant(real(0.5 if quadratic else 1.0))
DT = wp.constant(real(scene.dt))
MASS = wp.constant(real(scene.mass))
CUT = wp.constant(real(1e-20 * scene.mass))
MU, LAMBDA = wp.constant(real(scene.mu)), wp.constant(real(scene.lambda_))
AFFINE_MASS = wp.constant(real(scene.mass * scene.cell))
IMPULSE = wp.constant(real(scene.dt * scene.volume * inverse_inertia / scene.cell))
AFFINE = wp.constant(real(inverse_inertia / scene.cell))
LOW, HIGH = wp.constant(real(1 - scene.critical_compression)), wp.constant(real(1 + scene.critical_stretch))
HARDENING = wp.constant(real(scene.hardening))
SMALLEST, LARGEST = wp.constant(real(scene.smallest_plastic_ratio)), wp.constant(real(scene.largest_plastic_ratio))
FAR = wp.constant(real(100))
NEAR_INVERSION, CONVERGED, TINY = (wp.constant(real(value)) for value in (0.05, 1e-10, 1e-18))
ZERO, HALF, ONE, TWO = (wp.constant(real(value)) for value in (0, 0.5, 1, 2))
SIXTH, TWO_THIRDS, THREE_QUARTERS, THREE_HALVES = (wp.constant(real(v)) for v in (1 / 6, 2 / 3, 0.75, 1.5))

weights_type = wp.types.matrix((3, width), real)

if quadratic:

    @wp.func
    def weights(t: vec3):
        """The weights of the nodes along three axes, for the distances t in cells from the first of them."""
        w = weights_type()
        for a in range(3):
            left = THREE_HALVES - t[a]
            middle = t[a] - ONE
            right = t[a] - HALF
            w[a, 0] = HALF * left * left
            w[a, 1] = THREE_QUARTERS - middle * middle
            w[a, 2] = HALF * right * right
        return w

else:

    @wp.func
    def weights(t: vec3):
        """The weights of the nodes along three axes, for the distances t in cells from the first of them."""
        w = weights_type()
        for a in range(3):
            s = t[a] - ONE
            r = ONE - s
            w[a, 0] = SIXTH * r * r * r
            w[a, 1] = (HALF * s - ONE) * s * s + TWO_THIRDS
            w[a, 2] = (HALF * r - ONE) * r * r + TWO_THIRDS
            w[a, 3] = SIXTH * s * s * s
        return w


@wp.func
def first_node(at: vec3):
    return vec3(wp.floor(at[0] - FIRST), wp.floor(at[1] - FIRST), wp.floor(at[2] - FIRST))


@wp.func
def number_of(first: vec3):
    return (int(first[0]) * N + int(first[1])) * N + int(first[2])


@wp.func
def column(A: mat3, i: int):
    return vec3(A[0, i], A[1, i], A[2, i])


@wp.func
def columns(a: vec3, b: vec3, c: vec3):
    return mat3(a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2])


@wp.func
def make_orthogonal(a: vec3, b: vec3):
    """Turns two vectors in their plane until they are orthogonal: a step of one-sided Jacobi (Hestenes 1958)."""
    difference = wp.dot(b, b) - wp.dot(a, a)
    twice = TWO * wp.dot(a, b)
    total = wp.abs(difference) + wp.sqrt(difference * difference + twice * twice) + TINY
    opposite = wp.where(difference < ZERO, -twice, twice)
    length = ONE / wp.sqrt(total * total + opposite * opposite)
    c = total * length
    s = opposite * length
    return c * a - s * b, s * a + c * b


@wp.func
def left_singular_vectors(A: mat3):
    """U and the singular values of A with det A > 0; V is not needed, and not computed."""
    a, b, c = column(A, 0), column(A, 1), column(A, 2)
    for _ in range(4):
        a, b = make_orthogonal(a, b)
        a, c = make_orthogonal(a, c)
        b, c = make_orthogonal(b, c)
    sigma = vec3(wp.length(a), wp.length(b), wp.length(c))
    return columns(a / sigma[0], b / sigma[1], c / sigma[2]), sigma


@wp.func
def rotation(A: mat3, J: real):
    """The rotation R of A = R S by Newton's iteration; near or beyond inversion by the singular values."""
    R = A
    if J > NEAR_INVERSION:
        change = ONE
        while change > CONVERGED:
            a, b, c = column(R, 0), column(R, 1), column(R, 2)
            first = wp.cross(b, c)
            cofactors = columns(first, wp.cross(c, a), wp.cross(a, b))
            better = HALF * R + (HALF / wp.dot(a, first)) * cofactors
            change = wp.ddot(better - R, better - R)
            R = better
    else:
        U, sigma, V = wp.svd3(A)
        R = U @ wp.transpose(V)
    return R


@wp.func
def corotated(U: mat3, sigma: vec3, hardness: real):
    """The Kirchhoff stress of the fixed corotated law (Stomakhin et al. 2012) by the singular values of F."""
    J = sigma[0] * sigma[1] * sigma[2]
    pressure = LAMBDA * (J - ONE) * J
    principal = vec3()
    for i in range(3):
        principal[i] = hardness * (TWO * MU * (sigma[i] - ONE) * sigma[i] + pressure)
    return U @ wp.diag(principal) @ wp.transpose(U)


if scene.model == "neo_hookean":

    @wp.func
    def answer(p: int, trial: mat3, F: wp.array(dtype=mat3), J_P: wp.array(dtype=real)):
        """Stores the deformation gradient; returns the Kirchhoff stress."""
        F[p] = trial
        tau = MU * (trial @ wp.transpose(trial))
        pressure = LAMBDA * wp.log(wp.determinant(trial)) - MU
        for i in range(3):
            tau[i, i] += pressure
        return tau

elif scene.model == "fixed_corotated" and written:

    @wp.func
    def answer(p: int, trial: mat3, F: wp.array(dtype=mat3), J_P: wp.array(dtype=real)):
        """Stores the deformation gradient; returns the Kirchhoff stress."""
        F[p] = trial
        J = wp.determinant(trial)
        tau = TWO * MU * ((trial - rotation(trial, J)) @ wp.transpose(trial))
        for i in range(3):
            tau[i, i] += LAMBDA * (J - ONE) * J
        return tau

elif scene.model == "fixed_corotated":

    @wp.func
    def answer(p: int, trial: mat3, F: wp.array(dtype=mat3), J_P: wp.array(dtype=real)):
        """Stores the deformation gradient; returns the Kirchhoff stress."""
        F[p] = trial
        U, sigma, V = wp.svd3(trial)
        return corotated(U, sigma, ONE)

else:
    if written:

        @wp.func
        def decompose(A: mat3):
            U, sigma = left_singular_vectors(A)
            return U, sigma, mat3()

        @wp.func
        def put_back(trial: mat3, U: mat3, sigma: vec3, elastic: vec3, V: mat3):
            return U @ wp.diag(wp.cw_div(elastic, sigma)) @ (wp.transpose(U) @ trial)

    else:

        @wp.func
        def decompose(A: mat3):
            U, sigma, V = wp.svd3(A)
            return U, sigma, V

        @wp.func
        def put_back(trial: mat3, U: mat3, sigma: vec3, elastic: vec3, V: mat3):
            return U @ wp.diag(elastic) @ wp.transpose(V)

    @wp.func
    def answer(p: int, trial: mat3, F: wp.array(dtype=mat3), J_P: wp.array(dtype=real)):
        """Stores the deformation gradient as it returns to the yield surface; returns the Kirchhoff stress."""
        U, sigma, V = decompose(trial)
        elastic = vec3()
        ratio = J_P[p]
        yields = bool(False)
        for i in range(3):
            elastic[i] = wp.clamp(sigma[i], LOW, HIGH)
            ratio *= sigma[i] / elastic[i]
            if elastic[i] != sigma[i]:
                yields = True
        if yields:
            F[p] = put_back(trial, U, sigma, elastic, V)
        else:
            F[p] = trial
        ratio = wp.clamp(ratio, SMALLEST / FAR, LARGEST * FAR)
        J_P[p] = ratio
        return corotated(U, elastic, wp.exp(HARDENING * (ONE - wp.clamp(ratio, SMALLEST, LARGEST))))


@wp.kernel
def begin(
    F: wp.array(dtype=mat3),
    J_P: wp.array(dtype=real),
    given: wp.array(dtype=mat3),
):
    p = wp.tid()
    J_P[p] = ONE
    given[p] = -IMPULSE * answer(p, wp.identity(n=3, dtype=real), F, J_P)


@wp.kernel
def scatter(
    x: wp.array(dtype=vec3),
    v: wp.array(dtype=vec3),
    given: wp.array(dtype=mat3),
    grid: wp.array(dtype=vec4),
):
    p = wp.tid()
    at = x[p] * INVERSE_H
    first = first_node(at)
    t = at - first
    node = number_of(first)
    w = weights(t)
    A = given[p]
    step_x, step_y, step_z = column(A, 0), column(A, 1), column(A, 2)
    plane = MASS * v[p] - A @ t  # at the first node
    for i in range(WIDTH):
        row = plane
        for j in range(WIDTH):
            w_row = w[0, i] * w[1, j]
            q = row
            for k in range(WIDTH):
                weight = w_row * w[2, k]
                wp.atomic_add(grid, node + (i * N + j) * N + k, weight * vec4(q[0], q[1], q[2], MASS))
                q += step_z
            row += step_y
        plane += step_x


@wp.kernel
def update(grid: wp.array(dtype=vec4)):
    i = wp.tid()
    g = grid[i]
    if g[3] > CUT:
        s = ONE / g[3]
        grid[i] = vec4(g[0] * s, g[1] * s, g[2] * s, g[3])


@wp.kernel
def gather(
    x: wp.array(dtype=vec3),
    v: wp.array(dtype=vec3),
    F: wp.array(dtype=mat3),
    J_P: wp.array(dtype=real),
    given: wp.array(dtype=mat3),
    grid: wp.array(dtype=vec4),
):
    p = wp.tid()
    at = x[p] * INVERSE_H
    first = first_node(at)
    t = at - first
    node = number_of(first)
    w = weights(t)
    velocity = vec3()
    B = mat3()
    dx = -t[0]
    for i in range(WIDTH):
        dy = -t[1]
        for j in range(WIDTH):
            dz = -t[2]
            row = vec3()
            last = vec3()
            for k in range(WIDTH):
                g = grid[node + (i * N + j) * N + k]
                part = w[2, k] * vec3(g[0], g[1], g[2])
                row += part
                last += dz * part
                dz += ONE
            w_row = w[0, i] * w[1, j]
            row *= w_row
            velocity += row
            for a in range(3):
                B[a, 0] += dx * row[a]
                B[a, 1] += dy * row[a]
                B[a, 2] += w_row * last[a]
            dy += ONE
        dx += ONE
    C = AFFINE * B
    v[p] = velocity
    x[p] = x[p] + DT * velocity
    trial = F[p] + DT * (C @ F[p])
    given[p] = AFFINE_MASS * C - IMPULSE * answer(p, trial, F, J_P)


with wp.ScopedDevice("cpu"):
    x = wp.array(start_x.astype(number), dtype=vec3)
    v = wp.array(start_v.astype(number), dtype=vec3)
    F = wp.zeros(n, dtype=mat3)
    given = wp.zeros(n, dtype=mat3)
    J_P = wp.zeros(n, dtype=real)
    grid = wp.zeros(N**3, dtype=vec4)
    wp.launch(begin, n, [F, J_P, given])
    launches = [
        wp.launch(scatter, n, [x, v, given, grid], record_cmd=True),
        wp.launch(update, N**3, [grid], record_cmd=True),
        wp.launch(gather, n, [x, v, F, J_P, given, grid], record_cmd=True),
    ]

    def step():
        grid.zero_()
        for launch in launches:
            launch.launch()

    result = scenes.measure(scene, step, wp.synchronize)
    state = np.concatenate([array.numpy().reshape(n, -1) for array in (x, v, F, J_P)], axis=1)
scenes.report(scene, result, state, options.state)

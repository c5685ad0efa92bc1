// SPDX-License-Identifier: MIT
// What an obstacle costs that changes its form: steps by turns on a ball, on one that is read from a grid of
// distances, and on one whose grid deforms, alone and in a list. Where CGAL is, also the time in which such a
// grid is made of a mesh in two poses, as for each frame of a character:
//     deforming [rounds]
// Prints medians of milliseconds per step, and their ratio to the first, then of each rebuilding. The same
// file is compiled for a device, without the latter.
#include "block.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>
#if defined(FIRN_BENCH_SAMPLING)
#include <firn/sampling/deforming_mesh.hpp>
#endif

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

using bench::Backend, bench::h, bench::side;

double const radius = 0.4, frame = 1e9; // [m], [s]: it hardly moves while steps are timed

/// A ball on a grid whose cells are those of the scene, around the origin.
SignedDistanceGrid<float, 3> ball_on_grid()
{
    int const count = 25; // to 0.2 m beyond the ball
    std::vector<float> distances;
    Eigen::Vector3f const first = Eigen::Vector3f::Constant(-0.6f);
    for (int k = 0; k < count; ++k)
        for (int j = 0; j < count; ++j)
            for (int i = 0; i < count; ++i) {
                Eigen::Vector3f const x = first + float(h) * Eigen::Vector3f(float(i), float(j), float(k));
                distances.push_back(x.norm() - float(radius));
            }
    return {first, float(h), {count, count, count}, distances};
}

/// A shape whose values are where the backend reads them.
template <class ShapeType>
auto there(ShapeType const& shape)
{
    if constexpr (Backend::reaches_host_memory)
        return shape;
    else
        return shape.on(bench::backend());
}

#if defined(FIRN_BENCH_SAMPLING)
/// A ball of `2 (rings^2 - 1)` triangles, stretched along y.
TriangleMesh ball_of_triangles(int rings, double stretch)
{
    TriangleMesh mesh;
    int const around = rings + 1;
    double const pi = std::acos(-1.0);
    mesh.vertices.emplace_back(0, radius * stretch, 0);
    for (int i = 1; i < rings; ++i)
        for (int j = 0; j < around; ++j) {
            double const theta = pi * i / rings, phi = 2 * pi * j / around;
            mesh.vertices.emplace_back(radius * std::sin(theta) * std::cos(phi),
                                       stretch * radius * std::cos(theta),
                                       -radius * std::sin(theta) * std::sin(phi));
        }
    mesh.vertices.emplace_back(0, -radius * stretch, 0);
    auto const at = [&](int i, int j) { return std::uint32_t(1 + (i - 1) * around + j % around); };
    auto const last = std::uint32_t(mesh.vertices.size() - 1);
    for (int j = 0; j < around; ++j) {
        mesh.triangles.push_back({0, at(1, j), at(1, j + 1)});
        for (int i = 1; i + 1 < rings; ++i) {
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
        mesh.triangles.push_back({last, at(rings - 1, j + 1), at(rings - 1, j)});
    }
    return mesh;
}

void time_rebuilding(int rings, double cell, int rounds)
{
    auto const before = ball_of_triangles(rings, 1), after = ball_of_triangles(rings, 1.05);
    std::vector<double> seconds;
    for (int i = 0; i < rounds; ++i) {
        auto const start = std::chrono::steady_clock::now();
        auto const grid = deforming_mesh(before, after, 0, 1, cell, 3 * cell, bench::backend());
        seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        if (!(grid.reach() > 0)) std::abort();
    }
    double const cells = std::pow(2 * radius / cell + 6, 2) * (2 * 1.05 * radius / cell + 6);
    std::printf("%6zu triangles, cells of %5.3f m (%7.0f): %8.1f ms\n", before.triangles.size(), cell, cells,
                1e3 * bench::median(seconds));
}
#endif

} // namespace

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 15;
    Motion const place{.position = {side * h / 4, 0.1, side * h / 4}};
    Obstacle<Sphere> const ball{.shape = {radius}, .motion = place};
    auto const distances = ball_on_grid();
    auto const rigid = there(distances);
    auto const soft = there(DeformingGrid<float, 3>(
        distances, distances, std::vector<Vector<float, 3>>(25 * 25 * 25, Vector<float, 3>(0, 1, 0)), 0,
        frame));
    Obstacle<std::decay_t<decltype(rigid)>> const on_grid{.shape = rigid, .motion = place};
    Obstacle<std::decay_t<decltype(soft)>> const deforming{.shape = soft, .motion = place};
    Obstacles<std::decay_t<decltype(soft)>> const list{{deforming}};
    auto const block = [] { return bench::block(side, side / 2, side); };
    auto with_ball = block(), with_grid = block(), with_deforming = block(), with_list = block();
    double const dt = 0.5 * with_ball.stable_step(Gravity{}, ball);
    std::vector<double> seconds[4];
    for (int i = 0; i < rounds; ++i) {
        seconds[0].push_back(bench::seconds_per_step(with_ball, dt, ball));
        seconds[1].push_back(bench::seconds_per_step(with_grid, dt, on_grid));
        seconds[2].push_back(bench::seconds_per_step(with_deforming, dt, deforming));
        seconds[3].push_back(bench::seconds_per_step(with_list, dt, list));
    }
    char const* const names[]{"ball", "ball on a grid", "deforming", "deforming in a list"};
    double const first = bench::median(seconds[0]);
    std::printf("%zu particles\n", with_ball.size());
    for (int i = 0; i < 4; ++i) {
        double const middle = bench::median(seconds[i]);
        std::printf("%-20s %8.3f ms %6.3f\n", names[i], 1e3 * middle, middle / first);
    }
#if defined(FIRN_BENCH_SAMPLING)
    for (int const rings : {32, 100})
        for (double const cell : {0.1, 0.05, 0.025}) time_rebuilding(rings, cell, 3);
#endif
}

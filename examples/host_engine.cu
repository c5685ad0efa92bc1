// SPDX-License-Identifier: MIT
// A host engine's loop on a GPU: its stream, its buffer of positions, snow that falls on a moving ball.
#include <firn/cuda.hpp>
#include <firn/firn.hpp>

#include <cstdio>

using Space = firn::Space<3, float>;
using Solver = firn::Solver<firn::Cuda, firn::Snow<Space>, firn::QuadraticBSpline>;

int main()
try {
    firn::Cuda const gpu{.device = 0, .stream = nullptr}; // the stream that the engine renders in
    Solver solver(firn::lattice(0.02), firn::materials::fresh_snow<Space>(), {}, {}, gpu);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 40 * 40 * 40; ++i)
        points.emplace_back(0.01 * (i % 40), 0.5 + 0.01 * (i / 1600), 0.01 * (i / 40 % 40));
    solver.add(points, 1e-6, {0, -2, 0});

    firn::cuda::Array<float> vertices(gpu); // or a buffer that Vulkan, OpenGL or OptiX shares with CUDA
    vertices.resize(4 * solver.size());
    firn::Obstacle<firn::HalfSpace> const floor{.contact = firn::Contact::coulomb(0.5)};
    for (int frame = 0; frame < 12; ++frame) {
        firn::Obstacle<firn::Sphere> const ball{
            .shape = {0.15},
            .motion = {.position = {0.2 + 0.5 * solver.time(), 0.2, 0.2}, .velocity = {0.5, 0, 0}}};
        auto const report = solver.advance(1.0 / 24, firn::Gravity{}, floor, ball);
        solver.write_positions(vertices.data(), 4); // x y z and room for a colour; nothing leaves the device
        std::printf("%.3f s: %d steps, the ball was pushed by %.3f N\n", solver.time(), int(report.substeps),
                    report.reactions[1].impulse.norm() * 24);
    }
}
catch (firn::Error const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}

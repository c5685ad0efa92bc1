// SPDX-License-Identifier: MIT
// Snow falls on a turning ring: an obstacle from a mesh, here a generated torus; any closed mesh will do,
// also one that `read` reads from a file. `snow_on_mesh [--backend cuda] [folder]` writes frames as well.
// sample_mesh.cpp, which computes the distances from the mesh, includes CGAL: GPL, see README.
#include "frames.hpp"
#include "meshes.hpp"
#include "sample_mesh.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Room = Space<3, float>;
    auto frames = frames_of(argc, argv);
    double const h = 0.03, size = 0.42; // [m]
    auto const mesh = torus(0.25, 0.06);
    auto const distances = distances_of(mesh, h / 2, 4 * h);

    Solver<Backend, Snow<Room>> solver(lattice(h), materials::fresh_snow<Room>());
    auto points = block<3>({size, 0.3, size}, h);
    for (auto& x : points) x += Eigen::Vector3d(-size / 2, 0.1, -size / 2);
    solver.add(points, h * h * h / 8, {0, -1, 0});
    // its distances in the backend's memory: on a GPU with Cuda
    Obstacle<SignedDistanceGridOn<Backend, float, 3>> const ring{
        .shape = distances.on(solver.backend()),
        .contact = Contact::coulomb(0.4),
        .motion = {.angular_velocity = {0, 3, 0}, .time = 0},
        .on_particles = true};
    std::vector<Motion> poses; // of the ring in the frames

    std::printf("time [s]  snow below the ring  deepest in it [cells]  force on it [N]  torque on it [N m]  "
                "particles %zu\n",
                solver.size());
    double const frame = 1.0 / 24;
    for (int i = 1; i <= 12; ++i) {
        if (frames) {
            frames->write(solver);
            poses.push_back(ring.motion.at(solver.time()));
        }
        auto const report = solver.advance(frame, Gravity{}, ring);
        auto const now = ring.motion.at(solver.time());
        double below = 0, deepest = 0;
        for (auto const& x : solver.positions()) {
            Eigen::Vector3d const in_body = now.orientation.conjugate() * (x - now.position);
            deepest = std::max(deepest, -double(distances.surface(in_body.cast<float>()).distance) / h);
            below += (x.y() < -0.06) / double(solver.size());
        }
        if (i % 2 == 0)
            std::printf("%8.3f  %18.0f%%  %21.4f  %15.0f  %18.1f\n", solver.time(), 100 * below, deepest,
                        -report.reactions[0].impulse.y() / frame,
                        report.reactions[0].angular_impulse.y() / frame);
    }
    if (!frames) return 0;
    write_obj(mesh, frames->folder() / "ring.obj");
    frames->draw({.cell_size = h,
                  .spacing = h / 2,
                  .camera = Camera{{0.9, 0.85, 1.5}, {0, -0.02, 0}},
                  .obstacles = {{R"("shape": "mesh", "file": "ring.obj")", poses}}});
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}

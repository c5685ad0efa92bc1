// SPDX-License-Identifier: MIT
// A host that uses much of the library, of which a compiler is to have nothing to say: kernels, transfers,
// both dimensions and precisions, effects, what a solver tells, files.
#include <firn/firn.hpp>
#include <firn/host_copies.hpp>
#include <firn/id_lookup.hpp>
#include <firn/io/checkpoint.hpp>
#include <firn/io/write_particles.hpp>
#include <firn/openmp.hpp>
#include <firn/sampling/points.hpp>

#include <array>

namespace
{

using namespace firn;

/// A solid of the host's own.
struct Cube
{
    template <class Loop>
    std::vector<char> contains(std::span<Eigen::Vector3d const> points, Loop const&) const
    {
        return std::vector<char>(points.size(), 1);
    }
    double volume() const { return 1; }
    Eigen::AlignedBox3d bounding_box() const { return {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 1, 1)}; }
};

template <class Kernel, class Model, class Transfer, class... Effects>
void use(Model const& model, Transfer const& transfer, Effects const&... effects)
{
    using Space = typename Model::Space;
    using Solver = firn::Solver<OpenMP, Model, Kernel, Transfer>;
    Solver solver(lattice(0.02), model, transfer, {.smallest = 1e-9}, {.threads = 1});
    solver.add(std::vector<Vector<double, Space::dimension>>(10), 1e-6);
    solver.quarantine(10);
    AdvanceReport report = solver.advance(1.0 / 24, effects...);
    solver.step(1e-5, effects...);
    solver.steps(3, 1e-5, effects...);
    solver.remove_if([](auto const& x) { return x[0] > 1; });
    std::vector<typename Space::Scalar> numbers(3 * solver.size());
    solver.write_positions(numbers.data());
    solver.template upload<Velocity>(solver.template download<Velocity>());
    std::vector<std::array<double, std::size_t(Space::dimension)>> own(solver.size());
    solver.add(own, 1e-6);
    own.resize(solver.size());
    download_positions(solver, own);
    download<Velocity>(solver, own);
    upload<Velocity>(solver, own);
    IdLookup lookup;
    own.resize(lookup.indices_of(solver, solver.ids()).size());
    auto const snapshot = solver.snapshot();
    solver.restore(snapshot);
    if (solver.occupancy().alone > 0) read_checkpoint("scene.firn", solver);
    write_checkpoint("scene.firn", solver);
}

} // namespace

int main()
{
    using Plane = Space<2, double>;
    using Solid = Space<3, float>;
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5)};
    Obstacle<Shell<Box>> const box{};
    Obstacle<Capsule> const capsule{.on_particles = true};
    use<CubicBSpline>(materials::fresh_snow<Solid>(), Flip{}, Gravity{}, floor, capsule);
    Solver<OpenMP, Sand<Plane>> sand(lattice(0.02), materials::dry_sand<Plane>());
    sand.advance(0.1, Gravity{}, box, ReflectingWall{});

    RigidBody body = RigidBody::ball(0.3, 30);
    body.advance(Reaction{}, 0.1, {0, -9.81, 0});
    ParticleFrame frame;
    frame.at(lattice_points(Cube{}, Count{1000}).points);
    write_vtp("frame.vtp", frame);
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/driven.hpp"
#include "support/meshes.hpp"
#include "support/polygons.hpp"
#include "support/refused.hpp"
#include "support/threads.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/io/read_mesh.hpp>
#include <firn/sampling/deforming_mesh.hpp>
#include <firn/sampling/distance_from_mesh.hpp>
#include <firn/sampling/mesh_interior.hpp>
#include <firn/sampling/points.hpp>

#include <ctime>
#include <numbers>
#include <random>

using Eigen::Vector3d;
using firn::MeshInterior;
using firn::Repair;
using std::numbers::pi;

namespace
{

static_assert(firn::Interior<MeshInterior>);

std::vector<Vector3d> random_points(Eigen::AlignedBox3d const& box, int count)
{
    std::mt19937_64 random(5);
    std::vector<Vector3d> points;
    for (int i = 0; i < count; ++i) {
        Eigen::Array3d unit;
        for (double& u : unit) u = double(random() >> 11) * 0x1p-53;
        points.push_back(box.min().array() + unit * box.sizes().array());
    }
    return points;
}

/// The volume as the share of random points that lie inside; with its standard error.
std::pair<double, double> monte_carlo_volume(MeshInterior const& interior)
{
    auto const points = random_points(interior.bounding_box(), 100000);
    double inside = 0;
    for (char const in : interior.contains(points)) inside += in;
    double const share = inside / double(points.size()), volume = interior.bounding_box().volume();
    return {share * volume, volume * std::sqrt(share * (1 - share) / double(points.size()))};
}

void check_monte_carlo(MeshInterior const& interior)
{
    auto const [volume, error] = monte_carlo_volume(interior);
    CHECK(std::abs(volume - interior.volume()) < 4 * error + 1e-3 * interior.volume());
}

} // namespace

TEST_CASE(
    "the volume of a sphere and of a torus converges to the exact one with the square of the edge length")
{
    double const exact_sphere = 4.0 / 3 * pi, exact_torus = 2 * pi * pi * 0.35 * 0.35;
    auto const sphere_error = [&](unsigned n) {
        return exact_sphere - MeshInterior(meshes::sphere(1, n)).volume();
    };
    auto const torus_error = [&](unsigned n) {
        return exact_torus - MeshInterior(meshes::torus(1, 0.35, 3 * n, n)).volume();
    };
    CHECK(sphere_error(64) < 2e-3 * exact_sphere);
    CHECK(sphere_error(32) / sphere_error(64) == Approx(4).epsilon(0.02));
    CHECK(torus_error(64) < 3e-3 * exact_torus);
    CHECK(torus_error(32) / torus_error(64) == Approx(4).epsilon(0.02));
}

TEST_CASE("points are inside a sphere or a torus just as geometry says")
{
    MeshInterior const ball(meshes::sphere(1, 64)), ring(meshes::torus(1, 0.35, 192, 64));
    int wrong = 0;
    for (auto const& x : random_points(ball.bounding_box(), 20000)) {
        if (std::abs(x.norm() - 1) > 0.005) wrong += ball.contains(x) != (x.norm() < 1);
        double const from_tube = std::hypot(std::hypot(x.x(), x.y()) - 1, x.z());
        if (std::abs(from_tube - 0.35) > 0.005) wrong += ring.contains(x) != (from_tube < 0.35);
    }
    CHECK(wrong == 0);
    CHECK_FALSE(ball.contains({std::nan(""), 0, 0}));
    CHECK_FALSE(ball.contains({1e300, 0, 0}));
    check_monte_carlo(ball);
    check_monte_carlo(ring);
    CHECK_FALSE(ring.repaired());
    CHECK(ring.volume_error() == 0);
}

TEST_CASE("two threads find the same points inside as one")
{
    MeshInterior const ring(meshes::torus(1, 0.35, 96, 32));
    auto const points = random_points(ring.bounding_box(), 30001);
    CHECK(ring.contains(points) == ring.contains(points, TwoThreads{}));
    auto const alone = firn::poisson_disk_points(ring, firn::Count{2000}, 3);
    auto const shared = firn::poisson_disk_points(ring, firn::Count{2000}, 3, TwoThreads{});
    CHECK(alone.points == shared.points);
}

TEST_CASE("the volume does not depend on where the mesh is")
{
    Vector3d const far{1000, -2000, 3000};
    MeshInterior const there(meshes::moved(meshes::box({0, 0, 0}, {1, 2, 3}), far));
    CHECK(there.volume() == Approx(6).epsilon(1e-12));
    CHECK(there.contains(Vector3d{0.5, 0.5, 0.5} + far));
}

TEST_CASE("prisms over polygons of any shape are solids of the right volume, from whichever corner")
{
    meshes::Folder const folder;
    Eigen::Matrix3d const turned = Eigen::AngleAxisd(0.7, Vector3d{1, -2, 3}.normalized()).toRotationMatrix();
    for (auto const& profile : polygons::profiles()) {
        INFO(profile.name);
        double const exact = 2 * polygons::area(profile.outline);
        auto outline = profile.outline;
        for (std::size_t start = 0; start < outline.size(); ++start) {
            CAPTURE(start);
            auto solid = polygons::prism(outline);
            auto const check = [&](std::string const& file) {
                auto const mesh = firn::read_mesh(folder / file);
                std::size_t corners = 0; // each polygon of n corners becomes n - 2 triangles
                for (auto const& face : solid.faces) corners += face.size() - 2;
                CHECK(mesh.triangles.size() == corners);
                CHECK(MeshInterior(mesh).volume() == Approx(exact).epsilon(1e-12));
            };
            folder.file("a.obj", solid.obj());
            check("a.obj");
            if (start == 0) {
                folder.file("a.ply", solid.ply());
                check("a.ply");
            }
            for (auto& x : solid.vertices) x = turned * x + Vector3d{0.1, 20, -3}; // no polygon is plane now
            folder.file("a.obj", solid.obj());
            check("a.obj");
            std::ranges::rotate(outline, outline.begin() + 1);
        }
    }
}

TEST_CASE("solids beside one another add up")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(mesh, meshes::inverted(meshes::box({2, 0, 0}, {4, 1, 1})));
    MeshInterior const two(mesh);
    CHECK(two.components() == 2);
    CHECK(two.volume() == Approx(3).epsilon(1e-12));
    CHECK(two.contains({0.5, 0.5, 0.5}));
    CHECK(two.contains({3, 0.5, 0.5}));
    CHECK_FALSE(two.contains({1.5, 0.5, 0.5}));
}

TEST_CASE("of shells inside one another every second one is a hole, however they are oriented")
{
    auto const turned = GENERATE(0, 1, 2, 3, 4, 5, 6, 7);
    firn::TriangleMesh mesh;
    for (int shell = 0; shell < 3; ++shell) {
        auto const one = meshes::sphere(1 - 0.3 * shell, 24);
        meshes::append(mesh, turned >> shell & 1 ? meshes::inverted(one) : one);
    }
    MeshInterior const onion(mesh);
    CHECK(onion.components() == 3);
    CHECK(onion.contains({0.85, 0, 0}));
    CHECK_FALSE(onion.contains({0.55, 0, 0}));
    CHECK(onion.contains({0.1, 0, 0}));
    double const ball = MeshInterior(meshes::sphere(1, 24)).volume();
    CHECK(onion.volume() == Approx(ball * (1 - 0.343 + 0.064)).epsilon(1e-9));
    check_monte_carlo(onion);
}

TEST_CASE("a mesh turned inside out is the same solid")
{
    MeshInterior const ball(meshes::inverted(meshes::sphere(1, 24)));
    CHECK(ball.volume() == Approx(MeshInterior(meshes::sphere(1, 24)).volume()));
    CHECK(ball.contains({0, 0, 0}));
    auto const& mesh = ball.surface();
    CHECK(firn::detail::surface_sums(mesh).volume > 0);
}

TEST_CASE("a sound mesh is the same with repair as without")
{
    MeshInterior const ball(meshes::hollow_ball(1, 0.5, 24), Repair::fill);
    CHECK_FALSE(ball.repaired());
    CHECK(ball.defect().empty());
    CHECK(ball.volume() == MeshInterior(meshes::hollow_ball(1, 0.5, 24)).volume());
}

TEST_CASE("a head with open eyes is filled to the volume of the closed one")
{
    auto const n = 48u;
    // The closed skull crosses its eyeballs, so the reference is their union. Its volume is that of a ball
    // and of what sticks out of it.
    MeshInterior const open(meshes::head(n), Repair::fill);
    MeshInterior const closed(meshes::head(n, false), Repair::fill);
    CHECK(open.repaired());
    CHECK_THAT(open.defect(), Contains("2 holes") && Contains("3 components"));
    CHECK(open.components() == 3);
    CHECK(open.volume() == Approx(closed.volume()).epsilon(3e-3));
    CHECK(open.volume_error() / open.volume() < 4e-4);
    check_monte_carlo(open);

    double const R = 1, r = 0.2, apart = 0.95; // two balls' lens: the part of an eyeball within the skull
    double const lens = pi * std::pow(R + r - apart, 2) *
                        (apart * apart + 2 * apart * (R + r) - 3 * (R - r) * (R - r)) / (12 * apart);
    double const exact = 4.0 / 3 * pi + 2 * (4.0 / 3 * pi * r * r * r - lens);
    CHECK(closed.volume() == Approx(exact).epsilon(4e-3)); // n = 48 itself is 0.3 % too small
    for (auto const& eye : meshes::eyes()) {
        CHECK(open.contains(1.1 * eye));
        CHECK(open.contains(0.5 * eye));
    }
    CHECK(open.contains({0, 0, 0}));
    CHECK_FALSE(open.contains({0, -1.02, 0}));
}

TEST_CASE("overlapping solids are united by repair")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(mesh, meshes::inverted(meshes::box({0.5, 0.25, 0.25}, {1.5, 0.75, 0.75})));
    MeshInterior const both(mesh, Repair::fill);
    CHECK(both.volume() == Approx(1.125).epsilon(1e-3));
    CHECK(both.contains({0.75, 0.5, 0.5}));
    CHECK(both.contains({1.25, 0.5, 0.5}));
}

TEST_CASE("a hollow ball with a crack keeps its hollow, inside out as a whole too")
{
    auto const crack = [](Vector3d const& x) { return x.norm() > 0.9 && x.z() > 0.985; };
    auto const mesh = meshes::without(meshes::hollow_ball(1, 0.5, 24), crack);
    for (auto const& cracked : {mesh, meshes::inverted(mesh)}) {
        MeshInterior const ball(cracked, Repair::fill, TwoThreads{});
        CHECK(ball.volume() == Approx(4.0 / 3 * pi * 0.875).epsilon(1e-2));
        CHECK_FALSE(ball.contains({0, 0, 0}));
        CHECK(ball.contains({0.75, 0, 0}));
    }
}

TEST_CASE("the fast winding number is that of the sum over all triangles")
{
    auto const mesh = meshes::head(48);
    firn::WindingNumber const fast(mesh);
    double worst = 0;
    for (auto const& x : random_points({Vector3d::Constant(-1.2), Vector3d::Constant(1.2)}, 300)) {
        double exact = 0;
        for (auto const& t : mesh.triangles) {
            Vector3d const a = mesh.vertices[t[0]] - x, b = mesh.vertices[t[1]] - x,
                           c = mesh.vertices[t[2]] - x;
            exact += 2 * std::atan2(a.dot(b.cross(c)), a.norm() * b.norm() * c.norm() + a.dot(b) * c.norm() +
                                                           b.dot(c) * a.norm() + c.dot(a) * b.norm());
        }
        worst = std::max(worst, std::abs(fast(x) - exact / (4 * pi)));
    }
    CHECK(worst < 0.06);
}

TEST_CASE("the cells of a filled surface tell what its winding number tells")
{
    auto two = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(two, meshes::box({0.5, 0.25, 0.25}, {1.5, 0.75, 0.75}));
    auto bowl = meshes::without(meshes::sphere(1, 12), [](Vector3d const& x) { return x.z() > 0.3; });
    auto soup = meshes::sphere(1, 5); // each triangle by itself, none at its neighbours' corners
    firn::TriangleMesh loose;
    for (auto const& t : soup.triangles) {
        auto const first = static_cast<std::uint32_t>(loose.vertices.size());
        Vector3d const middle = (soup.vertices[t[0]] + soup.vertices[t[1]] + soup.vertices[t[2]]) / 3;
        for (auto const corner : t) loose.vertices.push_back(0.99 * soup.vertices[corner] + 0.01 * middle);
        loose.triangles.push_back({first, first + 1, first + 2});
    }
    for (auto const& mesh : {two, bowl, loose, meshes::head(12), meshes::finned_shell(0.7, 8, 8)}) {
        firn::WindingNumber const winding(mesh);
        firn::FilledSurface const filled(mesh);
        int wrong = 0, inside = 0;
        int const count = firn::test::sample_of(4000, 10000);
        for (auto const& x : random_points(filled.bounding_box(), count)) {
            double const w = winding(x);
            inside += w > 0.5;
            if (std::abs(w - 0.5) > 0.05) wrong += filled.contains(x) != (w > 0.5);
        }
        CHECK(wrong == 0);
        double const box = filled.bounding_box().volume(), share = double(inside) / count;
        CHECK(filled.volume() / box ==
              Approx(share).margin(4 * std::sqrt(share * (1 - share) / count) + 1e-3));
    }
}

TEST_CASE("a thin shell with edges of three triangles is filled within seconds, and tells how far it is")
{
    auto const mesh = meshes::finned_shell(0.95, 14, 14);
    auto const plain = MeshInterior(meshes::hollow_ball(1, 0.95, 14)).volume();
    std::vector<double> told;
    auto const start = std::clock();
    MeshInterior const shell(mesh, Repair::fill, TwoThreads{}, [&](double share) { told.push_back(share); });
    CHECK(double(std::clock() - start) / CLOCKS_PER_SEC <
          15); // 45 s, were each point asked of all the surface
    CHECK_THAT(shell.defect(), Contains("14 edges with more than two triangles"));
    CHECK(shell.volume() == Approx(plain).epsilon(5e-3)); // and what the fins bend
    CHECK(shell.volume_error() / shell.volume() < 1e-3);
    REQUIRE(told.size() > 10);
    CHECK(told.front() == 0);
    CHECK(told.back() == 1);
    CHECK(std::ranges::is_sorted(told));
}

TEST_CASE("filling is the same with any loop, and ends when its progress throws")
{
    auto const mesh = meshes::head(12);
    MeshInterior const alone(mesh, Repair::fill), shared(mesh, Repair::fill, TwoThreads{}),
        backend(mesh, Repair::fill, firn::OpenMP{2});
    CHECK(alone.volume() == shared.volume());
    CHECK(alone.volume() == backend.volume());
    struct Enough
    {};
    auto const stop = [](double share) {
        if (share > 0.2) throw Enough{};
    };
    CHECK_THROWS_AS(MeshInterior(mesh, Repair::fill, firn::OpenMP{2}, stop), Enough);
    int called = 0;
    MeshInterior const sound(meshes::sphere(1, 8), Repair::fill, firn::OpenMP{2}, [&](double) { ++called; });
    CHECK(called == 0);
}

TEST_CASE("the distance of a meshed sphere is that of the sphere")
{
    double const h = 0.05;
    auto const grid =
        firn::distance_from_mesh<double>(MeshInterior(meshes::sphere(1, 64)), h, 0.2, TwoThreads{});
    double worst = 0, worst_normal = 0;
    for (auto const& x : random_points({Vector3d::Constant(-1.2), Vector3d::Constant(1.2)}, 20000)) {
        auto const [distance, normal] = grid.surface(x);
        if (x.norm() < 0.3) continue; // the centre, where the distance has a kink
        worst = std::max(worst, std::abs(distance - (x.norm() - 1)));
        worst_normal = std::max(worst_normal, (normal - x.normalized()).norm());
    }
    CHECK(worst < 0.004); // the interpolant's h² / (4 · 0.3) and the mesh's 0.0012
    CHECK(worst_normal < 0.1);
    CHECK(grid.surface({5, 0, 0}).distance ==
          Approx(std::hypot(3.8, 0.2)).margin(0.01)); // a lower bound of 4
}

TEST_CASE("the distance of a repaired head sees neither its holes nor what is buried in it")
{
    double const h = 0.05;
    MeshInterior const head(meshes::head(48), Repair::fill);
    auto const grid = firn::distance_from_mesh<double>(head, h, 0.2);
    for (auto const& eye : meshes::eyes()) {
        CHECK(grid.surface(1.15 * eye).distance == Approx(0).margin(0.01)); // the eyeball's front
        CHECK(grid.surface(0.7 * eye).distance < -0.2);                     // behind it
    }
    int wrong = 0;
    for (auto const& x : random_points(head.bounding_box(), 20000)) {
        double const distance = grid.surface(x).distance;
        if (std::abs(distance) > h) wrong += head.contains(x) != (distance < 0);
    }
    CHECK(wrong == 0);
}

TEST_CASE("a mesh that deforms is between its forms, and its surface has the velocity of its vertices")
{
    auto const before = meshes::sphere(0.3, 48);
    auto after = before; // grown by a quarter, and farther away than it is large
    Vector3d const way(0.8, 0.1, 0);
    for (auto& x : after.vertices) x = 1.25 * x + way;
    auto const shape = firn::deforming_mesh<double>(before, after, 2, 0.5, 0.04, 0.2, TwoThreads{});
    for (double const share : {0.0, 0.3, 1.0}) {
        double const before_it = share > 0 ? 1e-3 : 0, time = 2 + 0.5 * share;
        auto const now =
            shape.view().over({time - before_it, time - before_it + 1e-3}); // ends there, or begins
        double worst = 0, worst_speed = 0;
        for (auto const& direction : random_points({Vector3d::Constant(-1), Vector3d::Constant(1)}, 500)) {
            Vector3d const n = direction.normalized();
            Vector3d const x = share * way + 0.3 * (1 + 0.25 * share) * n;
            worst = std::max(worst, std::abs(now.surface(x).distance));
            if (share == 0.3) continue; // its way is that of the form halfway
            worst_speed = std::max(worst_speed, (now.velocity(x) - (way + 0.25 * 0.3 * n) / 0.5).norm());
        }
        CAPTURE(share);
        CHECK(worst < 0.01); // a quarter of a cell of its grid
        CHECK(worst_speed < 0.3);
    }
    CHECK(shape.view().over({1.8, 1.9}).velocity(way).norm() == 0);
    CHECK(shape.view().over({2.5, 2.6}).velocity(way).norm() == 0);
    // a step that goes beyond the end has the rest of the way for all of its length
    Vector3d const whole = shape.view().over({2.3, 2.4}).velocity(way);
    CHECK((shape.view().over({2.4, 2.6}).velocity(way) - 0.5 * whole).norm() < 1e-9 * whole.norm());

    auto const refuse = [&](firn::TriangleMesh const& other, double duration, char const* what) {
        CHECK_THAT(
            firn::test::refused([&] { firn::deforming_mesh(before, other, 0, duration, 0.04, 0.2); }).what(),
            Contains(what));
    };
    auto other = after;
    std::swap(other.triangles[0], other.triangles[1]);
    refuse(other, 1, "different triangles");
    other.vertices.pop_back();
    refuse(other, 1, "vertices");
    refuse(after, 0, "duration");
}

TEST_CASE("samplers fill a mesh and share its volume")
{
    MeshInterior const ring(meshes::torus(1, 0.35, 96, 32));
    for (auto const& sample :
         {firn::lattice_points(ring, firn::Count{5000}), firn::uniform_points(ring, firn::Count{5000}),
          firn::poisson_disk_points(ring, firn::Count{5000})}) {
        CHECK(sample.points.size() == 5000);
        CHECK(sample.volume_per_point * 5000 == Approx(ring.volume()).epsilon(1e-12));
        auto const inside = ring.contains(sample.points);
        CHECK(std::ranges::count(inside, 1) == 5000);
    }
}

namespace
{

/// Drives particles at obstacles made of meshes, that act on nodes, on particles too, and as shells.
void check_leaks(int count, int steps)
{
    using namespace firn::test;
    double const reach = 1.5 * std::sqrt(3.0); // of the kernel along a diagonal, see physics/leaks.cpp
    Swing const swing{.reach = 0.2, .turn = {1, -2, 3}};
    for (auto const& mesh : {meshes::torus(0.35, 0.15, 40, 20), meshes::hollow_ball(0.45, 0.25, 16)}) {
        auto const shape = firn::distance_from_mesh<float>(MeshInterior(mesh), 0.025, 0.15, TwoThreads{});
        using Shape = std::decay_t<decltype(shape)>;
        auto const check = [&](auto const& obstacle, double deepest, double last) {
            auto const driven = drive<float, 3>(count, steps, shape, obstacle, swing);
            CAPTURE(driven.steps, driven.longest, driven.mean, driven.deepest);
            CHECK(driven.deepest <= deepest);
            CHECK(driven.last <= last);
            CHECK(driven.mean < 1); // they are at the obstacle
        };
        check(firn::Obstacle<Shape>{.shape = shape}, reach, reach);
        check(firn::Obstacle<Shape>{.shape = shape, .on_particles = true}, 0.1, 1e-3);
        check(firn::Obstacle<firn::Shell<Shape>>{.shape = {shape, 0.05 * cell}}, 0, 0);
    }
}

} // namespace

TEST_CASE("nothing gets into or through obstacles that are made of meshes, moving and turning")
{
    check_leaks(1000, 200);
}

TEST_CASE("nor do 1e5 particles in 2 000 steps", "[.full]") { check_leaks(100000, 2000); }

TEST_CASE("a mesh of a ball acts at its surface as a ball, and keeps momentum")
{
    using namespace firn::test;
    double const h = 0.05, radius = 0.2;
    auto const mesh = firn::distance_from_mesh<double>(MeshInterior(meshes::sphere(radius, 32)), h / 2, 3 * h,
                                                       TwoThreads{});
    auto const pushed_by = [&](auto const& shape) {
        firn::Solver<firn::OpenMP, firn::NeoHookean<Solid>> block(firn::lattice(h));
        block.add(box_of_points<3>({-0.15, 0.2, -0.15}, {0.15, 0.4, 0.15}, h), h * h * h / 8, {0.5, -2, 0});
        firn::Obstacles<std::decay_t<decltype(shape)>, firn::ActsOn::surface> ball;
        ball.list.push_back({.shape = shape,
                             .contact = firn::Contact::coulomb(0.3),
                             .motion = {.velocity = {0, 0.2, 0}, .angular_velocity = {1, 2, 3}}});
        Vector3d const before = Totals(block).momentum;
        Vector3d received = Vector3d::Zero();
        for (auto const& report : block.steps(100, 3e-4, ball)) received += report.reactions[0].impulse;
        CHECK((before - Totals(block).momentum - received).norm() < 1e-12 * before.norm());
        CHECK(received.norm() > 0.2 * before.norm());
        return received;
    };
    Vector3d const by_ball = pushed_by(firn::Sphere{radius}), by_mesh = pushed_by(mesh);
    CHECK((by_mesh - by_ball).norm() < 0.03 * by_ball.norm());
}

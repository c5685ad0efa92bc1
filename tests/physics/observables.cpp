// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"
#include "support/policies.hpp"

#include <firn/io/csv_series.hpp>
#include <firn/io/write_samples.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

using Jelly = NeoHookean<Plane>;
using Water = Fluid<Plane>;
using Both = Scene<Materials<Jelly, Water>, QuadraticBSpline, Mls>;
using SnowInSpace = Scene<Snow<SolidFloat>, QuadraticBSpline, Flip>;

double const density = 1000, gravity = 9.81, h = 1.0 / 16;
auto const moduli = lame(1e5, 0.3);

Jelly jelly()
{
    Jelly model;
    model.density = density;
    model.elasticity = moduli;
    return model;
}
Water water(double viscosity)
{
    Water model;
    model.density = density;
    model.bulk_modulus = 1e5;
    model.viscosity = viscosity;
    model.parts = false;
    return model;
}

Both::Solver both(double viscosity = 0) { return Both::Solver(lattice(h), {jelly(), water(viscosity)}); }

/// One jelly particle for each displacement gradient, and its stress and energy.
struct Strained
{
    explicit Strained(std::vector<Eigen::Matrix2d> const& H) : solver(both())
    {
        for (std::size_t i = 0; i < H.size(); ++i) points.emplace_back(0.1 * double(i), 0.3);
        solver.add<Jelly>(points, 1e-4);
        solver.upload<DisplacementGradient, Jelly>(H);
    }
    std::vector<Eigen::Vector2d> points;
    Both::Solver solver;
};

Eigen::Matrix2d matrix(double xx, double xy, double yx, double yy)
{
    Eigen::Matrix2d H;
    H << xx, xy, yx, yy;
    return H;
}

} // namespace

TEST_CASE("stress, pressure, volume and energy of a stretch along one axis, of shear and of a turn are those "
          "of the neo-Hookean law")
{
    double const s = 0.7, g = 0.4, angle = 1.1, c = std::cos(angle), n = std::sin(angle), log_s = std::log(s);
    Strained const strained({matrix(s - 1, 0, 0, 0), matrix(0, g, 0, 0), matrix(c - 1, -n, n, c - 1)});
    auto const stress = strained.solver.download<Stress, Jelly>();
    auto const pressure = strained.solver.download<Pressure, Jelly>();
    auto const equivalent = strained.solver.download<VonMisesStress, Jelly>();
    auto const energy = strained.solver.download<EnergyDensity, Jelly>();
    auto const volume = strained.solver.download<VolumeRatio, Jelly>();
    double const mu = moduli.mu, lambda = moduli.lambda, unit = lambda + 2 * mu;

    double const along = (mu * (s * s - 1) + lambda * log_s) / s, across = lambda * log_s / s;
    CHECK((stress[0] - matrix(along, 0, 0, across)).norm() <= 1e-12 * unit);
    CHECK(pressure[0] == Approx(-(along + across) / 2).epsilon(1e-12));
    CHECK(equivalent[0] == Approx(std::sqrt(0.75) * std::abs(along - across)).epsilon(1e-12));
    CHECK(energy[0] == Approx(mu / 2 * (s * s - 1) - mu * log_s + lambda / 2 * log_s * log_s).epsilon(1e-12));
    CHECK(volume[0] == Approx(s).epsilon(1e-12));

    CHECK((stress[1] - mu * matrix(g * g, g, g, 0)).norm() <= 1e-12 * unit);
    CHECK(energy[1] == Approx(mu / 2 * g * g).epsilon(1e-12));
    CHECK(volume[1] == Approx(1).epsilon(1e-12));

    CHECK(stress[2].norm() <= 1e-12 * unit);
    CHECK(std::abs(energy[2]) <= 1e-12 * unit);
    CHECK(volume[2] == Approx(1).epsilon(1e-12));
}

TEST_CASE("a viscous fluid's stress is Tait's pressure and Newton's stress of the velocity gradient")
{
    double const viscosity = 20, rate = 3, log_J = -0.01;
    auto solver = both(viscosity);
    std::vector<Eigen::Vector2d> const points{{0.1, 0.1}, {0.15, 0.12}};
    solver.add<Water>(points, 1e-4);
    solver.upload<AffineVelocity, Water>({matrix(0, rate, 0, 0), matrix(0, 0, 0, 0)});
    solver.upload<LogVolumeRatio, Water>({0, log_J});
    double const pressure = 1e5 / 7 * std::expm1(-7 * log_J);
    auto const stress = solver.download<Stress, Water>();
    CHECK((stress[0] - viscosity * matrix(0, rate, rate, 0)).norm() <= 1e-12 * viscosity * rate);
    CHECK((stress[1] + pressure * Eigen::Matrix2d::Identity()).norm() <= 1e-12 * pressure);
    CHECK(solver.download<Pressure, Water>()[1] == Approx(pressure).epsilon(1e-12));
    CHECK(solver.download<VolumeRatio, Water>()[1] == Approx(std::exp(log_J)).epsilon(1e-12));
    CHECK(solver.download<VelocityGradient, Water>()[0] == matrix(0, rate, 0, 0));
    CHECK(solver.download<VonMisesStress, Water>()[0] == Approx(std::sqrt(3.0) * viscosity * rate));
    double const J = std::exp(log_J);
    CHECK(solver.download<EnergyDensity, Water>()[1] ==
          Approx(1e5 / 7 * ((std::pow(J, -6) - 7) / 6 + J)).epsilon(1e-9));
}

TEST_CASE("an observed field of all materials has the values of each in their places, downloaded or written")
{
    auto solver = both();
    using Point = std::vector<Eigen::Vector2d>;
    solver.add<Jelly>(Point{{0, 0}}, 1e-4);
    solver.add<Water>(Point{{0.5, 0}}, 1e-4);
    solver.add<Jelly>(Point{{1, 0}}, 1e-4);
    solver.upload<DisplacementGradient, Jelly>({matrix(0.1, 0, 0, 0), matrix(0.2, 0, 0, 0)});
    solver.upload<LogVolumeRatio, Water>({-0.1});
    auto const all = solver.download<VolumeRatio>();
    CHECK(all[0] == Approx(1.1));
    CHECK(all[1] == Approx(std::exp(-0.1)));
    CHECK(all[2] == Approx(1.2));

    TestedBackend const backend{};
    TestedBackend::Array<double> there(backend);
    there.resize(10);
    there.fill(0, 10, -1.0);
    solver.write<Stress, Jelly>(there.data(), 5);
    std::vector<double> here(10);
    there.download(0, here);
    auto const stress = solver.download<Stress, Jelly>();
    for (int i = 0; i < 2; ++i) {
        for (int c = 0; c < 4; ++c) CHECK(here[5 * i + c] == stress[i](c / 2, c % 2));
        CHECK(here[5 * i + 4] == -1);
    }
    CHECK_THROWS_AS((solver.write<Stress, Jelly>(there.data(), 3)), Error);
    CHECK_THROWS_AS((solver.write<Stress, Jelly>(nullptr)), Error);
    CHECK(both().download<Stress>().empty());
}

TEST_CASE("of snow that yields the stress is that of its elastic part, hardened, and asking changes nothing")
{
    SnowInSpace::Solver solver(lattice(h));
    auto const points = box_of_points<3>({0, 0, 0}, {0.25, 0.25, 0.25}, h);
    solver.add(points, std::pow(h / 2, 3));
    std::vector<Eigen::Vector3f> v;
    double const rate = -20;
    for (auto const& x : points) v.emplace_back(float(rate * x[0]), 0.f, 0.f);
    solver.upload<Velocity>(v);
    double const dt = 1e-4;
    for (int i = 0; i < 25; ++i) solver.step(dt);
    auto const H = solver.download<DisplacementGradient>();
    auto const J_P = solver.download<PlasticVolumeRatio>();
    auto const x = solver.positions();
    auto const stress = solver.download<Stress>();
    auto const energy = solver.download<EnergyDensity>();
    auto const volume = solver.download<VolumeRatio>();
    double least = 1, worst_stress = 0, worst_energy = 0, worst_volume = 0;
    auto const& model = solver.model();
    for (std::size_t i = 0; i < H.size(); ++i) {
        Eigen::Matrix3d const F = Eigen::Matrix3d::Identity() + H[i].cast<double>();
        Eigen::JacobiSVD<Eigen::Matrix3d> const svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
        Eigen::Matrix3d const R = svd.matrixU() * svd.matrixV().transpose();
        double const J = F.determinant(), hard = std::exp(10 * (1 - double(J_P[i])));
        double const mu = hard * double(model.elasticity.mu), lambda = hard * double(model.elasticity.lambda);
        Eigen::Matrix3d const sigma =
            (2 * mu * (F - R) * F.transpose() + lambda * (J - 1) * J * Eigen::Matrix3d::Identity()) /
            (J * double(J_P[i]));
        double const psi = mu * (F - R).squaredNorm() + lambda / 2 * (J - 1) * (J - 1);
        worst_stress = std::max(worst_stress, (stress[i].cast<double>() - sigma).norm() / mu);
        worst_energy = std::max(worst_energy, std::abs(double(energy[i]) - psi) / mu);
        worst_volume = std::max(worst_volume, std::abs(double(volume[i]) - J * double(J_P[i])));
        least = std::min(least, double(J_P[i]));
    }
    CHECK(least < 0.99); // some have yielded
    CHECK(worst_stress <= 1e-5);
    CHECK(worst_energy <= 1e-6);
    CHECK(worst_volume <= 1e-6);
    CHECK(solver.download<DisplacementGradient>() == H);
    CHECK(solver.download<PlasticVolumeRatio>() == J_P);
    CHECK(solver.positions() == x);
    CHECK(solver.download<Stress>() == stress);
}

TEST_CASE("without an affine matrix the velocity gradient is that of the last step, and 0 after a change")
{
    SnowInSpace::Solver solver(lattice(h), {}, Flip{1});
    auto const points = box_of_points<3>({0, 0, 0}, {0.5, 0.5, 0.5}, h);
    solver.add(points, std::pow(h / 2, 3));
    Eigen::Matrix3f G;
    G << 1, 2, 3, -4, 5, 6, 7, -8, -9;
    std::vector<Eigen::Vector3f> v;
    for (auto const& x : points) v.push_back(G * x.cast<float>());
    solver.upload<Velocity>(v);
    CHECK(solver.download<VelocityGradient>()[0].norm() == 0);
    solver.step(1e-7);
    auto const L = solver.download<VelocityGradient>();
    double worst = 0;
    for (std::size_t i = 0; i < points.size(); ++i) // others see what nodes beyond the surface have
        if ((points[i].array() > 3 * h).all() && (points[i].array() < 0.5 - 3 * h).all())
            worst = std::max(worst, double((L[i] - G).norm()));
    CHECK(worst <= 1e-3);
    // a step that failed has written to the grid: what is told is that of the last good step, or nothing
    auto H = solver.download<DisplacementGradient>(); // forces, which a long step makes large
    for (std::size_t i = 0; i < points.size(); ++i)
        H[i] += 1e-4f * float(i % 7) * Eigen::Matrix3f::Identity();
    solver.upload<DisplacementGradient>(H);
    solver.upload<Velocity>(v);
    solver.step(1e-7);
    CHECK_THROWS_AS(solver.step(1), StepError);
    auto const after = solver.download<VelocityGradient>();
    double told = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        told = std::max(told, std::min(double(after[i].norm()), double((after[i] - L[i]).norm())));
    CHECK(told <= 1e-3);
    solver.step(1e-7);
    CHECK((solver.download<VelocityGradient>()[points.size() / 2] - L[points.size() / 2]).norm() <= 1e-2);
    solver.upload<Velocity>(v);
    CHECK(solver.download<VelocityGradient>()[0].norm() == 0);
}

namespace
{

double const height = 1, width = 2 * h, modulus = moduli.p_wave_modulus();

/// Fills a column of a height of 1 m.
template <class Material>
std::vector<Eigen::Vector2d> fill_column(Both::Solver& solver)
{
    auto const points = box_of_points<2>({0, 0}, {width, height}, h);
    solver.add<Material>(points, h * h / 4);
    return points;
}

/// Lets a column swing, or come to rest, between slippery walls.
void advance(Both::Solver& solver, double duration, double g, double damping)
{
    solver.advance(duration, Gravity{{0, -g, 0}}, Damping{damping}, ReflectingWall{.axis = 0},
                   ReflectingWall{.axis = 0, .node = 2, .side = -1}, ReflectingWall{.axis = 1});
}

/// The root mean square difference of some values from -rho g times the depth at rest, over that at the foot.
template <class Value>
double off_weight(std::vector<Eigen::Vector2d> const& points, double g, Value const& value)
{
    double squares = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        squares += std::pow(value(i) / (-density * g) - (height - points[i].y()), 2);
    return std::sqrt(squares / double(points.size())) / height;
}

} // namespace

// Whatever the law, the stress along the column is the weight of what was above it at rest, since its section
// stays. Across it is K0 = nu / (1 - nu) of that in small strains. A weight that is laid on at once loses
// twice the energy U = A (rho g)^2 H^3 / (6 M) that the column then has.
TEST_CASE(
    "a column at rest has the stress of its weight, K0 of it across, and lost as much energy as it stores")
{
    double const g = 0.1 * gravity, period = 4 * height / std::sqrt(modulus / density);
    auto solver = both();
    auto const points = fill_column<Jelly>(solver);
    Gravity const down{{0, -g, 0}};
    Energy const before = solver.energy(down);
    CHECK(before.gravitational == Approx(density * g * height * width * height / 2));
    CHECK(before.elastic == 0);
    advance(solver, 12 * period, g, 1.4 * 2 * M_PI / period);
    auto const stress = solver.download<Stress, Jelly>();
    CHECK(off_weight(points, g, [&](std::size_t i) { return stress[i](1, 1); }) <= 0.01);
    CHECK(off_weight(points, g, [&](std::size_t i) { return stress[i](0, 0) * (1 - 0.3) / 0.3; }) <= 0.015);
    Energy const after = solver.energy(down);
    double const stored = width * std::pow(density * g, 2) * std::pow(height, 3) / (6 * modulus);
    CHECK(after.elastic == Approx(stored).epsilon(0.02));
    CHECK(after.kinetic <= 1e-3 * stored);
    CHECK(after.dissipated_since(before) == Approx(stored).epsilon(0.02));
}

TEST_CASE("a column of fluid at rest has the pressure of its depth")
{
    double const g = 0.1 * gravity, period = 4 * height / std::sqrt(1e5 / density);
    auto solver = both();
    auto const points = fill_column<Water>(solver);
    advance(solver, 12 * period, g, 1.4 * 2 * M_PI / period);
    auto const pressure = solver.download<Pressure, Water>();
    CHECK(off_weight(points, g, [&](std::size_t i) { return -pressure[i]; }) <= 0.01);
}

TEST_CASE("a column that swings turns kinetic energy into elastic energy and back, and keeps their sum")
{
    auto solver = both();
    auto const points = fill_column<Jelly>(solver);
    double const c = std::sqrt(modulus / density), speed = 0.01 * c, period = 4 * height / c;
    std::vector<Eigen::Vector2d> velocity;
    std::vector<Eigen::Matrix2d> affine;
    for (auto const& x : points) {
        double const turn = M_PI / (2 * height);
        velocity.emplace_back(0, speed * std::sin(turn * x.y()));
        affine.push_back(matrix(0, 0, 0, speed * turn * std::cos(turn * x.y())));
    }
    solver.upload<Velocity, Jelly>(velocity);
    solver.upload<AffineVelocity, Jelly>(affine);
    Energy const start = solver.energy();
    CHECK(start.kinetic == Approx(density * width * height * speed * speed / 4).epsilon(5e-3));
    CHECK(start.elastic == 0);
    advance(solver, period / 4, 0, 0);
    Energy const strained = solver.energy<Jelly>();
    CHECK(strained.elastic >= 0.99 * start.kinetic);
    CHECK(strained.kinetic <= 0.01 * start.kinetic);
    advance(solver, period / 4, 0, 0);
    Energy const back = solver.energy();
    CHECK(back.kinetic >= 0.98 * start.kinetic);
    CHECK(std::abs(back.dissipated_since(start)) <= 5e-3 * start.kinetic);
    CHECK(solver.energy<Water>().total() == 0);
}

// Of n points s apart along an axis the mean square distance from their middle is s^2 (n^2 - 1) / 12, and the
// affine velocity of each adds that of its nodes, h^2 / 4.
TEST_CASE(
    "mass, centre, momentum and angular momentum of a square that turns and flies are those of its sums")
{
    auto solver = both();
    int const n = 16;
    double const s = h / 2, turn = 3, m = density * n * n * s * s;
    Eigen::Vector2d const low(0.3, -0.2), centre = low + Eigen::Vector2d::Constant(n * s / 2), fly(2, -1);
    auto const points = box_of_points<2>(low, low + Eigen::Vector2d::Constant(n * s), h);
    solver.add<Jelly>(points, s * s, fly);
    auto const spin = matrix(0, -turn, turn, 0);
    std::vector<Eigen::Vector2d> velocity;
    for (auto const& x : points) velocity.push_back(fly + spin * (x - centre));
    solver.upload<Velocity, Jelly>(velocity);
    solver.upload<AffineVelocity, Jelly>(std::vector<Eigen::Matrix2d>(points.size(), spin));
    double const inertia = m * (s * s * (n * n - 1) / 6 + h * h / 2);
    auto const totals = solver.totals();
    CHECK(totals.mass == Approx(m).epsilon(1e-12));
    CHECK((totals.centre_of_mass - centre).norm() <= 1e-12);
    CHECK((totals.momentum - m * fly).norm() <= 1e-12 * m);
    double const orbit = m * (centre.x() * fly.y() - centre.y() * fly.x());
    CHECK(totals.angular_momentum.z() == Approx(orbit + inertia * turn).epsilon(1e-12));
    CHECK(solver.totals(centre).angular_momentum.z() == Approx(inertia * turn).epsilon(1e-12));
    CHECK(solver.energy().kinetic ==
          Approx(0.5 * m * fly.squaredNorm() + 0.5 * inertia * turn * turn).epsilon(1e-12));
    CHECK(solver.totals<Water>().mass == 0);
    CHECK(solver.totals<Water>().centre_of_mass.norm() == 0);

    double const nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(solver.totals({0, nan}), Error);
    CHECK_THROWS_AS(solver.totals({1e305, -1e305}), Error); // moments that are none
    CHECK_THROWS_AS(solver.energy(Gravity{{0, nan, 0}}), Error);
    CHECK_THROWS_AS(solver.energy(Gravity{{1e308, -1e308, 0}}), Error);
    CHECK_THROWS_AS(solver.energy(Gravity{{0, 0, 1}}), Error);
}

TEST_CASE("in space a cube's angular momentum has all three components, and is that of its sums")
{
    SnowInSpace::Solver solver(lattice(h));
    int const n = 6;
    double const s = h / 2, m = 400 * std::pow(n * s, 3);
    Eigen::Vector3d const low(0.1, 0.2, -0.3), centre = low + Eigen::Vector3d::Constant(n * s / 2),
                                               turn(1, -2, 0.5), fly(3, 1, 2);
    auto const points = box_of_points<3>(low, low + Eigen::Vector3d::Constant(n * s), h);
    solver.add(points, s * s * s);
    std::vector<Eigen::Vector3f> velocity;
    for (auto const& x : points) velocity.push_back((fly + turn.cross(x - centre)).cast<float>());
    solver.upload<Velocity>(velocity);
    double const inertia = m * s * s * (n * n - 1) / 6;
    Eigen::Vector3d const expected = m * centre.cross(fly) + inertia * turn;
    CHECK((solver.totals().angular_momentum - expected).norm() <= 1e-6 * expected.norm());
    CHECK((solver.totals(centre).angular_momentum - inertia * turn).norm() <= 1e-4 * inertia * turn.norm());
}

TEST_CASE("the nodes of a particle lie as far from it as its kernel says")
{
    Lattice const cells = lattice(h);
    Eigen::Vector2d const x(0.3 * h, 0.6 * h);
    auto const of = [&]<class Kernel>(Kernel) { return firn::detail::inertia_of<Kernel, 2>(cells, x); };
    CHECK((of(Linear{}) - Eigen::Vector2d(0.3 * 0.7, 0.6 * 0.4)).norm() <= 1e-12);
    CHECK(of(QuadraticBSpline{})[0] == Approx(0.25));
    CHECK(of(CubicBSpline{})[0] == Approx(1.0 / 3));
}

#if defined(FIRN_TESTS_ON_OPENMP)
TEST_CASE("energy and momentum have the same bits with any number of threads")
{
    std::vector<Energy> energies;
    for (int const threads : {1, 3}) {
        Both::Solver solver(lattice(h), {jelly(), water(1)}, {}, {}, OpenMP{.threads = threads});
        fill_column<Jelly>(solver);
        advance(solver, 0.02, gravity, 0);
        energies.push_back(solver.energy(Gravity{}));
    }
    CHECK(energies[0].kinetic == energies[1].kinetic);
    CHECK(energies[0].elastic == energies[1].elastic);
    CHECK(energies[0].gravitational == energies[1].gravitational);
}
#endif

namespace
{

/// A block of jelly that is stretched along x, with a linear flow.
Both::Solver sheared_block(Eigen::Matrix2d const& G, Eigen::Vector2d const& fly, double strain)
{
    auto solver = both();
    auto const points = box_of_points<2>({0, 0}, {10 * h, 10 * h}, h);
    solver.add<Jelly>(points, h * h / 4);
    std::vector<Eigen::Vector2d> velocity;
    for (auto const& x : points) velocity.push_back(fly + G * x);
    solver.upload<Velocity, Jelly>(velocity);
    solver.upload<AffineVelocity, Jelly>(std::vector<Eigen::Matrix2d>(points.size(), G));
    solver.upload<DisplacementGradient, Jelly>(
        std::vector<Eigen::Matrix2d>(points.size(), matrix(strain, 0, 0, 0)));
    return solver;
}

std::string content(std::filesystem::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

} // namespace

TEST_CASE("inside a block samples are its density, its stress and its velocity, and outside all is 0")
{
    auto const G = matrix(1, 2, 3, 4);
    Eigen::Vector2d const fly(5, 6);
    double const strain = 0.1, s = 1 + strain;
    auto const solver = sheared_block(G, fly, strain);
    std::vector<Eigen::Vector2d> const places{{0.31, 0.3}, {0.2501, 0.33}, {-0.5, 0.1}, {1e30, 0}};
    auto const samples = solver.sample(places);
    REQUIRE(samples.size() == 4);
    double const along = (moduli.mu * (s * s - 1) + moduli.lambda * std::log(s)) / s,
                 across = moduli.lambda * std::log(s) / s;
    for (int i = 0; i < 2; ++i) { // particles as they lay at rest, so their density is that at rest
        CHECK(samples[i].density == Approx(density).epsilon(1e-9));
        CHECK((samples[i].velocity - fly - G * places[i]).norm() <= 1e-12 * fly.norm());
        CHECK((samples[i].stress - matrix(along, 0, 0, across)).norm() <= 1e-12 * modulus);
    }
    for (int i = 2; i < 4; ++i) {
        CHECK(samples[i].density == 0);
        CHECK(samples[i].velocity.norm() == 0);
        CHECK(samples[i].stress.norm() == 0);
    }
    // at an edge half of the kernel is empty; what is a mean stays
    auto const edge = solver.sample(std::vector<Eigen::Vector2d>{{0, 0.3}})[0];
    CHECK(edge.density == Approx(density / 2).epsilon(1e-9));
    CHECK((edge.stress - samples[0].stress).norm() <= 1e-12 * modulus);
    CHECK(solver.sample<Water>(places)[0].density == 0);
    CHECK(solver.sample<Jelly>(places)[0].density == samples[0].density);
}

TEST_CASE("where materials of different volumes meet, velocity is weighted by mass and stress by volume")
{
    auto solver = both();
    using Point = std::vector<Eigen::Vector2d>;
    Eigen::Vector2d const x(0.1, 0.2);
    solver.add<Jelly>(Point{x}, 1e-4, {1, 0});
    solver.add<Water>(Point{x}, 3e-4, {5, 0});
    double const log_J = std::log(0.9), pressure = 1e5 / 7 * std::expm1(-7 * log_J);
    solver.upload<LogVolumeRatio, Water>({log_J});
    auto const sample = solver.sample(Point{x})[0];
    CHECK(sample.velocity.x() == Approx(4));
    CHECK(sample.stress(0, 0) == Approx(-pressure * 2.7 / 3.7));
}

TEST_CASE("a grid of samples is that of its points, in VTI and CSV files too")
{
    meshes::Folder const folder;
    auto const solver = sheared_block(matrix(0, 1, 0, 0), {1, 0}, 0.1);
    auto const grid = sample_grid(solver, {0.2, 0.25}, {0.4, 0.3}, {3, 2});
    REQUIRE(grid.samples.size() == 6);
    CHECK((grid.place(1) - Eigen::Vector2d(0.3, 0.25)).norm() <= 1e-15);
    CHECK((grid.place(5) - Eigen::Vector2d(0.4, 0.3)).norm() <= 1e-15);
    for (std::size_t i = 0; i < 6; ++i) CHECK(grid.samples[i].velocity.x() == Approx(1 + grid.place(i).y()));

    write_vti(folder / "a.vti", grid, 0.5);
    auto const vti = content(folder / "a.vti");
    CHECK_THAT(vti, Contains("WholeExtent=\"0 2 0 1 0 0\" Origin=\"0.2 0.25 0\""));
    CHECK_THAT(vti, Contains("NumberOfTuples=\"1\" format=\"ascii\">0.5<"));
    CHECK_THAT(vti, Contains("Name=\"velocity\" NumberOfComponents=\"3\" format=\"appended\" offset=\"56\""));
    CHECK_THAT(vti, Contains("Name=\"stress\" NumberOfComponents=\"9\" format=\"appended\" offset=\"208\""));
    auto const at = vti.find("\n_") + 2;
    auto const number = [&](std::size_t place) {
        double value;
        std::copy_n(vti.data() + at + place, sizeof value, reinterpret_cast<char*>(&value));
        return value;
    };
    CHECK(number(8) == grid.samples[0].density);
    CHECK(number(56 + 8 + 5 * 24) == grid.samples[5].velocity.x());
    CHECK(number(208 + 8 + 72 + 4 * 8) == grid.samples[1].stress(1, 1));
    CHECK(vti.substr(at + 208 + 8 + 6 * 72) == "\n</AppendedData>\n</VTKFile>\n");

    write_csv(folder / "a.csv", grid);
    auto const csv = content(folder / "a.csv");
    CHECK_THAT(
        csv,
        StartsWith("x,y,density,velocity_x,velocity_y,stress_xx,stress_xy,stress_yx,stress_yy\n0.2,0.25,"));
    CHECK(std::count(csv.begin(), csv.end(), '\n') == 7);
    auto broken = grid;
    broken.samples.pop_back();
    CHECK_THROWS_AS(write_vti(folder / "a.vti", broken), Error);
    CHECK_THROWS_AS(write_csv(folder / "a.csv", broken), Error);
    CHECK_THROWS_WITH(write_vti(folder / "b.vti", grid, std::numeric_limits<double>::infinity()),
                      Contains("time of the samples is not finite"));
    CHECK(!std::filesystem::exists(folder / "b.vti"));
    CHECK(content(folder / "a.csv") == csv);
}

TEST_CASE("places that are none are refused, and so are grids that are none")
{
    auto const solver = sheared_block(matrix(0, 0, 0, 0), {0, 0}, 0);
    double const nan = std::numeric_limits<double>::quiet_NaN();
    using Points = std::vector<Eigen::Vector2d>;
    CHECK_THROWS_WITH(solver.sample(Points{}), Contains("no point"));
    CHECK_THROWS_WITH(solver.sample(Points{{0, 0}, {nan, 0}}), Contains("point 1"));
    CHECK_THROWS_AS(sample_grid(solver, {0, 0}, {0, 1}, {2, 2}), Error);
    CHECK_THROWS_AS(sample_grid(solver, {0, nan}, {1, 1}, {2, 2}), Error);
    CHECK_THROWS_AS(sample_grid(solver, {0, 0}, {1, 1}, {0, 2}), Error);
    CHECK_THROWS_WITH(sample_grid(solver, {0, 0}, {1, 1}, {2000000000, 2000000000}), Contains("2^31 - 1"));
    CHECK(sample_grid(solver, {0.3, 0.3}, {0.3, 0.4}, {1, 2}).samples[1].density == Approx(density));
}

TEST_CASE("a table of energies has its rows as they come, and refuses those that do not fit")
{
    meshes::Folder const folder;
    auto const path = folder / "energy.csv";
    CsvSeries series(path, {"time [s]", "kinetic [J]"});
    CHECK(content(path) == "time [s],kinetic [J]\n");
    series.add({0, 1.5});
    series.add({0.1, -2e-300});
    CHECK(content(path) == "time [s],kinetic [J]\n0,1.5\n0.1,-2e-300\n");
    CHECK_THROWS_AS(series.add({1}), Error);
    CHECK_THROWS_AS(CsvSeries(folder / "b.csv", {"a,b"}), Error);
    CHECK_THROWS_AS(CsvSeries(folder / "b.csv", {"a", "a"}), Error);
    CHECK_THROWS_AS(CsvSeries(folder / "b.csv", {}), Error);
    CHECK_THROWS_AS(CsvSeries(folder / "none/b.csv", {"a"}), Error);
    CHECK(content(path) == "time [s],kinetic [J]\n0,1.5\n0.1,-2e-300\n");
}

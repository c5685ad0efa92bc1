// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <algorithm>

using namespace firn;
using namespace firn::test;

namespace
{

/// What becomes of two disks that collide: cases 7.7 of the validation suite (after Sulsky et al. 1994).
struct Collision
{
    double kinetic = 0;          ///< kinetic energy at the end, of that at the start
    double least_kinetic = 1;    ///< the least on the way
    double least_at = 0;         ///< when [s]
    double largest_energy = 0;   ///< kinetic and elastic, of the kinetic one at the start
    double largest_momentum = 0; ///< [kg m/s per metre of depth]
};

template <class SceneType>
Collision collide(typename SceneType::Transfer const& transfer = {})
{
    using Number = typename SceneType::Number;
    double const h = 1.0 / 40, volume = h * h / 4;
    NeoHookean<typename SceneType::Space> material;
    material.density = 1000;
    material.elasticity = lame<Number>(1000, 0.3);
    typename SceneType::Solver solver(lattice(h), material, transfer);
    for (double side : {-1.0, 1.0}) {
        Vector<double, 2> const centre = Vector<double, 2>::Constant(0.5 + 0.3 * side);
        solver.add(ball_of_points<2>(centre, 0.2, h), volume, Vector<double, 2>::Constant(-0.1 * side));
    }
    auto const kinetic = [&](Vector<double, 2>& momentum) {
        auto const v = solver.template download<Velocity>();
        auto const m = solver.masses();
        double energy = 0;
        momentum.setZero();
        for (std::size_t i = 0; i < m.size(); ++i) {
            Vector<double, 2> const u = v[i].template cast<double>();
            energy += 0.5 * m[i] * u.squaredNorm();
            momentum += m[i] * u;
        }
        return energy;
    };
    Vector<double, 2> momentum;
    double const start = kinetic(momentum), mu = material.elasticity.mu, lambda = material.elasticity.lambda;
    Collision result;
    for (int frame = 0; frame < 72; ++frame) {
        solver.advance(0.05);
        result.kinetic = kinetic(momentum) / start;
        double elastic = 0;
        for (auto const& H : solver.template download<DisplacementGradient>()) {
            Matrix<double, 2> const F = Matrix<double, 2>::Identity() + H.template cast<double>();
            double const log_J = std::log(F.determinant());
            elastic +=
                volume * (0.5 * mu * (F.squaredNorm() - 2) - mu * log_J + 0.5 * lambda * log_J * log_J);
        }
        result.largest_energy = std::max(result.largest_energy, result.kinetic + elastic / start);
        result.largest_momentum = std::max(result.largest_momentum, momentum.norm());
        if (result.kinetic < result.least_kinetic) {
            result.least_kinetic = result.kinetic;
            result.least_at = solver.time();
        }
    }
    return result;
}

/// How far the top of a column sinks under its own weight between slippery walls [m], and the root mean
/// square error of its stress, of that at the foot: case 7.8. Whatever the law, the first Piola-Kirchhoff
/// stress is -rho_0 g (H - Y), Y being the height at rest.
template <class SceneType>
std::pair<double, double> settle(int cells)
{
    using Model = typename SceneType::Model;
    double const h = 1.0 / cells, g = 9.81, density = 1000;
    Model material;
    material.density = density;
    material.elasticity = lame<typename SceneType::Number>(1e5, 0.3);
    double const period = 4 / std::sqrt(material.elasticity.p_wave_modulus() / density);
    typename SceneType::Solver solver(lattice(h), material);
    auto const points = box_of_points<2>({0, 0}, {2 * h, 1}, h);
    solver.add(points, h * h / 4);
    solver.advance(12 * period, Gravity{}, Damping{1.4 * 6.283185307179586 / period},
                   ReflectingWall{.axis = 0}, ReflectingWall{.axis = 0, .node = 2, .side = -1},
                   ReflectingWall{.axis = 1});
    auto const x = solver.positions();
    auto const H = solver.template download<DisplacementGradient>();
    double squares = 0, highest = 0, tip = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        using Particle = Record<double, 2, typename Model::State>;
        auto particle = Particle::at_rest();
        particle[DisplacementGradient{}] = H[i];
        Matrix<double, 2> const still = Matrix<double, 2>::Zero();
        Matrix<double, 2> const tau =
            material.template respond<double>(particle, still, 0.0).kirchhoff_stress;
        double const found = tau(1, 1) / (1 + H[i](1, 1)), exact = -density * g * (1 - points[i].y());
        squares += (found - exact) * (found - exact);
        if (points[i].y() <= highest) continue;
        highest = points[i].y();
        tip = x[i].y() - highest + H[i](1, 1) * (1 - highest);
    }
    return {tip, std::sqrt(squares / double(points.size())) / (density * g)};
}

} // namespace

TEST_CASE("two elastic disks collide and part with most of their energy, and with their momentum")
{
    using Fast = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    using Lively = Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>;
    auto const check = [](Collision const& disks, double kept) {
        CHECK(disks.kinetic == Approx(kept).margin(0.03));
        CHECK(disks.least_kinetic < 0.5);
        CHECK(disks.least_at > 1.5); // they touch at about 1 s
        CHECK(disks.least_at < 2.5);
        CHECK(disks.largest_energy <= 1.01);
        CHECK(disks.largest_momentum <= 1e-12);
    };
    check(collide<Fast>(), 0.87);
    check(collide<Lively>(Flip{.fraction = 1}), 0.90);
    CHECK(collide<Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>>().kinetic <
          0.65); // it loses what it should keep
}

TEST_CASE("an elastic column under its own weight has the stress of equilibrium and the height of its law")
{
    using Mild = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    auto const [tip, error] = settle<Mild>(16);
    CHECK(tip == Approx(-0.03485531).epsilon(1e-3));
    CHECK(error <= 0.01);
    CHECK(settle<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>>(16).first ==
          Approx(-0.03643714).epsilon(1e-3));
    CHECK(settle<Scene<Hencky<Plane>, QuadraticBSpline, Mls>>(16).first == Approx(-0.03401370).epsilon(1e-3));
    // the error of stress falls with the cell size
    CHECK(settle<Mild>(8).second > 1.5 * error);
}

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/gravity.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/math/product.hpp>
#include <firn/particles/observables.hpp>
#include <firn/particles/readback.hpp>
#include <firn/transfer/transfer.hpp>

#include <cstddef>

// Sums over the particles of a scene. They are computed on the host, from downloads, in double precision and
// in rising order of rows: with the same bits in every run, for any number of workers of the backend.
namespace firn
{

/// The energy of some particles [J]; in the plane for a metre of depth.
struct Energy
{
    double kinetic = 0;       ///< of affine velocities, too
    double elastic = 0;       ///< of EnergyDensity
    double gravitational = 0; ///< -m g . x, if gravity was passed: 0 at the origin; none along periodic axes

    double total() const { return kinetic + elastic + gravitational; }

    /// The energy [J] that has been lost since an earlier moment, if nothing but the gravity that was passed
    /// has done work from outside and no particles came or went: what plastic flow, viscosity, contact and
    /// the transfer have turned into heat. Flow that hardens what is strained, such as snow's, may give some
    /// back.
    double dissipated_since(Energy const& earlier) const { return earlier.total() - total(); }
};

/// What some particles are together; in the plane for a metre of depth.
template <int d>
struct SceneTotals
{
    double mass = 0;                                               ///< [kg]
    Vector<double, d> centre_of_mass = zeros<Vector<double, d>>(); ///< [m]; 0 without particles
    Vector<double, d> momentum = zeros<Vector<double, d>>();       ///< [kg m/s]
    Eigen::Vector3d angular_momentum = zeros<Eigen::Vector3d>();   ///< [kg m^2/s]; in the plane along z
    double kinetic_energy = 0;                                     ///< [J]
};

namespace detail
{
/// The mean square distance between a particle and the nodes that it scatters to, along each axis [cells^2].
template <class Kernel, int d>
Vector<double, d> inertia_of([[maybe_unused]] Lattice const& lattice,
                             [[maybe_unused]] Vector<double, d> const& x)
{
    if constexpr (HasConstantInertia<Kernel>)
        return make_vector<double, d>([](int) { return 1 / double(Kernel::inverse_inertia); });
    else {
        Stencil<Kernel, double, d> const nodes(locate<d>(lattice, Kernel::degree, x).offset);
        return make_vector<double, d>([&](int a) {
            double sum = 0;
            for (std::size_t i = 0; i < nodes.weight[std::size_t(a)].size(); ++i) {
                double const away = nodes.distance[std::size_t(a)][i];
                sum += nodes.weight[std::size_t(a)][i] * away * away;
            }
            return sum;
        });
    }
}

/// The motion of a particle: its velocity [m/s], its affine matrix C [1/s], and C D [m^2/s], D being the mean
/// square distances of its nodes. Both matrices are zero without an affine velocity.
template <int d>
struct ParticleMotion
{
    Vector<double, d> velocity;
    Matrix<double, d> affine = zeros<Matrix<double, d>>(), spread = affine;

    /// The kinetic energy over the mass [m^2/s^2].
    double kinetic() const
    {
        double twice = dot<double, d>(velocity, velocity);
        for (int c = 0; c < d * d; ++c) twice += affine.data()[c] * spread.data()[c];
        return 0.5 * twice;
    }
};

/// Calls `use(mass, position, motion)` for every particle of a material, by row.
template <std::size_t k, class Scene, class Use>
FIRN_COLD void for_each_motion(Scene const& scene, Use const& use)
{
    constexpr int d = Scene::d;
    constexpr bool is_affine =
        Scene::Sets::template MaterialTraits<k>::State::template contains<AffineVelocity>;
    auto const& table = scene.sets.template particles<k>();
    auto const x = positions_of(table);
    auto const m = masses_of(table, scene.masses.unit);
    auto const v = scene.template download<Velocity, k>();
    decltype(scene.template download<VelocityGradient, k>()) C;
    if constexpr (is_affine) C = scene.template download<AffineVelocity, k>();
    double const h2 = scene.lattice.cell_size * scene.lattice.cell_size;
    for (std::size_t i = 0; i < x.size(); ++i) {
        ParticleMotion<d> motion{vector_of<double, d>(v[i])};
        if constexpr (is_affine) {
            auto const D = inertia_of<typename Scene::Kernel, d>(scene.lattice, x[i]);
            motion.affine = make_matrix<double, d>([&](int a, int b) { return double(C[i](a, b)); });
            motion.spread =
                make_matrix<double, d>([&](int a, int b) { return motion.affine(a, b) * D[b] * h2; });
        }
        use(m[i], x[i], motion);
    }
}
} // namespace detail

/// The energy of the material in `place`, or of all if that is their number; see Solver::energy.
template <std::size_t place, class Scene>
FIRN_COLD Energy energy_of(Scene const& scene, Gravity const& gravity)
{
    constexpr int d = Scene::d;
    using Sets = typename Scene::Sets;
    gravity.validate();
    if constexpr (d == 2) gravity.validate_in_plane();
    auto const g = vector_of<double, d>(gravity.acceleration);
    for (int a = 0; a < d; ++a)
        require(
            scene.lattice.periods[std::size_t(a)] == 0 || exactly_equal(g[a], 0),
            "gravity along a periodic axis has no potential: what goes around comes back with more energy",
            "Solver::energy", "Pass a gravity across the periodic axes, or none.");
    Energy sum;
    Sets::for_each([&](auto k) {
        if constexpr (Sets::template is_about<place, k>) {
            detail::for_each_motion<k>(scene, [&](double m, auto const& x, auto const& motion) {
                sum.kinetic += m * motion.kinetic();
                sum.gravitational -= m * dot<double, d>(g, x);
            });
            auto const density = scene.template download<EnergyDensity, k>();
            auto const volume = volumes_of(scene.sets.template particles<k>(), scene.masses.unit);
            for (std::size_t i = 0; i < density.size(); ++i) sum.elastic += volume[i] * double(density[i]);
        }
    });
    require(is_finite(sum.gravitational), "the energy of height is not finite under this gravity",
            "Solver::energy", "Pass the acceleration in m/s^2.");
    return sum;
}

/// The totals of the material in `place`, or of all if that is their number; see Solver::totals.
template <std::size_t place, class Scene>
FIRN_COLD SceneTotals<Scene::d> totals_of(Scene const& scene, Vector<double, Scene::d> const& about)
{
    constexpr int d = Scene::d;
    using Sets = typename Scene::Sets;
    for (int a = 0; a < d; ++a)
        require(is_between(-largest_length, about[a], largest_length),
                "the point about which momentum turns is not finite, or beyond 1e15 m", "Solver::totals",
                "Pass a point [m], or none for the origin.");
    SceneTotals<d> sum;
    Sets::for_each([&](auto k) {
        if constexpr (Sets::template is_about<place, k>)
            detail::for_each_motion<k>(scene, [&](double m, auto const& x, auto const& motion) {
                auto const r = in_space<d>(Vector<double, d>(x - about)), v = in_space<d>(motion.velocity);
                auto const A = [&](int a, int b) { return a < d && b < d ? motion.spread(a, b) : 0.0; };
                sum.mass += m;
                sum.kinetic_energy += m * motion.kinetic();
                sum.centre_of_mass += m * x;
                sum.momentum += m * motion.velocity;
                sum.angular_momentum +=
                    m *
                    (r.cross(v) + Eigen::Vector3d(A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1)));
            });
    });
    if (sum.mass > 0) sum.centre_of_mass /= sum.mass;
    return sum;
}

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/damping.hpp>
#include <firn/firn.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#elif defined(FIRN_TESTS_ON_REFERENCE)
#include <firn/reference.hpp>
#else
#define FIRN_TESTS_ON_OPENMP
#include <firn/openmp.hpp>
#endif

#include <cmath>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

// What tests of whole scenes share: one name for a combination of policies, bodies of particles, sums over
// them.
namespace firn::test
{

/// The backend that this file is compiled for: tests of whole scenes are compiled once for each.
#if defined(__CUDACC__)
using TestedBackend = Cuda;
#elif defined(FIRN_TESTS_ON_REFERENCE)
using TestedBackend = Reference;
#else
using TestedBackend = OpenMP;
#endif

/// What it computes on at a time.
template <class Number, class Backend = TestedBackend>
using TestedLane = typename Backend::template Lane<Number>;

#if defined(FIRN_TESTS_ON_OPENMP) && defined(FIRN_HAS_XSIMD)
/// Lanes that are packs of so many bytes: 16, which every processor that has packs has, or more where the
/// compile flags allow.
template <int bytes>
struct PacksOf
{
    template <class Number>
    using Lane = openmp::PackOf<Number, bytes / int(sizeof(Number))>;
};
#endif

/// A combination of policies, to be listed in TEMPLATE_TEST_CASE.
template <class ModelType, class KernelType, class TransferType, class BackendType = TestedBackend,
          class IntegratorType = SymplecticEuler>
struct Scene
{
    using Model = ModelType;
    using Kernel = KernelType;
    using Transfer = TransferType;
    using Backend = BackendType;
    using Integrator = IntegratorType;
    using Solver = firn::Solver<Backend, Model, Kernel, Transfer, Integrator>;
    using Space = typename Model::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    static constexpr bool is_implicit = !std::is_same_v<Integrator, SymplecticEuler>;
    static constexpr bool is_float = std::is_same_v<Number, float>;
};

/// In a list of combinations: those that prove little beyond the others of the list and the pairs of policies
/// (physics/pairs_*.cpp), and take minutes to compile: FIRN_TESTS_ALL has them.
template <class... Scenes>
struct More
{};

/// Likewise, but the reference backend alone leaves them out.
template <class... Scenes>
struct MoreThanReference
{};

template <class Scene>
struct Listed
{
    using Type = std::tuple<Scene>;
};
template <class... Scenes>
struct Listed<MoreThanReference<Scenes...>>
{
#if defined(FIRN_TESTS_ALL) || !defined(FIRN_TESTS_ON_REFERENCE)
    using Type = std::tuple<Scenes...>;
#else
    using Type = std::tuple<>;
#endif
};
template <class... Scenes>
struct Listed<More<Scenes...>>
{
#if defined(FIRN_TESTS_ALL)
    using Type = std::tuple<Scenes...>;
#else
    using Type = std::tuple<>;
#endif
};
template <class... Lists>
using Concatenated = decltype(std::tuple_cat(std::declval<Lists>()...));
template <class... Scenes>
using All = Concatenated<typename Listed<Scenes>::Type...>;

/// The combinations that a test goes through, written so that those in the middle may be left out where it is
/// only to be seen whether code for a device compiles: minutes of nvcc.
#if defined(FIRN_TESTS_FEW_COMBINATIONS)
template <class... Scenes>
using Combinations = std::tuple<std::tuple_element_t<0, All<Scenes...>>,
                                std::tuple_element_t<std::tuple_size_v<All<Scenes...>> - 1, All<Scenes...>>>;
#else
template <class... Scenes>
using Combinations = All<Scenes...>;
#endif

/// How many particles, steps or points a test takes: `all` of them on a device and with FIRN_TESTS_ALL, and
/// else `few`, which proves the same of a smaller sample.
constexpr int sample_of([[maybe_unused]] int few, [[maybe_unused]] int all)
{
#if defined(FIRN_TESTS_ALL) || (defined(__CUDACC__) && !defined(FIRN_ON_PROCESSOR))
    return all;
#else
    return few;
#endif
}

using Plane = Space<2, double>;
using PlaneFloat = Space<2, float>;
using Solid = Space<3, double>;
using SolidFloat = Space<3, float>;

/// Points at the middles of a regular lattice of `per_cell` points per cell and axis in a box.
template <int d>
std::vector<Vector<double, d>> box_of_points(Vector<double, d> const& low, Vector<double, d> const& high,
                                             double cell_size, int per_cell = 2)
{
    double const spacing = cell_size / per_cell;
    Eigen::Matrix<int, d, 1> count;
    for (int a = 0; a < d; ++a) count[a] = static_cast<int>(std::lround((high[a] - low[a]) / spacing));
    std::vector<Vector<double, d>> points;
    for (int i = 0; i < count[0]; ++i)
        for (int j = 0; j < count[1]; ++j)
            for (int k = 0; k < (d == 3 ? count[d - 1] : 1); ++k) {
                Vector<double, d> x = low;
                int const index[]{i, j, k};
                for (int a = 0; a < d; ++a) x[a] += (index[a] + 0.5) * spacing;
                points.push_back(x);
            }
    return points;
}

/// The points, each moved by up to `reach` along every axis: the same ones every time.
template <int d>
std::vector<Vector<double, d>> scattered(std::vector<Vector<double, d>> points, double reach)
{
    std::mt19937 random(1);
    std::uniform_real_distribution<double> away(-reach, reach);
    for (auto& x : points)
        for (int a = 0; a < d; ++a) x[a] += away(random);
    return points;
}

/// The points of a box that lie in a ball.
template <int d>
std::vector<Vector<double, d>> ball_of_points(Vector<double, d> const& centre, double radius,
                                              double cell_size, int per_cell = 2)
{
    Vector<double, d> const reach = Vector<double, d>::Constant(std::ceil(radius / cell_size) * cell_size);
    std::vector<Vector<double, d>> points;
    for (auto const& x : box_of_points<d>(centre - reach, centre + reach, cell_size, per_cell))
        if ((x - centre).norm() < radius) points.push_back(x);
    return points;
}

/// A random matrix of standard normal numbers.
template <int d>
Matrix<double, d> random_matrix(std::mt19937& random)
{
    std::normal_distribution<double> normal;
    Matrix<double, d> matrix;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) matrix(i, j) = normal(random);
    return matrix;
}

/// A random rotation.
template <int d>
Matrix<double, d> random_rotation(std::mt19937& random)
{
    Matrix<double, d> q = random_matrix<d>(random);
    for (int i = 0; i < d; ++i) { // Gram–Schmidt
        for (int j = 0; j < i; ++j) q.col(i) -= q.col(j) * q.col(j).dot(q.col(i));
        q.col(i).normalize();
    }
    if (q.determinant() < 0) q.col(0) = -q.col(0);
    return q;
}

/// Sums over all particles: mass, momentum, angular momentum about the origin (the affine part included),
/// energy.
template <class Solver>
struct Totals
{
    static constexpr int d = Solver::d;
    double mass = 0, kinetic_energy = 0, angular_momentum = 0; ///< about z
    Vector<double, d> momentum = Vector<double, d>::Zero();
    Vector<double, d> centre = Vector<double, d>::Zero();

    explicit Totals(Solver const& solver)
    {
        auto const x = solver.positions();
        auto const v = solver.template download<Velocity>();
        auto const m = solver.masses();
        for (std::size_t i = 0; i < x.size(); ++i) {
            Vector<double, d> const u = v[i].template cast<double>();
            mass += m[i];
            momentum += m[i] * u;
            centre += m[i] * x[i];
            kinetic_energy += 0.5 * m[i] * u.squaredNorm();
            angular_momentum += m[i] * (x[i][0] * u[1] - x[i][1] * u[0]);
        }
        centre /= mass;
        if constexpr (Solver::State::template contains<AffineVelocity>)
            add_affine_part(solver.template download<AffineVelocity>(), m, solver.lattice().cell_size);
    }

private:
    /// A particle's affine field carries m D (C_yx - C_xy) and m D |C|^2 / 2, D = h^2 / 4 or h^2 / 3.
    template <class Affine>
    void add_affine_part(Affine const& C, std::vector<double> const& m, double h)
    {
        double D = 0; // a tent's particles have no inertia of their own that is the same everywhere
        if constexpr (HasConstantInertia<typename Solver::kernel>)
            D = h * h / Solver::kernel::inverse_inertia;
        for (std::size_t i = 0; i < m.size(); ++i) {
            angular_momentum += m[i] * D * (double(C[i](1, 0)) - double(C[i](0, 1)));
            kinetic_energy += 0.5 * m[i] * D * C[i].template cast<double>().squaredNorm();
        }
    }
};

/// Everything on the left of a plane.
struct OnTheLeft
{
    double x;

    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const& at) const
    {
        return at[0] < x;
    }
};

} // namespace firn::test

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"
#include "support/tangent.hpp"

#include <firn/models/plasticity/cam_clay.hpp>
#include <firn/models/plasticity/herschel_bulkley.hpp>
#include <firn/models/semi_definite.hpp>
#include <firn/models/varied.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

using namespace firn;
using namespace firn::test;

namespace
{

/// A material with these moduli, and others of the test's.
template <class Model>
Model of_moduli(Model model = {})
{
    model.elasticity = lame<typename Model::Space::Scalar>(1e5, 0.3);
    return model;
}

/// A solid that counts something beside, which is infinite once it is loaded, and no matter for its stress.
struct Overflowing : NeoHookean<Plane>
{
    using State = Fields<DisplacementGradient, EquivalentPlasticStrain>;

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, 2> respond(Particle& state, Matrix<Real, 2> const& L, Real dt) const
    {
        auto const response = NeoHookean<Plane>::template respond<Real>(state, L, dt);
        state[EquivalentPlasticStrain{}] = Real(1) / Real(0);
        return response;
    }
};

/// A product as the symmetric matrix that it is, of the components of dl.
template <class Model>
Eigen::MatrixXd matrix_of_product(Model const& model, Matrix<double, Model::Space::dimension> const& H)
{
    constexpr int d = Model::Space::dimension;
    auto state = Record<double, d, typename Model::State>::at_rest();
    state[DisplacementGradient{}] = H;
    Eigen::MatrixXd all(d * d, d * d);
    for (int c = 0; c < d * d; ++c) {
        Matrix<double, d> one = Matrix<double, d>::Zero();
        one.data()[c] = 1;
        Matrix<double, d> const Q = model.template product<double>(state, one);
        for (int r = 0; r < d * d; ++r) all(r, c) = Q.data()[r];
    }
    return all;
}

/// Compares the product of a solid with that of its SemiDefinite, at rest and in states that soften.
template <class Model>
void check_semi_definite()
{
    constexpr int d = Model::Space::dimension;
    using M = Matrix<double, d>;
    auto const plain = of_moduli<Model>();
    SemiDefinite<Model> const clipped(plain);
    M const stretched = 0.05 * M::Identity(); // its tension resists turning
    Eigen::MatrixXd const both = matrix_of_product(plain, stretched);
    CHECK((matrix_of_product(clipped, stretched) - both).norm() <= 1e-12 * both.norm());
    auto const least = [](Eigen::MatrixXd const& Q) {
        return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (Q + Q.transpose())).eigenvalues()[0] /
               Q.norm();
    };
    std::mt19937 random(3);
    double softest = 0;
    for (int i = 0; i < 20; ++i) {
        M const H = random_matrix<d>(random, 0.35) - 0.2 * M::Identity();
        softest = std::min(softest, least(matrix_of_product(plain, H)));
        auto const Q = matrix_of_product(clipped, H);
        CHECK((Q - Q.transpose()).norm() <= 1e-12 * Q.norm());
        CHECK(least(Q) >= -1e-12);
    }
    CHECK(softest < -1e-3);
}

/// A film of a thick liquid, 0.1 m high, that runs down a slope of 0.5 rad.
struct Film
{
    static constexpr int cells = 16, wide = 8;
    static constexpr double height = 0.1, h = height / cells, nu = 1; ///< [m], [m^2/s]
    static constexpr double slope = 0.5;                              ///< [rad]

    Film()
        : film(lattice(h).periodic(0, wide), liquid()),
          points(box_of_points<2>({0, 0}, {wide * h, height}, h))
    {
        film.add(points, h * h / 4);
    }
    static Fluid<Plane> liquid()
    {
        Fluid<Plane> of;
        of.viscosity = of.density * nu;
        return of;
    }
    void step(double dt)
    {
        film.step(dt, Gravity{{9.81 * std::sin(slope), -9.81 * std::cos(slope), 0}},
                  Obstacle<HalfSpace>{.contact = Contact::sticky()});
    }
    /// The root mean square error of velocities, over that of the surface in the end.
    double error() const
    {
        double const t = film.time(), drive = 9.81 * std::sin(slope) / nu,
                     fastest = drive * height * height / 2;
        auto const v = film.download<Velocity>();
        double squares = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            double exact = 0;
            for (int k = 0; k < 50; ++k) {
                double const wave = (2 * k + 1) * M_PI / (2 * height);
                exact += 2 * drive / (height * std::pow(wave, 3)) * std::sin(wave * points[i].y()) *
                         (1 - std::exp(-nu * wave * wave * t));
            }
            squares += std::pow((v[i].x() - exact) / fastest, 2);
        }
        return std::sqrt(squares / double(points.size()));
    }

    Solver<TestedBackend, Fluid<Plane>, QuadraticBSpline, Mls, Implicit> film;
    std::vector<Eigen::Vector2d> points;
};

} // namespace

TEST_CASE("products of materials that flow are derivatives of the stress while nothing flows")
{
    check_product(of_moduli<MooneyRivlin<Plane>>());
    check_product(of_moduli<MooneyRivlin<Solid>>());
    auto crushed = Record<double, 3, Snow<Solid>::State>::at_rest();
    crushed[PlasticVolumeRatio{}] = 0.9; // hardened
    check_product(of_moduli<Snow<Solid>>(), crushed);
    check_product(of_moduli<Sand<Plane>>());
    check_product(of_moduli<HerschelBulkley<Plane>>());
    check_product(of_moduli<CamClay<Solid>>());
    auto stiff = Record<double, 2, Heterogeneous<Snow<Plane>>::State>::at_rest();
    stiff[Stiffness{}] = 3;
    check_product(of_moduli<Heterogeneous<Snow<Plane>>>(), stiff);
    using Sundry = Varied<Sand<Plane>, OwnShearModulus>;
    auto own = Record<double, 2, Sundry::State>::at_rest();
    own[OwnShearModulus{}] = 2e5;
    check_product(of_moduli<Sundry>(), own);
}

TEST_CASE("a semi-definite product is that of the solid where it stiffens, and never gives energy elsewhere")
{
    check_semi_definite<NeoHookean<Plane>>();
    check_semi_definite<NeoHookean<Solid>>();
    check_semi_definite<SplitNeoHookean<Solid>>();
    check_semi_definite<FixedCorotated<Solid>>();
    check_semi_definite<Sand<Solid>>();
}

// Compression alone, and motion that keeps the volume: the viscous stress is that of the volume before.
TEST_CASE("the product of a fluid is the derivative of pressure and of viscous stress, and symmetric")
{
    using M = Matrix<double, 3>;
    std::mt19937 random(7);
    double const dt = 1e-3;
    for (bool const viscous : {false, true})
        for (int i = 0; i < 20; ++i) {
            Fluid<Solid> fluid;
            if (viscous) fluid.viscosity = 100;
            M one = random_matrix<3>(random, 1), other = random_matrix<3>(random, 1);
            if (viscous)
                for (M* const motion : {&one, &other}) *motion -= M(M::Identity() * (motion->trace() / 3));
            auto before = Record<double, 3, Fluid<Solid>::State>::at_rest();
            before[LogVolumeRatio{}] = -0.02;
            auto const stress = [&](M const& change) {
                auto state = before;
                return fluid.predict<double>(state, M(change / dt), dt).kirchhoff_stress;
            };
            M const Q = fluid.product<double>(before, one, dt);
            constexpr double step = 1e-5;
            M const difference = (stress(step * one) - stress(-step * one)) / (2 * step);
            CHECK((Q - difference).norm() <= 1e-7 * Q.norm());
            M const of_other = fluid.product<double>(before, other, dt);
            CHECK((other.array() * Q.array()).sum() ==
                  Approx((one.array() * of_other.array()).sum()).epsilon(1e-11));
            CHECK((one.array() * Q.array()).sum() >= 0); // it never gives energy
        }
}

// Explicit steps may be h^2 / 4 nu long. Nodes above the surface move along, so the film is thicker to its
// viscosity by a part of a cell: 2 % of its speed at 16 cells, and 1 % at 32.
TEST_CASE("a viscous film gains its speed in implicit steps 10 and 100 times as long as explicit ones")
{
    for (int const times : {10, 100}) {
        CAPTURE(times);
        Film film;
        for (int i = 0; i < 1000 / times; ++i) film.step(times * film.h * film.h / (4 * film.nu));
        CHECK(film.error() <= 0.02);
        if (times == 100) CHECK(film.film.solved().products <= 50);
    }
}

// The stress across is K0 of the weight above as far as it is elastic, and then the weight less the
// difference of principal stresses at yield.
TEST_CASE("a plastic column that settles yields below, and leans on its walls as its yield stress says")
{
    constexpr int cells = 32, wide = 2;
    constexpr double h = 1.0 / cells, weight = 1000 * 9.81, yield = 2000, nu = 0.3;
    VonMises<Plane> clay;
    clay.density = 1000;
    clay.elasticity = lame<double>(1e7, nu);
    clay.yield_stress = yield;
    Solver<TestedBackend, VonMises<Plane>, QuadraticBSpline, Mls, Implicit> column(
        lattice(h), clay, {Mls{}, {.newton = 100}}); // whose systems are those of an elastic one
    column.add(box_of_points<2>({0, 0}, {wide * h, 1}, h), h * h / 4);
    auto const report =
        column.settle(Gravity{}, ReflectingWall{.axis = 0},
                      ReflectingWall{.axis = 0, .node = wide, .side = -1}, ReflectingWall{.axis = 1});
    double const difference = std::sqrt(2.0) * std::sqrt(2.0 / 3) * yield, rest = nu / (1 - nu),
                 from = difference / (1 - rest), elastic = from / weight;
    double const exact = rest * weight * elastic * elastic / 2 + (weight + from) / 2 * (1 - elastic) -
                         difference * (1 - elastic);
    CHECK(report.reactions[0].impulse.x() == Approx(-exact).epsilon(5e-3));
    CHECK(report.reactions[2].impulse.y() == Approx(-weight * wide * h).epsilon(1e-3));
    CHECK(report.load_steps == 1);
    CHECK(report.solve.passes <= 300);
}

// Images lie in the same block of nodes, or in one beside it, in other rows or in other lanes.
TEST_CASE("settle refuses a state that is not finite, and leaves the last good one")
{
    Solver<TestedBackend, Overflowing, QuadraticBSpline, Mls, Implicit> block(lattice(0.1),
                                                                              of_moduli<Overflowing>());
    block.add(box_of_points<2>({0, 0}, {0.3, 0.3}, 0.1), 0.1 * 0.1 / 4);
    auto const before = block.positions();
    auto const error =
        refused([&] { block.settle(Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()}); });
    CHECK(error.where() == std::string("Solver::settle"));
    CHECK(std::string(error.remedy()).find("pass a smaller load") != std::string::npos);
    CHECK(block.positions() == before);
}

TEST_CASE("a column between walls settles in the same way wherever they lie among the grid's blocks")
{
    constexpr int high = 6, wide = 2;
    constexpr double h = 1.0 / high;
    auto const settled = [&](int up, int side_at, int foot_at) {
        Eigen::Vector2d low, size;
        low[1 - up] = side_at * h, low[up] = foot_at * h;
        size[1 - up] = wide * h, size[up] = 1;
        Solver<TestedBackend, NeoHookean<Plane>, CubicBSpline, Mls, Implicit> column(
            lattice(h), of_moduli<NeoHookean<Plane>>());
        column.add(box_of_points<2>(low, low + size, h), h * h / 4);
        Eigen::Vector3d g(0, 0, 0);
        g[up] = -9.81;
        ReflectingWall const side{.axis = 1 - up, .node = side_at}, foot{.axis = up, .node = foot_at},
            other{.axis = 1 - up, .node = side_at + wide, .side = -1};
        auto const report = column.settle(Gravity{g}, side, other, foot);
        CHECK(report.reactions[2].impulse[up] == Approx(-1000 * 9.81 * wide * h).epsilon(1e-3));
        CHECK(report.reactions[0].impulse[1 - up] == Approx(-report.reactions[1].impulse[1 - up]));
        std::vector<double> heights; // above the foot
        for (auto const& x : column.positions()) heights.push_back(x[up] - low[up]);
        std::ranges::sort(heights);
        return heights;
    };
    auto const first = settled(1, 0, 0);
    CHECK(first.back() == Approx(1 - h / 4 - 0.0348553).epsilon(3e-3));
    for (int const up : {0, 1})
        for (int const side_at : {0, 5, 6, 7, 15})
            for (int const foot_at : {0, 6, 7, 14, 15}) {
                CAPTURE(up, side_at, foot_at);
                auto const other = settled(up, side_at, foot_at);
                for (std::size_t i = 0; i < first.size(); ++i)
                    CHECK(other[i] == Approx(first[i]).margin(1e-7));
            }
}

// Nodes beside a wall are found anew where the next call has other walls, or where a state is restored that
// lies elsewhere.
TEST_CASE("implicit steps see where the walls of each call are")
{
    constexpr double h = 0.125;
    using Block = Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Mls, Implicit>;
    ReflectingWall const floor{.axis = 1}, left{.axis = 0}, right{.axis = 0, .node = 8, .side = -1};
    auto const block = [&](int cells_above) {
        Block one(lattice(h), of_moduli<NeoHookean<Plane>>());
        one.add(box_of_points<2>({0, cells_above * h}, {1, 1 + cells_above * h}, h), h * h / 4);
        return one;
    };
    auto const check_same = [&](Block const& once, Block const& afresh) {
        auto const x = once.positions(), y = afresh.positions();
        for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i] - y[i]).norm() < 1e-9);
    };
    auto once = block(0), afresh = block(0);
    once.step(0.01, Gravity{}, floor, left);
    afresh.restore(once.snapshot()); // whose grid has seen no walls
    for (Block* const each : {&once, &afresh}) each->step(0.01, Gravity{}, floor, right);
    check_same(once, afresh);
    // two blocks of nodes above the floor there are as many, of which none has images behind it
    for (int const cells_above : {16, 0, 3}) {
        auto other = block(cells_above);
        once.restore(other.snapshot());
        for (Block* const each : {&once, &other}) each->step(0.01, Gravity{}, floor, left);
        check_same(once, other);
    }
}

// Without coarse grids nothing is kept, so that shows what is saved. 64 directions and their products are
// kept, as vectors of at least 60 numbers.
TEST_CASE("in small scenes the directions of earlier linear systems save products, and rest is the same")
{
    constexpr double h = 0.125;
    struct Settled
    {
        std::vector<Eigen::Vector2d> positions;
        int products;
        std::size_t bytes;
    };
    auto const settled = [&](bool keeps, int wide, bool stiff_inside, auto const&... effects) {
        using Solid = Heterogeneous<NeoHookean<Plane>>;
        Solver<TestedBackend, Solid, CubicBSpline, Mls, Implicit> solver(
            lattice(h), of_moduli<Solid>(), {Mls{}, {.share = 1e-3, .coarse = keeps}});
        solver.add(box_of_points<2>({0, 0}, {wide * h, 1}, h), h * h / 4);
        if (stiff_inside) {
            auto stiffness = solver.template download<Stiffness>();
            auto const x = solver.positions();
            for (std::size_t i = 0; i < x.size(); ++i)
                stiffness[i] = std::abs(x[i].y() - 0.5) < 2 * h && x[i].x() > h ? 100 : 1;
            solver.template upload<Stiffness>(stiffness);
        }
        auto const report = solver.settle(Gravity{}, effects...);
        CHECK(report.solve.converged);
        return Settled{solver.positions(), report.solve.products, solver.memory()};
    };
    auto const compare = [&](double share, int wide, bool stiff_inside, auto const&... effects) {
        CAPTURE(wide, stiff_inside);
        auto const kept = settled(true, wide, stiff_inside, effects...),
                   alone = settled(false, wide, stiff_inside, effects...);
        for (std::size_t i = 0; i < kept.positions.size(); ++i)
            CHECK((kept.positions[i] - alone.positions[i]).norm() < 1e-4);
        if (!TestedBackend::reaches_host_memory) return;
        CHECK(kept.products <= share * alone.products);
        CHECK(kept.bytes >= alone.bytes + 2 * 64 * 60 * sizeof(Plane::Scalar));
    };
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1}, foot{.axis = 1};
    compare(0.7, 2, false, left, right, foot);
    compare(0.7, 2, true, left, right, foot);
    compare(1, 6, false, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.5)}); // which may let go
}

// Beside its two buffers a particle keeps its place, and what a product needs of the state that was tried:
// in general that state, the inverse of A = I + dt L, and a number.
template <template <class> class Model, int in_space, int in_the_plane>
constexpr bool keeps = TrialFields<Model<Solid>>::components(
                           3) == in_space&& TrialFields<Model<Plane>>::components(2) == in_the_plane;
template <class Space>
using HeterogeneousRubber = Heterogeneous<NeoHookean<Space>>;
template <class Space>
using HeterogeneousSnow = Heterogeneous<Snow<Space>>;
template <class Space>
using SemiDefiniteRubber = SemiDefinite<NeoHookean<Space>>;
template <class Space>
using SandOfOwnModuli = Varied<Sand<Space>, OwnShearModulus>;
static_assert(keeps<NeoHookean, 20, 11> && keeps<HeterogeneousRubber, 20, 11>);
static_assert(keeps<FixedCorotated, 22, 11> && keeps<Hencky, 22, 11> && keeps<SplitNeoHookean, 22, 11> &&
              keeps<MooneyRivlin, 22, 11> && keeps<VonMises, 22, 11> && keeps<HerschelBulkley, 22, 11> &&
              keeps<SemiDefiniteRubber, 22, 11>);
static_assert(keeps<Snow, 23, 12> && keeps<HeterogeneousSnow, 23, 12> && keeps<Sand, 23, 12> &&
              keeps<HardeningVonMises, 23, 12> && keeps<CamClay, 23, 12> && keeps<SandOfOwnModuli, 24, 13>);
static_assert(keeps<Fluid, 5, 4>);

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/test_lane.hpp"

#include <firn/concepts.hpp>
#include <firn/core/cell_offset.hpp>
#include <firn/grid/cell_polynomial.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/interpolation/all.hpp>

#include <algorithm>
#include <iterator>
#include <new>
#include <random>
#include <tuple>
#include <type_traits>
#include <utility>

using namespace firn;
using namespace firn::test;

namespace
{

template <class KernelType, class SpaceType>
struct Case
{
    using Kernel = KernelType;
    using Space = SpaceType;
    using Real = typename Space::Scalar;
    static constexpr int d = Space::dimension;
};

/// The sums over a stencil that identities are about, added up in double precision: the weights are what is
/// tested.
template <class Kernel, class Real, int d>
struct Moments
{
    double unity = 0;
    Vector<double, d> first = Vector<double, d>::Zero(), gradient_sum = Vector<double, d>::Zero();
    Matrix<double, d> gradient_moment = Matrix<double, d>::Zero(), inertia = Matrix<double, d>::Zero();

    explicit Moments(Vector<Real, d> const& offset)
    {
        Stencil<Kernel, Real, d> const nodes(offset);
        for (int row = 0; row < nodes.rows; ++row)
            for (int k = 0; k < nodes.width; ++k) {
                Vector<double, d> distance, gradient;
                for (int a = 0; a < nodes.last; ++a) {
                    distance[a] = nodes.row_distance(row, a);
                    gradient[a] = nodes.row_gradient(row, a) * nodes.weight[nodes.last][k];
                }
                distance[nodes.last] = nodes.distance[nodes.last][k];
                gradient[nodes.last] = nodes.row_weight(row) * nodes.derivative[nodes.last][k];
                double const w = nodes.row_weight(row) * nodes.weight[nodes.last][k];
                unity += w;
                first += w * distance;
                gradient_sum += gradient;
                gradient_moment += distance * gradient.transpose();
                inertia += w * distance * distance.transpose();
            }
    }
};

/// Offsets in a cell: random ones, and the faces, centres and their floating-point neighbours.
template <class Real, int d, class Use>
void for_each_offset(int count, Use const& use)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<Real> inside(Real(-0.5), Real(0.5));
    Real const below_half = std::nextafter(Real(0.5), Real(0));
    Real const special[]{Real(-0.5), Real(0), Real(-0.0), below_half, std::nextafter(Real(-0.5), Real(0))};
    for (int i = 0; i < count; ++i) {
        Vector<Real, d> offset;
        for (int a = 0; a < d; ++a) offset[a] = i % 4 == 0 ? special[random() % 5] : inside(random);
        use(offset);
    }
}

} // namespace

/// Each kernel of a list in each space.
template <class Kernels>
struct InEachSpace;
template <class... Kernels>
struct InEachSpace<std::tuple<Kernels...>>
{
    template <class Space>
    using In = std::tuple<Case<Kernels, Space>...>;
    using Type =
        decltype(std::tuple_cat(std::declval<In<Space<2, double>>>(), std::declval<In<Space<3, double>>>(),
                                std::declval<In<Space<2, float>>>(), std::declval<In<Space<3, float>>>()));
};
using Cases = InEachSpace<AllKernels>::Type;

/// Those of a list with continuous derivatives, so that the sum of (dN/dx)^2 / N is bounded.
template <class Kernels>
struct Smooth;
template <class... Kernels>
struct Smooth<std::tuple<Kernels...>>
{
    using Type = decltype(std::tuple_cat(
        std::declval<std::conditional_t<(Kernels::degree > 1), std::tuple<Kernels>, std::tuple<>>>()...));
};
using SmoothKernels = Smooth<AllKernels>::Type;

TEMPLATE_LIST_TEST_CASE("weights sum to one, reproduce positions, and gradients do so for linear fields", "",
                        Cases)
{
    using Real = typename TestType::Real;
    constexpr int d = TestType::d;
    double const tolerance = std::is_same_v<Real, float> ? 5e-7 : 1e-14;
    double worst = 0;
    for_each_offset<Real, d>(100000, [&](Vector<Real, d> const& offset) {
        Moments<typename TestType::Kernel, Real, d> const sums(offset);
        double errors[]{std::abs(double(sums.unity) - 1), double(sums.first.cwiseAbs().maxCoeff()),
                        double(sums.gradient_sum.cwiseAbs().maxCoeff()),
                        double((sums.gradient_moment - Matrix<double, d>::Identity()).cwiseAbs().maxCoeff())};
        for (double error : errors) worst = std::max(worst, error);
        if constexpr (HasConstantInertia<typename TestType::Kernel>) {
            auto const D = Matrix<double, d>::Identity() / TestType::Kernel::inverse_inertia;
            worst = std::max(worst, double((sums.inertia - D).cwiseAbs().maxCoeff()));
        }
    });
    CHECK(worst <= tolerance);
}

TEMPLATE_LIST_TEST_CASE("what particles find by the expansion of their cell is what the weights give", "",
                        Cases)
{
    using Kernel = typename TestType::Kernel;
    using Real = typename TestType::Real;
    constexpr int d = TestType::d;
    using Nodes = Stencil<Kernel, Real, d>;
    constexpr bool has_inertia = HasConstantInertia<Kernel>;
    double const epsilon = std::numeric_limits<Real>::epsilon();

    // Nodes of no pattern, in two channels: the second is read.
    struct
    {
        Real value[Nodes::rows][Nodes::width];
        Real node(int c, int row, int k) const { return c == 7 ? value[row][k] : Real(NAN); }
    } field;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> anywhere(-1, 1), in_cell(-0.5, 0.5);
    for (auto& row : field.value)
        for (auto& value : row) value = Real(anywhere(random));

    CellPolynomial<Kernel, Real, d, 1> expansion;
    double worst = 0;
    expansion.read(field, 7);
    for (int sample = 0; sample < 200; ++sample) {
        Vector<Real, d> offset;
        for (int a = 0; a < d; ++a) offset[a] = Real(in_cell(random));
        Nodes const nodes(offset);
        double value = 0;
        Vector<double, d> affine = Vector<double, d>::Zero(), gradient = affine;
        for (int row = 0; row < Nodes::rows; ++row)
            for (int k = 0; k < Nodes::width; ++k) {
                double const v = field.value[row][k], along = nodes.weight[d - 1][k],
                             w = double(nodes.row_weight(row)) * along;
                value += v * w;
                for (int a = 0; a < d - 1; ++a) {
                    affine[a] += v * w * nodes.row_distance(row, a);
                    gradient[a] += v * nodes.row_gradient(row, a) * along;
                }
                affine[d - 1] += v * w * nodes.distance[d - 1][k];
                gradient[d - 1] += v * nodes.row_weight(row) * nodes.derivative[d - 1][k];
            }
        auto const found = expansion.template at<has_inertia, true>(Monomials<Kernel, Real, d>(offset));
        worst = std::max(worst, std::abs(found.value[0] - value));
        for (int a = 0; a < d; ++a) {
            worst = std::max(worst, std::abs(found.gradient[0][a] - gradient[a]));
            if constexpr (has_inertia)
                worst = std::max(worst, std::abs(found.affine[0][a] - Kernel::inverse_inertia * affine[a]));
        }
    }
    CHECK(worst <= 40 * epsilon);

    for (auto& row : field.value)
        for (auto& value : row) value = Real(0.1);
    expansion.read(field, 7);
    Vector<Real, d> offset = Vector<Real, d>::Constant(Real(0.3));
    auto const found = expansion.template at<has_inertia, true>(Monomials<Kernel, Real, d>(offset));
    CHECK(found.value[0] == Real(0.1)); // exactly: a body in free flight keeps its velocity
    for (int a = 0; a < d; ++a) {
        CHECK(found.gradient[0][a] == 0);
        if constexpr (has_inertia) CHECK(found.affine[0][a] == 0);
    }
}

TEMPLATE_LIST_TEST_CASE("derivatives of weights are those of the weights", "", AllKernels)
{
    double const step = 1e-6;
    for (double t = -0.49; t < 0.49; t += 0.01) {
        auto const left = TestType::weights(t - step), right = TestType::weights(t + step),
                   slope = TestType::derivatives(t);
        for (int i = 0; i <= TestType::degree; ++i)
            CHECK(std::abs((right[i] - left[i]) / (2 * step) - slope[i]) <= 1e-8);
    }
}

TEMPLATE_LIST_TEST_CASE(
    "weights are continuous from one cell to the next, and of splines so are the derivatives", "", AllKernels)
{
    auto const end = TestType::weights(0.5), begin = TestType::weights(-0.5);
    auto const end_slope = TestType::derivatives(0.5), begin_slope = TestType::derivatives(-0.5);
    for (int i = 0; i < TestType::degree; ++i) {
        CHECK(std::abs(end[i + 1] - begin[i]) <= 1e-15);
        if (TestType::degree > 1) CHECK(std::abs(end_slope[i + 1] - begin_slope[i]) <= 1e-15);
    }
    CHECK(std::abs(end[0]) <= 1e-15);
}

TEMPLATE_LIST_TEST_CASE("the gradient bound of a kernel is the largest sum of |dN|^2 / N", "", SmoothKernels)
{
    double largest = 0;
    for (double t = -0.5 + 1e-6; t < 0.5; t += 1e-5) {
        auto const w = TestType::weights(t), dw = TestType::derivatives(t);
        double sum = 0;
        for (int i = 0; i <= TestType::degree; ++i) sum += dw[i] * dw[i] / w[i];
        largest = std::max(largest, sum);
    }
    CHECK(largest <= TestType::gradient_bound);
    CHECK(largest >= 0.999 * TestType::gradient_bound);
}

TEMPLATE_LIST_TEST_CASE("a kernel gives a pack of numbers what it gives each number", "", AllKernels)
{
    using Pack = TestLane<double>;
    STATIC_REQUIRE(InterpolationKernel<TestType, Pack>);
    double const t[]{-0.5, -0.123, 0.0, 0.4999};
    auto const packed = TestType::weights(LaneTraits<Pack>::load(t));
    for (int i = 0; i <= TestType::degree; ++i) {
        double lane[4];
        LaneTraits<Pack>::store(packed[i], lane);
        for (int l = 0; l < 4; ++l) CHECK(std::abs(lane[l] - TestType::weights(t[l])[i]) <= 1e-15);
    }
}

TEST_CASE("a position is found again from its cell and offset, on both sides of the origin and far from it")
{
    auto const grid = lattice(0.1, {0.03, -0.07, 1.0});
    std::mt19937 random(3);
    std::uniform_real_distribution<double> anywhere(-200, 200);
    for (int degree = 1; degree <= 3; ++degree)
        for (int i = 0; i < 2000; ++i) {
            Vector<double, 3> const x{anywhere(random), anywhere(random),
                                      i % 3 == 0 ? 1.0 : anywhere(random)};
            auto const at = locate<3>(grid, degree, x);
            CHECK(at.offset.minCoeff() >= -0.5);
            CHECK(at.offset.maxCoeff() < 0.5);
            CHECK((world_position<3>(grid, degree, at.cell, at.offset) - x).cwiseAbs().maxCoeff() <= 1e-13);
        }
}

TEST_CASE("a lattice made of a cell size alone begins at the origin of the world")
{
    alignas(Lattice) unsigned char memory[sizeof(Lattice)];
    std::fill(std::begin(memory), std::end(memory), static_cast<unsigned char>(0x3f));
    CHECK((new (memory) Lattice{0.1})->origin == Eigen::Vector3d(0, 0, 0));
}

TEST_CASE(
    "an offset that rounding would take to the next cell stays in its own, and goes one further at most")
{
    using Offset = CellOffset<float>;
    auto stored = Offset::from(std::nextafter(0.5, 0.0));
    CHECK(Offset::inside(stored));
    CHECK(Offset::possible(stored));
    CHECK(!Offset::possible(stored + 1));
    stored = Offset::moved(stored, 1);
    CHECK(!Offset::inside(stored));
    CHECK(Offset::wrap(stored) == 1);
    CHECK(Offset::from(-0.5) == -(1 << (Offset::bits - 1)));
    CHECK(Offset::possible(Offset::from(-0.5)));
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"
#include "support/policies.hpp"

#include <firn/io/checkpoint.hpp>
#include <firn/transfer/conduction.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

using namespace firn;
using namespace firn::test;

namespace
{

using WarmMls = Carrying<Mls, Conduction>;
using WarmFlip = Carrying<Flip, Conduction>;
using WarmApic = Carrying<Apic, Conduction>;

template <class Number>
double sum_of_heat(std::vector<double> const& m, std::vector<Number> const& T)
{
    double sum = 0;
    for (std::size_t i = 0; i < T.size(); ++i) sum += m[i] * double(T[i]);
    return sum;
}

/// A block that flies, turns and swings, of temperatures between 0 and 1 that change within some cells.
template <class SceneType>
typename SceneType::Solver flying_block(double diffusivity, typename SceneType::Backend const& backend = {})
{
    constexpr int d = SceneType::d;
    using Number = typename SceneType::Number;
    double const h = 0.05;
    typename SceneType::Solver solver(lattice(h), {}, {{}, {.diffusivity = diffusivity}}, {}, backend);
    auto const points = scattered<d>(
        box_of_points<d>(Vector<double, d>::Constant(0.013), Vector<double, d>::Constant(0.313), h), 0.2 * h);
    solver.add(points, std::pow(h / 2, d));
    std::vector<Vector<Number, d>> velocities;
    std::vector<Number> temperatures;
    for (auto const& x : points) {
        Vector<double, d> v = Vector<double, d>::Constant(1.5);
        v[0] += -4 * (x[1] - 0.15) + std::sin(20 * x[0]);
        v[1] += 4 * (x[0] - 0.15);
        velocities.push_back(v.template cast<Number>());
        temperatures.push_back(Number(0.5 + 0.5 * std::sin(10 * x[0]) * std::cos(12 * x[1])));
    }
    solver.template upload<Velocity>(velocities);
    solver.template upload<Temperature>(temperatures);
    return solver;
}

double const some_diffusivity = 0.05; // [m^2/s]; the block's length squared over it is 2 s

} // namespace

using Blocks = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>,
                            More<Scene<NeoHookean<Plane>, CubicBSpline, WarmApic>>,
                            Scene<NeoHookean<SolidFloat>, QuadraticBSpline, WarmFlip>>;

// On the nodes of one particle alone the flow is m D g . grad w_i, so that its next gradient is -l g, with l
// = dt D sum of |dN/dx|^2 / N along the axis of g.
TEMPLATE_LIST_TEST_CASE(
    "of a particle alone the gradient changes as its kernel says, and not the temperature", "", Blocks)
{
    constexpr int d = TestType::d;
    using Number = typename TestType::Number;
    using Kernel = typename TestType::Kernel;
    double const h = 0.1, D = 2, dt = 1e-3, offset = 0.3; // of the cell
    typename TestType::Solver solver(lattice(h), {}, {{}, {.diffusivity = D}});
    double const centre = Kernel::degree % 2 == 0 ? 0 : 0.5;
    solver.add(std::vector<Vector<double, d>>{Vector<double, d>::Constant(h * (centre + offset))},
               std::pow(h / 2, d));
    Vector<Number, d> g;
    for (int a = 0; a < d; ++a) g[a] = Number(3 + a);
    solver.template upload<Temperature>({Number(7)});
    solver.template upload<TemperatureGradient>({g});
    solver.steps(3, dt);
    auto const weights = Kernel::weights(offset), derivatives = Kernel::derivatives(offset);
    double sum = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) sum += derivatives[i] * derivatives[i] / weights[i];
    double const l = dt * D * sum / (h * h), rounding = TestType::is_float ? 1e-5 : 1e-13;
    CHECK(l > 0.5);
    auto const after = solver.template download<TemperatureGradient>()[0];
    for (int a = 0; a < d; ++a) CHECK(double(after[a]) == Approx(-l * l * l * g[a]).epsilon(100 * rounding));
    CHECK(double(solver.template download<Temperature>()[0]) == Approx(7).epsilon(rounding));
}

TEMPLATE_LIST_TEST_CASE("heat is conserved in a block that flies and turns, and its temperatures even out",
                        "", Blocks)
{
    auto solver = flying_block<TestType>(some_diffusivity);
    auto const start = solver.template download<Temperature>();
    double const heat = sum_of_heat(solver.masses(), start);
    auto const report = solver.advance(0.1);
    CHECK(report.substeps > 20);
    auto const end = solver.template download<Temperature>();
    CHECK(std::abs(sum_of_heat(solver.masses(), end) / heat - 1) <= (TestType::is_float ? 1e-6 : 1e-13));
    auto const contrast = [](auto const& T) {
        auto const [low, high] = std::minmax_element(T.begin(), T.end());
        return *high - *low;
    };
    CHECK(contrast(end) < 0.7 * contrast(start));
}

TEMPLATE_LIST_TEST_CASE("one temperature stays one, and where nothing is conducted each keeps its bits", "",
                        Blocks)
{
    using Number = typename TestType::Number;
    auto solver = flying_block<TestType>(some_diffusivity);
    solver.template upload<Temperature>(std::vector<Number>(solver.size(), Number(293)));
    solver.template upload<TemperatureGradient>(
        std::vector<Vector<Number, TestType::d>>(solver.size(), zeros<Vector<Number, TestType::d>>()));
    solver.advance(0.02);
    double worst = 0;
    for (Number const T : solver.template download<Temperature>())
        worst = std::max(worst, std::abs(double(T) / 293 - 1));
    CHECK(worst <= 100 * double(std::numeric_limits<Number>::epsilon()));

    auto other = flying_block<TestType>(0);
    auto const before = other.template download<Temperature>();
    other.advance(0.02);
    CHECK(other.template download<Temperature>() == before);
}

// Of particles that do not move nothing is left of a transfer but the weights of its kernel. XPIC reads and
// writes nodes once more for each of its passes, and ASFLIP moves particles otherwise than the grid.
using Carriers = std::tuple<Xpic, Asflip, Tpic>;

TEMPLATE_LIST_TEST_CASE("heat is conducted alike whatever transfer carries it, and conserved", "", Carriers)
{
    using Warm = Scene<NeoHookean<Plane>, QuadraticBSpline, Carrying<TestType, Conduction>>;
    using Other = Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>;
    auto still = flying_block<Warm>(some_diffusivity);
    auto other = flying_block<Other>(some_diffusivity);
    std::vector<Vector<double, 2>> const at_rest(still.size(), Vector<double, 2>::Zero());
    still.template upload<Velocity>(at_rest);
    other.template upload<Velocity>(at_rest);
    auto const before = other.template download<Temperature>();
    still.steps(20, 2e-4);
    other.steps(20, 2e-4);
    auto const one = still.template download<Temperature>(), two = other.template download<Temperature>();
    double apart = 0, changed = 0;
    for (std::size_t i = 0; i < one.size(); ++i) {
        apart = std::max(apart, std::abs(one[i] - two[i]));
        changed = std::max(changed, std::abs(two[i] - before[i]));
    }
    CHECK(changed > 0.01);
    CHECK(apart <= 1e-13);

    auto flying = flying_block<Warm>(some_diffusivity);
    double const heat = sum_of_heat(flying.masses(), flying.template download<Temperature>());
    flying.advance(0.1);
    auto const end = flying.template download<Temperature>();
    CHECK(std::abs(sum_of_heat(flying.masses(), end) / heat - 1) <= 1e-13);
}

namespace arrows_at_nodes // nvcc warns of what concepts alone refer to in a namespace without a name
{

// A vector that is carried, and diffuses as heat does.
struct Arrow
{
    static constexpr auto name = "arrow";
    static constexpr auto shape = FieldShape::vector;
};
struct ArrowGradient
{
    static constexpr auto name = "arrow_gradient";
    static constexpr auto shape = FieldShape::matrix;
};
struct NodeArrow
{
    static constexpr auto name = "node_arrow";
    static constexpr auto shape = FieldShape::vector;
};
struct NodeArrowFlow
{
    static constexpr auto name = "node_arrow_flow";
    static constexpr auto shape = FieldShape::vector;
};

struct Arrows
{
    static constexpr auto name = "arrows";
    using State = Fields<Arrow, ArrowGradient>;
    using Stored = Fields<Arrow>;
    using ScatteredTerms = Fields<NodeArrow, GradientTerm<NodeArrowFlow>>;
    using NodeFields = Fields<NodeArrow, NodeArrowFlow>;
    using GatheredTerms = Fields<GradientTerm<NodeArrow>, NodeArrowFlow>;

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real cell_size, Terms& terms) const
    {
        terms[NodeArrow{}] = particle[Arrow{}] * mass;
        terms[GradientTerm<NodeArrowFlow>{}] = particle[ArrowGradient{}] * (-mass / cell_size);
    }

    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const& sums, Real inverse_mass, Real dt, Values& values) const
    {
        values[NodeArrowFlow{}] = sums[NodeArrowFlow{}] * (inverse_mass * dt);
        values[NodeArrow{}] = sums[NodeArrow{}] * inverse_mass + values[NodeArrowFlow{}];
    }

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle& particle, Terms const& terms, Real inverse_cell_size) const
    {
        particle[Arrow{}] += terms[NodeArrowFlow{}];
        particle[ArrowGradient{}] = terms[GradientTerm<NodeArrow>{}] * inverse_cell_size;
    }
};

} // namespace arrows_at_nodes
using namespace arrows_at_nodes;

TEST_CASE("beside a reflecting wall scalars and vectors are those of a body and its image")
{
    using Both = Scene<NeoHookean<Solid>, QuadraticBSpline, Carrying<Mls, Conduction, Arrows>>;
    double const h = 0.1, dt = 5e-4;
    Both::Solver at_wall(lattice(h), {}, {{}, {.diffusivity = 1}, {}}),
        whole(lattice(h), {}, at_wall.transfer());
    Vector<double, 3> const x(0.03, 0.04, 0.01), other(0.07, 0.01, 0.06), a(1, -2, 3), g(7, 5, -4);
    Matrix<double, 3> G;
    G << 1, 2, 3, 4, 5, 6, 7, 8, 9;
    Matrix<double, 3> const flip = Vector<double, 3>(-1, 1, 1).asDiagonal();
    double const volume = std::pow(h / 2, 3);
    at_wall.add(std::vector{x, other}, volume);
    at_wall.upload<Temperature>({2, -1});
    at_wall.upload<TemperatureGradient>({g, -g});
    at_wall.upload<Arrow>({a, 2 * a});
    at_wall.upload<ArrowGradient>({G, -G});
    Vector<double, 3> const image = flip * x, other_image = flip * other, fa = flip * a, fg = flip * g;
    Matrix<double, 3> const fG = flip * G * flip;
    whole.add(std::vector{x, other, image, other_image}, volume);
    whole.upload<Temperature>({2, -1, 2, -1});
    whole.upload<TemperatureGradient>({g, -g, fg, -fg});
    whole.upload<Arrow>({a, 2 * a, fa, 2 * fa});
    whole.upload<ArrowGradient>({G, -G, fG, -fG});
    at_wall.steps(4, dt, ReflectingWall{.axis = 0});
    whole.steps(4, dt);
    auto const near = [&](auto tag) {
        auto const one = at_wall.download<decltype(tag)>(), all = whole.download<decltype(tag)>();
        for (std::size_t i = 0; i < 2; ++i) {
            double difference = 0, size = 0;
            for_each_component<decltype(tag), 3>(one[i], [&](int c, double value) {
                difference += std::abs(value - component_of<decltype(tag), 3>(all[i], c));
                size += std::abs(value);
            });
            CHECK(size > 0);
            CHECK(difference <= 1e-13 * size);
        }
    };
    near(Temperature{});
    near(TemperatureGradient{});
    near(Arrow{});
    near(ArrowGradient{});
    CHECK(at_wall.download<Temperature>()[0] != 2);
    CHECK((at_wall.download<Arrow>()[0] - a).norm() > 1e-3);
}

namespace
{

/// The largest error of T = cos(pi x) exp(-D pi^2 t) in a bar of length 1 at rest between reflecting walls,
/// when the exponent is -1. Two cells high, so that there are corners.
double error_of_mode(int cells)
{
    using Bar = Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>;
    double const h = 1.0 / cells, D = 0.01, until = 1 / (D * M_PI * M_PI);
    Bar::Model soft;
    soft.elasticity = lame<double>(1e-3, 0);
    soft.density = 1;
    Bar::Solver solver(lattice(h), soft, {{}, {.diffusivity = D}});
    auto const points = box_of_points<2>({0, 0}, {1, 2 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<double> temperatures;
    std::vector<Vector<double, 2>> gradients;
    for (auto const& x : points) {
        temperatures.push_back(std::cos(M_PI * x.x()));
        gradients.emplace_back(-M_PI * std::sin(M_PI * x.x()), 0);
    }
    solver.upload<Temperature>(temperatures);
    solver.upload<TemperatureGradient>(gradients);
    ReflectingWall const below{.axis = 1}, above{.axis = 1, .node = 2, .side = -1}, left{.axis = 0},
        right{.axis = 0, .node = cells, .side = -1};
    auto const steps = std::size_t(std::ceil(20 * until * D / (h * h)));
    solver.steps(steps, until / double(steps), below, above, left, right);
    double worst = 0;
    auto const now = solver.download<Temperature>();
    for (std::size_t i = 0; i < now.size(); ++i)
        worst = std::max(worst, std::abs(now[i] - temperatures[i] * std::exp(-1)));
    CHECK(std::abs(sum_of_heat(solver.masses(), now)) <= 1e-13);
    return worst;
}

} // namespace

// Each pass between particles and nodes takes (k h)^2 / 8 of a mode away, and there are four of them from the
// temperatures to the change that particles gather: the exponent is too small by the share (k h)^2 / 2, which
// at an exponent of 1 is that share of exp(-1). Walls are insulated: the mode is that of no flow at its ends.
TEST_CASE("a mode between reflecting walls decays with D k^2, less (k h)^2 / 2 of that")
{
    double const coarse = error_of_mode(16), fine = error_of_mode(32);
    CAPTURE(coarse, fine);
    auto const expected = [](int cells) { return 0.5 * std::pow(M_PI / cells, 2) * std::exp(-1); };
    CHECK(coarse <= 1.2 * expected(16));
    CHECK(fine <= 1.2 * expected(32));
    CHECK(fine >= 0.5 * expected(32)); // else the reason above is not the reason
    CHECK(std::log2(coarse / fine) >= 1.9);
}

TEST_CASE("conduction bounds the step, and steps of that length are stable")
{
    using Block = Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>;
    double const D = 100;
    auto solver = flying_block<Block>(D);
    solver.upload<Velocity>(std::vector<Vector<double, 2>>(solver.size(), Vector<double, 2>::Zero()));
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(-1, 1);
    std::vector<double> T(solver.size());
    for (double& one : T) one = any(random);
    solver.upload<Temperature>(T);
    double const bound = 0.05 * 0.05 / (QuadraticBSpline::gradient_bound * D);
    auto const report = solver.advance(1000 * bound);
    CHECK(report.usual_limit() == StepLimit::field);
    CHECK(report.largest_dt <= 0.9 * bound);
    CHECK(report.largest_dt > 0.85 * bound);
    auto const squares = [](std::vector<double> const& of) {
        double sum = 0;
        for (double const one : of) sum += one * one;
        return sum;
    };
    CHECK(squares(solver.download<Temperature>()) <= squares(T));
    CHECK(solver.step(2 * bound).beyond_stable);
    solver.steps(200, 6 * bound);
    CHECK(squares(solver.download<Temperature>()) > 100 * squares(T)); // the control
}

#if defined(FIRN_TESTS_ON_OPENMP)
TEST_CASE("temperatures have the same bits with any number of threads")
{
    using Block = Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>;
    std::vector<double> of_one;
    for (int const threads : {1, 2, 3}) {
        auto solver = flying_block<Block>(some_diffusivity, OpenMP{.threads = threads});
        solver.advance(0.02);
        auto const T = solver.download<Temperature>();
        if (threads == 1) of_one = T;
        CHECK(T == of_one);
    }
}
#endif

TEST_CASE("a checkpoint keeps temperatures, and the run that goes on from it is the same")
{
    using Block = Scene<NeoHookean<Plane>, QuadraticBSpline, WarmMls>;
    meshes::Folder const folder;
    auto const path = folder / "warm.firn";
    auto solver = flying_block<Block>(some_diffusivity);
    solver.advance(0.01);
    write_checkpoint(path, solver);
    Block::Solver other(lattice(0.05), {}, {{}, {.diffusivity = some_diffusivity}});
    read_checkpoint(path, other);
    CHECK(other.download<Temperature>() == solver.download<Temperature>());
    CHECK(other.download<TemperatureGradient>() == solver.download<TemperatureGradient>());
    solver.advance(0.01);
    other.advance(0.01);
    CHECK(other.download<Temperature>() == solver.download<Temperature>());
    CHECK(other.positions() == solver.positions());
    Block::Solver colder(lattice(0.05), {}, {{}, {.diffusivity = 0.5 * some_diffusivity}});
    CHECK(solver.snapshot().transfer == "mls, conduction");
    CHECK_THROWS_AS(read_checkpoint(path, colder), Error);
    CHECK_THROWS_AS(Block::Solver(lattice(0.05), {}, {{}, {.diffusivity = -1}}), Error);
}

namespace means_at_nodes
{

// A number that particles keep, and how far it lies below the mean around them.
struct Own
{
    static constexpr auto name = "own";
    static constexpr auto shape = FieldShape::scalar;
};
struct BelowMean
{
    static constexpr auto name = "below_mean";
    static constexpr auto shape = FieldShape::scalar;
};
struct NodeMean
{
    static constexpr auto name = "node_mean";
    static constexpr auto shape = FieldShape::scalar;
};

struct Means
{
    static constexpr auto name = "means";
    using State = Fields<Own, BelowMean>;
    using Stored = Fields<Own>;
    using ScatteredTerms = Fields<NodeMean>;
    using NodeFields = Fields<NodeMean>;
    using GatheredTerms = Fields<NodeMean>;

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real, Terms& terms) const
    {
        terms[NodeMean{}] = particle[Own{}] * mass;
    }

    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const& sums, Real inverse_mass, Real, Values& values) const
    {
        values[NodeMean{}] = sums[NodeMean{}] * inverse_mass;
    }

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle& particle, Terms const& terms, Real) const
    {
        particle[BelowMean{}] = terms[NodeMean{}] - particle[Own{}];
    }
};

} // namespace means_at_nodes
using namespace means_at_nodes;

TEST_CASE("a field that is gathered and depends on one that is stored is the same again when it is asked for")
{
    using Block = Scene<NeoHookean<Plane>, QuadraticBSpline, Carrying<Mls, Means>>;
    auto const run = [](bool caches) {
        Block::Solver solver(lattice(0.05), {}, {{}, {}});
        auto const points = box_of_points<2>({0.01, 0.01}, {0.2, 0.2}, 0.05);
        solver.add(points, 6.25e-4, {1, 0.5});
        std::vector<double> own;
        for (auto const& x : points) own.push_back(1 + std::sin(15 * x[0]) * std::cos(11 * x[1]));
        solver.upload<Own>(own);
        if (caches) solver.quarantine(1); // gathered fields are then cached in every step
        solver.steps(20, 1e-4);
        return solver.download<BelowMean>();
    };
    auto const again = run(false), cached = run(true);
    CHECK(again == cached);
    double most = 0;
    for (double const value : again) most = std::max(most, std::abs(value));
    CHECK(most > 1e-3);
    CHECK(most < 0.9); // what is gathered alone would be as large as the mean, 1
}

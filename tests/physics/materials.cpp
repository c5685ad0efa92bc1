// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/sand_column.hpp"

using namespace firn;
using namespace firn::test;

// Every material in whole scenes.
namespace
{

template <class Model>
Model parameters()
{
    using Space = typename Model::Space;
    if constexpr (std::is_same_v<Model, VonMises<Space>>)
        return materials::clay<Space>();
    else if constexpr (std::is_same_v<Model, HardeningVonMises<Space>>)
        return materials::steel<Space>();
    else if constexpr (std::is_same_v<Model, CamClay<Space>>)
        return materials::wet_snow<Space>();
    else if constexpr (std::is_same_v<Model, HerschelBulkley<Space>>)
        return materials::foam<Space>();
    else if constexpr (std::is_same_v<Model, Fluid<Space>>)
        return materials::honey<Space>(5);
    else
        return {};
}

} // namespace

using Cases = Combinations<
    Scene<Hencky<Plane>, QuadraticBSpline, Tpic>,
    More<Scene<VonMises<Solid>, QuadraticBSpline, Apic>, Scene<Fluid<Solid>, QuadraticBSpline, Mls>,
         Scene<Fluid<PlaneFloat>, QuadraticBSpline, Flip>>,
    Scene<HardeningVonMises<SolidFloat>, QuadraticBSpline, Mls>, Scene<Sand<Solid>, QuadraticBSpline, Tpic>,
    Scene<CamClay<SolidFloat>, CubicBSpline, Mls>, Scene<HerschelBulkley<Plane>, QuadraticBSpline, Apic>>;

TEMPLATE_LIST_TEST_CASE(
    "a body of any material on a floor and a ball keeps mass and momentum, theirs included", "", Cases)
{
    constexpr int d = TestType::d;
    double const h = 0.025, side = 0.2, speed = 4;
    typename TestType::Solver solver(lattice(h), parameters<typename TestType::Model>());
    std::mt19937 random(4);
    std::uniform_real_distribution<double> inside(0, side);
    std::vector<Vector<double, d>> points(d == 3 ? 4000 : 800);
    for (auto& x : points)
        for (int a = 0; a < d; ++a) x[a] = inside(random);
    Vector<double, d> velocity = Vector<double, d>::Zero();
    velocity[1] = -speed;
    solver.add(points, std::pow(side, d) / double(points.size()), velocity);
    Obstacle<HalfSpace> const floor{.motion = {.position = {0, -0.001, 0}}};
    Obstacle<Sphere> const ball{
        .shape = {0.08},
        .contact = Contact::coulomb(0.5),
        .motion = {.position = {0.1, -0.04, 0.1}, .velocity = {0.5, 0, 0}, .time = 0}};
    auto const report = solver.advance(60 * h / solver.bounds().wave_speed, Gravity{}, floor, ball);
    Totals const end(solver);
    double const mass = std::pow(side, d) * double(solver.model().density);
    CHECK(std::abs(end.mass / mass - 1) <= (TestType::is_float ? 1e-6 : 1e-13));
    Vector<double, d> expected = Vector<double, d>::Zero();
    expected[1] = -(speed + 9.81 * report.time_of_forces) * mass;
    for (auto const& reaction : report.reactions) expected -= reaction.impulse.template head<d>();
    CHECK((end.momentum - expected).norm() <= (TestType::is_float ? 1e-5 : 1e-12) * speed * mass);
    CHECK(report.reactions[0].impulse.y() < -0.01 * speed * mass); // the floor is pressed down
    CHECK(report.lost == 0);
}

namespace
{

/// Nodes move up and down only: a column of any width then behaves as one between smooth walls.
struct Upright
{
    void validate() const {}

    template <class Number>
    struct Action
    {

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const&,
                                                 Vector<Real, d> const& velocity) const
        {
            Vector<Real, d> upright = Vector<Real, d>::Zero();
            upright[1] = velocity[1];
            return upright;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const&) const
    {
        return {};
    }
};

} // namespace

// The pressure at a reference height Y is rho_0 g (H - Y), whatever the equation of state. The rule for nodes
// at walls leaves an error in the two cells above the floor, so that the mean one falls with the root of the
// cell size.
TEST_CASE("a column of water at rest has the pressure of its weight")
{
    double const H = 1, h = H / 64, g = 9.81;
    using Solver = Scene<Fluid<Plane>, QuadraticBSpline, Mls>::Solver;
    Fluid<Plane> water;
    water.bulk_modulus = 2e5;
    water.parts = false;
    Solver solver(lattice(h), water);
    auto const points = box_of_points<2>({0, 0}, {2 * h, H}, h);
    solver.add(points, h * h / 4);
    Obstacle<HalfSpace> const floor{.contact = Contact::bound_slip()};
    double const period = 4 * H / std::sqrt(2e5 / 1000);
    solver.advance(12 * period, Gravity{}, Damping{1.4 * 2 * M_PI / period}, floor, Upright{});
    auto const log_J = solver.download<LogVolumeRatio>();
    double square = 0, square_above = 0, top = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        double const pressure = 2e5 / 7 * std::expm1(-7 * log_J[i]);
        double const error =
            std::pow(pressure / (1000 * g * H) - (1 - points[i].y()), 2) / double(points.size());
        square += error;
        if (points[i].y() > 4 * h) square_above += error;
    }
    for (auto const& x : solver.positions()) top = std::max(top, x.y());
    CHECK(std::sqrt(square) <= 0.02);
    CHECK(std::sqrt(square_above) <= 0.002);
    CHECK(top + h / 4 == Approx(.97819601).margin(2e-4));
    CHECK(solver.bounds().speed < 1e-6);
}

using Drops =
    Combinations<Scene<Fluid<Plane>, QuadraticBSpline, Mls>,
                 More<Scene<Fluid<Plane>, QuadraticBSpline, Apic>, Scene<Fluid<Solid>, CubicBSpline, Mls>>>;

TEMPLATE_LIST_TEST_CASE("the shear of a viscous drop decays below the stable step, and grows beyond it", "",
                        Drops)
{
    constexpr int d = TestType::d;
    Fluid<typename TestType::Space> honey;
    honey.viscosity = 10;
    honey.bulk_modulus = 1e-3; // so that no wave bounds the step
    double const h = 0.1;
    auto const rate_after = [&](double share, int steps) {
        typename TestType::Solver solver(lattice(h), honey);
        solver.add(std::vector<Vector<double, d>>{Vector<double, d>::Constant(0.033)}, 1e-3);
        Matrix<double, d> C = Matrix<double, d>::Zero();
        C(0, 1) = C(1, 0) = 1e-12;
        solver.template upload<AffineVelocity>({C});
        double const limit = solver.step(1e-9).stable_dt / StepControl{}.wave;
        for (int i = 0; i < steps; ++i) solver.step(share * limit);
        return solver.bounds().deformation_rate / 1e-12;
    };
    CHECK(rate_after(0.95, 400) < 1e-3);
    // APIC's nodes are bounded for the worst place in a cell
    if constexpr (std::is_same_v<typename TestType::Transfer, Mls>) CHECK(rate_after(1.05, 200) > 1e3);
    typename TestType::Solver solver(lattice(h), honey);
    solver.add(std::vector<Vector<double, d>>{Vector<double, d>::Constant(0.033)}, 1e-3);
    CHECK(solver.advance(1.0).usual_limit() == StepLimit::viscosity);
}

TEST_CASE("a viscous fluid that gives afresh gives the viscous stress of its motion, as one that gives while "
          "moving")
{
    using Solver = Scene<Fluid<Plane>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.1;
    auto honey = materials::honey<Plane>(5);
    honey.viscosity = 1000;
    Solver once(lattice(h), honey), afresh(lattice(h), honey), thin(lattice(h), materials::honey<Plane>(5));
    auto const points = ball_of_points<2>({0.013, 0.021}, 0.35, h);
    std::vector<Eigen::Vector2d> velocities;
    for (auto const& x : points) velocities.emplace_back(2 * x.y() - x.x(), x.x() + 3);
    for (auto* const solver : {&once, &afresh, &thin}) {
        solver->add(points, h * h / 4);
        solver->upload<Velocity>(velocities);
    }
    for (int i = 0; i < 40; ++i) {
        for (auto* const solver : {&once, &afresh, &thin}) solver->step(2e-4);
        afresh.upload<Velocity>(afresh.download<Velocity>());
    }
    auto const a = once.positions(), b = afresh.positions(), c = thin.positions();
    double worst = 0, viscous = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        worst = std::max(worst, (a[i] - b[i]).norm());
        viscous = std::max(viscous, (a[i] - c[i]).norm());
    }
    CHECK(viscous > 1e-5);
    CHECK(worst < 1e-13);
}

namespace
{

/// What became of a column of sand of a half width, and a height of so many of them.
struct Pile
{
    double run_out, height; ///< (L - L0) / L0, and over L0
    double creep;           ///< mean way per particle in a tenth of a second, in cells
};

Pile collapse(double aspect)
{
    SandColumn<Scene<Sand<Plane>, QuadraticBSpline, Mls>> column(sample_of(12, 16), 2, {}, {}, {}, aspect);
    double const L0 = column.half_width, h = column.solver.lattice().cell_size;
    column.advance(0);
    auto const before = column.solver.positions();
    column.advance_by(0.1);
    auto const after = column.solver.positions();
    Pile pile{column.run_out(), 0, 0};
    for (std::size_t i = 0; i < after.size(); ++i) {
        pile.height = std::max(pile.height, after[i].y() / L0);
        pile.creep += (after[i] - before[i]).norm() / h / double(after.size());
    }
    return pile;
}

} // namespace

// The fit of Lube et al. 2005 to columns in the plane, on a rough floor: a run-out of 1.2 times the height
// for low ones, growing with its power of 2/3 for high ones.
TEST_CASE("columns of sand run out as Lube's do, and lie then")
{
    auto const low = collapse(1), middle = collapse(2), high = collapse(4);
    CHECK(low.run_out == Approx(1.2).epsilon(0.35));
    CHECK(middle.run_out == Approx(1.9 * std::pow(2, 2.0 / 3)).epsilon(0.35));
    CHECK(high.run_out == Approx(1.9 * std::pow(4, 2.0 / 3)).epsilon(0.35));
    double const power = std::log(high.run_out / middle.run_out) / std::log(2.0);
    CHECK(power > 0.55);
    CHECK(power < 0.95);
    CHECK(low.height > 0.6);
    CHECK(low.height < 1.0);
    for (auto const& pile : {low, middle, high}) CHECK(pile.creep <= 0.1);
}

namespace
{

// Martin & Moyce 1952, a column of base 2.25 in and twice that height: time t sqrt(2 g / L0), front over L0.
// Without viscosity, gate and friction the front runs ahead.
void compare_with_martin_and_moyce(int cells)
{
    double const L0 = 0.05715, H = 2 * L0, g = 9.81, h = L0 / cells;
    double const measured[][2]{{.832, 1.217}, {1.219, 1.474}, {1.997, 2.292}, {2.547, 2.995}, {3.345, 4.134}};
    Scene<Fluid<Plane>, QuadraticBSpline, Apic>::Solver solver(lattice(h),
                                                               materials::water<Plane>(std::sqrt(2 * g * H)));
    solver.add(box_of_points<2>({0, 0}, {L0, H}, h), h * h / 4);
    Obstacle<HalfSpace> const floor{.contact = Contact::slip()};
    Obstacle<HalfSpace> const wall{.shape = {{1, 0, 0}}, .contact = Contact::slip()};
    std::vector<double> place;
    for (auto const& [time, expected] : measured) {
        solver.advance(time * std::sqrt(L0 / (2 * g)) - solver.time(), Gravity{{0, -g, 0}}, floor, wall);
        place.push_back(front(solver.positions()) / L0);
        CHECK(place.back() == Approx(expected).epsilon(0.15));
    }
    CHECK((place[3] - place[1]) / (measured[3][0] - measured[1][0]) == Approx(1.145).epsilon(0.15));
    CHECK(place.back() <
          std::sqrt(2.0) * 2 * std::sqrt(2.0) * measured[4][0] / 2 + 1); // 2 sqrt(g H) is a bound
}

} // namespace

TEST_CASE("the front of a dam break runs as Martin and Moyce measured") { compare_with_martin_and_moyce(16); }
TEST_CASE("the dam break in finer cells", "[.full]") { compare_with_martin_and_moyce(64); }

namespace
{

// Case 7.15 of the validation suite, of particles: the curve that models/snow.cpp has for one element. With s
// = 1 - e, s_E = 1 - 2.5e-2 once it yields: sigma = e^(xi (1 - s / s_E)) s_E (s_E - 1) (2 mu + lambda) / s.
void press_snow(int cells, double tolerance)
{
    double const height = 0.2, h = height / cells, speed = 0.1; // [m], [m/s]
    Scene<Snow<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(h));
    solver.add(box_of_points<2>({0, 0}, {2 * h, height}, h), h * h / 4);
    double plate = height; // where it is [m]
    auto const press = [&](double velocity, double duration) {
        Obstacle<HalfSpace> const pressing{
            .shape = {{0, -1, 0}}, .motion = {.position = {0, plate, 0}, .velocity = {0, -velocity, 0}}};
        plate -= velocity * duration;
        auto const report = solver.advance(duration, ReflectingWall{.axis = 0},
                                           ReflectingWall{.axis = 0, .node = 2, .side = -1},
                                           ReflectingWall{.axis = 1}, pressing);
        return report.reactions[3].impulse.y() / (duration * 2 * h); // [Pa]
    };
    auto const compression = [&] { // as the particles have it: the plate acts on nodes, up to a cell ahead
        auto const H = solver.download<DisplacementGradient>();
        auto const J_P = solver.download<PlasticVolumeRatio>();
        double J = 0;
        for (std::size_t i = 0; i < H.size(); ++i)
            J += (Eigen::Matrix2d::Identity() + H[i]).determinant() * J_P[i] / double(H.size());
        return 1 - J;
    };
    for (int i = 1; i <= 10; ++i) press(speed * i / 10, 0.01); // softly, or waves run through it for long
    auto const [mu, lambda] = solver.model().elasticity;
    for (int i = 0; i < 5; ++i) {
        press(speed, 0.07);
        double const before = compression(), stress = press(speed, 0.02), e = 0.5 * (before + compression());
        double const s = 1 - e, s_E = 1 - 2.5e-2;
        CHECK(e > 0.05);
        CHECK(stress == Approx(-std::exp(10 * (1 - s / s_E)) * s_E * (s_E - 1) * (2 * mu + lambda) / s)
                            .epsilon(tolerance));
    }
}

} // namespace

TEST_CASE("a column of snow between smooth walls resists a plate as confined compression asks for")
{
    press_snow(16, 0.05);
}
TEST_CASE("the column of snow in finer cells", "[.full]") { press_snow(64, 0.01); }

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

// Effects of a user's own, by every hook that there is: what they add to momentum, to rounding, and where.

namespace
{

/// An acceleration that grows along y from nothing at a place, an impulse for every node that holds
/// something, and a change of all velocities: along x, each by a hook of its own.
struct Push
{
    Eigen::Vector3d from{0, 0, 0}; ///< [m]
    double growth = 0;             ///< of the acceleration along y [1/s^2]
    double impulse = 0;            ///< [kg m/s]
    double change = 0;             ///< of velocities [m/s^2]
    double bound = 1e-3;           ///< of accelerations [m/s^2]

    void validate() const {}
    double largest_acceleration() const { return bound; }

    template <class Number>
    struct Action
    {
        Eigen::Vector3d from;
        Number growth, impulse, change;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> acceleration(LanePosition<Real, d> const& place) const
        {
            Vector<Real, d> a = zeros<Vector<Real, d>>();
            a[0] = Real(growth) * place.relative_to(from)[1];
            return a;
        }
        template <Lane Real, int d>
        FIRN_HOST_DEVICE void on_momentum(Vector<Real, d>& momentum, Real mass) const
        {
            momentum[0] += select(mass > Real(0), Real(impulse), Real(0));
        }
        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const& node,
                                                 Vector<Real, d> const& velocity) const
        {
            Vector<Real, d> after = velocity;
            after[0] += Real(change) * node.dt;          // the same change, and
            after[0] += Real(impulse) / node.mass;       // the same impulse, which is infinite
            after[0] -= node.mass / node.mass * Real(0); // or no number where there is no mass
            return after;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const&) const
    {
        return {from, Number(growth), Number(impulse), Number(change)};
    }
};

/// All that is left of a place stands still.
struct Stop
{
    double at; ///< [m]

    void validate() const {}
    double largest_speed() const { return 0; }

    struct Action
    {
        double at;
        Contact contact = Contact::sticky();

        template <Lane Real, int d>
        FIRN_HOST_DEVICE ContactResult<Real, d>
        touch(LanePosition<Real, d> const& place, Vector<Real, d> const& velocity, Contact const& rule) const
        {
            ContactResult<Real, d> touched{};
            touched.arm = place.relative_to({at, 0, 0});
            touched.inside = touched.arm[0] < Real(0);
            touched.depth = touched.surface_speed2 = Real(0);
            touched.normal = touched.surface = zeros<Vector<Real, d>>();
            touched.normal[0] = Real(1);
            Vector<Real, d> const after = rule.after<Real, d>(velocity, touched.normal);
            for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, after[a], velocity[a]);
            return touched;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action over(Interval const&) const
    {
        return {at};
    }
};

/// A few particles near a place, of odd masses, that go along y.
template <class Scene>
typename Scene::Solver drops(Vector<double, Scene::d> const& near, double h)
{
    typename Scene::Solver solver(lattice(h));
    std::vector<Vector<double, Scene::d>> points;
    for (int i = 0; i < 7; ++i) {
        points.push_back(near);
        for (int a = 0; a < Scene::d; ++a) points.back()[a] += h * (0.37 * i * (a + 1) - std::floor(0.3 * i));
    }
    Vector<double, Scene::d> velocity = Vector<double, Scene::d>::Zero();
    velocity[1] = 0.3;
    solver.add(points, 0.7 * std::pow(h, Scene::d), velocity);
    return solver;
}

} // namespace

using Cases = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                           Scene<NeoHookean<Plane>, QuadraticBSpline, Xpic>,
                           Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Flip>>;

TEMPLATE_LIST_TEST_CASE("an acceleration that differs from place to place acts where particles are", "",
                        Cases)
{
    constexpr int d = TestType::d;
    double const h = 0.1, rounding = TestType::is_float ? 1e-5 : 1e-11;
    for (double far : {0.0, 3000.0}) {
        Vector<double, d> near = Vector<double, d>::Constant(far);
        auto solver = drops<TestType>(near, h);
        Push const push{.from = {0, far - 2 * h, 0}, .growth = 5, .change = 3};
        auto const mass = solver.masses();
        double expected = 0, size = 0;
        for (double dt : {1e-4, 1.5e-4, 0.7e-4}) {
            auto const x = solver.positions();
            auto const report = solver.step(dt, push);
            for (std::size_t i = 0; i < x.size(); ++i) { // a linear field is summed exactly
                double const a = push.growth * (x[i].y() - push.from.y()) + push.change;
                expected += mass[i] * a * report.time_of_forces;
                size += std::abs(mass[i] * a * report.time_of_forces);
            }
        }
        Totals const end(solver);
        CHECK(std::abs(end.momentum[0] - expected) <= rounding * size);
        CHECK(std::abs(end.momentum[1] / end.mass - 0.3) <= 0.3 * rounding);
    }
}

TEST_CASE("what effects are told of masses and momenta is in kg")
{
    // One particle in the middle of a cell: each of its nine nodes receives an impulse twice.
    for (double h : {0.1, 1e-4}) {
        Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(h));
        solver.add(std::vector<Eigen::Vector2d>{{0.2 * h, 0.1 * h}}, 0.3 * h * h);
        double const impulse = 1e-6 * h * h; // [kg m/s]
        solver.step(1e-3 * h, Push{.impulse = impulse});
        CHECK(Totals(solver).momentum[0] == Approx(18 * impulse).epsilon(1e-12));
    }
}

TEST_CASE("beside a reflecting wall an effect acts on both halves of the mirrored body alike")
{
    double const h = 0.1, dt = 1e-4;
    auto solver = drops<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>>({0, 0.1 * h}, h);
    auto const x = solver.positions();
    auto const mass = solver.masses();
    Push const push{.growth = 5, .change = 3};
    double expected = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        double const y = x[i].y() / h, middle = std::round(y), t = y - middle;
        REQUIRE(y > 0);
        double const weight[]{0.5 * (0.5 - t) * (0.5 - t), 0.75 - t * t, 0.5 * (0.5 + t) * (0.5 + t)};
        for (int k = 0; k < 3; ++k) // what is behind the wall is as fast as its image
            expected += mass[i] * weight[k] * (push.growth * h * std::abs(middle + k - 1) + push.change) * dt;
    }
    auto const report = solver.step(dt, push, ReflectingWall{});
    CHECK(Totals(solver).momentum[0] == Approx(expected).epsilon(1e-12));
    CHECK(report.reactions.size() == 1);
}

TEST_CASE("contact of a user's own has a reaction")
{
    using Jelly = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    double const h = 0.1;
    auto solver = drops<Jelly>({0, 0}, h);
    auto const start = Totals(solver);
    Stop const stop{0.8 * h};
    auto const report = solver.advance(0.02, Gravity{{-5, 0, 0}}, stop);
    REQUIRE(report.reactions.size() == 1);
    Eigen::Vector2d const expected = start.momentum - report.reactions[0].impulse.head<2>() +
                                     Eigen::Vector2d(-5 * report.time_of_forces * start.mass, 0);
    CHECK(report.reactions[0].impulse.norm() > 0.1 * start.momentum.norm());
    CHECK((Totals(solver).momentum - expected).norm() <= 1e-13 * start.momentum.norm());
    CHECK(std::abs(report.reactions[0].angular_impulse.z()) > 0);
}

TEST_CASE("an effect of a user's own bounds the step, and a bound that is none is refused")
{
    double const h = 0.1;
    auto solver = drops<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>>({0, 0}, h);
    double const longest = solver.step(1e-4, Push{}).stable_dt, short_step = 1e-3 * longest;
    auto const bounded = solver.step(1e-6, Push{.bound = 0.5 * h / (short_step * short_step)});
    CHECK(bounded.stable_dt == Approx(short_step));
    for (double wrong : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        CHECK_THROWS_WITH(solver.step(1e-4, Push{.bound = wrong}),
                          Contains("largest acceleration") && Contains("effect 1 of Solver::step"));
    // of particles so light that numbers are none in kg
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver light(lattice(h));
    light.add(std::vector<Eigen::Vector2d>{{0, 0}}, 1e-300);
    CHECK_THROWS_WITH(light.step(1e-6, Push{}), Contains("kg"));
}

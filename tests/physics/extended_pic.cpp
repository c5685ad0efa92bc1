// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <array>
#include <map>

using namespace firn;
using namespace firn::test;

namespace
{

/// The B-spline of this order and its derivative at a distance of r cells, from its definition.
double spline(int degree, double r)
{
    double const a = std::abs(r);
    if (degree == 2) return a < 0.5 ? 0.75 - a * a : a < 1.5 ? 0.5 * (1.5 - a) * (1.5 - a) : 0;
    return a < 1 ? 2.0 / 3 - a * a + a * a * a / 2 : a < 2 ? std::pow(2 - a, 3) / 6 : 0;
}
double spline_slope(int degree, double r)
{
    double const a = std::abs(r), sign = r < 0 ? -1 : 1;
    if (degree == 2) return sign * (a < 0.5 ? -2 * a : a < 1.5 ? a - 1.5 : 0);
    return sign * (a < 1 ? -2 * a + 1.5 * a * a : a < 2 ? -0.5 * (2 - a) * (2 - a) : 0);
}

/// The same scheme with matrices for S and S+ and a power of one for the filter: S(p, i) = w_i(x_p), and
/// S+ = M^-1 S^T diag(m_p).
template <class SceneType>
struct Reference
{
    static constexpr int d = SceneType::d, degree = SceneType::Kernel::degree;
    using Points = std::vector<Vector<double, d>>;
    using Model = std::conditional_t<d == 2, NeoHookean<Plane>, NeoHookean<Solid>>;
    double h, volume;
    Model model;
    Eigen::VectorXd mass;
    Points x;
    Eigen::MatrixXd v;                ///< one row per particle
    std::vector<Matrix<double, d>> H; ///< F - I

    void step(double dt, int m, Eigen::VectorXd const& gravity)
    {
        std::map<std::array<int, 3>, int> index;
        std::vector<Vector<double, d>> nodes;
        for (auto const& at : x) {
            Eigen::Vector3i count(7, 7, d == 3 ? 7 : 1);
            for (int n = 0; n < count.prod(); ++n) {
                std::array<int, 3> const away{n % 7 - 3, n / 7 % 7 - 3, d == 3 ? n / 49 - 3 : 0};
                std::array<int, 3> key{};
                Vector<double, d> place;
                double w = 1;
                for (int a = 0; a < d; ++a) {
                    key[std::size_t(a)] = int(std::floor(at[a] / h)) + away[std::size_t(a)];
                    place[a] = key[std::size_t(a)];
                    w *= spline(degree, at[a] / h - place[a]);
                }
                if (w > 0 && index.emplace(key, int(nodes.size())).second) nodes.push_back(place);
            }
        }
        auto const particles = Eigen::Index(x.size()), count = Eigen::Index(nodes.size());
        Eigen::MatrixXd S(particles, count);
        std::vector<Eigen::MatrixXd> gradient(d, S);
        for (Eigen::Index p = 0; p < particles; ++p)
            for (Eigen::Index i = 0; i < count; ++i) {
                Vector<double, d> w, dw;
                for (int a = 0; a < d; ++a) {
                    double const r = x[std::size_t(p)][a] / h - nodes[std::size_t(i)][a];
                    w[a] = spline(degree, r);
                    dw[a] = spline_slope(degree, r) / h;
                }
                S(p, i) = w.prod();
                for (int a = 0; a < d; ++a) {
                    Vector<double, d> of_axis = w;
                    of_axis[a] = dw[a];
                    gradient[std::size_t(a)](p, i) = of_axis.prod();
                }
            }
        Eigen::VectorXd const node_mass = S.transpose() * mass;
        Eigen::MatrixXd const S_plus =
            node_mass.cwiseInverse().asDiagonal() * S.transpose() * mass.asDiagonal();
        Eigen::MatrixXd acceleration = Eigen::MatrixXd::Zero(count, d);
        for (Eigen::Index p = 0; p < particles; ++p) {
            Record<double, d, typename Model::State> state;
            state[DisplacementGradient{}] = H[std::size_t(p)];
            Matrix<double, d> const tau =
                model.template respond<double>(state, Matrix<double, d>::Zero(), 0.0).kirchhoff_stress;
            double const V0 = mass[p] / model.density;
            for (int a = 0; a < d; ++a)
                acceleration -=
                    V0 * gradient[std::size_t(a)].row(p).transpose() * tau.row(a); // tau is symmetric
        }
        acceleration = node_mass.cwiseInverse().asDiagonal() * acceleration;
        acceleration.rowwise() += gravity.transpose();

        Eigen::MatrixXd const one = Eigen::MatrixXd::Identity(particles, particles);
        Eigen::MatrixXd lost = one;
        for (int k = 0; k < m; ++k) lost = lost * (one - S * S_plus);
        Eigen::MatrixXd const node_velocity = S_plus * v + dt * acceleration;
        v = (one - lost) * v + dt * S * acceleration;
        Eigen::MatrixXd const way = dt * S * node_velocity;
        for (Eigen::Index p = 0; p < particles; ++p) {
            Matrix<double, d> L;
            for (int a = 0; a < d; ++a)
                L.col(a) = (gradient[std::size_t(a)].row(p) * node_velocity).transpose();
            auto& F = H[std::size_t(p)];
            F += dt * L * (Matrix<double, d>::Identity() + F);
            x[std::size_t(p)] += way.row(p).transpose();
        }
    }
};

/// Random particles that shear, stretch and fly, of two masses.
template <class SceneType>
void compare(int m)
{
    constexpr int d = SceneType::d, count = d == 3 ? 40 : 30, steps = 6;
    using Number = typename SceneType::Number;
    double const h = 0.1, dt = 2e-3;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> inside(0, 2.5 * h), any(-1, 1);
    Reference<SceneType> reference;
    reference.h = h;
    reference.model.elasticity = lame(1e4, 0.3);
    typename SceneType::Model model;
    model.elasticity = lame<Number>(1e4, 0.3);
    typename SceneType::Solver solver(lattice(h), model, Xpic{.order = m});
    reference.mass.resize(count);
    reference.v.resize(count, d);
    std::vector<Vector<Number, d>> velocities;
    std::vector<Matrix<Number, d>> deformations;
    for (int half = 0; half < 2; ++half) {
        double const volume = (1 + 2 * half) * std::pow(h / 3, d);
        typename Reference<SceneType>::Points points(count / 2);
        for (auto& x : points) {
            int const p = int(reference.x.size());
            for (int a = 0; a < d; ++a) {
                x[a] = inside(random);
                velocities.resize(std::size_t(p) + 1);
                velocities.back()[a] = Number(3 + 2 * any(random));
                reference.v(p, a) = double(velocities.back()[a]);
            }
            deformations.push_back((0.05 * random_matrix<d>(random)).template cast<Number>());
            reference.H.push_back(deformations.back().template cast<double>());
            reference.mass[p] = volume * double(model.density);
            reference.x.push_back(x);
        }
        solver.add(points, volume);
    }
    solver.template upload<Velocity>(velocities);
    solver.template upload<DisplacementGradient>(deformations);
    Gravity const gravity{{1, -9.81, d == 3 ? 2.0 : 0.0}};
    double const rounding = SceneType::is_float ? 1e-5 : 1e-13; // and what 6 steps make of it
    for (int i = 0; i < steps; ++i) {
        solver.step(dt, gravity);
        reference.step(dt, m, gravity.acceleration.template head<d>());
        auto const x = solver.positions();
        auto const v = solver.template download<Velocity>();
        double worst_x = 0, worst_v = 0;
        for (int p = 0; p < count; ++p) {
            worst_x = std::max(worst_x, (x[std::size_t(p)] - reference.x[std::size_t(p)]).norm() / h);
            worst_v = std::max(worst_v, (v[std::size_t(p)].template cast<double>() -
                                         Vector<double, d>(reference.v.row(p).transpose()))
                                            .norm());
        }
        CAPTURE(m, i);
        CHECK(worst_x <= rounding);
        CHECK(worst_v <= 5 * rounding);
    }
}

} // namespace

using Schemes = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Xpic>,
                             More<Scene<NeoHookean<PlaneFloat>, CubicBSpline, Xpic>>,
                             Scene<NeoHookean<Solid>, CubicBSpline, Xpic>>;

TEMPLATE_LIST_TEST_CASE("extended PIC takes v to [I - (I - S S+)^m] v + dt S a, by the matrices", "", Schemes)
{
    for (int m : {1, 2, 3, 8}) compare<TestType>(m);
}

namespace
{

/// Two blocks that meet, one upon a floor; some steps.
template <class Solver>
Reaction meet(Solver& solver, int steps)
{
    constexpr int d = Solver::d;
    double const h = 0.05;
    Vector<double, d> low = Vector<double, d>::Constant(0.01), v = Vector<double, d>::Zero();
    v[1] = -2;
    auto const points = scattered<d>(box_of_points<d>(low, low + Vector<double, d>::Constant(0.2), h), 0.004);
    solver.add(points, std::pow(h / 2, d), v);
    low[0] += 0.26;
    v[0] = -3;
    solver.add(box_of_points<d>(low, low + Vector<double, d>::Constant(0.2), h), std::pow(h / 2, d), v);
    Reaction all;
    for (int i = 0; i < steps; ++i)
        all +=
            solver.step(5e-4, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.4)}).reactions[0];
    return all;
}

template <class Transfer, class Space = Plane>
using Jelly = typename Scene<NeoHookean<Space>, QuadraticBSpline, Transfer>::Solver;

} // namespace

TEST_CASE("extended PIC of order 1 is PIC")
{
    Jelly<Xpic> extended(lattice(0.05), {}, Xpic{.order = 1});
    Jelly<Pic> plain(lattice(0.05));
    meet(extended, 100);
    meet(plain, 100);
    auto const x = extended.positions(), y = plain.positions();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - y[i]).norm());
    CHECK(worst <= 1e-13);
}

TEST_CASE("extended PIC keeps momentum: what two bodies have is what they had, gravity and the floor gave")
{
    Jelly<Xpic> solver(lattice(0.05), {}, Xpic{.order = 4});
    auto const received = meet(solver, 200);
    Totals const end(solver);
    double const half = end.mass / 2;
    Eigen::Vector2d const expected = half * Eigen::Vector2d(-3, -4) +
                                     0.1 * end.mass * Eigen::Vector2d(0, -9.81) - received.impulse.head<2>();
    CHECK((end.momentum - expected).norm() <= 1e-12 * end.mass);
    CHECK(received.impulse.norm() > 0.1 * end.mass);
    CHECK(end.kinetic_energy < 0.5 * half * (4 + 13)); // it gains none
}

namespace
{

/// The share of a speed that no node sees, to and fro from particle to particle, that is left after some
/// steps in a bar; and that of a shear that nodes see.
template <class Solver>
std::pair<double, double> left_of_noise(Solver solver, int steps)
{
    double const h = 0.05, speed = 1e-6;
    auto const points = box_of_points<2>({0, 0}, {20 * h, 8 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<Eigen::Vector2d> noise;
    for (auto const& x : points) {
        auto const turn = std::lround(x.x() / h * 2 - 0.5) + std::lround(x.y() / h * 2 - 0.5);
        noise.push_back({turn % 2 == 0 ? speed : -speed, 0});
    }
    auto const run = [&](auto const& v) {
        auto copy = Solver(lattice(h), solver.model(), solver.transfer());
        copy.add(points, h * h / 4);
        copy.template upload<Velocity>(v);
        for (int i = 0; i < steps; ++i) copy.step(1e-6);
        auto const after = copy.template download<Velocity>();
        double share = 0;
        for (std::size_t p = 0; p < v.size(); ++p) share += after[p].dot(v[p]) / double(v.size());
        return share;
    };
    double const noise_left = run(noise) / (speed * speed);
    std::vector<Eigen::Vector2d> shear;
    double square = 0;
    for (auto const& x : points) {
        shear.push_back({0, speed * std::sin(2 * M_PI * x.x() / (20 * h))});
        square += shear.back().squaredNorm() / double(points.size());
    }
    return {noise_left, run(shear) / square};
}

} // namespace

TEST_CASE("extended PIC damps what no node sees at once, FLIP never, and what nodes see far less than PIC")
{
    auto const [flip, flip_shear] = left_of_noise(Jelly<Flip>(lattice(0.05), {}, Flip{.fraction = 1}), 100);
    CHECK(flip > 0.98);
    CHECK(flip <= 1.01);
    auto const [pic, pic_shear] = left_of_noise(Jelly<Pic>(lattice(0.05)), 100);
    double before = pic_shear;
    for (int m : {2, 5, 20}) {
        auto const [noise, shear] = left_of_noise(Jelly<Xpic>(lattice(0.05), {}, Xpic{.order = m}), 100);
        CAPTURE(m, noise, shear, flip_shear, pic_shear);
        CHECK(std::abs(noise) < 0.1);
        CHECK(shear > before); // the higher the order, the nearer to FLIP
        CHECK(shear < flip_shear + 1e-6);
        before = shear;
    }
    CHECK(pic_shear < 0.9 * before);
}

TEST_CASE("two materials that are the same move as one by extended PIC, too")
{
    double const h = 0.05;
    firn::Solver<TestedBackend, Materials<NeoHookean<Plane>, NeoHookean<Plane>>, QuadraticBSpline, Xpic> two(
        lattice(h), {}, Xpic{.order = 3});
    Jelly<Xpic> one(lattice(h), {}, Xpic{.order = 3});
    std::vector<Eigen::Vector2d> even, odd;
    for (auto const& x : ball_of_points<2>({0.213, 0.213}, 0.2, h))
        (even.size() > odd.size() ? odd : even).push_back(x);
    one.add(even, h * h / 4, {0, -2});
    one.add(odd, h * h / 4, {0, -2});
    two.add<Material<0>>(even, h * h / 4, {0, -2});
    two.add<Material<1>>(odd, h * h / 4, {0, -2});
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
    for (int i = 0; i < 100; ++i) one.step(5e-4, Gravity{}, floor), two.step(5e-4, Gravity{}, floor);
    auto const x = one.positions(), y = two.positions();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - y[i]).norm());
    CHECK(worst <= 1e-12);
}

TEST_CASE("extended PIC repeats steps that go wrong, and after a failed step particles have what they gave")
{
    using Block = Jelly<Xpic>;
    Gravity const none{
        Eigen::Vector3d::Zero()}; // the same types of effects as elsewhere: each set takes time to compile
    double const speed = 60, mass = 0.09 * 1000;
    auto const hurled = [&](int retries) {
        Block solver(lattice(0.05), {}, Xpic{.order = 3},
                     {.deformation = 0.09, .rejection = 0.1, .retries = retries});
        solver.add(box_of_points<2>({0, 0.1}, {0.3, 0.4}, 0.05), 0.025 * 0.025, {0, -speed});
        return solver;
    };
    auto repeating = hurled(12);
    auto const report = repeating.advance(0.01, none, Obstacle<HalfSpace>{});
    CHECK(report.rejected > 0);
    double const expected = -speed * mass - report.reactions[0].impulse.y();
    CHECK(std::abs(Totals(repeating).momentum.y() - expected) < 1e-10 * speed * mass);

    auto ending = hurled(0);
    CHECK_THROWS_AS(ending.advance(0.02, none, Obstacle<HalfSpace>{}), Error);
    CHECK(ending.time() > 0);
    auto const before = Totals(ending);
    CHECK(before.momentum.y() < 0);
    CHECK(before.kinetic_energy < 0.5 * mass * speed * speed);
    ending.step(1e-6);
    CHECK((Totals(ending).momentum - before.momentum).norm() < 1e-12 * before.momentum.norm());
}

TEST_CASE("with extended PIC, too, a particle that fails is taken out, and all others are as if it had been "
          "removed")
{
    Jelly<Xpic> isolates(lattice(0.05), {}, Xpic{.order = 3}), removes(lattice(0.05), {}, Xpic{.order = 3});
    isolates.quarantine(1);
    auto const same = [&] {
        return isolates.ids() == removes.ids() && isolates.positions() == removes.positions() &&
               isolates.download<Velocity>() == removes.download<Velocity>() &&
               isolates.download<DisplacementGradient>() == removes.download<DisplacementGradient>();
    };
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
    for (auto* of : {&isolates, &removes}) {
        meet(*of, 20);
        auto H = of->download<DisplacementGradient>();
        H[20](1, 1) = -1.5; // det F = -0.5
        of->upload<DisplacementGradient>(H);
    }
    CHECK(same());
    Eigen::Vector2d const there = removes.positions()[20];
    CHECK(removes.remove_if(
              Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {there.x(), there.y(), 0}}}) == 1);
    auto const isolated = isolates.step(5e-4, Gravity{}, floor).isolated;
    removes.step(5e-4, Gravity{}, floor);
    REQUIRE(isolated.size() == 1);
    CHECK(isolated[0].particle == 20);
    CHECK(same());
    for (auto* of : {&isolates, &removes})
        for (int i = 0; i < 20; ++i) of->step(5e-4, Gravity{}, floor);
    CHECK(same());
}

TEST_CASE("extended PIC stores what PIC does, and refuses an order that is none")
{
    using Extended = Jelly<Xpic, SolidFloat>;
    STATIC_REQUIRE(Extended::state_bytes_per_particle == 52);
    STATIC_REQUIRE(Extended::bytes_per_particle == Jelly<Pic, SolidFloat>::bytes_per_particle);
    CHECK_THROWS_AS(Xpic{.order = 0}.validate(), Error);
    CHECK_THROWS_AS(Jelly<Xpic>(lattice(0.1), {}, Xpic{.order = -1}), Error);
}

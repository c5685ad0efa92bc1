// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <firn/host_copies.hpp>
#include <firn/id_lookup.hpp>

#include <array>
#include <numeric>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// Mass and momentum of the particles of one material.
template <class Which, class Solver>
std::pair<double, Vector<double, Solver::d>> momentum_of(Solver const& solver)
{
    constexpr int d = Solver::d;
    auto const m = solver.template masses<Which>();
    auto const v = solver.template download<Velocity, Which>();
    double mass = 0;
    Vector<double, d> momentum = Vector<double, d>::Zero();
    for (std::size_t i = 0; i < m.size(); ++i) {
        mass += m[i];
        momentum += m[i] * v[i].template cast<double>();
    }
    return {mass, momentum};
}

/// A soft solid that is as heavy as asked.
template <class Model>
Model solid(double density, double young = 1e5)
{
    Model model;
    model.density = static_cast<typename Model::Number>(density);
    model.elasticity = lame<typename Model::Number>(young, 0.3);
    return model;
}

using First = Material<0>;
using Second = Material<1>;

} // namespace

using Pairs = Combinations<
    Scene<Materials<VonMises<Plane>, HerschelBulkley<Plane>>, QuadraticBSpline, Mls>,
    Scene<Materials<VonMises<Solid>, HardeningVonMises<Solid>>, CubicBSpline, Flip>,
    More<Scene<Materials<NeoHookean<Plane>, FixedCorotated<Plane>>, CubicBSpline, Apic>,
         Scene<Materials<NeoHookean<Plane>, Hencky<Plane>>, QuadraticBSpline, Pic>,
         Scene<Materials<NeoHookean<SolidFloat>, FixedCorotated<SolidFloat>>, QuadraticBSpline, Mls>>>;

TEMPLATE_LIST_TEST_CASE("what one body gains in a collision of two materials the other loses, and their "
                        "centre of mass flies on",
                        "", Pairs)
{
    constexpr int d = TestType::d;
    using Solver = typename TestType::Solver;
    using A = typename Solver::template MaterialTraits<First>::Model;
    using B = typename Solver::template MaterialTraits<Second>::Model;
    double const h = 0.05, volume = std::pow(h / 2, d);
    Solver solver(lattice(h), {solid<A>(1000), solid<B>(3000)});
    Vector<double, d> low = Vector<double, d>::Constant(0.01), high = low, v = Vector<double, d>::Zero(),
                      w = v;
    high += Vector<double, d>::Constant(0.2);
    Vector<double, d> shift = Vector<double, d>::Zero(); // B hits A beside its middle
    shift[0] = 0.3;
    shift[1] = 0.1;
    v[0] = 2;
    w[0] = -1;
    auto const a = box_of_points<d>(low, high, h), b = box_of_points<d>(low + shift, high + shift, h);
    solver.template add<First>(a, volume, v);
    solver.template add<Second>(b, volume, w);
    auto const [mass_a, before_a] = momentum_of<First>(solver);
    auto const [mass_b, before_b] = momentum_of<Second>(solver);
    CHECK(mass_a == Approx(1000 * volume * double(a.size())));
    CHECK(mass_b == Approx(3000 * volume * double(b.size())));
    Vector<double, d> const total = mass_a * v + mass_b * w, start = Totals(solver).centre;
    double const size = mass_a * v.norm(), rounding = TestType::is_float ? 2e-6 : 1e-13;

    solver.advance(0.1);
    auto const after_a = momentum_of<First>(solver).second, after_b = momentum_of<Second>(solver).second;
    CHECK((after_a - before_a).norm() > 0.5 * size); // they have met
    CHECK((after_a - before_a + after_b - before_b).norm() <= 10 * rounding * size);
    Totals const end(solver);
    CHECK((end.momentum - total).norm() <= 10 * rounding * size);
    CHECK((end.centre - start - 0.1 * total / (mass_a + mass_b)).norm() <= rounding);
    CHECK(momentum_of<First>(solver).first == mass_a);
    CHECK(momentum_of<Second>(solver).first == mass_b);
}

using Halves = Combinations<
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
    More<Scene<FixedCorotated<Solid>, CubicBSpline, Flip>, Scene<Fluid<Plane>, QuadraticBSpline, Asflip>,
         Scene<Snow<PlaneFloat>, CubicBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE(
    "a body whose halves are two materials that are the same moves as one of that material", "", Halves)
{
    constexpr int d = TestType::d;
    using Model = typename TestType::Model;
    double const h = 0.05;
    typename TestType::Solver one(lattice(h));
    firn::Solver<TestedBackend, Materials<Model, Model>, typename TestType::Kernel,
                 typename TestType::Transfer>
        two(lattice(h));
    Vector<double, d> const middle = Vector<double, d>::Constant(0.213);
    std::vector<Vector<double, d>> even, odd; // particles of both share every cell
    for (auto const& x : ball_of_points<d>(middle, 0.2, h))
        (even.size() > odd.size() ? odd : even).push_back(x);
    Vector<double, d> v = Vector<double, d>::Zero();
    v[1] = -2;
    one.add(even, std::pow(h / 2, d), v);
    one.add(odd, std::pow(h / 2, d), v);
    two.template add<First>(even, std::pow(h / 2, d), v);
    CHECK(two.template add<Second>(odd, std::pow(h / 2, d), v) == even.size());
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
    double const mass = Totals(one).mass;
    for (int i = 0; i < 100; ++i) {
        auto const a = one.step(5e-4, Gravity{}, floor), b = two.step(5e-4, Gravity{}, floor);
        CHECK(b.stable_dt == Approx(a.stable_dt).epsilon(TestType::is_float ? 1e-3 : 1e-9));
        CHECK((a.reactions[0].impulse - b.reactions[0].impulse).norm() <=
              (TestType::is_float ? 1e-6 : 1e-12) * mass);
    }
    Totals const a(one);
    Totals const b(two);
    double const rounding = TestType::is_float ? 1e-4 : 1e-11;
    CHECK(b.mass == Approx(a.mass).epsilon(1e-15));
    CHECK((a.centre - b.centre).norm() <= rounding * 0.2);
    CHECK((a.momentum - b.momentum).norm() <= rounding * a.mass);
    CHECK(std::abs(a.kinetic_energy - b.kinetic_energy) <= rounding * a.kinetic_energy);
    auto const x = one.positions(), y = two.positions();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - y[i]).norm());
    CHECK(worst <= rounding * h);
}

using Alone = Combinations<
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
    More<Scene<FixedCorotated<Solid>, CubicBSpline, Flip>, Scene<Snow<PlaneFloat>, CubicBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE("a material that has no particles changes not a bit", "", Alone)
{
    constexpr int d = TestType::d;
    using Model = typename TestType::Model;
    double const h = 0.05;
    auto const run = [&](auto solver, auto which) {
        using Which = decltype(which);
        Vector<double, d> v = Vector<double, d>::Zero();
        v[1] = -2;
        solver.template add<Which>(ball_of_points<d>(Vector<double, d>::Constant(0.213), 0.2, h),
                                   std::pow(h / 2, d), v);
        Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
        for (int i = 0; i < 30; ++i) solver.step(5e-4, Gravity{}, floor);
        solver.advance(0.02, Gravity{}, floor);
        return std::tuple{solver.time(), solver.positions(), solver.template download<Velocity>()};
    };
    using Kernel = typename TestType::Kernel;
    using Transfer = typename TestType::Transfer;
    auto const alone = run(typename TestType::Solver(lattice(h)), EveryMaterial{});
    CHECK((run(firn::Solver<TestedBackend, Materials<Model, Sand<typename Model::Space>>, Kernel, Transfer>(
                   lattice(h)),
               First{}) == alone));
    CHECK((run(firn::Solver<TestedBackend, Materials<Sand<typename Model::Space>, Model>, Kernel, Transfer>(
                   lattice(h)),
               Second{}) == alone));
}

TEST_CASE("the step that is stable is the smallest of those of all materials")
{
    auto const stable = [](auto const& solid_model, auto const& fluid_model, bool with_solid, bool with_fluid,
                           auto order) {
        using S = std::decay_t<decltype(solid_model)>;
        using F = std::decay_t<decltype(fluid_model)>;
        std::vector<Eigen::Vector2d> const points{{0.1, 0.1}, {0.3, 0.2}};
        auto const first_step = [&](auto solver) {
            if (with_solid) solver.template add<S>(points, 1e-3);
            if (with_fluid) solver.template add<F>(points, 1e-3);
            return solver.step(1e-6).stable_dt;
        };
        if constexpr (decltype(order)::value)
            return first_step(
                firn::Solver<TestedBackend, Materials<S, F>>(lattice(0.1), {solid_model, fluid_model}));
        else
            return first_step(
                firn::Solver<TestedBackend, Materials<F, S>>(lattice(0.1), {fluid_model, solid_model}));
    };
    Fluid<Plane> thin, thick;
    thick.viscosity = 300;
    thick.bulk_modulus = 1e3; // its wave alone would allow a step seven times as long
    auto const check = [&](auto const& a, auto const& b, auto order) {
        double const both = stable(a, b, true, true, order), only_a = stable(a, b, true, false, order),
                     only_b = stable(a, b, false, true, order);
        CHECK(both == std::min(only_a, only_b));
        CHECK(only_a != only_b);
    };
    for (double young : {1e4, 1e7}) {
        check(solid<NeoHookean<Plane>>(1000, young), thin, std::true_type{});
        check(solid<NeoHookean<Plane>>(1000, young), thin, std::false_type{});
        check(solid<NeoHookean<Plane>>(1000, young), thick, std::true_type{});
        check(solid<NeoHookean<Plane>>(1000, young), thick, std::false_type{});
    }
}

TEST_CASE("ids are permanent and count the particles of all materials; what is told comes in their order")
{
    using Solver = Scene<Materials<Snow<Plane>, Fluid<Plane>>, QuadraticBSpline, Mls>::Solver;
    STATIC_REQUIRE(Solver::MaterialTraits<Snow<Plane>>::state_bytes_per_particle == 8 * (2 + 4 + 1) + 4);
    STATIC_REQUIRE(Solver::MaterialTraits<Fluid<Plane>>::state_bytes_per_particle == 8 * (2 + 1) + 4);
    STATIC_REQUIRE(Solver::State::contains<Velocity> && !Solver::State::contains<DisplacementGradient>);
    using Points = std::vector<Eigen::Vector2d>;
    using Ids = std::vector<std::uint32_t>;
    Solver solver(lattice(0.1));
    CHECK(solver.add<Snow<Plane>>(Points{{0.05, 0}, {0.15, 0}}, 1e-3, {1, 0}) == 0);
    CHECK(solver.add<Fluid<Plane>>(Points{{1.25, 0}}, 2e-3, {2, 0}) == 2);
    CHECK(solver.add<Material<0>>(Points{{0.35, 0}}, 1e-3, {3, 0}) == 3);
    CHECK(solver.add<Material<1>>(Points{}, 1e-3) == 4);
    CHECK(solver.size() == 4);
    CHECK(solver.size<Snow<Plane>>() == 3);
    CHECK(solver.ids() == Ids{0, 1, 2, 3});
    CHECK(solver.ids<Snow<Plane>>() == Ids{0, 1, 3});
    CHECK(solver.ids<Fluid<Plane>>() == Ids{2});
    CHECK(solver.masses() == std::vector<double>{0.4, 0.4, 2, 0.4});
    CHECK(solver.masses<Fluid<Plane>>() == std::vector<double>{2});
    for (int i = 0; i < 3; ++i) {
        auto const x = solver.positions();
        auto const v = solver.download<Velocity>();
        double const t = solver.time(), at[]{0.05, 0.15, 1.25, 0.35};
        if (i == 0)
            for (std::size_t id = 0; id < 4; ++id) CHECK((x[id] - Eigen::Vector2d(at[id], 0)).norm() < 1e-15);
        CHECK((x[2] - Eigen::Vector2d(1.25 + 2 * t, 0)).norm() < 1e-14); // far from the others
        CHECK((v[2] - Eigen::Vector2d(2, 0)).norm() < 1e-12);
        CHECK(solver.positions<Snow<Plane>>()[2] == x[3]);
        CHECK(solver.download<Velocity, Fluid<Plane>>()[0] == v[2]);
        solver.steps(2, 1e-3);
    }
    auto const view = solver.view<LogVolumeRatio, Fluid<Plane>>();
    CHECK(view.count == 1);
    // a material's own fields are its own
    solver.upload<PlasticVolumeRatio, Snow<Plane>>({0.9, 0.8, 0.7});
    CHECK(solver.download<PlasticVolumeRatio, Material<0>>() == std::vector<double>{0.9, 0.8, 0.7});
    IdLookup lookup;
    IdLookup<Snow<Plane>> among_snow;
    CHECK(lookup.index_of(solver, 3) == 3);
    CHECK(among_snow.index_of(solver, 3) == 2); // the fluid's is not among them
    CHECK_FALSE(among_snow.contains(solver, 2));
    CHECK(solver.remove_if<Fluid<Plane>>(Inside<Sphere>{.shape = {10}}) == 1);
    CHECK(solver.ids() == Ids{0, 1, 3});
    CHECK(lookup.index_of(solver, 3) == 2);
    CHECK(solver.add<Fluid<Plane>>(Points{{1.25, 0}}, 2e-3) == 4);
    CHECK(solver.ids<Fluid<Plane>>() == Ids{4});
    CHECK(lookup.indices_of(solver, Ids{4, 0}) == std::vector<std::size_t>{3, 0});
    CHECK_FALSE(lookup.contains(solver, 2));
    std::vector<std::array<double, 2>> places(1);
    download_positions<Fluid<Plane>>(solver, places); // a host's own vectors, of one material and of all
    CHECK(places[0] == std::array{1.25, 0.0});
    places.resize(4);
    download_positions(solver, places);
    for (std::size_t i = 0; i < 4; ++i) CHECK(places[i][0] == solver.positions()[i][0]);
}

TEST_CASE("water on which a lighter block floats presses on the floor by the weight of both")
{
    using Water = Fluid<Plane>;
    using Wood = FixedCorotated<Plane>;
    double const h = 0.05, g = 9.81, width = 1, depth = 0.4, side = 0.2;
    Water water = materials::water<Plane>(3);
    firn::Solver<TestedBackend, Materials<Water, Wood>, QuadraticBSpline, Pic> solver(
        lattice(h), {water, solid<Wood>(500, 2e5)});
    solver.add<Water>(box_of_points<2>({0, 0}, {width, depth}, h), h * h / 4);
    solver.add<Wood>(box_of_points<2>({0.4, depth}, {0.4 + side, depth + side}, h), h * h / 4);
    Obstacle<HalfSpace> const floor{.contact = Contact::slip()};
    Obstacle<HalfSpace> const left{.shape = {{1, 0, 0}}, .contact = Contact::slip()};
    Obstacle<HalfSpace> const right{
        .shape = {{-1, 0, 0}}, .contact = Contact::slip(), .motion = {.position = {width, 0, 0}}};
    solver.advance(2.0, Gravity{}, floor, left, right);
    double const duration = 1, weight = g * (1000 * width * depth + 500 * side * side);
    auto const report = solver.advance(duration, Gravity{}, floor, left, right);
    CHECK(report.reactions[0].impulse.y() / duration == Approx(-weight).epsilon(0.01));
    double bottom = 1;
    for (auto const& x : solver.positions<Wood>()) bottom = std::min(bottom, x.y());
    CHECK(bottom > 0.1); // it has not sunk
}

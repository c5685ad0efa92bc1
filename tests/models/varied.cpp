// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"
#include "support/test_lane.hpp"

#include <firn/assign.hpp>
#include <firn/initial_stress.hpp>
#include <firn/models/varied.hpp>

#include <limits>

using namespace firn;
using namespace firn::test;

namespace
{

// Tags of a user's own.
struct OwnBulkModulus : ParameterOfParticles
{
    static constexpr auto name = "own_bulk_modulus";
    FIRN_HOST_DEVICE static auto& of(auto& model) { return model.bulk_modulus; }
};
struct OwnViscosity : ParameterOfParticles
{
    static constexpr auto name = "own_viscosity";
    FIRN_HOST_DEVICE static auto& of(auto& model) { return model.viscosity; }
};
struct OwnDensity : ParameterOfParticles
{
    static constexpr auto name = "own_density";
    FIRN_HOST_DEVICE static auto& of(auto& model) { return model.density; }
};

/// Two values of a parameter which make a difference.
template <class Model>
struct TwoValues;
template <class Space>
struct TwoValues<VonMises<Space>>
{
    using Tag = OwnYieldStress;
    static constexpr double of[]{1e3, 2e4};
};
template <class Space>
struct TwoValues<Sand<Space>>
{
    using Tag = OwnCone;
    static constexpr double of[]{0.15, 0.4};
};

/// Two blocks a metre apart that hit a slippery floor; those of `which`.
template <class Solver>
void add_blocks(Solver& solver, int which)
{
    constexpr int d = Solver::d;
    double const h = solver.lattice().cell_size;
    for (int block = 0; block < 2; ++block) {
        if ((which >> block & 1) == 0) continue;
        Vector<double, d> low = Vector<double, d>::Zero(), down = low;
        low[0] = block, low[1] = 0.1 * h, down[1] = -4;
        solver.add(box_of_points<d>(low, low + Vector<double, d>::Constant(4 * h), h), std::pow(h / 2, d),
                   down);
    }
}

template <class Solver>
auto fallen(Solver& solver)
{
    Obstacle<HalfSpace> const floor{};
    solver.steps(150, 1e-4, Gravity{}, floor);
    return solver.positions();
}

} // namespace

using Scenes = Combinations<Scene<VonMises<Plane>, QuadraticBSpline, Mls>,
                            More<Scene<Sand<SolidFloat>, QuadraticBSpline, Apic>>>;

TEMPLATE_LIST_TEST_CASE(
    "two bodies of one material with values of their own are two scenes of one value each", "", Scenes)
{
    using Number = typename TestType::Number;
    using Plain = typename TestType::Solver;
    using Two = TwoValues<typename TestType::Model>;
    using Tag = typename Two::Tag;
    using Solver = typename Scene<Varied<typename TestType::Model, Tag>, typename TestType::Kernel,
                                  typename TestType::Transfer>::Solver;
    STATIC_REQUIRE(Solver::state_bytes_per_particle == Plain::state_bytes_per_particle + sizeof(Number));
    STATIC_REQUIRE(!Plain::State::template contains<Tag>);
    double const h = 0.05;
    Solver varied(lattice(h));
    add_blocks(varied, 3);
    auto const half = varied.size() / 2;
    auto values = varied.template download<Tag>();
    CHECK(values.back() == Tag::of(varied.model())); // new particles have the model's
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = Number(Two::of[i < half ? 0 : 1]);
    varied.template upload<Tag>(values);
    auto const x = fallen(varied);
    CHECK((varied.template download<Tag>() == values));
    double worst[2]{0, 0}, apart = 0;
    std::vector<Vector<double, TestType::d>> seen;
    for (int block = 0; block < 2; ++block) {
        typename TestType::Model model;
        Tag::of(model) = Number(Two::of[block]);
        Plain plain(lattice(h), model);
        add_blocks(plain, 1 << block);
        auto const y = fallen(plain);
        for (std::size_t i = 0; i < half; ++i) {
            worst[block] = std::max(worst[block], (x[i + std::size_t(block) * half] - y[i]).norm());
            if (block == 0)
                seen.push_back(y[i]);
            else
                apart = std::max(apart, (y[i] - seen[i] - Vector<double, TestType::d>::Unit(0)).norm());
        }
    }
    for (double const one : worst) CHECK(one <= (TestType::is_float ? 1e-5 : 1e-13));
    CHECK(apart > 1e-3);
}

TEST_CASE("the state of rest of a material whose parameters vary is its model's, in either precision")
{
    std::vector<Eigen::Vector3d> const deep{{0, -1, 0}};
    auto const difference = [&](auto model) {
        using Model = decltype(model);
        return (k0_state(Varied<Model, OwnShearModulus>{model}, deep, {})[0] - k0_state(model, deep, {})[0])
            .norm();
    };
    CHECK(difference(NeoHookean<Solid>{}) <= 1e-12);
    CHECK(difference(NeoHookean<SolidFloat>{}) <= 1e-6);
}

#if !defined(__CUDACC__) // which has no packs
namespace
{

/// Drives lanes whose values differ, one lane at a time and all at once: the largest difference of stress,
/// relative to the wave modulus, and of states.
template <class Model, class... Tags>
double difference_in_lanes(std::vector<std::array<double, sizeof...(Tags)>> const& values)
{
    constexpr int d = Model::Space::dimension;
    using Own = Varied<Model, Tags...>;
    using Lane = TestLane<double>;
    constexpr int width = lane_width<Lane>;
    using State = Record<double, d, typename Own::State>;
    Own const model;
    std::mt19937 random(7);
    double worst = 0;
    for (int round = 0; round < 50; ++round) {
        std::array<State, width> states;
        std::array<Matrix<double, d>, width> rates;
        Record<Lane, d, typename Own::State> lanes;
        Matrix<Lane, d> L;
        for (int lane = 0; lane < width; ++lane) {
            auto& state = states[std::size_t(lane)];
            state = state_of_new<State>(model);
            std::size_t tag = 0;
            auto const& own = values[random() % values.size()];
            ((state[Tags{}] = own[tag++]), ...);
            rates[std::size_t(lane)] = 0.1 * random_matrix<d>(random);
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < d; ++j) L(i, j)[lane] = rates[std::size_t(lane)](i, j);
            std::vector<double> numbers;
            state.for_each([&](int, double& value) { numbers.push_back(value); });
            lanes.for_each([&](int c, Lane& value) { value[lane] = numbers[std::size_t(c)]; });
        }
        auto const all = model.template respond<Lane>(lanes, L, Lane(0.5));
        for (int lane = 0; lane < width; ++lane) {
            auto& state = states[std::size_t(lane)];
            Model own = model;
            ((Tags::of(own) = state[Tags{}]), ...);
            auto const one = own.template respond<double>(state, rates[std::size_t(lane)], 0.5);
            double const scale = one.wave_modulus;
            worst = std::max(worst, std::abs(all.wave_modulus[lane] - scale) / scale);
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < d; ++j)
                    worst = std::max(worst,
                                     std::abs(all.kirchhoff_stress(i, j)[lane] - one.kirchhoff_stress(i, j)) /
                                         scale);
            if (all.capped.value[std::size_t(lane)] != one.capped) worst = 1;
            if (all.inverted.value[std::size_t(lane)] != one.inverted) worst = 1;
            std::vector<double> numbers;
            state.for_each([&](int, double& value) { numbers.push_back(value); });
            lanes.for_each([&](int c, Lane& value) {
                worst = std::max(worst, std::abs(value[lane] - numbers[std::size_t(c)]));
            });
            if constexpr (TellsEnergy<Model, double, State>)
                worst = std::max(worst, std::abs(model.template energy<Lane>(lanes)[lane] -
                                                 own.template energy<double>(state)) /
                                            scale);
        }
    }
    return worst;
}

} // namespace

TEST_CASE("particles of a pack with values of their own are each computed with theirs")
{
    CHECK(difference_in_lanes<VonMises<Plane>, OwnYieldStress>({{1e3}, {2e4}, {1e5}}) <= 1e-12);
    CHECK(difference_in_lanes<Sand<Solid>, OwnCone, OwnCohesion, OwnDilatancy>(
              {{0.2, 0, 0.1}, {0.4, 1e3, 0}, {0.4, 0, 0}, {0, 0, 0}}) <= 1e-12);
    CHECK(difference_in_lanes<NeoHookean<Solid>, OwnShearModulus, OwnLambda>({{1e4, 0}, {1e5, 2e5}}) <=
          1e-12);
    CHECK(difference_in_lanes<CamClay<Plane>, OwnCohesion>({{0}, {0.5}, {2}}) <= 1e-12);
    CHECK(difference_in_lanes<Fluid<Plane>, OwnBulkModulus>({{1e5}, {2e5}, {3e5}}) <= 1e-12);
}
#endif

TEST_CASE("the step is bounded by the stiffest particle, with the least favourable ratio of its moduli")
{
    using Solver =
        Scene<Varied<NeoHookean<Plane>, OwnShearModulus, OwnLambda>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.1;
    Solver solver(lattice(h));
    solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, h), h * h / 4);
    auto const usual = solver.model().elasticity;
    double const c = std::sqrt(usual.p_wave_modulus() / double(solver.model().density));
    CHECK(solver.bounds().wave_speed == Approx(c));
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver plain(lattice(h));
    plain.add(box_of_points<2>({0, 0}, {0.4, 0.4}, h), h * h / 4);
    CHECK(solver.stable_step() <= plain.stable_step());
    double const step = solver.stable_step();
    assign<OwnShearModulus>(solver, std::vector<std::uint32_t>{5}, 4 * usual.mu);
    assign<OwnLambda>(solver, std::vector<std::uint32_t>{5}, 4 * usual.lambda);
    CHECK(solver.bounds().wave_speed == Approx(2 * c));
    CHECK(solver.stable_step() == Approx(step / 2));
    solver.advance(0.01, Gravity{});
    CHECK(solver.bounds().wave_speed == Approx(2 * c).epsilon(1e-3));
    // the state at rest is that of the model's own values
    auto const H = k0_state(solver.model(), solver.positions(), {.surface = 0.4});
    auto const same = k0_state(plain.model(), solver.positions(), {.surface = 0.4});
    CHECK((H == same));
}

TEST_CASE("values with which no model would be made are refused by the particle, and so is a varied density")
{
    using Number = double;
    double const nan = std::numeric_limits<double>::quiet_NaN();
    using Grains = Varied<Sand<Plane>, OwnCone, OwnDilatancy>;
    Scene<Grains, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    solver.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.1), 0.0025);
    auto const before = solver.download<OwnCone>();
    for (double const wrong : {-0.1, nan, std::numeric_limits<double>::infinity()}) {
        auto values = before;
        values[3] = Number(wrong);
        auto const error = refused([&] { solver.upload<OwnCone>(values); });
        CHECK(error.where().find("value 3") != std::string::npos);
    }
    auto const opens = refused([&] { assign<OwnDilatancy>(solver, std::vector<std::uint32_t>{7}, 0.9); });
    CHECK(opens.what_is_wrong() == "the slope of the dilatancy is not between 0 and that of the cone");
    CHECK(opens.where().find("particle 7") != std::string::npos);
    CHECK((solver.download<OwnCone>() == before));
    // a snapshot with a nonsense value
    auto snapshot = solver.snapshot();
    for (auto& field : snapshot.materials[0].fields)
        if (field.name == OwnDilatancy::name) field.components[0][2] = 2;
    refused([&] { solver.restore(snapshot); });

    CHECK(refused([] { Varied<Sand<Plane>, OwnDensity>{}.validate(); }).what_is_wrong() ==
          "the density of particles is not varied");
    // the model's viscosity bounds steps, so none is above it
    using Water = Varied<Fluid<Plane>, OwnViscosity>;
    Water water;
    water.viscosity = 1;
    auto state = state_of_new<Record<double, 2, Water::State>>(water);
    CHECK(water.objection(state).empty());
    state[OwnViscosity{}] = 0.5;
    CHECK(water.objection(state).empty());
    state[OwnViscosity{}] = 1.5;
    CHECK(water.objection(state) == "a viscosity is above the model's, which bounds the time step");
}

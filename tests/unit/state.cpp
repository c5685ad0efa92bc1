// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "unit/bytes_of_materials.hpp"

#include <cmath>

using namespace firn;
using namespace firn::test;

TEST_CASE("a particle stores what the next step asks for, and nothing else")
{
    // position 3, id 1; H 9, (J_P 1), and the velocity 3 where the scheme keeps a part of it
    STATIC_REQUIRE(state<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Pic>> == 4 * (3 + 1 + 9));
    STATIC_REQUIRE(state<Scene<Snow<SolidFloat>, CubicBSpline, Flip>> == 4 * (3 + 1 + 3 + 9 + 1));
    STATIC_REQUIRE(state<Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Mls>> == 4 * (3 + 1 + 9));
    STATIC_REQUIRE(state<Scene<Snow<SolidFloat>, QuadraticBSpline, Apic>> == 4 * (3 + 1 + 9 + 1));
    STATIC_REQUIRE(state<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Tpic>> == 4 * (3 + 1 + 9));
    STATIC_REQUIRE(state<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Asflip>> == 4 * (3 + 1 + 3 + 9));
    // in two dimensions: position 2; velocity 2, H 4, J_P 1; the id has four bytes
    STATIC_REQUIRE(state<Scene<Snow<PlaneFloat>, CubicBSpline, Flip>> == 4 * (2 + 1 + 2 + 4 + 1));
    STATIC_REQUIRE(state<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>> == 8 * (2 + 4) + 4);
}

using Stores = std::tuple<Scene<Snow<SolidFloat>, CubicBSpline, Flip>,
                          Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>>;

TEMPLATE_LIST_TEST_CASE(
    "resident bytes are two buffers of the state and the order of cells, and memory keeps to them", "",
    Stores)
{
    using Solver = typename TestType::Solver;
    STATIC_REQUIRE(Solver::bytes_per_particle == 2 * state<TestType> + 8);
    Solver solver(lattice(0.01));
    solver.add(box_of_points<3>({0, 0, 0}, {0.2, 0.2, 0.2}, 0.01), 1.25e-7);
    solver.step(1e-5);
    double const per_particle = double(solver.memory()) / double(solver.size());
    CHECK(per_particle >= Solver::bytes_per_particle);
    CHECK(per_particle <= 1.2 * Solver::bytes_per_particle + 60); // 60: the grid, at eight particles per cell
}

TEST_CASE("fields are joined once each, and found where they lie")
{
    using Both =
        Join<Fields<Velocity, DisplacementGradient>, Fields<DisplacementGradient, PlasticVolumeRatio>>;
    STATIC_REQUIRE(std::is_same_v<Both, Fields<Velocity, DisplacementGradient, PlasticVolumeRatio>>);
    STATIC_REQUIRE(Both::components(3) == 13);
    STATIC_REQUIRE(Both::first_component<PlasticVolumeRatio>(2) == 6);
    STATIC_REQUIRE(std::is_same_v<Join<>, Fields<>>);
}

TEST_CASE("what is uploaded is what is downloaded, beyond the yield surface too")
{
    Scene<Snow<SolidFloat>, CubicBSpline, Flip>::Solver solver(lattice(0.1));
    solver.add(box_of_points<3>({0, 0, 0}, {0.2, 0.2, 0.2}, 0.1), 1.25e-4);
    std::vector<Matrix<float, 3>> H(solver.size());
    for (std::size_t i = 0; i < H.size(); ++i) H[i] = Eigen::Vector3f{-0.1f, 0.f, 0.001f * i}.asDiagonal();
    solver.upload<DisplacementGradient>(H);
    CHECK(solver.download<DisplacementGradient>() == H);
    CHECK(solver.download<PlasticVolumeRatio>() == std::vector<float>(H.size(), 1.f));
}

// The step after the last one of a call is planned before the next call says when it ends.
TEST_CASE("a step that was planned to end a rounding before a call does ends where the call ends")
{
    for (double const begin : {0.05, 0.055}) {
        firn::TimeStepController<1> controller;
        controller.cell_size = 1;
        controller.duration = 0.005;
        controller.end = begin + controller.duration;
        for (double const planned : {std::nextafter(controller.end, 0), controller.end}) {
            firn::TimeState state;
            state.time = begin;
            state.scattered = {{begin, planned}, firn::StepLimit::duration, controller.duration};
            CHECK(controller.choose(state) == (planned == controller.end));
            CHECK(state.now.interval.end == controller.end);
        }
    }
}

// SPDX-License-Identifier: MIT
// Compiled by budget.sh, never run: what the compiler says of these loops is the test.
#include <firn/cuda.hpp>
#include <firn/firn.hpp>

using namespace firn;
using Solid = Space<3, float>;

template <class Model, class Kernel, class Transfer, class... Effects>
void step(Effects const&... effects)
{
    Solver<Cuda, Model, Kernel, Transfer> solver(lattice(0.1));
    solver.template add<Material<0>>(std::vector<Vector<double, Model::Space::dimension>>(), 1e-4);
    solver.advance(0.1, effects...);
}

// Each transfer, and more materials, shapes and precisions: most of what nvcc would take.
#if defined(FIRN_TESTS_ALL)
void more()
{
    Obstacle<HalfSpace> const floor;
    step<NeoHookean<Solid>, QuadraticBSpline, Mls>();
    step<NeoHookean<Solid>, QuadraticBSpline, Apic>(Gravity{}, floor);
    step<NeoHookean<Space<3, double>>, QuadraticBSpline, Mls>(Gravity{}, floor);
    step<NeoHookean<Space<3, double>>, QuadraticBSpline, Asflip>(Gravity{}, floor);
    step<CamClay<Space<3, double>>, QuadraticBSpline, Flip>(Gravity{}, floor);
    step<FixedCorotated<Space<3, double>>, QuadraticBSpline, Tpic>(Gravity{}, floor);
    step<Sand<Space<2, double>>, QuadraticBSpline, Tpic>(Gravity{}, floor);
    step<FixedCorotated<Solid>, QuadraticBSpline, Mls>(Gravity{}, floor);
    step<HardeningVonMises<Solid>, QuadraticBSpline, Pic>(Gravity{}, floor);
    step<Snow<Solid>, QuadraticBSpline, Flip>(Gravity{}, floor);
    step<HerschelBulkley<Solid>, QuadraticBSpline, Mls>(Gravity{}, floor);
    step<Fluid<Solid>, QuadraticBSpline, Xpic>(Gravity{}, floor);
    step<Snow<Solid>, CubicBSpline, Flip>(Gravity{}, floor);
    // several obstacles: contact is called
    step<Snow<Solid>, QuadraticBSpline, Mls>(Gravity{}, floor, Obstacle<Sphere>{});
    step<Snow<Solid>, QuadraticBSpline, Flip>(Gravity{}, floor, Obstacle<Sphere>{});
    step<Snow<Solid>, QuadraticBSpline, Apic>(Gravity{}, floor, Obstacle<Box>{});
    step<Hencky<Solid>, QuadraticBSpline, Asflip>(Gravity{}, floor, Obstacle<Box>{});
    step<NeoHookean<Solid>, QuadraticBSpline, Asflip>(Obstacle<Shell<Box>>{}, Obstacle<Sphere>{});
    // walls, and shapes that look their surface up
    step<VonMises<Space<2, float>>, QuadraticBSpline, Mls>(ReflectingWall{}, floor);
    HeightField<float, 3> const hills({0, 0}, 1, {2, 2}, {0, 0, 0, 0});
    auto const hills_there = hills.on(Cuda{});
    step<NeoHookean<Solid>, QuadraticBSpline, Mls>(Obstacle{.shape = hills_there});
    step<Hencky<Solid>, QuadraticBSpline, Asflip>(Gravity{}, Obstacle{.shape = hills_there});
    SignedDistanceGrid<float, 3> const solid({0, 0, 0}, 1, {2, 2, 2}, std::vector<float>(8, 1.f));
    auto const solid_there = solid.on(Cuda{});
    step<Snow<Solid>, QuadraticBSpline, Mls>(Obstacle{.shape = solid_there});
    step<Snow<Solid>, QuadraticBSpline, Flip>(Obstacle{.shape = solid_there});
    step<Sand<Solid>, QuadraticBSpline, Tpic>(Gravity{}, floor);
    step<CamClay<Solid>, QuadraticBSpline, Asflip>(Gravity{}, floor);
}
#endif

// What comes closest to spilling, and each kind of loop.
void all()
{
    Obstacle<HalfSpace> const floor;
    step<Fluid<Space<3, double>>, QuadraticBSpline, Xpic>(Gravity{}, floor);
    step<Materials<NeoHookean<Solid>, Fluid<Solid>>, QuadraticBSpline, Mls>(ReflectingWall{}, floor);
    SignedDistanceGrid<float, 3> const solid({0, 0, 0}, 1, {2, 2, 2}, std::vector<float>(8, 1.f));
    auto const solid_there = solid.on(Cuda{});
    step<CamClay<Solid>, QuadraticBSpline, Asflip>(Gravity{}, Obstacle{.shape = solid_there});
}

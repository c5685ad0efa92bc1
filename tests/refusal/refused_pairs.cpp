// SPDX-License-Identifier: MIT
// Read by incomplete_model.sh: what is complete each by itself, and is refused together.
#include <firn/firn.hpp>

#include <firn/effects/force.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/held_marked.hpp>
#include <firn/effects/local_damping.hpp>
#include <firn/effects/marked_force.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/any_shape.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>
#include <firn/effects/shapes/inside.hpp>
#include <firn/effects/shapes/union.hpp>
#include <firn/effects/traction.hpp>
#include <firn/models/bodies.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/models/varied.hpp>
#include <firn/sampling/fill.hpp>
#include <firn/transfer/asflip.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/conduction.hpp>
#include <firn/transfer/marks.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
using Backend = firn::Cuda;
#else
#include <firn/openmp.hpp>
using Backend = firn::OpenMP;
#endif

using Solid = firn::NeoHookean<firn::Space<2, float>>;
using Two = firn::Bodies<Solid, Solid>;
using Deforming = firn::DeformingGrid<float, 2>;

// three reasons at once, and that of the wall and the transfer
template <class Transfer>
using SolverOfBodies = firn::Solver<Backend, Two, firn::QuadraticBSpline, Transfer>;
void bodies(SolverOfBodies<firn::Carrying<firn::Xpic, firn::Conduction>>& solver)
{
    solver.step(1e-4, firn::ReflectingWall{});
}
void loads(firn::Solver<Backend, Solid, firn::QuadraticBSpline, firn::Mls>& solver)
{
    solver.step(1e-4, firn::LocalDamping{}, firn::Traction{});
}
using AtSurface = firn::Obstacles<firn::AnyShape<>, firn::ActsOn::surface>;
void surfaces(firn::Solver<Backend, Solid, firn::QuadraticBSpline, firn::Mls>& solver,
              firn::Solver<Backend, Two, firn::QuadraticBSpline, firn::Mls>& of_bodies)
{
    solver.step(1e-4, AtSurface{}, firn::ReflectingWall{});
    of_bodies.step(1e-4, AtSurface{});
    static_cast<void>(sizeof(firn::Obstacles<firn::Shell<firn::Sphere>, firn::ActsOn::surface>));
}
using KeptWater = firn::KeepsVolume<firn::Fluid<firn::Space<2, float>>>;
void volumes(firn::Solver<Backend, KeptWater, firn::QuadraticBSpline, firn::Mls>& solver)
{
    solver.step(1e-4, firn::Obstacles<>{});
}
struct Other : firn::Mark
{
    static constexpr auto name = "other";
};
void marks(firn::Solver<Backend, Solid, firn::QuadraticBSpline, firn::Mls>& solver)
{
    solver.step(1e-4, firn::HeldMarked<firn::Mark>{}, firn::MarkedForce<Other>{});
    static_cast<void>(sizeof(firn::Marks<firn::Stiffness>));
    static_cast<void>(sizeof(firn::Varied<Solid, firn::OwnCone>));
}
void shapes(Deforming const& shape)
{
    static_cast<void>(sizeof(firn::Shell<Deforming>));
    static_cast<void>(sizeof(firn::Union<firn::Sphere, Deforming>));
    static_cast<void>(sizeof(firn::AnyShape<Deforming>));
    static_cast<void>(sizeof(firn::Inside<Deforming>));
    firn::Held<Deforming>{.shape = shape}.validate();
    firn::Force<Deforming>{.shape = shape}.validate();
    firn::fill<2>(shape, firn::Filling{.spacing = 0.1});
}

// implicit steps: see IMPLICIT.md
template <class Transfer, class Model = Solid, class By = firn::Implicit>
using SolverBySolving = firn::Solver<Backend, Model, firn::QuadraticBSpline, Transfer, By>;
using Water = firn::Fluid<firn::Space<2, float>>;
void implicit_steps(SolverBySolving<firn::Flip>& solver, SolverBySolving<firn::Mls, Two>& of_bodies)
{
    solver.step(1e-4, firn::LocalDamping{});
    solver.step(1e-4, AtSurface{});
    of_bodies.step(1e-4);
}
void rest(SolverBySolving<firn::Mls, Water>& solver) { solver.settle(firn::Gravity{}); }
std::size_t with_xpic = sizeof(firn::SteppedBy<firn::Xpic, firn::Implicit>);
std::size_t with_asflip = sizeof(firn::SteppedBy<firn::Asflip, firn::Implicit>);
std::size_t midpoint_with_mls = sizeof(firn::SteppedBy<firn::Mls, firn::ImplicitMidpoint>);

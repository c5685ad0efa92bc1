// SPDX-License-Identifier: MIT
#pragma once

#include <firn/interpolation/cubic_b_spline.hpp>
#include <firn/models/heterogeneous.hpp>
#include <firn/models/materials.hpp>
#include <firn/solver.hpp>
#include <firn/transfer/flip.hpp>

#include <utility>

// Which kernel, transfer and number of particles to take for a material, by error against cost as measured in
// the plane (bench/notes/2026-11-23-which-settings-are-on-the-front.md; in space quadratic kernels cost the
// least for large waves, as everywhere by default, and cubic ones are not far behind):
//
//     auto solver = firn::recommended_solver<firn::OpenMP>(firn::lattice(0.02),
//     firn::materials::dry_sand<Space>());
namespace firn
{

/// Of every material that has no entry of its own: solids, whose waves and columns cubic kernels with MLS
/// solve at the least cost for a given error, and metals, clay and foam, which were not measured.
template <class Model>
struct Recommended
{
    using Kernel = CubicBSpline;
    using Transfer = Mls;
    static constexpr Transfer transfer{};
    static constexpr StepControl control{};    ///< shorter steps than the library's own are no better
    static constexpr int per_axis = 2;         ///< particles per cell along each axis
    static constexpr bool is_measured = false; ///< whether a material of its class was
};

/// Elastic solids: large waves and a column under its weight.
template <class Space>
struct Recommended<NeoHookean<Space>> : Recommended<void>
{
    static constexpr bool is_measured = true;
};

/// Sand: a column that collapses comes nearer to its fine run without the losses of MLS, and PIC's share in
/// FLIP would act in every step. (Without it particles of a heap at rest keep velocities of 0.065 sqrt(g h),
/// h being the cell: take Mls where it is to lie still.)
template <class Space>
struct Recommended<Sand<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
    using Transfer = Flip;
    static constexpr Transfer transfer{.fraction = 1};
    static constexpr bool is_measured = true;
};

/// Snow: a block that is thrown on a floor, where quadratic kernels are as accurate as cubic ones and
/// cheaper.
template <class Space>
struct Recommended<Snow<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
    static constexpr bool is_measured = true;
};

/// Compacted snow and soil: not measured, as snow.
template <class Space>
struct Recommended<CamClay<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
};

/// Fluids: the pressure of a column at rest.
template <class Space>
struct Recommended<Fluid<Space>> : Recommended<void>
{
    static constexpr bool is_measured = true;
};

/// As the solid whose moduli it varies.
template <class Model>
struct Recommended<Heterogeneous<Model>> : Recommended<Model>
{
    static constexpr bool is_measured = false;
};

/// As the first of several: put the one first that matters most.
template <class First, class... Others>
struct Recommended<Materials<First, Others...>> : Recommended<First>
{
    static constexpr bool is_measured = false;
};

/// The solver of a material with what is recommended for it.
template <class Backend, class Model>
using RecommendedSolver =
    Solver<Backend, Model, typename Recommended<Model>::Kernel, typename Recommended<Model>::Transfer>;

/// Such a solver, its transfer and steps as recommended, too.
template <class Backend, class Model>
RecommendedSolver<Backend, Model> recommended_solver(Lattice lattice, Model model, Backend backend = {})
{
    using Choice = Recommended<Model>;
    return RecommendedSolver<Backend, Model>(lattice, std::move(model), Choice::transfer, Choice::control,
                                             std::move(backend));
}

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/interpolation/cubic_b_spline.hpp>
#include <firn/models/bodies.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/models/heterogeneous.hpp>
#include <firn/models/materials.hpp>
#include <firn/models/varied.hpp>
#include <firn/solver.hpp>
#include <firn/transfer/flip.hpp>

#include <utility>

// Which kernel, transfer and number of particles to use for a material, and which remedies, by error against
// cost as measured in the plane (bench/notes/2026-11-23-which-settings-are-on-the-front.md). In space
// quadratic kernels, the default everywhere, cost the least for large waves, and cubic ones are not far
// behind.
//
//     auto solver = firn::recommended_solver<firn::OpenMP>(firn::lattice(0.02),
//     firn::materials::dry_sand<Space>());
namespace firn
{

/// For every material without an entry of its own: solids, for whose waves and columns cubic kernels with MLS
/// reach a given error at the least cost, and metals, clay and foam, which were not measured.
template <class Model>
struct Recommended
{
    using Kernel = CubicBSpline;
    using Transfer = Mls;
    static constexpr Transfer transfer{};
    static constexpr StepControl control{};    ///< steps shorter than the default are no better
    static constexpr int per_axis = 2;         ///< particles per cell along each axis
    static constexpr bool is_measured = false; ///< whether a material of its class was
};

/// Elastic solids: large waves and a column under its weight.
template <class Space>
struct Recommended<NeoHookean<Space>> : Recommended<void>
{
    static constexpr bool is_measured = true;
};

/// Sand: a collapsing column comes nearer to its fine run without the losses of MLS, and PIC's share in FLIP
/// would damp in every step. Without that share particles of a heap at rest keep velocities of 0.065 sqrt(g
/// h), h being the cell size: use Mls where it is to lie still.
template <class Space>
struct Recommended<Sand<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
    using Transfer = Flip;
    static constexpr Transfer transfer{.fraction = 1};
    static constexpr bool is_measured = true;
};

/// Snow: a block thrown on a floor, where quadratic kernels are as accurate as cubic ones and cheaper.
template <class Space>
struct Recommended<Snow<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
    static constexpr bool is_measured = true;
};

/// Compacted snow and soil: not measured, set like snow.
template <class Space>
struct Recommended<CamClay<Space>> : Recommended<void>
{
    using Kernel = QuadraticBSpline;
};

/// Fluids: the pressure of a column at rest, and tanks and floating disks
/// (bench/notes/2026-11-29-water-at-walls.md).
template <class Space>
struct Recommended<Fluid<Space>> : Recommended<void>
{
    static constexpr bool is_measured = true;
};
template <class Space>
struct Recommended<KeepsVolume<Fluid<Space>>> : Recommended<Fluid<Space>>
{};

/// Like the solid whose moduli it varies.
template <class Model>
struct Recommended<Heterogeneous<Model>> : Recommended<Model>
{
    static constexpr bool is_measured = false;
};

/// Like the material of which parameters vary.
template <class Model, class... Tags>
struct Recommended<Varied<Model, Tags...>> : Recommended<Model>
{
    static constexpr bool is_measured = false;
};

/// Like the first of several materials: put the most important one first.
template <class First, class... Others>
struct Recommended<Materials<First, Others...>> : Recommended<First>
{
    static constexpr bool is_measured = false;
};

/// And like the first of several bodies.
template <class First, class... Others>
struct Recommended<Bodies<First, Others...>> : Recommended<Materials<First, Others...>>
{};

namespace detail
{
template <class Model>
struct RecommendedModel
{
    using Type = Model;
};
template <class Space>
struct RecommendedModel<Fluid<Space>>
{
    using Type = KeepsVolume<Fluid<Space>>;
};
} // namespace detail

/// What a scene of one material is to be solved as: a fluid by itself keeps its volume, so its obstacles have
/// to act at their surface. Materials and Bodies are what they name.
template <class Model>
using RecommendedModel = typename detail::RecommendedModel<Model>::Type;

/// The solver of a material with the recommended kernel and transfer.
template <class Backend, class Model>
using RecommendedSolver = Solver<Backend, RecommendedModel<Model>, typename Recommended<Model>::Kernel,
                                 typename Recommended<Model>::Transfer>;

/// Makes such a solver, with the recommended transfer parameters and step control.
template <class Backend, class Model>
RecommendedSolver<Backend, Model> recommended_solver(Lattice lattice, Model model, Backend backend = {})
{
    using Choice = Recommended<Model>;
    return RecommendedSolver<Backend, Model>(lattice, RecommendedModel<Model>(std::move(model)),
                                             Choice::transfer, Choice::control, std::move(backend));
}

} // namespace firn

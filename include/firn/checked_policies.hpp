// SPDX-License-Identifier: MIT
#pragma once

#include <firn/concepts.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/transfer/mls.hpp>

#include <type_traits>

// What a solver asks of its policies before it uses them. One that lacks a member is refused with a sentence.
namespace firn::detail
{

/// Whether all types of a scene's material list are materials, for this lane type.
template <class Real, class List>
inline constexpr bool are_materials = false;
template <class Real, template <class...> class List, class... Models>
inline constexpr bool are_materials<Real, List<Models...>> = (Complete<Models, Real>::value && ...);

/// Refuses a kernel of too high a degree for the backend with a sentence, and substitutes another one so that
/// the compiler reports nothing more.
template <class Backend, class Kernel>
struct KernelFor
{
    static constexpr bool fits = Kernel::degree <= Backend::largest_degree;
    static_assert(fits, "the kernel's degree is beyond what the backend's tiles take "
                        "(Backend::largest_degree): choose QuadraticBSpline, CubicBSpline or another one of "
                        "degree 3 or less");
    using Type = std::conditional_t<fits, Kernel, QuadraticBSpline>;
};

/// Refuses a transfer scheme that lacks a member with a sentence, and substitutes another one so that the
/// compiler reports nothing more.
template <class Backend, class Model, class Kernel, class Transfer>
struct TransferFor
{
    using Type = Transfer; // of a model without a Space, which is refused
};
template <class Backend, HasSpace Model, class Kernel, class Transfer>
struct TransferFor<Backend, Model, Kernel, Transfer>
{
    using Real = typename Backend::template Lane<typename Model::Space::Scalar>;
    static constexpr bool fits = CompleteTransfer<Transfer, Kernel, Real, Model::Space::dimension>::value;
    using Type = std::conditional_t<fits, Transfer, Mls>;
};

} // namespace firn::detail

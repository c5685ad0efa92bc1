// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/models/principal_product.hpp>

namespace firn
{

/// A solid whose product is positive semi-definite: what softens it is left out of the tangent, and its
/// stress stays. In implicit steps linear systems then have a solution by conjugate gradients in any state,
/// as the negative curvature that ends a search does not occur; Newton's method takes more of them near a
/// state that buckles. For all solids of the house: `SemiDefinite<NeoHookean<Space>>`.
template <class ModelType>
struct SemiDefinite : ModelType
{
    using Space = typename ModelType::Space;
    static_assert(
        !requires { typename ModelType::Model; },
        "SemiDefinite takes a solid itself: make it Heterogeneous or Varied around that");

    SemiDefinite() = default;
    SemiDefinite(ModelType const& model) : ModelType(model) {}

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change) const
    {
        return product_in_axes<Real, Space::dimension, true>(this->template in_axes<Real>(state), change);
    }
};

} // namespace firn

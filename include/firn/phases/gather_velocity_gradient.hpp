// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/particles/observables.hpp>
#include <firn/phases/gather.hpp>

namespace firn
{

/// Gathers the velocity gradients of the last step once more, by row, as GatherVelocities does velocities.
template <class Space, class Kernel, class TransferType, class PersistentFields>
struct GatherVelocityGradient : Gather<Space, Kernel, TransferType>
{
    using Transfer = TransferType;
    using Gather = firn::Gather<Space, Kernel, Transfer>;
    using Gather::d;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true};
    using Result = NothingFound;

    Transfer transfer;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, Fields<VelocityGradient>> gradients;
    Number cell_size; ///< [m]

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Gather::template set_position<typename Items::Real>(items, particles.position(items));
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        auto particle = Record<Real, d, typename Transfer::State>::at_rest(); // what it becomes is not stored
        Record<Real, d, Fields<VelocityGradient>> found;
        found[VelocityGradient{}] = transfer.template gather<Kernel, Real, d>(
            particle, Gather::template gathered<Real>(items), Real(1 / cell_size));
        gradients.store(items, particles.id, found);
    }
};

} // namespace firn

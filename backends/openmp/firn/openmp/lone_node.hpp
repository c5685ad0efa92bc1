// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/lattice.hpp>

namespace firn::openmp
{

/// One node that looks at others.
template <class GridType, class NumberType, int d>
class LoneNode
{
public:
    using Real = NumberType;

    /// `values` are where those of the node lie.
    LoneNode(GridType const& grid, Real* values, Coordinates<d> const& at)
        : grid_(grid), values_(values), at_(at)
    {}

    Coordinates<d> first() const { return at_; }
    void set(int c, Real value) const { values_[c * GridType::block_channel] = value; }

    /// The sums of any node; zeros where there is none.
    template <int channels>
    void sums_at(Coordinates<d> const& node, Real (&sums)[channels]) const
    {
        grid_.sums_at(node, sums);
    }

private:
    GridType const& grid_;
    Real* values_;
    Coordinates<d> at_;
};

} // namespace firn::openmp

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/transfer/transfer.hpp>

#include <array>
#include <cstddef>

namespace firn
{

/// The weights by which a force at a point of a surface acts on the nodes of a row.
///
/// A uniform pressure in all that lies behind a plane gives node i the integral of the gradient of w_i over
/// it as force, and so w_i at points of the plane. Mls has w_i (x_i - x) D^-1 in place of the gradient, which
/// is the derivative of another weight along each axis. By w_i the forces of a plane of nodes and of the
/// pressure behind it would balance in their sum alone, and drive currents. The product of the kernel's
/// surface_weights(t) along one axis and of w_i along the others, weighted by the square of the normal's
/// component along that axis, balances them along the normal of every plane.
template <class Kernel, class Transfer, class Number, int d>
class SurfaceWeights
{
    using Cell = Stencil<Kernel, Number, d>;
    using Weights = std::array<Number, std::size_t(Cell::width)>;
    static constexpr bool of_distances =
        !Transfer::template scatter_terms<Kernel>.gradient && requires(Number t)
    {
        Kernel::surface_weights(t);
    };

public:
    FIRN_HOST_DEVICE SurfaceWeights(Cell const& stencil, Vector<Number, d> const& offset,
                                    Vector<Number, d> const& normal)
        : cell_(stencil)
    {
        if constexpr (of_distances)
            for (int a = 0; a < d; ++a) {
                auto const weights = Kernel::surface_weights(offset[a]);
                for (std::size_t k = 0; k < weights.size(); ++k)
                    along_[std::size_t(a)][k] = normal[a] * normal[a] * weights[k];
            }
    }

    /// The weights of a row.
    FIRN_HOST_DEVICE Weights of_row(int row) const
    {
        Number product = picked(cell_.weight[0], Cell::index(row, 0)); // of all axes but the last
        if constexpr (d == 3) product *= picked(cell_.weight[1], Cell::index(row, 1));
        Number others = of_distances ? Number(0) : product;
        if constexpr (of_distances)
            for (int a = 0; a < d - 1; ++a) {
                Number along = picked(along_[std::size_t(a)], Cell::index(row, a));
                if constexpr (d == 3)
                    along *= picked(cell_.weight[std::size_t(1 - a)], Cell::index(row, 1 - a));
                others += along;
            }
        Weights weights;
        for (std::size_t k = 0; k < weights.size(); ++k) {
            weights[k] = others * cell_.weight[std::size_t(d - 1)][k];
            if constexpr (of_distances) weights[k] += product * along_[std::size_t(d - 1)][k];
        }
        return weights;
    }

private:
    /// A device has arrays in registers if all indices are known when it is compiled.
    FIRN_HOST_DEVICE static Number picked(Weights const& from, int k)
    {
        Number one = from[0];
        FIRN_UNROLL
        for (int i = 1; i < Cell::width; ++i) one = i == k ? from[std::size_t(i)] : one;
        return one;
    }

    Cell const& cell_;
    std::array<Weights, std::size_t(d)> along_{};
};

} // namespace firn

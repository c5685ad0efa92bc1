// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/particles/observables.hpp>

#include <cstddef>
#include <cstdint>
#include <vector>

// Sums over particles on nodes that the host computes when asked, from what it downloads.
namespace firn::detail
{

/// The hash of a node, by its coordinates.
template <int d>
struct HashOfNode
{
    std::size_t operator()(Coordinates<d> const& node) const
    {
        std::uint64_t hash = 0;
        for (int a = 0; a < d; ++a) {
            hash = (hash ^ static_cast<std::uint32_t>(node[a])) * 0x9E3779B97F4A7C15u;
            hash ^= hash >> 32;
        }
        return static_cast<std::size_t>(hash);
    }
};

/// Calls `use(node, weight, x_i - x)` for the nodes of a position's stencil, those of a periodic lattice in
/// its first period.
template <class Kernel, int d, class Use>
void for_each_node_around(Lattice const& lattice, Vector<double, d> const& x, Use const& use)
{
    constexpr int width = Kernel::degree + 1, count = d == 2 ? width * width : width * width * width;
    auto const at = locate<d>(lattice, Kernel::degree, x);
    Stencil<Kernel, double, d> const stencil(at.offset);
    for (int i = 0; i < count; ++i) {
        Coordinates<d> node = at.cell;
        Vector<double, d> away;
        double weight = 1;
        for (int a = 0, rest = i; a < d; ++a, rest /= width) {
            auto const k = static_cast<std::size_t>(rest % width);
            node[a] += rest % width - stencil_reach(Kernel::degree);
            weight *= stencil.weight[std::size_t(a)][k];
            away[a] = stencil.distance[std::size_t(a)][k] * lattice.cell_size;
        }
        use(periods_of<d>(lattice).wrapped(node), weight, away);
    }
}

/// The volumes [m^3] of a material's particles now, by rising id: by their masses and the model's density.
template <class One, class Solver>
FIRN_COLD std::vector<double> present_volumes(Solver const& solver)
{
    auto volumes = solver.template masses<One>();
    auto const J = solver.template download<VolumeRatio, One>();
    double const density(solver.template model<One>().density);
    for (std::size_t i = 0; i < volumes.size(); ++i) volumes[i] *= double(J[i]) / density;
    return volumes;
}

} // namespace firn::detail

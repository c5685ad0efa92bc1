// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/phases/coarse_nodes.hpp>
#include <firn/phases/coarse_sums.hpp>
#include <firn/time_stepping/coarse_extent.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace firn
{

/// A coarse grid's nodes: the corners of its cells that hold a particle. With others a coarse node could have
/// mass and hardly any stiffness.
template <int d>
class CoarseGrid
{
public:
    using Node = CoarseNode<d>;

    /// Lists the corners of these cells, in one order.
    void begin(std::vector<Coordinates<d>> cells)
    {
        nodes_.clear();
        std::vector<Coordinates<d>> corners;
        for (auto const& cell : cells)
            for (int corner = 0; corner < 1 << d; ++corner) {
                Coordinates<d> at = cell;
                for (int a = 0; a < d; ++a) at[a] += (corner >> a) & 1;
                corners.push_back(at);
            }
        make_unique(corners);
        for (auto const& at : corners) nodes_.push_back({at, {}});
        for (auto& node : nodes_)
            for (int i = 0; i < Node::beside_count; ++i) {
                Coordinates<d> at = node.at;
                for (int a = d - 1, rest = i; a >= 0; --a, rest /= 3) at[a] += rest % 3 - 1;
                node.beside[std::size_t(i)] = find(at);
            }
    }
    std::vector<Node> const& nodes() const { return nodes_; }

    /// The number of a node, or absent.
    std::uint32_t find(Coordinates<d> const& at) const
    {
        auto const found =
            std::ranges::lower_bound(nodes_, at, is_before, [](Node const& node) { return node.at; });
        bool const is_there = found != nodes_.end() && found->at == at;
        return is_there ? static_cast<std::uint32_t>(found - nodes_.begin()) : Node::absent;
    }

    static void make_unique(std::vector<Coordinates<d>>& places)
    {
        std::sort(places.begin(), places.end(), is_before);
        places.erase(std::unique(places.begin(), places.end()), places.end());
    }
    static bool is_before(Coordinates<d> const& a, Coordinates<d> const& b)
    {
        return std::lexicographical_compare(a.data(), a.data() + d, b.data(), b.data() + d);
    }

private:
    std::vector<Node> nodes_;
};

/// The coarse cells of those that hold a particle. Few boxes around a scene are so large that marks of
/// all their cells take more than a list of some.
template <int d>
std::vector<Coordinates<d>> coarse_cells(std::vector<HeldCells<d>> const& held)
{
    constexpr int far = std::numeric_limits<int>::max();
    Coordinates<d> low = Coordinates<d>::Constant(far), high = Coordinates<d>::Constant(-far);
    std::size_t any = 0;
    for (auto const& of : held) {
        if (of.corners == 0) continue;
        ++any;
        low = low.cwiseMin(of.node);
        high = high.cwiseMax(of.node);
    }
    std::vector<Coordinates<d>> cells;
    if (any == 0) return cells;
    low = coarse_cell<d>(low - Coordinates<d>::Constant(1)); // a corner's cell may begin a node before
    high = coarse_cell<d>(high);
    double box = 1;
    for (int a = 0; a < d; ++a) box *= double(high[a]) - double(low[a]) + 1;
    auto const each = [&](auto const& use) {
        for (auto const& of : held)
            if (of.corners != 0) of.for_each([&](Coordinates<d> const& cell) { use(coarse_cell<d>(cell)); });
    };
    if (box > 64 * double(any)) {
        each([&](Coordinates<d> const& cell) { cells.push_back(cell); });
        CoarseGrid<d>::make_unique(cells);
        return cells;
    }
    std::vector<bool> marks(static_cast<std::size_t>(box));
    Coordinates<d> const extent = high - low + Coordinates<d>::Constant(1);
    each([&](Coordinates<d> const& cell) {
        std::size_t place = 0;
        for (int a = 0; a < d; ++a) place = place * std::size_t(extent[a]) + std::size_t(cell[a] - low[a]);
        marks[place] = true;
    });
    for (std::size_t place = 0; place < marks.size(); ++place) {
        if (!marks[place]) continue;
        Coordinates<d> cell;
        std::size_t rest = place;
        for (int a = d - 1; a >= 0; --a) {
            cell[a] = low[a] + static_cast<int>(rest % std::size_t(extent[a]));
            rest /= std::size_t(extent[a]);
        }
        cells.push_back(cell);
    }
    return cells;
}

} // namespace firn

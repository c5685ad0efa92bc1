// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/phases/coarse_nodes.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
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

} // namespace firn

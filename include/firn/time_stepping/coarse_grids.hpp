// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/phases/coarse_nodes.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

// The coarse grids by which implicit steps are preconditioned.
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

/// An additive preconditioner on a ladder of grids, each four times as coarse as the one before, down to one
/// of a few cells:
///
///   z = D^-1 r + P_1 D_1^-1 P_1^T r + P_1 P_2 D_2^-1 P_2^T P_1^T r + ...
///
/// P interpolates multilinearly between the nodes that are there. D are diagonals: mass, and what stress
/// resists as in an elastic grid of that cell size, and nodes that are held as a penalty (Bramble, Pasciak &
/// Xu 1990, *Parallel multilevel preconditioners*).
template <class Backend, class Space>
class CoarseGrids
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Node = CoarseNode<d>;
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    explicit CoarseGrids(Backend const& backend)
        : backend_(backend), coarse_(backend), reached_(backend), linked_(backend), weights_(backend),
          residual_(backend), correction_(backend)
    {}

    bool are_there() const { return !levels_.empty(); }
    void clear() { levels_.clear(); }

    /// Lists the nodes of all grids, for particles in these cells of the first one, and links the first one's
    /// with the grid's own.
    template <class Kernel, class Transfer, class Actions, class Nodes>
    void begin(std::vector<Coordinates<d>> cells, StepContext<Number, Actions> const* now, Nodes const& nodes,
               std::size_t node_count, Number smallest_mass)
    {
        levels_.clear();
        CoarseGrid<d>::make_unique(cells);
        for (bool goes_on = !cells.empty(); goes_on;) {
            goes_on = cells.size() > 1;
            levels_.emplace_back();
            levels_.back().grid.begin(cells);
            for (auto& cell : cells)
                for (int a = 0; a < d; ++a) cell[a] = floor_of(cell[a]);
            CoarseGrid<d>::make_unique(cells);
            goes_on = goes_on && levels_.size() < 8;
        }
        if (!are_there()) return;
        for (std::size_t l = 1; l < levels_.size(); ++l) link(l);
        auto const& first = levels_.front().grid.nodes();
        coarse_.resize(first.size(), 0);
        coarse_.upload(0, first_copy_ = first);
        reached_.resize(first.size() * std::size_t(Node::reached_count), 0);
        linked_.resize(node_count, 0);
        linked_.fill(0, node_count, {});
        weights_.resize(first.size(), 0);
        residual_.resize(first.size(), 0);
        correction_.resize(first.size(), 0);
        backend_.for_each(first.size(),
                          LinkCoarseNodes<Space, Kernel, Transfer, Actions, Nodes>{
                              now, nodes, smallest_mass, coarse_.data(), reached_.data(), linked_.data()});
    }

    /// Finds the diagonals, for the state that was tried last.
    template <class Kernel, class Transfer, class Nodes>
    void weigh(Nodes const& nodes, bool at_rest, double stiffness_of_kernel)
    {
        auto& first = levels_.front();
        backend_.for_each(first.grid.nodes().size(), WeighCoarseNodes<Space, Kernel, Transfer, Nodes>{
                                                         nodes, reached_.data(), weights_.data(), at_rest});
        first.weights.resize(first.grid.nodes().size());
        weights_.download(0, first.weights);
        for (std::size_t l = 1; l < levels_.size(); ++l) {
            auto const& finer = levels_[l - 1].weights;
            auto& own = levels_[l];
            own.weights.assign(own.grid.nodes().size(), {});
            own.for_each_link([&](std::size_t to, std::size_t from, double w) {
                auto& sum = own.weights[to];
                sum.mass += w * finer[from].mass;
                sum.resists += w * finer[from].resists;
                for (std::size_t a = 0; a < std::size_t(d); ++a) {
                    sum.held[a] += w * finer[from].held[a];
                    sum.held_squares[a] += w * w * finer[from].held[a];
                }
            });
        }
        double in_cells = 1; // of the grid's own, to a level's size
        for (auto& level : levels_) {
            in_cells *= coarsening;
            level.inverse.resize(level.weights.size());
            for (std::size_t i = 0; i < level.weights.size(); ++i) {
                auto const& of = level.weights[i];
                double const resists =
                    of.resists * stiffness_of_interpolation / stiffness_of_kernel / (in_cells * in_cells);
                for (int a = 0; a < d; ++a) {
                    double const diagonal =
                        (at_rest ? 0 : of.mass) + resists + of.held_squares[std::size_t(a)];
                    level.inverse[i][a] = diagonal > 0 ? 1 / diagonal : 0;
                }
            }
        }
    }

    /// Adds the coarse grids' part to the preconditioned residual of nodes.
    template <class Kernel, class Transfer, class Nodes>
    void correct(Nodes const& nodes, std::size_t node_count)
    {
        auto& first = levels_.front();
        std::size_t const count = first.grid.nodes().size();
        backend_.for_each(count, RestrictResidual<Space, Kernel, Transfer, Nodes>{nodes, reached_.data(),
                                                                                  residual_.data()});
        numbers_.resize(count);
        residual_.download(0, numbers_);
        first.values.resize(count);
        for (std::size_t i = 0; i < count; ++i) first.values[i] = numbers_[i].template cast<double>();
        for (std::size_t l = 1; l < levels_.size(); ++l) {
            auto& own = levels_[l];
            own.values.assign(own.grid.nodes().size(), zeros<Vector<double, d>>());
            own.for_each_link([&](std::size_t to, std::size_t from, double w) {
                own.values[to] += levels_[l - 1].values[from] * w;
            });
        }
        for (auto& level : levels_)
            for (std::size_t i = 0; i < level.values.size(); ++i)
                for (int a = 0; a < d; ++a) level.values[i][a] *= level.inverse[i][a];
        for (std::size_t l = levels_.size() - 1; l > 0; --l)
            levels_[l].for_each_link([&](std::size_t to, std::size_t from, double w) {
                levels_[l - 1].values[from] += levels_[l].values[to] * w;
            });
        for (std::size_t i = 0; i < count; ++i) numbers_[i] = first.values[i].template cast<Number>();
        correction_.upload(0, numbers_);
        backend_.for_each(node_count, ProlongCorrection<Space, Kernel, Transfer, Nodes>{nodes, linked_.data(),
                                                                                        correction_.data()});
    }

    /// Bytes held for loops.
    std::size_t memory() const
    {
        return coarse_.memory() + reached_.memory() + linked_.memory() + weights_.memory() +
               residual_.memory() + correction_.memory();
    }

    /// The cell of the first coarse grid in which something lies at an offset from the middle of a cell.
    static int cell_of(int cell, double offset)
    {
        return static_cast<int>(std::floor((double(cell) + offset) / coarsening));
    }

private:
    /// What stress resists a node's interpolation with, over the mean modulus times 1 / cell size^2: of a
    /// cube whose sides resist along one axis, and shear along the others.
    static constexpr double stiffness_of_interpolation = 1;

    static int floor_of(int cell) { return static_cast<int>(std::floor(double(cell) / coarsening)); }

    struct Link
    {
        std::uint32_t to, from; ///< a node, and one of the finer grid
        double weight;
    };
    struct Level
    {
        CoarseGrid<d> grid;
        std::vector<Link> links; ///< with the finer grid of the ladder
        std::vector<CoarseWeights<d>> weights;
        std::vector<Vector<double, d>> inverse, values;

        template <class Use>
        void for_each_link(Use const& use) const
        {
            for (Link const& link : links) use(std::size_t(link.to), std::size_t(link.from), link.weight);
        }
    };

    void link(std::size_t l)
    {
        auto& own = levels_[l];
        auto const& finer = levels_[l - 1].grid;
        for (std::size_t number = 0; number < own.grid.nodes().size(); ++number) {
            Node const& node = own.grid.nodes()[number];
            for (int i = 0; i < Node::reached_count; ++i) {
                Coordinates<d> const way = Node::offset(i);
                std::uint32_t const from = finer.find(node.at * coarsening + way);
                if (from == Node::absent) continue;
                own.links.push_back(
                    {static_cast<std::uint32_t>(number), from, node.template weight<double>(way)});
            }
        }
    }

    Backend backend_;
    std::vector<Level> levels_;
    std::vector<Node> first_copy_;
    std::vector<Vector<Number, d>> numbers_;
    Array<Node> coarse_;
    Array<NodeWeight<Number>> reached_;
    Array<NodeInCoarse<Number, d>> linked_;
    Array<CoarseWeights<d>> weights_;
    Array<Vector<Number, d>> residual_, correction_;
};

} // namespace firn

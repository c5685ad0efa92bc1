// SPDX-License-Identifier: MIT
#pragma once

#include <firn/phases/coarse_ladder.hpp>
#include <firn/phases/coarse_nodes.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
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
        : backend_(backend), held_(backend), coarse_(backend), reached_(backend), linked_(backend)
    {}

    bool are_there() const { return are_there_; }
    void clear() { are_there_ = false; }

    /// Makes the grids under the particles of all materials, and links the first one's nodes with the grid's
    /// own.
    template <class Kernel, class Transfer, class Sets, class Actions, class Nodes>
    void begin(Sets const& sets, StepContext<Number, Actions> const* now, Nodes const& nodes,
               std::size_t node_count, Number smallest_mass)
    {
        auto cells = cells_with_particles<Kernel>(sets, nodes, node_count);
        are_there_ = !cells.empty();
        if (!are_there_) return;
        if (cells != cells_) { // mostly they are those of the step before
            cells_ = cells;
            make_levels(std::move(cells));
        }
        std::size_t const count = levels_.front().size();
        coarse_.resize(count, 0);
        coarse_.upload(0, first_copy_ = levels_.front().grid.nodes());
        reached_.resize(count * std::size_t(Node::reached_count), 0);
        linked_.resize(node_count, 0);
        linked_.fill(0, node_count, {});
        backend_.for_each(count,
                          LinkCoarseNodes<Space, Kernel, Transfer, Actions, Nodes>{
                              now, nodes, smallest_mass, coarse_.data(), reached_.data(), linked_.data()});
    }

    /// Finds the diagonals, for the state that was tried last.
    template <class Kernel, class Transfer, class Nodes>
    void weigh(Nodes const& nodes, bool at_rest, double stiffness_of_kernel)
    {
        auto& first = levels_.front();
        backend_.for_each(first.size(), WeighCoarseNodes<Space, Kernel, Transfer, Nodes>{
                                            nodes, reached_.data(), first.weights.data(), at_rest});
        for (std::size_t l = 1; l < levels_.size(); ++l)
            backend_.for_each(levels_[l].size(),
                              WeighLevel<d>{levels_[l].finer.links(), levels_[l - 1].weights.data(),
                                            levels_[l].weights.data()});
        double in_cells = 1; // of the grid's own, to a level's size
        for (auto& level : levels_) {
            in_cells *= coarsening;
            backend_.for_each(
                level.size(),
                InvertDiagonal<d>{level.weights.data(), level.inverse_diagonal.data(),
                                  stiffness_of_interpolation / stiffness_of_kernel / (in_cells * in_cells),
                                  at_rest});
        }
    }

    /// Adds the coarse grids' part to the preconditioned residual of nodes.
    template <class Kernel, class Transfer, class Nodes>
    void correct(Nodes const& nodes, std::size_t node_count)
    {
        auto& first = levels_.front();
        backend_.for_each(first.size(), RestrictResidual<Space, Kernel, Transfer, Nodes>{
                                            nodes, reached_.data(), first.values.data()});
        for (std::size_t l = 1; l < levels_.size(); ++l)
            backend_.for_each(levels_[l].size(),
                              RestrictLevel<d>{levels_[l].finer.links(), levels_[l - 1].values.data(),
                                               levels_[l].values.data()});
        for (std::size_t l = levels_.size(); l-- > 0;) {
            auto& own = levels_[l];
            bool const is_last = l + 1 == levels_.size();
            backend_.for_each(own.size(), ProlongLevel<d>{is_last, own.coarser.links(),
                                                          is_last ? nullptr : levels_[l + 1].values.data(),
                                                          own.inverse_diagonal.data(), own.values.data()});
        }
        backend_.for_each(node_count, ProlongCorrection<Space, Kernel, Transfer, Nodes>{nodes, linked_.data(),
                                                                                        first.values.data()});
    }

    /// Bytes held for loops.
    std::size_t memory() const
    {
        std::size_t bytes = held_.memory() + coarse_.memory() + reached_.memory() + linked_.memory();
        for (auto const& level : levels_) bytes += level.memory();
        return bytes;
    }

private:
    /// What stress resists a node's interpolation with, over the mean modulus times 1 / cell size^2: of a
    /// cube whose sides resist along one axis, and shear along the others.
    static constexpr double stiffness_of_interpolation = 1;

    /// Links of a grid's nodes with those of another grid of the ladder.
    struct Links
    {
        Array<std::uint32_t> begin;
        Array<NodeWeight<double>> of;

        explicit Links(Backend const& backend) : begin(backend), of(backend) {}

        void set(std::vector<std::vector<NodeWeight<double>>> const& by_node)
        {
            std::vector<std::uint32_t> begins{0};
            std::vector<NodeWeight<double>> all;
            for (auto const& links : by_node) {
                all.insert(all.end(), links.begin(), links.end());
                begins.push_back(static_cast<std::uint32_t>(all.size()));
            }
            begin.resize(begins.size(), 0);
            begin.upload(0, begins);
            of.resize(all.size(), 0);
            of.upload(0, all);
        }
        LadderLinks links() { return {begin.data(), of.data()}; }
        std::size_t memory() const { return begin.memory() + of.memory(); }
    };
    /// One of the grids.
    struct Level
    {
        CoarseGrid<d> grid;
        Links finer, coarser;
        Array<CoarseWeights<d>> weights;
        Array<Vector<double, d>> inverse_diagonal, values;

        explicit Level(Backend const& backend)
            : finer(backend), coarser(backend), weights(backend), inverse_diagonal(backend), values(backend)
        {}
        void begin(std::vector<Coordinates<d>> const& cells)
        {
            grid.begin(cells);
            weights.resize(size(), 0);
            inverse_diagonal.resize(size(), 0);
            values.resize(size(), 0);
        }
        std::size_t size() const { return grid.nodes().size(); }
        std::size_t memory() const
        {
            return finer.memory() + coarser.memory() + weights.memory() + inverse_diagonal.memory() +
                   values.memory();
        }
    };

    static Coordinates<d> coarse_cell(Coordinates<d> cell)
    {
        for (int a = 0; a < d; ++a)
            cell[a] = cell[a] >= 0 ? cell[a] / coarsening : -1 - (-1 - cell[a]) / coarsening;
        return cell;
    }

    /// The cells of the first coarse grid that hold a particle, in one order.
    template <class Kernel, class Sets, class Nodes>
    std::vector<Coordinates<d>> cells_with_particles(Sets const& sets, Nodes const& nodes,
                                                     std::size_t node_count)
    {
        held_.resize(node_count, 0);
        held_.fill(0, node_count, {});
        Sets::for_each([&](auto k) {
            auto const& table = sets.template particles<k>();
            backend_.for_each_place(table.cells(),
                                    NoteHeldCells<Number, d, Nodes>{nodes, table.ordered().offset,
                                                                    Kernel::degree % 2 != 0, held_.data()});
        });
        std::vector<HeldCells<d>> held(node_count);
        held_.download(0, held);
        std::vector<Coordinates<d>> cells;
        for (auto const& of : held)
            of.for_each([&](Coordinates<d> const& cell) {
                auto const at = coarse_cell(cell);
                if (cells.empty() || cells.back() != at) cells.push_back(at);
            });
        CoarseGrid<d>::make_unique(cells);
        return cells;
    }

    void make_levels(std::vector<Coordinates<d>> cells)
    {
        levels_.clear();
        for (bool goes_on = true; goes_on;) {
            goes_on = cells.size() > 1 && levels_.size() < 7;
            levels_.emplace_back(backend_);
            levels_.back().begin(cells);
            for (auto& cell : cells) cell = coarse_cell(cell);
            CoarseGrid<d>::make_unique(cells);
        }
        for (std::size_t l = 1; l < levels_.size(); ++l) link(levels_[l], levels_[l - 1]);
    }
    static void link(Level& own, Level& finer)
    {
        std::vector<std::vector<NodeWeight<double>>> down(own.size()), up(finer.size());
        for (std::size_t number = 0; number < own.size(); ++number) {
            Node const& node = own.grid.nodes()[number];
            for (int i = 0; i < Node::reached_count; ++i) {
                Coordinates<d> const way = Node::offset(i);
                std::uint32_t const from = finer.grid.find(node.at * coarsening + way);
                if (from == Node::absent) continue;
                double const weight = node.template weight<double>(way);
                down[number].push_back({from, weight});
                up[from].push_back({static_cast<std::uint32_t>(number), weight});
            }
        }
        own.finer.set(down);
        finer.coarser.set(up);
    }

    Backend backend_;
    bool are_there_ = false;
    std::vector<Coordinates<d>> cells_; ///< those under which the levels were made
    std::vector<Level> levels_;
    std::vector<Node> first_copy_;
    Array<HeldCells<d>> held_;
    Array<Node> coarse_;
    Array<NodeWeight<Number>> reached_;
    Array<NodeInCoarse<Number, d>> linked_;
};

} // namespace firn

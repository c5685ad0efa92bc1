// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/phases/coarse_ladder.hpp>
#include <firn/phases/coarse_nodes.hpp>
#include <firn/phases/coarse_sums.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/solve_search.hpp>
#include <firn/time_stepping/coarse_extent.hpp>
#include <firn/time_stepping/coarse_grid.hpp>
#include <firn/time_stepping/coarse_over_ranks.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

// The coarse grids by which implicit steps are preconditioned.
namespace firn
{

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
        : backend_(backend), held_(backend), coarse_(backend), reached_(backend), linked_(backend),
          weight_lines_(backend), lines_(backend), weights_(backend), diagonals_(backend), values_(backend),
          first_of_node_(backend), parts_(backend), to_first_(backend), to_coarser_(backend),
          products_(backend), of_sum_(backend), numbers_(backend), near_weights_(backend),
          near_values_(backend), over_ranks_(backend)
    {}

    bool are_there() const { return are_there_; }
    void clear() { are_there_ = false; }

    /// Makes the grids under the particles of all materials, and links the first one's nodes with the grid's
    /// own.
    template <class Kernel, class Transfer, class Sets, class Actions, class Grid>
    void begin(Sets& sets, StepContext<Number, Actions> const* now, Grid& grid, Number smallest_mass)
    {
        are_there_ = false;
        if constexpr (Backend::reaches_host_memory && !spans_ranks<Backend>)
            if (extent_.template find_of_few<Kernel>(sets) && extent_.is_small()) return;
        auto cells = cells_with_particles<Kernel>(sets, grid.nodes_by_index(), grid.node_count());
        extent_.find(cells);
        are_there_ = !extent_.is_small();
        if (!are_there_) return;
        if (cells != cells_) { // mostly they are those of the step before
            cells_ = cells;
            make_levels(std::move(cells));
        }
        if constexpr (spans_ranks<Backend>) {
            using Solve = SolvePhase<Space, Kernel, Transfer>;
            over_ranks_.halo.begin(backend_, grid, sets.orders(), coarsening - 1,
                                   NodeSums<d, SumsOf<Transfer>>::mass, smallest_mass,
                                   Solve::Own::stiffness + 1);
            over_ranks_.find(backend_, grid, sets.orders(), levels_.front().grid.nodes());
            upload(numbers_, over_ranks_.near);
            std::vector<Node> near;
            for (auto const number : over_ranks_.near) near.push_back(levels_.front().grid.nodes()[number]);
            upload(coarse_, near);
        }
        std::size_t const near = near_count(), node_count = grid.node_count() + over_ranks_.halo.size();
        reached_.resize(near * std::size_t(Node::reached_count), 0);
        weight_lines_.resize(near * std::size_t(Node::lines), 0);
        lines_.resize(near * std::size_t(Node::lines), 0);
        linked_.resize(node_count, 0);
        linked_.fill(0, node_count, {});
        auto const nodes = nodes_of(grid);
        backend_.for_each(
            near * std::size_t(Node::reached_count),
            LinkCoarseNodes<Space, Kernel, Transfer, Actions, std::remove_const_t<decltype(nodes)>>{
                now, nodes, smallest_mass, coarse_.data(), near, reached_.data(), linked_.data(),
                spans_ranks<Backend> ? numbers_.data() : nullptr});
        list_linked(grid.node_count());
    }

    /// Where the particles of begin() lie.
    CoarseExtent<d> const& extent() const { return extent_; }

    /// Finds the diagonals, for the state that was tried last, and makes room for added().
    template <class Kernel, class Transfer, class Grid>
    void weigh(Grid& grid, bool at_rest, double stiffness_of_kernel)
    {
        if constexpr (spans_ranks<Backend>) {
            using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
            std::vector<int> channels{Own::mass, Own::stiffness};
            for (int i = 0; i < d; ++i) channels.push_back(Own::free_at(i, i));
            over_ranks_.halo.update(backend_, grid, channels);
        }
        auto const nodes = nodes_of(grid);
        using Nodes = std::remove_const_t<decltype(nodes)>;
        std::size_t const near = near_count();
        constexpr std::size_t of_part = ProlongCorrection<Space, Kernel, Transfer, Nodes>::of_part;
        of_sum_.resize((first_count() + of_part - 1) / of_part, 0);
        std::size_t const lines = near * std::size_t(Node::lines);
        WeighLines<Space, Kernel, Transfer, Nodes> const weigh_lines{
            {nodes, reached_.data(), near}, weight_lines_.data(), at_rest};
        auto const add_lines = [&](CoarseWeights<double, d>* to) {
            return AddWeightsOfLines<Number, d>{near, weight_lines_.data(), to};
        };
        auto const size = [&](std::size_t l) { return l < levels_.size() ? levels_[l].size() : 0; };
        auto const weigh = [&](std::size_t l) { // a level after the first
            if (l >= levels_.size()) return WeighLevel<d>{};
            return WeighLevel<d>{levels_[l].finer.links(), weights_.data() + levels_[l - 1].offset,
                                 weights_.data() + levels_[l].offset};
        };
        auto const invert = [&](std::size_t l) {
            if (l >= levels_.size()) return InvertDiagonal<d>{};
            double in_cells = 1; // of the grid's own, to the level's size
            for (std::size_t i = 0; i <= l; ++i) in_cells *= coarsening;
            return InvertDiagonal<d>{
                weights_.data() + levels_[l].offset, diagonals_.data() + levels_[l].offset,
                stiffness_of_interpolation / stiffness_of_kernel / (in_cells * in_cells), at_rest};
        };
        if constexpr (Backend::queues) {
            auto const queue = [&]<std::size_t... l>(std::index_sequence<l...>)
            {
                backend_.for_each_in_turn(
                    in_turn(lines, weigh_lines), in_turn(near, add_lines(weights_.data())),
                    in_turn(size(l + 1), weigh(l + 1))..., in_turn(size(l), invert(l))...);
            };
            queue(std::make_index_sequence<most_levels>{});
        }
        else {
            backend_.for_each(lines, weigh_lines);
            on_first(weights_, near_weights_,
                     [&](CoarseWeights<double, d>* to) { backend_.for_each(near, add_lines(to)); });
            for (std::size_t l = 1; l < levels_.size(); ++l) backend_.for_each(size(l), weigh(l));
            for (std::size_t l = 0; l < levels_.size(); ++l) backend_.for_each(size(l), invert(l));
        }
    }

    /// Adds the coarse grids' part to the preconditioned residual of nodes, and calls `body(r z)` where loops
    /// run, `found` being that of nodes.
    template <class Kernel, class Transfer, class Grid, class Found, class Body>
    void correct(Grid& grid, Found const& found, Body const& body)
    {
        if constexpr (spans_ranks<Backend>) {
            constexpr int residual = SolvePhase<Space, Kernel, Transfer>::Own::residual;
            std::array<int, std::size_t(d)> channels;
            for (int i = 0; i < d; ++i) channels[std::size_t(i)] = residual + i;
            over_ranks_.halo.update(backend_, grid, channels);
        }
        auto const nodes = nodes_of(grid);
        using Nodes = std::remove_const_t<decltype(nodes)>;
        std::size_t const first = first_count(), coarser = values_.size() - first, near = near_count();
        using Prolong = ProlongCorrection<Space, Kernel, Transfer, Nodes>;
        std::size_t const count = lists_linked ? list_.size() : grid.node_count(), parts = of_sum_.size();

        std::size_t const lines = near * std::size_t(Node::lines),
                          parts_of_sums = coarser > 0 ? parts_.size() : 0;
        RestrictLines<Space, Kernel, Transfer, Nodes> const restrict_lines{{nodes, reached_.data(), near},
                                                                           lines_.data()};
        auto const add_lines = [&](Vector<double, d>* to) {
            return AddResidualsOfLines<Number, d>{near, lines_.data(), to};
        };
        RestrictPart<d> const restrict_part{to_first_.links(), values_.data(), parts_.data()};
        CorrectCoarser<d> const correct_coarser{first_of_node_.data(), parts_.data(),
                                                diagonals_.data() + first, values_.data() + first};
        CorrectFirst<d> const correct_first{to_coarser_.links(), values_.data() + first, diagonals_.data(),
                                            values_.data(), products_.data()};
        Prolong const prolong{nodes,          lists_linked ? list_.data() : nullptr,
                              count,          linked_.data(),
                              values_.data(), products_.data(),
                              first,          of_sum_.data()};
        if constexpr (Backend::queues) {
            backend_.for_each_in_turn(
                found, body, in_turn(lines, restrict_lines), in_turn(near, add_lines(values_.data())),
                in_turn(parts_of_sums, restrict_part), in_turn(coarser, correct_coarser),
                in_turn(first, correct_first), in_turn(count + parts, prolong));
        }
        else {
            backend_.for_each(lines, restrict_lines);
            on_first(values_, near_values_,
                     [&](Vector<double, d>* to) { backend_.for_each(near, add_lines(to)); });
            backend_.for_each(parts_of_sums, restrict_part);
            backend_.for_each(coarser, correct_coarser);
            backend_.for_each(first, correct_first);
            backend_.for_each(count + parts, prolong);
            call_with(backend_, found, body);
        }
    }
    /// What they have added to r z: where loops run.
    CoarsePartsOfSum added() const
    {
        if (!are_there_) return {};
        return {of_sum_.data(), of_sum_.size()};
    }

    /// Bytes held for loops.
    std::size_t memory() const
    {
        std::size_t bytes = held_.memory() + coarse_.memory() + reached_.memory() + linked_.memory() +
                            weight_lines_.memory() + lines_.memory() + weights_.memory() +
                            diagonals_.memory() + values_.memory() + first_of_node_.memory() +
                            parts_.memory() + to_first_.memory() + to_coarser_.memory() + products_.memory() +
                            of_sum_.memory() + list_.capacity() * sizeof(std::uint32_t);
        for (auto const& level : levels_) bytes += level.finer.memory();
        return bytes;
    }

private:
    /// What stress resists a node's interpolation with, over the mean modulus times 1 / cell size^2: of a
    /// cube whose sides resist along one axis, and shear along the others.
    static constexpr double stiffness_of_interpolation = 1;
    /// Whether nodes that take part are listed: a scene may have many others, of blocks that it hardly
    /// touches.
    static constexpr bool lists_linked = Backend::reaches_host_memory;
    /// The links of a part of a sum: a compromise between how many sums there are and how long one takes.
    static constexpr std::size_t links_of_part = 32;

    static constexpr std::size_t most_levels = 8; ///< of a ladder

    using LinksOfNode = std::vector<NodeWeight<double>>;

    /// Links of a grid's nodes with those of other grids of the ladder.
    struct Links
    {
        Array<std::uint32_t> begin;
        Array<NodeWeight<double>> of;

        explicit Links(Backend const& backend) : begin(backend), of(backend) {}

        void set(std::vector<LinksOfNode> const& by_node)
        {
            std::vector<std::uint32_t> begins{0};
            LinksOfNode all;
            for (auto const& links : by_node) {
                all.insert(all.end(), links.begin(), links.end());
                begins.push_back(static_cast<std::uint32_t>(all.size()));
            }
            upload(begin, begins);
            upload(of, all);
        }
        LadderLinks links() { return {begin.data(), of.data()}; }
        std::size_t memory() const { return begin.memory() + of.memory(); }
    };
    /// One of the grids.
    struct Level
    {
        CoarseGrid<d> grid;
        std::size_t offset; ///< of its nodes, among those of all grids
        Links finer;

        std::size_t size() const { return grid.nodes().size(); }
    };

    /// A loop among those of a backend that queues.
    template <class Body>
    static auto in_turn(std::size_t count, Body const& body)
    {
        return typename Backend::template LoopInTurn<Body>{count, body};
    }

    std::size_t first_count() const { return levels_.front().size(); }
    /// Of its nodes, those that may reach nodes here: all, unless other ranks have some.
    std::size_t near_count() const { return spans_ranks<Backend> ? over_ranks_.near.size() : first_count(); }
    /// The nodes that they reach.
    template <class Grid>
    auto nodes_of(Grid& grid)
    {
        if constexpr (spans_ranks<Backend>)
            return over_ranks_.halo.nodes(grid);
        else
            return grid.nodes_by_index();
    }
    /// Lets `find(to)` find a value of each node nearby of the first grid, with which those of all begin.
    template <class T, class Find>
    void on_first(Array<T>& of_all, [[maybe_unused]] Array<T>& of_near, Find const& find)
    {
        if constexpr (spans_ranks<Backend>) {
            of_near.resize(near_count(), 0);
            find(of_near.data());
            over_ranks_.share(backend_, of_near, of_all);
        }
        else
            find(of_all.data());
    }

    /// Lists those of the first nodes that take part, where the host reaches what loops write.
    void list_linked(std::size_t node_count)
    {
        if constexpr (lists_linked) {
            list_.clear();
            for (std::size_t i = 0; i < node_count; ++i)
                if (linked_.data()[i].flipped != 0) list_.push_back(static_cast<std::uint32_t>(i));
        }
    }

    template <class T>
    static void upload(Array<T>& to, std::vector<T> const& values)
    {
        to.resize(values.size(), 0);
        to.upload(0, values);
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
        held_on_host_.resize(node_count);
        held_.download(0, held_on_host_);
        auto cells = coarse_cells(held_on_host_);
        if constexpr (spans_ranks<Backend>) {
            cells = detail::of_all_ranks(backend_, std::move(cells));
            CoarseGrid<d>::make_unique(cells);
        }
        return cells;
    }
    void make_levels(std::vector<Coordinates<d>> cells)
    {
        levels_.clear();
        std::size_t count = 0;
        for (bool goes_on = true; goes_on;) {
            goes_on = cells.size() > 1 && levels_.size() < most_levels - 1;
            levels_.push_back({{}, count, Links(backend_)});
            levels_.back().grid.begin(cells);
            count += levels_.back().size();
            for (auto& cell : cells) cell = coarse_cell<d>(cell);
            CoarseGrid<d>::make_unique(cells);
        }
        weights_.resize(count, 0);
        diagonals_.resize(count, 0);
        values_.resize(count, 0);
        products_.resize(first_count(), 0);
        upload(coarse_, levels_.front().grid.nodes());
        link_levels();
    }

    /// Links each grid with the finer one, and the first one with all coarser ones.
    void link_levels()
    {
        std::size_t const first = first_count();
        std::vector<LinksOfNode> last(first), to_coarser(first), to_first(values_.size() - first);
        for (std::size_t i = 0; i < first; ++i) last[i] = {{static_cast<std::uint32_t>(i), 1.0}};
        for (std::size_t l = 1; l < levels_.size(); ++l) {
            auto const up = link(levels_[l], levels_[l - 1].grid);
            for (std::size_t i = 0; i < first; ++i) { // through the grid in between
                LinksOfNode next;
                for (auto const& [node, w] : last[i])
                    for (auto const& [coarser, more] : up[node]) {
                        auto const found = std::ranges::find(next, coarser, &NodeWeight<double>::node);
                        if (found == next.end())
                            next.push_back({coarser, w * more});
                        else
                            found->weight += w * more;
                    }
                for (auto const& [node, w] : next) {
                    auto const number = static_cast<std::uint32_t>(levels_[l].offset + node - first);
                    to_coarser[i].push_back({number, w});
                    to_first[number].push_back({static_cast<std::uint32_t>(i), w});
                }
                last[i] = std::move(next);
            }
        }
        std::vector<std::uint32_t> first_of_node{0};
        std::vector<LinksOfNode> parts;
        for (auto const& links : to_first) {
            for (std::size_t i = 0; i < links.size(); i += links_of_part)
                parts.emplace_back(links.begin() + std::ptrdiff_t(i),
                                   links.begin() + std::ptrdiff_t(std::min(i + links_of_part, links.size())));
            first_of_node.push_back(static_cast<std::uint32_t>(parts.size()));
        }
        upload(first_of_node_, first_of_node);
        parts_.resize(parts.size(), 0);
        to_first_.set(parts);
        to_coarser_.set(to_coarser);
    }
    /// Links a grid with the finer one. Returns the finer nodes' links.
    static std::vector<LinksOfNode> link(Level& own, CoarseGrid<d> const& finer)
    {
        std::vector<LinksOfNode> down(own.size()), up(finer.nodes().size());
        for (std::size_t number = 0; number < own.size(); ++number) {
            Node const& node = own.grid.nodes()[number];
            for (int i = 0; i < Node::reached_count; ++i) {
                Coordinates<d> const way = Node::offset(i);
                std::uint32_t const from = finer.find(node.at * coarsening + way);
                if (from == Node::absent) continue;
                double const weight = node.template weight<double>(way);
                down[number].push_back({from, weight});
                up[from].push_back({static_cast<std::uint32_t>(number), weight});
            }
        }
        own.finer.set(down);
        return up;
    }

    Backend backend_;
    bool are_there_ = false;
    std::vector<Coordinates<d>> cells_; ///< those under which the grids were made
    CoarseExtent<d> extent_;
    std::vector<Level> levels_;
    Array<HeldCells<d>> held_;
    std::vector<HeldCells<d>> held_on_host_;
    Array<Node> coarse_; ///< the first grid's nodes
    Array<NodeWeight<Number>> reached_;
    Array<NodeInCoarse<Number, d>> linked_;
    std::vector<std::uint32_t> list_; ///< see list_linked()
    Array<CoarseWeights<Number, d>> weight_lines_;
    Array<Vector<Number, d>> lines_;
    Array<CoarseWeights<double, d>> weights_;     ///< of all grids' nodes
    Array<Vector<double, d>> diagonals_, values_; ///< one over these diagonals, and what is found by them
    Array<std::uint32_t> first_of_node_;          ///< of the parts of coarser nodes' sums
    Array<Vector<double, d>> parts_;
    Links to_first_, to_coarser_;
    Array<double> products_, of_sum_; ///< R c of the first grid's nodes, and parts of their sum
    // on several ranks, of the coarse nodes nearby: their numbers among all, and what they have found
    Array<std::uint32_t> numbers_;
    Array<CoarseWeights<double, d>> near_weights_;
    Array<Vector<double, d>> near_values_;
    CoarseOverRanks<Backend, Number, d> over_ranks_;
};

} // namespace firn

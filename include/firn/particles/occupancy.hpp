// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <numeric>
#include <utility>
#include <vector>

namespace firn
{

/// How the particles of a scene lie in its cells at one moment: whether there are enough of them, and whether
/// the material has separated.
struct Occupancy
{
    std::uint64_t particles = 0;
    std::uint64_t cells = 0;               ///< that have a particle
    std::vector<std::uint64_t> cells_with; ///< how many cells have 0, 1, 2, … particles; entry 0 is always 0
    double per_cell = 0; ///< particles per cell, the mean over inner cells, which have no empty cell around
                         ///< them; over all cells if none is inner
    std::uint64_t pieces = 0; ///< parts of the scene that share no node with one another: a body that has
                              ///< separated is several, as are bodies that do not touch
    std::uint64_t alone = 0;  ///< particles that share a node with no other

    /// A warning: there are fewer than nine tenths of the recommended 4 (plane) or 8 (space) particles per
    /// cell. Holes open in such a body as it deforms, and the nodes do not see some of its modes.
    bool too_few = false;
};

namespace detail
{
/// Finds which cells are connected: sorts them, then compares row by row along the last axis.
template <int d>
class CellNeighbours
{
public:
    /// `cells` has one entry per particle, the particle's cell.
    CellNeighbours(std::vector<Coordinates<d>> cells, int degree, Periods<d> const& periods) : degree_(degree)
    {
        std::sort(cells.begin(), cells.end(), is_before);
        std::vector<Cell> all;
        for (auto const& cell : cells) {
            if (all.empty() || all.back().at != cell) all.push_back({cell, 0, all.size(), 0});
            ++all.back().particles;
        }
        std::size_t const own = all.size();
        for (std::size_t i = 0; i < own; ++i) add_images(all, all[i].at, i, periods, 0, 0);
        std::vector<std::size_t> order(all.size()), place_of(all.size());
        std::iota(order.begin(), order.end(), std::size_t(0));
        std::stable_sort(order.begin(), order.end(),
                         [&](auto a, auto b) { return is_before(all[a].at, all[b].at); });
        for (std::size_t i = 0; i < order.size(); ++i) place_of[order[i]] = i;
        for (auto const i : order) {
            Cell const& cell = all[i];
            if (cells_.empty() || across(cells_.back()) != across(cell.at)) rows_.push_back(cells_.size());
            cells_.push_back(cell.at);
            count_.push_back(cell.particles);
            image_of_.push_back(place_of[cell.own]);
            beyond_.push_back(cell.beyond);
        }
        rows_.push_back(cells_.size());
        adjacent_.assign(cells_.size(), 0);
        parent_.resize(cells_.size());
        std::iota(parent_.begin(), parent_.end(), std::size_t(0));
        std::array<int, std::size_t(d - 1)> offset{};
        visit_offsets(offset, 0);
        for (std::size_t i = 0; i < cells_.size(); ++i) {
            if (!is_image(i)) continue;
            parent_[root(i)] = root(image_of_[i]);
            adjacent_[image_of_[i]] += adjacent_[i];
        }
    }

    Occupancy occupancy()
    {
        Occupancy found{.cells_with = {0}};
        std::uint64_t inner = 0, in_inner = 0;
        int all_around = 1;
        for (int a = 0; a < d; ++a) all_around *= 3;
        std::vector<std::uint64_t> in_piece(cells_.size(), 0);
        for (std::size_t i = 0; i < cells_.size(); ++i) {
            if (is_image(i)) continue;
            std::size_t const n = count_[i];
            ++found.cells;
            found.particles += n;
            if (found.cells_with.size() <= n) found.cells_with.resize(n + 1, 0);
            ++found.cells_with[n];
            in_piece[root(i)] += n;
            if (adjacent_[i] != all_around - 1) continue;
            ++inner;
            in_inner += n;
        }
        for (auto const n : in_piece) {
            found.pieces += n > 0;
            found.alone += n == 1;
        }
        if (found.cells == 0) return found;
        found.per_cell =
            inner > 0 ? double(in_inner) / double(inner) : double(found.particles) / double(found.cells);
        found.too_few = found.per_cell < 0.9 * (d == 2 ? 4 : 8);
        return found;
    }

private:
    using Across = std::array<int, std::size_t(d - 1)>;
    struct Cell
    {
        Coordinates<d> at;
        std::size_t particles; ///< 0: it is the image of a cell beyond the end of a period
        std::size_t own;       ///< that cell, or itself
        int beyond;            ///< along which axes it lies beyond the end: a bit for each
    };

    static bool is_before(Coordinates<d> const& a, Coordinates<d> const& b)
    {
        return std::lexicographical_compare(a.data(), a.data() + d, b.data(), b.data() + d);
    }
    bool is_image(std::size_t i) const { return image_of_[i] != i; }

    /// Adds the images, beyond the ends of periods, of a cell that lies at their begins.
    void add_images(std::vector<Cell>& all, Coordinates<d> at, std::size_t own, Periods<d> const& periods,
                    std::size_t axis, int beyond) const
    {
        for (std::size_t a = axis; a < std::size_t(d); ++a) {
            int const period = periods.of[a];
            if (period == 0 || at[int(a)] >= degree_) continue;
            Coordinates<d> image = at;
            image[int(a)] += period;
            all.push_back({image, 0, own, beyond | 1 << a});
            add_images(all, image, own, periods, a + 1, beyond | 1 << a);
        }
    }

    static Across across(Coordinates<d> const& cell)
    {
        Across of;
        for (std::size_t a = 0; a < of.size(); ++a) of[a] = cell[static_cast<int>(a)];
        return of;
    }

    /// Joins the cells of all rows with those of all rows near enough for their stencils to overlap; each
    /// pair once.
    void visit_offsets(Across& offset, std::size_t axis)
    {
        if (axis < offset.size()) {
            for (offset[axis] = -degree_; offset[axis] <= degree_; ++offset[axis])
                visit_offsets(offset, axis + 1);
            return;
        }
        if (offset < Across{}) return;
        std::size_t other = 0;
        for (std::size_t row = 0; row + 1 < rows_.size(); ++row) { // both advance in the same order
            Across wanted = across(cells_[rows_[row]]);
            for (std::size_t a = 0; a < wanted.size(); ++a) wanted[a] += offset[a];
            while (other + 1 < rows_.size() && across(cells_[rows_[other]]) < wanted) ++other;
            if (other + 1 == rows_.size()) return;
            if (across(cells_[rows_[other]]) == wanted) join_rows(row, other, offset);
        }
    }

    void join_rows(std::size_t row, std::size_t other, Across const& offset)
    {
        bool const near = std::all_of(offset.begin(), offset.end(), [](int o) { return o * o <= 1; });
        std::size_t first = rows_[other];
        for (std::size_t i = rows_[row]; i < rows_[row + 1]; ++i) {
            int const at = cells_[i][d - 1];
            if (row == other) first = i + 1;
            while (first < rows_[other + 1] && cells_[first][d - 1] < at - degree_) ++first;
            for (std::size_t j = first; j < rows_[other + 1] && cells_[j][d - 1] <= at + degree_; ++j) {
                parent_[root(i)] = root(j);
                if (!near || std::abs(cells_[j][d - 1] - at) > 1 || (beyond_[i] & beyond_[j]) != 0) continue;
                ++adjacent_[i];
                ++adjacent_[j];
            }
        }
    }

    /// The representative cell of a piece.
    std::size_t root(std::size_t i)
    {
        while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
        return i;
    }

    int degree_;
    std::vector<Coordinates<d>> cells_; ///< each once
    std::vector<std::uint64_t> count_;  ///< particles of each
    std::vector<int> adjacent_;         ///< how many cells around each have particles, too
    std::vector<std::size_t> image_of_; ///< a cell beyond the end of a period: that at its begin
    std::vector<int> beyond_;           ///< see Cell; two images beyond one end are the pair at its begin
    std::vector<std::size_t> parent_;
    std::vector<std::size_t> rows_; ///< where rows of cells begin, and the end of the last
};

/// The occupancy of cells of a lattice by the particles whose cells are listed.
template <int d>
Occupancy occupancy_of(std::vector<Coordinates<d>> cells, int degree, Lattice const& lattice)
{
    return CellNeighbours<d>(std::move(cells), degree, periods_of<d>(lattice)).occupancy();
}
} // namespace detail

} // namespace firn

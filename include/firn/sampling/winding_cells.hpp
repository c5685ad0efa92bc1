// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/io/weld.hpp>
#include <firn/sampling/interior.hpp>
#include <firn/sampling/winding_number.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

namespace firn::detail
{

/// Tells whether a surface winds around a point by more than one half, in a fraction of the time that its
/// winding number takes: an octree that stores for each cell the winding number at one of the cell's points.
///
/// From there to any other point of the cell the winding number jumps by one at each triangle between the
/// two, and else changes only because of open edges: its gradient is the Biot-Savart integral 1/4π ∫ r × dl /
/// r³ over them. That is computed at the cell's centre, and changes by at most 1/4π ∫ 2 dl / r³ for each
/// metre from there. Where this bound does not decide, the winding number itself does.
class WindingCells
{
public:
    /// `progress(share)` is called from this thread, with shares up to 1.
    template <class Loop, class Progress>
    WindingCells(TriangleMesh const& mesh, Eigen::AlignedBox3d const& box, Loop const& loop,
                 Progress const& progress)
        : winding_(mesh), box_(box)
    {
        for (auto const& [i, j, k] : mesh.triangles) {
            auto const &a = mesh.vertices[i], &b = mesh.vertices[j], &c = mesh.vertices[k];
            triangles_.push_back({a, b, c, (b - a).cross(c - a)});
        }
        find_open_edges(mesh);
        auto level = roots();
        for (int depth = 0; !level.empty(); ++depth) {
            std::vector<std::vector<Growing>> children(level.size());
            constexpr std::size_t batch = 4096;
            for (std::size_t first = 0; first < level.size(); first += batch) {
                auto const count = std::min(batch, level.size() - first);
                loop.for_each(count,
                              [&](std::size_t i) { children[first + i] = grow(level[first + i], depth); });
                progress((depth + double(first + count) / double(level.size())) / (most_levels + 1));
            }
            level = keep(level, children);
        }
        progress(1.0);
    }

    /// Whether the surface winds around `x` [m], which lies in the box, by more than one half.
    bool contains(Eigen::Vector3d const& x) const
    {
        auto cell = root_of(x);
        while (cells_[cell].first_child != 0)
            cell = cells_[cell].first_child + octant(x, cells_[cell].centre);
        return contains(x, cells_[cell]);
    }

    /// A part of the box: wholly inside, wholly outside, or perhaps cut by the surface.
    struct Leaf
    {
        Eigen::AlignedBox3d box;
        bool cut;      ///< the surface may pass through it
        bool inside;   ///< if it is not cut
        bool doubtful; ///< if it may be cut: each point needs a winding number
        std::size_t cell;
    };

    std::vector<Leaf> leaves() const
    {
        std::vector<Leaf> result;
        for (std::size_t i = 0; i < cells_.size(); ++i) {
            auto const& cell = cells_[i];
            if (cell.first_child != 0) continue;
            result.push_back({{cell.centre - cell.half, cell.centre + cell.half},
                              cell.side == Side::both,
                              cell.side == Side::inside,
                              cell.doubt >= 0.5,
                              i});
        }
        return result;
    }

    bool contains(Eigen::Vector3d const& x, Leaf const& leaf) const { return contains(x, cells_[leaf.cell]); }

private:
    static constexpr int roots_along = 2, usual_levels = 5, most_levels = 8;
    static constexpr std::size_t few_triangles = 12;
    /// The error of a winding number (see WindingNumber), and the uncertainty up to which it is passed on
    /// from cell to cell before it is computed anew.
    static constexpr double error_of_winding = 0.06, most_doubt = 0.2;

    struct Triangle
    {
        Eigen::Vector3d a, b, c, normal;
    };

    /// An edge along which more triangles run from `a` to `b` than the other way.
    struct OpenEdge
    {
        Eigen::Vector3d a, b;
        double difference;

        double distance(Eigen::Vector3d const& x) const
        {
            Eigen::Vector3d const along = b - a;
            double const share = std::clamp(along.dot(x - a) / along.squaredNorm(), 0.0, 1.0);
            return (a + share * along - x).norm();
        }
        /// What it adds to the gradient of the winding number [1/m].
        Eigen::Vector3d gradient(Eigen::Vector3d const& x) const
        {
            Eigen::Vector3d const p = a - x, q = b - x;
            double const np = p.norm(), nq = q.norm();
            return difference / (4 * std::numbers::pi) * (np + nq) / (np * nq * (np * nq + p.dot(q))) *
                   p.cross(q);
        }
        /// A bound on how fast that changes, at this distance from the edge or beyond [1/m²].
        double change(double apart) const
        {
            if (!(apart > 0)) return std::numeric_limits<double>::infinity();
            return std::abs(difference) / (2 * std::numbers::pi * apart * apart) *
                   std::min((b - a).norm() / apart, 2.0);
        }
    };

    enum class Side : char
    {
        outside,
        inside,
        both
    };

    struct Cell
    {
        Eigen::Vector3d centre, half, known_at;
        Eigen::Vector3d gradient = Eigen::Vector3d::Zero(); ///< of the winding number, jumps aside
        double winding = 0;                                 ///< at `known_at`
        double doubt = 0;            ///< bound on its error anywhere in the cell, jumps aside
        std::size_t first_child = 0; ///< of eight; 0: none
        std::size_t first = 0, last = 0;
        Side side = Side::both;
    };

    struct Growing
    {
        Cell cell;
        double error = 0;                                   ///< of the winding number at `known_at`
        Eigen::Vector3d gradient = Eigen::Vector3d::Zero(); ///< from open edges far away, at some point here
        double gradient_error = 0;                          ///< bound on its change within the cell
        std::vector<std::uint32_t> triangles, open_edges;   ///< that may be in the cell or near it
        std::size_t at = 0;                                 ///< its place in the tree
    };

    static std::size_t octant(Eigen::Vector3d const& x, Eigen::Vector3d const& centre)
    {
        return std::size_t(x.x() > centre.x()) + 2 * std::size_t(x.y() > centre.y()) +
               4 * std::size_t(x.z() > centre.z());
    }

    std::size_t root_of(Eigen::Vector3d const& x) const
    {
        Eigen::Array3d const at = ((x - box_.min()).array() / root_size_).min(root_count_ - 1).max(0).floor();
        return static_cast<std::size_t>(at[0] + root_count_[0] * (at[1] + root_count_[1] * at[2]));
    }

    bool contains(Eigen::Vector3d const& x, Cell const& cell) const
    {
        if (cell.side != Side::both) return cell.side == Side::inside;
        if (cell.doubt < 0.5) {
            double winding = cell.winding + cell.gradient.dot(x - cell.known_at);
            for (auto i = cell.first; i < cell.last; ++i)
                winding += jump(triangles_[in_cells_[i]], cell.known_at, x);
            if (std::abs(winding - 0.5) > cell.doubt) return winding > 0.5;
        }
        return winding_(x) > 0.5;
    }

    /// By how much the winding number jumps at a triangle on the way from p to q.
    static int jump(Triangle const& t, Eigen::Vector3d const& p, Eigen::Vector3d const& q)
    {
        bool const from_front = (p - t.a).dot(t.normal) > 0;
        if (from_front == ((q - t.a).dot(t.normal) > 0)) return 0;
        // the triangle beyond an edge has the same numbers but for their sign, so no line passes between the
        // two
        Eigen::Vector3d const way = q - p, a = t.a - p, b = t.b - p, c = t.c - p;
        double const ab = way.dot(a.cross(b)), bc = way.dot(b.cross(c)), ca = way.dot(c.cross(a));
        bool const through = (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
        return !through ? 0 : from_front ? 1 : -1;
    }

    void find_open_edges(TriangleMesh const& mesh)
    {
        Weld weld; // by position: vertices may have been doubled to separate surfaces
        std::vector<std::uint32_t> number;
        for (auto const& x : mesh.vertices) number.push_back(weld(x));
        std::vector<std::array<std::uint32_t, 4>> edges; // by number; the vertices, in the triangle's order
        for (auto const& t : mesh.triangles)
            for (std::size_t i = 0; i < 3; ++i) {
                auto const a = t[i], b = t[(i + 1) % 3];
                auto const [low, high] = std::minmax(number[a], number[b]);
                edges.push_back({low, high, a, b});
            }
        std::ranges::sort(edges);
        for (auto at = edges.begin(); at != edges.end();) {
            auto const same = [&](auto const& e) { return e[0] == (*at)[0] && e[1] == (*at)[1]; };
            auto const next = std::find_if_not(at, edges.end(), same);
            int difference = 0;
            for (auto e = at; e != next; ++e) difference += number[(*e)[2]] == (*e)[0] ? 1 : -1;
            bool const from_low = number[(*at)[2]] == (*at)[0];
            auto const &a = mesh.vertices[(*at)[from_low ? 2 : 3]],
                       &b = mesh.vertices[(*at)[from_low ? 3 : 2]];
            if (difference != 0) open_edges_.push_back({a, b, double(difference)});
            at = next;
        }
    }

    /// About `roots_along`³ equal parts of the box, as nearly cubes as it allows.
    std::vector<Growing> roots()
    {
        double const h = std::cbrt(box_.volume()) / roots_along;
        root_count_ = (box_.sizes().array() / h).ceil().max(1).min(std::pow(roots_along, 3));
        root_size_ = box_.sizes().array() / root_count_;
        std::vector<Growing> level(static_cast<std::size_t>(root_count_.prod()));
        for (std::size_t i = 0; i < level.size(); ++i) {
            auto const nx = static_cast<std::size_t>(root_count_[0]),
                       ny = static_cast<std::size_t>(root_count_[1]);
            Eigen::Array3d const at{double(i % nx), double(i / nx % ny), double(i / nx / ny)};
            auto& cell = level[i].cell;
            level[i].at = i;
            cell.half = 0.5 * root_size_;
            cell.centre = box_.min().array() + (at + 0.5) * root_size_;
            cell.known_at = somewhere_in(cell, i);
            level[i].error = most_doubt; // so that it is computed
            level[i].open_edges.resize(open_edges_.size());
            std::iota(level[i].open_edges.begin(), level[i].open_edges.end(), 0u);
        }
        for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
            auto const& [a, b, c, normal] = triangles_[t];
            Eigen::Vector3d const lowest = a.cwiseMin(b).cwiseMin(c), highest = a.cwiseMax(b).cwiseMax(c);
            // with a margin: a triangle on a face between parts belongs to both
            Eigen::Array3d const low = ((lowest - box_.min()).array() / root_size_ - 1e-6).floor().max(0);
            Eigen::Array3d const high =
                ((highest - box_.min()).array() / root_size_ + 1e-6).floor().min(root_count_ - 1);
            for (double z = low[2]; z <= high[2]; ++z)
                for (double y = low[1]; y <= high[1]; ++y)
                    for (double x = low[0]; x <= high[0]; ++x) {
                        auto& root =
                            level[static_cast<std::size_t>(x + root_count_[0] * (y + root_count_[1] * z))];
                        if (touches(triangles_[t], root.cell)) root.triangles.push_back(t);
                    }
        }
        cells_.resize(level.size());
        return level;
    }

    /// A place in general position, so that no line from it runs along a triangle.
    static Eigen::Vector3d somewhere_in(Cell const& cell, std::uint64_t seed)
    {
        UnitRandom random(seed);
        return cell.centre.array() + (random.vector() - 0.5) * cell.half.array();
    }

    /// Whether a triangle may touch a cell: its box and its plane do.
    static bool touches(Triangle const& t, Cell const& cell)
    {
        Eigen::Vector3d const half = cell.half * (1 + 1e-6), a = t.a - cell.centre, b = t.b - cell.centre,
                              c = t.c - cell.centre;
        if ((a.cwiseMin(b).cwiseMin(c).array() > half.array()).any() ||
            (a.cwiseMax(b).cwiseMax(c).array() < -half.array()).any())
            return false;
        return std::abs(a.dot(t.normal)) <= half.dot(t.normal.cwiseAbs()) * (1 + 1e-6);
    }

    /// Decides on a cell, or returns its eight parts.
    std::vector<Growing> grow(Growing& grown, int depth) const
    {
        Cell& cell = grown.cell;
        double const radius = cell.half.norm();
        Eigen::Vector3d near = Eigen::Vector3d::Zero();
        double near_error = 0;
        std::erase_if(grown.open_edges, [&](auto e) {
            auto const& edge = open_edges_[e];
            double const apart = edge.distance(cell.centre) - radius, error = edge.change(apart) * radius;
            bool const is_far = apart > 3 * radius;
            (is_far ? grown.gradient_error : near_error) += error;
            if (is_finite(error)) (is_far ? grown.gradient : near) += edge.gradient(cell.centre);
            return is_far;
        });
        cell.gradient = grown.gradient + near;
        double const change = (grown.gradient_error + near_error) * 2 * radius;
        if (grown.error >= most_doubt) {
            cell.winding = winding_(cell.known_at);
            grown.error = error_of_winding;
        }
        cell.doubt = grown.error + change;
        double const in_middle = cell.winding + cell.gradient.dot(cell.centre - cell.known_at);
        double const slope = cell.gradient.cwiseAbs().dot(cell.half);
        bool const certain = std::abs(in_middle - 0.5) > cell.doubt + slope;
        if (grown.triangles.empty() && certain) {
            cell.side = cell.winding > 0.5 ? Side::inside : Side::outside;
            return {};
        }
        bool const crowded = grown.triangles.size() > few_triangles;
        if (depth >= (crowded ? most_levels : usual_levels)) return {};

        std::vector<Growing> parts(8);
        for (std::size_t octant = 0; octant < 8; ++octant) {
            auto& part = parts[octant];
            part.cell.half = cell.half / 2;
            for (int i = 0; i < 3; ++i)
                part.cell.centre[i] = cell.centre[i] + (octant >> i & 1 ? 0.5 : -0.5) * cell.half[i];
            part.cell.known_at = somewhere_in(part.cell, octant);
            part.cell.winding = cell.winding + cell.gradient.dot(part.cell.known_at - cell.known_at);
            for (auto const t : grown.triangles) {
                part.cell.winding += jump(triangles_[t], cell.known_at, part.cell.known_at);
                if (touches(triangles_[t], part.cell)) part.triangles.push_back(t);
            }
            part.error = std::min(grown.error + change, most_doubt);
            part.gradient = grown.gradient;
            part.gradient_error = grown.gradient_error;
            part.open_edges = grown.open_edges;
        }
        return parts;
    }

    /// Adds a level of cells to the tree; returns the next level.
    std::vector<Growing> keep(std::vector<Growing>& level, std::vector<std::vector<Growing>>& children)
    {
        std::vector<Growing> next;
        for (std::size_t i = 0; i < level.size(); ++i) {
            auto& grown = level[i];
            if (!children[i].empty()) {
                grown.cell.first_child = cells_.size();
                for (auto& part : children[i]) {
                    part.at = cells_.size();
                    cells_.emplace_back();
                    next.push_back(std::move(part));
                }
            }
            else if (grown.cell.side == Side::both) {
                grown.cell.first = in_cells_.size();
                in_cells_.insert(in_cells_.end(), grown.triangles.begin(), grown.triangles.end());
                grown.cell.last = in_cells_.size();
            }
            cells_[grown.at] = grown.cell;
        }
        return next;
    }

    WindingNumber winding_;
    Eigen::AlignedBox3d box_;
    Eigen::Array3d root_count_, root_size_;
    std::vector<Triangle> triangles_;
    std::vector<OpenEdge> open_edges_;
    std::vector<Cell> cells_;
    std::vector<std::uint32_t> in_cells_;
};

} // namespace firn::detail

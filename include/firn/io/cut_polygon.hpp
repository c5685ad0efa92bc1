// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

// Cuts polygons of any shape into triangles. The libraries at hand do not serve here: CGAL's triangulations
// are GPL, which reading a file must not require; assimp and earcut drop straight corners or fail at doubled
// edges. Every edge of a polygon must be an edge of a triangle, or the neighbour's edge stays open.
namespace firn::detail
{

/// A sum of up to twelve numbers without rounding, kept as parts that do not overlap: J. R. Shewchuk,
/// *Adaptive precision floating-point arithmetic and fast robust geometric predicates* (1997), theorem 10.
class ExactSum
{
public:
    void add(double x)
    {
        for (std::size_t i = 0; i < count_; ++i) {
            double const sum = x + parts_[i], from_part = sum - x;
            parts_[i] = (x - (sum - from_part)) + (parts_[i] - from_part);
            x = sum;
        }
        parts_[count_++] = x;
    }
    void add_product(double a, double b)
    {
        double const product = a * b;
        add(std::fma(a, b, -product));
        add(product);
    }
    int sign() const
    {
        for (auto i = count_; i > 0; --i)
            if (!exactly_equal(parts_[i - 1], 0)) return parts_[i - 1] > 0 ? 1 : -1;
        return 0;
    }

private:
    std::array<double, 12> parts_{};
    std::size_t count_ = 0;
};

/// 1 if a, b, c turn left, -1 if they turn right, 0 if they lie on a line: exactly.
inline int turn(Eigen::Vector2d const& a, Eigen::Vector2d const& b, Eigen::Vector2d const& c)
{
    double const left = (a.x() - c.x()) * (b.y() - c.y()), right = (a.y() - c.y()) * (b.x() - c.x());
    constexpr double unit = std::numeric_limits<double>::epsilon() / 2;
    double const error = (3 + 16 * unit) * unit * (std::abs(left) + std::abs(right)); // Shewchuk's bound A
    if (left - right > error) return 1;
    if (right - left > error) return -1;
    ExactSum sum; // a × b + b × c + c × a
    sum.add_product(a.x(), b.y());
    sum.add_product(-a.y(), b.x());
    sum.add_product(b.x(), c.y());
    sum.add_product(-b.y(), c.x());
    sum.add_product(c.x(), a.y());
    sum.add_product(-c.y(), a.x());
    return sum.sign();
}

/// Cuts a polygon into triangles: ear clipping, then flips to a constrained Delaunay triangulation.
///
/// Corners may be concave or straight, and holes may be connected with the outline by doubled edges. Every
/// edge of the polygon is an edge of a triangle, and none of a planar polygon's triangles is flat.
class PolygonCutter
{
public:
    using Triangle = std::array<std::uint32_t, 3>; ///< corners of the polygon, from 0

    /// Cuts the polygon with these corners, counter-clockwise from outside. A polygon that crosses itself is
    /// cut in some way; one of fewer than three different corners gives no triangles.
    std::vector<Triangle> const& operator()(std::span<Eigen::Vector3d const> corners)
    {
        triangles_.clear();
        corners_ = corners;
        keep_.clear();
        for (std::uint32_t i = 0; i < corners.size(); ++i)
            if (keep_.empty() || corners[i] != corners[keep_.back()]) keep_.push_back(i);
        while (keep_.size() > 1 && corners[keep_.front()] == corners[keep_.back()]) keep_.pop_back();
        if (keep_.size() < 3) return triangles_;
        if (keep_.size() == 3) {
            triangles_.push_back({keep_[0], keep_[1], keep_[2]});
            return triangles_;
        }
        // Dropping one coordinate leaves the others exact; a warped polygon may need its best plane.
        Eigen::Vector3d const normal = area_vector();
        if (!clip_along_axis(normal) && !clip_in_plane(normal)) clip_along_axis(normal);
        flip();
        return triangles_;
    }

private:
    struct Corner
    {
        Eigen::Vector2d x;
        std::uint32_t before, after;
        bool convex;
    };

    Eigen::Vector3d const& place(std::uint32_t i) const { return corners_[keep_[i]]; }

    Eigen::Vector3d area_vector() const
    {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (std::uint32_t i = 1; i + 1 < keep_.size(); ++i)
            sum += (place(i) - place(0)).cross(place(i + 1) - place(0));
        return sum;
    }

    bool clip_along_axis(Eigen::Vector3d const& normal)
    {
        int axis;
        normal.cwiseAbs().maxCoeff(&axis);
        int first = (axis + 1) % 3, second = (axis + 2) % 3;
        if (normal[axis] < 0) std::swap(first, second);
        return clip([&](Eigen::Vector3d const& x) { return Eigen::Vector2d{x[first], x[second]}; });
    }

    bool clip_in_plane(Eigen::Vector3d const& normal)
    {
        if (!(normal.squaredNorm() > 0)) return false;
        Eigen::Vector3d const n = normal.normalized(), u = n.unitOrthogonal(), v = n.cross(u);
        Eigen::Vector3d const origin = place(0);
        return clip([&](Eigen::Vector3d const& x) {
            Eigen::Vector3d const r = x - origin;
            return Eigen::Vector2d{u.dot(r), v.dot(r)};
        });
    }

    /// Cuts off one corner after the other; false if a corner that is no ear had to be cut off.
    template <class Project>
    bool clip(Project const& project)
    {
        triangles_.clear();
        auto const count = static_cast<std::uint32_t>(keep_.size());
        ring_.resize(count);
        for (std::uint32_t i = 0; i < count; ++i)
            ring_[i] = {project(place(i)), (i + count - 1) % count, (i + 1) % count, false};
        for (std::uint32_t i = 0; i < count; ++i) judge(i);
        bool clean = true;
        std::uint32_t at = 0, left = count, tried = 0;
        while (left > 3) {
            auto const [before, after] = std::pair{ring_[at].before, ring_[at].after};
            if (is_ear(at)) {
                triangles_.push_back({before, at, after});
                take_out(at);
                --left;
                tried = 0;
                at = ring_[after].after; // not a fan: the next but one
            }
            else if (++tried < left)
                at = after;
            else { // no ear: the tip of a doubled edge that is left over, or a polygon that crosses itself
                if (auto const tip = doubled(at, left)) {
                    take_out(*tip);
                    at = ring_[*tip].after;
                    take_out(at);
                    at = ring_[at].after;
                    left -= 2;
                }
                else {
                    clean = false;
                    triangles_.push_back({before, at, after});
                    take_out(at);
                    --left;
                    at = after;
                }
                tried = 0;
            }
        }
        if (left == 3) triangles_.push_back({ring_[at].before, at, ring_[at].after});
        return clean && (left < 3 || ring_[at].convex);
    }

    void take_out(std::uint32_t i)
    {
        auto const before = ring_[i].before, after = ring_[i].after;
        ring_[before].after = after;
        ring_[after].before = before;
        ring_[i].convex = true; // blocks no ear any more
        judge(before);
        judge(after);
    }

    void judge(std::uint32_t i)
    {
        ring_[i].convex = turn(ring_[ring_[i].before].x, ring_[i].x, ring_[ring_[i].after].x) > 0;
    }

    /// A corner between two neighbours that coincide, in the rest of the ring.
    std::optional<std::uint32_t> doubled(std::uint32_t at, std::uint32_t left) const
    {
        for (; left > 0; --left, at = ring_[at].after)
            if (ring_[ring_[at].before].x == ring_[ring_[at].after].x) return at;
        return {};
    }

    bool is_ear(std::uint32_t tip) const
    {
        if (!ring_[tip].convex) return false;
        auto const &p = ring_[ring_[tip].before].x, &t = ring_[tip].x, &n = ring_[ring_[tip].after].x;
        Eigen::Vector2d const low = p.cwiseMin(t).cwiseMin(n), high = p.cwiseMax(t).cwiseMax(n);
        for (auto i = ring_[ring_[tip].after].after; i != ring_[tip].before; i = ring_[i].after)
            if (!ring_[i].convex && (ring_[i].x.array() >= low.array()).all() &&
                (ring_[i].x.array() <= high.array()).all() && blocks(i, p, t, n))
                return false;
        return !enters(ring_[ring_[ring_[tip].before].before].x, p, t, n) &&
               !enters(ring_[ring_[ring_[tip].after].after].x, n, p, t);
    }

    /// Whether corner i lies in the triangle or, where it coincides with one of the triangle's corners,
    /// whether its edges enter the triangle.
    bool blocks(std::uint32_t i, Eigen::Vector2d const& p, Eigen::Vector2d const& t,
                Eigen::Vector2d const& n) const
    {
        auto const& x = ring_[i].x;
        auto const edges_enter = [&](auto const& corner, auto const& next, auto const& last) {
            return enters(ring_[ring_[i].before].x, corner, next, last) ||
                   enters(ring_[ring_[i].after].x, corner, next, last);
        };
        if (x == p) return edges_enter(p, t, n);
        if (x == t) return edges_enter(t, n, p);
        if (x == n) return edges_enter(n, p, t);
        return turn(p, t, x) >= 0 && turn(t, n, x) >= 0 && turn(n, p, x) >= 0;
    }

    /// Whether the line from a triangle's corner to `x` starts between the sides to the next and to the last
    /// corner.
    static bool enters(Eigen::Vector2d const& x, Eigen::Vector2d const& corner, Eigen::Vector2d const& next,
                       Eigen::Vector2d const& last)
    {
        return turn(corner, next, x) > 0 && turn(corner, last, x) < 0;
    }

    /// Flips diagonals until none has a triangle's corner within another one's circle (C. L. Lawson, 1977),
    /// where both new triangles are sound as seen along the projection.
    void flip()
    {
        opposite_.clear();
        std::vector<std::pair<std::uint32_t, std::uint32_t>> doubtful;
        for (auto const& t : triangles_)
            for (std::size_t i = 0; i < 3; ++i) {
                opposite_[{t[i], t[(i + 1) % 3]}] = t[(i + 2) % 3];
                doubtful.emplace_back(t[i], t[(i + 1) % 3]);
            }
        auto flips_left = keep_.size() * keep_.size(); // rounding must not make it flip for ever
        while (!doubtful.empty() && flips_left > 0) {
            auto const [a, b] = doubtful.back();
            doubtful.pop_back();
            auto const here = opposite_.find({a, b}), there = opposite_.find({b, a});
            if (here == opposite_.end() || there == opposite_.end()) continue;
            auto const c = here->second, d = there->second;
            if (!(cotangent(c, a, b) + cotangent(d, b, a) < -1e-9)) continue;
            auto const& x = [&](std::uint32_t i) -> auto const& { return ring_[i].x; };
            if (turn(x(c), x(a), x(d)) <= 0 || turn(x(d), x(b), x(c)) <= 0) continue;
            opposite_.erase(here);
            opposite_.erase(there);
            opposite_[{c, a}] = opposite_[{b, c}] = d;
            opposite_[{a, d}] = opposite_[{d, b}] = c;
            opposite_[{d, c}] = a;
            opposite_[{c, d}] = b;
            for (auto const& edge : {std::pair{c, a}, {a, d}, {d, b}, {b, c}}) doubtful.push_back(edge);
            --flips_left;
        }
        triangles_.clear();
        for (auto const& [edge, c] : opposite_)
            if (edge.first < edge.second && edge.first < c)
                triangles_.push_back({keep_[edge.first], keep_[edge.second], keep_[c]});
    }

    /// The cotangent of the angle at corner `c` between `a` and `b`.
    double cotangent(std::uint32_t c, std::uint32_t a, std::uint32_t b) const
    {
        Eigen::Vector3d const to_a = place(a) - place(c), to_b = place(b) - place(c);
        return to_a.dot(to_b) / to_a.cross(to_b).norm();
    }

    std::span<Eigen::Vector3d const> corners_;
    std::vector<std::uint32_t> keep_; ///< corners without those that repeat the one before
    std::vector<Corner> ring_;
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t>
        opposite_; ///< the corner left of an edge
    std::vector<Triangle> triangles_;
};

} // namespace firn::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/cut_polygon.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// A region of the plane within a closed loop of corners [m], and outside of others, to be filled with
/// points. Loops may run in either direction. What an odd number of them surrounds is inside, so there may be
/// islands in holes, and other outlines beside the first.
class Polygon
{
public:
    using Loop = std::vector<Eigen::Vector2d>;

    /// Throws an Error if a loop has less than three corners, a corner is not finite or beyond 1e15 m, edges
    /// cross or touch one another, or nothing is inside.
    explicit Polygon(Loop outline, std::vector<Loop> holes = {}) : loops_(std::move(holes))
    {
        loops_.insert(loops_.begin(), std::move(outline));
        for (std::size_t l = 0; l < loops_.size(); ++l) {
            std::string const where = "Polygon, loop " + std::to_string(l);
            require(loops_[l].size() >= 3, "it has less than three corners", where.c_str(),
                    "Pass the corners in the order along the loop, each once.");
            for (Eigen::Vector2d const& x : loops_[l]) {
                require(is_between(-1e15, x.x(), 1e15) && is_between(-1e15, x.y(), 1e15),
                        "a corner is not finite, or beyond 1e15 m", where.c_str(), "Pass metres.");
                box_.extend(x);
            }
        }
        require_no_crossings();
        for (std::size_t l = 0; l < loops_.size(); ++l) {
            int around = 0;
            for (std::size_t other = 0; other < loops_.size(); ++other)
                if (other != l) around += surrounds(loops_[other], loops_[l].front()) ? 1 : 0;
            area_ += (around % 2 == 0 ? 1 : -1) * std::abs(area_of(loops_[l]));
        }
        require(area_ > 0, "there is nothing inside", "Polygon", "Pass an outline.");
    }

    bool contains(Eigen::Vector2d const& x) const
    {
        bool inside = false;
        for (Loop const& loop : loops_) inside = inside != surrounds(loop, x);
        return inside;
    }
    double area() const { return area_; } ///< [m^2]
    Eigen::AlignedBox2d const& bounding_box() const { return box_; }

private:
    /// Whether a ray from a point crosses a loop an odd number of times.
    static bool surrounds(Loop const& loop, Eigen::Vector2d const& x)
    {
        bool inside = false;
        for (std::size_t i = 0, before = loop.size() - 1; i < loop.size(); before = i++) {
            Eigen::Vector2d const &a = loop[before], &b = loop[i];
            if ((a.y() > x.y()) == (b.y() > x.y())) continue;
            // the ray to the right meets the edge: x lies left of it, seen upwards
            int const side = detail::turn(a, b, x);
            if (a.y() < b.y() ? side > 0 : side < 0) inside = !inside;
        }
        return inside;
    }

    static double area_of(Loop const& loop)
    {
        double twice = 0;
        for (std::size_t i = 0; i < loop.size(); ++i) { // from the first corner, or far from 0 all is rounded
            Eigen::Vector2d const a = loop[i] - loop[0], b = loop[(i + 1) % loop.size()] - loop[0];
            twice += a.x() * b.y() - a.y() * b.x();
        }
        return twice / 2;
    }

    void require_no_crossings() const
    {
        struct Edge
        {
            std::size_t loop, from, to;
        };
        std::vector<Edge> edges;
        for (std::size_t l = 0; l < loops_.size(); ++l)
            for (std::size_t i = 0; i < loops_[l].size(); ++i)
                edges.push_back({l, i, (i + 1) % loops_[l].size()});
        for (std::size_t i = 0; i < edges.size(); ++i)
            for (std::size_t j = i + 1; j < edges.size(); ++j) {
                Edge const &one = edges[i], &other = edges[j];
                bool const are_neighbours =
                    one.loop == other.loop && (one.to == other.from || other.to == one.from);
                Eigen::Vector2d const &a = loops_[one.loop][one.from], &b = loops_[one.loop][one.to],
                                      &c = loops_[other.loop][other.from], &e = loops_[other.loop][other.to];
                if (!are_neighbours && meet(a, b, c, e))
                    throw Error{"edge " + std::to_string(one.from) + " of loop " + std::to_string(one.loop) +
                                    " meets edge " + std::to_string(other.from) + " of loop " +
                                    std::to_string(other.loop),
                                "Polygon", "Pass loops that neither cross nor touch themselves or others."};
            }
    }

    static bool meet(Eigen::Vector2d const& a, Eigen::Vector2d const& b, Eigen::Vector2d const& c,
                     Eigen::Vector2d const& e)
    {
        Eigen::AlignedBox2d one(a), other(c);
        one.extend(b);
        other.extend(e);
        if (!one.intersects(other)) return false;
        return detail::turn(a, b, c) * detail::turn(a, b, e) <= 0 &&
               detail::turn(c, e, a) * detail::turn(c, e, b) <= 0;
    }

    std::vector<Loop> loops_;
    Eigen::AlignedBox2d box_;
    double area_ = 0;
};

} // namespace firn

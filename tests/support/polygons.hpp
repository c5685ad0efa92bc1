// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

/// Polygons of many shapes, and the prisms over them as files.
namespace polygons
{

using Eigen::Vector2d;
using Eigen::Vector3d;

struct Profile
{
    char const* name;
    std::vector<Vector2d> outline; ///< counter-clockwise
};

inline std::vector<Profile> profiles()
{
    std::vector<Profile> result{
        {"L", {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}},
        {"T", {{1, 0}, {2, 0}, {2, 2}, {3, 2}, {3, 3}, {0, 3}, {0, 2}, {1, 2}}},
        {"U", {{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}}},
        {"plus",
         {{1, 0}, {2, 0}, {2, 1}, {3, 1}, {3, 2}, {2, 2}, {2, 3}, {1, 3}, {1, 2}, {0, 2}, {0, 1}, {1, 1}}},
        {"star", {{0, -5}, {1, -1}, {5, 0}, {1, 1}, {0, 5}, {-1, 1}, {-5, 0}, {-1, -1}}},
        {"arrow", {{0, 1}, {4, 1}, {4, 0}, {7, 2}, {4, 4}, {4, 3}, {0, 3}, {1, 2}}},
        {"spiral",
         {{0, 0},
          {7, 0},
          {7, 7},
          {0, 7},
          {0, 2},
          {5, 2},
          {5, 5},
          {2, 5},
          {2, 4},
          {4, 4},
          {4, 3},
          {1, 3},
          {1, 6},
          {6, 6},
          {6, 1},
          {0, 1}}},
        // straight corners along all edges, three in a row along some
        {"stairs",
         {{0, 0},
          {1, 0},
          {2, 0},
          {3, 0},
          {4, 0},
          {4, 1},
          {3, 1},
          {3, 2},
          {2, 2},
          {2, 3},
          {1, 3},
          {1, 4},
          {0, 4},
          {0, 3},
          {0, 2},
          {0, 1}}},
        {"square with a hole",
         {{0, 0}, {3, 0}, {3, 3}, {0, 3}, {0, 0}, {1, 1}, {1, 2}, {2, 2}, {2, 1}, {1, 1}}},
        {"two holes from one corner",
         {{0, 0},
          {7, 0},
          {7, 3},
          {0, 3},
          {0, 0},
          {1, 1},
          {1, 2},
          {2, 2},
          {2, 1},
          {1, 1},
          {0, 0},
          {4, 1},
          {4, 2},
          {5, 2},
          {6, 2},
          {6, 1},
          {5, 1},
          {4, 1}}},
    };
    Profile comb{"comb", {{0, 0}, {9, 0}}};
    for (int tooth = 4; tooth >= 0; --tooth) {
        for (auto const& x : {Vector2d{2 * tooth + 1, 1}, {2 * tooth + 1, 5}, {2 * tooth, 5}, {2 * tooth, 1}})
            comb.outline.push_back(x);
    }
    result.push_back(comb);
    return result;
}

/// Polygons, each a list of vertices.
struct Polygons
{
    std::vector<Vector3d> vertices;
    std::vector<std::vector<std::size_t>> faces;

    std::string obj() const
    {
        std::ostringstream text;
        text.precision(17);
        for (auto const& x : vertices) text << "v " << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
        for (auto const& face : faces) {
            text << 'f';
            for (auto const i : face) text << ' ' << i + 1;
            text << '\n';
        }
        return text.str();
    }
    std::string ply() const
    {
        std::ostringstream text;
        text << "ply\nformat ascii 1.0\nelement vertex " << vertices.size()
             << "\nproperty float x\nproperty float y\nproperty float z\nelement face " << faces.size()
             << "\nproperty list uchar int vertex_indices\nend_header\n";
        for (auto const& x : vertices) text << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
        for (auto const& face : faces) {
            text << face.size();
            for (auto const i : face) text << ' ' << i;
            text << '\n';
        }
        return text.str();
    }
};

/// The prism of height 2 over a profile: two polygons, and a quadrilateral over each edge that is not
/// doubled.
inline Polygons prism(std::vector<Vector2d> const& outline)
{
    Polygons result;
    std::map<std::pair<double, double>, std::size_t> number;
    std::vector<std::size_t> ring;
    for (auto const& x : outline) {
        auto const [at, is_new] = number.try_emplace({x.x(), x.y()}, result.vertices.size());
        if (is_new)
            for (double const z : {0.0, 2.0}) result.vertices.push_back({x.x(), x.y(), z});
        ring.push_back(at->second);
    }
    auto& faces = result.faces;
    faces.emplace_back(ring.rbegin(), ring.rend());
    faces.emplace_back();
    for (auto const i : ring) faces[1].push_back(i + 1);
    auto const has_edge = [&](std::size_t a, std::size_t b) {
        for (std::size_t i = 0; i < ring.size(); ++i)
            if (ring[i] == a && ring[(i + 1) % ring.size()] == b) return true;
        return false;
    };
    for (std::size_t i = 0; i < ring.size(); ++i)
        if (auto const a = ring[i], b = ring[(i + 1) % ring.size()]; !has_edge(b, a))
            faces.push_back({a, b, b + 1, a + 1});
    return result;
}

inline double area(std::vector<Vector2d> const& outline)
{
    double twice = 0;
    for (std::size_t i = 0; i < outline.size(); ++i) {
        auto const &a = outline[i], &b = outline[(i + 1) % outline.size()];
        twice += a.x() * b.y() - a.y() * b.x();
    }
    return twice / 2;
}

} // namespace polygons

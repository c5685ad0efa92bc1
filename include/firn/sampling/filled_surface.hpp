// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/serial.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/sampling/mesh_topology.hpp>
#include <firn/sampling/winding_number.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

namespace firn
{

/// The solid that a surface with holes, crossings or overlaps means: where it winds around a point by more
/// than one half, within the box of its vertices.
///
/// A hole is closed by the smooth sheet on which the winding number is one half, components that overlap are
/// united. The orientation must be consistent within each connected component; a component that is (nearly)
/// closed and turned inside out is a cavity if it lies inside another one, and is turned over if not.
class FilledSurface
{
public:
    /// Throws firn::Error if the surface, which must have triangles, surrounds nothing.
    template <class Loop = Serial>
    explicit FilledSurface(TriangleMesh mesh, Loop const& loop = {})
        : mesh_(oriented(std::move(mesh))), box_(detail::bounding_box(mesh_)), winding_(mesh_)
    {
        estimate_volume(loop);
        require(volume_ > 0, "the surface surrounds no volume", "FilledSurface",
                "A flat or wide open sheet has no interior: give it a thickness in the modelling program.");
    }

    bool contains(Eigen::Vector3d const& x) const { return box_.contains(x) && winding_(x) > 0.5; }

    TriangleMesh const& surface() const { return mesh_; }
    Eigen::AlignedBox3d const& bounding_box() const { return box_; } ///< [m]

    /// The volume [m³], estimated to a standard error of 0.03 % where 8 million points suffice for that: one
    /// random point in each cell of a regular grid, finer where the surface fills less of its box.
    double volume() const { return volume_; }
    double volume_error() const { return volume_error_; } ///< standard error of `volume()` [m³]

private:
    struct Count
    {
        double inside = 0, cut = 0, cells = 0;
        /// A cell that the surface cuts somewhere adds p (1 - p) to the variance, 1/6 in the mean.
        double relative_error() const { return inside > 0 ? std::sqrt(cut / 6) / inside : 0; }
    };

    template <class Loop>
    void estimate_volume(Loop const& loop)
    {
        // a sheet has no inside, and counting it in cubes would take as many of them as it is thin
        if (!(box_.sizes().minCoeff() > 1e-4 * box_.sizes().maxCoeff())) return;
        constexpr double wanted = 0.0003, coarse = 48, finest = 200;
        auto count = count_inside(coarse, loop);
        // The relative error falls with the square of the cells along an edge.
        double const needed = std::ceil(coarse * std::sqrt(count.relative_error() / wanted));
        if (needed > coarse) count = count_inside(std::min(needed, finest), loop);
        volume_ = box_.volume() * count.inside / count.cells;
        volume_error_ = volume_ * count.relative_error();
    }

    /// Counts the points inside, one in each of about `edge`³ cells, and pairs of neighbours that differ.
    template <class Loop>
    Count count_inside(double edge, Loop const& loop) const
    {
        double const h = std::cbrt(box_.volume()) / edge;
        Eigen::Array3d const cells = (box_.sizes().array() / h).ceil().max(1).min(edge * edge * edge);
        auto const nx = static_cast<std::size_t>(cells[0]), ny = static_cast<std::size_t>(cells[1]);
        Eigen::Array3d const size = box_.sizes().array() / cells;
        Count count{0, 0, cells.prod()};
        std::mt19937_64 random;
        auto const unit = [&] { return double(random() >> 11) * 0x1p-53; };
        std::vector<Eigen::Vector3d> points(nx * ny);
        std::vector<char> slab(nx * ny), below(nx * ny);
        for (double z = 0; z < cells[2]; ++z) {
            for (std::size_t i = 0; i < points.size(); ++i) {
                Eigen::Array3d const jitter{unit(), unit(), unit()};
                Eigen::Array3d const cell{double(i % nx), double(i / nx), z};
                points[i] = box_.min().array() + (cell + jitter) * size;
            }
            loop.for_each(points.size(), [&](std::size_t i) { slab[i] = contains(points[i]); });
            for (std::size_t i = 0; i < slab.size(); ++i) {
                count.inside += slab[i];
                count.cut += (i % nx > 0 && slab[i] != slab[i - 1]) + (i >= nx && slab[i] != slab[i - nx]) +
                             (z > 0 && slab[i] != below[i]);
            }
            slab.swap(below);
        }
        return count;
    }

    static void turn_over(TriangleMesh& mesh)
    {
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    }

    static TriangleMesh oriented(TriangleMesh mesh)
    {
        if (detail::surface_sums(mesh).volume < 0) turn_over(mesh);
        auto const components = detail::components(mesh);
        std::vector<TriangleMesh> parts(components.count);
        for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
            parts[components.of_triangle[t]].triangles.push_back(mesh.triangles[t]);

        TriangleMesh outward, result;
        std::vector<TriangleMesh> inward;
        outward.vertices = result.vertices = mesh.vertices;
        for (auto& part : parts) {
            part.vertices.swap(mesh.vertices); // lent for the sums
            auto const sums = detail::surface_sums(part);
            part.vertices.swap(mesh.vertices);
            // Of a wide open piece nobody can tell what its inside is: it keeps its side.
            bool const nearly_closed = sums.area_vector.norm() < 0.6 * sums.area;
            if (sums.volume < 0 && nearly_closed)
                inward.push_back(std::move(part));
            else
                outward.triangles.insert(outward.triangles.end(), part.triangles.begin(),
                                         part.triangles.end());
        }
        WindingNumber const around(outward);
        for (auto& part : inward) {
            // A sample of its triangles' corners is enough: a component that is neither inside nor outside
            // crosses the others, and is no cavity.
            auto const stride = std::max<std::size_t>(1, part.triangles.size() / 64);
            bool inside = true;
            for (std::size_t t = 0; t < part.triangles.size() && inside; t += stride)
                inside = around(mesh.vertices[part.triangles[t][0]]) > 0.5;
            if (!inside) turn_over(part);
            result.triangles.insert(result.triangles.end(), part.triangles.begin(), part.triangles.end());
        }
        result.triangles.insert(result.triangles.end(), outward.triangles.begin(), outward.triangles.end());
        return result;
    }

    TriangleMesh mesh_;
    Eigen::AlignedBox3d box_;
    WindingNumber winding_;
    double volume_ = 0, volume_error_ = 0;
};

} // namespace firn

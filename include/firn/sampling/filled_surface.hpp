// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/serial.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/sampling/interior.hpp>
#include <firn/sampling/mesh_topology.hpp>
#include <firn/sampling/winding_cells.hpp>
#include <firn/sampling/winding_number.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace firn
{

/// The solid that a surface with holes, crossings or overlaps stands for: the points in the box of its
/// vertices around which it winds by more than one half.
///
/// A hole is closed by the smooth sheet on which the winding number is one half, and components that overlap
/// are united. The orientation must be consistent within each connected component; a component that is
/// (nearly) closed and turned inside out is a cavity if it lies inside another one, and is turned over if
/// not.
class FilledSurface
{
public:
    /// Throws firn::Error if the surface, which must have triangles, surrounds nothing. `progress`, if any,
    /// is called now and then with the share that is done, from 0 to 1, by the thread that makes the object;
    /// an exception that it throws ends the work.
    template <class Loop = Serial>
    explicit FilledSurface(TriangleMesh mesh, Loop const& loop = {},
                           std::function<void(double)> const& progress = {})
        : mesh_(oriented(std::move(mesh))), box_(detail::bounding_box(mesh_))
    {
        auto const tell = [&](double from, double to) {
            return [&progress, from, to](double share) {
                if (progress) progress(from + share * (to - from));
            };
        };
        tell(0, 0)(0);
        // a sheet has no inside, and the thinner it is, the more cells the search for one would take
        if (box_.sizes().minCoeff() > 1e-4 * box_.sizes().maxCoeff()) {
            cells_.emplace(mesh_, box_, loop, tell(0, 0.5));
            estimate_volume(loop, tell(0.5, 0.6), tell(0.6, 1));
        }
        require(volume_ > 0, "the surface surrounds no volume", "FilledSurface",
                "A flat or wide open sheet has no interior: give it a thickness in the modelling program.");
    }

    bool contains(Eigen::Vector3d const& x) const { return box_.contains(x) && cells_->contains(x); }

    TriangleMesh const& surface() const { return mesh_; }
    Eigen::AlignedBox3d const& bounding_box() const { return box_; } ///< [m]

    /// The volume [m³]: that of the cells wholly inside, plus an estimate for the cells that the surface
    /// cuts, from two random points in each part of a regular division. The standard error is 0.02 %, or more
    /// where that would take more than some ten million points.
    double volume() const { return volume_; }
    double volume_error() const { return volume_error_; } ///< standard error of `volume()` [m³]

private:
    struct Estimate
    {
        double volume = 0, variance = 0;

        double relative_error() const
        {
            return volume > 0 ? std::sqrt(variance) / volume : std::numeric_limits<double>::infinity();
        }
    };

    template <class Loop, class Progress>
    void estimate_volume(Loop const& loop, Progress const& first_progress, Progress const& progress)
    {
        auto const leaves = cells_->leaves();
        constexpr double wanted = 0.0002, most_work = 1e7, work_of_winding = 25;
        double work = 0; // with one part per leaf
        for (auto const& leaf : leaves)
            if (leaf.cut) work += 2 * (leaf.doubtful ? work_of_winding : 1);
        auto estimate = sample(leaves, 1, loop, first_progress);
        // The error falls with the square of the number of parts along an edge.
        double const needed = std::ceil(std::sqrt(estimate.relative_error() / wanted));
        double const affordable = std::floor(std::cbrt(most_work / std::max(work, 1.0)));
        if (double const edge = std::min(needed, affordable); edge > 1)
            estimate = sample(leaves, static_cast<int>(edge), loop, progress);
        progress(1);
        volume_ = estimate.volume;
        volume_error_ = std::sqrt(estimate.variance);
    }

    /// Counts points inside, two in each of `edge`³ parts of each leaf that the surface may cut.
    template <class Loop, class Progress>
    Estimate sample(std::vector<detail::WindingCells::Leaf> const& leaves, int edge, Loop const& loop,
                    Progress const& progress) const
    {
        std::vector<Estimate> parts(leaves.size());
        auto const look = [&](std::size_t i) {
            auto const& leaf = leaves[i];
            double const share = leaf.box.volume() / std::pow(edge, 3);
            if (!leaf.cut) {
                parts[i].volume = leaf.inside ? leaf.box.volume() : 0;
                return;
            }
            detail::UnitRandom random(i);
            Eigen::Array3d const size = leaf.box.sizes().array() / edge;
            for (int z = 0; z < edge; ++z)
                for (int y = 0; y < edge; ++y)
                    for (int x = 0; x < edge; ++x) {
                        int inside = 0;
                        for (int point = 0; point < 2; ++point) {
                            Eigen::Array3d const place = Eigen::Array3d(x, y, z) + random.vector();
                            inside += cells_->contains(leaf.box.min().array() + place * size, leaf);
                        }
                        parts[i].volume += share * inside / 2;
                        // a quarter of the squared difference of the two: the variance of their mean
                        parts[i].variance += inside == 1 ? share * share / 4 : 0;
                    }
        };
        constexpr std::size_t batch = 4096;
        Estimate sum;
        for (std::size_t first = 0; first < leaves.size(); first += batch) {
            auto const count = std::min(batch, leaves.size() - first);
            loop.for_each(count, [&](std::size_t i) { look(first + i); });
            progress(double(first + count) / double(leaves.size()));
        }
        for (auto const& part : parts) {
            sum.volume += part.volume;
            sum.variance += part.variance;
        }
        return sum;
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
            // The inside of a wide open piece is unknown, so it keeps its orientation.
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
    std::optional<detail::WindingCells> cells_;
    double volume_ = 0, volume_error_ = 0;
};

} // namespace firn

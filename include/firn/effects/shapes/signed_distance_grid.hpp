// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/shapes/samples_on.hpp>
#include <firn/effects/shapes/shape.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace firn
{

/// The values of a SignedDistanceGrid in the memory of a host or a device: a plain value to pass to a loop.
template <std::floating_point Real, int d>
struct SignedDistanceGridView
{
    static constexpr bool is_sampled = true;

    Vector<Real, d> origin;        ///< the first node [m]
    Real cell_size;                ///< [m]
    Eigen::Array<int, d, 1> nodes; ///< along each axis
    Real const* values;            ///< distance of each node [m], x fastest
    double farthest; ///< bound on the distance of the solid's points from the reference point [m]

    double reach() const { return farthest; } ///< the same bound [m]

    /// Signed distance and outward normal at `x` [m].
    ///
    /// Within the grid: the multilinear interpolant and its normalised gradient (the last axis where that
    /// vanishes). Beyond it: c being the nearest point of the grid's box, sqrt(|x - c|² + distance(c)²),
    /// which is never more than the true distance of a solid that lies within the box.
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        Vector<Real, d> nearest;
        auto const here = interpolate(x, nearest);
        Vector<Real, d> const away = x - nearest;
        Real const squared = away.squaredNorm();
        if (!(squared > 0)) return {here.distance, unit(here.normal)};
        // A solid that reaches out of the box: only its depth at the border is known.
        if (!(here.distance > 0)) return {here.distance + std::sqrt(squared), unit(away)};
        return {std::sqrt(squared + here.distance * here.distance),
                unit(away + here.distance * unit(here.normal))};
    }

private:
    /// Distance and (not normalised) gradient at the grid's point nearest to `x`.
    FIRN_HOST_DEVICE SurfaceSample<Real, d> interpolate(Vector<Real, d> const& x,
                                                        Vector<Real, d>& nearest) const
    {
        detail::CellOfSamples<Real, d> const cell(x, origin, cell_size, nodes);
        nearest = cell.nearest;
        SurfaceSample<Real, d> result{0, Vector<Real, d>::Zero()};
        for (int corner = 0; corner < (1 << d); ++corner) {
            Real const value = values[cell.at(corner)];
            Real weight = 1;
            Vector<Real, d> slope = Vector<Real, d>::Constant(1 / cell_size);
            for (int i = 0; i < d; ++i) {
                bool const high = corner >> i & 1;
                Real const w = high ? cell.within[i] : 1 - cell.within[i];
                weight *= w;
                for (int j = 0; j < d; ++j) slope[j] *= j != i ? w : (high ? Real(1) : Real(-1));
            }
            result.distance += weight * value;
            result.normal += value * slope;
        }
        return result;
    }

    FIRN_HOST_DEVICE static Vector<Real, d> unit(Vector<Real, d> const& v)
    {
        Real const length = v.norm();
        // The gradient of a distance has the length 1; where the sides meet it is the rest of a cancellation.
        if (length > Real(1e-6)) return v / length;
        Vector<Real, d> up = Vector<Real, d>::Zero();
        up[d - 1] = 1;
        return up;
    }
};

/// A SignedDistanceGrid on a backend.
template <class Backend, std::floating_point Real, int d>
using SignedDistanceGridOn = SamplesOn<Backend, SignedDistanceGridView<Real, d>>;

/// A solid given by its signed distance [m] on the nodes of a regular grid: a Shape. Cheap to copy.
///
/// `Real` is a number, not a pack of them. The distance is as good as its nodes: the interpolant errs by
/// cell_size² / 8 times the curvature, and rounds edges off within a cell.
template <std::floating_point Real, int d>
    requires(d == 2 || d == 3)
class SignedDistanceGrid
{
public:
    /// Takes `nodes` values along each axis, x fastest, the first at `origin` [m], `cell_size` [m] apart.
    ///
    /// Throws firn::Error: cell size not above 0, fewer than 2 nodes along an axis, a number of values that
    /// does not fit, a value or an origin that is not finite, a grid so far from its origin that its cells
    /// are lost to rounding.
    SignedDistanceGrid(Vector<Real, d> const& origin, Real cell_size, Eigen::Array<int, d, 1> const& nodes,
                       std::vector<Real> values)
        : origin_(origin), cell_size_(cell_size), nodes_(nodes)
    {
        char const* const where = "SignedDistanceGrid";
        require(is_finite(cell_size) && cell_size > 0 && all_finite(origin),
                "the grid's cell size is not above 0, or its origin is not finite", where,
                "Pass lengths in metres.");
        require((nodes >= 2).all(), "the grid has an axis of fewer than 2 nodes", where, "Use more nodes.");
        require(exactly_equal(double(values.size()),
                              nodes.template cast<double>().prod()), // which cannot overflow
                "the number of values is not that of the nodes", where,
                "Pass one distance for each node, x fastest.");
        require(std::ranges::all_of(values,
                                    [](Real v) { return is_between(-largest_length, v, largest_length); }),
                "a distance is not finite, or out of range", where, "Pass a distance [m] for each node.");
        require(detail::tells_cells_apart<Real, d>(origin, cell_size, nodes),
                "the grid lies so far from its frame's origin that its cells are lost to rounding", where,
                "Give it in coordinates about a point of the solid, and place it by the obstacle's motion.");
        farthest_ = farthest_of(values);
        values_ = std::make_shared<std::vector<Real> const>(std::move(values));
    }

    /// Signed distance and outward normal at `x` [m]; see SignedDistanceGridView::surface.
    SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const { return view().surface(x); }

    /// A view of its values, valid while the grid or a copy of it lives.
    SignedDistanceGridView<Real, d> view() const
    {
        return {origin_, cell_size_, nodes_, values_->data(), farthest_};
    }
    double reach() const { return farthest_; } ///< bound on its points' distance from the reference point [m]
    static constexpr bool in_host_memory = true; ///< where a backend for devices cannot reach them

    /// The same with its values in memory that the backend's loops can read: for a backend that runs on a
    /// device.
    template <class Backend>
    SignedDistanceGridOn<Backend, Real, d> on(Backend const& backend) const
    {
        return {view(), *values_, backend};
    }
    std::vector<Real> const& values() const { return *values_; } ///< [m]

private:
    /// A bound on the reach: a diagonal of a cell beyond the farthest node that is not outside. From a node
    /// on the border the solid may reach as far beyond the grid as the node is deep.
    double farthest_of(std::vector<Real> const& values) const
    {
        double farthest = 0;
        for (std::size_t node = 0; node < values.size(); ++node) {
            if (values[node] > 0) continue;
            Vector<double, d> x = origin_.template cast<double>();
            bool on_border = false;
            std::size_t rest = node;
            for (int a = 0; a < d; ++a) {
                int const at = static_cast<int>(rest % std::size_t(nodes_[a]));
                rest /= std::size_t(nodes_[a]);
                x[a] += double(cell_size_) * at;
                on_border = on_border || at == 0 || at == nodes_[a] - 1;
            }
            double const beyond = std::sqrt(double(d)) * double(cell_size_);
            farthest = std::max(farthest, x.norm() + beyond - (on_border ? double(values[node]) : 0.0));
        }
        return farthest;
    }

    Vector<Real, d> origin_;
    Real cell_size_;
    Eigen::Array<int, d, 1> nodes_;
    double farthest_ = 0; ///< see reach()
    std::shared_ptr<std::vector<Real> const> values_;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/shapes/samples_on.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace firn
{

/// The values of a DeformingGrid in the memory of a host or a device: a plain value to pass to a loop.
template <std::floating_point Real, int d>
struct DeformingGridView
{
    static constexpr bool is_sampled = true;
    static constexpr bool is_deforming = true;

    Vector<Real, d> origin;        ///< the first node [m]
    Real cell_size;                ///< [m]
    Eigen::Array<int, d, 1> nodes; ///< along each axis
    Real const*
        values;      ///< of each node, x fastest: distances before, and after [m], d ways of the surface [m]
    double farthest; ///< bound on the distance of the solid's points from the reference point [m]
    double begin;    ///< when the solid has the form before [s]
    double duration; ///< until it has the form after [s]
    double farthest_way; ///< the longest way of the surface [m]
    Real share = 0;      ///< how much of its way the surface has gone
    Real rate = 0;       ///< the share that it goes in a second [1/s]

    double reach() const { return farthest; } ///< the same bound [m]
    /// A bound on the speed of the surface [m/s].
    double largest_speed() const { return farthest_way / duration; }

    /// The shape at the end of a step, with its mean velocity in the step: it is as before until `begin`, as
    /// after from the end on, and at rest beyond both.
    FIRN_HOST_DEVICE DeformingGridView over(Interval const& step) const
    {
        DeformingGridView then = *this;
        double const start = share_at(step.begin), end = share_at(step.end), dt = step.end - step.begin;
        then.share = static_cast<Real>(end);
        then.rate = static_cast<Real>(dt > 0 ? (end - start) / dt : 0.0);
        return then;
    }

    /// Signed distance and outward normal at `x` [m]: between that of the form before at the place which the
    /// surface came from, and that of the form after at the place where it goes. So a surface that moves far
    /// is where it belongs, and has not faded in between.
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        Vector<Real, d> const way = way_at(x);
        SurfaceSample<Real, d> sample = distances(0).surface(x - way * share);
        if (!(share > 0)) return sample;
        auto const after = distances(1).surface(x + way * (1 - share));
        sample.distance += (after.distance - sample.distance) * share;
        sample.normal += (after.normal - sample.normal) * share;
        Real const length = sample.normal.norm();
        sample.normal = length > Real(1e-6) ? Vector<Real, d>(sample.normal / length) : after.normal;
        return sample;
    }

    /// The velocity of the surface beside `x` [m/s].
    FIRN_HOST_DEVICE Vector<Real, d> velocity(Vector<Real, d> const& x) const { return way_at(x) * rate; }

private:
    FIRN_HOST_DEVICE double share_at(double time) const
    {
        double const gone = (time - begin) / duration;
        return gone > 0 ? (gone < 1 ? gone : 1.0) : 0.0;
    }
    FIRN_HOST_DEVICE std::ptrdiff_t count() const
    {
        std::ptrdiff_t product = 1;
        for (int a = 0; a < d; ++a) product *= nodes[a];
        return product;
    }
    FIRN_HOST_DEVICE SignedDistanceGridView<Real, d> distances(int which) const
    {
        return {origin, cell_size, nodes, values + which * count(), farthest};
    }

    /// The way of the surface beside `x` [m]: multilinear within the grid, and that of its nearest point
    /// beyond.
    FIRN_HOST_DEVICE Vector<Real, d> way_at(Vector<Real, d> const& x) const
    {
        detail::CellOfSamples<Real, d> const cell(x, origin, cell_size, nodes);
        Vector<Real, d> way = Vector<Real, d>::Zero();
        for (int corner = 0; corner < (1 << d); ++corner) {
            Real weight = 1;
            for (int i = 0; i < d; ++i) weight *= corner >> i & 1 ? cell.within[i] : 1 - cell.within[i];
            for (int i = 0; i < d; ++i) way[i] += weight * values[(2 + i) * cell.stride + cell.at(corner)];
        }
        return way;
    }
};

/// A DeformingGrid on a backend.
template <class Backend, std::floating_point Real, int d>
using DeformingGridOn = SamplesOn<Backend, DeformingGridView<Real, d>>;

/// A solid that changes its form during an interval of time: a Shape with a velocity of its own, which its
/// obstacle adds to that of its motion. It is given by signed distances [m] at the beginning and at the end,
/// and by the way that the surface goes [m], on the nodes of one grid. Cheap to copy.
///
/// Before the interval it has the first form, and after it the last one, at rest. A scene that goes on needs
/// a new one for each interval: `deforming_mesh` makes it of a mesh.
template <std::floating_point Real, int d>
    requires(d == 2 || d == 3)
class DeformingGrid
{
public:
    static constexpr bool is_deforming = true;
    static constexpr bool in_host_memory = true; ///< where a backend for devices cannot reach them

    /// Takes the solid before and after on grids of the same nodes, and for each node the way of the nearest
    /// point of the surface [m], x fastest. The interval begins at a time [s] and takes a duration [s].
    ///
    /// Throws firn::Error: grids of different nodes, a number of ways that does not fit, a way that is not
    /// finite, a time that is not finite, a duration that is not above 0.
    DeformingGrid(SignedDistanceGrid<Real, d> const& before, SignedDistanceGrid<Real, d> const& after,
                  std::vector<Vector<Real, d>> const& ways, double begin, double duration)
    {
        char const* const where = "DeformingGrid";
        auto const from = before.view(), to = after.view();
        require((from.nodes == to.nodes).all() && exactly_equal(from.cell_size, to.cell_size) &&
                    exactly_equal(from.origin, to.origin),
                "the grids of the two forms have different nodes", where,
                "Compute both on one grid, which surrounds both.");
        std::size_t const count = before.values().size();
        require(ways.size() == count, "the number of ways is not that of the nodes", where,
                "Pass one way for each node, x fastest.");
        require(is_number(begin) && is_finite(begin) && is_finite(duration) && duration > 0,
                "the interval's begin or duration is not a finite time, or the duration not above 0", where,
                "Pass the solver's time and the length of the call in seconds.");
        auto values = std::make_shared<std::vector<Real>>(before.values());
        values->insert(values->end(), after.values().begin(), after.values().end());
        double farthest_way = 0;
        for (int a = 0; a < d; ++a)
            for (auto const& way : ways) {
                require(is_between(-largest_length, way[a], largest_length),
                        "the way of the surface is not finite, or out of range", where,
                        "Pass a way [m] for each node.");
                values->push_back(way[a]);
            }
        for (auto const& way : ways) farthest_way = std::max(farthest_way, double(way.norm()));
        view_ = {from.origin,
                 from.cell_size,
                 from.nodes,
                 values->data(),
                 std::max(from.farthest, to.farthest) + farthest_way,
                 begin,
                 duration,
                 farthest_way};
        values_ = std::move(values);
    }

    /// A view of its values, valid while the grid or a copy of it lives: the form before.
    DeformingGridView<Real, d> view() const { return view_; }
    double reach() const
    {
        return view_.reach();
    } ///< bound on its points' distance from the reference point [m]
    double largest_speed() const { return view_.largest_speed(); } ///< of its surface [m/s]

    /// The same with its values in memory that the backend's loops can read: for a backend that runs on a
    /// device.
    template <class Backend>
    DeformingGridOn<Backend, Real, d> on(Backend const& backend) const
    {
        return {view(), *values_, backend};
    }

private:
    DeformingGridView<Real, d> view_;
    std::shared_ptr<std::vector<Real> const> values_;
};

} // namespace firn

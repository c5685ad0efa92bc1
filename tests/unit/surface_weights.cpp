// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/interpolation/all.hpp>
#include <firn/phases/surface_weights.hpp>
#include <firn/transfer/mls.hpp>
#include <firn/transfer/pic.hpp>

#include <cmath>
#include <cstddef>
#include <tuple>

using namespace firn;

namespace
{

template <class KernelType, class TransferType>
struct Scheme
{
    using Kernel = KernelType;
    using Transfer = TransferType;
};
using Schemes = std::tuple<Scheme<QuadraticBSpline, Mls>, Scheme<CubicBSpline, Mls>,
                           Scheme<QuadraticBSpline, Pic>, Scheme<CubicBSpline, Pic>>;

/// A point of the plane as its stencil sees it, and the place of the node at the origin in this.
template <class Kernel>
struct SeenFrom
{
    Vector<double, 2> offset;
    int row, place; ///< along the first axis and the last
    bool is_near;

    explicit SeenFrom(Vector<double, 2> const& x)
    {
        double const half = 0.5 * Kernel::degree;
        int of[2];
        for (int a = 0; a < 2; ++a) {
            double const centre = Kernel::degree % 2 == 0 ? std::round(x[a]) : std::floor(x[a]) + 0.5;
            offset[a] = x[a] - centre;
            of[a] = static_cast<int>(std::lround(half - centre));
        }
        row = of[0], place = of[1];
        is_near = row >= 0 && row <= Kernel::degree && place >= 0 && place <= Kernel::degree;
    }
};

} // namespace

TEMPLATE_LIST_TEST_CASE("a force at a plane balances a uniform pressure behind it at each node", "", Schemes)
{
    using Kernel = typename TestType::Kernel;
    using Transfer = typename TestType::Transfer;
    using Cell = Stencil<Kernel, double, 2>;
    double const step = 1.0 / 64;
    for (double const degrees : {0.0, 17.0, 45.0, 70.0, 180.0})
        for (double const height : {0.0, 0.3, -0.5}) { // of the plane over the node [cells]
            CAPTURE(degrees, height);
            double const angle = degrees * M_PI / 180;
            Vector<double, 2> normal, along;
            normal[0] = -std::sin(angle), normal[1] = std::cos(angle);
            along[0] = normal[1], along[1] = -normal[0];
            auto const at = [&](double s, double below) {
                return SeenFrom<Kernel>(Vector<double, 2>(along * s + normal * (height - below)));
            };
            double at_plane = 0, behind = 0;
            for (double s = -3 + step / 2; s < 3; s += step) {
                if (auto const x = at(s, 0); x.is_near) {
                    Cell const cell(x.offset);
                    SurfaceWeights<Kernel, Transfer, double, 2> const weights(cell, x.offset, normal);
                    at_plane += step * weights.of_row(x.row)[std::size_t(x.place)];
                }
                for (double below = step / 2; below < 4; below += step) {
                    auto const x = at(s, below);
                    if (!x.is_near) continue;
                    Cell const cell(x.offset);
                    auto const i = std::size_t(x.row), j = std::size_t(x.place);
                    double slope;
                    if constexpr (Transfer::template scatter_terms<Kernel>.gradient)
                        slope = normal[0] * cell.derivative[0][i] * cell.weight[1][j] +
                                normal[1] * cell.weight[0][i] * cell.derivative[1][j];
                    else
                        slope = Kernel::inverse_inertia * cell.weight[0][i] * cell.weight[1][j] *
                                (normal[0] * cell.distance[0][i] + normal[1] * cell.distance[1][j]);
                    behind += step * step * slope;
                }
            }
            CHECK(std::abs(at_plane - behind) <= 1e-3);
        }
}

TEMPLATE_LIST_TEST_CASE("weights at a surface add up to one, and their mean place is the point", "", Schemes)
{
    using Kernel = typename TestType::Kernel;
    using Cell = Stencil<Kernel, double, 3>;
    Vector<double, 3> normal, offset;
    normal[0] = 0.36, normal[1] = 0.48, normal[2] = 0.8;
    for (double t = -0.5; t < 0.5; t += 0.05) {
        offset[0] = t, offset[1] = -0.7 * t, offset[2] = 0.3;
        Cell const cell(offset);
        double sum = 0;
        Vector<double, 3> mean = zeros<Vector<double, 3>>();
        SurfaceWeights<Kernel, typename TestType::Transfer, double, 3> const weights(cell, offset, normal);
        for (int row = 0; row < Cell::rows; ++row) {
            auto const of_row = weights.of_row(row);
            for (std::size_t k = 0; k < of_row.size(); ++k) {
                sum += of_row[k];
                for (int a = 0; a < 2; ++a) mean[a] += of_row[k] * cell.row_distance(row, a);
                mean[2] += of_row[k] * cell.distance[2][k];
            }
        }
        CHECK(std::abs(sum - 1) <= 1e-14);
        for (int a = 0; a < 3; ++a) CHECK(std::abs(mean[a]) <= 1e-14);
    }
}

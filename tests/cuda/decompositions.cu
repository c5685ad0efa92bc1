// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/matrices.hpp"

#include <firn/cuda.hpp>
#include <firn/firn.hpp>
#include <firn/math/principal_axes.hpp>
#include <firn/math/singular_values.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

// What material laws are made of, on a device: its own square roots, reciprocals and order of operations.
using namespace firn;
using firn::test::Exact;

namespace
{

/// Matrices as numbers, one after the other.
template <class Number, int d>
using Each = Eigen::Map<Matrix<Number, d>>;

template <class Number, int d>
struct Decompose
{
    Number const* given;
    Number* found; ///< U, V and diag(sigma); then principal axes, and those before the deformation

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        Matrix<Number, d> const F = Eigen::Map<Matrix<Number, d> const>(given + i * d * d);
        SingularValues<Number, d> const values = singular_values(F);
        auto const axes = principal_axes<Number, d>(Matrix<Number, d>(F - Matrix<Number, d>::Identity()));
        Matrix<Number, d> sigma = Matrix<Number, d>::Zero();
        for (int a = 0; a < d; ++a) sigma(a, a) = values.sigma[a];
        Matrix<Number, d> const all[]{values.U, values.V, sigma, axes.U, axes.stretched};
        for (std::size_t k = 0; k < 5; ++k) Each<Number, d>{found + (5 * i + k)* d* d} = all[k];
    }
};

template <int d>
double from_rotation(Exact<d> const& Q)
{
    return std::max((Q.transpose() * Q - Exact<d>::Identity()).cwiseAbs().maxCoeff(),
                    std::abs(Q.determinant() - 1));
}

template <class Number, int d>
void check_decompositions()
{
    double const exact = sizeof(Number) == 4 ? 1e-6 : 2e-15; // as on a processor
    std::size_t const count = 1000;
    Cuda const device;
    cuda::Array<Number> F(device), there(device);
    F.resize(count * d * d);
    there.resize(5 * F.size());
    for (auto const& kind : test::kinds<d>()) {
        INFO(d << " dimensions, " << kind.name);
        test::Source<d> source;
        std::vector<Number> given(F.size()), found(there.size());
        for (std::size_t i = 0; i < count; ++i)
            Each<Number, d>{&given[i * d * d]} = kind.make(source).template cast<Number>();
        F.upload(0, given);
        device.for_each(count, Decompose<Number, d>{F.data(), there.data()});
        there.download(0, found);

        double residual = 0, turned = 0, rebuilt = 0, axes_turned = 0;
        auto const raise = [](double& worst, double value) { worst = value <= worst ? worst : value; };
        for (std::size_t i = 0; i < count; ++i) {
            Exact<d> const exactly = Each<Number, d>(&given[i * d * d]).template cast<double>();
            auto const part = [&](std::size_t k) -> Exact<d> {
                return Each<Number, d>(&found[(5 * i + k) * d * d]).template cast<double>();
            };
            Exact<d> const U = part(0), V = part(1), axes = part(3);
            double const norm = exactly.norm();
            raise(residual, (U * part(2) * V.transpose() - exactly).norm() / (norm > 0 ? norm : 1));
            raise(turned, std::max(from_rotation<d>(U), from_rotation<d>(V)));
            if (norm > 1e4) continue; // principal axes need squares
            raise(axes_turned, from_rotation<d>(axes));
            raise(rebuilt, (axes * part(4).transpose() - exactly).norm() / (1 + norm));
        }
        CHECK(residual <= exact);
        CHECK(turned <= 3 * exact);
        CHECK(axes_turned <= 3 * exact);
        CHECK(rebuilt <= 3 * exact);
    }
}

} // namespace

TEST_CASE("singular values and principal axes are as exact on a device as on a processor")
{
    check_decompositions<float, 3>();
#if !defined(FIRN_TESTS_FEW_COMBINATIONS)
    check_decompositions<float, 2>();
    check_decompositions<double, 2>();
    check_decompositions<double, 3>();
#endif
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/lane_types.hpp"
#include "support/matrices.hpp"

#include <firn/math/principal_axes.hpp>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include <algorithm>
#include <vector>

namespace
{

using namespace firn;
using test::Exact;
using test::ExactVector;
using test::kinds;
using test::matrix_of;
using test::pack;
using test::Source;

template <class Number>
constexpr double rounding = sizeof(Number) == 4 ? 6e-8 : 1.2e-16;

/// That of singular values: see singular_values.cpp.
template <class Number>
constexpr double exactness = sizeof(Number) == 4 ? 1e-6 : 2e-15;

/// V - I of F = V R, V symmetric, from H = F - I: its eigenvalues are exact where H is small.
template <int d>
Exact<d> strain_of(Exact<d> const& exact)
{
    using Long = Eigen::Matrix<long double, d, d>;
    Long const H = exact.template cast<long double>();
    Eigen::SelfAdjointEigenSolver<Long> const found(Long(H + H.transpose() + H * H.transpose()));
    Eigen::Matrix<long double, d, 1> extension;
    for (int i = 0; i < d; ++i)
        extension[i] = found.eigenvalues()[i] / (1 + std::sqrt(std::max(0.0L, 1 + found.eigenvalues()[i])));
    return Long(found.eigenvectors() * extension.asDiagonal() * found.eigenvectors().transpose())
        .template cast<double>();
}

template <class Real, int d>
Matrix<Real, d> strain_of(PrincipalAxes<Real, d> const& axes)
{
    return axes.U * axes.extension.asDiagonal() * axes.U.transpose();
}

template <class Real, int d>
void check_strains(double size, double turn)
{
    Source<d> source;
    double worst = 0, not_rotation = 0, not_rebuilt = 0;
    for (int i = 0; i < 10000; i += lane_width<Real>) {
        std::vector<Exact<d>> matrices(lane_width<Real>);
        for (auto& H : matrices) {
            H = size * source.any();
            if (turn > 0) H += source.rotation() - Exact<d>::Identity();
            H = H.template cast<Scalar<Real>>().template cast<double>();
        }
        auto const axes = principal_axes<Real, d>(pack<Real, d>(matrices));
        auto const strain = strain_of(axes);
        for (int lane = 0; lane < lane_width<Real>; ++lane) {
            Exact<d> const H = matrices[static_cast<std::size_t>(lane)], U = matrix_of(axes.U, lane);
            if ((Exact<d>::Identity() + H).determinant() <= 0) continue; // the square has no sign
            double const scale = H.norm() * (1 + H.norm());
            worst = std::max(worst, (matrix_of(strain, lane) - strain_of<d>(H)).norm() / scale);
            not_rotation = std::max(not_rotation, (U.transpose() * U - Exact<d>::Identity()).norm());
            Exact<d> const back = U * matrix_of(axes.stretched, lane).transpose();
            not_rebuilt = std::max(not_rebuilt, (back - H - Exact<d>::Identity()).norm());
        }
    }
    INFO(d << " dimensions, " << lane_width<Real> << " lanes, H of " << size << ", turned " << turn);
    CHECK(worst <= exactness<Scalar<Real>>);
    CHECK(not_rotation <= 12 * rounding<Scalar<Real>>);
    CHECK(not_rebuilt <= 20 * (1 + size) * rounding<Scalar<Real>>);
}

/// Whether two lanes hold the same bits, or NaN both.
bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

} // namespace

TEMPLATE_LIST_TEST_CASE("Strains are exact to the rounding of the displacement gradient, however small", "",
                        test::LaneTypes)
{
    for (double const size : {1.0, 0.1, 1e-2, 1e-4, 1e-6, 1e-8})
        for (double const turn : {0, 1}) { // a rotation has the rounding of its own entries
            check_strains<TestType, 2>(size, turn);
            check_strains<TestType, 3>(size, turn);
        }
}

TEMPLATE_LIST_TEST_CASE("Stretches of every kind of matrix are those of its singular values", "",
                        test::LaneTypes)
{
    auto const check = [](auto dimension) {
        constexpr int d = dimension;
        for (auto const& kind : kinds<d>()) {
            Source<d> source;
            double worst = 0, least_sign = 1;
            for (int i = 0; i < 2000; i += lane_width<TestType>) {
                std::vector<Exact<d>> matrices(lane_width<TestType>);
                for (auto& H : matrices) {
                    Exact<d> F = kind.make(source);
                    double const largest = F.cwiseAbs().maxCoeff();
                    if (largest > 0) F /= largest; // there is no scaling: F is of the order of 1
                    H = (F - Exact<d>::Identity()).template cast<Scalar<TestType>>().template cast<double>();
                }
                auto const axes = principal_axes<TestType, d>(pack<TestType, d>(matrices));
                for (int lane = 0; lane < lane_width<TestType>; ++lane) {
                    Exact<d> const F = Exact<d>::Identity() + matrices[static_cast<std::size_t>(lane)];
                    ExactVector<d> sigma = matrix_of(axes.extension, lane) + ExactVector<d>::Ones();
                    ExactVector<d> const exact = Eigen::JacobiSVD<Exact<d>>(F).singularValues();
                    if (std::abs(F.determinant()) > 1e-5)
                        least_sign = std::min(least_sign, sigma.prod() * F.determinant() > 0 ? 1.0 : -1.0);
                    sigma = sigma.cwiseAbs();
                    std::sort(sigma.data(), sigma.data() + d, std::greater<>());
                    worst = std::max(worst, (sigma - exact).cwiseAbs().maxCoeff() / std::max(exact[0], 1e-3));
                }
            }
            INFO(d << " dimensions, " << lane_width<TestType> << " lanes, " << kind.name);
            CHECK(worst <= exactness<Scalar<TestType>>);
            CHECK(least_sign == 1);
        }
    };
    check(std::integral_constant<int, 2>{});
    check(std::integral_constant<int, 3>{});
}

TEMPLATE_LIST_TEST_CASE("No lane's axes depend on what is in the others, be it nothing or not finite", "",
                        test::LaneTypes)
{
    Source<3> source;
    int others = 0;
    for (int i = 0; i < 2000; ++i) {
        std::vector<Exact<3>> matrices(lane_width<TestType>);
        for (auto& H : matrices) H = 0.1 * source.any();
        std::vector<Exact<3>> alone(lane_width<TestType>, Exact<3>::Zero());
        auto const kept = static_cast<std::size_t>(i % lane_width<TestType>);
        alone[kept] = matrices[kept];
        for (std::size_t lane = 0; lane < alone.size(); ++lane)
            if (lane != kept && i % 2 == 1) alone[lane].setConstant(std::nan(""));
        auto const a = principal_axes<TestType, 3>(pack<TestType, 3>(matrices)),
                   b = principal_axes<TestType, 3>(pack<TestType, 3>(alone));
        int const lane = static_cast<int>(kept);
        for (int k = 0; k < 9; ++k) {
            others += !same(matrix_of(a.U, lane)(k), matrix_of(b.U, lane)(k));
            others += !same(matrix_of(a.stretched, lane)(k), matrix_of(b.stretched, lane)(k));
        }
        for (int k = 0; k < 3; ++k)
            others += !same(matrix_of(a.extension, lane)(k), matrix_of(b.extension, lane)(k));
    }
    CHECK(others == 0);
}

TEMPLATE_LIST_TEST_CASE("Nothing is stretched at rest, and nothing finite comes of what is not", "",
                        test::LaneTypes)
{
    auto const rest = principal_axes<TestType, 3>(Matrix<TestType, 3>(Matrix<TestType, 3>::Zero()));
    std::vector<Exact<3>> broken(lane_width<TestType>, Exact<3>::Zero());
    broken[0](1, 2) = std::numeric_limits<double>::quiet_NaN();
    auto const lost = principal_axes<TestType, 3>(pack<TestType, 3>(broken));
    CHECK(matrix_of(lost.extension, 0).array().isNaN().all());
    for (int lane = 0; lane < lane_width<TestType>; ++lane) {
        CHECK(matrix_of(rest.extension, lane) == ExactVector<3>::Zero());
        CHECK((matrix_of(rest.U, lane) - Exact<3>::Identity()).norm() <= 4 * rounding<Scalar<TestType>>);
        if (lane > 0) CHECK(matrix_of(lost.extension, lane) == ExactVector<3>::Zero());
    }
}

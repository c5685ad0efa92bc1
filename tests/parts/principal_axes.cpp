// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/lane_types.hpp"
#include "support/matrices.hpp"

#include <firn/math/largest_eigenvalue.hpp>
#include <firn/math/left_stretch.hpp>
#include <firn/math/principal_axes.hpp>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include <algorithm>
#include <vector>

namespace
{

using namespace firn;
using test::diagonal;
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

// One copy each for all tests: what they cost is to be compiled.
template <class Real, int d>
[[gnu::noinline]] PrincipalAxes<Real, d> axes_of_lanes(Matrix<Real, d> const& H)
{
    return principal_axes<Real, d>(H);
}

template <class Real, int d>
[[gnu::noinline]] LeftStretch<Real, d> stretch_of_lanes(Matrix<Real, d> const& H)
{
    return left_stretch<Real, d>(H, volume_change<Real, d>(H));
}

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
        auto const axes = axes_of_lanes<Real, d>(pack<Real, d>(matrices));
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

/// The left stretch V of F = V R, and the product of what two stretches each add up to, with their signs,
/// where the largest is 1: where that is nothing, the rotation R may be any, and V with it.
template <int d>
std::pair<Exact<d>, double> left_stretch_of(Exact<d> const& F)
{
    Eigen::JacobiSVD<Exact<d>> const found(F, Eigen::ComputeFullU);
    ExactVector<d> sigma = found.singularValues();
    if (F.determinant() < 0) sigma[d - 1] = -sigma[d - 1];
    Exact<d> const V = found.matrixU() * sigma.asDiagonal() * found.matrixU().transpose();
    sigma /= std::max(sigma[0], 1e-300);
    double settled = 1;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < i; ++j) settled *= sigma[i] + sigma[j];
    return {V, settled};
}

/// What lanes of a type find of any number of matrices, so that what tests compare is not compiled for each
/// type: V - I and V^2 - I from H = F - I.
template <class Real, int d>
std::vector<std::pair<Exact<d>, Exact<d>>> stretches_by(std::vector<Exact<d>> const& all)
{
    std::vector<std::pair<Exact<d>, Exact<d>>> found;
    for (std::size_t i = 0; i < all.size(); i += lane_width<Real>) {
        std::vector<Exact<d>> matrices(lane_width<Real>, Exact<d>::Zero());
        for (std::size_t lane = 0; lane < matrices.size() && i + lane < all.size(); ++lane)
            matrices[lane] = all[i + lane];
        auto const V = stretch_of_lanes<Real, d>(pack<Real, d>(matrices));
        for (int lane = 0; lane < lane_width<Real>; ++lane)
            found.emplace_back(matrix_of(V.strain, lane), matrix_of(V.square, lane));
    }
    return found;
}

/// The same: largest eigenvalues of symmetric matrices.
template <class Real, int d>
std::vector<double> largest_eigenvalues_by(std::vector<Exact<d>> const& all)
{
    std::vector<double> found;
    for (std::size_t i = 0; i < all.size(); i += lane_width<Real>) {
        std::vector<Exact<d>> matrices(lane_width<Real>, Exact<d>::Zero());
        for (std::size_t lane = 0; lane < matrices.size() && i + lane < all.size(); ++lane)
            matrices[lane] = all[i + lane];
        Scalar<Real> numbers[lane_width<Real>];
        LaneTraits<Real>::store(largest_eigenvalue(pack<Real, d>(matrices)), numbers);
        found.insert(found.end(), numbers, numbers + lane_width<Real>);
    }
    return found;
}

/// A matrix as rounded to a precision.
template <int d>
Exact<d> rounded_to(bool single, Exact<d> const& matrix)
{
    return single ? Exact<d>(matrix.template cast<float>().template cast<double>()) : matrix;
}

template <int d>
void check_stretches(decltype(&stretches_by<double, d>) stretches, bool single)
{
    double const bound = single ? exactness<float> : exactness<double>;
    Exact<d> const I = Exact<d>::Identity();
    auto all = kinds<d>();
    for (double const apart : {1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.1}) {
        all.push_back({"nearly a reflection", [=](Source<d>& s) {
                           return s.turned(1.9 * diagonal<d>(1 + apart * s.normal(), 1 + apart * s.normal(),
                                                             -1 + apart * s.normal()));
                       }});
        for (double const sign : {1, -1})
            all.push_back({"needle", [=](Source<d>& s) {
                               return s.turned(diagonal<d>(1.3, apart, sign * 0.7 * apart));
                           }});
        all.push_back({"point", [=](Source<d>& s) { return s.turned(apart * diagonal<d>(1, 0.9, 0.8)); }});
    }
    for (double const size : {0.1, 1e-2, 1e-4, 1e-6, 1e-8}) // exact to the rounding of H, however small
        for (double const turn : {0, 1}) {
            Source<d> source;
            std::vector<Exact<d>> matrices(2000);
            for (auto& H : matrices)
                H = rounded_to<d>(single, size * source.any() + turn * (source.rotation() - I));
            auto const found = stretches(matrices);
            double worst = 0;
            for (std::size_t i = 0; i < matrices.size(); ++i)
                worst = std::max(worst, (found[i].first - strain_of<d>(matrices[i])).norm() /
                                            (matrices[i].norm() * (1 + matrices[i].norm())));
            INFO(d << " dimensions, H of " << size << ", turned " << turn);
            CHECK(worst <= bound);
        }
    for (auto const& kind : all) {
        Source<d> source;
        std::vector<Exact<d>> matrices(2000);
        for (auto& H : matrices) H = rounded_to<d>(single, kind.make(source) - I);
        auto const found = stretches(matrices);
        double worst = 0, squares = 0, not_root = 0;
        for (std::size_t i = 0; i < matrices.size(); ++i) {
            Exact<d> const F = I + matrices[i], V = I + found[i].first, square = F * F.transpose();
            auto const [exact, settled] = left_stretch_of<d>(F);
            double const size = std::max(F.norm(), 1.0); // what is below 1 has the rounding of 1
            // where the rotation is open, another V may be as good
            worst = std::max(worst, (V - exact).norm() / size * std::min(settled * settled, 1.0));
            not_root = std::max(not_root, (V * V - square).norm() / (size * size));
            squares = std::max(squares, (found[i].second + I - square).norm() / (size * size));
        }
        INFO(d << " dimensions, " << kind.name);
        CHECK(worst <= 8 * bound);
        CHECK(squares <= bound);
        CHECK(not_root <= 1000 * bound); // of what is nearly a reflection; 10 of most
    }
}

template <int d>
void check_largest_eigenvalues(decltype(&largest_eigenvalues_by<double, d>) largest, bool single)
{
    double const within = d == 2 ? 0 : 0.0046, off = 4000 * (single ? rounding<float> : rounding<double>);
    for (double const size : {1e-10, 1e-5, 1.0, 1e6}) {
        Source<d> source;
        std::vector<Exact<d>> matrices(2000);
        for (std::size_t i = 0; i < matrices.size(); ++i) {
            Exact<d> const any = size * source.any(), U = source.rotation(),
                           D = diagonal<d>(-size, size, size);
            Exact<d> const S = i % 2 == 0 ? Exact<d>(any + any.transpose()) : Exact<d>(U * D * U.transpose());
            matrices[i] = rounded_to<d>(single, S);
        }
        auto const found = largest(matrices);
        double least = 1, most = 0;
        for (std::size_t i = 0; i < matrices.size(); ++i) {
            Exact<d> const& S = matrices[i];
            double const exact = Eigen::SelfAdjointEigenSolver<Exact<d>>(S).eigenvalues()[d - 1];
            double const above = (found[i] - exact) / std::max(exact - S.trace() / d, S.norm() * 1e-3);
            least = std::min(least, above), most = std::max(most, above);
        }
        INFO(d << " dimensions, " << size);
        CHECK(least >= -off);
        CHECK(most <= within + off);
    }
}

/// One type of lanes of each precision: more take the compiler long.
using WidestLanes =
    std::tuple<std::tuple_element_t<0, test::LaneTypes>, std::tuple_element_t<1, test::LaneTypes>>;

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
                auto const axes = axes_of_lanes<TestType, d>(pack<TestType, d>(matrices));
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
        auto const a = axes_of_lanes<TestType, 3>(pack<TestType, 3>(matrices)),
                   b = axes_of_lanes<TestType, 3>(pack<TestType, 3>(alone));
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

TEMPLATE_LIST_TEST_CASE(
    "No lane's stretch depends on what is in the others, near rest or far, be it finite or not", "",
    WidestLanes)
{
    Source<3> source;
    int others = 0, finite = 0;
    auto const stretch = [](std::vector<Exact<3>> const& matrices) {
        auto const H = pack<TestType, 3>(matrices);
        return stretch_of_lanes<TestType, 3>(H).strain;
    };
    for (int i = 0; i < 2000; ++i) {
        std::vector<Exact<3>> matrices(lane_width<TestType>);
        for (auto& H : matrices)
            H = (i % 3 == 0 ? 0.1 : i % 3 == 1 ? 1 : 10) * source.any(); // inside out, too
        std::vector<Exact<3>> alone(lane_width<TestType>, Exact<3>::Zero());
        auto const kept = static_cast<std::size_t>(i % lane_width<TestType>);
        alone[kept] = matrices[kept];
        for (std::size_t lane = 0; lane < alone.size(); ++lane)
            if (lane != kept && i % 2 == 1) alone[lane].setConstant(std::nan(""));
        auto const a = stretch(matrices), b = stretch(alone);
        int const lane = static_cast<int>(kept);
        for (int k = 0; k < 9; ++k) others += !same(matrix_of(a, lane)(k), matrix_of(b, lane)(k));
        if (lane_width < TestType >> 1 && i % 2 == 1)
            finite += !matrix_of(b, (lane + 1) % lane_width<TestType>).array().isNaN().all();
    }
    CHECK(others == 0);
    CHECK(finite == 0);
}

TEMPLATE_LIST_TEST_CASE("The largest eigenvalue is found, or half a percent more of the deviator", "",
                        WidestLanes)
{
    constexpr bool single = sizeof(Scalar<TestType>) == 4;
    check_largest_eigenvalues<2>(largest_eigenvalues_by<TestType, 2>, single);
    check_largest_eigenvalues<3>(largest_eigenvalues_by<TestType, 3>, single);
}

TEMPLATE_LIST_TEST_CASE("Nothing is stretched at rest, and nothing finite comes of what is not", "",
                        test::LaneTypes)
{
    auto const rest = axes_of_lanes<TestType, 3>(Matrix<TestType, 3>(Matrix<TestType, 3>::Zero()));
    std::vector<Exact<3>> broken(lane_width<TestType>, Exact<3>::Zero());
    broken[0](1, 2) = std::numeric_limits<double>::quiet_NaN();
    auto const lost = axes_of_lanes<TestType, 3>(pack<TestType, 3>(broken));
    CHECK(matrix_of(lost.extension, 0).array().isNaN().all());
    for (int lane = 0; lane < lane_width<TestType>; ++lane) {
        CHECK(matrix_of(rest.extension, lane) == ExactVector<3>::Zero());
        CHECK((matrix_of(rest.U, lane) - Exact<3>::Identity()).norm() <= 4 * rounding<Scalar<TestType>>);
        if (lane > 0) CHECK(matrix_of(lost.extension, lane) == ExactVector<3>::Zero());
    }
}

TEMPLATE_LIST_TEST_CASE(
    "The left stretch is that of the singular values, at any size, and squared it is F F^T", "", WidestLanes)
{
    constexpr bool single = sizeof(Scalar<TestType>) == 4;
    check_stretches<2>(stretches_by<TestType, 2>, single);
    check_stretches<3>(stretches_by<TestType, 3>, single);
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/lane_types.hpp"
#include "support/long_double.hpp"
#include "support/matrices.hpp"

#include <firn/math/largest_eigenvalue.hpp>
#include <firn/math/left_stretch.hpp>
#include <firn/math/principal_axes.hpp>

#include <Eigen/SVD>

#include <algorithm>
#include <vector>

namespace
{

using namespace firn;
using test::diagonal;
using test::Exact;
using test::ExactVector;
using test::is_single;
using test::kinds;
using test::Long;
using test::matrix_of;
using test::rounded_to;
using test::Source;

/// The unit roundoff of a precision, nearly.
double rounding(bool single) { return single ? 6e-8 : 1.2e-16; }

/// That of singular values: see singular_values.cpp.
double exactness(bool single) { return single ? 1e-6 : 2e-15; }

/// See PrincipalAxes.
template <int d>
struct Axes
{
    Exact<d> U, stretched;
    ExactVector<d> extension;
};

template <class Real, int d>
std::vector<Axes<d>> axes_by(std::vector<Exact<d>> const& all)
{
    return test::found_by<Real, d>(
        all, [](Matrix<Real, d> const& H) { return principal_axes<Real, d>(H); },
        [](PrincipalAxes<Real, d> const& axes, int lane) {
            return Axes<d>{matrix_of(axes.U, lane), matrix_of(axes.stretched, lane),
                           matrix_of(axes.extension, lane)};
        });
}

/// V - I and V^2 - I from H = F - I.
template <class Real, int d>
std::vector<std::pair<Exact<d>, Exact<d>>> stretches_by(std::vector<Exact<d>> const& all)
{
    return test::found_by<Real, d>(
        all, [](Matrix<Real, d> const& H) { return left_stretch<Real, d>(H, volume_change<Real, d>(H)); },
        [](LeftStretch<Real, d> const& V, int lane) {
            return std::pair{matrix_of(V.strain, lane), matrix_of(V.square, lane)};
        });
}

/// The largest eigenvalues of symmetric matrices.
template <class Real, int d>
std::vector<double> largest_eigenvalues_by(std::vector<Exact<d>> const& all)
{
    using Value = Eigen::Matrix<Real, 1, 1>;
    return test::found_by<Real, d>(
        all, [](Matrix<Real, d> const& S) { return Value(largest_eigenvalue(S)); },
        [](Value const& value, int lane) { return matrix_of(value, lane)(0); });
}

/// V - I of F = V R, V symmetric, from H = F - I: its eigenvalues are exact where H is small.
template <int d>
Exact<d> strain_of(Exact<d> const& exact)
{
    Long<d> const H = exact.template cast<long double>();
    Eigen::SelfAdjointEigenSolver<Long<d>> const found(Long<d>(H + H.transpose() + H * H.transpose()));
    Eigen::Matrix<long double, d, 1> extension;
    for (int i = 0; i < d; ++i)
        extension[i] = found.eigenvalues()[i] / (1 + std::sqrt(std::max(0.0L, 1 + found.eigenvalues()[i])));
    return Long<d>(found.eigenvectors() * extension.asDiagonal() * found.eigenvectors().transpose())
        .template cast<double>();
}

template <int d>
void check_strains(decltype(&axes_by<double, d>) find, bool single, double size, double turn)
{
    Source<d> source;
    std::vector<Exact<d>> matrices(10000);
    for (auto& H : matrices) {
        H = size * source.any();
        if (turn > 0) H += source.rotation() - Exact<d>::Identity();
        H = rounded_to<d>(single, H);
    }
    auto const found = find(matrices);
    double worst = 0, not_rotation = 0, not_rebuilt = 0;
    for (std::size_t i = 0; i < matrices.size(); ++i) {
        Exact<d> const &H = matrices[i], &U = found[i].U;
        if ((Exact<d>::Identity() + H).determinant() <= 0) continue; // the square has no sign
        double const scale = H.norm() * (1 + H.norm());
        Exact<d> const strain = U * found[i].extension.asDiagonal() * U.transpose();
        worst = std::max(worst, (strain - strain_of<d>(H)).norm() / scale);
        not_rotation = std::max(not_rotation, (U.transpose() * U - Exact<d>::Identity()).norm());
        Exact<d> const back = U * found[i].stretched.transpose();
        not_rebuilt = std::max(not_rebuilt, (back - H - Exact<d>::Identity()).norm());
    }
    INFO(d << " dimensions, H of " << size << ", turned " << turn);
    CHECK(worst <= exactness(single));
    CHECK(not_rotation <= 12 * rounding(single));
    CHECK(not_rebuilt <= 20 * (1 + size) * rounding(single));
}

template <int d>
void check_singular_values_of_axes(decltype(&axes_by<double, d>) find, bool single)
{
    for (auto const& kind : kinds<d>()) {
        Source<d> source;
        std::vector<Exact<d>> matrices(2000);
        for (auto& H : matrices) {
            Exact<d> F = kind.make(source);
            double const largest = F.cwiseAbs().maxCoeff();
            if (largest > 0) F /= largest; // there is no scaling: F is of the order of 1
            H = rounded_to<d>(single, F - Exact<d>::Identity());
        }
        auto const found = find(matrices);
        double worst = 0, least_sign = 1;
        for (std::size_t i = 0; i < matrices.size(); ++i) {
            Exact<d> const F = Exact<d>::Identity() + matrices[i];
            ExactVector<d> sigma = found[i].extension + ExactVector<d>::Ones();
            ExactVector<d> const exact = Eigen::JacobiSVD<Long<d>>(F.template cast<long double>())
                                             .singularValues()
                                             .template cast<double>();
            if (std::abs(F.determinant()) > 1e-5)
                least_sign = std::min(least_sign, sigma.prod() * F.determinant() > 0 ? 1.0 : -1.0);
            sigma = sigma.cwiseAbs();
            std::sort(sigma.data(), sigma.data() + d, std::greater<>());
            worst = std::max(worst, (sigma - exact).cwiseAbs().maxCoeff() / std::max(exact[0], 1e-3));
        }
        INFO(d << " dimensions, " << kind.name);
        CHECK(worst <= exactness(single));
        CHECK(least_sign == 1);
    }
}

/// Whether two lanes hold the same bits, or NaN both.
template <class Matrix>
bool same(Matrix const& a, Matrix const& b)
{
    return (a.array() == b.array() || (a.array().isNaN() && b.array().isNaN())).all();
}

/// Calls `check` with the same matrix among others, and alone in the same lane, beside zeros or NaN: (one
/// lane's worth, the same but for the others, the lane, whether the others are NaN).
template <class Check>
void for_each_alone(std::size_t width, double (*size)(int), Check&& check)
{
    Source<3> source;
    for (int i = 0; i < 2000; ++i) {
        std::vector<Exact<3>> among(width), alone(width, Exact<3>::Zero());
        for (auto& H : among) H = size(i) * source.any();
        std::size_t const kept = static_cast<std::size_t>(i) % width;
        for (std::size_t lane = 0; lane < width && i % 2 == 1; ++lane) alone[lane].setConstant(std::nan(""));
        alone[kept] = among[kept];
        check(among, alone, kept, i % 2 == 1);
    }
}

void check_axes_alone(decltype(&axes_by<double, 3>) find, std::size_t width)
{
    int others = 0;
    for_each_alone(
        width, [](int) { return 0.1; },
        [&](auto const& among, auto const& alone, std::size_t kept, bool) {
            auto const a = find(among)[kept], b = find(alone)[kept];
            others += !same(a.U, b.U) || !same(a.stretched, b.stretched) || !same(a.extension, b.extension);
        });
    CHECK(others == 0);
}

void check_stretches_alone(decltype(&stretches_by<double, 3>) find, std::size_t width)
{
    int others = 0, finite = 0;
    for_each_alone(
        width, [](int i) { return i % 3 == 0   ? 0.1
                                  : i % 3 == 1 ? 1.0
                                               : 10.0; }, // inside out, too
        [&](auto const& among, auto const& alone, std::size_t kept, bool beside_nan) {
            auto const a = find(among), b = find(alone);
            others += !same(a[kept].first, b[kept].first);
            if (width > 1 && beside_nan) finite += !b[(kept + 1) % width].first.array().isNaN().all();
        });
    CHECK(others == 0);
    CHECK(finite == 0);
}

void check_rest_and_nan(decltype(&axes_by<double, 3>) find, bool single, std::size_t width)
{
    std::vector<Exact<3>> broken(width, Exact<3>::Zero());
    auto const rest = find(broken);
    broken[0](1, 2) = std::nan("");
    auto const lost = find(broken);
    CHECK(lost[0].extension.array().isNaN().all());
    for (std::size_t lane = 0; lane < width; ++lane) {
        CHECK(rest[lane].extension == ExactVector<3>::Zero());
        CHECK((rest[lane].U - Exact<3>::Identity()).norm() <= 4 * rounding(single));
        if (lane > 0) CHECK(lost[lane].extension == ExactVector<3>::Zero());
    }
}

/// The left stretch V of F = V R, and the product of what two stretches each add up to, with their signs,
/// where the largest is 1: where that is nothing, the rotation R may be any, and V with it.
template <int d>
std::pair<Exact<d>, double> left_stretch_of(Exact<d> const& F)
{
    Eigen::JacobiSVD<Long<d>> const found(F.template cast<long double>(), Eigen::ComputeFullU);
    Exact<d> const U = found.matrixU().template cast<double>();
    ExactVector<d> sigma = found.singularValues().template cast<double>();
    if (F.determinant() < 0) sigma[d - 1] = -sigma[d - 1];
    Exact<d> const V = U * sigma.asDiagonal() * U.transpose();
    sigma /= std::max(sigma[0], 1e-300);
    double settled = 1;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < i; ++j) settled *= sigma[i] + sigma[j];
    return {V, settled};
}

template <int d>
void check_stretches(decltype(&stretches_by<double, d>) stretches, bool single)
{
    double const bound = exactness(single);
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
    double const within = d == 2 ? 0 : 0.0046, off = 4000 * rounding(single);
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
            double const exact = static_cast<double>(test::spectrum_of<d>(S).eigenvalues()[d - 1]);
            double const above = (found[i] - exact) / std::max(exact - S.trace() / d, S.norm() * 1e-3);
            least = std::min(least, above), most = std::max(most, above);
        }
        INFO(d << " dimensions, " << size);
        CHECK(least >= -off);
        CHECK(most <= within + off);
    }
}

} // namespace

TEMPLATE_LIST_TEST_CASE("Strains are exact to the rounding of the displacement gradient, however small", "",
                        test::LaneTypes)
{
    for (double const size : {1.0, 0.1, 1e-2, 1e-4, 1e-6, 1e-8})
        for (double const turn : {0, 1}) { // a rotation has the rounding of its own entries
            check_strains<2>(axes_by<TestType, 2>, is_single<TestType>, size, turn);
            check_strains<3>(axes_by<TestType, 3>, is_single<TestType>, size, turn);
        }
}

TEMPLATE_LIST_TEST_CASE("Stretches of every kind of matrix are those of its singular values", "",
                        test::LaneTypes)
{
    check_singular_values_of_axes<2>(axes_by<TestType, 2>, is_single<TestType>);
    check_singular_values_of_axes<3>(axes_by<TestType, 3>, is_single<TestType>);
}

TEMPLATE_LIST_TEST_CASE("No lane's axes depend on what is in the others, be it nothing or not finite", "",
                        test::LaneTypes)
{
    check_axes_alone(axes_by<TestType, 3>, lane_width<TestType>);
}

TEMPLATE_LIST_TEST_CASE(
    "No lane's stretch depends on what is in the others, near rest or far, be it finite or not", "",
    test::LaneTypes)
{
    check_stretches_alone(stretches_by<TestType, 3>, lane_width<TestType>);
}

TEMPLATE_LIST_TEST_CASE("The largest eigenvalue is found, or half a percent more of the deviator", "",
                        test::LaneTypes)
{
    check_largest_eigenvalues<2>(largest_eigenvalues_by<TestType, 2>, is_single<TestType>);
    check_largest_eigenvalues<3>(largest_eigenvalues_by<TestType, 3>, is_single<TestType>);
}

TEMPLATE_LIST_TEST_CASE("Nothing is stretched at rest, and nothing finite comes of what is not", "",
                        test::LaneTypes)
{
    check_rest_and_nan(axes_by<TestType, 3>, is_single<TestType>, lane_width<TestType>);
}

TEMPLATE_LIST_TEST_CASE(
    "The left stretch is that of the singular values, at any size, and squared it is F F^T", "",
    test::LaneTypes)
{
    check_stretches<2>(stretches_by<TestType, 2>, is_single<TestType>);
    check_stretches<3>(stretches_by<TestType, 3>, is_single<TestType>);
}

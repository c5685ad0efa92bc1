// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/lane_types.hpp"
#include "support/long_double.hpp"
#include "support/matrices.hpp"

#include <firn/math/inverse.hpp>
#include <firn/math/singular_values.hpp>

#include <Eigen/LU>
#include <Eigen/SVD>

#include <limits>
#include <vector>

namespace
{

using namespace firn;
using test::Exact;
using test::ExactVector;
using test::is_single;
using test::kinds;
using test::LaneTypes;
using test::Long;
using test::matrix_of;
using test::rounded_to;
using test::Source;

struct Bounds
{
    double error, determinant;
};

constexpr Bounds bounds(bool single) { return single ? Bounds{1e-6, 3e-6} : Bounds{2e-15, 1e-14}; }

/// F = U diag(sigma) V^T.
template <int d>
struct Values
{
    Exact<d> U, V;
    ExactVector<d> sigma;
};

template <class Real, int d>
std::vector<Values<d>> values_by(std::vector<Exact<d>> const& all)
{
    return test::found_by<Real, d>(
        all, [](Matrix<Real, d> const& F) { return singular_values(F); },
        [](SingularValues<Real, d> const& found, int lane) {
            return Values<d>{matrix_of(found.U, lane), matrix_of(found.V, lane),
                             matrix_of(found.sigma, lane)};
        });
}

template <class Real, int d, class Inverse>
std::vector<Exact<d>> inverses_by(std::vector<Exact<d>> const& all, Inverse inverse)
{
    return test::found_by<Real, d>(
        all, inverse, [](Matrix<Real, d> const& found, int lane) { return matrix_of(found, lane); });
}

struct Worst
{
    double residual = 0, U = 0, V = 0, sigma = 0, determinant = 0;
    int not_finite = 0, wrong_order = 0, wrong_sign = 0;
};

template <int d>
double from_identity(Exact<d> const& Q)
{
    return (Q.transpose() * Q - Exact<d>::Identity()).cwiseAbs().maxCoeff();
}

template <int d>
void compare(Exact<d> const& F, Values<d> const& found, Worst& worst)
{
    auto const& [U, V, sigma] = found;
    if (!U.allFinite() || !V.allFinite() || !sigma.allFinite()) {
        ++worst.not_finite;
        return;
    }
    auto const raise = [](double& old, double now) { old = std::max(old, now); };
    Long<d> const back = U.template cast<long double>() * sigma.template cast<long double>().asDiagonal() *
                         V.template cast<long double>().transpose();
    double const norm = F.norm();
    double const difference = (back - F.template cast<long double>()).template cast<double>().norm();
    raise(worst.residual, difference / (norm > 0 ? norm : 1));
    raise(worst.U, from_identity<d>(U));
    raise(worst.V, from_identity<d>(V));
    raise(worst.determinant, std::max(std::abs(U.determinant() - 1), std::abs(V.determinant() - 1)));
    ExactVector<d> const reference =
        Eigen::JacobiSVD<Long<d>>(F.template cast<long double>()).singularValues().template cast<double>();
    double const largest = reference[0] > 0 ? reference[0] : 1;
    raise(worst.sigma, (sigma.cwiseAbs() - reference).cwiseAbs().maxCoeff() / largest);
    bool ordered = sigma[d - 2] >= std::abs(sigma[d - 1]);
    for (int i = 0; i + 2 < d; ++i) ordered = ordered && sigma[i] >= sigma[i + 1];
    worst.wrong_order += !ordered;
    double const determinant = F.determinant() / std::pow(largest, d);
    worst.wrong_sign += std::abs(determinant) > 1e-5 && (determinant > 0) != (sigma[d - 1] > 0);
}

template <int d>
void check_singular_values(decltype(&values_by<double, d>) find, bool single)
{
    Bounds const bound = bounds(single);
    for (auto const& kind : kinds<d>()) {
        Source<d> source;
        std::vector<Exact<d>> matrices(10000);
        for (auto& F : matrices) F = rounded_to<d>(single, kind.make(source));
        auto const found = find(matrices);
        Worst worst;
        for (std::size_t i = 0; i < matrices.size(); ++i) compare<d>(matrices[i], found[i], worst);
        INFO(d << " dimensions, " << kind.name);
        CHECK(worst.not_finite == 0);
        CHECK(worst.residual <= bound.error);
        CHECK(worst.U <= bound.error);
        CHECK(worst.V <= bound.error);
        CHECK(worst.sigma <= bound.error);
        CHECK(worst.determinant <= bound.determinant);
        CHECK(worst.wrong_order == 0);
        CHECK(worst.wrong_sign == 0);
    }
}

template <int d>
void check_nothing(decltype(&values_by<double, d>) find, std::size_t width)
{
    for (auto const& [U, V, sigma] : find(std::vector<Exact<d>>(width, Exact<d>::Zero()))) {
        CHECK(U == Exact<d>::Identity());
        CHECK(V == Exact<d>::Identity());
        CHECK(sigma == ExactVector<d>::Zero());
    }
}

template <int d>
void check_that_what_is_not_finite_stays_so(decltype(&values_by<double, d>) find, std::size_t width)
{
    for (double poison : {std::nan(""), std::numeric_limits<double>::infinity()}) {
        Source<d> source;
        for (int entry = 0; entry < d * d; ++entry) {
            std::size_t const bad = static_cast<std::size_t>(entry) % width;
            std::vector<Exact<d>> matrices(width, source.any());
            matrices[bad](entry) = poison;
            auto const found = find(matrices);
            for (std::size_t lane = 0; lane < width; ++lane) {
                INFO("entry " << entry << ", lane " << lane << ", poisoned lane " << bad);
                auto const& [U, V, sigma] = found[lane];
                CHECK(U.array().isNaN().all() == (lane == bad));
                CHECK(sigma.array().isNaN().all() == (lane == bad));
                CHECK(V.array().isNaN().all() == (lane == bad));
                CHECK(U.allFinite() == (lane != bad));
            }
        }
    }
}

template <class Real, int d>
void check_inverses()
{
    using Lanes = Matrix<Real, d>;
    Source<d> source;
    std::vector<Exact<d>> matrices(800);
    for (auto& F : matrices) F = rounded_to<d>(is_single<Real>, Exact<d>::Identity() + 0.1 * source.any());
    auto const plain = inverses_by<Real, d>(matrices, [](Lanes const& F) { return Lanes(inverse(F)); });
    auto const turned =
        inverses_by<Real, d>(matrices, [](Lanes const& F) { return Lanes(inverse_transpose(F)); });
    auto const scaled = inverses_by<Real, d>(matrices, [](Lanes const& F) { return Lanes(cofactors(F)); });
    double worst = 0;
    for (std::size_t i = 0; i < matrices.size(); ++i) {
        Exact<d> const &A = matrices[i], I = A.inverse();
        worst = std::max(worst, (plain[i] - I).norm());
        worst = std::max(worst, (turned[i] - I.transpose()).norm());
        worst = std::max(worst, (scaled[i] - A.determinant() * I.transpose()).norm());
    }
    CHECK(worst <= 10 * bounds(is_single<Real>).error);
}

} // namespace

TEMPLATE_LIST_TEST_CASE("Singular values of every kind of matrix are exact to rounding", "", LaneTypes)
{
    check_singular_values<3>(values_by<TestType, 3>, is_single<TestType>);
    check_singular_values<2>(values_by<TestType, 2>, is_single<TestType>);
}

TEMPLATE_LIST_TEST_CASE("The zero matrix has U = V = I and no stretch", "", LaneTypes)
{
    check_nothing<3>(values_by<TestType, 3>, lane_width<TestType>);
    check_nothing<2>(values_by<TestType, 2>, lane_width<TestType>);
}

TEMPLATE_LIST_TEST_CASE("A matrix that is not finite gives NaN, in its own lane only", "", LaneTypes)
{
    check_that_what_is_not_finite_stays_so<3>(values_by<TestType, 3>, lane_width<TestType>);
    check_that_what_is_not_finite_stays_so<2>(values_by<TestType, 2>, lane_width<TestType>);
}

TEMPLATE_LIST_TEST_CASE("Inverse, inverse transpose and cofactors agree with Eigen's", "", LaneTypes)
{
    check_inverses<TestType, 3>();
    check_inverses<TestType, 2>();
}

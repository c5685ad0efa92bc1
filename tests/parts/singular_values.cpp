// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/lane_types.hpp"
#include "support/matrices.hpp"

#include <firn/math/inverse.hpp>
#include <firn/math/singular_values.hpp>

#include <Eigen/SVD>

#include <vector>

namespace
{

using namespace firn;
using test::Exact;
using test::ExactVector;
using test::kinds;
using test::LaneTypes;
using test::matrix_of;
using test::pack;
using test::Source;

constexpr int count = 10000;

// One copy each for all tests: what it costs is to be compiled.
template <class Real, int d>
[[gnu::noinline]] SingularValues<Real, d> values_of_lanes(Matrix<Real, d> const& F)
{
    return singular_values(F);
}

struct Bounds
{
    double error, determinant;
};

template <class Number>
constexpr Bounds bounds = sizeof(Number) == 4 ? Bounds{1e-6, 3e-6} : Bounds{2e-15, 1e-14};

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
void compare(Exact<d> const& F, Exact<d> const& U, ExactVector<d> const& sigma, Exact<d> const& V,
             Worst& worst)
{
    if (!U.allFinite() || !V.allFinite() || !sigma.allFinite()) {
        ++worst.not_finite;
        return;
    }
    auto const raise = [](double& old, double now) { old = std::max(old, now); };
    using Long = Eigen::Matrix<long double, d, d>;
    Long const back = U.template cast<long double>() * sigma.template cast<long double>().asDiagonal() *
                      V.template cast<long double>().transpose();
    double const norm = F.norm();
    double const difference = (back - F.template cast<long double>()).template cast<double>().norm();
    raise(worst.residual, difference / (norm > 0 ? norm : 1));
    raise(worst.U, from_identity<d>(U));
    raise(worst.V, from_identity<d>(V));
    raise(worst.determinant, std::max(std::abs(U.determinant() - 1), std::abs(V.determinant() - 1)));
    ExactVector<d> const reference =
        Eigen::JacobiSVD<Long>(F.template cast<long double>()).singularValues().template cast<double>();
    double const largest = reference[0] > 0 ? reference[0] : 1;
    raise(worst.sigma, (sigma.cwiseAbs() - reference).cwiseAbs().maxCoeff() / largest);
    bool ordered = sigma[d - 2] >= std::abs(sigma[d - 1]);
    for (int i = 0; i + 2 < d; ++i) ordered = ordered && sigma[i] >= sigma[i + 1];
    worst.wrong_order += !ordered;
    double const determinant = F.determinant() / std::pow(largest, d);
    worst.wrong_sign += std::abs(determinant) > 1e-5 && (determinant > 0) != (sigma[d - 1] > 0);
}

template <class Real, int d>
Worst worst_of(test::Kind<d> const& kind)
{
    Source<d> source;
    Worst worst;
    for (int i = 0; i < count; i += lane_width<Real>) {
        std::vector<Exact<d>> matrices(lane_width<Real>);
        for (auto& F : matrices) F = kind.make(source).template cast<Scalar<Real>>().template cast<double>();
        auto const found = values_of_lanes<Real, d>(pack<Real, d>(matrices));
        for (int lane = 0; lane < lane_width<Real>; ++lane)
            compare<d>(matrices[static_cast<std::size_t>(lane)], matrix_of(found.U, lane),
                       matrix_of(found.sigma, lane), matrix_of(found.V, lane), worst);
    }
    return worst;
}

template <class Real, int d>
void check_singular_values()
{
    constexpr Bounds bound = bounds<Scalar<Real>>;
    for (auto const& kind : kinds<d>()) {
        INFO(d << " dimensions, " << lane_width<Real> << " lanes, " << kind.name);
        Worst const worst = worst_of<Real, d>(kind);
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

template <class Real, int d>
void check_that_what_is_not_finite_stays_so(double poison)
{
    Source<d> source;
    for (int entry = 0; entry < d * d; ++entry) {
        int const bad = entry % lane_width<Real>;
        std::vector<Exact<d>> matrices(lane_width<Real>, source.any());
        matrices[static_cast<std::size_t>(bad)](entry) = poison;
        auto const found = values_of_lanes<Real, d>(pack<Real, d>(matrices));
        for (int lane = 0; lane < lane_width<Real>; ++lane) {
            INFO("entry " << entry << ", lane " << lane << ", poisoned lane " << bad);
            auto const U = matrix_of(found.U, lane), V = matrix_of(found.V, lane);
            auto const sigma = matrix_of(found.sigma, lane);
            CHECK(U.array().isNaN().all() == (lane == bad));
            CHECK(sigma.array().isNaN().all() == (lane == bad));
            CHECK(V.array().isNaN().all() == (lane == bad));
            CHECK(U.allFinite() == (lane != bad));
        }
    }
}

template <class Real, int d>
void check_inverses()
{
    Source<d> source;
    double worst = 0;
    for (int i = 0; i < 100; ++i) {
        std::vector<Exact<d>> matrices(lane_width<Real>);
        for (auto& F : matrices) F = Exact<d>::Identity() + 0.1 * source.any();
        Matrix<Real, d> const F = pack<Real, d>(matrices);
        for (int lane = 0; lane < lane_width<Real>; ++lane) {
            Exact<d> const A = matrix_of(F, lane), I = A.inverse();
            worst = std::max(worst, (matrix_of(inverse(F), lane) - I).norm());
            worst = std::max(worst, (matrix_of(inverse_transpose(F), lane) - I.transpose()).norm());
            worst = std::max(worst, (matrix_of(cofactors(F), lane) - A.determinant() * I.transpose()).norm());
        }
    }
    CHECK(worst <= 10 * bounds<Scalar<Real>>.error);
}

} // namespace

TEMPLATE_LIST_TEST_CASE("Singular values of every kind of 3 x 3 matrix are exact to rounding", "", LaneTypes)
{
    check_singular_values<TestType, 3>();
}

TEMPLATE_LIST_TEST_CASE("Singular values of every kind of 2 x 2 matrix are exact to rounding", "", LaneTypes)
{
    check_singular_values<TestType, 2>();
}

TEMPLATE_LIST_TEST_CASE("The zero matrix has U = V = I and no stretch", "", LaneTypes)
{
    auto const found = values_of_lanes<TestType, 3>(Matrix<TestType, 3>::Zero());
    auto const flat = values_of_lanes<TestType, 2>(Matrix<TestType, 2>::Zero());
    for (int lane = 0; lane < lane_width<TestType>; ++lane) {
        CHECK(matrix_of(found.U, lane) == Exact<3>::Identity());
        CHECK(matrix_of(found.V, lane) == Exact<3>::Identity());
        CHECK(matrix_of(found.sigma, lane) == ExactVector<3>::Zero());
        CHECK(matrix_of(flat.U, lane) == Exact<2>::Identity());
        CHECK(matrix_of(flat.V, lane) == Exact<2>::Identity());
        CHECK(matrix_of(flat.sigma, lane) == ExactVector<2>::Zero());
    }
}

TEMPLATE_LIST_TEST_CASE("A matrix that is not finite gives NaN, in its own lane only", "", LaneTypes)
{
    for (double poison : {std::nan(""), std::numeric_limits<double>::infinity()}) {
        check_that_what_is_not_finite_stays_so<TestType, 3>(poison);
        check_that_what_is_not_finite_stays_so<TestType, 2>(poison);
    }
}

TEMPLATE_LIST_TEST_CASE("Inverse, inverse transpose and cofactors agree with Eigen's", "", LaneTypes)
{
    check_inverses<TestType, 3>();
    check_inverses<TestType, 2>();
}

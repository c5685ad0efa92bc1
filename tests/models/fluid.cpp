// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/one_element.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

template <class Space>
Fluid<Space> tait(double exponent, double viscosity = 0)
{
    Fluid<Space> model;
    model.exponent = static_cast<typename Space::Real>(exponent);
    model.viscosity = static_cast<typename Space::Real>(viscosity);
    model.parts = false;
    return model;
}

/// The energy of Tait's equation [Pa].
double energy_of_volume(double K, double gamma, double J)
{
    if (gamma == 1) return K * (J - 1 - std::log(J));
    return K / gamma * ((std::pow(J, 1 - gamma) - gamma) / (gamma - 1) + J);
}

} // namespace

TEMPLATE_TEST_CASE("a fluid's pressure is the derivative of Tait's energy, and its wave modulus the second",
                   "", Plane, Solid)
{
    constexpr int d = TestType::dimension;
    for (double gamma : {1.0, 4.0, 7.0})
        for (double J : {0.7, 0.95, 0.999, 1.0, 1.001, 1.3}) {
            auto const model = tait<TestType>(gamma);
            auto state = Record<double, d, typename Fluid<TestType>::State>::at_rest();
            Matrix<double, d> L = Matrix<double, d>::Zero();
            L(0, 0) = std::log(J);
            auto const response = model.template respond<double>(state, L, 1.0);
            double const K = model.bulk_modulus, step = 1e-5;
            double const up = energy_of_volume(K, gamma, J * (1 + step)),
                         here = energy_of_volume(K, gamma, J),
                         down = energy_of_volume(K, gamma, J * (1 - step));
            Matrix<double, d> const expected = Matrix<double, d>::Identity() * ((up - down) / (2 * step));
            CHECK((response.kirchhoff_stress - expected).norm() <= 1e-7 * K);
            double const modulus = (up - 2 * here + down) / (step * step);
            CHECK(response.wave_modulus == Approx(std::max(modulus, K)).epsilon(1e-4));
        }
}

TEST_CASE("a column of Tait's fluid settles to its known height under its weight")
{
    // p = rho_0 g (H - Y) by reference height Y, whatever the equation of state; the height is the sum of J.
    auto const model = tait<Solid>(7);
    double const H = 1, weight = 1000 * 9.81;
    auto const pressure = [&](double J) {
        auto state = Record<double, 3, Fluid<Solid>::State>::at_rest();
        Eigen::Matrix3d const L = Eigen::Matrix3d::Identity() * (std::log(J) / 3);
        return -model.respond<double>(state, L, 1.0).kirchhoff_stress(0, 0) / J;
    };
    double height = 0;
    int const layers = 1000;
    for (int i = 0; i < layers; ++i) {
        double const wanted = weight * (i + 0.5) / layers * H;
        double low = 0.5, high = 1.5;
        for (int j = 0; j < 60; ++j) {
            double const middle = 0.5 * (low + high);
            (pressure(middle) > wanted ? low : high) = middle;
        }
        height += low * H / layers;
    }
    CHECK(height == Approx(.97819601).epsilon(1e-7));
}

TEMPLATE_TEST_CASE("a viscous fluid has Newton's stress, and none of it in rotation", "", Plane, Solid)
{
    constexpr int d = TestType::dimension;
    auto const model = tait<TestType>(7, 5.0);
    std::mt19937 random(31);
    for (int i = 0; i < 100; ++i) {
        Matrix<double, d> L = random_matrix<d>(random);
        auto state = Record<double, d, typename Fluid<TestType>::State>::at_rest();
        auto const tau = model.template respond<double>(state, L, 0.0).kirchhoff_stress;
        Matrix<double, d> const expected =
            5.0 * (L + L.transpose() - Matrix<double, d>::Identity() * (2.0 / d * L.trace()));
        CHECK((tau - expected).norm() <= 1e-12 * expected.norm());
        CHECK((tau.array() * L.array()).sum() >= 0); // dissipates
        Matrix<double, d> const spin = L - L.transpose();
        CHECK(model.template respond<double>(state, spin, 0.0).kirchhoff_stress.norm() <= 1e-12);
    }
}

TEST_CASE("a fluid that parts bears no tension, and forgets how far it was torn")
{
    Fluid<Solid> const model;
    auto state = Record<double, 3, Fluid<Solid>::State>::at_rest();
    CHECK(model.respond<double>(state, Eigen::Matrix3d::Identity() * 0.1, 1.0).kirchhoff_stress.norm() == 0);
    CHECK(state[LogVolumeRatio{}] == 0);
    CHECK(model.respond<double>(state, Eigen::Matrix3d::Identity() * -0.01, 1.0).kirchhoff_stress(0, 0) < 0);
}

TEST_CASE("a fluid in single precision sees compressions far below those of rounding a volume")
{
    auto const model = tait<SolidFloat>(7);
    auto state = Record<float, 3, Fluid<SolidFloat>::State>::at_rest();
    Eigen::Matrix3f const L = Eigen::Matrix3f::Identity() * (-1e-10f / 3);
    Eigen::Matrix3f tau;
    for (int i = 0; i < 100; ++i) tau = model.respond<float>(state, L, 1.0f).kirchhoff_stress;
    CHECK(tau(0, 0) == Approx(-1e-8 * 2e5).epsilon(1e-4));
}

TEST_CASE("e^x - 1 and ln(1 + x) are exact to a few units of the last place, small or large")
{
    for (double x = 1e-12; x < 30; x *= 1.07)
        for (double sign : {-1.0, 1.0}) {
            CHECK(exp_minus_one(sign * x) == Approx(std::expm1(sign * x)).epsilon(2e-15).margin(0));
            float const y = static_cast<float>(sign * x);
            CHECK(exp_minus_one(y) == Approx(std::expm1(double(y))).epsilon(5e-7).margin(0));
            if (sign * x > -0.99)
                CHECK(log_one_plus(sign * x) == Approx(std::log1p(sign * x)).epsilon(1e-15).margin(0));
        }
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/one_element.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

template <class Space>
OneElement<Fluid<Space>> tait(double exponent, double viscosity = 0)
{
    OneElement<Fluid<Space>> fluid;
    fluid.model.exponent = static_cast<typename Space::Scalar>(exponent);
    fluid.model.viscosity = static_cast<typename Space::Scalar>(viscosity);
    fluid.model.parts = false;
    return fluid;
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
            auto const fluid = tait<TestType>(gamma);
            auto state = fluid.at_rest(1).front();
            Matrix<double, d> L = Matrix<double, d>::Zero();
            L(0, 0) = std::log(J);
            auto const response = fluid.step(state, L, 1);
            double const K = fluid.model.bulk_modulus, step = 1e-5;
            double const up = energy_of_volume(K, gamma, J * (1 + step)),
                         here = energy_of_volume(K, gamma, J),
                         down = energy_of_volume(K, gamma, J * (1 - step));
            CHECK(fluid.model.template energy<double>(state) == Approx(here).epsilon(1e-9));
            Matrix<double, d> const expected = Matrix<double, d>::Identity() * ((up - down) / (2 * step));
            CHECK((response.kirchhoff_stress - expected).norm() <= 1e-7 * K);
            double const modulus = (up - 2 * here + down) / (step * step);
            CHECK(response.wave_modulus == Approx(std::max(modulus, K)).epsilon(1e-4));
        }
}

TEST_CASE("a column of Tait's fluid settles to its known height under its weight")
{
    // p = rho_0 g (H - Y) by reference height Y, whatever the equation of state; the height is the sum of J.
    auto const fluid = tait<Solid>(7);
    double const H = 1, weight = 1000 * 9.81;
    std::size_t const layers = 1000;
    std::vector<double> low(layers, 0.5), high(layers, 1.5); // of J, by bisection
    for (int j = 0; j < 60; ++j) {
        std::vector<Eigen::Matrix3d> rates;
        for (std::size_t i = 0; i < layers; ++i)
            rates.push_back(Eigen::Matrix3d::Identity() * (std::log(0.5 * (low[i] + high[i])) / 3));
        auto states = fluid.at_rest(layers);
        auto const answers = fluid.drive(states, {rates}, 1);
        for (std::size_t i = 0; i < layers; ++i) {
            double const J = 0.5 * (low[i] + high[i]), pressure = -answers[i].kirchhoff_stress(0, 0) / J;
            (pressure > weight * (double(i) + 0.5) / double(layers) * H ? low : high)[i] = J;
        }
    }
    double height = 0;
    for (double J : low) height += J * H / double(layers);
    CHECK(height == Approx(.97819601).epsilon(1e-7));
}

TEMPLATE_TEST_CASE("a viscous fluid has Newton's stress, and none of it in rotation", "", Plane, Solid)
{
    constexpr int d = TestType::dimension;
    using Tensor = Matrix<double, d>;
    auto const fluid = tait<TestType>(7, 5.0);
    std::mt19937 random(31);
    std::vector<Tensor> rates, spins;
    for (int i = 0; i < 100; ++i) {
        rates.push_back(random_matrix<d>(random));
        spins.push_back(rates.back() - rates.back().transpose());
    }
    auto states = fluid.at_rest(rates.size());
    auto const sheared = fluid.drive(states, {rates}, 0), turned = fluid.drive(states, {spins}, 0);
    for (std::size_t i = 0; i < rates.size(); ++i) {
        Tensor const &L = rates[i], &tau = sheared[i].kirchhoff_stress;
        Tensor const expected = 5.0 * (L + L.transpose() - Tensor::Identity() * (2.0 / d * L.trace()));
        CHECK((tau - expected).norm() <= 1e-12 * expected.norm());
        CHECK((tau.array() * L.array()).sum() >= 0); // dissipates
        CHECK(turned[i].kirchhoff_stress.norm() <= 1e-12);
    }
}

TEST_CASE("a fluid that parts bears no tension, and forgets how far it was torn")
{
    OneElement<Fluid<Solid>> const fluid;
    auto state = fluid.at_rest(1).front();
    CHECK(fluid.step(state, Eigen::Matrix3d::Identity() * 0.1, 1).kirchhoff_stress.norm() == 0);
    CHECK(state[LogVolumeRatio{}] == 0);
    CHECK(fluid.step(state, Eigen::Matrix3d::Identity() * -0.01, 1).kirchhoff_stress(0, 0) < 0);
}

TEMPLATE_TEST_CASE(
    "a fluid that does not part holds its tension at twice its volume, and says that it is capped", "", Plane,
    Solid)
{
    constexpr int d = TestType::dimension;
    using Tensor = Matrix<double, d>;
    for (double gamma : {1.0, 7.0}) {
        auto const fluid = tait<TestType>(gamma);
        double const K = fluid.model.bulk_modulus;
        auto state = fluid.at_rest(1).front();
        auto const stretched = [&](double log_J, int times = 1) {
            return fluid.step(state, Tensor::Identity() * (log_J / d), 1, times);
        };
        CHECK_FALSE(stretched(0.69).capped);
        double last = stretched(0).kirchhoff_stress(0, 0);
        CHECK(last > 0);
        auto const far = stretched(1, 30); // without a cap e^30.69 times its volume, and as much stress
        CHECK(far.capped);
        CHECK(far.kirchhoff_stress(0, 0) == Approx(2 * K / gamma * (1 - std::pow(2, -gamma))));
        CHECK(far.kirchhoff_stress(0, 0) <= far.wave_modulus * (1 + 1e-12));
        CHECK(state[LogVolumeRatio{}] == Approx(std::log(fluid.model.largest_volume_ratio)));
        CHECK_FALSE(stretched(-0.1).capped); // and comes back from there
        CHECK(state[LogVolumeRatio{}] == Approx(std::log(2.0) - 0.1));
    }
    OneElement<Fluid<TestType>> const water; // parts: no cap, since it has nothing to hold
    auto state = water.at_rest(1).front();
    CHECK_FALSE(water.step(state, Tensor::Identity(), 1, 30).capped);
}

TEST_CASE("a fluid in single precision sees compressions far below those of rounding a volume")
{
    auto const fluid = tait<SolidFloat>(7);
    auto state = fluid.at_rest(1).front();
    auto const tau = fluid.step(state, Eigen::Matrix3d::Identity() * (-1e-10 / 3), 1, 100).kirchhoff_stress;
    CHECK(tau(0, 0) == Approx(-1e-8 * 2e5).epsilon(1e-4));
}

TEST_CASE("e^x - 1 and ln(1 + x) are exact to a few units of the last place, small or large")
{
    for (double x = 1e-12; x < 30; x *= 1.07)
        for (double sign : {-1.0, 1.0}) {
            CHECK(exp_minus_one(sign * x) == Approx(std::expm1(sign * x)).epsilon(2e-15).margin(0));
            float const y = static_cast<float>(sign * x);
            CHECK(exp_minus_one(y) == Approx(std::expm1(double(y))).epsilon(5e-7).margin(0));
            if (sign * x > -0.99) {
                CHECK(log_one_plus(sign * x) == Approx(std::log1p(sign * x)).epsilon(4.5e-16).margin(0));
                CHECK(log_one_plus(y) == Approx(std::log1p(double(y))).epsilon(2.4e-7).margin(0));
            }
        }
    CHECK(log_one_plus(1e38f) ==
          Approx(std::log(1e38)).epsilon(2.4e-7)); // u - 1 times ln u is more than any float
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/long_double.hpp"
#include "support/one_element.hpp"

#include <array>

using namespace firn;
using namespace firn::test;

// What every plastic flow owes, and the closed forms of each.
namespace
{

/// A material for maps of an otherwise unchanged state: hardening moves the yield surface.
template <class Model>
void forget_flow(typename OneElement<Model>::State& state)
{
    auto const fresh = OneElement<Model>::State::at_rest();
    if constexpr (Model::State::template contains<LogPlasticVolumeRatio>)
        state[LogPlasticVolumeRatio{}] = fresh[LogPlasticVolumeRatio{}];
}

/// Random deformations by stretches within bounds.
template <int d>
std::vector<Matrix<double, d>> random_deformations(std::mt19937& random, int count, double low, double high)
{
    std::vector<Matrix<double, d>> deformations;
    for (int i = 0; i < count; ++i) deformations.push_back(random_deformation<d>(random, low, high));
    return deformations;
}

/// How far a stress is beyond yield, over the scale of stresses.
template <class Space>
double beyond_yield(VonMises<Space> const& model, OneElement<VonMises<Space>> const&,
                    typename OneElement<VonMises<Space>>::State const&,
                    Matrix<double, Space::dimension> const& tau)
{
    constexpr int d = Space::dimension;
    Matrix<double, d> const s = tau - Matrix<double, d>::Identity() * (tau.trace() / d);
    return (s.norm() - std::sqrt(2.0 / 3) * model.yield_stress) / model.elasticity.mu;
}

template <class Space>
double beyond_yield(HardeningVonMises<Space> const& model, OneElement<HardeningVonMises<Space>> const&,
                    typename OneElement<HardeningVonMises<Space>>::State const& state,
                    Matrix<double, Space::dimension> const& tau)
{
    constexpr int d = Space::dimension;
    Matrix<double, d> const s = tau - Matrix<double, d>::Identity() * (tau.trace() / d);
    double const yield = model.yield_stress + model.hardening_modulus * state[EquivalentPlasticStrain{}];
    return (s.norm() - std::sqrt(2.0 / 3) * yield) / model.elasticity.mu;
}

template <class Space>
double beyond_yield(Sand<Space> const& model, OneElement<Sand<Space>> const&,
                    typename OneElement<Sand<Space>>::State const&,
                    Matrix<double, Space::dimension> const& tau)
{
    constexpr int d = Space::dimension;
    Matrix<double, d> const s = tau - Matrix<double, d>::Identity() * (tau.trace() / d);
    return (s.norm() + model.cone * tau.trace()) / model.elasticity.mu;
}

template <class Space>
double beyond_yield(CamClay<Space> const& model, OneElement<CamClay<Space>> const&,
                    typename OneElement<CamClay<Space>>::State const&,
                    Matrix<double, Space::dimension> const& tau)
{
    constexpr int d = Space::dimension;
    double const kappa = model.elasticity.lambda + 2 * model.elasticity.mu / d;
    Matrix<double, d> const s = tau - Matrix<double, d>::Identity() * (tau.trace() / d);
    double const p = -tau.trace() / d, q = std::sqrt((6.0 - d) / 2) * s.norm(), beta = model.cohesion;
    double const p0 = kappa * (1e-5 + std::sinh(-model.hardening * model.start)); // as it was
    return ((1 + 2 * beta) * q * q + std::pow(model.slope, 2) * (p + beta * p0) * (p - p0)) / (p0 * kappa);
}

template <class Space>
double beyond_yield(Snow<Space> const& model, OneElement<Snow<Space>> const&,
                    typename OneElement<Snow<Space>>::State const& state,
                    Matrix<double, Space::dimension> const&)
{
    auto const sigma = singular_values(OneElement<Snow<Space>>::elastic_part(state)).sigma;
    return std::max(sigma.maxCoeff() - 1 - model.critical_stretch,
                    1 - model.critical_compression - sigma.minCoeff());
}

template <class Model>
constexpr bool is_snow = std::is_same_v<Model, Snow<typename Model::Space>>;

template <class Space>
using RateIndependent =
    std::tuple<Snow<Space>, VonMises<Space>, HardeningVonMises<Space>, Sand<Space>, CamClay<Space>>;

} // namespace

using Flows = Tested<RateIndependent<Plane>, RateIndependent<Solid>>;

TEMPLATE_LIST_TEST_CASE("a return map ends on the yield surface, is idempotent and dissipates", "", Flows)
{
    constexpr int d = TestType::Space::dimension;
    using Tensor = Matrix<double, d>;
    OneElement<TestType> const material;
    double const rounding = 1e-15 * material.model.elasticity.p_wave_modulus();
    std::mt19937 random(24);
    int flowed = 0;
    for (double spread : {0.3, 0.02}) {
        auto const deformations = random_deformations<d>(random, 500, 1 - spread, 1 + spread);
        auto states = material.at_rest(deformations.size());
        auto const answers = material.answers(states, deformations);
        auto const mapped = states;
        for (auto& state : states) forget_flow<TestType>(state);
        auto again = states;
        material.drive(again, {std::vector<Tensor>(again.size(), Tensor::Zero())}, 1);
        for (std::size_t i = 0; i < mapped.size(); ++i) {
            auto const& F = deformations[i];
            auto const F_E = material.elastic_part(mapped[i]);
            flowed += (F_E - F).norm() > 1e-6;
            CHECK(beyond_yield(material.model, material, mapped[i], answers[i].kirchhoff_stress) <= 1e-9);
            // Snow's clamp is no projection: in space it may raise the energy a little, see models/snow.cpp.
            if (!is_snow<TestType> || d == 2 || spread > 0.1)
                CHECK(energy(material.model, F_E) <= energy(material.model, F) * (1 + 1e-12) + rounding);

            CHECK((material.elastic_part(again[i]) - F_E).norm() <= 1e-12);
            double kept = 0;
            states[i].for_each([&](int, double& x) { kept += x; });
            again[i].for_each([&](int, double& x) { kept -= x; });
            CHECK(std::abs(kept) <= 1e-11);
        }
    }
    CHECK(flowed > 500);
}

#if defined(FIRN_TESTS_ALL) || defined(__CUDACC__)
using FloatFlows = Tested<RateIndependent<PlaneFloat>, RateIndependent<SolidFloat>>;
#else
using FloatFlows = Tested<RateIndependent<SolidFloat>>;
#endif

TEMPLATE_LIST_TEST_CASE("in single precision a return map is idempotent to rounding", "", FloatFlows)
{
    constexpr int d = TestType::Space::dimension;
    OneElement<TestType> const material;
    std::mt19937 random(24);
    auto states = material.at_rest(500);
    material.answers(states, random_deformations<d>(random, 500, 0.7, 1.3));
    if constexpr (TestType::State::template contains<LogPlasticVolumeRatio>)
        for (auto& state : states) state[LogPlasticVolumeRatio{}] = 0;
    auto again = states;
    material.drive(again, {std::vector<Matrix<double, d>>(500, Matrix<double, d>::Zero())}, 1);
    for (std::size_t i = 0; i < states.size(); ++i)
        CHECK((again[i][DisplacementGradient{}] - states[i][DisplacementGradient{}]).norm() <= 1e-5);
}

TEMPLATE_TEST_CASE("snow's volume is that of its elastic part times that of its plastic part", "",
                   Snow<Plane>, Snow<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    OneElement<TestType> const material;
    std::mt19937 random(27);
    auto const deformations = random_deformations<d>(random, 200, 0.7, 1.3);
    auto states = material.at_rest(200);
    material.answers(states, deformations);
    for (std::size_t i = 0; i < states.size(); ++i)
        CHECK(material.elastic_part(states[i]).determinant() * states[i][PlasticVolumeRatio{}] ==
              Approx(deformations[i].determinant()).epsilon(1e-12));
}

TEMPLATE_TEST_CASE("flow in shear keeps the volume", "", VonMises<Plane>, VonMises<Solid>,
                   HardeningVonMises<Solid>, HerschelBulkley<Plane>, HerschelBulkley<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    OneElement<TestType> const material;
    std::mt19937 random(28);
    auto const deformations = random_deformations<d>(random, 500, 0.5, 2);
    auto states = material.at_rest(500);
    material.answers(states, deformations);
    for (std::size_t i = 0; i < states.size(); ++i)
        CHECK(material.elastic_part(states[i]).determinant() ==
              Approx(deformations[i].determinant()).epsilon(1e-12));
}

TEMPLATE_TEST_CASE("Cam-Clay's flow in shear keeps the volume of random trial states too", "", CamClay<Plane>,
                   CamClay<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    OneElement<TestType> const material;
    double const kappa = material.model.elasticity.lambda + 2 * material.model.elasticity.mu / d;
    double const p0 = kappa * (1e-5 + std::sinh(-material.model.hardening * material.model.start));
    std::mt19937 random(29);
    auto deformations = random_deformations<d>(random, 2000, 0.5, 2);
    for (auto& F : deformations) { // to a volume with a pressure within the ellipse
        double const p = std::uniform_real_distribution<double>(-0.4 * p0, 0.9 * p0)(random);
        F *= std::pow(std::sqrt(1 - 2 * p / kappa) / F.determinant(), 1.0 / d);
    }
    auto states = material.at_rest(2000);
    material.answers(states, deformations);
    int sheared = 0;
    for (std::size_t i = 0; i < states.size(); ++i) {
        auto const& F = deformations[i];
        auto const F_E = material.elastic_part(states[i]);
        sheared += (F_E - F).norm() > 0.1;
        CHECK(F_E.determinant() == Approx(F.determinant()).epsilon(1e-11));
    }
    CHECK(sheared > 1000);
}

namespace
{

/// The answer to a stretch along x with no stress across: the stretch across is found by bisection.
template <class Model>
Matrix<double, Model::Space::dimension> uniaxial_stress(Model const& model, double stretch)
{
    constexpr int d = Model::Space::dimension;
    OneElement<Model> const material{model};
    auto const answer = [&](double across) {
        Matrix<double, d> F = Matrix<double, d>::Identity() * across;
        F(0, 0) = stretch;
        return material.stress(F);
    };
    double low = 0.3, high = 3;
    for (int i = 0; i < 60; ++i) {
        double const middle = 0.5 * (low + high);
        (answer(middle)(1, 1) < 0 ? low : high) = middle;
    }
    return answer(low);
}

} // namespace

TEST_CASE("von Mises yields in uniaxial stress at the yield stress, and in the plane at 2/sqrt(3) of it")
{
    VonMises<Solid> const solid;
    VonMises<Plane> const sheet;
    double const E = 1e6, Y = solid.yield_stress;
    for (double strain : {-0.2, -0.05, -0.02, 0.02, 0.05, 0.2}) {
        double const sign = strain < 0 ? -1 : 1;
        CHECK(uniaxial_stress(solid, std::exp(strain))(0, 0) == Approx(sign * Y).epsilon(1e-9));
        CHECK(uniaxial_stress(sheet, std::exp(strain))(0, 0) ==
              Approx(sign * 2 / std::sqrt(3.0) * Y).epsilon(1e-9));
    }
    CHECK(uniaxial_stress(solid, std::exp(0.009))(0, 0) == Approx(0.009 * E).epsilon(1e-9)); // before it
    CHECK(uniaxial_stress(solid, std::exp(0.0101))(0, 0) == Approx(Y).epsilon(1e-9));
}

TEST_CASE("with hardening the tangent beyond yield is E H / (E + H)")
{
    HardeningVonMises<Solid> model;
    model.hardening_modulus = 2e5;
    double const E = 1e6, Y = model.yield_stress, H = model.hardening_modulus;
    for (double strain : {0.02, 0.1, 0.3})
        CHECK(uniaxial_stress(model, std::exp(strain))(0, 0) ==
              Approx(Y + E * H / (E + H) * (strain - Y / E)).epsilon(1e-9));
}

TEST_CASE("sand in triaxial compression yields at q = M p, M = 6 sin(phi) / (3 - sin(phi))")
{
    struct
    {
        double degrees, alpha, M;
    } const known[]{{30, .32660, 1.2000}, {35, .38602, 1.41833}, {40, .44530, 0}};
    for (auto const& grains : known) {
        double const phi = grains.degrees * M_PI / 180, M = 6 * std::sin(phi) / (3 - std::sin(phi));
        OneElement<Sand<Solid>> material;
        material.model.cone = friction_cone(3, phi);
        CHECK(material.model.cone == Approx(grains.alpha).epsilon(2e-5));
        if (grains.M > 0) CHECK(M == Approx(grains.M).epsilon(1e-5));
        for (double axial : {0.85, 0.75, 0.6}) {
            double const across = std::pow(axial, -0.4);
            Eigen::Matrix3d const tau = material.stress(Eigen::Vector3d(axial, across, across).asDiagonal());
            double const q = std::abs(tau(0, 0) - tau(1, 1)), p = -tau.trace() / 3;
            CHECK(q / p == Approx(M).epsilon(1e-12));
        }
    }
}

TEST_CASE("sand in the plane has the angle of friction that it was given: that at which it stands")
{
    for (double degrees : {25.0, 35.0}) {
        OneElement<Sand<Plane>> material;
        material.model.cone = friction_cone(2, degrees * M_PI / 180);
        Eigen::Matrix2d const tau = material.stress(Eigen::Vector2d(0.8, 1.05).asDiagonal());
        double const sine = (tau(1, 1) - tau(0, 0)) / -tau.trace();
        CHECK(std::asin(sine) * 180 / M_PI == Approx(degrees).epsilon(1e-12));
        material.model.cone = friction_cone(3, 30 * M_PI / 180);
        Eigen::Matrix2d const other = material.stress(Eigen::Vector2d(0.8, 1.05).asDiagonal());
        CHECK(std::asin((other(1, 1) - other(0, 0)) / -other.trace()) * 180 / M_PI ==
              Approx(27.51).epsilon(2e-4));
    }
}

TEST_CASE("loose sand bears nothing, and bears again only when it has given back the volume that it gained")
{
    OneElement<Sand<Solid>> const material;
    auto state = OneElement<Sand<Solid>>::State::at_rest();
    auto const stretch = [&](double by) {
        Eigen::Matrix3d const L = Eigen::Matrix3d::Identity() * (by - 1);
        return material.step(state, L, 1).kirchhoff_stress;
    };
    CHECK(stretch(1.1).norm() == 0); // flies apart
    CHECK(state[LooseVolume{}] == Approx(3 * std::log(1.1)).epsilon(1e-12));
    CHECK(stretch(1 / 1.05).norm() <= 1e-9); // and comes together, but not all of the way
    CHECK(state[LooseVolume{}] == Approx(3 * std::log(1.1 / 1.05)).epsilon(1e-12));
    auto const tau = stretch(1.05 / 1.1 * 0.99);
    CHECK(state[LooseVolume{}] <= 1e-12);
    double const bulk = 3 * material.model.elasticity.lambda + 2 * material.model.elasticity.mu;
    CHECK(tau(0, 0) == Approx(bulk * std::log(0.99)).epsilon(1e-9));
}

namespace
{

/// Sand of an angle of friction and one of dilatancy [rad].
template <class Space>
OneElement<Sand<Space>> sand_of(double phi, double psi, Friction measured_on = Friction::standing)
{
    constexpr int d = Space::dimension;
    OneElement<Sand<Space>> material;
    material.model.cone = friction_cone(d, phi, measured_on, psi);
    material.model.dilatancy = dilatancy_cone(d, psi);
    return material;
}

/// Compressed in all directions alike, to a pressure [Pa].
template <class Space>
auto compressed(OneElement<Sand<Space>> const& material, double pressure)
{
    constexpr int d = Space::dimension;
    auto const& elasticity = material.model.elasticity;
    auto state = material.at_rest(1).front();
    double const strain = -pressure / (d * elasticity.lambda + 2 * elasticity.mu);
    material.answer(state, Matrix<double, d>::Identity() * std::exp(strain));
    return state;
}

/// What a band that is sheared at constant pressure bears over that pressure, and its growth over its shear.
struct Band
{
    double friction, growth;
};

template <class Space>
Band sheared(OneElement<Sand<Space>> const& material)
{
    constexpr int d = Space::dimension, candidates = 65;
    double const pressure = 100, shear = 1e-4;
    auto state = compressed(material, pressure);
    Band found{};
    for (int step = 0; step < 150; ++step) {
        std::vector<decltype(state)> states(candidates, state);
        std::vector<Matrix<double, d>> rates(candidates, Matrix<double, d>::Zero());
        auto const growth = [&](double i) { return shear * (4 * i / (candidates - 1) - 2); };
        for (int i = 0; i < candidates; ++i) {
            rates[i](0, 1) = shear;
            rates[i](1, 1) = growth(i);
        }
        auto const answers = material.drive(states, {rates}, 1);
        auto const excess = [&](int i) { return answers[i].kirchhoff_stress(1, 1) + pressure; };
        int i = 0;
        while (i + 2 < candidates && excess(i + 1) < 0) ++i;
        Matrix<double, d> rate = rates[0];
        rate(1, 1) = growth(i + excess(i) / (excess(i) - excess(i + 1)));
        auto const tau = material.step(state, rate, 1).kirchhoff_stress;
        found = {tau(0, 1) / -tau(1, 1), rate(1, 1) / shear};
    }
    return found;
}

} // namespace

TEMPLATE_TEST_CASE("sand's return goes along the flow of its dilatancy to the cone, and opens it at its edge",
                   "", Plane, Solid)
{
    constexpr int d = TestType::dimension;
    double const degrees = M_PI / 180, phi = 35 * degrees, most = Sand<TestType>{}.tension_cutoff;
    std::mt19937 random(31);
    for (double psi : {0.0, 10 * degrees, phi})
        for (auto const& [c, cutoff] : {std::pair{0.0, most}, {2e4, most}, {2e4, 5e3}}) {
            CAPTURE(psi, c, cutoff);
            auto material = sand_of<TestType>(phi, psi);
            auto& model = material.model;
            model.cohesion = c;
            model.tension_cutoff = cutoff;
            double const sine = std::sin(phi), mu = model.elasticity.mu,
                         k = c * std::cos(phi) *
                             (d == 2 ? std::sqrt(2.0) : 6 * std::sqrt(2.0 / 3) / (3 - sine)),
                         tension = std::min(cutoff, c / std::tan(phi));
            auto const deformations = random_deformations<d>(random, 300, 0.9, 1.1);
            auto states = material.at_rest(deformations.size());
            auto const answers = material.answers(states, deformations);
            int slid = 0, opened = 0, held = 0;
            for (std::size_t i = 0; i < states.size(); ++i) {
                auto const F_E = material.elastic_part(states[i]);
                Matrix<double, d> const& tau = answers[i].kirchhoff_stress;
                double const trace = tau.trace(),
                             beyond = beyond_yield(model, material, states[i], tau) * mu - k;
                Vector<double, d> const flow = singular_values(deformations[i]).sigma.array().log() -
                                               singular_values(F_E).sigma.array().log();
                double const growth = flow.sum(), loose = states[i][LooseVolume{}],
                             dilated = d * model.dilatancy *
                                       (flow - Vector<double, d>::Constant(growth / d)).norm();
                CHECK(beyond <= 1e-9 * mu);
                CHECK(trace <= d * tension + 1e-9 * mu);
                CHECK(energy(model, F_E) <= energy(model, deformations[i]) * (1 + 1e-12));
                if (flow.norm() < 1e-9) continue;
                if (loose > 1e-12) { // all of it is recovered
                    CHECK(trace == Approx(d * tension).margin(1e-9 * mu));
                    CHECK(loose == Approx(growth).epsilon(1e-9));
                    CHECK(growth >= dilated - 1e-12);
                    held += tau(0, 0) != Approx(tau(1, 1)).margin(1e-6 * mu);
                    ++opened;
                }
                else { // what they gained by dilatancy is not
                    CHECK(std::abs(beyond) <= 1e-9 * mu);
                    CHECK(growth == Approx(dilated).margin(1e-12));
                    ++slid;
                }
            }
            CHECK(slid > 20);
            CHECK(opened > 20);
            CHECK((held > 20) == (cutoff == 5e3)); // shear is borne at an edge, none at the tip
            auto const mapped = states;
            material.drive(states, {std::vector<Matrix<double, d>>(states.size(), Matrix<double, d>::Zero())},
                           1);
            for (std::size_t i = 0; i < states.size(); ++i) {
                CHECK((material.elastic_part(states[i]) - material.elastic_part(mapped[i])).norm() <= 1e-12);
                CHECK(states[i][LooseVolume{}] == Approx(mapped[i][LooseVolume{}]).margin(1e-12));
            }
        }
}

TEMPLATE_TEST_CASE("a shear band of sand bears less than it stands at, and opens by its dilatancy", "", Plane,
                   Solid)
{
    constexpr int d = TestType::dimension;
    double const degrees = M_PI / 180, phi = 30 * degrees;
    for (double psi : {0.0, 10 * degrees, phi}) {
        CAPTURE(psi);
        auto const strong = sand_of<TestType>(phi, psi);
        // in plane strain, see friction_cone; in the plane these are sin phi and sin psi
        double const alpha = strong.model.cone, beta = strong.model.dilatancy,
                     shear = std::sqrt(d == 2 ? 2 : 2 - 3 * beta * beta), sine_of_psi = d * beta / shear,
                     sine = d == 2 ? std::sin(phi) : 3 * alpha * shear / (2 - 3 * alpha * beta),
                     cosine_of_psi = std::sqrt(1 - sine_of_psi * sine_of_psi);
        if (d == 2) CHECK(sine_of_psi == Approx(std::sin(psi)).margin(1e-12));
        auto const of_strength = sheared(strong);
        CHECK(of_strength.friction == Approx(sine * cosine_of_psi / (1 - sine * sine_of_psi)).epsilon(2e-3));
        CHECK(of_strength.growth == Approx(sine_of_psi / cosine_of_psi).margin(2e-3));
        // and what flows from an angle bears that
        CHECK(sheared(sand_of<TestType>(phi, psi, Friction::flowing)).friction ==
              Approx(std::tan(phi)).epsilon(2e-3));
    }
    auto const sliding = sheared(sand_of<Plane>(phi, 0)), associated = sheared(sand_of<Plane>(phi, phi));
    CHECK(sliding.friction == Approx(std::sin(phi)).epsilon(2e-3)); // Davis 1968
    CHECK(associated.friction == Approx(std::tan(phi)).epsilon(2e-3));
}

TEST_CASE("sand keeps what it gains by dilatancy, and parted grains gain nothing by it")
{
    auto const material = sand_of<Plane>(30 * M_PI / 180, 10 * M_PI / 180);
    auto state = compressed(material, 100);
    Eigen::Matrix2d L = Eigen::Matrix2d::Zero();
    L(0, 1) = 1e-4;
    L(1, 1) = L(0, 1) * std::tan(10 * M_PI / 180);
    double const before = material.elastic_part(state).determinant();
    auto const sheared = material.step(state, L, 1, 100).kirchhoff_stress;
    CHECK(state[LooseVolume{}] <= 1e-15);
    CHECK(sheared.trace() == Approx(-200).epsilon(0.2)); // it has grown by 2e-3, and is under pressure still
    CHECK(material.elastic_part(state).determinant() == Approx(before).margin(1e-4));

    state = material.at_rest(1).front();
    material.answer(state, Eigen::Matrix2d::Identity() * std::exp(1e-3));
    L(1, 1) = 0;
    CHECK(material.step(state, L, 1, 100).kirchhoff_stress.norm() == 0);
    CHECK(state[LooseVolume{}] == Approx(2e-3).epsilon(1e-3));
}

TEST_CASE("sand with cohesion has the strength of Mohr and Coulomb's in Pa")
{
    double const phi = 30 * M_PI / 180, c = 1e4, sine = std::sin(phi), cosine = std::cos(phi);
    auto solid = sand_of<Solid>(phi, 0);
    solid.model.cohesion = c;
    Eigen::Matrix3d const tau = solid.stress(Eigen::Vector3d(0.8, 1.08, 1.08).asDiagonal());
    CHECK(std::abs(tau(0, 0) - tau(1, 1)) == Approx(6 / (3 - sine) * (sine * -tau.trace() / 3 + c * cosine)));
    auto sheet = sand_of<Plane>(phi, 0);
    sheet.model.cohesion = c;
    Eigen::Matrix2d const plane = sheet.stress(Eigen::Vector2d(0.8, 1.05).asDiagonal());
    CHECK((plane(1, 1) - plane(0, 0)) / 2 == Approx(sine * -plane.trace() / 2 + c * cosine));
}

TEMPLATE_TEST_CASE("sand with cohesion that is pulled reaches c / tan(phi) or its cut-off, and no more", "",
                   Plane, Solid)
{
    constexpr int d = TestType::dimension;
    double const phi = 30 * M_PI / 180, c = 1e4;
    auto material = sand_of<TestType>(phi, 0);
    auto& model = material.model;
    model.cohesion = c;
    double const expansion = d * model.elasticity.lambda + 2 * model.elasticity.mu;
    for (double const cutoff : std::array{double(model.tension_cutoff), 2e3, 0.0}) { // a list stops nvcc
        model.tension_cutoff = cutoff;
        double const most = std::min(cutoff, c / std::tan(phi));
        auto state = material.at_rest(1).front();
        Matrix<double, d> const pull = Matrix<double, d>::Identity() * 1e-4;
        for (int step = 1; step <= 1000; ++step) { // to e^0.1
            auto const tau = material.step(state, pull, 1).kirchhoff_stress;
            if (step % 50) continue;
            double const elastic = expansion * step * std::log1p(1e-4);
            CHECK(tau(0, 0) == Approx(std::min(most, elastic)).margin(1e-9));
        }
        // along one axis, too, the mean stays below it
        auto const tau =
            material.stress((Vector<double, d>::Ones() + Vector<double, d>::Unit(0)).asDiagonal());
        CHECK(tau.trace() <= d * most * (1 + 1e-12) + 1e-9);
        CHECK(std::isfinite(tau.norm()));
    }
}

TEMPLATE_TEST_CASE(
    "Cam-Clay that bears no tension has the angle of friction that it was given at the critical state", "",
    Plane, Solid)
{
    constexpr int d = TestType::dimension;
    CHECK(critical_slope(3, 30 * M_PI / 180) == Approx(1.2)); // the known values of 30 degrees
    CHECK(critical_slope(2, 30 * M_PI / 180) == Approx(1));
    CHECK(CamClay<TestType>{}.slope == Approx(critical_slope(d, 30 * M_PI / 180)).epsilon(1e-15));
    for (double degrees : {20.0, 30.0, 40.0}) {
        OneElement<CamClay<TestType>> material;
        auto& model = material.model;
        model.cohesion = 0;
        model.slope = critical_slope(d, degrees * M_PI / 180);
        double const kappa = model.elasticity.lambda + 2 * model.elasticity.mu / d;
        double const p0 = kappa * (1e-5 + std::sinh(-model.hardening * model.start));
        // to the pressure at the middle of the ellipse, where flow neither compacts nor opens, and pressed
        // along one axis far beyond it
        Vector<double, d> stretches = Vector<double, d>::Constant(std::pow(0.7, -1.0 / (d - 1)));
        stretches[0] = 0.7;
        stretches *= std::pow(1 - p0 / kappa, 0.5 / d);
        auto const tau = material.stress(stretches.asDiagonal());
        CHECK(-tau.trace() / d == Approx(p0 / 2).epsilon(1e-9));
        double const sine = (tau(1, 1) - tau(0, 0)) / -(tau(1, 1) + tau(0, 0));
        CHECK(std::asin(sine) * 180 / M_PI == Approx(degrees).epsilon(1e-9));
    }
    for (double bad : {0.0, -0.1, 30.0}) CHECK_THROWS_AS(critical_slope(d, bad), Error);
}

TEST_CASE("Cam-Clay that is compressed from all sides stays at the pressure that it is compacted to")
{
    OneElement<CamClay<Solid>> const material;
    auto const& model = material.model;
    auto state = material.at_rest(1).front();
    double const kappa = model.elasticity.lambda + 2 * model.elasticity.mu / 3;
    int const steps = 4000;
    double const ratio = std::exp(std::log(0.9) / (3.0 * steps)); // to J = 0.9
    Eigen::Matrix3d const L = Eigen::Matrix3d::Identity() * (ratio - 1);
    Eigen::Matrix3d const tau = material.step(state, L, 1, steps).kirchhoff_stress;
    double const opened = state[LogPlasticVolumeRatio{}];
    double const J_E = material.elastic_part(state).determinant();
    CHECK(J_E * std::exp(opened) == Approx(0.9).epsilon(1e-9));
    double const p0 = kappa * (1e-5 + std::sinh(-model.hardening * (model.start + opened)));
    CHECK(-tau(0, 0) == Approx(p0).epsilon(1e-3)); // one step behind it
    CHECK(p0 > 0.05 * kappa);                      // from 0.03
}

TEST_CASE("Cam-Clay is compacted up to the pressure that it can bear, and sheared loses that bit by bit")
{
    OneElement<CamClay<Solid>> const material;
    auto const& model = material.model;
    auto state = material.at_rest(1).front();
    auto const alpha = [&] { return model.start + state[LogPlasticVolumeRatio{}]; };
    // to half of its volume at once, where the logarithm is twice the limit, and back until no stress is left
    CHECK(material.answer(state, Eigen::Matrix3d::Identity() * std::cbrt(0.5)).capped);
    CHECK(model.hardening * alpha() == Approx(-std::asinh(0.5 - 1e-5)).epsilon(1e-5));
    double const elastic = material.elastic_part(state).determinant();
    auto const released =
        material.step(state, Eigen::Matrix3d::Identity() * (1 / std::cbrt(elastic) - 1), 1, 1);
    CHECK(!released.capped);
    CHECK(material.elastic_part(state).determinant() == Approx(1).epsilon(1e-9));
    CHECK(model.hardening * alpha() == Approx(-std::asinh(0.5 - 1e-5)).epsilon(1e-5));
    // sheared without pressure, on the dry side of the ellipse, it opens
    Eigen::Matrix3d shear = Eigen::Matrix3d::Zero();
    shear(0, 1) = 0.2; // the most that a step may do
    double fastest = 0, before = alpha();
    for (int step = 0; step < 40; ++step) {
        material.step(state, shear, 1, 1);
        fastest = std::max(fastest, alpha() - before);
        before = alpha();
    }
    CHECK(fastest > 0.001);
    CHECK(fastest < 0.05); // of 0.16
    CHECK(alpha() > -0.05);
}

TEST_CASE("Cam-Clay that is pulled apart lets go: its tension vanishes")
{
    OneElement<CamClay<Solid>> const material;
    auto const& model = material.model;
    auto state = material.at_rest(1).front();
    Eigen::Matrix3d const L = Eigen::Matrix3d::Identity() * 1e-4;
    double most = 0, last = 0;
    for (int i = 0; i < 200; ++i) {
        last = material.step(state, L, 1, 10).kirchhoff_stress(0, 0);
        most = std::max(most, last);
    }
    double const kappa = model.elasticity.lambda + 2 * model.elasticity.mu / 3;
    CHECK(most > 0.3 * kappa * model.cohesion * std::sinh(-model.hardening * model.start));
    CHECK(last <= 2e-5 * kappa);
}

namespace
{

/// A stiff fluid, so that its elastic shear is small, of tau = yield + K rate^power in shear.
template <class Space>
HerschelBulkley<Space> stiff_fluid(double yield, double K, double power)
{
    HerschelBulkley<Space> model;
    model.elasticity = lame(2e5, 0.45);
    model.yield_stress = std::sqrt(3.0) * yield;
    model.consistency = std::pow(2, 0.5 * (1 + power)) * K;
    model.power = power;
    return model;
}

template <int d>
Matrix<double, d> deviator(Matrix<double, d> const& tau)
{
    return tau - Matrix<double, d>::Identity() * (tau.trace() / d);
}

/// The principal logarithmic strains of F, and principal values of a symmetric matrix, the largest first.
template <int d>
Vector<double, d> logarithms(Matrix<double, d> const& F)
{
    return singular_values(F).sigma.array().log();
}
template <int d>
Vector<double, d> principal_values(Matrix<double, d> const& symmetric)
{
    return spectrum_of<d>(symmetric).eigenvalues().reverse().template cast<double>();
}

} // namespace

TEMPLATE_TEST_CASE(
    "a yield-stress fluid in steady shear has the stress of Herschel and Bulkley, and dissipates "
    "its power",
    "", HerschelBulkley<Plane>, HerschelBulkley<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    using Space = typename TestType::Space;
    double const yield = 10, K = 4;
    for (double power : {1.0, 0.5, 0.22})
        for (double rate : {1e-9, 0.1, 1.0, 10.0}) {
            OneElement<TestType> const material{stiff_fluid<Space>(yield, K, power)};
            auto state = material.at_rest(1).front();
            Matrix<double, d> L = Matrix<double, d>::Zero();
            L(0, 1) = rate;
            double const dt = 1e-5 / rate, expected = yield + K * std::pow(rate, power);
            auto const tau = material.step(state, L, dt, 2000).kirchhoff_stress;
            CHECK(tau(0, 1) == Approx(expected).epsilon(1e-3));
            Matrix<double, d> const trial =
                (Matrix<double, d>::Identity() + dt * L) * material.elastic_part(state);
            material.step(state, L, dt);
            double const lost =
                energy(material.model, trial) - energy(material.model, material.elastic_part(state));
            // the stress goes up by mu rate dt in a step, and down again: in the mean it is half of that
            // above
            double const mean = expected + 0.5 * material.model.elasticity.mu * rate * dt;
            CHECK(lost / (dt * rate) == Approx(mean).epsilon(1e-3));
        }
}

TEMPLATE_TEST_CASE(
    "a yield-stress fluid flows beyond its yield stress alone, and by no less than the work of "
    "the stress that is left",
    "", HerschelBulkley<Plane>, HerschelBulkley<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    using Space = typename TestType::Space;
    std::mt19937 random(30);
    for (double power : {1.0, 0.5, 0.22})
        for (double dt : {1e-6, 1e-3, 1.0, 1e6}) {
            OneElement<TestType> const material{stiff_fluid<Space>(10, 4, power)};
            auto const& model = material.model;
            double const yield = std::sqrt(2.0 / 3) * model.yield_stress,
                         rounding = 1e-14 * model.elasticity.p_wave_modulus();
            auto deformations = random_deformations<d>(random, 200, 0.7, 1.3); // beyond yield, and about it
            for (auto const& F : random_deformations<d>(random, 200, 0.99985, 1.00015))
                deformations.push_back(F);
            std::vector<Matrix<double, d>> rates;
            for (auto const& F : deformations) rates.push_back((F - Matrix<double, d>::Identity()) / dt);
            auto states = material.at_rest(rates.size());
            auto const answers = material.drive(states, {rates}, dt);
            OneElement<SplitNeoHookean<Space>> elastic;
            elastic.model.elasticity = model.elasticity;
            auto const tried = elastic.stresses(deformations);
            int flowed = 0;
            for (std::size_t i = 0; i < states.size(); ++i) {
                auto const& F = deformations[i];
                auto const F_E = material.elastic_part(states[i]);
                Matrix<double, d> const s = deviator<d>(answers[i].kirchhoff_stress),
                                        s_tried = deviator<d>(tried[i]);
                double const lost = energy(model, F) - energy(model, F_E);
                if (s_tried.norm() <= yield * (1 - 1e-9)) {
                    CHECK((s - s_tried).norm() <= rounding);
                    CHECK(std::abs(lost) <= rounding);
                    continue;
                }
                ++flowed;
                CHECK(s.norm() >= yield * (1 - 1e-9) - rounding);
                CHECK(s.norm() <= s_tried.norm() + rounding);
                // The energy is convex in logarithms, along which all that is lost in a step flows: it is
                // between the work of the stress at the end and that of the stress at the start.
                Vector<double, d> const flow = logarithms<d>(F) - logarithms<d>(F_E);
                double const least = principal_values<d>(s).dot(flow);
                CHECK(least >= 0);
                CHECK(lost >= least - rounding);
                CHECK(lost <= principal_values<d>(s_tried).dot(flow) + rounding);
            }
            CHECK(flowed > 200);
            CHECK(flowed < 400);
        }
}

TEST_CASE("a yield-stress fluid does not flow in no time, and comes to rest at its yield stress")
{
    OneElement<HerschelBulkley<Solid>> const material;
    auto const& model = material.model;
    auto state = material.at_rest(1).front();
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    H(0, 1) = 0.2;
    state[DisplacementGradient{}] = H;
    material.step(state, Eigen::Matrix3d::Zero(), 0);
    CHECK(state[DisplacementGradient{}] == H);
    auto const norm_of_deviator = [&](double dt) {
        return deviator<3>(material.step(state, Eigen::Matrix3d::Zero(), dt).kirchhoff_stress).norm();
    };
    CHECK(norm_of_deviator(1e-9) > 10 * model.yield_stress);
    CHECK(norm_of_deviator(1e6) == Approx(std::sqrt(2.0 / 3) * model.yield_stress).epsilon(1e-6));
}

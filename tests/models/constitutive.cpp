// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/test_lane.hpp"

#include <Eigen/Eigenvalues>

using namespace firn;
using namespace firn::test;

namespace
{

/// The energies that the stresses must be derivatives of [Pa]; of snow at fixed plastic deformation.
template <class SpaceType, int d = SpaceType::dimension>
double energy(NeoHookean<SpaceType> const& model, Matrix<double, d> const& F, double)
{
    double const log_J = std::log(F.determinant());
    return 0.5 * model.elasticity.mu * (F.squaredNorm() - d) - model.elasticity.mu * log_J +
           0.5 * model.elasticity.lambda * log_J * log_J;
}

template <int d>
double corotated_energy(Lame<double> const& elasticity, Matrix<double, d> const& F)
{
    auto const svd = singular_values(F);
    double const J = F.determinant();
    return elasticity.mu * (svd.sigma - Vector<double, d>::Ones()).squaredNorm() +
           0.5 * elasticity.lambda * (J - 1) * (J - 1);
}

template <class SpaceType, int d = SpaceType::dimension>
double energy(FixedCorotated<SpaceType> const& model, Matrix<double, d> const& F, double)
{
    return corotated_energy<d>(model.elasticity, F);
}

template <class SpaceType, int d = SpaceType::dimension>
double energy(Snow<SpaceType> const& model, Matrix<double, d> const& F, double J_P)
{
    return std::exp(model.hardening * (1 - J_P)) * corotated_energy<d>(model.elasticity, F);
}

template <class Model>
struct Material
{
    static constexpr int d = Model::Space::dimension;
    using Tensor = Matrix<double, d>;
    using State = Record<double, d, typename Model::State>;
    Model model{};

    /// The answer of a fresh particle to a deformation gradient reached in one step.
    Response<double, d> answer(State& state, Tensor const& F) const
    {
        return model.template respond<double>(state, Tensor((F - Tensor::Identity())), 1.0);
    }

    Tensor stress(Tensor const& F) const
    {
        auto state = State::at_rest();
        return answer(state, F).kirchhoff_stress;
    }
};

/// A deformation gradient: a rotation times moderate stretches within snow's elastic range if asked for.
template <int d>
Matrix<double, d> random_deformation(std::mt19937& random, double low, double high)
{
    std::uniform_real_distribution<double> stretch(low, high);
    Matrix<double, d> S = Matrix<double, d>::Zero();
    for (int a = 0; a < d; ++a) S(a, a) = stretch(random);
    Matrix<double, d> const V = random_rotation<d>(random);
    return random_rotation<d>(random) * V * S * V.transpose();
}

template <class Model>
constexpr bool is_snow =
    std::is_same_v<typename Model::State, Fields<DisplacementGradient, PlasticVolumeRatio>>;

template <class Model, int d>
Matrix<double, d> elastic_deformation(std::mt19937& random)
{
    return is_snow<Model> ? random_deformation<d>(random, 0.98, 1.007)
                          : random_deformation<d>(random, 0.6, 1.7);
}

} // namespace

using Models = std::tuple<NeoHookean<Plane>, NeoHookean<Solid>, FixedCorotated<Plane>, FixedCorotated<Solid>,
                          Snow<Plane>, Snow<Solid>>;

TEMPLATE_LIST_TEST_CASE(
    "the stress is the derivative of the energy, symmetric, isotropic and frame indifferent", "", Models)
{
    constexpr int d = TestType::Space::dimension;
    using Tensor = Matrix<double, d>;
    Material<TestType> const material;
    std::mt19937 random(21);
    double const modulus = material.model.elasticity.p_wave_modulus();
    for (int i = 0; i < 200; ++i) {
        Tensor const F = elastic_deformation<TestType, d>(random);
        Tensor const tau = material.stress(F);
        CHECK((tau - tau.transpose()).norm() <= 1e-13 * modulus);

        double const step = 1e-6;
        Tensor P;
        for (int a = 0; a < d; ++a)
            for (int b = 0; b < d; ++b) {
                Tensor up = F, down = F;
                up(a, b) += step, down(a, b) -= step;
                P(a, b) = (energy(material.model, up, 1.0) - energy(material.model, down, 1.0)) / (2 * step);
            }
        Tensor const expected = P * F.transpose();
        CHECK((tau - expected).norm() <= 1e-7 * std::max(expected.norm(), 1e-2 * modulus));

        Tensor const Q = random_rotation<d>(random);
        CHECK((material.stress(Q * F) - Q * tau * Q.transpose()).norm() <= 1e-12 * modulus);
        CHECK((material.stress(F * Q) - tau).norm() <= 1e-12 * modulus);
    }
}

TEMPLATE_LIST_TEST_CASE(
    "the wave modulus is the largest eigenvalue of the acoustic tensors along the principal axes, or above",
    "", Models)
{
    constexpr int d = TestType::Space::dimension;
    using Tensor = Matrix<double, d>;
    Material<TestType> const material;
    std::mt19937 random(22);
    double const rest = material.model.elasticity.p_wave_modulus();
    auto at_rest = Material<TestType>::State::at_rest();
    CHECK(material.answer(at_rest, Tensor::Identity()).wave_modulus == Approx(rest));

    for (int i = 0; i < 100; ++i) {
        Tensor const F = elastic_deformation<TestType, d>(random);
        auto state = Material<TestType>::State::at_rest();
        double const claimed = material.answer(state, F).wave_modulus;
        // Q_ac n_b n_d = d(tau_ab)/d(F) along a displacement a e^(i n.x): dF = a n^T F, dtau minus its
        // geometric part
        double largest = 0;
        Eigen::SelfAdjointEigenSolver<Tensor> const axes(Tensor(F * F.transpose()));
        for (int axis = 0; axis < d; ++axis) {
            Vector<double, d> const n = axes.eigenvectors().col(axis);
            Tensor acoustic;
            for (int c = 0; c < d; ++c) {
                Vector<double, d> const u = Vector<double, d>::Unit(c);
                double const step = 1e-6;
                Tensor const dF = u * n.transpose() * F * step;
                // P = tau F^-T; traction change in the current frame: (dP F^T) n
                auto const piola = [&](Tensor const& G) {
                    return Tensor(material.stress(G) * G.inverse().transpose());
                };
                Tensor const dP = (piola(F + dF) - piola(F - dF)) / (2 * step);
                acoustic.col(c) = dP * F.transpose() * n;
            }
            largest = std::max(
                largest, Tensor(0.5 * (acoustic + acoustic.transpose())).eigenvalues().real().maxCoeff());
        }
        CHECK(claimed >= largest * (1 - 1e-5));
        CHECK(claimed <= std::max(rest, largest) * 1.5);
    }
}

TEMPLATE_LIST_TEST_CASE("two half rotations are one: the update of the state is frame indifferent", "",
                        Models)
{
    constexpr int d = TestType::Space::dimension;
    using Tensor = Matrix<double, d>;
    Material<TestType> const material;
    std::mt19937 random(23);
    for (int i = 0; i < 100; ++i) {
        Tensor const F = random_deformation<d>(random, 0.9, 1.1), Q = random_rotation<d>(random);
        auto plain = Material<TestType>::State::at_rest(), turned = plain;
        auto const tau = material.answer(plain, F).kirchhoff_stress;
        auto const tau_turned = material.answer(turned, Q * F).kirchhoff_stress;
        CHECK((tau_turned - Q * tau * Q.transpose()).norm() <= 1e-9 * std::max(1.0, tau.norm()));
        Tensor const F_E = deformation_gradient<double, d>(plain[DisplacementGradient{}]);
        Tensor const F_E_turned = deformation_gradient<double, d>(turned[DisplacementGradient{}]);
        CHECK((F_E_turned - Q * F_E).norm() <= 1e-12);
    }
}

TEMPLATE_TEST_CASE("snow's return map is idempotent, dissipates and stays within its stretches", "",
                   Snow<Plane>, Snow<Solid>)
{
    constexpr int d = TestType::Space::dimension;
    Material<TestType> const material;
    std::mt19937 random(24);
    for (int i = 0; i < 500; ++i) {
        auto const F = random_deformation<d>(random, 0.7, 1.3);
        auto state = Material<TestType>::State::at_rest();
        material.answer(state, F);
        auto const F_E = deformation_gradient<double, d>(state[DisplacementGradient{}]);
        double const J_P = state[PlasticVolumeRatio{}];
        auto const sigma = singular_values(F_E).sigma;
        CHECK(sigma.maxCoeff() <= 1 + 7.5e-3 + 1e-12);
        CHECK(sigma.minCoeff() >= 1 - 2.5e-2 - 1e-12);
        CHECK(F_E.determinant() * J_P == Approx(F.determinant()).epsilon(1e-12)); // J = J_E J_P
        CHECK(energy(material.model, F_E, 1.0) <= energy(material.model, F, 1.0) * (1 + 1e-12));

        material.model.template respond<double>(state, Matrix<double, d>::Zero(), 1.0);
        CHECK((deformation_gradient<double, d>(state[DisplacementGradient{}]) - F_E).norm() <= 1e-12);
        CHECK(std::abs(state[PlasticVolumeRatio{}] - J_P) <= 1e-12);
    }
}

TEST_CASE("fixed corotated takes no reflection for a rest state")
{
    Material<FixedCorotated<Solid>> const material;
    Eigen::Matrix3d const reflected = Eigen::Vector3d(1, 1, -1).asDiagonal();
    CHECK(material.stress(reflected).norm() > 0.1 * material.model.elasticity.mu);
}

TEST_CASE("an inverted neo-Hookean particle is said to be inverted, and its answer is finite")
{
    Material<NeoHookean<Solid>> const material;
    auto state = Material<NeoHookean<Solid>>::State::at_rest();
    auto const response = material.answer(state, Eigen::Matrix3d(Eigen::Vector3d(1, 1, -0.5).asDiagonal()));
    CHECK(response.inverted);
    CHECK(response.kirchhoff_stress.allFinite());
}

TEMPLATE_LIST_TEST_CASE("a pack of numbers is answered as each number is: no material branches on a value",
                        "", Models)
{
    constexpr int d = TestType::Space::dimension;
    using Pack = TestLane<double>;
    STATIC_REQUIRE(ConstitutiveModel<TestType, Pack>);
    TestType const model;
    std::mt19937 random(25);
    for (int i = 0; i < 100; ++i) {
        Record<double, d, typename TestType::State> single[4];
        Matrix<double, d> L[4];
        auto packed = Record<Pack, d, typename TestType::State>::at_rest();
        Matrix<Pack, d> packed_L;
        double lanes[d * d][4];
        for (int l = 0; l < 4; ++l) {
            single[l] = Record<double, d, typename TestType::State>::at_rest();
            L[l] = 0.2 * random_matrix<d>(random);
            for (int a = 0; a < d * d; ++a) lanes[a][l] = L[l](a / d, a % d);
        }
        for (int a = 0; a < d * d; ++a) packed_L(a / d, a % d) = LaneTraits<Pack>::load(lanes[a]);
        auto const all = model.template respond<Pack>(packed, packed_L, Pack(0.5));
        for (int l = 0; l < 4; ++l) {
            auto const one = model.template respond<double>(single[l], L[l], 0.5);
            double const rounding = 1e-12 * model.elasticity.p_wave_modulus();
            double lane[4];
            for (int a = 0; a < d * d; ++a) {
                LaneTraits<Pack>::store(all.kirchhoff_stress(a / d, a % d), lane);
                CHECK(std::abs(lane[l] - one.kirchhoff_stress(a / d, a % d)) <= rounding);
            }
            LaneTraits<Pack>::store(all.wave_modulus, lane);
            CHECK(lane[l] == Approx(one.wave_modulus).epsilon(1e-12));
        }
    }
}

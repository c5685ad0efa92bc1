// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/one_element.hpp"
#include "support/test_lane.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

/// The largest difference between what the lanes of a backend answer and what each number is answered here:
/// of stress and wave modulus over the scale of stresses, and of states.
template <class Model, class LaneType = TestedLane<typename Model::Space::Scalar>>
double difference_from_numbers(double size)
{
    constexpr int d = Model::Space::dimension;
    using Element = OneElement<Model, LaneType>;
    using Number = typename Element::Number;
    Element const material;
    std::mt19937 random(25);
    std::vector<Matrix<double, d>> rates;
    for (int i = 0; i < 800; ++i) rates.push_back(size * random_matrix<d>(random));
    auto states = Element::at_rest(rates.size());
    auto const answers = material.drive(states, {rates}, 0.5);
    double worst = 0;
    for (std::size_t i = 0; i < rates.size(); ++i) {
        auto state = Element::State::at_rest();
        auto const expected = material.model.template respond<Number>(
            state, Matrix<Number, d>(rates[i].template cast<Number>()), Number(0.5));
        double const scale = expected.wave_modulus;
        double const stress = (answers[i].kirchhoff_stress - expected.kirchhoff_stress).norm(),
                     modulus = std::abs(answers[i].wave_modulus - expected.wave_modulus);
        worst = std::max({worst, stress / scale, modulus / scale});
        if (answers[i].inverted != expected.inverted || answers[i].capped != expected.capped) worst = 1;
        std::vector<double> found;
        states[i].for_each([&](int, Number const& value) { found.push_back(value); });
        state.for_each([&](int c, Number const& value) {
            worst = std::max(worst, std::abs(found[std::size_t(c)] - double(value)));
        });
    }
    return worst;
}

} // namespace

// Packs and devices have roots and exponentials of their own.
TEMPLATE_LIST_TEST_CASE("a backend's lanes are answered as each number is", "", AllMaterials)
{
    STATIC_REQUIRE(ConstitutiveModel<TestType, TestLane<double>>);
    for (double size : {0.2, 0.01}) CHECK(difference_from_numbers<TestType>(size) <= 1e-11);
}

#if defined(FIRN_TESTS_ALL)
using FloatMaterials = Tested<AllModels<PlaneFloat>, AllModels<SolidFloat>>;
#else
using FloatMaterials = Tested<AllModels<SolidFloat>>;
#endif

TEMPLATE_LIST_TEST_CASE("so are they in single precision", "", FloatMaterials)
{
    for (double size : {0.2, 0.01}) CHECK(difference_from_numbers<TestType>(size) <= 3e-5);
}

#if defined(FIRN_HAS_XSIMD) && defined(FIRN_TESTS_ALL)
namespace
{
template <class Model, int bytes>
void check_packs(double tolerance)
{
    using Number = typename Model::Space::Scalar;
    using Lanes = typename PacksOf<bytes>::template Lane<Number>;
    for (double size : {0.2, 0.01}) CHECK(difference_from_numbers<Model, Lanes>(size) <= tolerance);
}

template <class Model>
void check_packs_of_all_widths(double tolerance)
{
    check_packs<Model, 16>(tolerance);
#if defined(__AVX512F__) // what a processor with AVX has
    check_packs<Model, 32>(tolerance);
#endif
}
} // namespace

TEMPLATE_LIST_TEST_CASE("so are narrower packs", "", AllMaterials)
{
    check_packs_of_all_widths<TestType>(1e-11);
}

TEMPLATE_LIST_TEST_CASE("so are they in single precision, too", "", FloatMaterials)
{
    check_packs_of_all_widths<TestType>(3e-5);
}
#endif

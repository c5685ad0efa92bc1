// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<HardeningVonMises<Solid>, QuadraticBSpline, Apic>, Scene<Hencky<Plane>, QuadraticBSpline, Apic>,
    Scene<CamClay<Plane>, QuadraticBSpline, Apic>, Scene<SplitNeoHookean<PlaneFloat>, CubicBSpline, Tpic>,
    Scene<HerschelBulkley<SolidFloat>, CubicBSpline, Tpic>,
    Scene<VonMises<PlaneFloat>, QuadraticBSpline, Tpic>, Scene<Snow<Plane>, QuadraticBSpline, Tpic>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Tpic>, Scene<CamClay<Plane>, QuadraticBSpline, Tpic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Tpic>, Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Mls>,
    Scene<HerschelBulkley<Plane>, QuadraticBSpline, Mls>, Scene<Hencky<PlaneFloat>, CubicBSpline, Tpic>,
    Scene<Sand<Solid>, QuadraticBSpline, Tpic>, Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Apic>,
    Scene<VonMises<Plane>, QuadraticBSpline, Mls>, Scene<CamClay<Plane>, Linear, Tpic>,
    Scene<SplitNeoHookean<PlaneFloat>, Linear, Tpic>, Scene<Snow<Plane>, Linear, Mls>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: affine transfers keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

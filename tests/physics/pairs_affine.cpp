// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Apic>,
    Scene<MooneyRivlin<PlaneFloat>, QuadraticBSpline, Apic>, Scene<Snow<Plane>, QuadraticBSpline, Apic>,
    Scene<VonMises<Plane>, CubicBSpline, Apic>, Scene<Sand<Plane>, QuadraticBSpline, Apic>,
    Scene<CamClay<Solid>, Linear, Apic>, Scene<FixedCorotated<PlaneFloat>, Linear, Mls>,
    Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Mls>,
    Scene<MooneyRivlin<SolidFloat>, QuadraticBSpline, Mls>,
    Scene<SplitNeoHookean<SolidFloat>, CubicBSpline, Tpic>, Scene<MooneyRivlin<Plane>, Linear, Tpic>,
    Scene<Snow<Plane>, QuadraticBSpline, Tpic>, Scene<VonMises<Plane>, QuadraticBSpline, Tpic>,
    Scene<HardeningVonMises<Plane>, Linear, Tpic>, Scene<CamClay<PlaneFloat>, QuadraticBSpline, Tpic>,
    Scene<HerschelBulkley<Plane>, QuadraticBSpline, Tpic>, Scene<Fluid<Plane>, QuadraticBSpline, Tpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: affine transfers keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

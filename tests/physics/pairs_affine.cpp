// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<MooneyRivlin<Plane>, Linear, Apic>, Scene<MooneyRivlin<PlaneFloat>, CubicBSpline, Mls>,
    Scene<MooneyRivlin<Solid>, QuadraticBSpline, Tpic>, Scene<CamClay<Solid>, Linear, Apic>,
    Scene<HardeningVonMises<Plane>, CubicBSpline, Apic>, Scene<Hencky<Plane>, QuadraticBSpline, Apic>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Apic>, Scene<VonMises<Plane>, QuadraticBSpline, Apic>,
    Scene<HerschelBulkley<Solid>, QuadraticBSpline, Mls>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Mls>, Scene<VonMises<Plane>, QuadraticBSpline, Mls>,
    Scene<CamClay<Plane>, QuadraticBSpline, Tpic>, Scene<Fluid<SolidFloat>, QuadraticBSpline, Tpic>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Tpic>,
    Scene<Hencky<PlaneFloat>, QuadraticBSpline, Tpic>, Scene<HerschelBulkley<PlaneFloat>, Linear, Tpic>,
    Scene<Sand<Plane>, QuadraticBSpline, Tpic>, Scene<Snow<Plane>, QuadraticBSpline, Tpic>,
    Scene<SplitNeoHookean<Solid>, QuadraticBSpline, Tpic>,
    Scene<VonMises<PlaneFloat>, QuadraticBSpline, Tpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: affine transfers keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

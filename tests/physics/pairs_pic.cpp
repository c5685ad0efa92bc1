// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<MooneyRivlin<SolidFloat>, QuadraticBSpline, Pic>, Scene<MooneyRivlin<Plane>, Linear, Xpic>,
    Scene<CamClay<Plane>, QuadraticBSpline, Pic>, Scene<Fluid<Plane>, Linear, Pic>,
    Scene<HardeningVonMises<Solid>, QuadraticBSpline, Pic>, Scene<Hencky<Plane>, Linear, Pic>,
    Scene<HerschelBulkley<SolidFloat>, QuadraticBSpline, Pic>, Scene<Sand<Plane>, QuadraticBSpline, Pic>,
    Scene<Snow<Plane>, Linear, Pic>, Scene<SplitNeoHookean<SolidFloat>, QuadraticBSpline, Pic>,
    Scene<VonMises<Plane>, QuadraticBSpline, Pic>, Scene<CamClay<PlaneFloat>, QuadraticBSpline, Xpic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Xpic>, Scene<HardeningVonMises<PlaneFloat>, Linear, Xpic>,
    Scene<Hencky<SolidFloat>, QuadraticBSpline, Xpic>, Scene<HerschelBulkley<Plane>, CubicBSpline, Xpic>,
    Scene<Sand<Plane>, QuadraticBSpline, Xpic>, Scene<Snow<Plane>, QuadraticBSpline, Xpic>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Xpic>, Scene<VonMises<Plane>, CubicBSpline, Xpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: PIC and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

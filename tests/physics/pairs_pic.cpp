// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<Hencky<Plane>, QuadraticBSpline, Pic>, Scene<MooneyRivlin<Plane>, QuadraticBSpline, Pic>,
    Scene<Snow<Plane>, QuadraticBSpline, Pic>, Scene<VonMises<Plane>, Linear, Pic>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Pic>, Scene<Sand<Plane>, QuadraticBSpline, Pic>,
    Scene<CamClay<Plane>, QuadraticBSpline, Pic>, Scene<HerschelBulkley<SolidFloat>, CubicBSpline, Pic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Pic>, Scene<Hencky<Plane>, QuadraticBSpline, Xpic>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Xpic>, Scene<MooneyRivlin<Plane>, QuadraticBSpline, Xpic>,
    Scene<Snow<Plane>, Linear, Xpic>, Scene<VonMises<PlaneFloat>, QuadraticBSpline, Xpic>,
    Scene<HardeningVonMises<PlaneFloat>, QuadraticBSpline, Xpic>, Scene<Sand<SolidFloat>, Linear, Xpic>,
    Scene<CamClay<Plane>, QuadraticBSpline, Xpic>, Scene<HerschelBulkley<Solid>, QuadraticBSpline, Xpic>,
    Scene<Fluid<SolidFloat>, Linear, Xpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: PIC and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

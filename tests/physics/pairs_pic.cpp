// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<VonMises<SolidFloat>, CubicBSpline, Pic>,
    Scene<HardeningVonMises<PlaneFloat>, QuadraticBSpline, Pic>,
    Scene<CamClay<PlaneFloat>, QuadraticBSpline, Pic>,
    Scene<HerschelBulkley<PlaneFloat>, QuadraticBSpline, Pic>,
    Scene<SplitNeoHookean<Solid>, QuadraticBSpline, Pic>, Scene<Hencky<Plane>, QuadraticBSpline, Pic>,
    Scene<Sand<Plane>, QuadraticBSpline, Pic>, Scene<Fluid<Plane>, QuadraticBSpline, Pic>,
    Scene<Hencky<SolidFloat>, QuadraticBSpline, Xpic>, Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Xpic>,
    Scene<Snow<Plane>, QuadraticBSpline, Xpic>, Scene<VonMises<Plane>, QuadraticBSpline, Xpic>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Xpic>, Scene<Sand<Plane>, QuadraticBSpline, Xpic>,
    Scene<CamClay<Plane>, QuadraticBSpline, Xpic>, Scene<HerschelBulkley<Plane>, QuadraticBSpline, Xpic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Xpic>, Scene<Fluid<SolidFloat>, Linear, Pic>,
    Scene<Sand<PlaneFloat>, Linear, Xpic>, Scene<VonMises<Plane>, Linear, Xpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: PIC and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that. What scenes of one
// space share takes a compiler longer than the rest, so each file has few spaces.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<SplitNeoHookean<PlaneFloat>, QuadraticBSpline, Pic>,
    Scene<HardeningVonMises<PlaneFloat>, QuadraticBSpline, Xpic>,
    Scene<VonMises<PlaneFloat>, QuadraticBSpline, Xpic>, Scene<HerschelBulkley<PlaneFloat>, Linear, Flip>,
    Scene<Hencky<PlaneFloat>, CubicBSpline, Asflip>, Scene<MooneyRivlin<PlaneFloat>, QuadraticBSpline, Apic>,
    Scene<FixedCorotated<PlaneFloat>, Linear, Mls>, Scene<CamClay<PlaneFloat>, QuadraticBSpline, Tpic>,
    Scene<HerschelBulkley<Solid>, QuadraticBSpline, Xpic>, Scene<SplitNeoHookean<Solid>, Linear, Asflip>,
    Scene<CamClay<Solid>, Linear, Apic>, Scene<HerschelBulkley<SolidFloat>, CubicBSpline, Pic>,
    Scene<Fluid<SolidFloat>, Linear, Xpic>, Scene<Sand<SolidFloat>, Linear, Xpic>,
    Scene<VonMises<SolidFloat>, QuadraticBSpline, Asflip>,
    Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Mls>,
    Scene<MooneyRivlin<SolidFloat>, QuadraticBSpline, Mls>,
    Scene<SplitNeoHookean<SolidFloat>, CubicBSpline, Tpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies in space, and in single precision, keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

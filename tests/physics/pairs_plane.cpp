// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that. What scenes of one
// space share takes a compiler longer than the rest, so each file has few spaces.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<VonMises<Plane>, Linear, Pic>, Scene<CamClay<Plane>, QuadraticBSpline, Pic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Pic>, Scene<HardeningVonMises<Plane>, QuadraticBSpline, Pic>,
    Scene<Hencky<Plane>, QuadraticBSpline, Pic>, Scene<MooneyRivlin<Plane>, QuadraticBSpline, Pic>,
    Scene<Sand<Plane>, QuadraticBSpline, Pic>, Scene<Snow<Plane>, QuadraticBSpline, Pic>,
    Scene<Snow<Plane>, Linear, Xpic>, Scene<CamClay<Plane>, QuadraticBSpline, Xpic>,
    Scene<Hencky<Plane>, QuadraticBSpline, Xpic>, Scene<MooneyRivlin<Plane>, QuadraticBSpline, Xpic>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Xpic>, Scene<Hencky<Plane>, Linear, Flip>,
    Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Flip>, Scene<CamClay<Plane>, QuadraticBSpline, Asflip>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Asflip>,
    Scene<HerschelBulkley<Plane>, QuadraticBSpline, Asflip>, Scene<Snow<Plane>, QuadraticBSpline, Asflip>,
    Scene<VonMises<Plane>, CubicBSpline, Apic>, Scene<Sand<Plane>, QuadraticBSpline, Apic>,
    Scene<Snow<Plane>, QuadraticBSpline, Apic>, Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Apic>,
    Scene<HardeningVonMises<Plane>, Linear, Tpic>, Scene<MooneyRivlin<Plane>, Linear, Tpic>,
    Scene<Fluid<Plane>, QuadraticBSpline, Tpic>, Scene<HerschelBulkley<Plane>, QuadraticBSpline, Tpic>,
    Scene<Snow<Plane>, QuadraticBSpline, Tpic>, Scene<VonMises<Plane>, QuadraticBSpline, Tpic>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies in the plane keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

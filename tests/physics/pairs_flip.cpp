// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<MooneyRivlin<Plane>, QuadraticBSpline, Flip>, Scene<MooneyRivlin<Plane>, QuadraticBSpline, Asflip>,
    Scene<CamClay<Plane>, QuadraticBSpline, Flip>, Scene<FixedCorotated<Plane>, Linear, Flip>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Flip>, Scene<Hencky<Plane>, CubicBSpline, Flip>,
    Scene<HerschelBulkley<Plane>, QuadraticBSpline, Flip>, Scene<Sand<Plane>, CubicBSpline, Flip>,
    Scene<SplitNeoHookean<Plane>, Linear, Flip>, Scene<VonMises<SolidFloat>, Linear, Flip>,
    Scene<CamClay<Plane>, QuadraticBSpline, Asflip>,
    Scene<HardeningVonMises<SolidFloat>, QuadraticBSpline, Asflip>,
    Scene<Hencky<Plane>, QuadraticBSpline, Asflip>, Scene<HerschelBulkley<Plane>, QuadraticBSpline, Asflip>,
    Scene<Sand<Plane>, Linear, Asflip>, Scene<Snow<Plane>, QuadraticBSpline, Asflip>,
    Scene<SplitNeoHookean<PlaneFloat>, CubicBSpline, Asflip>,
    Scene<VonMises<Solid>, QuadraticBSpline, Asflip>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: FLIP and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

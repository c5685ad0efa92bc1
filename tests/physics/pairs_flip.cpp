// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes = std::tuple<
    Scene<Hencky<Plane>, Linear, Flip>, Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Flip>,
    Scene<HerschelBulkley<PlaneFloat>, Linear, Flip>, Scene<Hencky<PlaneFloat>, CubicBSpline, Asflip>,
    Scene<SplitNeoHookean<Solid>, Linear, Asflip>, Scene<Snow<Plane>, QuadraticBSpline, Asflip>,
    Scene<VonMises<SolidFloat>, QuadraticBSpline, Asflip>,
    Scene<HardeningVonMises<Plane>, QuadraticBSpline, Asflip>,
    Scene<CamClay<Plane>, QuadraticBSpline, Asflip>, Scene<HerschelBulkley<Plane>, QuadraticBSpline, Asflip>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: FLIP and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

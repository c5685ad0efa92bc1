// SPDX-License-Identifier: MIT
#include "physics/every_combination.hpp"

// With these no pair of policies is missing from the tests: pairs.sh looks after that.
namespace
{

using namespace firn;
using namespace firn::test;

using Scenes =
    std::tuple<Scene<VonMises<Plane>, QuadraticBSpline, Flip>, Scene<CamClay<Solid>, QuadraticBSpline, Flip>,
               Scene<HerschelBulkley<Solid>, QuadraticBSpline, Flip>,
               Scene<Hencky<Plane>, QuadraticBSpline, Flip>,
               Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Flip>,
               Scene<Sand<Plane>, QuadraticBSpline, Flip>, Scene<Hencky<Plane>, QuadraticBSpline, Asflip>,
               Scene<Snow<Plane>, QuadraticBSpline, Asflip>, Scene<VonMises<Plane>, QuadraticBSpline, Asflip>,
               Scene<HardeningVonMises<Plane>, QuadraticBSpline, Asflip>,
               Scene<CamClay<Plane>, QuadraticBSpline, Asflip>,
               Scene<SplitNeoHookean<SolidFloat>, QuadraticBSpline, Asflip>,
               Scene<HerschelBulkley<Plane>, QuadraticBSpline, Asflip>,
               Scene<HardeningVonMises<Plane>, CubicBSpline, Flip>,
               Scene<HardeningVonMises<Plane>, Linear, Flip>, Scene<FixedCorotated<PlaneFloat>, Linear, Flip>,
               Scene<Hencky<Solid>, Linear, Flip>, Scene<HerschelBulkley<Plane>, Linear, Asflip>>;

TEMPLATE_LIST_TEST_CASE("pairs of policies: FLIP and its kin keep momentum", "", Scenes)
{
    check_momentum<TestType>();
}

} // namespace

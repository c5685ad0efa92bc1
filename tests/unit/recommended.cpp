// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/firn.hpp>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

using namespace firn;

namespace
{

std::string guide()
{
    auto const project = std::filesystem::path(__FILE__).parent_path().parent_path().parent_path();
    std::ifstream in(project / "include/firn/models/README.md");
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
}

template <class Kernel>
std::string name_of_kernel()
{
    return std::is_same_v<Kernel, CubicBSpline> ? "CubicBSpline" : "QuadraticBSpline";
}

std::string name_of_transfer(Mls const&) { return "Mls"; }
std::string name_of_transfer(Flip const& flip)
{
    std::ostringstream name;
    name << "Flip{" << flip.fraction << "}";
    return name.str();
}

/// Whether the guide to materials has the row of a material as the code has it.
template <class Model>
void check_row(std::string const& name)
{
    using Choice = Recommended<Model>;
    std::string const row = "| `" + name + "` | `" + name_of_kernel<typename Choice::Kernel>() + "` | `" +
                            name_of_transfer(Choice::transfer) + "` | " +
                            std::to_string(Choice::per_axis * Choice::per_axis) + " | ";
    static std::string const text = guide();
    INFO("include/firn/models/README.md lacks: " << row);
    auto const at = text.find(row);
    CHECK(at != std::string::npos);
    if (at == std::string::npos) return;
    std::string const rest = text.substr(at, text.find('\n', at) - at);
    INFO(rest);
    CHECK((rest.find("not measured") == std::string::npos) == Choice::is_measured);
}

} // namespace

TEST_CASE("the guide to materials recommends for each material what the code does")
{
    using Plane = Space<2, float>;
    check_row<NeoHookean<Plane>>("NeoHookean");
    check_row<FixedCorotated<Plane>>("FixedCorotated");
    check_row<Hencky<Plane>>("Hencky");
    check_row<SplitNeoHookean<Plane>>("SplitNeoHookean");
    check_row<MooneyRivlin<Plane>>("MooneyRivlin");
    check_row<Snow<Plane>>("Snow");
    check_row<VonMises<Plane>>("VonMises");
    check_row<HardeningVonMises<Plane>>("HardeningVonMises");
    check_row<Sand<Plane>>("Sand");
    check_row<CamClay<Plane>>("CamClay");
    check_row<HerschelBulkley<Plane>>("HerschelBulkley");
    check_row<Fluid<Plane>>("Fluid");
    CHECK(Recommended<Sand<Plane>>::transfer.fraction == 1);
    CHECK(Recommended<NeoHookean<Plane>>::control.wave == StepControl{}.wave);
}

TEST_CASE("what is recommended for a material holds with factors of its moduli, and for the first of several")
{
    using Room = Space<3, double>;
    CHECK(std::is_same_v<Recommended<Heterogeneous<Sand<Room>>>::Transfer, Flip>);
    CHECK(std::is_same_v<Recommended<Varied<Sand<Room>, OwnCone>>::Transfer, Flip>);
    CHECK(std::is_same_v<Recommended<Materials<Snow<Room>, Sand<Room>>>::Kernel, QuadraticBSpline>);
    CHECK(std::is_same_v<Recommended<Materials<Snow<Room>, Sand<Room>>>::Transfer, Mls>);
    CHECK(std::is_same_v<Recommended<Bodies<Snow<Room>, Sand<Room>>>::Kernel, QuadraticBSpline>);
}

TEST_CASE("water by itself keeps its volume, and nothing else stores or asks more for it")
{
    using Room = Space<3, float>;
    CHECK(std::is_same_v<RecommendedModel<Fluid<Room>>, KeepsVolume<Fluid<Room>>>);
    CHECK(std::is_same_v<RecommendedModel<Snow<Room>>, Snow<Room>>);
    CHECK(std::is_same_v<RecommendedModel<Materials<Fluid<Room>, Sand<Room>>>,
                         Materials<Fluid<Room>, Sand<Room>>>);
    CHECK(std::is_same_v<Recommended<KeepsVolume<Fluid<Room>>>::Kernel, Recommended<Fluid<Room>>::Kernel>);
    KeepsVolume<Fluid<Room>> const water = RecommendedModel<Fluid<Room>>(materials::water<Room>(2));
    CHECK(water.bulk_modulus == materials::water<Room>(2).bulk_modulus);
    CHECK(!KeepsItsVolume<Fluid<Room>>);
    CHECK(!KeepsItsVolume<Snow<Room>>);
}

// SPDX-License-Identifier: MIT
#include "blocks.hpp"
#include "catch.hpp"
#include "compare.hpp"
#include "encounters.hpp"
#include "support/meshes.hpp"

bool tests_need_a_device = true; // see main.cpp

using namespace firn::test;

TEST_CASE("a device takes a scene to where the processor takes it")
{
    check_agreement(openmp_cases(), cuda_cases());
}

TEST_CASE("so it does with a block of each material that vibrates")
{
    check_agreement(openmp_blocks_in_space(), cuda_blocks_in_space());
    check_agreement(openmp_blocks_in_the_plane(), cuda_blocks_in_the_plane());
}

TEST_CASE("so it does where bodies meet walls, shells, terrain, a body that they push, and one another")
{
    check_agreement(openmp_encounters(), cuda_encounters());
}

TEST_CASE("a scene that either has written half way goes on with both to where one alone takes it")
{
    meshes::Folder const folder;
    auto const path = folder / "half.firn";
    auto const processor = openmp_restarts(), device = cuda_restarts();
    REQUIRE(processor.size() == device.size());
    for (std::size_t i = 0; i < processor.size(); ++i) {
        processor[i].write(path);
        auto const alone = processor[i].go_on(path);
        check_agreement(processor[i].name + ", from the processor", alone, device[i].go_on(path));
        device[i].write(path);
        check_agreement(processor[i].name + ", from the device", alone, processor[i].go_on(path));
        check_agreement(processor[i].name + ", on the device", alone, device[i].go_on(path));
    }
}

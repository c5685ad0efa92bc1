// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/host_copies.hpp>
#include <firn/io/checkpoint.hpp>
#include <firn/io/frame_series.hpp>

#include <cstdint>
#include <numeric>

using namespace firn;
using namespace firn::test;

namespace
{

/// Fields of a host, of which the library knows nothing.
struct Handle
{
    static constexpr auto name = "handle";
    static constexpr auto shape = FieldShape::integer;
    static constexpr std::uint32_t at_rest = 0xffffffff;
};
struct Warmth
{
    static constexpr auto name = "warmth";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr double at_rest = 273;
    static constexpr FieldRange range{.at_least = 0};
};
struct Origin
{
    static constexpr auto name = "where_it_began";
    static constexpr auto shape = FieldShape::vector;
};
struct Namesake
{
    static constexpr auto name = "handle";
    static constexpr auto shape = FieldShape::scalar;
};

struct HasHandleBelow
{
    std::uint32_t bound;

    template <class Position, class Particle>
    FIRN_HOST_DEVICE bool operator()(Position const&, Particle const& particle) const
    {
        return integer_of(particle[Handle{}]) < bound;
    }
};

using Plain = Scene<Snow<SolidFloat>, QuadraticBSpline, Mls>::Solver;
using Tagged = Scene<Snow<SolidFloat>, QuadraticBSpline, WithFields<Mls, Handle, Warmth, Origin>>::Solver;

std::vector<std::uint32_t> handles_of(Tagged const& solver)
{
    std::vector<std::uint32_t> handles(solver.size());
    download<Handle>(solver, handles);
    return handles;
}

/// Any handle: all bits of it occur.
std::uint32_t handle(std::uint32_t id) { return 0x9e3779b9u * (id + 1); }

std::vector<std::uint32_t> handles_by(std::vector<std::uint32_t> const& ids)
{
    std::vector<std::uint32_t> handles;
    for (auto const id : ids) handles.push_back(handle(id));
    return handles;
}

/// A block that flies, and grains of which change their cells in every step.
template <class Solver>
void throw_block(Solver& solver)
{
    solver.add(box_of_points<3>({0.01, 0, 0}, {0.41, 0.2, 0.2}, 0.1), 1.25e-4, {30, 20, -40});
}

} // namespace

TEST_CASE("own fields stay with their particles, bit by bit, through steps, removals, additions and files")
{
    Tagged solver(lattice(0.1));
    throw_block(solver);
    CHECK(handles_of(solver) == std::vector<std::uint32_t>(solver.size(), Handle::at_rest));
    CHECK(solver.download<Warmth>() == std::vector<float>(solver.size(), 273.f));
    upload<Handle>(solver, handles_by(solver.ids()));
    auto const origins = solver.positions();
    std::vector<Eigen::Vector3f> in_floats;
    for (auto const& x : origins) in_floats.push_back(x.cast<float>());
    solver.upload<Origin>(in_floats);
    for (int i = 0; i < 20; ++i) solver.step(5e-4, Gravity{}, Obstacle<HalfSpace>{});
    CHECK((solver.positions()[0] - origins[0]).norm() > 0.3); // some cells further
    CHECK(handles_of(solver) == handles_by(solver.ids()));
    CHECK(solver.download<Origin>() == in_floats);

    auto const frame = frame_of<Handle>(solver);
    CHECK((frame.fields[1].name == "handle" && frame.fields[1].integers == handles_by(solver.ids())));

    std::size_t const before = solver.size();
    std::size_t const gone = solver.remove_if(HasHandleBelow{0x80000000u});
    CHECK((gone > before / 4 && gone < before)); // about half of them
    for (auto const each : handles_of(solver)) CHECK(each >= 0x80000000u);
    CHECK(handles_of(solver) == handles_by(solver.ids()));

    auto const first = solver.add(box_of_points<3>({0, 1, 0}, {0.1, 1.1, 0.1}, 0.1), 1.25e-4);
    CHECK(handles_of(solver).back() == Handle::at_rest);
    std::vector<std::uint32_t> added(8);
    std::iota(added.begin(), added.end(), first);
    upload_from<Handle>(solver, first, handles_by(added));
    CHECK(handles_of(solver) == handles_by(solver.ids()));
    solver.step(1e-4);

    auto const bytes = checkpoint_in_memory(solver);
    Tagged restored(lattice(0.1));
    restore_from_memory(bytes, restored);
    for (auto* const each : {&solver, &restored}) each->step(1e-4);
    CHECK(handles_of(restored) == handles_by(restored.ids()));
    CHECK(restored.ids() == solver.ids());
    CHECK(restored.download<Origin>() == solver.download<Origin>());
    CHECK(restored.positions() == solver.positions());
    Plain plain(lattice(0.1));
    CHECK_THAT(refused([&] { restore_from_memory(bytes, plain); }).what_is_wrong(), Contains("'handle'"));
}

TEST_CASE("with own fields particles move as they do without, bit by bit, and those alone cost memory")
{
    Tagged tagged(lattice(0.1));
    Plain plain(lattice(0.1));
    throw_block(tagged);
    throw_block(plain);
    std::vector<float> warmth(tagged.size());
    std::iota(warmth.begin(), warmth.end(), 1.f);
    tagged.upload<Warmth>(warmth);
    plain.upload<Velocity>(plain.download<Velocity>()); // scatters afresh, too
    tagged.upload<Velocity>(tagged.download<Velocity>());
    for (int i = 0; i < 10; ++i) {
        tagged.step(5e-4, Gravity{}, Obstacle<HalfSpace>{});
        plain.step(5e-4, Gravity{}, Obstacle<HalfSpace>{});
    }
    CHECK(tagged.positions() == plain.positions());
    CHECK(tagged.download<DisplacementGradient>() == plain.download<DisplacementGradient>());
    CHECK(tagged.download<Warmth>() == warmth);
    STATIC_REQUIRE(Tagged::state_bytes_per_particle == Plain::state_bytes_per_particle + 4 * (2 + 1 + 3));
    STATIC_REQUIRE(!firn::detail::have_own_names(Fields<Handle, Warmth, Namesake>{}));
    STATIC_REQUIRE(firn::detail::have_own_names(Tagged::State{}));
}

TEST_CASE("values that an own field may not have are refused, and nothing has changed")
{
    Tagged solver(lattice(0.1));
    throw_block(solver);
    std::size_t const count = solver.size();
    auto const handles = handles_by(solver.ids());
    upload<Handle>(solver, handles);
    std::vector<float> cold(count, 1.f);
    cold[3] = -1;
    CHECK_THAT(refused([&] { solver.upload<Warmth>(cold); }).what_is_wrong(), Contains("'warmth' is below"));
    for (float const half : {0.5f, -1.f, 65536.f}) {
        auto halves = solver.download<Handle>();
        halves[5][1] = half;
        CHECK_THAT(refused([&] { solver.upload<Handle>(halves); }).what_is_wrong(),
                   Contains("not half of an integer"));
        auto snapshot = solver.snapshot();
        for (auto& field : snapshot.materials[0].fields)
            if (field.name == "handle") field.components[1][5] = half;
        refused([&] { solver.restore(snapshot); });
    }
    refused([&] { upload<Handle>(solver, std::vector<std::uint32_t>(count + 1)); });
    refused([&] { upload_from<Handle>(solver, std::uint32_t(count - 2), std::vector<std::uint32_t>(3)); });
    upload_from<Handle>(solver, std::uint32_t(count - 2), std::vector<std::uint32_t>{1, 0xfffffffeu});
    auto expected = handles;
    expected[count - 2] = 1;
    expected[count - 1] = 0xfffffffeu;
    CHECK(handles_of(solver) == expected);
}

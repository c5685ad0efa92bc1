// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/numbers.hpp"

#include <firn/contact_points.hpp>
#include <firn/distributed.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/firn.hpp>
#include <firn/worlds.hpp>
#if !defined(__CUDACC__) && defined(FIRN_TESTS_ALL)
#include <firn/distributed/on_reference.hpp>
#include <firn/reference.hpp>
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

using namespace firn;
using firn::test::append;
using firn::test::append_all;
using firn::test::append_report;
using firn::test::box_of_points;
using firn::test::Numbers;
using firn::test::OfBlocks;
using firn::test::on;
using firn::test::part_of_time;
using firn::test::Ranks;
using firn::test::require_same_on_any_ranks;

// Many worlds on one rank and on several must come to the same bits.
namespace
{

using Plane = firn::Space<2, double>;

double const h = 0.1;
Obstacle<HalfSpace> const ground{.contact = Contact::coulomb(0.3)};

template <int d>
auto block(double side)
{
    using V = Vector<double, d>;
    V low = V::Constant(-side / 2);
    low[1] = 0.01;
    return box_of_points<d>(low, low + V::Constant(side), h / 2);
}

template <class Backend, class Space, ActsOn acts_on = ActsOn::nodes>
using WorldsOn = Worlds<Solver<Backend, NeoHookean<Space>>, AnyShape<>, acts_on>;

/// Worlds with a block in each, the larger the higher their number, and a ball that pushes it.
template <class Space, ActsOn acts_on = ActsOn::nodes, class Backend>
auto begun(Backend const& backend, std::uint32_t count)
{
    constexpr int d = Space::dimension;
    WorldsOn<Backend, Space, acts_on> worlds(count, lattice(h), NeoHookean<Space>{}, Mls{}, StepControl{},
                                             backend);
    for (std::uint32_t w = 0; w < count; ++w) {
        Vector<double, d> velocity = Vector<double, d>::Zero();
        velocity[0] = 0.5 * w;
        worlds.add(w, block<d>(0.4 + 0.1 * double(w % 3)), std::pow(h / 2, d), velocity);
        worlds.obstacles(w).push_back({.shape = Sphere{0.15},
                                       .contact = Contact::slip(),
                                       .motion = {.position = {-0.4, 0.2, 0}, .velocity = {1.0 + w, 0, 0}}});
    }
    return worlds;
}

template <class Of>
void append_worlds(Numbers& to, Of const& worlds)
{
    append_all(to, worlds.solver());
    append(to, worlds.world_of_particles());
    for (std::uint32_t w = 0; w < worlds.count(); ++w) {
        to.push_back(worlds.time(w));
        for (auto const& reaction : worlds.reactions(w)) append(to, reaction.impulse);
    }
    for (auto const& gone : worlds.solver().isolated())
        append(to, Numbers{double(gone.particle), double(*gone.world), gone.position[0], gone.time});
}

template <class State>
void append_state(Numbers& to, State const& state)
{
    auto const& material = state.materials[0];
    append(to, material.ids);
    append(to, material.cells);
    for (auto const& offset : material.offsets) append(to, offset);
    for (auto const& field : material.fields)
        for (auto const& component : field.components) append(to, component);
    for (auto const& group : material.mass_groups)
        append(to, Numbers{double(group.first_row), double(group.mass)});
    to.push_back(state.time);
}

/// All that worlds do.
template <class Space>
struct EveryCall
{
    bool tells_states = true; ///< whose particles are in the order of cells

    template <class Backend>
    Numbers operator()(Backend const& backend) const
    {
        constexpr int d = Space::dimension;
        auto worlds = begun<Space>(backend, 7);
        auto const spoil = [&](std::uint32_t id) {
            auto const ids = worlds.ids();
            auto strains = worlds.template download<DisplacementGradient>();
            strains[std::size_t(std::ranges::find(ids, id) - ids.begin())](0, 0) = -2;
            worlds.template upload<DisplacementGradient>(strains);
        };
        Numbers all;
        auto const go_on = [&] {
            append_report(all, worlds.advance(0.01 * part_of_time, Gravity{}, ground));
            append(all, Numbers{worlds.stable_step(Gravity{})});
            append_worlds(all, worlds);
        };
        go_on();
        auto const first = worlds.save(0);
        if (tells_states) append_state(all, first);
        auto const middle = worlds.save(4);
        if (tells_states) append_state(all, middle);
        go_on();
        worlds.reset(std::vector<std::uint32_t>{6, 3}, first); // of as many particles
        worlds.reset(1, middle);
        append_worlds(all, worlds);
        go_on();
        auto const world_of = worlds.world_of_particles();
        spoil(worlds.ids()[std::size_t(std::ranges::find(world_of, 3u) - world_of.begin()) + 5]);
        try {
            worlds.step(1e-4);
        }
        catch (StepError const& error) {
            append(all, Numbers{double(error.failure().particle), double(error.failure().world.value_or(99)),
                                error.failure().position[1]});
        }
        worlds.quarantine(2);
        go_on();
        worlds.reset(3, first); // brings it back
        append(all, Numbers{double(worlds.clear(2))});
        worlds.add(2, block<d>(0.5), std::pow(h / 2, d));
        worlds.reset(2, middle);
        go_on();
        for (std::uint32_t w = 0; w < worlds.count(); ++w)
            if (tells_states) append_state(all, worlds.save(w));
        return all;
    }
};

} // namespace

TEST_CASE("many worlds come to the same bits on any number of ranks")
{
    require_same_on_any_ranks(EveryCall<OfBlocks>{});
}

#if !defined(__CUDACC__) && defined(FIRN_TESTS_ALL)
TEST_CASE("many worlds come to the same numbers on the reference backend on one rank and on three")
{
    EveryCall<Plane> const scene{.tells_states = false}; // in a cell they lie in any order
    Numbers const alone = scene(Reference{});
    std::vector<std::size_t> different(3, 0);
    run_ranks(3, [&](RankThreads const& communicator) {
        Numbers const here =
            scene(Distributed<Reference, RankThreads>{.local = {}, .communicator = communicator});
        auto& count = different[std::size_t(communicator.rank())];
        count = here.size() == alone.size() ? 0 : 1;
        for (std::size_t i = 0; i < here.size() && i < alone.size(); ++i) // sums are in another order
            count += !(std::abs(here[i] - alone[i]) <= 1e-9 * (1 + std::abs(alone[i])));
    });
    CHECK(different == std::vector<std::size_t>(3, 0));
}
#endif

TEST_CASE(
    "obstacles that act at their surface do so in many worlds with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        auto worlds = begun<Plane, ActsOn::surface>(backend, 4);
        Numbers all;
        for (int call = 0; call < 2; ++call) {
            append_report(all, worlds.advance(0.02 * part_of_time, Gravity{}));
            append_worlds(all, worlds);
            std::vector<std::array<double, 6>> sorted; // points have an order of their own
            for (auto const& point : contact_points(worlds).points)
                sorted.push_back({double(point.world), double(point.obstacle), point.position[0],
                                  point.position[1], point.impulse[0], point.impulse[1]});
            std::ranges::sort(sorted);
            for (auto const& point : sorted) append(all, point);
        }
        return all;
    });
}

TEST_CASE("ranks have whole worlds where these are as many for each, and parts of them where there are few")
{
    std::uint32_t const count = GENERATE(61u, 2u), first = count == 61 ? 20 : 0; // worlds before have nothing
    using Found = std::vector<std::set<std::uint32_t>>;
    Found before(3), after(3); // the worlds of each rank
    run_ranks(3, [&](RankThreads const& communicator) {
        auto const rank = std::size_t(communicator.rank());
        WorldsOn<Ranks, Plane> worlds(count, lattice(h), NeoHookean<Plane>{}, Mls{}, StepControl{},
                                      on(communicator));
        auto const points = block<2>(count == 61 ? 0.6 : 2);
        for (std::uint32_t w = first; w < count; ++w) worlds.add(w, points, h * h / 4);
        auto const here = [&](std::set<std::uint32_t>& found) {
            for (auto const id : worlds.solver().ids_here())
                found.insert(first + id / static_cast<std::uint32_t>(points.size()));
        };
        here(before[rank]);
        worlds.step(1e-4); // particles are counted
        here(after[rank]);
    });
    auto const sizes = [](Found const& found) {
        return std::vector{found[0].size(), found[1].size(), found[2].size()};
    };
    CHECK(sizes(before) ==
          (count == 61 ? std::vector<std::size_t>{1, 20, 20} : std::vector<std::size_t>{1, 1, 0}));
    CHECK(sizes(after) ==
          (count == 61 ? std::vector<std::size_t>{14, 13, 14} : std::vector<std::size_t>{1, 2, 1}));
}

TEST_CASE("another world or another state on one rank is refused on all")
{
    int const other = GENERATE(0, 1, 2, 3);
    std::mutex mutex;
    std::vector<std::string> said;
    run_ranks(3, [&](RankThreads const& communicator) {
        std::uint32_t const is_other = communicator.rank() == 1 ? 1 : 0;
        try {
            auto worlds = begun<Plane>(on(communicator), other == 0 ? 6 + is_other : 6);
            if (other == 1) worlds.add(is_other, block<2>(0.4), h * h / 4);
            if (other == 2) static_cast<void>(worlds.save(99 * is_other));
            auto state = worlds.save(0);
            if (other == 3)
                state.materials[0].offsets[1][7] +=
                    static_cast<decltype(CellOffset<double>::Stored{})>(is_other);
            worlds.reset(3, state);
        }
        catch (Error const& error) {
            {
                std::lock_guard const lock(mutex);
                said.push_back(error.what());
            }
            communicator.abort("it was refused a call"); // or others might wait if they were not
        }
    });
    REQUIRE(said.size() == 3);
    for (auto const& error : said) CHECK_THAT(error, Contains("not all ranks make the same call"));
}

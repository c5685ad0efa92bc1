// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/budget.hpp>
#include <firn/worlds.hpp>

#include <algorithm>
#include <utility>
#include <vector>

// Many worlds: particles come and go, obstacles change, worlds are saved and reset, in any order.
namespace firn::fuzz
{

class CallsOfWorlds
{
    static constexpr std::uint32_t count = 5;
    static constexpr std::size_t most = 200; // particles of a world

public:
    explicit CallsOfWorlds(Input& input)
        : input_(input), worlds_(count, lattice(0.05), materials::fresh_snow<PlaneFloat>()), in_(count),
          saved_(count)
    {
        worlds_.quarantine(3);
    }

    void run()
    {
        for (int i = 0; i < 60 && !input_.empty(); ++i) {
            call();
            look();
        }
    }

private:
    void call()
    {
        auto const w = std::uint32_t(input_.below(count));
        switch (input_.below(9)) {
        case 0:
        case 1:
            add(w);
            break;
        case 2:
            only_in(w, [&] {
                auto const there = in_[w] - lost(w);
                expect(worlds_.clear(w) == there, "other particles were cleared than are there");
            });
            in_[w] = 0;
            break;
        case 3:
            saved_[w] = worlds_.save(w);
            expect(saved_[w].materials[0].ids.size() == in_[w] - lost(w),
                   "a state has other particles than its world");
            break;
        case 4:
            reset(w, std::uint32_t(input_.below(count)));
            break;
        case 5:
            worlds_.obstacles(w).resize(std::size_t(input_.below(4)),
                                        Obstacle<AnyShape<>>{.shape = Sphere{0.1}});
            for (auto& obstacle : worlds_.obstacles(w)) {
                if (input_.below(2) == 0) obstacle.shape = Box{{input_.any(0.1), 0.1, 0.1}};
                obstacle.motion.position = {input_.any(0.2), input_.between(-1, 1), 0};
                obstacle.motion.velocity = {input_.between(-3, 3), input_.any(1), 0};
                if (input_.below(2) == 0) obstacle.motion.time = input_.any(0.1);
            }
            break;
        default:
            go_on(w);
            break;
        }
    }

    void add(std::uint32_t w)
    {
        std::vector<Eigen::Vector2d> points(std::size_t(1 + input_.below(20)));
        for (auto& x : points) x = {input_.between(-1, 1), input_.between(-1, 1)};
        if (input_.below(16) == 0) points.back().x() = input_.any(1e4);
        if (in_[w] + points.size() > most) return;
        only_in(w, [&] {
            auto const before = worlds_.solver().size();
            refused([&] { worlds_.add(w, points, 6e-4, {input_.between(-5, 5), 0}); });
            in_[w] += worlds_.solver().size() - before;
        });
    }

    void reset(std::uint32_t w, std::uint32_t from)
    {
        if (saved_[from].materials.empty()) return;
        only_in(w, [&] { refused([&] { worlds_.reset(w, saved_[from]); }); });
    }

    void go_on(std::uint32_t w)
    {
        double const before = worlds_.time(w);
        bool const was_refused = refused([&] {
            if (input_.below(2) == 0)
                worlds_.steps(std::size_t(1 + input_.below(3)), input_.between(1e-6, 2e-4), Gravity{});
            else
                worlds_.advance(input_.any(1e-3), Budget{.steps = 20}, Gravity{});
        });
        expect(worlds_.time(w) >= before, "the time of a world went back");
        if (was_refused) return; // the reactions may be those of the call before
        for (std::uint32_t other = 0; other < count; ++other)
            expect(worlds_.reactions(other).size() == worlds_.obstacles(other).size(),
                   "there is not one reaction for each obstacle");
    }

    /// How many particles a world lost to the quarantine.
    std::size_t lost(std::uint32_t w) const
    {
        return std::size_t(std::ranges::count(worlds_.solver().isolated(), w, &StepFailure::world));
    }

    /// Calls what may change one world, and looks whether the others keep their bits.
    template <class Work>
    void only_in(std::uint32_t w, Work const& work)
    {
        auto const others = [&] {
            auto const of = worlds_.world_of_particles();
            auto const x = worlds_.solver().positions();
            auto const v = worlds_.solver().download<Velocity>();
            std::vector<std::pair<Eigen::Vector2d, Eigen::Vector2f>> told;
            for (std::size_t i = 0; i < of.size(); ++i)
                if (of[i] != w) told.push_back({x[i], v[i]});
            return told;
        };
        auto const before = others();
        work();
        expect(others() == before, "a particle of another world has changed");
    }

    void look() const
    {
        expect_whole(worlds_.solver());
        std::vector<std::size_t> found(count);
        for (auto const world : worlds_.world_of_particles()) {
            expect(world < count, "a particle is in no world");
            ++found[world];
        }
        for (std::uint32_t w = 0; w < count; ++w) found[w] += lost(w);
        expect(found == in_, "a world has other particles than were added and not cleared");
    }

    Input& input_;
    Worlds<Sheet> worlds_;
    std::vector<std::size_t> in_; ///< particles of each world, with those that it lost to the quarantine
    std::vector<WorldState<float, 2>> saved_;
};

inline void worlds(Bytes bytes)
{
    Input input(bytes);
    CallsOfWorlds(input).run();
}

} // namespace firn::fuzz

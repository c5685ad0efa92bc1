// SPDX-License-Identifier: MIT
#pragma once

#include "distributed/numbers.hpp"

#include <firn/firn.hpp>

#include <cmath>
#include <type_traits>

// A scene in which particles go from one rank to another.
namespace firn::test
{

/// Two blocks that fly at each other along x, over a floor, and through the parts of all ranks.
template <class Model, class Transfer = Mls, class Kernel = QuadraticBSpline>
auto encounter(Model const& model, Transfer const& transfer = {}, double duration = 0.1)
{
    return [=](auto const& backend) {
        constexpr int d = Model::Space::dimension;
        using V = Vector<double, d>;
        double const h = 0.1;
        Solver<std::remove_cvref_t<decltype(backend)>, Model, Kernel, Transfer> solver(lattice(h), model,
                                                                                       transfer, {}, backend);
        V low = V::Constant(0.1), high = V::Constant(0.9), velocity = V::Zero();
        velocity[0] = 3;
        solver.add(box_of_points<d>(low, high, h / 2), std::pow(h / 2, d), velocity);
        low[0] += 1.05, high[0] += 1.05;
        velocity[0] = -3, velocity[1] = 1;
        solver.add(box_of_points<d>(low, high, h / 2), std::pow(h / 2, d), velocity);
        Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.3)};
        Obstacle<Sphere> const ball{.shape = {0.3},
                                    .motion = {.position = {1, 0.2, 0.5}, .velocity = {0, 0.5, 0}}};
        Numbers all;
        for (int i = 0; i < 4; ++i) {
            append_report(all, solver.advance(duration / 4, Gravity{}, floor, ball));
            append(all, Numbers{solver.stable_step(Gravity{}, floor, ball)});
        }
        append_all(all, solver);
        return all;
    };
}

} // namespace firn::test

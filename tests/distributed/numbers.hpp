// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

#include <cmath>
#include <cstddef>
#include <type_traits>
#include <vector>

// What a scene comes to, to be compared between runs on different numbers of ranks.
namespace firn::test
{

/// All that can be asked of a scene, as numbers.
using Numbers = std::vector<double>;

template <class Values>
void append(Numbers& to, Values const& values)
{
    for (auto const& value : values)
        if constexpr (requires { value.data(); })
            for (std::ptrdiff_t i = 0; i < value.size(); ++i) to.push_back(double(value.data()[i]));
        else
            to.push_back(double(value));
}

template <class Solver>
void append_all(Numbers& to, Solver const& solver)
{
    append(to, solver.ids());
    append(to, solver.positions());
    append(to, solver.template download<Velocity>());
    append(to, solver.template download<Stress>());
    append(to, solver.masses());
    auto const totals = solver.totals();
    append(to, totals.momentum);
    append(to, totals.angular_momentum);
    append(to, Numbers{solver.time(), solver.energy().total(), double(solver.size()),
                       double(solver.occupancy().cells), solver.bounds().speed, solver.bounds().wave_speed});
}

inline void append_report(Numbers& to, AdvanceReport const& report)
{
    to.push_back(double(report.substeps));
    for (auto const& reaction : report.reactions) {
        append(to, reaction.impulse);
        append(to, reaction.angular_impulse);
    }
}

template <int d>
std::vector<Vector<double, d>> box_of_points(Vector<double, d> const& low, Vector<double, d> const& high,
                                             double spacing)
{
    std::vector<Vector<double, d>> points;
    Vector<double, d> x = low;
    for (int a = 0; a < d; ++a) x[a] += spacing / 2;
    Vector<double, d> const first = x;
    while (true) {
        points.push_back(x);
        int a = d - 1;
        for (; a >= 0; --a) {
            x[a] += spacing;
            if (x[a] < high[a]) break;
            x[a] = first[a];
        }
        if (a < 0) return points;
    }
}

} // namespace firn::test

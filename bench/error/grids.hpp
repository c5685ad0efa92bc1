// SPDX-License-Identifier: MIT
#pragma once

#include "settings.hpp"

// Named sets of settings.
namespace firn::bench
{

/// The sizes at which a problem is solved, from coarse to fine: cells per metre, of P4 per half width of the
/// column, of P5 per side of the block, of P6 per side of the cube, of P7 per depth of the water, of P8 per
/// diameter of the disk, of P9 per thickness of the beam.
inline std::vector<int> cells_of(std::string const& problem, bool is_long)
{
    if (problem == "P1")
        return is_long ? std::vector{8, 16, 32, 64, 128, 256} : std::vector{8, 16, 32, 64, 128};
    if (problem == "P2") return is_long ? std::vector{8, 16, 32, 64, 128} : std::vector{8, 16, 32, 64};
    if (problem == "P3") return is_long ? std::vector{20, 40, 80, 160} : std::vector{20, 40, 80};
    if (problem == "P4") return is_long ? std::vector{4, 8, 16, 32} : std::vector{4, 8, 16};
    if (problem == "P6") return is_long ? std::vector{8, 16, 32} : std::vector{8, 16};
    if (problem == "P7") return is_long ? std::vector{8, 16, 32, 64} : std::vector{8, 16, 32};
    if (problem == "P9") return is_long ? std::vector{4, 6, 8, 12, 16} : std::vector{4, 6, 8};
    if (problem == "P8") return is_long ? std::vector{4, 8, 16, 32} : std::vector{4, 8, 16};
    return std::vector{8, 16, 32};
}

/// `short` or `long`: all problems, kernels, transfers and precisions at all sizes with the library's step
/// and four particles per cell; and for spline kernels two things by themselves, the length of steps and
/// the number of particles. In the short one the latter are for APIC and MLS in float, without the finest
/// size. P6, in space, is for spline kernels and transfers in float, with eight particles per cell. P7 and P8
/// are for spline kernels and MLS, with obstacles by both rules. P2 and P9 are for spline kernels, APIC and
/// MLS by `settle`, too.
inline std::vector<Setting> named_grid(std::string const& name)
{
    using Words = std::vector<std::string>;
    bool const is_long = name == "long";
    Words const transfers{"pic", "flip_0.95", "flip_1", "apic", "mls"}, precisions{"float", "double"};
    Words const some_transfers = is_long ? transfers : Words{"apic", "mls"};
    Words const some_precisions = is_long ? precisions : Words{"float"};
    std::vector<double> const fractions = is_long ? std::vector{0.4, 0.2, 0.1} : std::vector{0.4, 0.2};
    std::vector<Setting> all;
    for (auto const* const problem : {"P1", "P2", "P3", "P4", "P5"}) {
        std::vector<int> const sizes = cells_of(problem, is_long);
        for (auto const* const kernel : {"linear", "quadratic", "cubic"})
            for (auto const& transfer : transfers) {
                if (kernel == std::string("linear") && transfer == "mls") continue; // that is APIC
                for (auto const& precision : precisions)
                    for (int cells : sizes)
                        all.push_back({problem, kernel, transfer, precision, 0.9, cells, 2});
            }
        for (auto const* const kernel : {"quadratic", "cubic"})
            for (auto const& transfer : some_transfers)
                for (auto const& precision : some_precisions)
                    for (int cells : sizes) {
                        if (cells == sizes.back()) continue;
                        for (double fraction : fractions)
                            all.push_back({problem, kernel, transfer, precision, fraction, cells, 2});
                        for (int per_cell : {3, 4})
                            all.push_back({problem, kernel, transfer, precision, 0.9, cells, per_cell});
                    }
    }
    for (auto const* const kernel : {"quadratic", "cubic"})
        for (auto const& transfer : transfers)
            for (int cells : cells_of("P6", is_long))
                all.push_back({"P6", kernel, transfer, "float", 0.9, cells, 2});
    for (auto const* const problem : {"P7", "P8"})
        for (auto const* const kernel : {"quadratic", "cubic"})
            for (auto const& precision : precisions)
                for (auto const* const acts_on : {"nodes", "surface"})
                    for (int cells : cells_of(problem, is_long))
                        all.push_back({problem, kernel, "mls", precision, 0.9, cells, 2, acts_on});
    for (auto const* const problem : {"P2", "P9"}) // P2 by damped steps is above
        for (auto const* const kernel : {"quadratic", "cubic"})
            for (auto const* const transfer : {"apic", "mls"})
                for (auto const& precision : precisions)
                    for (auto const* const acts_on : {"", "settle"})
                        for (int cells : cells_of(problem, is_long))
                            if (problem == std::string("P9") || acts_on == std::string("settle"))
                                all.push_back({problem, kernel, transfer, precision, 0.9, cells, 2, acts_on});
    return all;
}

} // namespace firn::bench

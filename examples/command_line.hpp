// SPDX-License-Identifier: MIT
#pragma once

#include "backend.hpp"
#include "sample_mesh.hpp"

#include <firn/core/exactly_equal.hpp>

#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdlib>
#include <string>

namespace firn::examples
{

/// What the user asked for.
struct Options
{
    Sampling sampling{};
    std::string mesh{}; ///< empty: the scene's own
    double scale = 1;
    double cell = 0; ///< [m]; 0: about eight particles per cell
    int frames = 48;
    double frames_per_second = 24;
    std::string out{};
    std::string backend = backend_name, transfer = "mls",
                kernel = "quadratic"; ///< as README advises for snow
    double flip = 0.95;
    bool as_in_the_report = false; ///< with the kernel and the transfer of Stomakhin et al. 2013
    int threads = 0;
    bool write_ply = true;
};

/// Chooses the policies that --as-in-the-report stands for. Throws an Error if an option contradicts it or
/// another one, or would be without effect.
inline void choose_policies(CLI::App const& app, Options& options)
{
    if (options.as_in_the_report) {
        Options report;
        report.kernel = "cubic", report.transfer = "flip";
        auto const refuse_other = [&](char const* option, bool is_the_same) {
            if (app.count(option) != 0 && !is_the_same)
                throw Error{std::string(option) + " contradicts --as-in-the-report, which is --kernel cubic "
                                                  "--transfer flip --flip 0.95",
                            "the command line", "Leave one of them out."};
        };
        refuse_other("--kernel", options.kernel == report.kernel);
        refuse_other("--transfer", options.transfer == report.transfer);
        refuse_other("--flip", exactly_equal(options.flip, report.flip));
        options.kernel = report.kernel, options.transfer = report.transfer;
    }
    if (app.count("--flip") != 0 && options.transfer != "flip")
        throw Error{"--flip would be without effect: the transfer is " + options.transfer, "the command line",
                    "Add --transfer flip, or leave --flip out."};
}

/// Reads the command line; ends the program after --help or a mistake.
inline Options command_line(int argc, char** argv, std::string const& name, std::string const& description)
{
    Options options;
    options.out = "out/" + name;
    CLI::App app{description, name};
    app.option_defaults()->always_capture_default();
    CLI::Validator const positive(
        [](std::string const& text) -> std::string {
            char* end = nullptr;
            double const number = std::strtod(text.c_str(), &end);
            return *end == '\0' && std::isfinite(number) && number > 0 ? ""
                                                                       : text + " is not a number above 0";
        },
        "NUMBER > 0");
    app.add_option("--mesh", options.mesh,
                   "closed OBJ, PLY, STL, glTF or GLB file [m, y up]; default: generated");
    app.add_option("--scale", options.scale, "metres per unit of the mesh file: 0.001 for millimetres")
        ->check(positive);
    app.add_flag("--repair", options.sampling.repair,
                 "fill a mesh that is open or broken, and say what volume it took");
    app.add_option("--particles", options.sampling.particles, "number of particles")->check(positive);
    app.add_option("--sampling", options.sampling.pattern, "how particles are placed")
        ->check(CLI::IsMember({"lattice", "uniform", "poisson"}));
    app.add_option("--seed", options.sampling.seed, "of the random numbers that place particles");
    app.add_option("--cell", options.cell, "grid spacing [m]; 0: eight particles per cell")
        ->check(CLI::NonNegativeNumber);
    app.add_option("--frames", options.frames, "number of frames after the first")
        ->check(CLI::NonNegativeNumber);
    app.add_option("--fps", options.frames_per_second, "frames per second of simulated time")
        ->check(positive);
    app.add_option("--out", options.out, "folder of the results");
    app.add_option("--backend", options.backend, "where it runs; ranks, cuda_ranks: on those of mpirun")
        ->check(CLI::IsMember({"openmp", "cuda", "ranks", "cuda_ranks"}));
    app.add_option("--transfer", options.transfer, "between particles and grid")
        ->check(CLI::IsMember({"pic", "flip", "apic", "mls"}));
    app.add_option("--flip", options.flip, "share of FLIP in --transfer flip")->check(CLI::Range(0.0, 1.0));
    app.add_option("--kernel", options.kernel, "interpolation kernel")
        ->check(CLI::IsMember({"quadratic", "cubic"}));
    app.add_flag("--as-in-the-report", options.as_in_the_report,
                 "the settings of Stomakhin et al. 2013: --kernel cubic --transfer flip --flip 0.95");
    app.add_option("--threads", options.threads, "of the backend openmp, or of each rank; 0: all cores")
        ->check(CLI::NonNegativeNumber);
    app.add_flag("--ply,!--no-ply", options.write_ply, "write each frame as binary PLY, too");
    try {
        app.parse(argc, argv);
    }
    catch (CLI::ParseError const& error) {
        std::exit(app.exit(error));
    }
    choose_policies(app, options);
    change_backend(options.backend, argv);
    let_first_rank_speak();
    return options;
}

} // namespace firn::examples

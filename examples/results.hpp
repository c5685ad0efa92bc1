// SPDX-License-Identifier: MIT
#pragma once

#include "command_line.hpp"
#include "drawing.hpp"

#include <firn/firn.hpp>
#include <firn/io/write_particles.hpp>
#include <firn/io/write_pieces.hpp>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <unistd.h>
#include <vector>

// What a run leaves: frames with an index, obstacles for the pictures, a report; and its progress line.
namespace firn::examples
{

/// The folder of a run.
class Results
{
public:
    Results(std::filesystem::path folder, bool write_ply)
        : folder_(std::move(folder)), index_(folder_ / "particles.pvd"), write_ply_(write_ply)
    {
        if (!is_first_rank()) return;
        std::error_code failed;
        std::filesystem::remove_all(folder_ / "frames", failed);
        std::filesystem::create_directories(folder_ / "frames", failed);
        if (failed)
            throw Error{"the folder cannot be made: " + failed.message(), folder_.string(),
                        "Choose another --out."};
    }

    std::filesystem::path const& folder() const { return folder_; }

    /// Writes the particles of a frame: of several ranks each its piece.
    template <class Solver>
    void frame(int number, Solver const& solver)
    {
        auto const started = std::chrono::steady_clock::now();
        char text[32];
        std::snprintf(text, sizeof text, "frames/frame_%04d", number);
        std::string const name = text, file = name + (spans_ranks<Backend> ? ".pvtp" : ".vtp");
        ParticleFrame frame{.time = solver.time()};
        frame.at(solver.positions_here()).vector("velocity", solver.template download_here<Velocity>());
        frame.scalar("J_P", solver.template download_here<PlasticVolumeRatio>());
        if constexpr (spans_ranks<Backend>)
            write_pieces(folder_ / file, frame, solver.backend());
        else
            write_vtp(folder_ / file, frame);
        if (write_ply_) ply(name, solver);
        if (is_first_rank()) index_.add(frame.time, file);
        seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    }

    /// Writes what render.py needs beside the frames.
    void obstacles(std::vector<DrawnObstacle> const& obstacles, Camera const& camera, double cell_size,
                   double spacing, double frames_per_second) const
    {
        if (!is_first_rank()) return;
        write_drawing(folder_, {.cell_size = cell_size,
                                .spacing = spacing,
                                .frames_per_second = frames_per_second,
                                .camera = camera,
                                .obstacles = obstacles});
    }

    double seconds() const { return seconds_; } ///< spent on writing frames

private:
    /// Writes all particles to one file, since PLY knows no pieces.
    template <class Solver>
    void ply(std::string const& name, Solver const& solver) const
    {
        ParticleFrame frame{.time = solver.time()};
        frame.at(solver.positions()).vector("velocity", solver.template download<Velocity>());
        frame.scalar("J_P", solver.template download<PlasticVolumeRatio>());
        if (is_first_rank()) write_ply(folder_ / (name + ".ply"), frame);
    }

    std::filesystem::path folder_;
    PvdIndex index_;
    bool write_ply_;
    double seconds_ = 0;
};

/// The time that the rest of a run takes [s]: if steps stay as long as in the last frame, and if they become
/// as short as they can.
struct TimeLeft
{
    double least = 0, most = 0;
};

/// "1:05 to 2:10": a time left in minutes and seconds.
inline std::string describe(TimeLeft const& left)
{
    auto const text = [](double seconds) {
        char written[32];
        int const whole = static_cast<int>(seconds + 0.5);
        std::snprintf(written, sizeof written, "%d:%02d", whole / 60, whole % 60);
        return std::string(written);
    };
    std::string const least = text(left.least), most = text(left.most);
    return least == most ? least : least + " to " + most;
}

/// The line that says how far a run is: rewritten in place on a terminal, else one line per frame.
inline void show_progress(int frame, int frames, double time, AdvanceReport const& last,
                          double particle_steps_per_second, TimeLeft const& left)
{
    bool const terminal = isatty(fileno(stderr)) != 0;
    std::fprintf(stderr, "%sframe %d/%d  t %.3f s  dt %.2e s (%s)  %.2f M particle-steps/s  left %s%s",
                 terminal ? "\r" : "", frame, frames, time, last.smallest_dt, describe(last.usual_limit()),
                 particle_steps_per_second * 1e-6, describe(left).c_str(),
                 terminal && frame < frames ? "        " : "\n");
    std::fflush(stderr);
}

/// The largest resident size of the process so far [bytes].
inline double peak_memory()
{
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

/// Mass [kg] and momentum [kg m/s] of all particles.
struct MassAndMomentum
{
    double mass = 0;
    Eigen::Vector3d momentum = Eigen::Vector3d::Zero();

    template <class Solver>
    explicit MassAndMomentum(Solver const& solver)
    {
        auto const m = solver.masses();
        auto const v = solver.template download<Velocity>();
        for (std::size_t i = 0; i < m.size(); ++i) {
            mass += m[i];
            momentum += m[i] * v[i].template cast<double>();
        }
    }
};

} // namespace firn::examples

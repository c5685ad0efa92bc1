// SPDX-License-Identifier: MIT
#pragma once

#include "backend.hpp"
#include "drawing.hpp"

#include <firn/firn.hpp>
#include <firn/io/write_particles.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

// What the small examples share: their arguments, points, and frames for ParaView in a folder.
namespace firn::examples
{

/// Points at the middles of a lattice in a box, `per_cell` per cell and axis.
template <int d>
std::vector<Vector<double, d>> block(Vector<double, d> const& size, double cell_size, int per_cell = 2)
{
    double const spacing = cell_size / per_cell;
    std::vector<Vector<double, d>> points{Vector<double, d>::Constant(0.5 * spacing)};
    for (int axis = 0; axis < d; ++axis) {
        auto const layer = points;
        for (int i = 1; i < std::lround(size[axis] / spacing); ++i)
            for (auto x : layer) {
                x[axis] += i * spacing;
                points.push_back(x);
            }
    }
    return points;
}

/// 0 or 1 for each point, alternating by horizontal layers of this height [m]: for pictures of how layers
/// have moved.
template <class Points>
std::vector<float> layers(Points const& points, double height)
{
    std::vector<float> number;
    for (auto const& x : points) number.push_back(float(std::lround(std::floor(x.y() / height)) & 1));
    return number;
}

/// The coordinate along x below which this share of the particles is.
template <class Points>
double front(Points const& points, double share)
{
    std::vector<double> x;
    for (auto const& point : points) x.push_back(point[0]);
    auto const place = x.begin() + static_cast<std::ptrdiff_t>(share * double(x.size() - 1));
    std::nth_element(x.begin(), place, x.end());
    return *place;
}

/// Frames in a folder, with an index that ParaView opens: DIR/particles.pvd.
class Frames
{
public:
    explicit Frames(std::filesystem::path folder)
        : folder_(std::move(folder)), index_(made(folder_) / "particles.pvd")
    {}

    /// `add` may add fields to the frame.
    template <class Solver, class Add>
    void write(Solver const& solver, Add const& add)
    {
        ParticleFrame frame;
        frame.time = solver.time();
        frame.at(solver.positions()).vector("velocity", solver.template download<Velocity>());
        add(frame);
        char name[32];
        std::snprintf(name, sizeof name, "frames/frame_%04d.vtp", count_++);
        write_vtp(folder_ / name, frame);
        index_.add(frame.time, name);
    }
    template <class Solver>
    void write(Solver const& solver)
    {
        write(solver, [](ParticleFrame&) {});
    }

    /// Writes what render.py draws beside them.
    void draw(Drawing const& drawing) const { write_drawing(folder_, drawing); }

    int count() const { return count_; } ///< of frames so far
    std::filesystem::path const& folder() const { return folder_; }

private:
    /// The folder with room for frames: those of an earlier run are removed.
    static std::filesystem::path const& made(std::filesystem::path const& folder)
    {
        std::error_code failed;
        std::filesystem::remove_all(folder / "frames", failed);
        std::filesystem::create_directories(folder / "frames", failed);
        if (failed)
            throw Error{"the folder for the frames cannot be made: " + failed.message(), folder.string(),
                        "Name one that can be written to."};
        return folder;
    }

    std::filesystem::path folder_;
    PvdIndex index_;
    int count_ = 0;
};

/// The folder that the command line names, if it does. Continues in another program if that has the wanted
/// backend, and ends this one after --help. Throws an Error for any other command line.
inline std::optional<std::filesystem::path> folder_of(int argc, char** argv)
{
    std::string const usage = "[--backend openmp|cuda] [FOLDER]";
    std::string backend = backend_name;
    std::optional<std::filesystem::path> folder;
    for (int i = 1; i < argc; ++i) {
        std::string const argument = argv[i];
        if (argument == "--help") {
            std::printf("%s %s\nprints a table and, with a folder, leaves frames there for ParaView.\n",
                        argv[0], usage.c_str());
            std::exit(0);
        }
        else if (argument == "--backend" && i + 1 < argc)
            backend = argv[++i];
        else if (argument.starts_with("--backend="))
            backend = argument.substr(argument.find('=') + 1);
        else if (!argument.empty() && argument[0] != '-' && !folder)
            folder = argument;
        else
            throw Error{"the argument is not understood", argument, "It takes " + usage + "."};
    }
    change_backend(backend, argv);
    return folder;
}

/// Frames in the folder that the command line names, if it does.
inline std::optional<Frames> frames_of(int argc, char** argv)
{
    auto folder = folder_of(argc, argv);
    return folder ? std::optional<Frames>(std::in_place, *std::move(folder)) : std::nullopt;
}

} // namespace firn::examples

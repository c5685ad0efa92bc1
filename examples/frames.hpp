// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>
#include <firn/io/write_particles.hpp>
#include <firn/openmp.hpp>

#include <cstdio>
#include <filesystem>

// What the small examples share: a table on the terminal, and frames for ParaView in a folder.
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

/// The coordinate along x that a share of the particles has not passed.
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

private:
    static std::filesystem::path const& made(std::filesystem::path const& folder)
    {
        std::filesystem::create_directories(folder / "frames");
        return folder;
    }

    std::filesystem::path folder_;
    PvdIndex index_;
    int count_ = 0;
};

} // namespace firn::examples

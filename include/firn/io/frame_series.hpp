// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/fields.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/paraview_state.hpp>
#include <firn/io/write_particles.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

// Frames that are written while the solver goes on. The library starts nothing beside its caller: a frame is
// copied at once, and the host calls its write() from wherever it likes.
namespace firn
{

namespace detail
{
/// Adds a field under its own name.
template <class Tag, class Values>
void add_field(ParticleFrame& frame, Values const& values)
{
    if constexpr (Tag::shape == FieldShape::scalar)
        frame.scalar(Tag::name, values);
    else if constexpr (Tag::shape == FieldShape::vector)
        frame.vector(Tag::name, values);
    else if constexpr (Tag::shape == FieldShape::matrix)
        frame.matrix(Tag::name, values);
    else {
        std::vector<std::uint32_t> integers;
        integers.reserve(values.size());
        for (auto const& value : values) integers.push_back(integer_of(value));
        frame.integer(Tag::name, integers);
    }
}
} // namespace detail

/// The particles as they are now, copied: positions, ids, and some fields under their own names, such as
/// `frame_of<Velocity, Stress>(solver)`.
template <class... Tags, class Solver>
ParticleFrame frame_of(Solver const& solver)
{
    ParticleFrame frame{.time = solver.time()};
    frame.at(solver.positions()).integer("id", solver.ids());
    (detail::add_field<Tags>(frame, solver.template download<Tags>()), ...);
    return frame;
}

/// The same of the particles that lie on this rank: what write_pieces() takes.
template <class... Tags, class Solver>
ParticleFrame frame_here(Solver const& solver)
{
    ParticleFrame frame{.time = solver.time()};
    frame.at(solver.positions_here()).integer("id", solver.ids_here());
    (detail::add_field<Tags>(frame, solver.template download_here<Tags>()), ...);
    return frame;
}

/// What a frame is written as.
enum class FrameFile
{
    vtp, ///< for ParaView, with an index
    ply, ///< for Blender and Houdini, in which the velocity is `v`
    both
};

/// Where the frames of a series go, and how many of them may be under way.
struct FrameSettings
{
    std::filesystem::path folder; ///< of the index; the frames are in its folder `frames`. Both are made.
    FrameFile file = FrameFile::vtp;
    std::size_t most_pending = 2; ///< frames that are taken and not yet written: each is a copy in memory
    std::size_t first = 0;        ///< the number of the first frame, if the series goes on with another's
    std::filesystem::path index = "particles.pvd"; ///< its name in the folder
    std::string shown_field = "velocity"; ///< the colour of points in the state of ParaView beside the index
};

/// A frame that was taken, and is to be written: by write(), once, from anywhere. Copies are the same frame.
class PendingFrame
{
public:
    /// Writes the frame, and returns what FrameSeries::add takes. Throws an Error if the disk is full or the
    /// file cannot be written. Then the files of before are whole, nothing is left of this one, and it may be
    /// tried again. Frames may be written at the same time as others, and in any order.
    PvdEntry write() const
    {
        Job& job = *job_;
        require(job.place != nullptr, "the frame has been written already", "PendingFrame::write",
                "Call write() once for each frame.");
        auto const path = job.folder / job.file;
        if (job.kind != FrameFile::ply) write_vtp(path, job.frame);
        try {
            if (job.kind != FrameFile::vtp)
                write_ply(std::filesystem::path(path).replace_extension(".ply"), job.frame);
        }
        catch (...) {
            std::error_code ignored; // what is wrong is told by the first error
            if (job.kind == FrameFile::both) std::filesystem::remove(path, ignored);
            throw;
        }
        PvdEntry entry{job.frame.time, job.file};
        job.frame = {}; // the memory is needed no more
        job.place = nullptr;
        return entry;
    }

private:
    friend class FrameSeries;
    struct Place
    {};
    struct Job
    {
        ParticleFrame frame;
        std::filesystem::path folder, file;
        FrameFile kind;
        std::shared_ptr<Place> place; ///< among those that are pending
    };

    explicit PendingFrame(Job job) : job_(std::make_shared<Job>(std::move(job))) {}

    std::shared_ptr<Job> job_;
};

/// A series of frames, numbered in the order in which they are taken, that are written while the solver goes
/// on. The object belongs to whatever calls the solver; PendingFrame::write alone may be called elsewhere.
class FrameSeries
{
public:
    /// Throws an Error if the folder cannot be made, or if the series goes on with a number and an index of
    /// this name is there.
    explicit FrameSeries(FrameSettings settings) : settings_(std::move(settings)), next_(settings_.first)
    {
        require(!settings_.folder.empty(), "the folder of the frames has no name", "FrameSeries",
                "Pass the path of one.");
        require(settings_.most_pending > 0, "no frame may be under way", "FrameSeries",
                "Pass 1 or more: each takes the memory of a frame.");
        std::error_code failed;
        std::filesystem::create_directories(settings_.folder / "frames", failed);
        if (failed)
            throw Error{"the folder of the frames cannot be made", settings_.folder.string(),
                        failed.message() + "."};
        if (settings_.first > 0 && has_index() && std::filesystem::exists(index_path()))
            throw Error{"the index of the frames before is there", index_path().string(),
                        "Pass another name for that of the frames from " + std::to_string(settings_.first) +
                            " on."};
    }

    /// How many frames were taken and are still to be written.
    std::size_t pending() const
    {
        auto const is_there = [](auto const& place) { return !place.expired(); };
        return static_cast<std::size_t>(std::ranges::count_if(places_, is_there));
    }
    /// Whether next() may be called now.
    bool has_room() const { return pending() < settings_.most_pending; }

    /// Takes a frame and gives it the next number. Throws an Error, and takes none, if as many as may be are
    /// pending, or if a field does not fit the frame. A frame that is dropped unwritten is not pending any
    /// more, and its number is left out.
    PendingFrame next(ParticleFrame frame)
    {
        char name[48];
        std::snprintf(name, sizeof name, "frames/frame_%04zu.vtp", next_);
        detail::check_frame(frame, settings_.folder / name);
        if (!has_room())
            throw Error{std::to_string(pending()) + " frames are still to be written", "FrameSeries::next",
                        "Wait until the oldest of them is: or let more be pending."};
        std::erase_if(places_, [](auto const& place) { return place.expired(); });
        auto const place = std::make_shared<PendingFrame::Place>();
        places_.push_back(place);
        PendingFrame pending({std::move(frame), settings_.folder, name, settings_.file, place});
        ++next_;
        return pending;
    }

    /// Lists a frame that write() has written in the index, in the order of times. The index is whole on the
    /// disk after each, and lists no frame that is not. With the first one, a state of ParaView is written
    /// that shows the series: see write_paraview_state. Series of PLY have neither. Throws an Error, and
    /// lists none, if the file is not there, its time is not finite, or the index cannot be written.
    void add(PvdEntry entry)
    {
        if (!has_index()) return;
        std::error_code ignored;
        require(is_finite(entry.time) &&
                    std::filesystem::is_regular_file(settings_.folder / entry.file, ignored),
                "the frame to be listed is not there, or its time is not finite", "FrameSeries::add",
                "Pass what PendingFrame::write returned.");
        auto entries = entries_;
        auto const later =
            std::ranges::upper_bound(entries, entry.time, {}, [](auto const& e) { return e.time; });
        entries.insert(later, std::move(entry));
        if (entries_.empty())
            write_paraview_state(state_path(), settings_.index.filename(), settings_.shown_field);
        write_pvd(index_path(), entries);
        entries_ = std::move(entries);
    }

private:
    bool has_index() const { return settings_.file != FrameFile::ply; }
    std::filesystem::path index_path() const { return settings_.folder / settings_.index; }
    std::filesystem::path state_path() const
    {
        auto const path = index_path();
        return path.parent_path() / (path.stem().string() + "_state.py");
    }

    FrameSettings settings_;
    std::size_t next_;
    std::vector<std::weak_ptr<PendingFrame::Place>> places_;
    std::vector<PvdEntry> entries_;
};

} // namespace firn

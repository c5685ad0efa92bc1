// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/io/frame_series.hpp>
#include <firn/io/write_samples.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace firn::fuzz
{

/// A folder of this process's own, in memory where there is such a place; gone with the object.
class TemporaryFolder
{
public:
    TemporaryFolder() : place_(".frames") { std::filesystem::create_directories(path()); }
    TemporaryFolder(TemporaryFolder const&) = delete;
    ~TemporaryFolder()
    {
        std::error_code ignored;
        std::filesystem::remove_all(path(), ignored);
    }
    std::filesystem::path const& path() const { return place_.path(); }

private:
    TemporaryFile place_;
};

inline std::string content_of(std::filesystem::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// A series of frames that are taken and written in any order, and that are to be what the scene was when
/// they were taken.
class FramesUnderWay
{
public:
    explicit FramesUnderWay(int settings)
        : most_(std::size_t(settings % 4)), has_vtp_(settings / 4 % 3 != 1), has_ply_(settings / 4 % 3 != 0)
    {
        FrameSettings chosen{.folder = folder_.path(), .most_pending = most_};
        if (has_ply_) chosen.file = has_vtp_ ? FrameFile::both : FrameFile::ply;
        bool const was_refused = refused([&] { series_.emplace(chosen); });
        expect(was_refused == (most_ == 0), "a series in which no frame may be under way, or the reverse");
    }

    template <class Solver>
    void call(Solver const& solver, Input& input)
    {
        if (!series_) return;
        switch (input.below(4)) {
        case 0:
        case 1:
            take(solver, input);
            break;
        case 2:
            if (!pending_.empty()) write(input);
            break;
        default:
            if (!pending_.empty()) pending_.erase(some_pending(input));
            break;
        }
        expect(series_->pending() == pending_.size() && series_->has_room() == (pending_.size() < most_),
               "another number of frames is under way");
    }

private:
    struct Pending
    {
        PendingFrame frame;
        ParticleFrame told;
    };

    template <class Solver>
    void take(Solver const& solver, Input& input)
    {
        auto frame = frame_of<Velocity, Stress, VolumeRatio>(solver);
        bool good = frame.positions.size() == solver.size() && frame.fields.size() == 4;
        expect(good, "a frame has other particles or fields than were asked for");
        if (input.below(4) == 0) { // one that a host has filled
            frame.time = input.any(1);
            good = std::isfinite(frame.time);
            std::vector<double> values(solver.size() + (input.below(8) == 0 ? 1 : 0), input.any(1));
            good = good && values.size() == solver.size();
            char const* const names[]{"own", "", "velocity", "v_x", "id", "a b", "<"};
            int const name = input.below(7);
            good = good && (name == 0 || name == 3);
            frame.scalar(names[name], values);
        }
        bool const has_room = series_->has_room();
        std::optional<PendingFrame> pending;
        bool const was_refused = refused([&] { pending = series_->next(frame); });
        expect(was_refused == !(has_room && good), "a frame that fits is refused, or the reverse");
        if (!was_refused) pending_.push_back({*pending, std::move(frame)});
    }

    std::vector<Pending>::iterator some_pending(Input& input)
    {
        return pending_.begin() + input.below(int(pending_.size()));
    }

    /// The files are those of the scene as it was. A frame is written once.
    void write(Input& input)
    {
        auto const chosen = some_pending(input);
        PvdEntry entry;
        bool const was_refused = refused([&] { entry = chosen->frame.write(); });
        auto const vtp = folder_.path() / entry.file, other = folder_.path() / "other";
        auto const ply = std::filesystem::path(vtp).replace_extension(".ply");
        if (was_refused) { // in PLY two properties may have one name
            expect(has_ply_, "a frame that was taken cannot be written");
            expect(refused([&] { chosen->frame.write(); }), "a frame was refused, and then written");
            return;
        }
        expect(refused([&] { chosen->frame.write(); }), "a frame was written twice");
        if (has_vtp_) {
            write_vtp(other, chosen->told);
            expect(content_of(vtp) == content_of(other), "a frame is not what the scene was");
        }
        if (has_ply_) {
            write_ply(other, chosen->told);
            expect(content_of(ply) == content_of(other), "a frame is not what the scene was");
        }
        series_->add(entry);
        written_.push_back(entry.file.generic_string());
        std::string const index = content_of(folder_.path() / "particles.pvd");
        for (auto const& file : written_)
            expect(!has_vtp_ || index.find('"' + file + '"') != std::string::npos,
                   "a frame that was written is not listed");
        pending_.erase(chosen);
    }

    TemporaryFolder folder_;
    std::size_t most_;
    bool has_vtp_, has_ply_;
    std::optional<FrameSeries> series_;
    std::vector<Pending> pending_;
    std::vector<std::string> written_;
};

} // namespace firn::fuzz

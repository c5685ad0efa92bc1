// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"
#include "support/refused.hpp"

#include <firn/io/frame_series.hpp>

#include <csignal>
#include <deque>
#include <future>
#include <limits>
#include <sys/resource.h>

using firn::FrameFile;
using firn::FrameSeries;
using firn::test::refused;

namespace
{

std::string text_of(std::filesystem::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// A frame that is known by its time.
firn::ParticleFrame frame_at(double time, std::size_t particles = 3)
{
    firn::ParticleFrame frame{.time = time};
    return frame.at(std::vector<Eigen::Vector3d>(particles, Eigen::Vector3d(time, 0, 0)));
}

} // namespace

TEST_CASE("frames that are written elsewhere, in any order, have the names and the index of those in order")
{
    meshes::Folder const folder;
    FrameSeries series({.folder = folder / "run", .most_pending = 3});
    std::vector<firn::PendingFrame> taken;
    for (int i = 0; i < 3; ++i) taken.push_back(series.next(frame_at(0.25 * i)));
    CHECK(series.pending() == 3);
    CHECK_FALSE(series.has_room());
    CHECK_THAT(refused([&] { (void)series.next(frame_at(9)); }).what_is_wrong(),
               Contains("3 frames are still to be written"));
    series.add(taken[2].write());
    CHECK(series.pending() == 2);
    auto first = std::async(std::launch::async, [frame = taken[0]] { return frame.write(); });
    auto second = std::async(std::launch::async, [frame = taken[1]] { return frame.write(); });
    series.add(second.get());
    series.add(first.get());
    CHECK(series.pending() == 0);
    refused([&] { (void)taken[1].write(); });
    for (int i = 0; i < 3; ++i)
        CHECK_THAT(text_of(folder / "run/frames" / ("frame_000" + std::to_string(i) + ".vtp")),
                   Contains("format=\"ascii\">" + firn::detail::exact_text(0.25 * i) + "<"));
    auto const index = text_of(folder / "run/particles.pvd");
    auto const at = [&](std::string const& part) { return index.find(part); };
    CHECK(at("\"0\" group=\"\" part=\"0\" file=\"frames/frame_0000.vtp\"") < at("\"0.25\" group"));
    CHECK(at("\"0.25\" group=\"\" part=\"0\" file=\"frames/frame_0001.vtp\"") < at("\"0.5\" group"));
    CHECK_THAT(text_of(folder / "run/particles_state.py"),
               Contains("\nINDEX = \"particles.pvd\"\nFIELD = \"velocity\"\n"));
    CHECK(at("\"0.5\" group=\"\" part=\"0\" file=\"frames/frame_0002.vtp\"") < std::string::npos);
}

TEST_CASE("many frames under way at the same time are all written, and no more than may be are there at once")
{
    meshes::Folder const folder;
    FrameSeries series({.folder = folder / "", .file = FrameFile::both, .most_pending = 4});
    std::deque<std::future<firn::PvdEntry>> writing;
    auto const finish_oldest = [&] {
        auto oldest = std::move(writing.front());
        writing.pop_front();
        series.add(oldest.get());
    };
    for (int i = 0; i < 40; ++i) {
        while (!series.has_room()) finish_oldest();
        CHECK(series.pending() < 4);
        writing.push_back(std::async(std::launch::async,
                                     [frame = series.next(frame_at(i, 2000))] { return frame.write(); }));
    }
    while (!writing.empty()) finish_oldest();
    FrameSeries alone({.folder = folder / "of_ply", .file = FrameFile::ply});
    alone.add(alone.next(frame_at(0)).write());
    CHECK_FALSE(std::filesystem::exists(folder / "of_ply/particles_state.py"));
    for (auto const* const name : {"frame_0000.vtp", "frame_0039.vtp", "frame_0000.ply", "frame_0039.ply"})
        CHECK(std::filesystem::exists(folder / "frames" / name));
    CHECK_THAT(text_of(folder / "particles.pvd"), Contains("timestep=\"39\""));
}

TEST_CASE("a full disk is an error that loses no frame of before, and the series goes on")
{
    meshes::Folder const folder;
    FrameSeries series({.folder = folder / ""});
    series.add(series.next(frame_at(0)).write());
    auto const before = text_of(folder / "frames/frame_0000.vtp"), index = text_of(folder / "particles.pvd");
    auto const large = series.next(frame_at(1, 100000));
    // A limit on the size of files stands for a full disk.
    rlimit limit{};
    REQUIRE(getrlimit(RLIMIT_FSIZE, &limit) == 0);
    auto const handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit const small{100000, limit.rlim_max};
    REQUIRE(setrlimit(RLIMIT_FSIZE, &small) == 0);
    std::string said;
    try {
        (void)large.write();
    }
    catch (firn::Error const& error) {
        said = error.what_is_wrong();
    }
    setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, handler);
    CHECK(said == "the file could not be written to its end");
    CHECK(text_of(folder / "frames/frame_0000.vtp") == before);
    CHECK(text_of(folder / "particles.pvd") == index);
    CHECK_FALSE(std::filesystem::exists(folder / "frames/frame_0001.vtp"));
    CHECK(series.pending() == 1); // it may be tried again
    series.add(large.write());
    CHECK(std::filesystem::exists(folder / "frames/frame_0001.vtp"));
    {
        auto const dropped = series.next(frame_at(2));
        CHECK(series.pending() == 1);
    }
    CHECK(series.pending() == 0);
    series.add(series.next(frame_at(3)).write());
    CHECK_THAT(text_of(folder / "particles.pvd"),
               Contains("\"3\" group=\"\" part=\"0\" file=\"frames/frame_0003"));
}

TEST_CASE(
    "of a frame of two files nothing is left if one of them cannot be written, and it may be tried again")
{
    meshes::Folder const folder;
    FrameSeries series({.folder = folder / "", .file = FrameFile::both});
    series.add(series.next(frame_at(0)).write());
    auto const index = text_of(folder / "particles.pvd"), before = text_of(folder / "frames/frame_0000.ply");
    auto const in_the_way = folder / "frames/frame_0001.ply"; // a folder of that name
    std::filesystem::create_directories(in_the_way / "full");
    auto const second = series.next(frame_at(1));
    CHECK_THAT(refused([&] { (void)second.write(); }).where(), Contains("frame_0001.ply"));
    CHECK_FALSE(std::filesystem::exists(folder / "frames/frame_0001.vtp"));
    CHECK(text_of(folder / "particles.pvd") == index);
    CHECK(text_of(folder / "frames/frame_0000.ply") == before);
    CHECK(series.pending() == 1);
    std::filesystem::remove_all(in_the_way);
    series.add(second.write());
    CHECK(std::filesystem::is_regular_file(in_the_way));
    CHECK(std::filesystem::exists(folder / "frames/frame_0001.vtp"));
    CHECK_THAT(text_of(folder / "particles.pvd"), Contains("frame_0001.vtp"));
    for (auto const& each : std::filesystem::directory_iterator(folder / "frames")) { // nothing half written
        auto const kind = each.path().extension();
        CHECK((kind == ".vtp" || kind == ".ply"));
    }
}

TEST_CASE("a frame that is not there, or of no time, is not listed")
{
    meshes::Folder const folder;
    FrameSeries series({.folder = folder / ""});
    auto const entry = series.next(frame_at(0)).write();
    series.add(entry);
    auto const index = text_of(folder / "particles.pvd");
    double const nan = std::numeric_limits<double>::quiet_NaN();
    for (auto const& wrong : {firn::PvdEntry{nan, entry.file}, firn::PvdEntry{1, ""},
                              firn::PvdEntry{1, "frames/frame_0001.vtp"}, firn::PvdEntry{1, "frames"}})
        CHECK_THAT(refused([&] { series.add(wrong); }).where(), Contains("FrameSeries::add"));
    CHECK(text_of(folder / "particles.pvd") == index);
    refused([&] { firn::write_pvd(folder / "particles.pvd", {{nan, entry.file}}); });
    CHECK(text_of(folder / "particles.pvd") == index);
}

TEST_CASE("a series that cannot be, or would write over another's index, is refused")
{
    meshes::Folder const folder;
    refused([] { FrameSeries({.folder = ""}); });
    refused([&] { FrameSeries({.folder = folder / "", .most_pending = 0}); });
    refused([&] { FrameSeries({.folder = folder.file("file", "x") / "below"}); });
    FrameSeries series({.folder = folder / ""});
    auto misfit = frame_at(0);
    misfit.scalar("J", std::vector<float>{1});
    refused([&] { (void)series.next(misfit); });
    CHECK(series.pending() == 0);
    series.add(series.next(frame_at(0)).write());
    CHECK_THAT(refused([&] { FrameSeries({.folder = folder / "", .first = 1}); }).what_is_wrong(),
               Contains("the index of the frames before"));
    FrameSeries more(
        {.folder = folder / "", .first = 1, .index = "more \"or\" less.pvd", .shown_field = "J_P"});
    more.add(more.next(frame_at(1)).write());
    CHECK(std::filesystem::exists(folder / "frames/frame_0001.vtp"));
    CHECK_THAT(text_of(folder / "more \"or\" less.pvd"),
               Contains("frame_0001.vtp") && !Contains("frame_0000.vtp"));
    CHECK_THAT(text_of(folder / "more \"or\" less_state.py"),
               Contains("\nINDEX = \"more \\\"or\\\" less.pvd\"\nFIELD = \"J_P\"\n"));
}

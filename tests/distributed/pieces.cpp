// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "distributed/numbers.hpp"
#include "support/meshes.hpp"

#include <firn/core/exactly_equal.hpp>
#include <firn/distributed.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/firn.hpp>
#include <firn/io/frame_series.hpp>
#include <firn/io/write_pieces.hpp>
#include <firn/openmp.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <mutex>
#include <string>
#include <vector>

using namespace firn;
using firn::test::box_of_points;

// What a rank returns of its own particles, and the pieces of frames that it writes.
namespace
{

using Pieces = Distributed<OpenMP, RankThreads>;
using Flat = firn::Space<2, double>;
using Two = Materials<NeoHookean<Flat>, Sand<Flat>>;

std::string text_of_file(std::filesystem::path const& path)
{
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// A jelly and sand that collide, after some steps; a few particles are gone, so ids have gaps.
auto collided(RankThreads const& communicator)
{
    Solver<Pieces, Two> solver(lattice(0.1), {}, {}, {},
                               Pieces{.local = {.threads = 1}, .communicator = communicator});
    solver.add<NeoHookean<Flat>>(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05, {4, 0});
    solver.add<Sand<Flat>>(box_of_points<2>({1.1, 0.2}, {2.1, 1.2}, 0.05), 0.05 * 0.05, {-4, 1});
    solver.advance(0.02, Gravity{});
    solver.remove_if([](Vector<double, 2> const& x) { return x[1] > 0.9; });
    return solver;
}

} // namespace

TEST_CASE("a rank returns the values of its own particles, and each particle is one rank's")
{
    std::vector<std::uint32_t> ids;
    std::size_t different = 0, others = 0;
    std::mutex one_at_a_time;
    run_ranks(3, [&](RankThreads const& communicator) {
        auto const solver = collided(communicator);
        auto const all = solver.ids(), here = solver.ids_here();
        auto const x = solver.positions(), x_here = solver.positions_here();
        auto const v = solver.download<Velocity>(), v_here = solver.download_here<Velocity>();
        auto const s = solver.download<Stress>(), s_here = solver.download_here<Stress>();
        auto const strains = solver.download<DisplacementGradient, Sand<Flat>>();
        auto const view = solver.view_here<DisplacementGradient, Sand<Flat>>();
        auto const sand = solver.ids<Sand<Flat>>(), sand_here = solver.ids_here<Sand<Flat>>();
        std::lock_guard const lock(one_at_a_time);
        for (std::size_t i = 0; i < here.size(); ++i) {
            auto const row = std::size_t(std::ranges::lower_bound(all, here[i]) - all.begin());
            different += !(x[row] == x_here[i] && v[row] == v_here[i] && s[row] == s_here[i]);
        }
        for (std::size_t i = 0; i < view.count; ++i) {
            different += !firn::exactly_equal(view.component[1][i * view.stride], strains[view.row[i]](0, 1));
            different += !std::ranges::binary_search(sand_here, sand[view.row[i]]);
        }
        different += view.count != sand_here.size();
        for (auto const id : here)
            others += std::ranges::binary_search(sand, id) != std::ranges::binary_search(sand_here, id);
        different += !std::ranges::is_sorted(here) || x_here.size() != here.size();
        ids.insert(ids.end(), here.begin(), here.end());
        std::ranges::sort(ids);
        if (ids.size() >= all.size()) different += ids != all;
    });
    CHECK(ids.size() > 500);
    CHECK(std::ranges::adjacent_find(ids) == ids.end());
    CHECK(different == 0);
    CHECK(others == 0);
}

TEST_CASE("each rank writes its piece of a frame, and the first lists them")
{
    meshes::Folder const folder;
    auto const list = folder / "a & b.pvtp";
    run_ranks(3, [&](RankThreads const& communicator) {
        auto const solver = collided(communicator);
        auto const frame = frame_here<Velocity>(solver);
        write_pieces(list, frame, solver.backend());
        write_vtp(folder / ("own_" + std::to_string(communicator.rank())), frame);
    });
    auto const text = text_of_file(list);
    std::size_t piece = 0;
    for (int const rank : {0, 1, 2}) {
        auto const name = "_" + std::to_string(rank);
        piece = text.find("<Piece Source=\"a &amp; b" + name + ".vtp\"/>", piece);
        CHECK(piece != std::string::npos);
        auto const written = text_of_file(folder / ("a & b" + name + ".vtp"));
        CHECK(written.size() > 1000);
        CHECK(written == text_of_file(folder / ("own" + name)));
    }
    CHECK(text.find("<PDataArray type=\"UInt32\" Name=\"id\" NumberOfComponents=\"1\"/>") !=
          std::string::npos);
    CHECK(text.find("<PDataArray type=\"Float32\" Name=\"velocity\" NumberOfComponents=\"3\"/>") !=
          std::string::npos);
}

TEST_CASE("a piece that cannot be written is the same error on all ranks, and the list stays")
{
    meshes::Folder const folder;
    auto const list = folder / "frame.pvtp";
    std::filesystem::create_directory(folder / "frame_1.vtp"); // in the way of the second rank
    std::ofstream(list) << "before";
    std::vector<std::string> errors(3), of_other_times(3), of_other_names(3);
    run_ranks(3, [&](RankThreads const& communicator) {
        Pieces const backend{.local = {.threads = 1}, .communicator = communicator};
        auto const rank = std::size_t(communicator.rank());
        auto const error_of = [&](std::filesystem::path const& path, ParticleFrame const& frame) {
            try {
                write_pieces(path, frame, backend);
            }
            catch (Error const& error) {
                return std::string(error.what());
            }
            return std::string();
        };
        errors[rank] = error_of(list, {});
        of_other_times[rank] = error_of(list, {.time = double(rank)});
        of_other_names[rank] = error_of(folder / "frame.vtp", {});
    });
    CHECK(text_of_file(list) == "before");
    for (std::size_t const rank : {0u, 1u, 2u}) {
        CHECK(errors[rank].find("frame_1.vtp") != std::string::npos);
        CHECK(errors[rank] == errors[0]);
        CHECK(of_other_times[rank].find("not all ranks make the same call") != std::string::npos);
        CHECK(of_other_names[rank].find("'.pvtp'") != std::string::npos);
    }
}

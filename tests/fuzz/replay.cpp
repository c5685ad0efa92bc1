// SPDX-License-Identifier: MIT
// Passes the files of tests/fuzz/corpus through the harnesses, without a fuzzer: `replay corpus`. With
// `replay --seed corpus` it writes those that a fuzzer starts from (with FIRN_FUZZ_ALL those in space, too).
#include "calls.hpp"
#include "checkpoint.hpp"
#include "parameters.hpp"
#include "worlds.hpp"
#if defined(FIRN_FUZZ_MESHES)
#include "mesh.hpp"
#endif
#include "support/meshes.hpp"

#include <map>

namespace fs = std::filesystem;
using namespace firn::fuzz;

namespace
{

std::map<std::string, void (*)(Bytes)> const harnesses
{
    {"calls", calls}, {"checkpoint", checkpoint}, {"parameters", parameters}, {"worlds", worlds},
#if defined(FIRN_FUZZ_MESHES)
    {
        "mesh", mesh
    }
#endif
};

std::string content(fs::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// A few particles of snow after a step in which one of them was isolated.
template <class Solver>
Solver some_snow()
{
    Solver solver(firn::lattice(0.05), firn::materials::fresh_snow<typename Solver::Space>());
    using Point = firn::Vector<double, Solver::d>;
    std::vector<Point> points;
    for (int i = 0; i < 6; ++i) {
        points.push_back(Point::Constant(0.02));
        points.back().template head<2>() = Eigen::Vector2d(0.02 * i, 0.1 + 0.01 * (i % 3));
    }
    solver.add(points, 6e-4, Point::Unit(0) - Point::Unit(1));
    solver.step(1e-4, firn::Gravity{});
    solver.remove_if(OnTheLeft{0.01});
    auto snapshot = solver.snapshot();
    snapshot.isolated.push_back({.cause = firn::FailureCause::rejected, .time = 1e-4, .dt = 1e-4});
    solver.restore(snapshot);
    return solver;
}

/// Files that are good, one for each way to begin.
void write_seeds(fs::path const& folder)
{
    auto const put = [&](char const* harness, char const* name, std::string const& bytes) {
        fs::create_directories(folder / harness);
        std::ofstream(folder / harness / name, std::ios::binary) << bytes;
    };
    auto const ball = meshes::sphere(1, 4);
    put("mesh", "obj", '\0' + meshes::obj(ball));
    put("mesh", "stl", '\1' + meshes::stl(ball));
    put("mesh", "ply", '\2' + meshes::ply(ball));
    put("mesh", "gltf", '\3' + meshes::gltf_json(ball, "none.bin", {0, 0, 0}));
    put("mesh", "glb", '\4' + meshes::glb(ball));

    auto sheet = some_snow<Sheet>();
    TemporaryFile const file(".firn");
    firn::write_checkpoint(file.path(), sheet);
    std::string const whole = file.content();
    put("checkpoint", "scene", whole.substr(sizeof(firn::detail::CheckpointPreamble)));
    put("checkpoint", "whole_file", '\0' + whole);
    firn::write_checkpoint(file.path(), sheet, firn::RigidBody{}, 5);
    put("checkpoint", "companions", file.content().substr(sizeof(firn::detail::CheckpointPreamble)));

    // every call once, after some particles are there
    auto const with_calls = [](char scene, int first, int last) {
        std::string bytes{scene, '\5', '\0', '\40', '\1'};
        for (int i = 0; i < 80; ++i) bytes += static_cast<char>(i * 41);
        for (int call = first; call < last; ++call) {
            bytes += static_cast<char>(call);
            for (int i = 0; i < 12; ++i) bytes += static_cast<char>(call * 7 + i * 29);
        }
        return bytes;
    };
    put("calls", "every_call", with_calls('\0', 0, 16));
    put("worlds", "every_call", with_calls('\0', 0, 16));
    put("calls", "every_call_with_marks", with_calls('\5', 0, 16));
    put("calls", "later_calls", with_calls('\10', 16, 26));
    put("calls", "later_calls_with_marks", with_calls('\15', 16, 26));
    put("calls", "latest_calls", with_calls('\30', 26, 31));
    put("calls", "latest_calls_with_marks", with_calls('\35', 26, 31));
    put("calls", "every_call_of_a_pool", with_calls('\37', 0, 31));
#if defined(FIRN_FUZZ_ALL)
    put("calls", "every_call_in_space", with_calls('\2', 0, 16));
    put("calls", "later_calls_in_space", with_calls('\12', 16, 26));
    auto ball_of_snow = some_snow<SnowBall>();
    firn::write_checkpoint(file.path(), ball_of_snow);
    put("checkpoint", "in_space", file.content().substr(sizeof(firn::detail::CheckpointPreamble)));
    put("parameters", "usual_7", {'\7', 0, 99, 0, 0, 0, 0});
#endif
    put("parameters", "usual_8", {'\10', 0, 99, 0, 0, 0, 0});
    put("parameters", "usual_pool", {'\374', 0, 99, 0, 0, 0, 0});
    for (char model = 0; model < 7; ++model)
        put("parameters", ("usual_" + std::to_string(model)).c_str(), {model, 0, 99, 0, 0, 0, 0});
}

} // namespace

int main(int argc, char** argv)
{
    bool const writes = argc == 3 && std::string(argv[1]) == "--seed";
    if (argc != 2 && !writes) return std::fprintf(stderr, "replay [--seed] FOLDER\n"), 2;
    fs::path const folder = argv[argc - 1];
    if (writes) return write_seeds(folder), 0;
    for (auto const& [name, harness] : harnesses) {
        std::size_t files = 0;
        for (auto const& entry : fs::directory_iterator(folder / name)) {
            std::fprintf(stderr, "%s\n", entry.path().c_str()); // the last one is that which ends the program
            std::string const bytes = content(entry.path());
            harness({reinterpret_cast<std::uint8_t const*>(bytes.data()), bytes.size()});
            ++files;
        }
        std::printf("%s: %zu files\n", name.c_str(), files);
        if (files == 0) return std::fprintf(stderr, "%s has no files\n", name.c_str()), 1;
    }
    return 0;
}

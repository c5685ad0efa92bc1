// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"

#include <firn/io/write_particles.hpp>

#include <csignal>
#include <sys/resource.h>

using Eigen::Vector3d;

namespace
{

std::string content(std::filesystem::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

template <class T>
T read(std::string const& bytes, std::size_t& at)
{
    T value;
    std::memcpy(&value, bytes.data() + at, sizeof(T));
    at += sizeof(T);
    return value;
}

firn::ParticleFrame small_frame()
{
    firn::ParticleFrame frame{.time = 0.1};
    std::vector<Vector3d> const x{{1, 2, 3}, {1e6 + 0.125, 5, 6}}, v{{-1, 0, 0.5}, {7, 8, 9}};
    return frame.at(x).vector("velocity", v).scalar("J_P", std::vector<double>{0.9, 1.1});
}

std::size_t files_in(meshes::Folder const& folder)
{
    auto const begin = std::filesystem::directory_iterator(folder / "");
    return std::size_t(std::distance(begin, std::filesystem::directory_iterator{}));
}

} // namespace

TEST_CASE("a VTP file holds positions, fields and time where its head says")
{
    meshes::Folder const folder;
    firn::write_vtp(folder / "a.vtp", small_frame());
    auto const text = content(folder / "a.vtp");
    CHECK_THAT(text, Contains("Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">0.1<"));
    CHECK_THAT(text, Contains("NumberOfPoints=\"2\" NumberOfVerts=\"1\""));
    CHECK_THAT(text, Contains("Name=\"Points\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\""));
    CHECK_THAT(text,
               Contains("Name=\"velocity\" NumberOfComponents=\"3\" format=\"appended\" offset=\"84\""));
    CHECK_THAT(text, Contains("Name=\"J_P\" NumberOfComponents=\"1\" format=\"appended\" offset=\"116\""));
    auto const begin = text.find("\n_") + 2;
    std::size_t at = begin;
    CHECK(read<std::uint64_t>(text, at) == 48);
    for (double const x : {1.0, 2.0, 3.0, 1e6 + 0.125, 5.0, 6.0}) CHECK(read<double>(text, at) == x);
    CHECK(read<std::uint64_t>(text, at) == 8);
    CHECK(read<std::int32_t>(text, at) == 0);
    CHECK(read<std::int32_t>(text, at) == 1);
    CHECK(read<std::uint64_t>(text, at) == 4);
    CHECK(read<std::int32_t>(text, at) == 2);
    CHECK(at - begin == 84);
    CHECK(read<std::uint64_t>(text, at) == 24);
    for (float const v : {-1.0f, 0.0f, 0.5f, 7.0f, 8.0f, 9.0f}) CHECK(read<float>(text, at) == v);
    CHECK(read<std::uint64_t>(text, at) == 8);
    for (float const j : {0.9f, 1.1f}) CHECK(read<float>(text, at) == j);
    CHECK(text.substr(at) == "\n</AppendedData>\n</VTKFile>\n");
    CHECK(files_in(folder) == 1);
}

TEST_CASE("a matrix is nine numbers, row by row, of which the plane has four")
{
    meshes::Folder const folder;
    Eigen::Matrix2f stress;
    stress << 1, 2, 3, 4;
    firn::ParticleFrame frame;
    frame.at(std::vector<Vector3d>{{0, 0, 0}}).matrix("stress", std::vector<Eigen::Matrix2f>{stress});
    CHECK(frame.fields[0].values == std::vector<float>{1, 2, 0, 3, 4, 0, 0, 0, 0});
    firn::write_vtp(folder / "a.vtp", frame);
    CHECK_THAT(content(folder / "a.vtp"), Contains("Name=\"stress\" NumberOfComponents=\"9\""));
    firn::write_ply(folder / "a.ply", frame);
    CHECK_THAT(content(folder / "a.ply"),
               Contains("property float stress_xx\nproperty float stress_xy\nproperty float stress_xz\n"
                        "property float stress_yx\n"));
}

TEST_CASE("ids are written as integers, to the last")
{
    meshes::Folder const folder;
    firn::ParticleFrame frame;
    std::vector<std::uint32_t> const ids{16777217u, 4294967294u}; // beyond what a float tells apart
    frame.at(std::vector<Vector3d>{{0, 0, 0}, {1, 2, 3}})
        .integer("id", ids)
        .scalar("J", std::vector{0.5, 2.0});
    firn::write_vtp(folder / "a.vtp", frame);
    auto text = content(folder / "a.vtp");
    CHECK_THAT(
        text,
        Contains("type=\"UInt32\" Name=\"id\" NumberOfComponents=\"1\" format=\"appended\" offset=\"84\""));
    CHECK_THAT(
        text,
        Contains("type=\"Float32\" Name=\"J\" NumberOfComponents=\"1\" format=\"appended\" offset=\"100\""));
    std::size_t at = text.find("\n_") + 2 + 84;
    CHECK(read<std::uint64_t>(text, at) == 8);
    for (std::uint32_t const id : ids) CHECK(read<std::uint32_t>(text, at) == id);
    CHECK(read<std::uint64_t>(text, at) == 8);
    CHECK(read<float>(text, at) == 0.5f);

    firn::write_ply(folder / "a.ply", frame);
    text = content(folder / "a.ply");
    CHECK_THAT(text, Contains("property float z\nproperty uint id\nproperty float J\nend_header\n"));
    at = text.find("end_header\n") + 11;
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(read<float>(text, at) == float(frame.positions[i].x()));
        at += 8;
        CHECK(read<std::uint32_t>(text, at) == ids[i]);
        CHECK(read<float>(text, at) == (i == 0 ? 0.5f : 2.f));
    }
    frame.fields[0].integers.pop_back();
    CHECK_THROWS_AS(firn::write_ply(folder / "b.ply", frame), firn::Error);
}

TEST_CASE("what is no integer of 32 bits is refused as one, and adds no field")
{
    firn::ParticleFrame frame;
    CHECK_THROWS_WITH(frame.integer("id", std::vector<int>{0, -1}),
                      Contains("no integer from 0 to 2^32 - 1"));
    CHECK_THROWS_AS(frame.integer("id", std::vector<std::uint64_t>{std::uint64_t(1) << 32}), firn::Error);
    CHECK_THROWS_AS(frame.integer("id", std::vector<std::uint64_t>{~std::uint64_t(0)}), firn::Error);
    CHECK_THROWS_AS(frame.integer("id", std::vector<double>{0.5}), firn::Error);
    CHECK(frame.fields.empty());
    frame.integer("id", std::vector<std::uint64_t>{0xffffffffu}).integer("flag", std::vector<bool>{true});
    CHECK(frame.fields[0].integers[0] == 0xffffffffu);
    CHECK(frame.fields[1].integers[0] == 1);
}

TEST_CASE("a PLY file holds one row of floats for each particle")
{
    meshes::Folder const folder;
    firn::write_ply(folder / "a.ply", small_frame());
    auto const text = content(folder / "a.ply");
    CHECK_THAT(text, StartsWith("ply\nformat binary_little_endian 1.0\n"));
    CHECK_THAT(text, Contains("comment time 0.1 s\nelement vertex 2\nproperty float x\nproperty float y\n"
                              "property float z\nproperty float v_x\nproperty float v_y\n"
                              "property float v_z\nproperty float J_P\nend_header\n"));
    auto at = text.find("end_header\n") + 11;
    for (float const value :
         {1.f, 2.f, 3.f, -1.f, 0.f, 0.5f, 0.9f, 1000000.125f, 5.f, 6.f, 7.f, 8.f, 9.f, 1.1f})
        CHECK(read<float>(text, at) == value);
    CHECK(at == text.size());
}

TEST_CASE(
    "the velocity is v in PLY, as in Houdini, unless another field has that name, and keeps its own in VTP")
{
    meshes::Folder const folder;
    auto frame = small_frame();
    firn::write_vtp(folder / "a.vtp", frame);
    CHECK_THAT(content(folder / "a.vtp"), Contains("Name=\"velocity\"") && !Contains("Name=\"v\""));
    frame.vector("v", std::vector<Vector3d>{{0, 0, 0}, {1, 1, 1}});
    firn::write_ply(folder / "a.ply", frame);
    CHECK_THAT(content(folder / "a.ply"), Contains("property float velocity_x\n") && Contains("float v_x\n"));
    firn::ParticleFrame speeds; // a scalar is no velocity
    speeds.at(std::vector<Vector3d>{{0, 0, 0}}).scalar("velocity", std::vector<float>{1});
    firn::write_ply(folder / "b.ply", speeds);
    CHECK_THAT(content(folder / "b.ply"), Contains("property float velocity\n"));
}

TEST_CASE("particles in the plane are written with z = 0")
{
    firn::ParticleFrame frame;
    frame.at(std::vector<Eigen::Vector2f>{{1, 2}}).vector("velocity", std::vector<Eigen::Vector2d>{{3, 4}});
    CHECK(frame.positions[0] == Vector3d{1, 2, 0});
    CHECK(frame.fields[0].values == std::vector<float>{3, 4, 0});
}

TEST_CASE("a frame without particles is a file too")
{
    meshes::Folder const folder;
    firn::ParticleFrame frame;
    frame.scalar("J_P", std::vector<float>{});
    firn::write_vtp(folder / "a.vtp", frame);
    firn::write_ply(folder / "a.ply", frame);
    CHECK_THAT(content(folder / "a.vtp"), Contains("NumberOfPoints=\"0\" NumberOfVerts=\"0\""));
    CHECK_THAT(content(folder / "a.ply"), Contains("element vertex 0\n") && EndsWith("end_header\n"));
}

TEST_CASE("an index lists each file with its time and is whole after each")
{
    meshes::Folder const folder;
    firn::PvdIndex index(folder / "series.pvd");
    index.add(0, "frame_0.vtp");
    auto const one = content(folder / "series.pvd");
    CHECK_THAT(one, Contains("timestep=\"0\"") && EndsWith("</VTKFile>\n"));
    index.add(1.0 / 24, "snow & <ice>.vtp");
    auto const two = content(folder / "series.pvd");
    CHECK_THAT(two, Contains("<DataSet timestep=\"0\" group=\"\" part=\"0\" file=\"frame_0.vtp\"/>"));
    CHECK_THAT(two, Contains("timestep=\"0.041666666666666664\"") && Contains("snow &amp; &lt;ice>.vtp"));
}

TEST_CASE("a file that cannot be written is refused, for root too, and leaves nothing behind")
{
    meshes::Folder const folder;
    auto const frame = small_frame();
    auto const below_a_file = folder.file("file", "x") / "a.vtp";
    CHECK_THROWS_AS(firn::write_vtp(below_a_file, frame), firn::Error);
    CHECK_THROWS_AS(firn::write_ply(below_a_file, frame), firn::Error);
    CHECK_THROWS_AS(firn::write_pvd(below_a_file, {}), firn::Error);
    CHECK_THROWS_WITH(firn::write_vtp(folder / "none" / "a.vtp", frame), Contains("Create its folder first"));
    CHECK_THROWS_WITH(firn::write_vtp(folder / "", frame), Contains("folder"));
    CHECK(files_in(folder) == 1);
}

TEST_CASE("a writer that throws leaves the file of before, and nothing beside it")
{
    meshes::Folder const folder;
    auto const path = folder.file("a", "before");
    CHECK_THROWS_AS(firn::detail::replace_file(path,
                                               [](std::ostream& out) {
                                                   out << "half";
                                                   throw std::bad_alloc();
                                               }),
                    std::bad_alloc);
    CHECK(content(path) == "before");
    CHECK(files_in(folder) == 1);
}

TEST_CASE("a second writer of a file is refused as long as the first one writes, and no longer")
{
    meshes::Folder const folder;
    auto const path = folder / "a";
    auto const write = [&](std::string const& text, auto const& meanwhile) {
        firn::detail::replace_file(path, [&](std::ostream& out) {
            out << text;
            meanwhile();
        });
    };
    auto const nothing = [] {};
    (void)folder.file("a.part", "left by a program that was killed, and longer");
    write("first", [&] { // the same in another thread: the lock is on the file
        CHECK_THROWS_WITH(write("second", nothing), Contains("another program is writing this file"));
    });
    CHECK(content(path) == "first");
    CHECK(files_in(folder) == 1);
    write("third", nothing);
    CHECK(content(path) == "third");
}

TEST_CASE("a write cut short is refused and leaves the file of before")
{
    meshes::Folder const folder;
    auto const path = folder.file("a.vtp", "before");
    firn::ParticleFrame frame;
    frame.at(std::vector<Vector3d>(100000, Vector3d::Zero()));
    // A limit on the size of files stands for a full disk.
    rlimit before{};
    REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
    auto const handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit const small{100000, before.rlim_max};
    REQUIRE(setrlimit(RLIMIT_FSIZE, &small) == 0);
    std::string refused;
    for (auto const& write : {firn::write_vtp, firn::write_ply}) {
        try {
            write(path, frame);
        }
        catch (firn::Error const& error) {
            refused += error.what_is_wrong() + "; ";
        }
    }
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, handler);
    CHECK(refused == "the file could not be written to its end; the file could not be written to its end; ");
    CHECK(content(path) == "before");
    CHECK(files_in(folder) == 1);
}

TEST_CASE("fields that do not fit the particles are refused")
{
    meshes::Folder const folder;
    auto const refused = [&](auto const& change, std::string const& what) {
        auto frame = small_frame();
        change(frame);
        CHECK_THROWS_WITH(firn::write_vtp(folder / "a.vtp", frame), Contains(what));
        CHECK_THROWS_WITH(firn::write_ply(folder / "a.ply", frame), Contains(what));
    };
    refused([](auto& frame) { frame.scalar("J", std::vector<float>{1}); }, "holds 1 numbers for 2 particles");
    refused([](auto& frame) { frame.scalar("J_P", std::vector<float>{1, 2}); }, "two fields are named");
    refused([](auto& frame) { frame.scalar("a b", std::vector<float>{1, 2}); }, "is not plain");
    refused([](auto& frame) { frame.scalar("", std::vector<float>{1, 2}); }, "is not plain");
    refused([](auto& frame) { frame.fields[0].components = 2; }, "2 components");
    auto frame = small_frame();
    CHECK_THROWS_WITH(firn::write_ply(folder / "a.ply", frame.scalar("x", std::vector<float>{1, 2})),
                      Contains("two PLY properties"));
    CHECK(files_in(folder) == 0);
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"
#include "support/policies.hpp"

#include <firn/io/checkpoint.hpp>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

using namespace firn;
using namespace firn::test;

namespace
{

using Sheet = Scene<Snow<PlaneFloat>, QuadraticBSpline, Mls>::Solver;

StepFailure const gone{.cause = FailureCause::not_finite,
                       .particle = 0,
                       .position = {0.0125, 0.0125, 0},
                       .time = 1e-4,
                       .dt = 2e-5,
                       .count = 3};

/// Two lumps of snow, one of which has lost a particle.
Sheet small_scene(double cell_size = 0.05)
{
    Sheet solver(lattice(cell_size), materials::fresh_snow<PlaneFloat>());
    solver.add(box_of_points<2>({0, 0}, {0.1, 0.1}, 0.05), 6e-4, {1, -1});
    solver.add(box_of_points<2>({0.3, 0}, {0.35, 0.1}, 0.05), 7e-4, {-1, 0});
    solver.step(1e-4, Gravity{});
    solver.remove_if(Inside<Sphere>{.shape = {0.03}, .pose = {.position = {0, 0, 0}}});
    auto snapshot = solver.snapshot();
    snapshot.isolated = {gone}; // as if it had been isolated
    solver.restore(snapshot);
    return solver;
}

std::string content(std::filesystem::path const& path)
{
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

void write(std::filesystem::path const& path, std::string const& bytes)
{
    std::filesystem::remove(path); // some file systems wait for the disk when a file is written over
    std::ofstream(path, std::ios::binary) << bytes;
}

/// The bytes with correct checksums: no accidental damage produces these.
std::string signed_anew(std::string bytes)
{
    detail::CheckpointPreamble preamble;
    std::memcpy(static_cast<void*>(&preamble), bytes.data(), sizeof(preamble));
    detail::Crc32 crc;
    crc.add(std::span<char const>(bytes).subspan(sizeof(preamble)));
    preamble.bytes = bytes.size();
    preamble.checksum = crc.value();
    preamble.own_checksum = preamble.find_own_checksum();
    std::memcpy(bytes.data(), &preamble, sizeof(preamble));
    return bytes;
}

/// Runs what must be refused; returns the message, which must have its three parts.
template <class Call>
std::string refused(Call const& call)
{
    try {
        call();
    }
    catch (Error const& error) {
        if (error.what_is_wrong().empty() || error.where().empty() || error.remedy().empty())
            FAIL("a part of the error is missing: " << error.what());
        return error.what();
    }
    return "nothing was refused";
}

template <class Solver>
bool same(Solver const& a, Solver const& b)
{
    return a.time() == b.time() && a.ids() == b.ids() && a.positions() == b.positions() &&
           a.template download<Velocity>() == b.template download<Velocity>() && a.masses() == b.masses();
}

} // namespace

TEST_CASE("the checksum is that of zip and Ethernet")
{
    auto const of = [](std::string const& text, std::size_t cut) {
        detail::Crc32 crc;
        crc.add(std::span<char const>(text).first(cut));
        crc.add(std::span<char const>(text).subspan(cut));
        return crc.value();
    };
    CHECK(of("", 0) == 0);
    for (std::size_t cut = 0; cut <= 9; ++cut) CHECK(of("123456789", cut) == 0xcbf43926); // its check value
    std::string const fox = "The quick brown fox jumps over the lazy dog";
    for (std::size_t cut = 0; cut <= fox.size(); ++cut) CHECK(of(fox, cut) == 0x414fa339);
}

TEST_CASE("a checkpoint with any of its bytes changed, or cut off anywhere, is refused and changes nothing")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    write_checkpoint(path, written);
    std::string const whole = content(path);
    CHECK(whole.size() > 500);
    CHECK(whole.size() < 5000);
    Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>());
    solver.add(std::vector<Eigen::Vector2d>{{1, 1}}, 1e-3);
    std::size_t refusals = 0, attempts = 0;
    int companion = 5;
    auto const attempt = [&](std::string const& bytes) {
        write(path, bytes);
        ++attempts;
        refusals += refused([&] { read_checkpoint(path, solver); }) != "nothing was refused";
        refusals += refused([&] { read_checkpoint(path, solver, companion); }) != "nothing was refused";
    };
    for (std::size_t i = 0; i < whole.size(); ++i)
        for (int const flip : {0x01, 0x80, 0xff}) {
            std::string damaged = whole;
            damaged[i] = static_cast<char>(damaged[i] ^ flip);
            attempt(damaged);
        }
    for (std::size_t length = 0; length < whole.size(); ++length) attempt(whole.substr(0, length));
    attempt(whole + '\0');
    attempt(whole + whole);
    CHECK(refusals == 2 * attempts);
    CHECK(companion == 5);
    CHECK(solver.size() == 1);
    write(path, whole);
    read_checkpoint(path, solver);
    CHECK(same(solver, written));
    REQUIRE(solver.isolated().size() == 1);
    StepFailure const& read = solver.isolated()[0];
    CHECK(read.cause == gone.cause);
    CHECK(read.particle == gone.particle);
    CHECK(read.material == gone.material);
    CHECK(read.position == gone.position);
    CHECK(read.time == gone.time);
    CHECK(read.dt == gone.dt);
    CHECK(read.count == gone.count);
}

TEST_CASE("whatever is in a file whose checksums are right, it is read or refused")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    write_checkpoint(path, written);
    std::string const whole = content(path);
    std::size_t taken = 0, refusals = 0;
    for (std::size_t i = sizeof(detail::CheckpointPreamble); i < whole.size(); ++i)
        for (int const put : {0x00, 0x7f, 0x80, 0xff}) {
            std::string crafted = whole;
            crafted[i] = static_cast<char>(put);
            if (crafted == whole) continue;
            write(path, signed_anew(crafted));
            Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>());
            if (refused([&] { read_checkpoint(path, solver); }) == "nothing was refused") {
                ++taken; // another position or velocity, for example: a state like any other
                CHECK(solver.size() == written.size());
                refused([&] { solver.step(1e-6); });
            }
            else {
                ++refusals;
                CHECK(solver.size() == 0);
            }
        }
    for (std::size_t length = sizeof(detail::CheckpointPreamble); length < whole.size(); ++length) {
        write(path, signed_anew(whole.substr(0, length)));
        Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>());
        CHECK(refused([&] { read_checkpoint(path, solver); }) != "nothing was refused");
    }
    write(path, signed_anew(whole + std::string(8, '\0')));
    Sheet untouched(lattice(0.05), materials::fresh_snow<PlaneFloat>());
    CHECK_THAT(refused([&] { read_checkpoint(path, untouched); }), Contains("holds more than it says"));
    CHECK(taken > 100);
    CHECK(refusals > 100);
}

TEST_CASE("a file that says it holds 2^60 particles is refused before memory is asked for")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    write_checkpoint(path, written);
    std::string bytes = content(path);
    // particles, then u32 fields, then mass groups: of cells and ids some bytes may be like the first by
    // chance
    std::uint64_t const count = written.size(), mass_groups = 2, huge = std::uint64_t(1) << 60;
    auto const is_number = [&](std::size_t at, std::uint64_t number) {
        return at + sizeof(number) <= bytes.size() &&
               std::memcmp(bytes.data() + at, &number, sizeof(number)) == 0;
    };
    std::size_t at = 0, found = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
        if (is_number(i, count) && is_number(i + sizeof(count) + 4, mass_groups)) at = i, ++found;
    REQUIRE(found == 1);
    std::memcpy(bytes.data() + at, &huge, sizeof(huge));
    write(path, signed_anew(bytes));
    Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>());
    CHECK_THAT(refused([&] { read_checkpoint(path, solver); }), Contains("holds more than it does"));
}

TEST_CASE("a file that changes between the look at its checksum and the reading is refused")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    write_checkpoint(path, written);
    std::string const whole = content(path);
    for (bool const changes : {false, true}) {
        write(path, whole);
        std::ifstream in;
        auto reader = detail::open_checkpoint(path, in);
        if (changes) { // of the velocity of one particle the last bit
            std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
            std::size_t const at = whole.size() - 4 - 57 - 4;
            file.seekp(static_cast<std::streamoff>(at)).put(static_cast<char>(whole[at] ^ 1));
        }
        Snapshot<float, 2> snapshot;
        CHECK_THAT(refused([&] { detail::get_checkpoint<>(reader, snapshot); }),
                   Contains(changes ? "has changed while it was read" : "nothing was refused"));
    }
}

TEST_CASE("a pipe or a device is not replaced by a file, nor read as one")
{
    meshes::Folder const folder;
    auto const pipe = folder / "pipe";
    REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
    auto solver = small_scene();
    CHECK_THAT(refused([&] { write_checkpoint(pipe, solver); }), Contains("a device or a pipe"));
    CHECK(std::filesystem::is_fifo(pipe));
    CHECK(!std::filesystem::exists(folder / "pipe.part"));
    CHECK_THAT(refused([&] { read_checkpoint(pipe, solver); }),
               Contains("no file")); // and the call does not block
    CHECK_THAT(refused([&] { write_checkpoint(folder / "", solver); }), Contains("a folder"));
    CHECK_THAT(refused([&] { write_checkpoint("", solver); }), Contains("no name"));
    CHECK_THAT(refused([&] { read_checkpoint("", solver); }), Contains("no name"));
    CHECK_THAT(refused([&] { write_checkpoint(folder / std::string(300, 'a'), solver); }),
               Contains("cannot be created"));
}

TEST_CASE("a checkpoint of another version is refused as one, and what is no checkpoint as none")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto solver = small_scene();
    write_checkpoint(path, solver);
    std::string bytes = content(path);
    auto const refusal = [&](char schema) {
        bytes[8] = schema;
        write(path, signed_anew(bytes));
        return refused([&] { read_checkpoint(path, solver); });
    };
    CHECK_THAT(refusal(7), Contains("schema 7") && Contains("newer version"));
    CHECK_THAT(refusal(4), Contains("schema 4") && Contains("older version"));
    write(path, "ply\nformat ascii 1.0, and so on for more than thirty-two bytes\n");
    CHECK_THAT(refused([&] { read_checkpoint(path, solver); }), Contains("no checkpoint"));
    write(path, "");
    CHECK_THAT(refused([&] { read_checkpoint(path, solver); }), Contains("0 bytes"));
    CHECK_THAT(refused([&] { read_checkpoint(folder / "b.firn", solver); }), Contains("no file"));
    CHECK_THAT(refused([&] { read_checkpoint(folder / "", solver); }), Contains("no file"));
}

TEST_CASE("a checkpoint that does not fit is refused by the name of what differs")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    int const frame = 1;
    write_checkpoint(path, written, frame);
    auto const snow = materials::fresh_snow<PlaneFloat>();
    int same_frame = 0;
    auto const refusal_of = [&](auto solver) {
        auto const text = refused([&] { read_checkpoint(path, solver, same_frame); });
        CHECK_THAT(text, Contains(path.string()));
        CHECK(solver.size() == 0);
        return text;
    };
    using Quadratic = QuadraticBSpline;
    CHECK_THAT(refusal_of(Scene<HardeningVonMises<Plane>, Quadratic, Apic>::Solver(lattice(0.05))),
               Contains("4 bytes"));
    // the same types as in physics/checkpoint.cpp: each solver takes time to compile
    CHECK_THAT(refusal_of(Scene<Heterogeneous<Snow<SolidFloat>>, CubicBSpline, Flip>::Solver(lattice(0.05))),
               Contains("2 dimensions"));
    CHECK_THAT(refusal_of(Scene<Snow<PlaneFloat>, CubicBSpline, Mls>::Solver(lattice(0.05), snow)),
               Contains("quadratic") && Contains("cubic"));
    CHECK_THAT(refusal_of(Scene<Materials<Sand<PlaneFloat>, Fluid<PlaneFloat>>, Quadratic, Asflip>::Solver(
                   lattice(0.05))),
               Contains("mls") && Contains("asflip"));
    CHECK_THAT(refusal_of(Scene<Sand<PlaneFloat>, Quadratic, Mls>::Solver(lattice(0.05))),
               Contains("snow") && Contains("sand"));
    using Uneven = Heterogeneous<Snow<PlaneFloat>>;
    CHECK_THAT(refusal_of(Scene<Uneven, Quadratic, Mls>::Solver(lattice(0.05), Uneven{snow})),
               Contains("stiffness"));
    using Both = Materials<Snow<PlaneFloat>, Snow<PlaneFloat>>;
    CHECK_THAT(refusal_of(Scene<Both, Quadratic, Mls>::Solver(lattice(0.05), Both{snow, snow})),
               Contains("materials"));
    CHECK_THAT(refusal_of(Sheet(lattice(0.06), snow)), Contains("cell size"));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05 + 1e-12), snow)),
               Contains("of 0.05, this solver has 0.050000000001 ["));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05, {0, 1, 0}), snow)), Contains("origin"));
    auto denser = snow, stiffer = snow, harder = snow, squeezed = snow;
    denser.density *= 2;
    stiffer.elasticity.mu *= 2;
    harder.hardening = 5;
    // another Poisson's ratio with the same wave modulus
    squeezed.elasticity.mu *= 0.5f;
    squeezed.elasticity.lambda += 2 * squeezed.elasticity.mu;
    REQUIRE(squeezed.elasticity.p_wave_modulus() == Approx(snow.elasticity.p_wave_modulus()));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05), denser)), Contains("density"));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05), stiffer)), Contains("elasticity.mu"));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05), squeezed)), Contains("elasticity.mu"));
    CHECK_THAT(refusal_of(Sheet(lattice(0.05), harder)),
               Contains("for material 0 (snow) hardening = 10, this solver has 5") &&
                   Contains("forget_parameters") && Contains("read_snapshot"));
    CHECK(same_frame == 0);

    Sheet solver(lattice(0.05), snow);
    RigidBody ball;
    std::uint32_t other = 0;
    CHECK_THAT(refused([&] { read_checkpoint(path, solver); }), Contains("1 companions, 0 are asked for"));
    CHECK_THAT(refused([&] { read_checkpoint(path, solver, ball); }),
               Contains("'i32'") && Contains("rigid_body"));
    CHECK_THAT(refused([&] { read_checkpoint(path, solver, other); }), Contains("'u32'"));
    CHECK_THAT(refused([&] { read_checkpoint(path, solver, same_frame, other); }), Contains("companions"));
    CHECK(solver.size() == 0);

    std::uint8_t two = 2;
    bool truth = false;
    auto const of_two = folder / "two.firn";
    write_checkpoint(of_two, solver, two);
    CHECK_THAT(refused([&] { read_checkpoint(of_two, solver, truth); }), Contains("a bool is asked for"));
    CHECK(!truth);
    write_checkpoint(of_two, solver, true);
    read_checkpoint(of_two, solver, truth);
    CHECK(truth);
}

TEST_CASE("other parameters of a transfer or of any of several materials are refused by their names")
{
    using Sands = Materials<Sand<PlaneFloat>, Sand<PlaneFloat>>;
    using Solver = Scene<Sands, QuadraticBSpline, Flip>::Solver;
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    Sand<PlaneFloat> const sand;
    auto smooth = sand, wet = sand, other_compiler = sand;
    smooth.cone = 0.2f;
    wet.cohesion = 1e-30f;
    other_compiler.cone = std::nextafter(sand.cone, 1.0f);
    Solver written(lattice(0.05), {sand, smooth}, {0.95});
    written.add<Material<0>>(std::vector<Eigen::Vector2d>{{1, 1}}, 1e-3);
    int const frame = 3;
    write_checkpoint(path, written, frame);
    auto const refusal_of = [&](Sands const& sands, Flip const& flip) {
        Solver solver(lattice(0.05), sands, flip);
        int read = 0;
        auto const text = refused([&] { read_checkpoint(path, solver, read); });
        bool const taken = text == "nothing was refused";
        CHECK(read == (taken ? frame : 0));
        CHECK(solver.size() == (taken ? 1 : 0));
        return text;
    };
    CHECK_THAT(refusal_of({sand, smooth}, {0.5}),
               Contains("for the transfer (flip) fraction = 0.95, this solver has 0.5"));
    CHECK_THAT(refusal_of({sand, smooth}, {0.950002}), Contains("fraction = 0.95, this solver has 0.950002"));
    CHECK(refusal_of({sand, smooth}, {0.9500001}) == "nothing was refused"); // a rounding of the scene's
    CHECK_THAT(refusal_of({sand, sand}, {0.95}), Contains("for material 1 (sand) cone = 0.2, this solver"));
    CHECK_THAT(refusal_of({wet, smooth}, {0.95}),
               Contains("for material 0 (sand) cohesion = 0, this solver has 1e-30"));
    CHECK(refusal_of({other_compiler, smooth}, {0.95}) == "nothing was refused");
    CHECK(refusal_of({sand, smooth}, {0.95}) == "nothing was refused");

    // of a snapshot those that it names, each by itself
    Solver solver(lattice(0.05), {sand, sand}, {0.5});
    auto snapshot = written.snapshot();
    std::erase_if(snapshot.materials[1].parameters, [](auto const& one) { return one.name == "cone"; });
    CHECK_THAT(refused([&] { solver.restore(snapshot); }), Contains("fraction"));
    snapshot.transfer_parameters[0].value = 0.5;
    solver.restore(snapshot);
    CHECK(solver.size() == 1);
    for (double const odd : {std::nan(""), std::numeric_limits<double>::infinity(), 1e300}) {
        snapshot.transfer_parameters[0].value = odd;
        CHECK_THAT(refused([&] { solver.restore(snapshot); }), Contains("this solver has 0.5"));
    }
    snapshot.transfer_parameters = {{"viscosity", 1}};
    CHECK_THAT(refused([&] { solver.restore(snapshot); }),
               Contains("(flip) a parameter viscosity, this solver has none of this name"));
}

TEST_CASE("a snapshot whose parameters are forgotten goes on with others, by steps that suit these")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto written = small_scene();
    RigidBody const ball = RigidBody::ball(0.1, 3);
    write_checkpoint(path, written, ball, 7);
    auto snow = materials::fresh_snow<PlaneFloat>();
    snow.elasticity = {4 * snow.elasticity.mu, 4 * snow.elasticity.lambda};
    snow.critical_stretch = 1e-3f;
    Sheet solver(lattice(0.05), snow);

    RigidBody same_ball;
    int frame = 0;
    CHECK_THAT(refused([&] { read_snapshot<float, 3>(path, same_ball, frame); }), Contains("2 dimensions"));
    CHECK_THAT(refused([&] { read_snapshot<double, 2>(path, same_ball, frame); }), Contains("4 bytes"));
    CHECK_THAT(refused([&] { read_snapshot<float, 2>(path, frame); }), Contains("2 companions"));
    CHECK(frame == 0);
    auto snapshot = read_snapshot<float, 2>(path, same_ball, frame);
    CHECK(frame == 7);
    CHECK(same_ball.mass == ball.mass);
    CHECK(snapshot.materials.at(0).parameters.size() == 7);
    CHECK_THAT(refused([&] { solver.restore(snapshot); }), Contains("elasticity.mu"));
    CHECK(solver.size() == 0);

    snapshot.forget_parameters();
    solver.restore(snapshot);
    CHECK(same(solver, written));
    CHECK(solver.bounds().wave_speed == Approx(2 * written.bounds().wave_speed)); // by the root of the moduli
    CHECK(solver.bounds().deformation_rate == Approx(written.bounds().deformation_rate));
    solver.advance(1e-3, Gravity{});
    // and with the same ones as if they had not been forgotten
    auto twin = small_scene();
    twin.restore(snapshot);
    twin.step(1e-4, Gravity{});
    written.step(1e-4, Gravity{});
    CHECK(same(twin, written));

    for (auto& material : snapshot.materials) material.density *= 2;
    CHECK_THAT(refused([&] { solver.restore(snapshot); }), Contains("density"));
}

namespace
{
/// One that says nothing of its parameters.
struct Silent : Snow<PlaneFloat>
{
    void for_each_parameter() const;
};
} // namespace

TEST_CASE("a material that does not say its parameters is known by its density and its wave modulus at rest")
{
    using Solver = Scene<Silent, QuadraticBSpline, Mls>::Solver;
    auto const solver_of = [](float stiffer, float hardening) {
        Silent snow;
        snow.elasticity = {stiffer * snow.elasticity.mu, stiffer * snow.elasticity.lambda};
        snow.hardening = hardening;
        return Solver(lattice(0.05), snow);
    };
    auto written = solver_of(1, 10), harder = solver_of(1, 20), stiffer = solver_of(2, 10);
    written.add(std::vector<Eigen::Vector2d>{{1, 1}}, 1e-3, {1, 2});
    auto snapshot = written.snapshot();
    CHECK(snapshot.materials[0].parameters.empty());
    harder.restore(snapshot);
    CHECK(same(harder, written));
    CHECK_THAT(refused([&] { stiffer.restore(snapshot); }),
               Contains("the wave modulus at rest [Pa]") && Contains("forget_parameters"));
    snapshot.forget_parameters();
    stiffer.restore(snapshot);
    CHECK(stiffer.bounds().wave_speed == Approx(std::sqrt(2) * written.bounds().wave_speed));
}

TEST_CASE("a heterogeneous solver's field that a plain one lacks is named, and a value that it cannot have")
{
    using Uneven = Scene<Heterogeneous<Snow<PlaneFloat>>, QuadraticBSpline, Mls>::Solver;
    meshes::Folder const folder;
    Uneven uneven(lattice(0.05));
    uneven.add(std::vector<Eigen::Vector2d>{{1, 1}}, 1e-3);
    write_checkpoint(folder / "a.firn", uneven);
    auto snapshot = uneven.snapshot();
    for (auto& field : snapshot.materials[0].fields)
        if (field.name == "stiffness") field.components[0][0] = -1;
    CHECK_THAT(refused([&] { uneven.restore(snapshot); }), Contains("'stiffness' is not above 0"));
    snapshot.materials[0].fields.clear();
    CHECK_THAT(refused([&] { uneven.restore(snapshot); }), Contains("is missing"));
    Sheet plain(lattice(0.05));
    CHECK_THAT(refused([&] { read_checkpoint(folder / "a.firn", plain); }), Contains("no field 'stiffness'"));
}

TEST_CASE("a checkpoint is read by a solver of other lanes, which goes on to the same place but for rounding")
{
    using OneByOne = BasicOpenMP<openmp::ScalarLanes>;
    meshes::Folder const folder;
    auto solver = small_scene();
    write_checkpoint(folder / "a.firn", solver);
    Scene<Snow<PlaneFloat>, QuadraticBSpline, Mls, OneByOne>::Solver other(
        lattice(0.05), materials::fresh_snow<PlaneFloat>());
    read_checkpoint(folder / "a.firn", other);
    CHECK(other.positions() == solver.positions());
    CHECK(other.download<Velocity>() == solver.download<Velocity>());
    for (int i = 0; i < 20; ++i) {
        solver.step(1e-4, Gravity{});
        other.step(1e-4, Gravity{});
    }
    CHECK(other.ids() == solver.ids());
    auto const x = solver.positions(), y = other.positions();
    for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i] - y[i]).norm() < 1e-8); // of 2e-3 m
}

TEST_CASE("a snapshot that was changed by hand to what cannot be is refused")
{
    auto solver = small_scene();
    auto const good = solver.snapshot();
    auto const before = small_scene();
    auto const refuses = [&](auto const& spoil) {
        auto bad = good;
        spoil(bad, bad.materials[0]);
        CHECK(refused([&] { solver.restore(bad); }) != "nothing was refused");
        CHECK(same(solver, before));
    };
    refuses([](auto&, auto& snow) { snow.ids[1] = snow.ids[0]; });
    refuses([](auto& all, auto&) { all.next_id = 3; });
    refuses([](auto&, auto& snow) { snow.cells.pop_back(); });
    refuses([](auto&, auto& snow) { snow.cells[0][1] = 2'000'000'000; });
    refuses([](auto&, auto& snow) { snow.offsets[0][0] = 1 << 29; });
    refuses([](auto&, auto& snow) { snow.offsets[1].push_back(0); });
    refuses([](auto&, auto& snow) { snow.fields[0].components[0][0] = std::nanf(""); });
    refuses([](auto&, auto& snow) { snow.fields[0].components.pop_back(); });
    refuses([](auto&, auto& snow) { snow.fields[0].components[0].pop_back(); });
    refuses([](auto&, auto& snow) { snow.fields.push_back(snow.fields[0]); });
    refuses([](auto&, auto& snow) { snow.mass_groups.clear(); });
    refuses([](auto&, auto& snow) { snow.mass_groups[0].first_row = 1; });
    refuses([](auto&, auto& snow) { snow.mass_groups[1].first_row = 100; });
    refuses([](auto&, auto& snow) { snow.mass_groups[0].mass = 0; });
    refuses([](auto&, auto& snow) { snow.mass_groups[0].volume = -1; });
    refuses([](auto& all, auto&) { all.masses.unit = 0; });
    refuses(
        [](auto& all, auto&) { all.masses.largest = 1e25; }); // nodes would treat all other masses as zero
    refuses([](auto& all, auto&) { all.bounds.material = 1; });
    refuses([](auto& all, auto&) { all.bounds.speed = std::nan(""); });
    refuses([](auto& all, auto&) { all.time = std::nan(""); });
    refuses([](auto& all, auto&) { all.isolated[0].particle = 1; }); // this particle exists
    refuses([](auto& all, auto&) { all.isolated[0].particle = all.next_id; });
    refuses([](auto& all, auto&) { all.isolated.push_back(all.isolated[0]); });
    refuses([](auto& all, auto&) { all.isolated[0].material = 1; });
    refuses([](auto& all, auto&) { all.isolated[0].cause = static_cast<FailureCause>(200); });
    refuses([](auto& all, auto&) { all.isolated[0].position.y() = std::nan(""); });
    refuses([](auto& all, auto&) { all.isolated[0].dt = -1; });
    solver.restore(good);
    CHECK(same(solver, before));
}

TEST_CASE("a checkpoint that cannot be written leaves the one of before, and the solver goes on")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto solver = small_scene(), other = small_scene();
    write_checkpoint(path, solver);
    auto const whole = content(path);
    solver.step(1e-4);
    CHECK_THAT(refused([&] { write_checkpoint(folder / "nowhere" / "a.firn", solver); }),
               Contains("cannot be created"));
    // an existing file where the unfinished one would be is another program's: it is left alone, and not
    // waited for
    std::filesystem::path const part = folder / "a.firn.part", aim = folder / "aim";
    auto const leaves_it = [&] {
        CHECK_THAT(refused([&] { write_checkpoint(path, solver); }), Contains("is no file, but a folder"));
        CHECK(content(path) == whole);
        CHECK(std::filesystem::remove(part));
    };
    std::filesystem::create_directory(part);
    leaves_it();
    REQUIRE(::mkfifo(part.c_str(), 0600) == 0);
    leaves_it();
    std::filesystem::copy_file(path, aim);
    std::filesystem::create_symlink(aim, part);
    leaves_it();
    CHECK(content(aim) == whole);
    // a link is written through, and a name with an end in its midst is none
    auto const link = folder / "latest";
    std::filesystem::create_symlink("aim", link);
    write_checkpoint(link, solver);
    CHECK(std::filesystem::is_symlink(link));
    CHECK(content(aim) != whole);
    std::filesystem::create_symlink("round", folder / "round");
    CHECK_THAT(refused([&] { write_checkpoint(folder / "round", solver); }), Contains("leads to itself"));
    CHECK_THAT(refused([&] { write_checkpoint(folder / std::string("a\0b", 3), solver); }),
               Contains("an end in its midst"));
    struct rlimit before, small;
    ::getrlimit(RLIMIT_FSIZE, &before);
    small = {256, before.rlim_max};
    auto const handler = std::signal(SIGXFSZ, SIG_IGN);
    ::setrlimit(RLIMIT_FSIZE, &small);
    auto const refusal = refused([&] { write_checkpoint(path, solver); });
    ::setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, handler);
    CHECK_THAT(refusal, Contains("Is the disk full?"));
    CHECK(content(path) == whole);
    CHECK(!std::filesystem::exists(folder / "a.firn.part"));
    // the next steps are those after a checkpoint that was written
    write_checkpoint(path, other);
    other.step(1e-4);
    write_checkpoint(path, other);
    solver.step(1e-4);
    other.step(1e-4);
    CHECK(same(solver, other));
}

namespace
{

/// As many particles as make a checkpoint of a megabyte.
Sheet large_scene()
{
    Sheet solver(lattice(0.05), materials::fresh_snow<PlaneFloat>());
    solver.add(box_of_points<2>({0, 0}, {4, 2}, 0.05), 6e-4, {1, -1});
    return solver;
}

// where the writer writes, and the file descriptor to which it tells what is written
char const *const folder_of_writer = "FIRN_TEST_CHECKPOINT_FOLDER", *const writer_tells =
                                                                        "FIRN_TEST_CHECKPOINT_DESCRIPTOR";

} // namespace

// Not to be run by itself: the next test starts it in a program of its own, and kills that.
TEST_CASE("writes checkpoints until it is killed", "[.writer]")
{
    char const *const folder = std::getenv(folder_of_writer), *const tells = std::getenv(writer_tells);
    if (folder == nullptr || tells == nullptr) return;
    auto const path = std::filesystem::path(folder) / "a.firn";
    auto solver = large_scene();
    std::uint64_t count = 0;
    if (std::filesystem::exists(path)) read_checkpoint(path, solver, count);
    for (;;) {
        solver.step(1e-6);
        ++count;
        write_checkpoint(path, solver, count);
        if (::write(std::atoi(tells), &count, sizeof(count)) != sizeof(count)) return;
    }
}

TEST_CASE("a program that is killed as it writes loses the newest checkpoint at most")
{
    meshes::Folder const folder;
    auto const path = folder / "a.firn";
    auto const self = std::filesystem::read_symlink("/proc/self/exe");
    std::mt19937 random(1);
    std::uint64_t last = 0; // that was known to be written
    int in_the_middle = 0, went_on = 0;
    for (int kill = 0; kill < 50; ++kill) {
        int told[2];
        REQUIRE(::pipe(told) == 0);
        ::pid_t const writer = ::fork();
        REQUIRE(writer >= 0);
        if (writer == 0) {
            ::close(told[0]);
            ::setenv(folder_of_writer, (folder / "").c_str(), 1);
            ::setenv(writer_tells, std::to_string(told[1]).c_str(), 1);
            ::execl(self.c_str(), self.c_str(), "writes checkpoints until it is killed", "-o", "/dev/null",
                    nullptr);
            ::_exit(1);
        }
        ::close(told[1]);
        std::uint64_t const before = last;
        // from the first one that it has written on, so that there is something to kill
        auto const hear = [&] {
            std::uint64_t count = 0;
            if (::read(told[0], &count, sizeof(count)) != sizeof(count)) return false;
            last = count;
            return true;
        };
        REQUIRE(hear());
        using Clock = std::chrono::steady_clock;
        auto const first = Clock::now();
        REQUIRE(hear());
        // at any time between two of them, however long one takes here
        std::this_thread::sleep_for((Clock::now() - first) *
                                    std::uniform_real_distribution<double>(0, 1)(random));
        ::kill(writer, SIGKILL);
        int status = 0;
        REQUIRE(::waitpid(writer, &status, 0) == writer);
        CHECK(WIFSIGNALED(status));
        while (hear()) {
        }
        ::close(told[0]);
        in_the_middle += std::filesystem::exists(folder / "a.firn.part");
        Sheet solver = large_scene();
        std::uint64_t count = 0;
        REQUIRE_NOTHROW(read_checkpoint(path, solver, count));
        CHECK(count >= last);     // what it was told to have written is there
        CHECK(count <= last + 1); // or one that was finished before it could tell
        CHECK(solver.time() == Approx(1e-6 * double(count)));
        went_on += count > before;
        last = count;
    }
    CHECK(went_on == 50);
    CHECK(in_the_middle > 0); // a part of its time it writes
}

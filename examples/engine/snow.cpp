// SPDX-License-Identifier: MIT
// The one file of the engine that includes Firn.
#include "snow.hpp"

#include <firn/budget.hpp>
#include <firn/effects/gravity.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/host_copies.hpp>
#include <firn/id_lookup.hpp>
#include <firn/io/checkpoint.hpp>
#include <firn/models/materials.hpp>
#include <firn/openmp.hpp>
#include <firn/solver.hpp>
#include <firn/transfer/with_fields.hpp>

#include <fstream>
#include <stdexcept>
#include <type_traits>

namespace engine
{

namespace
{

/// The engine's object that a particle belongs to.
struct Owner
{
    static constexpr auto name = "owner";
    static constexpr auto shape = firn::FieldShape::integer;
};

struct BelongsTo
{
    std::uint32_t owner;

    template <class Position, class Particle>
    bool operator()(Position const&, Particle const& particle) const
    {
        return firn::integer_of(particle[Owner{}]) == owner;
    }
};

using Space = firn::Space<3, float>;
using Solver =
    firn::Solver<firn::OpenMP, firn::Snow<Space>, firn::QuadraticBSpline, firn::WithFields<firn::Mls, Owner>>;

} // namespace

struct Snow::Parts
{
    Solver solver;
    Limits limits;
    std::sig_atomic_t const volatile* stop;
    double owed = 0; ///< [s]
    firn::IdLookup<> lookup{};
    std::vector<Vec3> positions{};
    std::vector<std::uint32_t> owners{};

    void copy_for_engine()
    {
        positions.resize(solver.size());
        owners.resize(solver.size());
        firn::download_positions(solver, positions);
        firn::download<Owner>(solver, owners);
    }
};

Snow::Snow(float cell_size, Limits limits, std::sig_atomic_t const volatile* stop)
    : parts_(new Parts{Solver(firn::lattice(cell_size), firn::materials::fresh_snow<Space>()), limits, stop})
{}
Snow::~Snow() = default;
Snow::Snow(Snow&&) noexcept = default;
Snow& Snow::operator=(Snow&&) noexcept = default;

std::uint32_t Snow::add_box(Vec3 low, Vec3 high, Vec3 velocity, std::uint32_t owner)
{
    auto& solver = parts_->solver;
    auto const spacing = float(solver.lattice().cell_size / 2); // eight particles in a cell
    std::vector<Vec3> points;
    for (float x = low.x + spacing / 2; x < high.x; x += spacing)
        for (float y = low.y + spacing / 2; y < high.y; y += spacing)
            for (float z = low.z + spacing / 2; z < high.z; z += spacing) points.push_back({x, y, z});
    double const volume = double(spacing) * double(spacing) * double(spacing);
    auto const first = solver.add(points, volume, {velocity.x, velocity.y, velocity.z});
    firn::upload_from<Owner>(solver, first, std::vector(points.size(), owner));
    parts_->copy_for_engine();
    return first;
}

std::size_t Snow::remove(std::uint32_t owner)
{
    auto const count = parts_->solver.remove_if(BelongsTo{owner});
    parts_->copy_for_engine();
    return count;
}

Frame Snow::advance(float seconds)
{
    auto& [solver, limits, stop, owed, lookup, positions, owners] = *parts_;
    firn::Obstacles<> obstacles;
    obstacles.list.push_back({.shape = firn::HalfSpace{}, .contact = firn::Contact::coulomb(0.5)});
    for (auto const& [centre, radius, velocity, push_back] : balls)
        obstacles.list.push_back({.shape = firn::Sphere{radius},
                                  .contact = firn::Contact::coulomb(0.3),
                                  .motion = {.position = {centre.x, centre.y, centre.z},
                                             .velocity = {velocity.x, velocity.y, velocity.z}}});
    firn::Budget budget{
        .seconds = limits.seconds, .steps = static_cast<std::uint64_t>(limits.steps), .cut_last_step = false};
    if (stop != nullptr) budget.cancelled = [stop = stop] { return *stop != 0; };
    double const before = solver.time(), longest_debt = 4 * double(seconds);
    auto const report = solver.advance(double(seconds) + owed, budget, firn::Gravity{}, obstacles);
    owed = std::min(report.left, longest_debt); // what a slow machine cannot catch up with is let go
    auto const passed = float(solver.time() - before);
    for (std::size_t i = 0; i < balls.size(); ++i) {
        auto& ball = balls[i];
        auto const& impulse = report.reactions[i + 1].impulse; // the floor's is the first
        ball.push_back = {float(impulse.x()), float(impulse.y()), float(impulse.z())};
        ball.centre.x += ball.velocity.x * passed;
        ball.centre.y += ball.velocity.y * passed;
        ball.centre.z += ball.velocity.z * passed;
    }
    parts_->copy_for_engine();
    return {int(report.substeps), float(owed)};
}

double Snow::time() const { return parts_->solver.time(); }
std::span<Vec3 const> Snow::positions() const { return parts_->positions; }
std::span<std::uint32_t const> Snow::owners() const { return parts_->owners; }
std::size_t Snow::index_of(std::uint32_t id) { return parts_->lookup.index_of(parts_->solver, id); }

void Snow::save(std::filesystem::path const& path)
{
    static_assert(std::is_trivially_copyable_v<Ball>);
    auto part = path;
    part += ".part"; // renamed when it is whole
    std::ofstream out(part, std::ios::binary);
    auto const count = std::uint32_t(balls.size());
    out.write(reinterpret_cast<char const*>(&count), sizeof count);
    out.write(reinterpret_cast<char const*>(balls.data()), std::streamsize(count * sizeof(Ball)));
    firn::write_checkpoint(out, parts_->solver, parts_->owed);
    out.close();
    if (!out) throw std::runtime_error(part.string() + " could not be written. Is the disk full?");
    std::filesystem::rename(part, path);
}

void Snow::load(std::filesystem::path const& path)
{
    std::ifstream in(path, std::ios::binary);
    std::uint32_t count = 0;
    in.read(reinterpret_cast<char*>(&count), sizeof count);
    if (!in || count > 100000) throw std::runtime_error(path.string() + " is no saved snow.");
    std::vector<Ball> loaded(count);
    in.read(reinterpret_cast<char*>(loaded.data()), std::streamsize(count * sizeof(Ball)));
    firn::read_checkpoint(in, parts_->solver, parts_->owed); // throws, and has changed nothing, if it is none
    balls = std::move(loaded);
    parts_->copy_for_engine();
}

} // namespace engine

// SPDX-License-Identifier: MIT
#pragma once

#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

// The snow of an engine, as the rest of the engine sees it: its own types, and neither Firn nor Eigen.
namespace engine
{

/// The engine's own vector.
struct Vec3
{
    float x, y, z;
};

/// A ball that the engine moves, and that pushes snow.
struct Ball
{
    Vec3 centre;      ///< [m]
    float radius;     ///< [m]
    Vec3 velocity{};  ///< [m/s]
    Vec3 push_back{}; ///< by the snow, over the last frame [N s]
};

/// What a frame did.
struct Frame
{
    int steps = 0;
    float behind = 0; ///< the engine's clock, and to be caught up with in the next frame [s]
};

/// What the snow may cost.
struct Limits
{
    double seconds = 0.008; ///< of a frame, by a clock
    int steps = 100;        ///< of a frame
};

/// Snow on a floor at y = 0, and any number of balls in it. What goes wrong is a std::exception that says
/// what, where, and what to do.
class Snow
{
public:
    /// `stop`, if not null, ends a frame early once it is not 0.
    explicit Snow(float cell_size, Limits limits = {}, std::sig_atomic_t const volatile* stop = nullptr);
    ~Snow();
    Snow(Snow&&) noexcept;
    Snow& operator=(Snow&&) noexcept;

    /// Adds a box of snow that belongs to an object of the engine. Returns the id of its first particle.
    std::uint32_t add_box(Vec3 low, Vec3 high, Vec3 velocity, std::uint32_t owner);
    /// Removes the snow of an object. Returns how many particles that were.
    std::size_t remove(std::uint32_t owner);

    std::vector<Ball> balls; ///< add, move and remove them between frames

    /// Goes on by a frame of so many seconds. Balls move along.
    Frame advance(float seconds);
    double time() const; ///< simulated [s]

    /// The particles, for the renderer: valid until the next call that changes the snow.
    std::span<Vec3 const> positions() const;
    /// To which object each of them belongs.
    std::span<std::uint32_t const> owners() const;
    /// The place in both of a particle, by the id that it has for good.
    std::size_t index_of(std::uint32_t id);

    /// Saves snow and balls, and loads them. A save that fails leaves the file of before, and a load that
    /// fails leaves the snow as it is.
    void save(std::filesystem::path const& path);
    void load(std::filesystem::path const& path);

private:
    struct Parts; // of Firn's types
    std::unique_ptr<Parts> parts_;
};

} // namespace engine

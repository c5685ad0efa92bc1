// SPDX-License-Identifier: MIT
// What it gives that a fluid keeps its volume, and what it costs: see KeepsVolume.
//     liquids [seconds] [rounds]
// Prints, in the plane, the level and the speed of still water in a tank that is tilted against the cells,
// over so many seconds (10); then of water that is shaken by half of gravity for five seconds and left alone
// for as long. The level is the mean height over the right one less what the water's kinetic energy could
// raise it by. Then, in space, medians of milliseconds per step by turns (9 rounds).
#include "on_each_backend.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/models/fluids/keeps_volume.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

using Plane = Space<2, double>;
using Walls = Obstacles<AnyShape<>, ActsOn::surface_and_particles>;
double const g = 9.81;

Eigen::Vector3d in_space(Eigen::Vector2d const& v) { return {v.x(), v.y(), 0}; }

void add_wall(Walls& walls, Eigen::Vector3d const& normal, Eigen::Vector3d const& at)
{
    walls.list.push_back({.shape = HalfSpace{normal}, .motion = {.position = at}, .on_particles = true});
}

/// Water in a tank that lies across the cells, at rest at the start.
template <class Model, class Kernel, class Transfer>
class Tank
{
public:
    static constexpr double h = 0.02, width = 0.6;

    Tank(double degrees, double depth, double fastest)
        : turn_(degrees * M_PI / 180), depth_(depth), model_(materials::water<Plane>(fastest)),
          water_(lattice(h), model_, {}, {}, bench::backend())
    {
        std::vector<Eigen::Vector2d> points;
        std::vector<double> log_J;
        for (double x = -width / 2 + h / 4; x < width / 2; x += h / 2)
            for (double y = h / 4; y < depth; y += h / 2) {
                points.push_back(turn_ * Eigen::Vector2d(x, y) + origin_);
                double const pressure = model_.density * g * (depth - y);
                log_J.push_back(-std::log1p(model_.exponent * pressure / model_.bulk_modulus) /
                                model_.exponent);
            }
        water_.add(points, h * h / 4);
        water_.template upload<LogVolumeRatio>(log_J);
        auto const wall = [&](Eigen::Vector2d const& normal, Eigen::Vector2d const& at) {
            add_wall(walls_, in_space(turn_ * normal), in_space(turn_ * at + origin_));
        };
        wall({0, 1}, {0, 0});
        wall({1, 0}, {-width / 2, 0});
        wall({-1, 0}, {width / 2, 0});
        rest_ = mean_height();
    }

    /// Advances by a time [s], pushed sidewards by a share of gravity.
    void advance(double duration, double sidewards = 0)
    {
        water_.advance(duration, Gravity{in_space(turn_ * Eigen::Vector2d(sidewards * g, -g))}, walls_);
    }
    /// The frequency of the first standing wave [Hz].
    double frequency() const
    {
        double const k = M_PI / width;
        return std::sqrt(g * k * std::tanh(k * depth_)) / (2 * M_PI);
    }
    /// How far the level is from its place [% of the depth], without the waves.
    double level() const
    {
        double const waves = speed() * speed() / (2 * g);
        return 100 * (mean_height() - rest_ - waves) / (depth_ / 2);
    }
    /// The root mean square [m/s].
    double speed() const
    {
        double sum = 0;
        for (auto const& v : water_.template download<Velocity>()) sum += v.squaredNorm();
        return std::sqrt(sum / double(water_.size()));
    }

private:
    double mean_height() const
    {
        double sum = 0;
        for (auto const& x : water_.positions()) sum += (turn_.inverse() * (x - origin_)).y();
        return sum / double(water_.size());
    }

    Eigen::Rotation2Dd turn_;
    Eigen::Vector2d origin_ = Eigen::Vector2d(0.3, 0.21) * h;
    double depth_, rest_ = 0;
    Model model_;
    Solver<bench::Backend, Model, Kernel, Transfer> water_;
    Walls walls_;
};

template <class Model, class Kernel, class Transfer>
void still(char const* name, double seconds)
{
    for (double const degrees : {17.0, 30.0}) {
        Tank<Model, Kernel, Transfer> tank(degrees, 0.4, 3);
        std::printf("still  %-24s %2.0f degrees", name, degrees);
        for (int i = 1; i <= 4; ++i) {
            tank.advance(seconds / 4);
            std::printf("%s %4.1f s: level %+.2f %%, %.4f m/s", i > 1 ? "," : ":", i * seconds / 4,
                        tank.level(), tank.speed());
        }
        std::printf("\n");
    }
}

template <class Model, class Kernel, class Transfer>
void sloshed(char const* name, double seconds)
{
    Tank<Model, Kernel, Transfer> tank(0, 0.25, 4);
    double const of_call = 0.02, shaken = 5;
    double time = 0;
    for (; time < shaken; time += of_call)
        tank.advance(of_call, 0.5 * std::sin(2 * M_PI * tank.frequency() * time));
    std::printf("shaken %-24s", name);
    int const means = 4;
    for (int i = 0; i < means; ++i) { // of all phases of the waves
        double level = 0, speed = 0;
        int const count = 50;
        for (int k = 0; k < count; ++k) {
            tank.advance(seconds / (means * count));
            level += tank.level() / count;
            speed += tank.speed() / count;
        }
        std::printf("%s %4.1f to %4.1f s after: level %+.2f %%, %.3f m/s", i > 0 ? "," : ":",
                    i * seconds / means, (i + 1) * seconds / means, level, speed);
    }
    std::printf("\n");
}

template <class Model>
auto block(int side)
{
    double const h = 0.05;
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < side; ++i)
        for (int j = 0; j < side; ++j)
            for (int k = 0; k < side; ++k)
                points.push_back(h / 2 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5));
    Solver<bench::Backend, Model> solver(lattice(h), materials::water<Space<3, float>>(), {}, {},
                                         bench::backend());
    solver.add(points, std::pow(h / 2, 3));
    return solver;
}

void cost(int rounds)
{
    using Water = Fluid<Space<3, float>>;
    int const side = bench::on_a_device ? 128 : 64;
    auto plain = block<Water>(side);
    auto kept = block<KeepsVolume<Water>>(side);
    Obstacles<AnyShape<>, ActsOn::surface> floor;
    floor.list.push_back({.shape = HalfSpace{}});
    double const dt =
        0.8 * plain.stable_step(Gravity{}, floor); // it stays stable while the water falls apart
    constexpr std::size_t steps = 80;              // some four corrections
    auto const seconds_of = [&](auto& solver) {
        auto const start = std::chrono::steady_clock::now();
        solver.steps(steps, dt, Gravity{}, floor);
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() /
               double(steps);
    };
    std::vector<double> seconds[2];
    for (int i = 0; i < rounds + 1; ++i) {
        double const of[]{seconds_of(plain), seconds_of(kept)};
        for (int k = 0; k < 2 && i > 0; ++k) seconds[k].push_back(of[k]); // the first warms up
    }
    double const without = bench::median(seconds[0]), with = bench::median(seconds[1]);
    std::printf("cost   %.0f particles on a floor: %.3f ms a step, %.3f ms keeping the volume: %.3f\n",
                double(plain.size()), 1e3 * without, 1e3 * with, with / without);
}

} // namespace

int main(int argc, char** argv)
{
    double const seconds = argc > 1 ? std::atof(argv[1]) : 10;
    int const rounds = argc > 2 ? std::atoi(argv[2]) : 9;
    using Water = Fluid<Plane>;
    if (seconds > 0) {
        still<Water, QuadraticBSpline, Mls>("Fluid, quadratic MLS", seconds);
        still<KeepsVolume<Water>, QuadraticBSpline, Mls>("kept, quadratic MLS", seconds);
        sloshed<Water, QuadraticBSpline, Mls>("Fluid, quadratic MLS", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Mls>("kept, quadratic MLS", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Apic>("kept, quadratic APIC", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Flip>("kept, quadratic FLIP", seconds);
        sloshed<KeepsVolume<Water>, CubicBSpline, Mls>("kept, cubic MLS", seconds);
    }
    if (rounds > 0) cost(rounds);
}

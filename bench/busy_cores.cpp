// SPDX-License-Identifier: MIT
// What a solver's threads are worth on a machine that is not idle: steps with one thread and with the
// default, by turns, beside 0, 1, 2, ... other busy programs:
//     busy_cores [--busy MOST] [--rounds N] [--seconds PER_RUN] [--particles N] [--gate]
// Prints a table of medians. With --gate the exit status is 1 if the default is slower than 0.9 of one
// thread.
#include "timing.hpp"

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

namespace
{

using firn::bench::median, firn::bench::processor_seconds;
using Space = firn::Space<3, float>;
using Solver = firn::Solver<firn::OpenMP, firn::Snow<Space>, firn::QuadraticBSpline, firn::Mls>;

/// Programs that do nothing but use a core each, until they are destroyed.
class BusyPrograms
{
public:
    explicit BusyPrograms(int count)
    {
        for (int i = 0; i < count; ++i) {
            pid_t const child = fork();
            if (child < 0) throw std::runtime_error("no further process could be started");
            if (child == 0) {
                prctl(PR_SET_PDEATHSIG, SIGKILL);
                std::atomic<std::uint64_t> turns{0};
                for (;;) turns.fetch_add(1, std::memory_order_relaxed);
            }
            children_.push_back(child);
        }
    }
    BusyPrograms(BusyPrograms const&) = delete;
    BusyPrograms& operator=(BusyPrograms const&) = delete;
    ~BusyPrograms()
    {
        for (pid_t const child : children_) kill(child, SIGKILL), waitpid(child, nullptr, 0);
    }

private:
    std::vector<pid_t> children_;
};

/// Particle-steps per second, and the number of processors used.
struct Speed
{
    double steps, processors;
};

/// A block of snow that falls on a floor, in frames of a sixtieth of a second of so many calls each.
Speed measure(int threads, int particles, int calls_per_frame, double seconds)
{
    using Clock = std::chrono::steady_clock;
    double const h = 0.05;
    int const side = int(std::lround(std::cbrt(particles)));
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < side * side * side; ++i)
        points.push_back(h / 2 * Eigen::Vector3d(i % side, i / side % side + 2, i / side / side));
    Solver solver(firn::lattice(h), firn::materials::fresh_snow<Space>(), {}, {}, {.threads = threads});
    solver.add(points, h * h * h / 8, {0, -1, 0});
    firn::Obstacle<firn::HalfSpace> const ground{.contact = firn::Contact::coulomb(0.5)};
    double const call = 1.0 / 60 / calls_per_frame;
    auto const start = Clock::now();
    double const processors_before = processor_seconds();
    double steps = 0, passed = 0;
    while (passed < seconds) {
        for (int i = 0; i < calls_per_frame; ++i)
            steps += double(solver.advance(call, firn::Gravity{}, ground).substeps);
        passed = std::chrono::duration<double>(Clock::now() - start).count();
    }
    return {steps * double(points.size()) / passed, (processor_seconds() - processors_before) / passed};
}

} // namespace

int main(int argc, char** argv)
{
    int most_busy = 2, rounds = 5, particles = 0;
    double seconds = 0.4;
    bool gate = false;
    try {
        for (int i = 1; i < argc; ++i) {
            std::string_view const option = argv[i];
            if (option == "--gate") {
                gate = true;
                continue;
            }
            if (i + 1 == argc) throw std::invalid_argument(std::string(option) + " needs a value");
            std::string const value = argv[++i];
            if (option == "--busy")
                most_busy = std::stoi(value);
            else if (option == "--rounds")
                rounds = std::stoi(value);
            else if (option == "--seconds")
                seconds = std::stod(value);
            else if (option == "--particles")
                particles = std::stoi(value);
            else
                throw std::invalid_argument("there is no option " + std::string(option));
        }
    }
    catch (std::exception const& error) {
        std::fprintf(stderr, "busy_cores: %s\n", error.what());
        return 2;
    }
    std::printf("%s\n", firn::openmp_info().c_str());
    std::printf("busy  particles  calls/frame  one [M/s]  default [M/s]  default/one (least, median, most)  "
                "processors\n");
    double worst = 1e9;
    std::vector<int> const sizes = particles > 0 ? std::vector{particles} : std::vector{2197, 8000, 125000};
    for (int busy = 0; busy <= most_busy; ++busy)
        for (int const size : sizes)
            for (int const calls : {1, 16}) {
                BusyPrograms const others(busy);
                measure(0, size, calls, seconds);
                std::vector<double> one, all, ratios, processors;
                for (int round = 0; round < rounds; ++round) {
                    Speed const alone = measure(1, size, calls, seconds),
                                team = measure(0, size, calls, seconds);
                    one.push_back(alone.steps), all.push_back(team.steps);
                    ratios.push_back(team.steps / alone.steps), processors.push_back(team.processors);
                }
                auto const [least, most] = std::minmax_element(ratios.begin(), ratios.end());
                std::printf("%4d  %9d  %11d  %9.2f  %13.2f  %5.2f  %5.2f  %5.2f  %23.2f\n", busy, size, calls,
                            median(one) / 1e6, median(all) / 1e6, *least, median(ratios), *most,
                            median(processors));
                std::fflush(stdout);
                worst = std::min(worst, median(ratios));
            }
    std::printf("worst median: %.2f of one thread\n", worst);
    return gate && worst < 0.9 ? 1 : 0;
}

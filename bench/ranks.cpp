// SPDX-License-Identifier: MIT
//
// How long a whole step takes on several ranks, and what travels (see ranks.sh):
//
//     mpirun --bind-to none -n RANKS ranks [--particles N] [--blocks B] [--threads T] [--nccl] [--peers R]
//     [--steps S] SCENE...
//
// A scene is made of B blocks of N elastic particles side by side along the first axis. There are as many as
// ranks if nothing is said, so that each rank has the same work in the same phase of the same scene on any
// number of ranks.
//
// - elastic: they fly in all directions, sideways too, and fall on a floor. Each particle lies anywhere in
//   its eighth of a cell, so that some change their cells in each step.
// - layers: the same on a lattice, where whole layers change their cells at once, and only ten steps come
//   before.
// - splash: they are thrown on the floor sideways, which deforms and scatters them.
//
// It prints the median and the mean of calls of ten steps, after 64 steps in which arrays get their room;
// with one rank also those of the backend without ranks. As `ranks_cuda` each rank has a device of its own,
// as long as there are as many, and --nccl lets devices send to one another by NCCL. With --peers R it is one
// process of R ranks, which are threads, and whose devices copy from one another.
#include "timing.hpp"

#include <firn/firn.hpp>
#include <firn/mpi.hpp>
#if defined(__CUDACC__)
#include <firn/distributed/on_cuda.hpp>
#include <firn/peers.hpp>
#if defined(FIRN_HAS_NCCL)
#include <firn/nccl.hpp>
#endif
#else
#include <firn/openmp.hpp>
#endif

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace
{

using namespace firn;
using Rubber = NeoHookean<Space<3, float>>;

#if defined(__CUDACC__)
Cuda backend_of(int rank, int)
{
    int devices = 1;
    static_cast<void>(cudaGetDeviceCount(&devices));
    return {.device = rank % std::max(devices, 1)};
}
#else
OpenMP backend_of(int, int threads) { return {.threads = threads}; }
#endif

/// What a communicator has sent, and how long its calls took.
struct Sent
{
    double calls = 0, messages = 0, bytes = 0, seconds = 0;
};

/// Counts what goes through a communicator.
template <class C>
struct Counted
{
    C of;
    std::shared_ptr<Sent> sent = std::make_shared<Sent>();

    template <class Stream>
    void exchange_on_device(Stream const& stream, std::span<DeviceMessage const> to,
                            std::span<DeviceMessage const> from) const requires(DeviceCommunicator<C, Stream>)
    {
        for (auto const& message : to) {
            sent->messages += 1;
            sent->bytes += double(message.bytes);
        }
        of.exchange_on_device(stream, to, from);
    }
    template <class Stream>
    void gather_on_device(Stream const& stream, void const* own, std::size_t bytes, void* all) const
        requires(DeviceCommunicator<C, Stream>)
    {
        sent->messages += 1;
        sent->bytes += double(bytes);
        of.gather_on_device(stream, own, bytes, all);
    }
    template <class Stream>
    void gather_beside(Stream const& stream, void const* own, std::size_t bytes, void* all,
                       std::span<DeviceMessage const> to,
                       std::span<DeviceMessage const> from) const requires requires
    {
        this->of.gather_beside(stream, own, bytes, all, to, from);
    }
    {
        sent->messages += 1 + double(to.size());
        sent->bytes += double(bytes);
        for (auto const& message : to) sent->bytes += double(message.bytes);
        of.gather_beside(stream, own, bytes, all, to, from);
    }
    int rank() const { return of.rank(); }
    int size() const { return of.size(); }
    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const
    {
        for (std::size_t r = 0; r < to.size(); ++r)
            if (static_cast<int>(r) != rank() && !to[r].empty()) {
                sent->messages += 1;
                sent->bytes += double(to[r].size());
            }
        return timed([&] { return of.exchange(to); });
    }
    std::vector<Parcel> all_gather(Parcel const& own) const
    {
        return timed([&] { return of.all_gather(own); });
    }
    void abort(char const* why) const
    {
        std::fprintf(stderr, "rank %d: %s\n", rank(), why);
        of.abort(why);
    }

private:
    template <class Call>
    auto timed(Call const& call) const
    {
        auto const begin = std::chrono::steady_clock::now();
        auto came = call();
        sent->seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        sent->calls += 1;
        return came;
    }
};

/// What is to be timed.
struct Options
{
    int particles = 125000; ///< of a block
    int blocks = 0;         ///< 0: as many as ranks
    int threads = 1, steps = 200;
    int peers = 0; ///< ranks of this process; 0: processes are ranks
    bool by_nccl = false;
    std::vector<std::string> scenes;
};

/// The times of a step [s]: the median of calls of ten, the mean and the longest one; and how many parts of
/// space have been made anew meanwhile.
struct Times
{
    double median = 0, mean = 0, longest = 0;
    int divisions = 0;
    double energy = 0; ///< of the particles at the end [J]: the same bits on any number of ranks
};

/// Blocks of particles side by side along the first axis.
std::vector<Eigen::Vector3d> blocks_of_points(Options const& options, double spacing, double jitter)
{
    int const side = static_cast<int>(std::lround(std::cbrt(options.particles)));
    std::mt19937 random(7);
    std::vector<Eigen::Vector3d> points;
    points.reserve(std::size_t(options.blocks) * std::size_t(side) * std::size_t(side) * std::size_t(side));
    for (int i = 0; i < options.blocks * side; ++i)
        for (int j = 0; j < side; ++j)
            for (int k = 0; k < side; ++k) {
                Eigen::Vector3d place(i, j, k);
                for (double& x : place) x += 0.5 + jitter * (double(random()) * 0x1p-32 - 0.5);
                points.push_back(place * spacing);
            }
    return points;
}

template <class Backend>
Times times_of_step(Backend const& backend, Options const& options, std::string const& scene)
{
    bool const splashes = scene == "splash", is_regular = scene == "layers";
    double const h = is_regular ? 0.1 : 0.01, spacing = h / 2, throwing = 5;
    Solver<Backend, Rubber> solver(lattice(h), {}, {}, {}, backend);
    solver.add(blocks_of_points(options, spacing, is_regular ? 0 : 0.999), std::pow(spacing, 3),
               splashes ? Eigen::Vector3d(2, -throwing, 1) : Eigen::Vector3d(1, 0, 2));
    Obstacle<HalfSpace> const floor{.motion = {.position = {0, -2 * h, 0}}};
    if (splashes) // until half of it has come to the floor
        solver.advance(0.5 * std::cbrt(options.particles) * spacing / throwing, Gravity{}, floor);
    double const dt = 0.5 * solver.stable_step(Gravity{}, floor);
    solver.steps(is_regular ? 10 : 64, dt, Gravity{}, floor);
    int divisions = 0;
    if constexpr (spans_ranks<Backend>) {
        *backend.communicator.sent = {};
        divisions = solver.backend().partition->divisions();
    }
    std::vector<double> times;
    Times found;
    for (int done = 0; done < options.steps; done += 10) {
        auto const begin = std::chrono::steady_clock::now();
        solver.steps(10, dt, Gravity{}, floor);
        times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / 10);
        found.mean += times.back();
    }
    found.mean /= double(times.size());
    found.median = bench::median(times);
    found.longest = std::ranges::max(times);
    found.energy = solver.energy().total();
    if constexpr (spans_ranks<Backend>) found.divisions = solver.backend().partition->divisions() - divisions;
    return found;
}

void print(std::string const& scene, Options const& options, std::string const& on, Times const& times)
{
    std::printf("%s, %d blocks of %d particles, %s: %.3f ms a step, mean %.3f, longest of ten %.3f, "
                "energy at the end %.17g J",
                scene.c_str(), options.blocks, options.particles, on.c_str(), 1e3 * times.median,
                1e3 * times.mean, 1e3 * times.longest, times.energy);
}

/// Prints how long a step of each scene takes on the ranks of a communicator.
template <class Local, class C>
void measure(Local const& local, C const& of, Options options)
{
    if (options.blocks == 0) options.blocks = of.size();
    for (auto const& scene : options.scenes) {
        Counted<C> const communicator{of};
        Times const times =
            times_of_step(Distributed<Local, Counted<C>>{local, communicator}, options, scene);
        Sent const sent = *communicator.sent;
        double const steps = options.steps;
        std::string const threads =
            std::to_string(options.threads) + (options.threads == 1 ? " thread" : " threads");
        if (communicator.rank() == 0) {
            print(scene, options, std::to_string(of.size()) + " ranks of " + threads, times);
            std::printf(
                "; rank 0: %.2f calls, %.2f messages, %.1f kB a step, %.3f ms in calls; space divided anew "
                "%d times\n",
                sent.calls / steps, sent.messages / steps, sent.bytes / steps / 1e3,
                1e3 * sent.seconds / steps, times.divisions);
        }
        if (communicator.size() == 1) {
            print(scene, options, "no ranks, " + threads, times_of_step(local, options, scene));
            std::printf("\n");
        }
        std::fflush(stdout);
    }
}

/// The same on the ranks that are asked for.
void measure_ranks(Mpi const& processes, Options const& options)
{
    auto const local = backend_of(processes.rank(), options.threads);
#if defined(__CUDACC__)
    if (options.peers > 0)
        return run_ranks(options.peers, [&](RankThreads const& threads) {
            auto const own = backend_of(threads.rank(), options.threads);
            measure(own, Peers(threads, own.device), options);
        });
#if defined(FIRN_HAS_NCCL)
    if (options.by_nccl) return measure(local, Nccl<Mpi>(processes, local.device), options);
#endif
#endif
    measure(local, processes, options);
}

/// Reads the arguments; returns what is wrong with them, or nothing.
std::string read(int argc, char** argv, Options& options)
{
    for (int i = 1; i < argc; ++i) {
        std::string const name = argv[i];
        if (name == "--nccl") {
            options.by_nccl = true;
            continue;
        }
        if (name == "elastic" || name == "layers" || name == "splash") {
            options.scenes.push_back(name);
            continue;
        }
        int* const number = name == "--particles" ? &options.particles
                            : name == "--blocks"  ? &options.blocks
                            : name == "--threads" ? &options.threads
                            : name == "--steps"   ? &options.steps
                            : name == "--peers"   ? &options.peers
                                                  : nullptr;
        if (number == nullptr) return "unknown argument '" + name + "'";
        double const value = ++i < argc ? std::atof(argv[i]) : 0;
        if (!(value >= 1 && value < 2e9)) return name + " needs a number above 0";
        *number = static_cast<int>(value);
    }
    if (options.scenes.empty()) options.scenes = {"elastic"};
    options.steps = (options.steps + 9) / 10 * 10; // calls are of ten
    return {};
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    {
        Mpi const communicator;
        Options options;
        std::string wrong = read(argc, argv, options);
#if !(defined(__CUDACC__) && defined(FIRN_HAS_NCCL))
        if (options.by_nccl) wrong = "this program was built without NCCL: see the components of the build";
#endif
#if !defined(__CUDACC__)
        if (options.peers > 0) wrong = "--peers is for devices: use ranks_cuda";
#endif
        if (options.peers > 0 && communicator.size() > 1) wrong = "--peers is for one process";
        if (!wrong.empty()) {
            if (communicator.rank() == 0) std::fprintf(stderr, "ranks: %s.\n", wrong.c_str());
            MPI_Abort(MPI_COMM_WORLD, 1);
        }
        measure_ranks(communicator, options);
    }
    MPI_Finalize();
}

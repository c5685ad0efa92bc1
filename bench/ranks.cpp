// SPDX-License-Identifier: MIT
//
// A block of elastic particles that lies on a floor, on several ranks: how long a step takes, and what
// travels.
//     mpirun --bind-to none -n RANKS ranks PARTICLES [threads]
// prints, for so many particles in all, one line for `results.py`. With one rank it is the backend without
// ranks, too. As `ranks_cuda` each rank has a device of its own, as long as there are as many, and `nccl` in
// the place of the threads lets devices send to one another by NCCL.
#include <firn/firn.hpp>
#include <firn/mpi.hpp>
#if defined(__CUDACC__)
#include <firn/distributed/on_cuda.hpp>
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

/// The time of a step [s], the median of some calls of ten.
template <class Backend>
double seconds_of_step(Backend const& backend, double particles)
{
    double const h = 0.1;
    int const across = static_cast<int>(std::lround(std::cbrt(particles)));
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < across; ++i)
        for (int j = 0; j < across; ++j)
            for (int k = 0; k < across; ++k)
                points.push_back((Eigen::Vector3d(i, j, k).array() + 0.5) * h / 2);
    Solver<Backend, Rubber> solver(lattice(h), {}, {}, {}, backend);
    solver.add(points, h * h * h / 8, {1, 0, 2});
    Obstacle<HalfSpace> const floor{.motion = {.position = {0, -0.2, 0}}};
    double const dt = 0.5 * solver.stable_step(Gravity{}, floor);
    solver.steps(10, dt, Gravity{}, floor);
    if constexpr (spans_ranks<Backend>) *backend.communicator.sent = {};
    std::vector<double> times;
    for (int call = 0; call < 7; ++call) {
        auto const begin = std::chrono::steady_clock::now();
        solver.steps(10, dt, Gravity{}, floor);
        times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / 10);
    }
    std::nth_element(times.begin(), times.begin() + 3, times.end());
    return times[3];
}

/// Prints how long a step of a scene takes on the ranks of a communicator.
template <class Local, class C>
void measure(Local const& local, C const& of, double particles, int threads)
{
    Counted<C> const communicator{of};
    double const seconds = seconds_of_step(Distributed<Local, Counted<C>>{local, communicator}, particles);
    Sent const sent = *communicator.sent;
    if (communicator.rank() == 0)
        std::printf(
            "%d ranks of %d threads, %.0f particles: %.3f ms a step; %.2f calls, %.2f messages, %.0f kB, "
            "%.3f ms in them\n",
            communicator.size(), threads, particles, 1e3 * seconds, sent.calls / 70, sent.messages / 70,
            sent.bytes / 70e3, 1e3 * sent.seconds / 70);
    if (communicator.size() == 1)
        std::printf("no ranks, %d threads: %.3f ms a step\n", threads,
                    1e3 * seconds_of_step(local, particles));
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    {
        double const particles = argc > 1 ? std::atof(argv[1]) : 125000;
        int const threads = argc > 2 ? std::max(std::atoi(argv[2]), 1) : 1;
        Mpi const communicator;
        auto const local = backend_of(communicator.rank(), threads);
        bool const by_nccl = argc > 2 && std::string(argv[2]) == "nccl";
#if defined(__CUDACC__) && defined(FIRN_HAS_NCCL)
        if (by_nccl)
            measure(local, Nccl<Mpi>(communicator, local.device), particles, threads);
        else
#else
        if (by_nccl) {
            std::fprintf(stderr, "this program was built without NCCL: see the components of the build\n");
            MPI_Abort(MPI_COMM_WORLD, 1);
        }
#endif
            measure(local, communicator, particles, threads);
    }
    MPI_Finalize();
}

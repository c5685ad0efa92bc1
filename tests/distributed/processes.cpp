// SPDX-License-Identifier: MIT
#include "distributed/numbers.hpp"

#include <firn/distributed/on_reference.hpp>
#include <firn/mpi.hpp>
#include <firn/openmp.hpp>
#include <firn/reference.hpp>

#include <cstdio>
#include <cstring>
#include <exception>
#include <type_traits>

// mpirun -n COUNT processes [forever]: a scene on these processes, and on each of them alone, which must come
// to the same bits, and on the reference backend to the same numbers. With `forever` it goes on until it is
// stopped.
namespace
{

using namespace firn;
using namespace firn::test;

using Jelly = NeoHookean<Space<2, double>>;

template <class Backend>
auto solver_on(Backend const& backend)
{
    Solver<Backend, Jelly> solver(lattice(0.1), {}, {}, {}, backend);
    solver.add(box_of_points<2>({0, 0.1}, {1, 1.1}, 0.05), 0.05 * 0.05, {4, 0});
    solver.add(box_of_points<2>({1.2, 0.2}, {2.2, 1.2}, 0.05), 0.05 * 0.05, {-4, 1});
    return solver;
}

template <class Backend>
Numbers scene(Backend const& backend)
{
    auto solver = solver_on(backend);
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.3)};
    Numbers all;
    append_report(all, solver.advance(0.05, Gravity{}, floor));
    auto const middle = solver.snapshot();
    solver.advance(0.05, Gravity{}, floor);
    append_all(all, solver);
    auto again = solver_on(backend);
    again.restore(middle);
    again.advance(0.05, Gravity{}, floor);
    append_all(all, again);
    return all;
}

/// The largest difference between two lists; infinite if there is no telling.
double difference(Numbers const& a, Numbers const& b)
{
    if (a.size() != b.size()) return INFINITY;
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        double const here = std::abs(a[i] - b[i]) / (1 + std::abs(a[i]));
        if (!(here <= largest)) largest = std::isnan(here) ? INFINITY : here;
    }
    return largest;
}

bool run(bool forever)
{
    Mpi const communicator;
    OpenMP const alone{.threads = 1};
    Distributed<OpenMP, Mpi> const together{.local = alone, .communicator = communicator};
    if (forever) {
        auto solver = solver_on(together);
        while (true) solver.advance(1e-3);
    }
    double const of_bits = difference(scene(together), scene(alone));
    Distributed<Reference, Mpi> const plainly{.local = {}, .communicator = communicator};
    double const of_reference = difference(scene(plainly), scene(Reference{}));
    std::printf("rank %d of %d: OpenMP differs by %g, the reference by %g\n", communicator.rank(),
                communicator.size(), of_bits, of_reference);
    return of_bits == 0 && of_reference <= 1e-9;
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    bool good = false;
    try {
        good = run(argc > 1 && std::strcmp(argv[1], "forever") == 0);
    }
    catch (std::exception const& error) {
        std::fprintf(stderr, "stop: %s\n", error.what());
    }
    if (!good) MPI_Abort(MPI_COMM_WORLD, 1);
    MPI_Finalize();
}

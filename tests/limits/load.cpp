// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <exception>
#include <malloc.h>
#include <thread>

using namespace firn;
using namespace firn::test;

namespace
{

using Jelly = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
constexpr double cell = 0.05, side = 64 * cell; // [m]

/// A block that falls onto a floor.
Jelly block(int seed, TestedBackend const& backend = {})
{
    Jelly solver(lattice(cell), {}, {}, {}, backend);
    Vector<double, 2> const low(0, 0.01 * seed);
    solver.add(box_of_points<2>(low, low + Vector<double, 2>::Constant(side), cell), cell * cell / 4,
               {0.1 * seed, -2});
    return solver;
}

void run(Jelly& solver, double duration = 1e-2)
{
    solver.advance(duration, Gravity{}, Obstacle<HalfSpace>{});
}

/// Sanitizers keep freed memory for a while to watch it.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool sanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool sanitized = true;
#else
constexpr bool sanitized = false;
#endif
#else
constexpr bool sanitized = false;
#endif

/// Memory in use where solvers lie [bytes]. On a processor: allocated and not freed. Resident memory would
/// also count free memory of the allocator, which varies by more than a solver's worth.
double held()
{
#if defined(__CUDACC__)
    std::size_t free = 0, total = 0;
    cuda::check(cudaMemGetInfo(&free, &total), "cudaMemGetInfo");
    return double(total - free);
#else
    struct mallinfo2 const heap = mallinfo2();
    return double(heap.uordblks + heap.hblkhd);
#endif
}

/// What 24 solvers may leave behind, in solvers: a device's memory is counted by its large pages.
#if defined(__CUDACC__)
constexpr double may_stay = 0.5;
#else
constexpr double may_stay = 0.02;
#endif

} // namespace

TEST_CASE("24 solvers that come and go leave no memory behind")
{
    double one = 0, most = 0;
    auto const once = [&](int seed) {
        Jelly solver = block(seed % 3);
        run(solver, 1e-3);
        auto const saved = solver.snapshot();
        solver.remove_if(OnTheLeft{0.2});
        solver.restore(saved);
        one = std::max(one, double(solver.memory()));
        most = std::max(most, held());
    };
    for (int seed = 0; seed < 4; ++seed) once(seed); // what allocators, threads and devices keep
    double const before = held();
    for (int seed = 0; seed < 24; ++seed) once(seed);
    CAPTURE(one, most, before);
    if (sanitized) return;
    CHECK(most > 0.9 * one); // it is seen
    CHECK(held() - before < may_stay * one);
}

TEST_CASE("two solvers on two threads at once come to the same bits as each alone")
{
    auto const backend = [](auto two) {
        if constexpr (requires { two.threads; }) two.threads = 2;
        return two;
    }(TestedBackend{});
    std::vector<std::vector<Vector<double, 2>>> alone, together(2);
    for (int seed = 0; seed < 2; ++seed) {
        Jelly solver = block(seed, backend);
        run(solver);
        alone.push_back(solver.positions());
    }
    std::exception_ptr wrong[2];
    auto const on_a_thread = [&](int seed) {
        return std::thread([&, seed] {
            try {
                Jelly solver = block(seed, backend);
                run(solver);
                together[seed] = solver.positions();
            }
            catch (...) {
                wrong[seed] = std::current_exception();
            }
        });
    };
    std::thread first = on_a_thread(0), second = on_a_thread(1);
    first.join();
    second.join();
    for (auto const& what : wrong)
        if (what) std::rethrow_exception(what);
    CHECK((together[0] == alone[0])); // not to be printed
    CHECK((together[1] == alone[1]));
    CHECK((alone[0] != alone[1]));
}

#if !defined(NDEBUG) && !defined(__CUDACC__)

namespace
{

/// Calls `ask` on another thread, once, while the solver looks for particles to remove; removes none.
template <class Ask>
struct Interrupted
{
    Ask const* ask;

    bool operator()(Eigen::Matrix<double, 2, 1> const&) const
    {
        static bool asked;
        if (!std::exchange(asked, true)) std::thread(*ask).join();
        return false;
    }
};

} // namespace

TEST_CASE("a call that comes from another thread while one is under way is refused, and changes nothing")
{
    Jelly solver = block(0, {.threads = 1});
    Jelly other = block(1, {.threads = 1});
    std::string refusals;
    auto const attempt = [&](auto const& call) {
        try {
            call();
            refusals += "taken ";
        }
        catch (Error const& error) {
            CHECK(error.what_is_wrong() == "another call of the same object is under way");
            CHECK(!error.remedy().empty());
            refusals += error.where() + ' ';
        }
    };
    auto const ask = [&] {
        attempt([&] { run(solver); });
        attempt([&] { solver.add(std::vector<Vector<double, 2>>(1), 1e-5); });
        attempt([&] { solver.positions(); });
        attempt([&] { solver.snapshot(); });
        attempt([&] { run(other); }); // another solver is independent
    };
    auto const count = solver.size();
    CHECK(solver.remove_if(Interrupted<decltype(ask)>{&ask}) == 0);
    CHECK(refusals == "Solver::advance Solver::add Solver::download Solver::snapshot taken ");
    CHECK(solver.size() == count);
    CHECK(solver.time() == 0);
    CHECK_THROWS_AS(run(solver, -1), Error); // nor does one that is refused stay inside
    Jelly moved = std::move(solver);
    run(moved);
    CHECK(moved.positions().size() == count);
    CHECK_THROWS_WITH(run(solver), Contains("moved to another") && Contains("Solver::advance"));
    CHECK_THROWS_WITH(solver.snapshot(), Contains("moved to another"));
    std::swap(solver, moved);
    CHECK(solver.positions().size() == count);
}

#endif

// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <csignal>
#include <cstdio>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

// Contracts are checked where NDEBUG is not defined, as here: each is broken once, in a process of its own.
#if defined(NDEBUG)
#error "this file is about builds without NDEBUG"
#endif

using namespace firn;

namespace
{

using Plane = Space<2, double>;

/// A user-defined spline that may have wrong weights.
struct Spline : QuadraticBSpline
{
    static inline double first_weight = 0; ///< is off by that

    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> weights(Real t)
    {
        auto weights = QuadraticBSpline::weights(t);
        weights[0] += Real(first_weight);
        return weights;
    }
};

using Sheet = Solver<BasicOpenMP<openmp::ScalarLanes>, NeoHookean<Plane>, Spline, Mls>;

/// A node as the grid's update sees it.
struct Node
{
    using Real = double;
    double mass;
    double sum(int channel) const { return channel == 0 ? mass : 0; }
    double value(int) const { return 0; }
    void set(int, double) const {}
    Coordinates<2> first() const { return Coordinates<2>::Zero(); }
    Vector<double, 2> offset() const { return Vector<double, 2>::Zero(); }
};

void run_with_weights_off_by(double error)
{
    Spline::first_weight = error;
    Sheet solver(lattice(0.1), {}, {}, {}, BasicOpenMP<openmp::ScalarLanes>{.threads = 1});
    solver.add(std::vector<Eigen::Vector2d>{{0.1, 0.2}, {0.15, 0.2}}, 1e-3, {1, 0});
    solver.steps(20, 1e-3);
}

void update_node_of_mass(double mass)
{
    StepContext<double, Chain<>> const now{.dt = 1e-3, .forces = 1e-3, .next_forces = 1e-3, .actions = {}};
    UpdateGrid<Plane, Spline, Mls, Chain<>> const update{{}, &now, lattice(0.1), 1e-40, 0};
    UpdateGrid<Plane, Spline, Mls, Chain<>>::Result result{};
    Node node{mass};
    update(node, result);
}

void read_element(std::size_t i)
{
    openmp::Array<int> array;
    array.resize(3);
    array.fill(0, 3, 1);
    [[maybe_unused]] int const volatile element = array[i];
}

/// What a call says before it is stopped; nothing if it is not.
template <class Call>
std::string complaint_of(Call const& call)
{
    int ends[2];
    REQUIRE(::pipe(ends) == 0);
    pid_t const child = ::fork();
    if (child == 0) {
        std::signal(SIGABRT, SIG_DFL);
        ::dup2(ends[1], STDERR_FILENO);
        call();
        ::_exit(0);
    }
    ::close(ends[1]);
    std::string said;
    char part[256];
    for (ssize_t n; (n = ::read(ends[0], part, sizeof part)) > 0;) said.append(part, std::size_t(n));
    ::close(ends[0]);
    int status = 0;
    REQUIRE(::waitpid(child, &status, 0) == child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return "";
    CHECK((WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT));
    return said;
}

} // namespace

TEST_CASE("a contract that is broken in a build without NDEBUG stops the program and says which it was")
{
    CHECK(complaint_of([] { run_with_weights_off_by(0); }) == "");
    CHECK_THAT(complaint_of([] { run_with_weights_off_by(1e-9); }),
               Contains("the weights of a stencil add up to one"));
    CHECK(complaint_of([] { update_node_of_mass(2); }) == "");
    CHECK_THAT(complaint_of([] { update_node_of_mass(-1e-9); }),
               Contains("the mass of a node is not below 0"));
    CHECK(complaint_of([] { read_element(2); }) == "");
    CHECK_THAT(complaint_of([] { read_element(3); }), Contains("an element is in its array"));
}

// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "unit/bytes_of_materials.hpp"

#include <array>
#include <functional>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

using Jelly = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
constexpr int some_steps = sample_of(5, 20);

void add_block(Jelly& solver, double speed = 1)
{
    solver.add(box_of_points<3>({0, 0, 0}, {0.5, 0.5, 0.5}, 0.05), std::pow(0.025, 3), {speed, 0, 0});
}

/// Most of the device's memory, so that what is left can run short.
class Hoard
{
public:
    explicit Hoard(std::size_t left)
    {
        std::size_t available = 0, total = 0;
        cuda::check(cudaMemGetInfo(&available, &total), "cudaMemGetInfo");
        if (available > left) cuda::check(cudaMalloc(&memory_, available - left), "cudaMalloc");
    }
    ~Hoard() { cudaFree(memory_); }

private:
    void* memory_ = nullptr;
};

/// An obstacle that nothing touches: the compiler has little to do.
struct Nowhere
{
    void validate() const {}
    double largest_speed() const { return 0; }

    struct Action
    {
        Contact contact;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE ContactResult<Real, d> touch(LanePosition<Real, d> const&, Vector<Real, d> const& v,
                                                      Contact const&) const
        {
            ContactResult<Real, d> touched{};
            touched.velocity = v;
            return touched;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action over(Interval const&) const
    {
        return {};
    }
};

} // namespace

TEST_CASE("where memory is short an error says how much was needed and had, and the scene goes on as it was",
          "[memory]") // needs the whole device for itself
{
    Jelly solver(lattice(0.05)), untouched(lattice(0.05));
    for (auto* const scene : {&solver, &untouched}) {
        add_block(*scene);
        for (int i = 0; i < 5; ++i) scene->step(1e-4, Gravity{});
    }
    auto const size = solver.size();
    {
        Hoard const hoard(std::size_t(64) << 20);
        auto const many = box_of_points<3>({2, 2, 2}, {5, 5, 5}, 0.05); // 1.7 million: 100 MB
        try {
            solver.add(many, std::pow(0.025, 3));
            FAIL("there was memory enough");
        }
        catch (Error const& error) {
            CHECK_THAT(error.what_is_wrong(), Contains("memory is short"));
            CHECK_THAT(error.what_is_wrong(), Contains("were needed"));
            CHECK_THAT(error.what_is_wrong(), Contains("are available"));
            CHECK_THAT(error.what_is_wrong(), Contains("scenes hold"));
        }
    }
    CHECK(solver.size() == size);
    for (int i = 0; i < 5; ++i) {
        solver.step(1e-4, Gravity{});
        untouched.step(1e-4, Gravity{});
    }
    double worst = 0; // velocities were read on the way, and particles scattered afresh
    auto const a = solver.positions(), b = untouched.positions();
    for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, (a[i] - b[i]).norm());
    CHECK(worst <= 1e-7);
}

TEST_CASE("where memory runs short in the middle of a step, so says every call after it", "[memory]")
{
    Jelly solver(lattice(0.05));
    solver.add(box_of_points<3>({0, 0, 0}, {3, 3, 3}, 0.05), std::pow(0.025, 3)); // the grid is yet to come
    // room for the next buffer, which is allocated before anything changes, and not for the grid's 35 MB
    Hoard const hoard(solver.size() * Jelly::state_bytes_per_particle + (std::size_t(24) << 20));
    CHECK_THROWS_WITH(solver.step(1e-4), Contains("memory is short") && Contains("are available"));
    std::function<void()> const calls[]{[&] { solver.step(1e-4); }, [&] { solver.advance(1e-4); },
                                        [&] { solver.positions(); }, [&] { solver.snapshot(); }};
    for (auto const& call : calls)
        CHECK_THROWS_WITH(call(),
                          Contains("broke off") && Contains("memory is short") && Contains("make a new one"));
    Jelly moved(std::move(solver));
    CHECK_THROWS_WITH(moved.step(1e-4), Contains("broke off"));
}

TEST_CASE("what is looked at on the device is what is downloaded, before steps and after")
{
    Jelly solver(lattice(0.05));
    int const steps = sample_of(10, 40);
    add_block(solver, 40.0 / steps);
    std::size_t const stride = 4;
    cuda::Array<float> there(solver.backend());
    there.resize(stride * solver.size());
    for (int i = 0; i < 3; ++i) {
        there.fill(0, there.size(), -1);
        solver.write_positions(there.data(), stride);
        std::vector<float> x(there.size());
        there.download(0, x);
        auto const expected = solver.positions();
        for (std::size_t id = 0; id < expected.size(); ++id) {
            REQUIRE((Eigen::Map<Eigen::Vector3f>(&x[stride * id]) == expected[id].cast<float>()));
            REQUIRE(x[stride * id + 3] == -1);
        }

        auto const view = solver.view<DisplacementGradient>();
        REQUIRE(view.count == solver.size());
        std::vector<float> column(view.count);
        std::vector<std::uint32_t> rows(view.count);
        REQUIRE(cudaMemcpy(rows.data(), view.row, 4 * view.count, cudaMemcpyDeviceToHost) == cudaSuccess);
        REQUIRE(cudaMemcpy(column.data(), view.component[5], 4 * view.count, cudaMemcpyDeviceToHost) ==
                cudaSuccess);
        auto const H = solver.download<DisplacementGradient>();
        for (std::size_t k = 0; k < rows.size(); ++k) REQUIRE(column[k] == H[rows[k]](1, 2));
        for (int k = 0; k < steps; ++k) solver.step(5e-4, Gravity{}); // cells are left behind
    }
    CHECK_THROWS_AS(solver.write_positions(nullptr), Error);
    CHECK_THROWS_AS(solver.write_positions(there.data(), 2), Error);
    int reaches_all = 0;
    REQUIRE(cudaDeviceGetAttribute(&reaches_all, cudaDevAttrPageableMemoryAccess, 0) == cudaSuccess);
    if (reaches_all == 0) {
        std::vector<float> of_the_host(3 * solver.size());
        CHECK_THROWS_WITH(solver.write_positions(of_the_host.data()), Contains("is the host's"));
        CHECK_THROWS_WITH(solver.write<Velocity>(of_the_host.data()), Contains("is the host's"));
    }
    void* mapped = nullptr; // of the host, but for devices
    REQUIRE(cudaMallocHost(&mapped, 12 * solver.size()) == cudaSuccess);
    auto* const x = static_cast<float*>(mapped);
    solver.write_positions(x);
    REQUIRE(cudaStreamSynchronize(nullptr) == cudaSuccess);
    auto const expected = solver.positions();
    for (std::size_t i = 0; i < expected.size(); ++i)
        REQUIRE((Eigen::Map<Eigen::Vector3f>(x + 3 * i) == expected[i].cast<float>()));
    REQUIRE(cudaFreeHost(mapped) == cudaSuccess);
}

TEST_CASE("an error that a call of another library left behind stays there")
{
    Jelly first(lattice(0.05)), solver(lattice(0.05));
    add_block(first);
    first.steps(some_steps, 1e-4, Gravity{}); // loops that are new get their shared memory: see allow_shared
    cudaError_t const left = cudaSetDevice(1000);
    REQUIRE(left != cudaSuccess);
    add_block(solver);
    solver.steps(some_steps, 1e-4, Gravity{});
    CHECK(solver.size() > 0);
    CHECK(cudaGetLastError() == left);
}

TEST_CASE("the results of many obstacles fit beside the tiles that teams share")
{
    Jelly none(lattice(0.05)), many(lattice(0.05));
    for (auto* const scene : {&none, &many}) add_block(*scene);
    for (int i = 0; i < some_steps; ++i) {
        none.step(1e-4);
        auto const step = [&](auto const&... obstacles) { return many.step(1e-4, obstacles...); };
        CHECK(std::apply(step, std::array<Nowhere, 12>{}).reactions.size() == 12);
    }
    double worst = 0;
    auto const a = none.positions(), b = many.positions();
    for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, (a[i] - b[i]).norm());
    CHECK(worst <= 1e-7);
}

TEST_CASE("thousands of blocks that are born at once are numbered as those that are born one after the other",
          "[many_blocks]") // too many for a processor that stands in for a device
{
    std::vector<Vector<double, 3>> points; // each in a block of its own
    for (int i = 0; i < 21 * 21 * 21; ++i)
        points.push_back(0.4 * Vector<double, 3>(i % 21, i / 21 % 21, i / 441) +
                         Vector<double, 3>::Constant(0.011));
    Jelly together(lattice(0.05)), apart(lattice(0.05));
    together.add(points, std::pow(0.025, 3), {1, 0, 0});
    for (auto from = points.begin(); from != points.end(); from += 21 * 21 * 3)
        apart.add(std::vector(from, from + 21 * 21 * 3), std::pow(0.025, 3), {1, 0, 0});
    for (auto* const scene : {&together, &apart}) scene->steps(200, 5e-4);
    auto const here = together.positions();
    CHECK((here == apart.positions()));
    double worst = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        worst = std::max(worst, (here[i] - points[i] - Vector<double, 3>(0.1, 0, 0)).norm());
    CHECK(worst <= 1e-5);
}

namespace
{
/// An order of cells that says how many blocks it would create around those that hold items.
struct OrderWithBlocksAround : cuda::CellOrder<float, 3>
{
    using cuda::CellOrder<float, 3>::CellOrder;
    std::uint32_t blocks_around(std::vector<Coordinates<3>> const& cells)
    {
        cuda::Array<Coordinates<3>> there(Cuda{});
        there.resize(cells.size());
        there.upload(0, cells);
        insert(there.data(), cells.size(), 0);
        return cuda::detail::missing_around<3>(queue_, set_, begin_.data(), periods_);
    }
};
} // namespace

TEST_CASE("blocks are created around a block where items can leave it in one step")
{
    auto const around = [](std::vector<Coordinates<3>> const& cells) {
        return OrderWithBlocksAround(Cuda{}).blocks_around(cells);
    };
    CHECK(around({{1, 2, 1}}) == 0);
    CHECK(around({{-4, 2, 1}}) == 1);
    CHECK(around({{0, 3, 1}}) == 3);
    CHECK(around({{0, 3, -1}}) == 7);
    CHECK(around({{0, 1, 1}, {3, 1, 1}}) == 2);
    CHECK(around({{3, 1, 1}, {4, 1, 1}}) == 0); // of the other's block
}

TEST_CASE("a scene spreads if blocks are missing step after step, and not if they are in two steps of forty")
{
    cuda::detail::RateOfBirths cloud, body;
    auto const take = [](auto& scene, int steps, auto const& misses_blocks) {
        for (int i = 0; i < steps; ++i) {
            if (misses_blocks(i)) {
                scene.count_births();
                scene.count_births(); // there was no room for them
            }
            scene.count_step();
        }
    };
    take(cloud, 8, [](int) { return true; });
    CHECK(!cloud.spreads());
    take(cloud, 2, [](int) { return true; });
    CHECK(cloud.spreads());
    take(cloud, 400, [](int i) { return i % 20 == 0; });
    CHECK(cloud.spreads());
    take(cloud, 400, [](int i) { return i % 40 < 2; });
    CHECK(!cloud.spreads());
    take(body, 1000, [](int i) { return i % 40 < 2; });
    CHECK(!body.spreads());
    take(body, 10, [](int) { return true; });
    CHECK(body.spreads());
    take(body, 1000, [](int) { return false; }); // it has come to rest
    CHECK(!body.spreads());
}

TEST_CASE("a cloud that spreads over thousands of blocks flies straight on, and as in single steps",
          "[many_blocks]")
{
    std::vector<Vector<double, 3>> points; // each in a block of its own; none meets another
    std::vector<Vector<float, 3>> velocities;
    for (int i = 0; i < 11 * 11 * 11; ++i) {
        points.push_back(0.8 * Vector<double, 3>(i % 11 - 5, i / 11 % 11 - 5, i / 121 - 5) +
                         Vector<double, 3>(0.32, 0.13, 0.03));
        velocities.push_back(15 * points.back().cast<float>());
    }
    Jelly queued(lattice(0.1)), single(lattice(0.1));
    double const dt = 2e-4;
    int const steps = 120;
    for (auto* const scene : {&queued, &single}) {
        scene->add(points, 1e-4);
        scene->upload<Velocity>(velocities);
    }
    queued.steps(steps, dt);
    for (int i = 0; i < steps; ++i) single.step(dt);
    auto const here = queued.positions();
    CHECK((here == single.positions()));
    double worst = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        worst = std::max(worst, (here[i] - points[i] - steps * dt * velocities[i].cast<double>()).norm());
    CHECK(worst <= 1e-5);
}

TEST_CASE("more shared memory than a device has is an error that says how much was needed")
{
    CHECK_THROWS_WITH(cuda::detail::allow_shared(cuda::Queue{}, cuda::any_loop, 1 << 20),
                      Contains("1048576 bytes") && Contains("shared memory is short"));
    CHECK(cudaGetLastError() == cudaSuccess);
}

TEST_CASE("an error of CUDA's has a remedy of its own")
{
    auto const remedy = [](cudaError_t status) { return std::string(cuda::remedy_for(status)); };
    CHECK_THAT(remedy(cudaErrorIllegalAddress), Contains("new process"));
    CHECK_THAT(remedy(cudaErrorDevicesUnavailable), Contains("has the device to itself"));
    CHECK_THAT(remedy(cudaErrorInitializationError), Contains("nvidia-smi"));
    CHECK_THAT(remedy(cudaErrorNoKernelImageForDevice), Contains("Compile for this device"));
}

TEST_CASE("a batch of no steps, or of more than can be told of, is refused")
{
    for (std::size_t const batch : {std::size_t(0), Cuda::most_batch + 1, std::size_t(1) << 31})
        CHECK_THROWS_WITH(Jelly(lattice(0.05), {}, {}, {}, Cuda{.batch = batch}),
                          Contains("Pass a batch of"));
    Jelly largest(lattice(0.05), {}, {}, {}, Cuda{.batch = Cuda::most_batch});
    add_block(largest);
    CHECK(largest.steps(3, 1e-4).size() == 3);
}

TEST_CASE("two solvers in streams of their own do not disturb each other")
{
    cudaStream_t streams[2];
    for (auto& stream : streams)
        REQUIRE(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking) == cudaSuccess);
    {
        Jelly alone(lattice(0.05)), first(lattice(0.05), {}, {}, {}, Cuda{.stream = streams[0]}),
            second(lattice(0.05), {}, {}, {}, Cuda{.stream = streams[1]});
        for (auto* const scene : {&alone, &first, &second}) add_block(*scene);
        for (int i = 0; i < some_steps; ++i) {
            first.step(1e-4, Gravity{});
            second.step(1e-4, Gravity{});
        }
        for (int i = 0; i < some_steps; ++i) alone.step(1e-4, Gravity{});
        CHECK((first.positions() == alone.positions()));
        CHECK((second.positions() == alone.positions()));
    }
    for (auto& stream : streams) cudaStreamDestroy(stream);
}

#if defined(FIRN_ON_PROCESSOR) // which can say what a machine with a device cannot
TEST_CASE(
    "without a driver, with one that is too old, or without a device no solver is made, and why is said")
{
    auto const says = [](cudaError_t status, char const* what, char const* remedy) {
        on_processor::Memory::driver = status;
        CHECK_THROWS_WITH(Jelly(lattice(0.05)), Contains(what) && Contains(remedy));
        on_processor::Memory::driver = cudaSuccess;
        CHECK(cudaGetLastError() == cudaSuccess); // nothing is left for others to find
    };
    says(cudaErrorInsufficientDriver, "there is no driver for CUDA devices, or it is too old",
         "Install a driver for CUDA");
    says(cudaErrorNoDevice, "there is no CUDA device", "Use another backend");
    says(cudaErrorInitializationError, "cudaGetDeviceCount failed", "Look whether the driver runs");
    Jelly solver(lattice(0.05)); // afterwards as ever
    add_block(solver);
    solver.step(1e-4);
}
#endif

TEST_CASE("solvers on all devices give the same bits, and the caller's device stays the current one")
{
    int devices = 0;
    REQUIRE(cudaGetDeviceCount(&devices) == cudaSuccess);
    std::vector<std::vector<Eigen::Vector3d>> ends;
    for (int device = 0; device < devices; ++device) {
        Jelly solver(lattice(0.05), {}, {}, {}, Cuda{.device = device});
        add_block(solver);
        for (int i = 0; i < some_steps; ++i) solver.step(1e-4, Gravity{});
        int current = -1;
        REQUIRE(cudaGetDevice(&current) == cudaSuccess);
        CHECK(current == 0);
        ends.push_back(solver.positions());
        CHECK((ends.back() == ends.front()));
    }
}

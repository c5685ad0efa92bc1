// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/host_arrays.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/particles/host_nodes.hpp>
#include <firn/particles/observables.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <new>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

// Density, velocity and stress at any points, interpolated by the solver's kernel. From N_i of a point and
// w_ip of the particles p around it:
//
//   m_i = sum_p w_ip m_p,   (m v)_i = sum_p w_ip m_p (v_p + L_p (x_i - x_p)),   V_i, (V sigma)_i likewise
//   density = sum_i N_i m_i / h^d,   velocity = sum_i N_i (m v)_i / sum_i N_i m_i,
//   stress = sum_i N_i (V sigma)_i / sum_i N_i V_i
//
// The host computes it from downloads, in double precision and in rising order of rows. It keeps those nodes
// alone that some point reads.
namespace firn
{

/// The material at a point; all is 0 where there is none, farther from particles than the kernel reaches.
template <int d>
struct FieldSample
{
    double density = 0; ///< [kg/m^3], in the plane of a slab; near a surface it is less than the material's
    Vector<double, d> velocity = zeros<Vector<double, d>>(); ///< [m/s], the mean weighted by mass
    Matrix<double, d> stress = zeros<Matrix<double, d>>();   ///< Cauchy's [Pa], the mean weighted by volume
};

/// Samples at the points of a regular grid, x fastest.
template <int d>
struct SampledGrid
{
    Vector<double, d> low;     ///< the first point [m]
    Vector<double, d> spacing; ///< from point to point [m]
    Coordinates<d> points;     ///< along each axis
    std::vector<FieldSample<d>> samples;

    /// The place of a sample [m].
    Vector<double, d> place(std::size_t i) const
    {
        Vector<double, d> x = low;
        for (int a = 0; a < d; ++a) {
            auto const count = static_cast<std::size_t>(points[a]);
            x[a] += spacing[a] * double(i % count);
            i /= count;
        }
        return x;
    }
};

namespace detail
{
/// Sums over particles on those nodes that points read.
template <class Kernel, int d>
class SampledNodes
{
public:
    explicit SampledNodes(Lattice const& lattice) : lattice_(lattice) {}

    /// Whether a point may have nodes: particles have none so far away.
    bool reaches(Vector<double, d> const& x) const
    {
        for (int a = 0; a < d; ++a)
            if (!(std::abs(x[a] - lattice_.origin[a]) < 1e9 * lattice_.cell_size)) return false;
        return true;
    }

    /// Makes room for the nodes around a point that reaches() admits.
    void prepare(Vector<double, d> const& x)
    {
        visit(x, [&](Coordinates<d> const& node, double, auto const&) { nodes_.try_emplace(node); });
    }

    /// Adds a particle with a volume [m^3], a velocity gradient and a stress.
    void add(Vector<double, d> const& x, double mass, double volume, Vector<double, d> const& velocity,
             Matrix<double, d> const& gradient, Matrix<double, d> const& stress)
    {
        visit(x, [&](Coordinates<d> const& node, double weight, Vector<double, d> const& away) {
            auto const found = nodes_.find(node);
            if (found == nodes_.end()) return;
            Sums& sums = found->second;
            sums.mass += weight * mass;
            sums.volume += weight * volume;
            sums.momentum += weight * mass * (velocity + product<double, d>(gradient, away));
            sums.stress += weight * volume * stress;
        });
    }

    /// The sample at a point that was prepared.
    FieldSample<d> at(Vector<double, d> const& x) const
    {
        Sums sums;
        visit(x, [&](Coordinates<d> const& node, double weight, auto const&) {
            Sums const& own = nodes_.find(node)->second;
            sums.mass += weight * own.mass;
            sums.volume += weight * own.volume;
            sums.momentum += weight * own.momentum;
            sums.stress += weight * own.stress;
        });
        FieldSample<d> sample;
        if (!(sums.mass > 0)) return sample;
        sample.density = sums.mass;
        for (int a = 0; a < d; ++a) sample.density /= lattice_.cell_size;
        sample.velocity = sums.momentum / sums.mass;
        if (sums.volume > 0) sample.stress = sums.stress / sums.volume;
        return sample;
    }

private:
    struct Sums
    {
        double mass = 0, volume = 0;
        Vector<double, d> momentum = zeros<Vector<double, d>>();
        Matrix<double, d> stress = zeros<Matrix<double, d>>();
    };

    template <class Use>
    void visit(Vector<double, d> const& x, Use const& use) const
    {
        for_each_node_around<Kernel, d>(lattice_, x, use);
    }

    Lattice lattice_;
    std::unordered_map<Coordinates<d>, Sums, HashOfNode<d>> nodes_;
};

/// Adds all particles of the materials that a call is about.
template <class Which, class Nodes, class Solver>
FIRN_COLD void add_particles_to(Nodes& nodes, Solver const& solver)
{
    constexpr int d = Solver::d;
    constexpr std::size_t place = PlaceOf<Which, typename MaterialsOf<typename Solver::Model>::Type>::value;
    auto const add = [&]<std::size_t k>(std::integral_constant<std::size_t, k>) {
        if constexpr (place == k || place == Solver::materials) {
            using One = Material<k>;
            auto const x = solver.template positions<One>();
            auto const m = solver.template masses<One>();
            auto const v = solver.template download<Velocity, One>();
            auto const L = solver.template download<VelocityGradient, One>();
            auto const stress = solver.template download<Stress, One>();
            auto const volumes = present_volumes<One>(solver);
            for (std::size_t i = 0; i < x.size(); ++i)
                nodes.add(x[i], m[i], volumes[i], vector_of<double, d>(v[i]), L[i].template cast<double>(),
                          stress[i].template cast<double>());
        }
    };
    [&]<std::size_t... k>(std::index_sequence<k...>) { (add(std::integral_constant<std::size_t, k>{}), ...); }
    (std::make_index_sequence<Solver::materials>{});
}
} // namespace detail

/// Samples a solver's material, or all of them, at `points` [m], a range as Solver::add takes it;
/// see Solver::sample. Throws an Error if there is no point, or one is not finite.
template <class Which = EveryMaterial, class Solver, class Points>
FIRN_COLD auto sample_fields(Solver const& solver, Points const& points)
{
    constexpr int d = Solver::d;
    static_assert(
        PointOf<std::remove_cvref_t<decltype(*std::begin(points))>, d>,
        "points have as many coordinates as the scene has dimensions, and those of a host no padding: "
        "see HostValue in firn/core/host_arrays.hpp");
    detail::SampledNodes<typename Solver::kernel, d> nodes(solver.lattice());
    std::vector<FieldSample<d>> samples;
    std::size_t count = 0;
    for (auto const& point : points) {
        auto const x = point_of<d>(point);
        if (!all_finite(x))
            throw Error{"the point is not finite", "Solver::sample, point " + std::to_string(count),
                        "Pass places in metres."};
        if (nodes.reaches(x)) nodes.prepare(x);
        ++count;
    }
    require(count > 0, "there is no point to sample at", "Solver::sample", "Pass places in metres.");
    require(solver.lattice().half_world == 0, "the scene has many worlds, which would be added up",
            "Solver::sample", "Compute it from positions() and world_of_particles() of the Worlds.");
    detail::add_particles_to<Which>(nodes, solver);
    samples.reserve(count);
    for (auto const& point : points) {
        auto const x = point_of<d>(point);
        samples.push_back(nodes.reaches(x) ? nodes.at(x) : FieldSample<d>{});
    }
    return samples;
}

/// Samples a solver's material, or all of them, at the points of a regular grid from `low` to `high` [m], so
/// many along each axis. One point along an axis lies at `low`. Throws an Error if the box or the counts make
/// no grid, or one of more than 2^31 - 1 points, or of more than memory has room for.
template <class Which = EveryMaterial, class Solver>
FIRN_COLD auto sample_grid(Solver const& solver, Vector<double, Solver::d> const& low,
                           Vector<double, Solver::d> const& high, Coordinates<Solver::d> const& points)
{
    constexpr int d = Solver::d;
    auto const require_that = [](bool holds, char const* what, char const* remedy) {
        require(holds, what, "sample_grid", remedy);
    };
    require_that(all_finite(low) && all_finite(high), "the box is not finite", "Pass its corners in metres.");
    SampledGrid<d> grid{.low = low, .spacing = low, .points = points, .samples = {}};
    std::uint64_t count = 1;
    for (int a = 0; a < d; ++a) {
        require_that(points[a] >= 1, "there is no point along an axis", "Pass 1 or more for each axis.");
        count *= static_cast<std::uint64_t>(points[a]); // below 2^31 times 2^31
        require_that(count <= std::uint64_t(std::numeric_limits<std::int32_t>::max()),
                     "there are more than 2^31 - 1 points", "Pass fewer along each axis.");
        double const length = high[a] - low[a];
        require_that(is_finite(length) && (points[a] == 1 ? length >= 0 : length > 0),
                     "the upper corner of the box does not lie above the lower one",
                     "Pass the lower corner first.");
        grid.spacing[a] = points[a] == 1 ? solver.lattice().cell_size : length / (points[a] - 1);
    }
    std::vector<Vector<double, d>> places;
    try {
        places.reserve(count);
        grid.samples.reserve(count); // only to see that there is room
    }
    catch (std::bad_alloc const&) {
        require_that(false, "there is not enough memory for so many points", "Pass fewer along each axis.");
    }
    for (std::size_t i = 0; i < count; ++i) places.push_back(grid.place(i));
    grid.samples = sample_fields<Which>(solver, places);
    return grid;
}

} // namespace firn

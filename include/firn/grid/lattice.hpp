// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace firn
{

/// The unbounded lattice of grid nodes: node i is at origin + i h. A scene in two dimensions uses x and y
/// alone. It may be periodic along some axes.
struct Lattice
{
    double cell_size;                ///< h [m]
    Eigen::Vector3d origin{0, 0, 0}; ///< the position of node (0, 0, 0) [m]
    /// Half the cells of a world along each axis, a power of two; 0: the lattice is one world. Worlds sets
    /// it.
    int half_world = 0;
    int world_bits = 0; ///< there is room for 2^world_bits worlds along each axis; Worlds sets it, too
    /// After how many cells it begins anew along each axis; 0: never. See periodic().
    std::array<int, 3> periods{};

    /// The same lattice, but periodic along an axis (0, 1, 2: x, y, z) over so many cells: a particle that
    /// leaves at one end comes in at the other, and nodes near one end are those beyond the other. Positions
    /// are then from the origin on up to the period. An obstacle acts where its nearest image is.
    ///
    /// Throws an Error unless there is such an axis, and the cells are from 4 to 2^20. A backend needs whole
    /// blocks, which 16 cells are for all of them; a Solver says what its own needs.
    Lattice periodic(int axis, int cells) const
    {
        require(axis >= 0 && axis < 3, "there is no such axis", "Lattice::periodic",
                "Pass 0, 1 or 2 for x, y or z.");
        require(cells >= 4 && cells <= 1 << 20, "the period is not from 4 to 1048576 cells",
                "Lattice::periodic", "Pass a number of cells: the length of the scene over the cell size.");
        Lattice with = *this;
        with.periods[std::size_t(axis)] = cells;
        return with;
    }
    /// The length after which it begins anew along an axis [m]; 0: never.
    FIRN_HOST_DEVICE double period(int axis) const { return periods[std::size_t(axis)] * cell_size; }

    /// A coordinate of a cell or a node in the world where it lies.
    FIRN_HOST_DEVICE int in_world(int coordinate) const
    {
        return ((coordinate + half_world) & (2 * half_world - 1)) - half_world;
    }
};

/// The lattice of cell size h [m]; throws an Error unless h > 0 and all numbers are finite.
inline Lattice lattice(double cell_size, Eigen::Vector3d const& origin = {0, 0, 0})
{
    require(is_finite(cell_size) && cell_size > 0, "the cell size is not a finite number above 0", "lattice",
            "Pass the grid spacing in metres, e.g. twice the distance between particles.");
    require(all_finite(origin), "the origin is not finite", "lattice",
            "Pass the position of node (0, 0, 0) in metres.");
    return {cell_size, origin};
}

/// A lattice for a scene in this precision. Steps square rates of deformation, which are speeds over the cell
/// size: throws an Error unless the precision can represent these squares for speeds of some kilometres per
/// second. In single precision the cell size is from 4e-16 to 2e15 m.
template <class Number>
Lattice lattice_for(Lattice const& lattice)
{
    double const largest = std::pow(double(std::numeric_limits<Number>::max()), 0.4);
    double const h = firn::lattice(lattice.cell_size, lattice.origin).cell_size;
    require(h <= largest && h >= 1 / largest,
            "speeds over the cell size have squares beyond the precision of the scene", "lattice",
            "Pass the grid spacing in metres, or compute in double precision.");
    return lattice;
}

/// The integer coordinates of a cell or a node.
template <int d>
using Coordinates = Eigen::Matrix<int, d, 1>;

/// A point of the lattice as its cell and the offset from that cell's centre in cells, each in [-1/2, 1/2).
///
/// A kernel's cell is the set of positions that share a stencil: cells are centred on nodes for an even
/// degree of the kernel and on the middle between nodes for an odd one.
template <int d>
struct CellPosition
{
    Coordinates<d> cell;
    Vector<double, d> offset;
};

/// Half a cell for kernels of even degree, whose cells are centred on nodes.
FIRN_HOST_DEVICE constexpr double cell_shift(int kernel_degree) { return kernel_degree % 2 == 0 ? 0.5 : 0.0; }

/// The first node of the stencil of cell k is k - stencil_reach(degree).
FIRN_HOST_DEVICE constexpr int stencil_reach(int kernel_degree) { return kernel_degree / 2; }

/// The largest distance of a position from the nodes of its stencil, along each axis [cells].
FIRN_HOST_DEVICE constexpr double kernel_reach(int kernel_degree) { return 0.5 * (kernel_degree + 1); }

/// The cell of a world position [m] and the offset in it. The cell must fit an int: see Solver::add.
template <int d>
FIRN_HOST_DEVICE CellPosition<d> locate(Lattice const& lattice, int kernel_degree,
                                        Vector<double, d> const& position)
{
    CellPosition<d> located;
    for (int a = 0; a < d; ++a) {
        double const x = (position[a] - lattice.origin[a]) / lattice.cell_size + cell_shift(kernel_degree);
        double const cell = std::floor(x);
        located.cell[a] = static_cast<int>(cell);
        located.offset[a] = x - cell - 0.5;
    }
    return located;
}

/// The position [m] of an offset in a cell, in the world where the cell lies.
template <int d>
FIRN_HOST_DEVICE Vector<double, d> world_position(Lattice const& lattice, int kernel_degree,
                                                  Coordinates<d> const& cell, Vector<double, d> const& offset)
{
    Vector<double, d> position;
    for (int a = 0; a < d; ++a) {
        double const in_cells = lattice.in_world(cell[a]) + offset[a] + (0.5 - cell_shift(kernel_degree));
        position[a] = lattice.origin[a] + lattice.cell_size * in_cells;
        if (lattice.periods[std::size_t(a)] !=
            0) { // a cell that is centred on a node reaches below the origin
            if (in_cells < 0) position[a] += lattice.period(a);
        }
    }
    return position;
}

} // namespace firn

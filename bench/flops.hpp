// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <array>
#include <cstdint>
#include <memory>

// The floating-point operations of one particle's step, counted by running the phases themselves on a number
// that counts.
namespace firn::bench
{

/// A number that counts the sums, products, quotients and roots that it is part of (exp and log count as
/// one).
template <class Number>
struct Counted
{
    Number value;
    static inline std::uint64_t operations = 0;

    Counted() = default;
    Counted(Number number) : value(number) {}

    static Counted counted(Number result)
    {
        ++operations;
        return result;
    }

    Counted& operator+=(Counted b) { return *this = *this + b; }
    Counted& operator-=(Counted b) { return *this = *this - b; }
    Counted& operator*=(Counted b) { return *this = *this * b; }
    Counted& operator/=(Counted b) { return *this = *this / b; }

    friend Counted operator+(Counted a) { return a; }
    friend Counted operator-(Counted a) { return -a.value; }
    friend Counted operator+(Counted a, Counted b) { return counted(a.value + b.value); }
    friend Counted operator-(Counted a, Counted b) { return counted(a.value - b.value); }
    friend Counted operator*(Counted a, Counted b) { return counted(a.value * b.value); }
    friend Counted operator/(Counted a, Counted b) { return counted(a.value / b.value); }
    friend Counted sqrt(Counted a) { return counted(firn::sqrt(a.value)); }
    friend Counted inverse_sqrt(Counted a) { return counted(firn::inverse_sqrt(a.value)); }
    friend Counted exp(Counted a) { return counted(firn::exp(a.value)); }
    friend Counted log(Counted a) { return counted(firn::log(a.value)); }
    friend Counted pow(Counted a, Counted b) { return counted(firn::pow(a.value, b.value)); }
    friend Counted sin(Counted a) { return counted(firn::sin(a.value)); }
    friend Counted cos(Counted a) { return counted(firn::cos(a.value)); }
    friend Counted tanh(Counted a) { return counted(firn::tanh(a.value)); }

    friend bool operator<(Counted a, Counted b) { return a.value < b.value; }
    friend bool operator>(Counted a, Counted b) { return a.value > b.value; }
    friend bool operator<=(Counted a, Counted b) { return a.value <= b.value; }
    friend bool operator>=(Counted a, Counted b) { return a.value >= b.value; }
    friend bool operator==(Counted a, Counted b) { return a.value == b.value; }
    friend bool operator!=(Counted a, Counted b) { return a.value != b.value; }
    friend bool is_below(Counted magnitude, Counted bound)
    {
        return firn::is_below(magnitude.value, bound.value);
    }
    friend Counted select(bool condition, Counted a, Counted b) { return condition ? a : b; }
    friend Counted min(Counted a, Counted b) { return firn::min(a.value, b.value); }
    friend Counted max(Counted a, Counted b) { return firn::max(a.value, b.value); }
    friend Counted abs(Counted a) { return firn::abs(a.value); }
    friend Counted floor(Counted a) { return firn::floor(a.value); }
    friend Number largest(Counted a) { return a.value; }
};

} // namespace firn::bench

template <class Number>
struct firn::LaneTraits<firn::bench::Counted<Number>>
{
    using Scalar = Number;
    using Mask = bool;
    static constexpr int width = 1;
    static firn::bench::Counted<Number> load(Number const* from) { return *from; }
    static void store(firn::bench::Counted<Number> const& lane, Number* to) { *to = lane.value; }
};

template <class Number>
struct Eigen::NumTraits<firn::bench::Counted<Number>> : Eigen::GenericNumTraits<firn::bench::Counted<Number>>
{
    using Real = firn::bench::Counted<Number>;
    using NonInteger = Real;
    using Nested = Real;
    using Literal = Real;
    enum
    {
        IsComplex = 0,
        IsInteger = 0,
        IsSigned = 1,
        RequireInitialization = 0,
        ReadCost = 1,
        AddCost = 1,
        MulCost = 1
    };
    static Real epsilon() { return Eigen::NumTraits<Number>::epsilon(); }
    static Real dummy_precision() { return Eigen::NumTraits<Number>::dummy_precision(); }
    static Real highest() { return Eigen::NumTraits<Number>::highest(); }
    static Real lowest() { return Eigen::NumTraits<Number>::lowest(); }
};

namespace firn::bench
{

/// One particle in one cell, as a phase sees it: it plays both the items and their row of cells. The nodes
/// move as a linear field.
template <class Number, int d, int scratch_channels>
struct OneParticle
{
    using Real = Counted<Number>;
    std::array<Real, scratch_channels> scratch_{};

    bool here() const { return true; }
    void set_scratch(int channel, Real value) { scratch_[std::size_t(channel)] = value; }
    Real scratch(int channel) const { return scratch_[std::size_t(channel)]; }
    Real load(Number const* array) const { return *array; }
    void store(Number* array, Real value) const { *array = value.value; }
    template <class Offset>
    Real load_offset(Offset const* array, int) const
    {
        return CellOffset<Number>::value(*array);
    }
    template <class Offset>
    bool move_offset(Offset const* from, Offset* to, int, Real displacement, Real& value) const
    {
        *to = CellOffset<Number>::moved(*from, displacement.value);
        value = CellOffset<Number>::value(*to);
        return true;
    }
    template <class T>
    void expect_load(T const*) const
    {}
    template <class T>
    void expect_store(T const*) const
    {}
    void store_at(Number*, std::uint32_t const*, Real) const {}
    template <class T>
    void copy(T const* from, T* to) const
    {
        *to = *from;
    }
    template <class Ask>
    Real map(Ask const& ask) const
    {
        return ask(0);
    }
    template <class T>
    T value(T const* array, int) const
    {
        return *array;
    }
    bool at_the_edge() const { return false; }
    Coordinates<d> first() const { return Coordinates<d>::Zero(); }
    Vector<Real, d> along() const { return Vector<Real, d>::Zero(); }
    void leave(bool, int, int) const {}
    Real const& of_cells(Real const& value) const { return value; }
    Real node(int c, int row, int k) const { return Number(0.01) * Number(1 + c + row - 2 * k); }
};

/// The phase that moves a solver's particles, without obstacles.
template <class Solver>
using MoveOf = G2p2g<typename Solver::Space, typename Solver::Model, typename Solver::kernel,
                     typename Solver::Transfer, Chain<>, typename Solver::template MaterialTraits<>::Stored,
                     typename Solver::template MaterialTraits<>::Derived>;

/// The operations of one particle in one step of gather, update and scatter, with its share of what is done
/// once per cell; the grid's own are left out.
template <class Model, class Kernel, class Transfer>
double flops_per_particle_step()
{
    using Space = typename Model::Space;
    using Number = typename Space::Scalar;
    constexpr int d = Space::dimension, particles_per_cell = 1 << d;
    using Set = typename Solver<OpenMP, Model, Kernel, Transfer>::template MaterialTraits<>::Stored;
    using Move = MoveOf<Solver<OpenMP, Model, Kernel, Transfer>>;

    typename CellOffset<Number>::Stored offset[d]{};
    auto record = Record<Number, d, Set>::at_rest();
    std::array<Number, std::size_t(Set::components(d))> state{};
    record.for_each([&](int c, Number& value) { state[std::size_t(c)] = value; });
    std::uint32_t id = 0;
    TableView<Number, d, Set> table;
    for (int a = 0; a < d; ++a) table.offset[a] = &offset[a];
    for (std::size_t c = 0; c < state.size(); ++c) table.component[c] = &state[c];
    table.id = &id;
    MassGroup<Number> const group{0, Number(1), Number(1e-3)};

    StepContext<Number, Chain<>> const now{Number(1e-5), Number(1e-5), Number(1e-5), {}};
    Move const move{{}, {}, &now, table, table, {}, {&group, 1}, lattice(0.01), Number(100), Number(1)};
    OneParticle<Number, d, Move::scratch_channels> particle;
    typename Move::Result result;
    using Real = Counted<Number>;
    struct Sums
    {
        Real of_cell[Move::Scatter::width][Move::Scatter::rows][Move::Scatter::channels];
    };
    auto const sums = std::make_unique<Sums>();
    Real::operations = 0;
    typename Move::template CellNodes<Real> nodes;
    double of_cell = 0;
    move.begin(particle);
    for (int channel = 0; channel < Move::node_channels; channel += nodes.channels) {
        auto const before = Real::operations;
        nodes.read(particle, channel);
        of_cell += double(Real::operations - before);
        Move::Gather::gather(particle, nodes, channel);
    }
    move.update(particle, result);
    Move::scatter(particle, sums->of_cell);
    return double(Real::operations) - of_cell + of_cell / particles_per_cell;
}

} // namespace firn::bench

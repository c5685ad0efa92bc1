// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/openmp/pack.hpp>

#include <concepts>

#if defined(FIRN_HAS_XSIMD)

/// Lets a pack be the scalar of an Eigen matrix.
template <class Number, class Arch>
struct Eigen::NumTraits<firn::openmp::Pack<Number, Arch>>
    : Eigen::GenericNumTraits<firn::openmp::Pack<Number, Arch>>
{
    using Real = firn::openmp::Pack<Number, Arch>;
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

// Sums and multiples of vectors and matrices of packs. Overload resolution prefers them to Eigen's operators,
// which return expressions: each is a type of its own for which a compiler generates some fifty functions,
// and deferring work gains nothing for packs, which are registers already. These operators return values. An
// Eigen expression built from one (`(a + b).transpose()`) must not outlive the line, so do not store it with
// `auto`.
namespace firn::openmp
{

namespace detail
{
template <class T>
inline constexpr bool is_matrix_of_packs = false;
template <class Number, class Arch, int rows, int columns>
inline constexpr bool is_matrix_of_packs<Eigen::Matrix<Pack<Number, Arch>, rows, columns>> =
    rows > 0 && columns > 0;
} // namespace detail

/// A vector or a matrix of packs, of a size known to the compiler.
template <class T>
concept MatrixOfPacks = detail::is_matrix_of_packs<T>;

template <MatrixOfPacks M>
M operator+(M const& a, M const& b)
{
    return made_of<M>([x = a.data(), y = b.data()](int i) { return x[i] + y[i]; });
}

template <MatrixOfPacks M>
M operator-(M const& a, M const& b)
{
    return made_of<M>([x = a.data(), y = b.data()](int i) { return x[i] - y[i]; });
}

template <MatrixOfPacks M>
M operator-(M const& a)
{
    return made_of<M>([x = a.data()](int i) { return -x[i]; });
}

template <MatrixOfPacks M, std::same_as<typename M::Scalar> Real>
M operator*(M const& a, Real const& factor)
{
    return made_of<M>([x = a.data(), factor](int i) { return x[i] * factor; });
}

template <MatrixOfPacks M, std::same_as<typename M::Scalar> Real>
M operator*(Real const& factor, M const& a)
{
    return made_of<M>([x = a.data(), factor](int i) { return factor * x[i]; });
}

template <MatrixOfPacks M, std::same_as<typename M::Scalar> Real>
M operator/(M const& a, Real const& divisor)
{
    return made_of<M>([x = a.data(), divisor](int i) { return x[i] / divisor; });
}

template <MatrixOfPacks M>
M& operator+=(M& a, M const& b)
{
    return a = a + b;
}

template <MatrixOfPacks M>
M& operator-=(M& a, M const& b)
{
    return a = a - b;
}

template <MatrixOfPacks M, std::same_as<typename M::Scalar> Real>
M& operator*=(M& a, Real const& factor)
{
    return a = a * factor;
}

} // namespace firn::openmp

#endif

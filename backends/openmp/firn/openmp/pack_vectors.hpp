// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/openmp/lanes.hpp>

#if defined(FIRN_HAS_XSIMD)

// Sums and multiples of vectors and matrices of packs, which formulas find before Eigen's own: those are
// expressions, each a type of its own that a compiler makes some fifty functions of, where packs are
// registers already and there is nothing to put off.
namespace firn::openmp
{

template <class Number, class Arch, int rows, int columns>
using PackMatrix = Eigen::Matrix<Pack<Number, Arch>, rows, columns>;

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns> operator+(PackMatrix<Number, Arch, rows, columns> const& a,
                                                  PackMatrix<Number, Arch, rows, columns> const& b)
{
    return made_of<PackMatrix<Number, Arch, rows, columns>>(
        [x = a.data(), y = b.data()](int i) { return x[i] + y[i]; });
}

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns> operator-(PackMatrix<Number, Arch, rows, columns> const& a,
                                                  PackMatrix<Number, Arch, rows, columns> const& b)
{
    return made_of<PackMatrix<Number, Arch, rows, columns>>(
        [x = a.data(), y = b.data()](int i) { return x[i] - y[i]; });
}

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns> operator*(PackMatrix<Number, Arch, rows, columns> const& a,
                                                  Pack<Number, Arch> const& factor)
{
    return made_of<PackMatrix<Number, Arch, rows, columns>>(
        [x = a.data(), factor](int i) { return x[i] * factor; });
}

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns>& operator+=(PackMatrix<Number, Arch, rows, columns>& a,
                                                    PackMatrix<Number, Arch, rows, columns> const& b)
{
    return a = a + b;
}

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns>& operator-=(PackMatrix<Number, Arch, rows, columns>& a,
                                                    PackMatrix<Number, Arch, rows, columns> const& b)
{
    return a = a - b;
}

template <class Number, class Arch, int rows, int columns>
PackMatrix<Number, Arch, rows, columns>& operator*=(PackMatrix<Number, Arch, rows, columns>& a,
                                                    Pack<Number, Arch> const& factor)
{
    return a = a * factor;
}

} // namespace firn::openmp

#endif

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

// Matrices of every kind that breaks singular value decompositions, and their way into lanes and back.
namespace firn::test
{

template <int d>
using Exact = Eigen::Matrix<double, d, d>;

template <int d>
using ExactVector = Eigen::Matrix<double, d, 1>;

/// The matrix of one lane.
template <class Real, int rows, int columns>
Eigen::Matrix<double, rows, columns> matrix_of(Eigen::Matrix<Real, rows, columns> const& F, int lane)
{
    Eigen::Matrix<double, rows, columns> out;
    for (int i = 0; i < F.size(); ++i) {
        ScalarOf<Real> numbers[lane_width<Real>] = {};
        LaneTraits<Real>::store(F(i), numbers);
        out(i) = numbers[lane];
    }
    return out;
}

/// One matrix per lane.
template <class Real, int d>
Matrix<Real, d> pack(std::vector<Exact<d>> const& matrices)
{
    Matrix<Real, d> out;
    for (int i = 0; i < d * d; ++i) {
        ScalarOf<Real> numbers[lane_width<Real>] = {};
        for (std::size_t lane = 0; lane < matrices.size(); ++lane)
            numbers[lane] = static_cast<ScalarOf<Real>>(matrices[lane](i));
        if constexpr (lane_width<Real> == 1)
            out(i) = numbers[0];
        else
            out(i) = Real::load(numbers);
    }
    return out;
}

/// What lanes of a type find of any number of matrices, a lane's worth at a time: `read(found, lane)` of
/// each, where found = find(matrices of one lane's worth). So what tests compare is compiled once, not for
/// every type.
template <class Real, int d, class Find, class Read>
auto found_by(std::vector<Exact<d>> const& all, Find find, Read read)
{
    std::vector<decltype(read(find(Matrix<Real, d>()), 0))> found;
    found.reserve(all.size());
    for (std::size_t i = 0; i < all.size(); i += lane_width<Real>) {
        std::vector<Exact<d>> matrices(lane_width<Real>, Exact<d>::Zero());
        std::size_t const count = std::min(matrices.size(), all.size() - i);
        for (std::size_t lane = 0; lane < count; ++lane) matrices[lane] = all[i + lane];
        auto const result = find(pack<Real, d>(matrices));
        for (std::size_t lane = 0; lane < count; ++lane)
            found.push_back(read(result, static_cast<int>(lane)));
    }
    return found;
}

/// Whether lanes hold floats.
template <class Real>
constexpr bool is_single = sizeof(ScalarOf<Real>) == 4;

/// A matrix as rounded to a precision.
template <int d>
Exact<d> rounded_to(bool single, Exact<d> const& matrix)
{
    return single ? Exact<d>(matrix.template cast<float>().template cast<double>()) : matrix;
}

template <int d>
class Source
{
public:
    double normal() { return normal_(generator_); }
    int index() { return static_cast<int>(generator_() % d); }
    Exact<d> any()
    {
        return Exact<d>::NullaryExpr([&] { return normal(); });
    }
    Exact<d> rotation()
    {
        if constexpr (d == 2)
            return Eigen::Rotation2Dd(std::atan2(normal(), normal())).toRotationMatrix();
        else
            return Eigen::Quaterniond(Eigen::Vector4d::NullaryExpr([&] { return normal(); }))
                .normalized()
                .matrix();
    }
    Exact<d> turned(Exact<d> const& D)
    {
        Exact<d> const U = rotation();
        return U * D * rotation();
    }
    Exact<d> permutation()
    {
        Exact<d> P = Exact<d>::Zero();
        int const shift = index();
        bool const turn = index() == 0;
        for (int i = 0; i < d; ++i) P(i, ((turn ? d - i : i) + shift) % d) = index() == 0 ? -1 : i + 1;
        return P;
    }

private:
    std::mt19937_64 generator_{7};
    std::normal_distribution<double> normal_;
};

template <int d>
struct Kind
{
    char const* name;
    std::function<Exact<d>(Source<d>&)> make;
};

/// diag(a, b, c), or diag(b, c) in the plane: one list serves both.
template <int d>
Exact<d> diagonal(double a, double b, double c)
{
    return Eigen::Vector3d(a, b, c).template tail<d>().asDiagonal();
}

// clang-format off
template <int d>
std::vector<Kind<d>> kinds()
{
    using S = Source<d>;
    using E = Exact<d>;
    E const one = E::Identity(), reflection = diagonal<d>(1, 1, -1), axis = diagonal<d>(0, 0, 1);
    return {
        {"near the identity", [=](S& s) { return E(one + 0.1 * s.any()); }},
        {"random", [](S& s) { return s.any(); }},
        {"rotation", [](S& s) { return s.rotation(); }},
        {"identity", [=](S&) { return one; }},
        {"zero", [](S&) { return E(E::Zero()); }},
        {"rank one", [](S& s) { return E(s.any().col(0) * s.any().row(0)); }},
        {"rank one, turned", [=](S& s) { return s.turned(axis); }},
        {"rank two", [](S& s) { return s.turned(diagonal<d>(0, 1, 0.5)); }},
        {"one column", [=](S& s) { return E(s.any() * s.permutation() * axis); }},
        {"one row", [=](S& s) { return E(axis * s.permutation() * s.any()); }},
        {"inverted", [=](S&) { return reflection; }},
        {"inverted and turned", [=](S& s) { return E(s.rotation() * reflection); }},
        {"minus the identity", [=](S&) { return E(-one); }},
        {"badly conditioned", [](S& s) { return s.turned(diagonal<d>(1, 1e-3, 1e-6)); }},
        {"very badly conditioned", [](S& s) { return s.turned(diagonal<d>(1, 1e-7, 1e-14)); }},
        {"repeated", [](S& s) { return s.turned(diagonal<d>(1, 1 + 1e-6 * s.normal(), 1 + 1e-6 * s.normal())); }},
        {"large", [](S& s) { return E(1e15 * s.any()); }},
        {"small", [](S& s) { return E(1e-15 * s.any()); }},
        {"of any size", [](S& s) { return E(std::pow(10., 4 * s.normal()) * s.any()); }},
        {"permutation", [](S& s) { return s.permutation(); }},
        {"nearly symmetric", [](S& s) { E const F = s.any(); return E(F + F.transpose() + 1e-8 * s.any()); }},
        {"sheared far", [=](S& s) { return E(one + 1e3 * s.normal() * axis * s.permutation()); }},
        {"unequal columns", [](S& s) { return E(s.any() * diagonal<d>(1e4, 1, 1e-6) * s.permutation()); }},
    };
}
// clang-format on

} // namespace firn::test

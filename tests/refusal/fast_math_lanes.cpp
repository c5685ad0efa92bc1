// SPDX-License-Identifier: MIT
// As fast_math.cpp, for lanes alone: it compiles quickly, and with compilers that cannot compile more.
#include <firn/openmp/native_lane.hpp>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>

namespace
{

// from bits, and unknown to the compiler
std::uint64_t volatile bits_of_nan = 0x7ff8000000000000, bits_of_infinity = 0x7ff0000000000000;
double const nan = std::bit_cast<double>(std::uint64_t(bits_of_nan));
double const infinity = std::bit_cast<double>(std::uint64_t(bits_of_infinity));

int failures = 0;

void check(bool holds, char const* what, char const* of)
{
    if (holds) return;
    ++failures;
    std::printf("does not hold: %s of %s\n", what, of);
}

/// The first lane is NaN and the last one of several infinite; all others are 1.
template <class Real>
void check_guards(char const* name)
{
    using firn::abs, firn::bits, firn::is_below;
    using Number = firn::ScalarOf<Real>;
    constexpr int width = firn::lane_width<Real>;
    Number values[width];
    for (Number& value : values) value = 1;
    if (width > 1) values[width - 1] = Number(infinity);
    values[0] = Number(nan);
    Real const value = firn::LaneTraits<Real>::load(values), largest(std::numeric_limits<Number>::max());
    std::uint64_t finite = 0;
    for (int i = 1; i < width - 1; ++i) finite |= std::uint64_t{1} << i;
    check(bits(is_below(abs(value), largest)) == finite, "what is finite", name);
    // clang carries its assumptions about sums into their bits
    check(bits(is_below(abs(value + value), Real(Number(2.5)))) == finite, "a sum below a bound", name);
    check(bits(is_below(abs(value), Real(Number(1)))) == 0, "what is not below 1", name);
    check(!firn::is_finite(values[0]) && !firn::is_finite(values[0] + Number(1)), "NaN", name);
    check(!firn::is_number(values[0]) && firn::is_number(Number(infinity)), "a number", name);
    check(!firn::is_finite(Number(infinity)) && firn::is_finite(std::numeric_limits<Number>::max()),
          "infinity", name);
}

/// Functions keep their digits, but for a few units in the last place that reassociation costs.
template <class Real>
void check_functions(char const* name)
{
    using firn::cos, firn::exp, firn::floor, firn::inverse_sqrt, firn::log, firn::pow, firn::sin, firn::tanh;
    using Number = firn::ScalarOf<Real>;
    double const most = 64 * double(std::numeric_limits<Number>::epsilon());
    auto const first = [](Real lanes) {
        Number numbers[firn::lane_width<Real>];
        firn::LaneTraits<Real>::store(lanes, numbers);
        return double(numbers[0]);
    };
    auto const near = [&](double is, double should, char const* what) {
        check(std::abs(is - should) <= most * std::abs(should), what, name);
    };
    for (double const number : {-31.4, -3.3, -0.1, 0.3, 5.7, 40.1}) {
        Number const x = Number(number);
        near(first(exp(Real(x))), std::exp(double(x)), "exp");
        near(first(floor(Real(x))), std::floor(double(x)), "floor");
        near(first(sin(Real(x))), std::sin(double(x)), "sin");
        near(first(cos(Real(x))), std::cos(double(x)), "cos");
        near(first(tanh(Real(x))), std::tanh(double(x)), "tanh");
        Number const positive = std::abs(x);
        near(first(log(Real(positive))), std::log(double(positive)), "log");
        near(first(pow(Real(positive), Real(Number(1.3)))), std::pow(double(positive), double(Number(1.3))),
             "pow");
        near(first(inverse_sqrt(Real(positive))), 1 / std::sqrt(double(positive)), "inverse_sqrt");
        check(first(-Real(x)) == -double(x), "the negative", name);
    }
}

template <class Real>
void check_lanes(char const* name)
{
    check_guards<Real>(name);
    check_functions<Real>(name);
}

} // namespace

int main()
{
    check_lanes<float>("numbers of single precision");
    check_lanes<double>("numbers of double precision");
#if defined(FIRN_HAS_XSIMD)
    check_lanes<firn::openmp::NativePack<float>>("packs of single precision");
    check_lanes<firn::openmp::NativePack<double>>("packs of double precision");
#endif
    return failures == 0 ? 0 : 1;
}

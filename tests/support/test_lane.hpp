// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace firn::test
{

/// One truth value per number of a TestLane; refuses `if (mask)`.
template <int width>
struct TestMask
{
    std::array<bool, width> value{};

    explicit operator bool() const = delete;

    friend TestMask operator!(TestMask a)
    {
        for (auto& x : a.value) x = !x;
        return a;
    }
    friend TestMask operator&(TestMask a, TestMask b)
    {
        for (std::size_t i = 0; i < width; ++i) a.value[i] = a.value[i] && b.value[i];
        return a;
    }
    friend TestMask operator|(TestMask a, TestMask b)
    {
        for (std::size_t i = 0; i < width; ++i) a.value[i] = a.value[i] || b.value[i];
        return a;
    }
    friend std::uint64_t bits(TestMask a)
    {
        std::uint64_t found = 0;
        for (std::size_t i = 0; i < width; ++i) found |= std::uint64_t{a.value[i]} << i;
        return found;
    }
    friend bool any(TestMask a) { return bits(a) != 0; }
    friend bool all(TestMask a) { return bits(a) == (std::uint64_t{1} << width) - 1; }
    static TestMask from_bits(std::uint64_t pattern)
    {
        TestMask made;
        for (std::size_t i = 0; i < width; ++i) made.value[i] = (pattern >> i) & 1;
        return made;
    }
};

/// A lane of `width` numbers in a plain array, for tests: each number goes through exactly what the scalar
/// lane would do to it, so results must agree bit by bit, and code that branches on a value does not compile.
template <class Number, int lanes = 4>
struct TestLane
{
    using Mask = TestMask<lanes>;
    static constexpr int width = lanes;

    std::array<Number, lanes> value;

    TestLane() = default;
    TestLane(Number number) { value.fill(number); }

    /// The number in lane `i`.
    Number operator[](int i) const { return value[static_cast<std::size_t>(i)]; }
    Number& operator[](int i) { return value[static_cast<std::size_t>(i)]; }

    static TestLane load(Number const* from)
    {
        return make([&](std::size_t i) { return from[i]; });
    }
    static TestLane gather(Number const* base, std::int32_t const* index)
    {
        return make([&](std::size_t i) { return base[index[i]]; });
    }
    void store(Number* to) const
    {
        for (Number x : value) *to++ = x;
    }

    TestLane& operator+=(TestLane b) { return *this = *this + b; }
    TestLane& operator-=(TestLane b) { return *this = *this - b; }
    TestLane& operator*=(TestLane b) { return *this = *this * b; }
    TestLane& operator/=(TestLane b) { return *this = *this / b; }

    // clang-format off
    friend TestLane operator+(TestLane a) { return a; }
    friend TestLane operator-(TestLane a) { return make([&](auto i) { return -a.value[i]; }); }
    friend TestLane operator+(TestLane a, TestLane b) { return make([&](auto i) { return a.value[i] + b.value[i]; }); }
    friend TestLane operator-(TestLane a, TestLane b) { return make([&](auto i) { return a.value[i] - b.value[i]; }); }
    friend TestLane operator*(TestLane a, TestLane b) { return make([&](auto i) { return a.value[i] * b.value[i]; }); }
    friend TestLane operator/(TestLane a, TestLane b) { return make([&](auto i) { return a.value[i] / b.value[i]; }); }

    friend Mask operator<(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] < b.value[i]; }); }
    friend Mask operator>(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] > b.value[i]; }); }
    friend Mask operator<=(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] <= b.value[i]; }); }
    friend Mask operator>=(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] >= b.value[i]; }); }
    friend Mask operator==(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] == b.value[i]; }); }
    friend Mask operator!=(TestLane a, TestLane b) { return compare([&](auto i) { return a.value[i] != b.value[i]; }); }

    friend Mask is_below(TestLane a, TestLane b) { return compare([&](auto i) { return firn::is_below(a.value[i], b.value[i]); }); }

    friend TestLane select(Mask m, TestLane a, TestLane b) { return make([&](auto i) { return m.value[i] ? a.value[i] : b.value[i]; }); }
    friend TestLane min(TestLane a, TestLane b) { return make([&](auto i) { return firn::min(a.value[i], b.value[i]); }); }
    friend TestLane max(TestLane a, TestLane b) { return make([&](auto i) { return firn::max(a.value[i], b.value[i]); }); }
    friend TestLane abs(TestLane a) { return make([&](auto i) { return firn::abs(a.value[i]); }); }
    friend TestLane sqrt(TestLane a) { return make([&](auto i) { return firn::sqrt(a.value[i]); }); }
    friend TestLane exp(TestLane a) { return make([&](auto i) { return firn::exp(a.value[i]); }); }
    friend TestLane log(TestLane a) { return make([&](auto i) { return firn::log(a.value[i]); }); }
    friend TestLane pow(TestLane a, TestLane b) { return make([&](auto i) { return firn::pow(a.value[i], b.value[i]); }); }
    friend TestLane sin(TestLane a) { return make([&](auto i) { return firn::sin(a.value[i]); }); }
    friend TestLane cos(TestLane a) { return make([&](auto i) { return firn::cos(a.value[i]); }); }
    friend TestLane tanh(TestLane a) { return make([&](auto i) { return firn::tanh(a.value[i]); }); }
    friend TestLane floor(TestLane a) { return make([&](auto i) { return firn::floor(a.value[i]); }); }
    friend TestLane inverse_sqrt(TestLane a) { return make([&](auto i) { return firn::inverse_sqrt(a.value[i]); }); }
    // clang-format on

    friend Number largest(TestLane a)
    {
        Number found = a.value[0];
        for (Number x : a.value) {
            if (x != x) return x;
            found = firn::max(found, x);
        }
        return found;
    }

private:
    template <class Function>
    static TestLane make(Function function)
    {
        TestLane made;
        for (std::size_t i = 0; i < lanes; ++i) made.value[i] = function(i);
        return made;
    }

    template <class Function>
    static Mask compare(Function function)
    {
        Mask made;
        for (std::size_t i = 0; i < lanes; ++i) made.value[i] = function(i);
        return made;
    }
};

} // namespace firn::test

template <class Number, int lanes>
struct firn::LaneTraits<firn::test::TestLane<Number, lanes>>
{
    using Scalar = Number;
    using Mask = firn::test::TestMask<lanes>;
    static constexpr int width = lanes;

    static firn::test::TestLane<Number, lanes> load(Number const* from)
    {
        return firn::test::TestLane<Number, lanes>::load(from);
    }
    static void store(firn::test::TestLane<Number, lanes> const& lane, Number* to) { lane.store(to); }
};

/// Lets a test lane be the scalar of an Eigen matrix.
template <class Number, int lanes>
struct Eigen::NumTraits<firn::test::TestLane<Number, lanes>>
    : Eigen::GenericNumTraits<firn::test::TestLane<Number, lanes>>
{
    using Real = firn::test::TestLane<Number, lanes>;
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

static_assert(firn::Lane<firn::test::TestLane<float>> && firn::Lane<firn::test::TestLane<double>>);

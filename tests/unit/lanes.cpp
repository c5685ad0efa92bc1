// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/test_lane.hpp"

#include <firn/openmp/compress.hpp>
#include <firn/openmp/indirect_load.hpp>
#include <firn/openmp/native_lane.hpp>
#include <firn/openmp/offset_lane.hpp>
#include <firn/openmp/permutation.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>
#include <type_traits>
#include <vector>

#if __has_include(<xsimd/xsimd.hpp>)

namespace
{

using namespace firn;
using openmp::NativePack;
using openmp::PackOf;

#if defined(__AVX512F__)
using Packs = std::tuple<NativePack<float>, NativePack<double>, PackOf<float, 8>, PackOf<double, 4>,
                         PackOf<float, 4>, PackOf<double, 2>>;
static_assert(lane_width<NativePack<float>> == 16 && lane_width<NativePack<double>> == 8);
#elif defined(__AVX__)
using Packs = std::tuple<NativePack<float>, NativePack<double>, PackOf<float, 4>, PackOf<double, 2>>;
static_assert(lane_width<NativePack<float>> == 8 && lane_width<NativePack<double>> == 4);
#else
using Packs = std::tuple<NativePack<float>, NativePack<double>>;
#endif

template <class Number>
using Limits = std::numeric_limits<Number>;

/// Zeros, denormals, infinities, NaN, and numbers of every size; a multiple of every pack's width.
template <class Number>
std::vector<Number> numbers()
{
    Number const inf = Limits<Number>::infinity(), tiny = Limits<Number>::denorm_min();
    std::vector<Number> all{0,
                            Number(-0.0),
                            inf,
                            -inf,
                            Limits<Number>::quiet_NaN(),
                            tiny,
                            -tiny,
                            Limits<Number>::min(),
                            Limits<Number>::min() / 3,
                            Limits<Number>::max(),
                            Limits<Number>::lowest(),
                            Limits<Number>::epsilon(),
                            1,
                            -1,
                            Number(0.5),
                            Number(2.5),
                            Number(-2.5),
                            Number(1e9),
                            Number(-1e9),
                            Number(4e9),
                            1 - Limits<Number>::epsilon()};
    std::mt19937_64 generator(11);
    std::uniform_real_distribution<double> size(Limits<Number>::min_exponent10,
                                                Limits<Number>::max_exponent10);
    std::normal_distribution<double> plain;
    while (all.size() < 40000) {
        all.push_back(static_cast<Number>(std::pow(10, size(generator)) * (generator() % 2 ? 1 : -1)));
        all.push_back(static_cast<Number>(10 * plain(generator)));
    }
    return all;
}

template <class Number>
bool same_bits(Number a, Number b)
{
    using Bits = std::conditional_t<sizeof(Number) == 4, std::uint32_t, std::uint64_t>;
    return (std::isnan(a) && std::isnan(b)) || std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b);
}

/// Distance in units of the last place of `expected`; 0 if both are NaN or the same infinity.
template <class Number>
double distance(Number found, double expected)
{
    if (std::isnan(expected) || std::isnan(found))
        return std::isnan(expected) && std::isnan(found) ? 0 : 1e30;
    if (double(found) == expected) return 0;
    if (std::isinf(expected) || std::isinf(found)) return 1e30;
    int exponent = 0;
    std::frexp(std::max(std::abs(expected), double(Limits<Number>::min())), &exponent);
    return std::abs(found - expected) / std::ldexp(1.0, exponent - Limits<Number>::digits);
}

/// The largest distance between a pack's function and a scalar one, over all numbers that `wanted` accepts.
template <class Pack, class OfPack, class OfNumber, class Wanted>
double worst(OfPack of_pack, OfNumber of_number, Wanted wanted)
{
    using Number = ScalarOf<Pack>;
    auto const all = numbers<Number>();
    double found = 0;
    for (std::size_t i = 0; i + Pack::width <= all.size(); i += Pack::width) {
        Number results[Pack::width];
        of_pack(Pack::load(&all[i])).store(results);
        for (std::size_t lane = 0; lane < Pack::width; ++lane) {
            Number const x = all[i + lane];
            if (wanted(x)) found = std::max(found, distance(results[lane], double(of_number(x))));
        }
    }
    return found;
}

/// Calls `check(pack a, pack b, numbers a, numbers b)` for many pairs.
template <class Pack, class Check>
void for_pairs(Check check)
{
    auto const all = numbers<ScalarOf<Pack>>();
    for (std::size_t shift : {0, 1, 2, 3, 5, 7, 11, 13, 17, 19, 301}) {
        for (std::size_t i = 0; i + shift + Pack::width <= 400; i += Pack::width)
            check(Pack::load(&all[i]), Pack::load(&all[i + shift]), &all[i], &all[i + shift]);
    }
}

template <class Pack, class OfPack, class OfNumber>
bool agrees(OfPack of_pack, OfNumber of_number)
{
    bool same = true;
    for_pairs<Pack>([&](Pack a, Pack b, auto const* x, auto const* y) {
        ScalarOf<Pack> results[Pack::width];
        of_pack(a, b).store(results);
        for (int i = 0; i < Pack::width; ++i) same = same && same_bits(results[i], of_number(x[i], y[i]));
    });
    return same;
}

template <class Pack, class OfPack, class OfNumber>
bool mask_agrees(OfPack of_pack, OfNumber of_number)
{
    bool same = true;
    for_pairs<Pack>([&](Pack a, Pack b, auto const* x, auto const* y) {
        std::uint64_t expected = 0;
        for (int i = 0; i < Pack::width; ++i) expected |= std::uint64_t{bool(of_number(x[i], y[i]))} << i;
        same = same && bits(of_pack(a, b)) == expected;
    });
    return same;
}

auto const everything = [](auto) { return true; };

template <class Mask>
concept Branchable = requires(Mask mask)
{
    mask ? 1 : 0;
};

} // namespace

TEMPLATE_LIST_TEST_CASE("A pack computes what its numbers would, bit by bit", "", Packs)
{
    auto const check = [](auto f) { return agrees<TestType>(f, f); };
    CHECK(check([](auto a, auto b) { return a + b; }));
    CHECK(check([](auto a, auto b) { return a - b; }));
    CHECK(check([](auto a, auto b) { return a * b; }));
    CHECK(check([](auto a, auto b) { return a / b; }));
    CHECK(check([](auto a, auto) { return -a; }));
    CHECK(check([](auto a, auto) { return sqrt(a); }));
    CHECK(check([](auto a, auto) { return abs(a); }));
    CHECK(check([](auto a, auto b) { return min(a, b); }));
    CHECK(check([](auto a, auto b) { return max(a, b); }));
    CHECK(check([](auto a, auto b) { return select(a < b, a, b); }));
}

TEMPLATE_LIST_TEST_CASE("A pack compares as its numbers would, NaN included", "", Packs)
{
    auto const check = [](auto f) { return mask_agrees<TestType>(f, f); };
    CHECK(check([](auto a, auto b) { return a < b; }));
    CHECK(check([](auto a, auto b) { return a > b; }));
    CHECK(check([](auto a, auto b) { return a <= b; }));
    CHECK(check([](auto a, auto b) { return a >= b; }));
    CHECK(check([](auto a, auto b) { return a == b; }));
    CHECK(check([](auto a, auto b) { return a != b; }));
    CHECK(check([](auto a, auto b) { return !(a < b); }));
    CHECK(check([](auto a, auto b) { return (a < b) & (b > decltype(b)(0)); }));
    CHECK(check([](auto a, auto b) { return (a < b) | (a == a); }));
}

TEST_CASE("The logarithm of every positive float is off by one unit of the last place at most", "[.full]")
{
    using Pack = NativePack<float>;
    double most = 0;
    std::uint32_t const infinity = std::bit_cast<std::uint32_t>(Limits<float>::infinity());
    for (std::uint32_t first = 1; first < infinity; first += lane_width<Pack>) {
        float x[lane_width<Pack>], found[lane_width<Pack>];
        for (int l = 0; l < lane_width<Pack>; ++l)
            x[l] = std::bit_cast<float>(std::min(first + std::uint32_t(l), infinity - 1));
        log(Pack::load(x)).store(found);
        for (int l = 0; l < lane_width<Pack>; ++l) {
            double const exact = std::log(double(x[l]));
            int exponent = 0;
            std::frexp(float(exact), &exponent);
            most = std::max(most, std::abs(double(found[l]) - exact) / std::ldexp(1.0, exponent - 24));
        }
    }
    CHECK(most <= 1);
    WARN("units of the last place: " << most);
}

TEMPLATE_LIST_TEST_CASE("Functions of a pack are exact to two units of the last place", "", Packs)
{
    using N = ScalarOf<TestType>;
    CHECK(worst<TestType>([](auto x) { return log(x); }, [](N x) { return std::log(x); }, everything) <= 2);
    CHECK(worst<TestType>([](auto x) { return floor(x); }, [](N x) { return std::floor(x); }, everything) ==
          0);
    // results that are denormal come out as zero, those near the largest number as infinity
    double const lowest = std::log(double(Limits<N>::min())) + 1e-3, highest = -lowest + 1;
    CHECK(worst<TestType>([](auto x) { return exp(x); }, [](N x) { return std::exp(x); },
                          [=](N x) { return !(x < lowest || x > highest) || std::isinf(x); }) <= 2);
    CHECK(worst<TestType>([](auto x) { return exp(x); },
                          [](N x) { return x < 0 ? N(0) : Limits<N>::infinity(); },
                          [=](N x) { return x < lowest - 1 || x > highest + 1; }) == 0);
}

TEMPLATE_LIST_TEST_CASE("Sines, cosines and hyperbolic tangents are exact to two units of the last place", "",
                        Packs)
{
    using N = ScalarOf<TestType>;
    CHECK(worst<TestType>([](auto x) { return sin(x); }, [](N x) { return std::sin(double(x)); },
                          everything) <= 2);
    CHECK(worst<TestType>([](auto x) { return cos(x); }, [](N x) { return std::cos(double(x)); },
                          everything) <= 2);
    CHECK(worst<TestType>([](auto x) { return tanh(x); }, [](N x) { return std::tanh(double(x)); },
                          everything) <= 3); // the C library itself is off by up to two for doubles
    // and where angles are reduced most: close to multiples of a right angle, up to the bound and beyond
    double found = 0;
    for (int n = -540000; n + TestType::width < 540000; n += 7 * TestType::width) {
        N x[TestType::width], sines[TestType::width], cosines[TestType::width];
        for (int l = 0; l < TestType::width; ++l) x[l] = N((n + l) * 1.57079632679489661923);
        sin(TestType::load(x)).store(sines);
        cos(TestType::load(x)).store(cosines);
        for (int l = 0; l < TestType::width; ++l) {
            found = std::max(found, distance(sines[l], std::sin(double(x[l]))));
            found = std::max(found, distance(cosines[l], std::cos(double(x[l]))));
        }
    }
    CHECK(found <= 2);
    N zeros[TestType::width], results[TestType::width];
    for (N& each : zeros) each = N(-0.0);
    for (auto const& of_zero : {sin(TestType::load(zeros)), tanh(TestType::load(zeros))}) {
        of_zero.store(results);
        for (N result : results) CHECK(same_bits(result, N(-0.0)));
    }
}

TEMPLATE_LIST_TEST_CASE("Powers are exact to two units of the last place, denormal ones included", "", Packs)
{
    using N = ScalarOf<TestType>;
    for (N const y : {N(0.5), N(-0.5), N(2), N(-1), N(3), N(1) / 3, N(7.25), N(-12.1), N(0.001), N(-60)}) {
        CAPTURE(y);
        CHECK(worst<TestType>([=](auto x) { return pow(x, y); },
                              [=](N x) { return N(std::pow(double(x), double(y))); }, everything) <= 2);
    }
    for (N const x : {N(0.5), N(0.999), N(1.001), N(1.7), N(2), N(10), N(1e-30)}) {
        CAPTURE(x);
        CHECK(worst<TestType>([=](auto y) { return pow(x, y); },
                              [=](N y) { return N(std::pow(double(x), double(y))); }, everything) <= 2);
    }
}

TEMPLATE_LIST_TEST_CASE("Powers of zeros, infinities, NaN and negative numbers are as std::pow has them", "",
                        Packs)
{
    using N = ScalarOf<TestType>;
    N const odd = N(std::ldexp(1, Limits<N>::digits) - 1), even = odd + 1; // the largest odd number
    std::vector<N> const special{N(0.0),
                                 Limits<N>::infinity(),
                                 Limits<N>::quiet_NaN(),
                                 Limits<N>::denorm_min(),
                                 Limits<N>::min(),
                                 Limits<N>::max(),
                                 N(0.25),
                                 N(0.5),
                                 N(1) - Limits<N>::epsilon(),
                                 N(1),
                                 N(1) + Limits<N>::epsilon(),
                                 N(2),
                                 N(2.5),
                                 N(3),
                                 odd,
                                 even};
    for (N const base : special)
        for (N const exponent : special)
            for (int signs = 0; signs < 4; ++signs) {
                N const x = signs & 1 ? -base : base, y = signs & 2 ? -exponent : exponent;
                N const expected = std::pow(x, y);
                CAPTURE(x, y, expected);
                N found[TestType::width];
                pow(TestType(x), TestType(y)).store(found);
                CHECK(std::signbit(found[0]) * !std::isnan(expected) ==
                      std::signbit(expected) * !std::isnan(expected));
                CHECK(distance(found[0], double(expected)) <= 2);
            }
}

TEMPLATE_LIST_TEST_CASE("Functions of a number have the same bits in any pack and beside any numbers", "",
                        Packs)
{
    using N = ScalarOf<TestType>;
    using Narrow = PackOf<N, 16 / sizeof(N)>;
    auto const all = numbers<N>();
    std::size_t const count = all.size() - all.size() % TestType::width;
    auto const check = [&](auto const& function) {
        std::vector<N> wide(count), narrow(count);
        for (std::size_t i = 0; i < count; i += TestType::width)
            function(TestType::load(&all[i])).store(&wide[i]);
        std::vector<N> backwards(all.rbegin() + std::ptrdiff_t(all.size() - count), all.rend());
        for (std::size_t i = 0; i < count; i += Narrow::width)
            function(Narrow::load(&backwards[i])).store(&narrow[i]);
        int different = 0;
        for (std::size_t i = 0; i < count; ++i) different += !same_bits(wide[i], narrow[count - 1 - i]);
        CHECK(different == 0);
    };
    check([](auto x) { return sin(x); });
    check([](auto x) { return cos(x); });
    check([](auto x) { return tanh(x); });
    check([](auto x) { return pow(x, x); });
    check([](auto x) { return pow(x, N(-1.3)); });
    check([](auto x) { return pow(N(1.3), x); });
}

TEMPLATE_LIST_TEST_CASE("The inverse square root is exact to 2e-7 for every number, denormal ones included",
                        "", Packs)
{
    using N = ScalarOf<TestType>;
    std::vector<N> const all = numbers<N>();
    double error = 0;
    int wrong = 0;
    for (std::size_t i = 0; i + TestType::width <= all.size(); i += TestType::width) {
        N results[TestType::width];
        inverse_sqrt(TestType::load(&all[i])).store(results);
        for (std::size_t lane = 0; lane < TestType::width; ++lane) {
            N const x = all[i + lane], found = results[lane];
            double const expected = 1 / std::sqrt(double(x));
            if (std::isfinite(expected) && expected > 0)
                error = std::max(error, std::abs(found / expected - 1));
            else
                wrong += std::isnan(expected) ? !std::isnan(found) : found != N(expected);
        }
    }
    CHECK(error <= (sizeof(N) == 4 ? 2e-7 : 4e-16));
    CHECK(wrong == 0);
}

TEMPLATE_LIST_TEST_CASE("A mask has one bit per lane, comes back from its bits, and is no branch", "", Packs)
{
    using M = Mask<TestType>;
    constexpr std::uint64_t full = (std::uint64_t{1} << TestType::width) - 1;
    for (std::uint64_t i = 0; i < 100; ++i) {
        std::uint64_t const pattern = i < 2 ? i * full : 0x9e3779b97f4a7c15u * i & full;
        M const mask = M::from_bits(pattern | ~full); // bits beyond the width are ignored
        CHECK(bits(mask) == pattern);
        CHECK(bits(!mask) == (full & ~pattern));
        CHECK(any(mask) == (pattern != 0));
        CHECK(all(mask) == (pattern == full));
        CHECK(bits(select(mask, TestType(1), TestType(0)) > TestType(0)) == pattern);
    }
    STATIC_REQUIRE(!std::is_convertible_v<M, bool>);
    STATIC_REQUIRE(!Branchable<M>);
    STATIC_REQUIRE(!Branchable<Mask<test::TestLane<float>>>);
    STATIC_REQUIRE(Branchable<Mask<float>>);
}

TEMPLATE_LIST_TEST_CASE("The largest number of a pack is found in every lane, and NaN wins", "", Packs)
{
    using N = ScalarOf<TestType>;
    for (int i = 0; i < TestType::width; ++i) {
        std::vector<N> lanes(TestType::width);
        for (int j = 0; j < TestType::width; ++j) lanes[j] = N(-1 - (i + j) % TestType::width);
        CHECK(largest(TestType::load(lanes.data())) == -1);
        lanes[i] = Limits<N>::quiet_NaN();
        CHECK(std::isnan(largest(TestType::load(lanes.data()))));
    }
}

TEMPLATE_LIST_TEST_CASE("Numbers are gathered from anywhere", "", Packs)
{
    using N = ScalarOf<TestType>;
    auto const all = numbers<N>();
    std::vector<std::int32_t> index(TestType::width);
    for (int i = 0; i < TestType::width; ++i) index[i] = (7919 * i + 25) % 40000;
    N results[TestType::width];
    TestType::gather(all.data(), index.data()).store(results);
    for (int i = 0; i < TestType::width; ++i) CHECK(same_bits(results[i], all[index[i]]));
}

TEMPLATE_LIST_TEST_CASE("A window over two packs has the end of one and the beginning of the other", "",
                        Packs)
{
    using Number = typename TestType::Number;
    constexpr int width = TestType::width;
    Number both[2 * width], found[width];
    for (int i = 0; i < 2 * width; ++i) both[i] = Number(i + 1);
    auto const low = TestType::load(both), high = TestType::load(both + width);
    auto const check = [&](auto first) {
        TestType::template window<first>(low, high).store(found);
        for (int l = 0; l < width; ++l) CHECK(found[l] == both[first + l]);
    };
    check(std::integral_constant<int, 0>{});
    check(std::integral_constant<int, 1>{});
    check(std::integral_constant<int, width - 1>{});
}

TEMPLATE_LIST_TEST_CASE("The first numbers alone are loaded and stored", "", Packs)
{
    using Number = typename TestType::Number;
    constexpr int width = TestType::width;
    for (int count = 0; count <= width; ++count) {
        // There are exactly `count` numbers: a sanitizer sees reads and writes beyond.
        std::vector<Number> from(std::size_t(count), Number(3)), to(std::size_t(count), Number(0));
        auto const pack = TestType::load_first(count, from.data());
        Number all[width];
        pack.store(all);
        for (int l = 0; l < width; ++l) CHECK(all[l] == Number(l < count ? 3 : 0));
        pack.store_first(count, to.data());
        CHECK(to == from);
    }
}

TEMPLATE_LIST_TEST_CASE("Of the first integers the last is there once more in each lane beyond", "", Packs)
{
    constexpr int width = TestType::width;
    for (int count = 1; count <= width; ++count) {
        std::vector<std::uint32_t> from(static_cast<std::size_t>(count)); // no more: see above
        std::iota(from.begin(), from.end(), 7u);
        std::uint32_t to[width];
        openmp::copy_first<width>(from.data(), count, to);
        for (int l = 0; l < width; ++l) CHECK(to[l] == 7u + std::uint32_t(std::min(l, count - 1)));
        openmp::count_up<width>(7u, to);
        for (int l = 0; l < width; ++l) CHECK(to[l] == 7u + std::uint32_t(l));
    }
}

TEMPLATE_LIST_TEST_CASE("Offsets in cells move lane by lane as they do one by one, to the bit", "", Packs)
{
    using Number = typename TestType::Number;
    using One = CellOffset<Number>;
    using Several = openmp::OffsetLane<TestType>;
    constexpr int width = TestType::width;
    std::vector<double> offsets{-0.5, std::nextafter(0.5, 0.0), 0, -0x1p-30, 0x1p-30, 0.25},
        displacements{-1, 1, 0, -0.0, 0x1p-31, -0x1p-31, 1.5 * 0x1p-30, -1.5 * 0x1p-30, 0x1p-40, 0.5, -0.5};
    std::mt19937 random(8);
    std::uniform_real_distribution<double> inside(-0.5, 0.5);
    for (int i = 0; i < 1000; ++i) {
        offsets.push_back(inside(random));
        displacements.push_back(i % 3 == 0 ? 2 * inside(random) : inside(random) * 1e-7);
    }
    int wrong = 0;
    for (std::size_t first = 0; first + width <= offsets.size(); first += width)
        for (std::size_t turn = 0; turn < width; ++turn) {
            typename One::Stored stored[width], now[width];
            Number by[width], value[width];
            for (std::size_t l = 0; l < width; ++l) {
                stored[l] = One::from(offsets[first + l]);
                by[l] = Number(displacements[first + (l + turn) % width]);
            }
            auto const moved = One::moved(Several::load(stored), TestType::load(by));
            Several::store(moved, now);
            One::value(moved).store(value);
            auto const stays = bits(One::inside(moved));
            for (std::size_t l = 0; l < width; ++l) {
                auto const alone = One::moved(stored[l], by[l]);
                wrong += now[l] != alone || value[l] != One::value(alone);
                wrong += ((stays >> l) & 1) != std::uint64_t(One::inside(alone));
                if constexpr (sizeof(Number) == 4) { // what they should be, found in another way
                    wrong += alone != stored[l] + std::llround(double(by[l]) * 0x1p30);
                    wrong += One::inside(alone) != (alone >= -(1 << 29) && alone < 1 << 29);
                }
            }
        }
    CHECK(wrong == 0);
}

TEMPLATE_LIST_TEST_CASE("Lanes are put side by side and back by every pattern", "", Packs)
{
    using Number = typename TestType::Number;
    constexpr int width = TestType::width;
    Number numbers[width], found[width];
    std::uint32_t counts[width];
    for (int l = 0; l < width; ++l) numbers[l] = Number(l + 1);
    auto const pack = TestType::load(numbers);
    int wrong = 0;
    for (std::uint64_t pattern = 0; pattern < std::uint64_t{1} << width; ++pattern) {
        std::vector<std::uint32_t> places, together(width, 0);
        for (int l = 0; l < width; ++l) {
            counts[l] = (pattern >> l) & 1 ? 0xffffffffu : std::uint32_t(l);
            if ((pattern >> l) & 1) places.push_back(std::uint32_t(l));
        }
        int const count = static_cast<int>(places.size());
        wrong += bits(Mask<TestType>::from_bits(pattern)) != pattern;
        wrong += openmp::lanes_above<width>(counts, width) != pattern;
        pack.compressed(pattern).store(found);
        for (int l = 0; l < width; ++l) wrong += found[l] != (l < count ? numbers[places[l]] : Number(0));
        pack.expanded(pattern).store(found);
        for (int n = 0; n < count; ++n) wrong += found[places[n]] != numbers[n];
        for (int l = 0; l < width; ++l) wrong += ((pattern >> l) & 1) == 0 && found[l] != 0;

        std::uint32_t lanes[width], back[width];
        for (int l = 0; l < width; ++l) lanes[l] = std::uint32_t(l);
        openmp::compress<width>(lanes, pattern, together.data());
        for (int l = 0; l < width; ++l) wrong += together[l] != (l < count ? places[l] : 0);
        openmp::expand<width>(together.data(), pattern, back);
        for (int n = 0; n < count; ++n) wrong += back[places[n]] != places[n];
        std::uint32_t counts[width], more[width];
        for (int l = 0; l < width; ++l)
            counts[l] = std::uint32_t(l), more[l] = counts[l] + std::uint32_t((pattern >> l) & 1);
        wrong += openmp::lanes_above<width>(more, counts) != pattern;
        wrong += openmp::lanes_above<width>(counts, more) != 0;
        wrong += openmp::most_of<width>(more) != *std::max_element(more, more + width);
    }
    CHECK(wrong == 0);
}

TEMPLATE_LIST_TEST_CASE("Numbers are read from places in runs, with gaps and anywhere", "", Packs)
{
    using Number = typename TestType::Number;
    constexpr int width = TestType::width;
    std::vector<Number> array(1000 + 2 * width);
    std::vector<std::conditional_t<sizeof(Number) == 4, std::int32_t, std::int64_t>> integers(array.size());
    for (std::size_t i = 0; i < array.size(); ++i) array[i] = Number(i), integers[i] = -std::int64_t(i);
    std::mt19937 random(7);
    openmp::RunsOfPlaces<TestType> reader;
    int wrong = 0;
    for (int trial = 0; trial < 20000; ++trial) {
        std::uint32_t places[width];
        auto const gap = random() % 4, apart = random() % 8;
        std::uint32_t place = random() % (1000 - 5 * width);
        for (auto& each : places) each = gap == 3 ? random() % 1000 : place += 1 + random() % (gap + 1);
        for (unsigned i = 0; i < apart; ++i)
            places[random() % width] = random() % 1000; // of a run, not in it
        reader.follow(places);
        Number found[width], bits[width];
        std::decay_t<decltype(integers[0])> copied[width];
        reader.load(array.data()).store(found);
        reader.load(reinterpret_cast<Number const*>(integers.data())).store(bits);
        std::memcpy(copied, bits, sizeof bits);
        for (int l = 0; l < width; ++l)
            wrong += found[l] != Number(places[l]) || copied[l] != -std::int64_t(places[l]);
    }
    CHECK(wrong == 0);
}

TEMPLATE_LIST_TEST_CASE("Lanes go wherever they are wanted", "", Packs)
{
    using Number = typename TestType::Number;
    constexpr int width = TestType::width;
    Number numbers[width], found[width];
    for (int l = 0; l < width; ++l) numbers[l] = Number(l + 1);
    std::mt19937 random(7);
    openmp::LanesInOrder<TestType> order;
    int wrong = 0;
    for (int trial = 0; trial < 2000; ++trial) {
        std::uint32_t from[width];
        for (auto& lane : from) lane = random() % width;
        order.follow(from);
        order(TestType::load(numbers)).store(found);
        for (int l = 0; l < width; ++l) wrong += found[l] != numbers[from[l]];
    }
    CHECK(wrong == 0);
}

TEMPLATE_LIST_TEST_CASE("A pack is a scalar of Eigen, and mixes with plain numbers", "", Packs)
{
    using N = ScalarOf<TestType>;
    Matrix<TestType, 3> F = Matrix<TestType, 3>::Identity() * N(2);
    F = F * F.transpose() - F * TestType(1) + N(1) * F;
    CHECK(all(F.determinant() == TestType(64)));
    CHECK(all(F.trace() == TestType(12)));
    CHECK(all(F.norm() == sqrt(TestType(48))));
    CHECK(all(N(1) + TestType(2) * N(3) - 1 == TestType(6)));
}

TEMPLATE_LIST_TEST_CASE("Vectors and matrices of packs compute what their packs do, into themselves, too", "",
                        Packs)
{
    using N = ScalarOf<TestType>;
    N lanes[lane_width<TestType>];
    for (int l = 0; l < lane_width<TestType>; ++l) lanes[l] = N(l);
    TestType const lane = LaneTraits<TestType>::load(lanes);
    auto const check = [lane](auto a) {
        using M = decltype(a);
        M b;
        for (int i = 0; i < a.size(); ++i) {
            a.data()[i] = lane * TestType(N(0.3)) + TestType(N(i + 1));
            b.data()[i] = lane * TestType(N(-0.7)) + TestType(N(2 * i - 3));
        }
        TestType const s = lane + TestType(N(1.1));
        auto const is = [&](M const& found, auto const& component) {
            for (int i = 0; i < a.size(); ++i)
                CHECK(all(found.data()[i] == component(a.data()[i], b.data()[i])));
        };
        using P = TestType const&;
        is(a + b, [](P x, P y) { return x + y; });
        is(a - b, [](P x, P y) { return x - y; });
        is(-a, [](P x, P) { return -x; });
        is(a * s, [&](P x, P) { return x * s; });
        is(s * a, [&](P x, P) { return s * x; });
        is(a / s, [&](P x, P) { return x / s; });
        M c = a;
        is(c += c, [](P x, P) { return x + x; });
        c = a;
        is(c -= b, [](P x, P y) { return x - y; });
        c = a;
        c *= c(0); // by one of its own, as it was
        is(c, [&](P x, P) { return x * a(0); });
        auto const kept = (a - b) / s; // a value, not an expression that refers to temporaries
        is(kept, [&](P x, P y) { return (x - y) / s; });
        // beside expressions of Eigen's
        is(a + b.cwiseProduct(a) * N(2), [](P x, P y) { return x + y * x * TestType(N(2)); });
    };
    check(Vector<TestType, 2>());
    check(Vector<TestType, 3>());
    check(Matrix<TestType, 3>());
    Eigen::Matrix<TestType, Eigen::Dynamic, 1> any(2); // that is left to Eigen
    any << TestType(N(1)), TestType(N(2));
    any += any * TestType(N(3));
    CHECK(all(any[1] == TestType(N(8))));
}

#endif

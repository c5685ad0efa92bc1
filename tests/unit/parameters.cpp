// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/firn.hpp>

#include <array>
#include <bit>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

// What a policy says of its parameters: no member is left out, so that no difference from a checkpoint's
// parameters goes unnoticed.
using namespace firn;

namespace
{

using Solid = Space<3, double>;
using PlaneFloat = Space<2, float>;

/// For a policy with members of `size` bytes each: changing any one of them changes exactly one of the
/// parameters that it says, but for `silent` members that change none.
template <class Policy>
void require_told(std::size_t size, int silent)
{
    using Bytes = std::array<unsigned char, sizeof(Policy)>;
    auto const all = detail::parameters_of(Policy{});
    REQUIRE(sizeof(Policy) % size == 0);
    CHECK(all.size() + silent == sizeof(Policy) / size);
    std::set<std::string> changed;
    int without = 0;
    for (std::size_t at = 0; at < sizeof(Policy); at += size) {
        auto bytes = std::bit_cast<Bytes>(Policy{});
        bytes[at] ^= 1; // a last bit, or whether
        auto const other = detail::parameters_of(std::bit_cast<Policy>(bytes));
        REQUIRE(other.size() == all.size());
        std::size_t differ = 0;
        for (std::size_t i = 0; i < all.size(); ++i) {
            CHECK(other[i].name == all[i].name);
            if (other[i].value == all[i].value) continue;
            changed.insert(all[i].name);
            ++differ;
        }
        CHECK(differ <= 1);
        without += differ == 0;
    }
    CHECK(without == silent);
    CHECK(changed.size() == all.size());
}

template <class Space>
using Models = decltype(std::tuple_cat(std::declval<AllModels<Space>>(),
                                       std::declval<std::tuple<Heterogeneous<Snow<Space>>>>()));

/// A user-defined policy with parameters of all kinds.
struct Own
{
    enum class Kind
    {
        smooth,
        rough
    };
    struct Side
    {
        Lame<float> moduli{1, 2};
        Kind kind = Kind::rough;
        void for_each_parameter(auto const& use) const
        {
            use("moduli", moduli);
            use("kind", kind);
        }
    };
    Side left{}, right{{3, 4}, Kind::smooth};
    int layers = 5;
    bool is_open = true;
    void for_each_parameter(auto const& use) const
    {
        use("left", left);
        use("right", right);
        use("layers", layers);
        use("is_open", is_open);
    }
};

} // namespace

TEMPLATE_LIST_TEST_CASE("a material says every parameter but its density", "", Models<Solid>)
{
    require_told<TestType>(sizeof(double), 1);
}
TEMPLATE_LIST_TEST_CASE("a material in single precision says them, too", "", Models<PlaneFloat>)
{
    require_told<TestType>(sizeof(float), 1);
}

TEST_CASE("a transfer scheme says every parameter")
{
    require_told<Flip>(sizeof(double), 0);
    require_told<Asflip>(sizeof(double), 0);
    require_told<Xpic>(sizeof(int), 0);
    CHECK(detail::parameters_of(Pic{}).empty());
    CHECK(detail::parameters_of(Apic{}).empty());
    CHECK(detail::parameters_of(Mls{}).empty());
    CHECK(detail::parameters_of(Tpic{}).empty());
}

TEST_CASE("parameters within parameters are named by where they are")
{
    std::vector<std::pair<std::string, double>> said;
    for (auto const& one : detail::parameters_of(Own{})) said.emplace_back(one.name, one.value);
    CHECK(said == std::vector<std::pair<std::string, double>>{{"left.moduli.mu", 1},
                                                              {"left.moduli.lambda", 2},
                                                              {"left.kind", 1},
                                                              {"right.moduli.mu", 3},
                                                              {"right.moduli.lambda", 4},
                                                              {"right.kind", 0},
                                                              {"layers", 5},
                                                              {"is_open", 1}});
}

namespace
{

/// Says two of its numbers under one name, as a copied line would.
struct Twice
{
    double first = 1, second = 2;
    void for_each_parameter(auto const& use) const
    {
        use("first", first);
        use("first", second);
    }
};

/// A number that may be rounded and one that may not.
struct Seeded
{
    int seed = 20'000'000;
    void for_each_parameter(auto const& use) const
    {
        use("flip", Flip{});
        use("seed", seed);
    }
};

} // namespace

TEST_CASE("two parameters of one name are refused by it")
{
    CHECK_THROWS_WITH(detail::parameters_of(Twice{}), Contains("two parameters are called first"));
    CHECK(detail::parameters_of(Seeded{}).size() == 2);
}

TEST_CASE("of whole numbers nothing is rounded away when they are compared")
{
    auto const all = detail::parameters_of(Seeded{});
    CHECK(!all[0].is_whole);
    CHECK(all[1].is_whole);
    auto other = all;
    other[0].value *= 1 + 1e-7;
    CHECK(detail::compare_parameters<float>("for it", other, all));
    ++other[1].value;
    CHECK_THROWS_WITH(detail::compare_parameters<float>("for it", other, all),
                      Contains("seed = 20000001, this solver has 20000000"));
}

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/contact.hpp>
#include <firn/models/several_materials.hpp>

#include <array>
#include <cassert>
#include <cstddef>
#include <string>
#include <utility>

namespace firn
{

/// How the bodies of a scene act on each other where they touch: a Contact for each pair of them. It acts on
/// the velocity of one relative to the other.
///
///   BodyContact<3> contact = Contact::coulomb(0.5);
///   contact.between(0, 2) = Contact::slip();
template <std::size_t bodies>
struct BodyContact
{
    static_assert(bodies >= 2 && bodies <= 16, "a scene has 2 to 16 bodies with contact between them");

    /// Bodies touch where they fill at least this share of the space around a node. Below it there is a gap
    /// between them, and they do not act on each other. 0: they do wherever both reach the same node.
    double touching = 0.8;

    /// The same contact between all bodies.
    FIRN_HOST_DEVICE BodyContact(Contact const& all = {})
    {
        for (Contact& pair : pairs_) pair = all;
    }

    /// The contact between two bodies, which are counted from 0. Throws an Error if there are no such two.
    Contact& between(std::size_t a, std::size_t b)
    {
        require(a < bodies && b < bodies && a != b, "there are no such two bodies", "BodyContact::between",
                "Pass two numbers that differ, counted from 0.");
        return pairs_[place(a, b)];
    }
    /// The same for loops, which pass no others.
    FIRN_HOST_DEVICE Contact const& between(std::size_t a, std::size_t b) const
    {
        assert(a < bodies && b < bodies && a != b && "two bodies of the scene");
        return pairs_[place(a, b)];
    }

    void validate() const
    {
        require(is_number(touching) && touching >= 0 && touching <= 1,
                "the share of space that touching bodies fill is outside [0, 1]", "BodyContact",
                "Pass 0.8, or 0 for contact wherever two bodies reach the same node.");
        for (Contact const& pair : pairs_) pair.validate("BodyContact");
    }

    void for_each_parameter(auto const& use) const
    {
        use("touching", touching);
        for (std::size_t b = 1; b < bodies; ++b)
            for (std::size_t a = 0; a < b; ++a) {
                std::string const pair = std::to_string(a) + "_" + std::to_string(b) + ".";
                Contact const& contact = between(a, b);
                use((pair + "friction").c_str(), contact.friction);
                use((pair + "separates").c_str(), int{contact.separates});
                use((pair + "sticks").c_str(), int{contact.sticks});
            }
    }

private:
    FIRN_HOST_DEVICE static constexpr std::size_t place(std::size_t a, std::size_t b)
    {
        return a < b ? b * (b - 1) / 2 + a : a * (a - 1) / 2 + b;
    }

    std::array<Contact, bodies*(bodies - 1) / 2> pairs_;
};

/// Several bodies in one scene that touch without sticking together: each has its own velocities on the grid,
/// and where two of them touch, they push, slide with friction, and separate.
///
///   Solver<OpenMP, Bodies<Rubber, Rubber, Snow>> solver(lattice, {rubber, rubber, snow,
///                                                                 Contact::coulomb(0.3)});
///   solver.template add<Material<0>>(points, volume, velocity);
///
/// Bodies are named as materials are: by Material<place>, or by a type that occurs once.
///
/// Bodies need more memory on the grid than Materials do: a set of velocities for each body.
template <class First, class... Rest>
struct Bodies : Materials<First, Rest...>
{
    using Contacts = BodyContact<1 + sizeof...(Rest)>;

    Contacts contact;

    Bodies() = default;
    Bodies(First first, Rest... rest, Contacts const& between = {})
        : Materials<First, Rest...>(std::move(first), std::move(rest)...), contact(between)
    {}
};

namespace detail
{
template <class Model, class Places>
struct SameBodies;
template <class Model, std::size_t... k>
struct SameBodies<Model, std::index_sequence<k...>>
{
    template <std::size_t>
    struct Each
    {
        using Type = Model;
    };
    using Type = Bodies<typename Each<k>::Type...>;
};
} // namespace detail

/// So many bodies of the same material: BodiesOf<Rubber, 5>.
template <class Model, std::size_t count>
using BodiesOf = typename detail::SameBodies<Model, std::make_index_sequence<count>>::Type;

namespace detail
{
template <class... Models>
struct MaterialsOf<Bodies<Models...>>
{
    using Type = Bodies<Models...>;
};

/// The contact between the materials of a list, if it has one.
struct NoBodyContact
{};
template <class List>
struct BodyContactOf
{
    using Type = NoBodyContact;
    static constexpr bool any = false;
    static Type of(List const&) { return {}; }
};
template <class... Models>
struct BodyContactOf<Bodies<Models...>>
{
    using Type = BodyContact<sizeof...(Models)>;
    static constexpr bool any = true;
    static Type const& of(Bodies<Models...> const& list) { return list.contact; }
};
} // namespace detail

} // namespace firn

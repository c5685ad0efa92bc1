// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/hooks.hpp>
#include <firn/effects/validate_effects.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>
#include <firn/transfer/loaded_surfaces.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace firn::detail
{

/// Tells whether a field of a particle is not 0: called for every place of a particle.
template <class Number, std::size_t components>
struct TellMarked
{
    std::array<Number const*, components> column;
    unsigned char* is_marked; ///< 1 or 0, by place

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        bool any = false;
        for (std::size_t c = 0; c < components; ++c) any = any || !exactly_equal(column[c][place], Number(0));
        is_marked[place] = any ? 1 : 0;
    }
};

/// Whether a particle of a table has a field that is not 0.
template <class Tag, class Table>
bool has_marked(Table const& table)
{
    using Number = typename Table::Number;
    constexpr int d = Table::d, first = Table::PersistentFields::template first_component<Tag>(d);
    constexpr std::size_t components = component_count<Tag>(d);
    if (table.size() == 0) return false;
    typename Table::Backend::template Array<unsigned char> there(table.backend());
    there.resize(table.places());
    TellMarked<Number, components> tell{{}, there.data()};
    for (std::size_t c = 0; c < components; ++c)
        tell.column[c] = table.contents().buffer[0].component[std::size_t(first) + c].data();
    table.backend().for_each(table.places(), tell);
    auto const here = downloaded(there);
    return sum_of_ranks(table.backend(), std::ranges::find(here, 1) != here.end() ? 1 : 0) > 0;
}

/// The field that marks what an action is about.
template <class Action>
struct MarkOf
{
    using Type = void;
};
template <class Action>
    requires(has_marked_acceleration<Action> || has_touch_marked<Action>)
struct MarkOf<Action>
{
    using Type = typename Action::Marked;
};
template <class Action>
    requires has_surface_force<Action>
struct MarkOf<Action>
{
    using Type = AreaPerMass;
};

/// The name of an effect in a message.
template <class Effect>
std::string name_of_effect()
{
    if constexpr (requires { std::string(Effect::name); })
        return Effect::name;
    else
        return "an effect";
}

/// The marks that some particle of a scene is known to have. Steps leave marks alone, so particles are looked
/// at only if they came, went or were set since then.
class KnownMarks
{
public:
    /// To be called when fields of particles were set or restored.
    void forget() { names_.clear(); }

    /// Throws an Error if an effect of a call acts on what is marked, and no particle of `sets` is.
    template <class Sets, class... Effects>
    void look([[maybe_unused]] char const* call, [[maybe_unused]] Sets const& sets, Effects const&...)
    {
        [[maybe_unused]] int place = 0;
        (look_for<Effects>(call, ++place, sets), ...);
    }

private:
    template <class Effect, class Sets>
    void look_for([[maybe_unused]] char const* call, [[maybe_unused]] int place,
                  [[maybe_unused]] Sets const& sets)
    {
        using Tag = typename MarkOf<ActionOf<Effect, typename Sets::Space::Scalar, Sets::d>>::Type;
        if constexpr (!std::is_same_v<Tag, void>) {
            auto const particles = sets.template id_marks<Sets::count>();
            bool const are_same = std::ranges::equal(particles, particles_,
                                                     [](auto const& a, auto const& b) { return a == b; });
            if (!are_same) forget();
            if (std::ranges::find(names_, Tag::name) != names_.end()) return;
            bool is_marked = false;
            Sets::for_each([&](auto k) {
                using Table = std::remove_cvref_t<decltype(sets.template particles<k>())>;
                if constexpr (Table::PersistentFields::template contains<Tag>)
                    is_marked = is_marked || has_marked<Tag>(sets.template particles<k>());
                else // a policy of the program's own, which marks in another way
                    is_marked = true;
            });
            if (!is_marked) refuse(Tag::name, name_of_effect<Effect>(), call, place);
            particles_.assign(particles.begin(), particles.end());
            names_.push_back(Tag::name);
        }
    }

    [[noreturn, gnu::cold]] static void refuse(char const* mark, std::string const& effect, char const* call,
                                               int place)
    {
        refuse_effect({"no particle has the mark '" + std::string(mark) + "', so it would act on nothing",
                       effect,
                       "Mark particles before the call, by assign() or mark_face(), or leave the effect out "
                       "once the last one that was marked has been removed."},
                      place, call);
    }

    std::vector<IdMark> particles_; ///< of each material, when the marks were found
    std::vector<std::string_view> names_;
};

} // namespace firn::detail

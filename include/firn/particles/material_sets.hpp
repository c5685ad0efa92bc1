// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/step_error.hpp>
#include <firn/models/bodies.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/particle_table.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/remove_particles.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{
/// Whether a material's fields have none of those that WithFields adds to a transfer.
template <class Transfer, class State>
inline constexpr bool leaves_own_fields = true;
template <class Transfer, class State>
    requires requires { typename Transfer::Own; }
inline constexpr bool leaves_own_fields<Transfer, State> =
    Join<typename Transfer::Own, State>::components(3) == Transfer::Own::components(3) + State::components(3);

template <class Models>
inline constexpr bool any_keeps_volume = false;
template <class... Models>
inline constexpr bool any_keeps_volume<std::tuple<Models...>> = (KeepsItsVolume<Models> || ...);
} // namespace detail

/// The materials of a scene, each with its particles. Each has a layer of the grid, in the same order.
template <class Backend, class List, class Transfer>
class MaterialSets
{
public:
    using Space = typename List::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    /// How many materials there are.
    static constexpr std::size_t count = std::tuple_size_v<decltype(List::of)>;
    using Places = std::make_index_sequence<count>;
    /// Whether the materials are bodies, which have their own velocities on the grid.
    static constexpr bool are_bodies = detail::BodyContactOf<List>::any;
    /// Whether one of them is a fluid that keeps its volume.
    static constexpr bool keep_volume = detail::any_keeps_volume<decltype(List::of)>;

    /// The types and sizes of one material.
    template <std::size_t place>
    struct MaterialTraits
    {
        static_assert(place < count, "say which material: its type, or Material<place>");
        using Model = std::tuple_element_t<place, decltype(List::of)>;
        /// A particle's fields beside position and id: the union of what transfer and model declare.
        using State = Join<typename Transfer::State, typename Model::State>;
        /// The fields that are stored from step to step, and those that are gathered from the grid on
        /// request.
        using Stored = Join<typename Transfer::Stored, typename Model::State>;
        using Derived = Without<typename Transfer::State, Stored>;
        static_assert(detail::leaves_own_fields<Transfer, typename Model::State>,
                      "the material has a field that WithFields adds, and would change it");
        static_assert(detail::have_own_names(State{}),
                      "two fields of a particle have the same name, by which checkpoints tell them apart");
        using Table = ParticleTable<Backend, Space, Stored, Derived>;

        /// The bytes stored per particle: its position, its fields and its row.
        static constexpr std::size_t state_bytes_per_particle = Table::state_bytes;
        /// All resident bytes per particle: two buffers of that, and the index of the cell order. The host
        /// keeps four more where ids differ from rows.
        static constexpr std::size_t bytes_per_particle = Table::resident_bytes;
    };
    using CellOrder = typename MaterialTraits<0>::Table::CellOrder;

private:
    template <std::size_t... k>
    static CommonToAll<typename MaterialTraits<k>::State...> common_state(std::index_sequence<k...>);
    template <std::size_t... k>
    static constexpr std::size_t most_state_bytes(std::index_sequence<k...>)
    {
        return std::max({MaterialTraits<k>::state_bytes_per_particle...});
    }
    template <std::size_t... k>
    static constexpr std::size_t most_bytes(std::index_sequence<k...>)
    {
        return std::max({MaterialTraits<k>::bytes_per_particle...});
    }

public:
    /// The fields that particles of all materials have in common.
    using CommonState = typename decltype(common_state(Places{}))::Type;
    /// MaterialTraits' bytes; of several materials, the largest.
    static constexpr std::size_t state_bytes_per_particle = most_state_bytes(Places{}),
                                 bytes_per_particle = most_bytes(Places{});

    MaterialSets(List list, Lattice lattice, int kernel_degree, Backend const& backend)
        : MaterialSets(std::move(list), lattice, kernel_degree, backend, Places{})
    {}

    /// The same materials without particles.
    MaterialSets emptied(Lattice lattice, int kernel_degree, Backend const& backend) const
    {
        return [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            List list{model<k>()...};
            if constexpr (are_bodies) list.contact = contact_;
            return MaterialSets(std::move(list), lattice, kernel_degree, backend);
        }
        (Places{});
    }

    /// Calls `use(place)` for every material, `place` being a constant.
    template <class Use>
    static void for_each(Use const& use)
    {
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (use(std::integral_constant<std::size_t, k>{}), ...);
        }
        (Places{});
    }

    template <std::size_t k>
    auto& particles()
    {
        return std::get<k>(sets_).particles;
    }
    template <std::size_t k>
    auto const& particles() const
    {
        return std::get<k>(sets_).particles;
    }
    template <std::size_t k>
    auto const& model() const
    {
        return std::get<k>(sets_).model;
    }

    /// Throws an Error if a parameter is outside its range.
    void validate() const
    {
        for_each([&](auto k) { model<k>().validate(); });
        if constexpr (are_bodies) contact_.validate();
    }

    /// The contact between bodies.
    auto const& contact() const { return contact_; }

    /// Whether a call about the material in `place`, or about all if that is `count`, is about this one.
    template <std::size_t place, std::size_t k>
    static constexpr bool is_about = place == k || place == count;

    /// How many particles a material has, or all if `place` is `count`.
    template <std::size_t place>
    std::size_t size() const
    {
        std::size_t size = 0;
        for_each([&](auto k) {
            if constexpr (is_about<place, k>) size += particles<k>().size();
        });
        return size;
    }

    /// Whether a material has particles.
    bool has_particles(int material) const
    {
        bool has = false;
        for_each([&](auto k) { has = has || (k == std::size_t(material) && particles<k>().size() > 0); });
        return has;
    }

    /// The values that `ask(place)` returns for one material, or for all merged, by rising id.
    template <std::size_t place, class Value, class Ask>
    std::vector<Value> by_id(Ask const& ask) const
    {
        if constexpr (place < count)
            return ask(std::integral_constant<std::size_t, place>{});
        else {
            std::vector<std::pair<std::uint32_t, Value>> all;
            for_each([&](auto k) {
                std::vector<Value> const values = ask(k);
                for (std::size_t row = 0; row < values.size(); ++row)
                    all.emplace_back(particles<k>().id(row), values[row]);
            });
            return sorted_by_id(std::move(all));
        }
    }
    /// The same for the particles that lie here: on a backend that spans ranks, those of this rank.
    template <std::size_t place, class Value, class Ask>
    std::vector<Value> by_id_here(Ask const& ask) const
    {
        std::vector<std::pair<std::uint32_t, Value>> here;
        for_each([&](auto k) {
            if constexpr (is_about<place, k>) {
                std::vector<Value> const values = ask(k);
                for (std::uint32_t const row : detail::rows_of(particles<k>()))
                    here.emplace_back(particles<k>().id(row), values[row]);
            }
        });
        return sorted_by_id(std::move(here));
    }

    /// The marks of which particles one material has, or each of all: see Solver::id_marks.
    template <std::size_t place>
    auto id_marks() const
    {
        std::array<IdMark, place == count ? count : 1> marks;
        for_each([&](auto k) {
            if constexpr (is_about<place, k>) marks[place == count ? k : 0] = particles<k>().id_mark();
        });
        return marks;
    }

    /// Marks the particles of a material, or of all, for which a predicate is true: see Solver::remove_if.
    template <std::size_t place, class Predicate>
    std::vector<RemovalMask<Backend>> find(Predicate const& predicate, Backend const& backend) const
    {
        std::vector<RemovalMask<Backend>> masks;
        for_each([&](auto k) {
            using Particle = Record<Number, d, typename MaterialTraits<k>::State>;
            if constexpr (is_about<place, k>) {
                static_assert(
                    TellsByPosition<Predicate, d> || TellsByFields<Predicate, d, Particle>,
                    "predicate is to take a position, or a position and a particle, and tell yes or no");
                masks.push_back(find_particles(particles<k>(), predicate));
            }
            else
                masks.emplace_back(backend);
        });
        return masks;
    }

    /// " of snow (material 1)" and so on, for errors; empty in a scene of one material.
    static std::string name(std::size_t material)
    {
        std::string name;
        for_each([&](auto k) {
            if (count == 1 || k != material) return;
            name = " of ";
            if constexpr (requires { std::string(MaterialTraits<k>::Model::name); })
                name += std::string(MaterialTraits<k>::Model::name) + " (material " + std::to_string(k) + ")";
            else
                name += "material " + std::to_string(k);
        });
        return name;
    }

    /// Whether the model of a material may object to a state from outside.
    template <std::size_t k>
    static constexpr bool may_object = ObjectsToStates<typename MaterialTraits<k>::Model,
                                                       Record<Number, d, typename MaterialTraits<k>::Stored>>;

    /// Throws an Error if the model objects to the particle of a row of a table, which may be the scene's own
    /// or a new one.
    template <std::size_t k, class Table, class Particle>
    void require_bearable(Table const& table, std::uint32_t row, Particle const& particle,
                          char const* call) const
    {
        std::string const objection = model<k>().objection(particle);
        if (objection.empty()) return;
        throw Error{objection,
                    std::string(call) + ", value " + std::to_string(row) + ", particle " +
                        std::to_string(table.id(row)) + name(k),
                    "Pass a state that the material could have come to."};
    }

    /// The model's response to a particle's state at zero velocity gradient.
    template <std::size_t k, class Particle>
    Response<Number, d> response(Particle const& particle) const
    {
        auto state = state_of_new<StateOf<k>>(model<k>());
        for_each_tag(typename MaterialTraits<k>::Model::State{},
                     [&](auto tag) { state[tag] = particle[tag]; });
        return response_of<k>(state);
    }
    template <std::size_t k>
    Response<Number, d> response_at_rest() const
    {
        return response_of<k>(state_of_new<StateOf<k>>(model<k>()));
    }

    /// The speed of waves [m/s] of a modulus [Pa].
    template <std::size_t k>
    double wave_speed(double modulus) const
    {
        return std::sqrt(modulus / double(model<k>().density));
    }

    std::array<double, count> densities() const
    {
        std::array<double, count> densities{};
        for_each([&](auto k) { densities[k] = double(model<k>().density); });
        return densities;
    }

    /// The cell orders of all materials.
    std::array<CellOrder*, count> orders()
    {
        std::array<CellOrder*, count> orders{};
        for_each([&](auto k) { orders[k] = &particles<k>().cells(); });
        return orders;
    }

    /// Whether the gathered fields are cached beside the particles.
    bool has_grid_fields() const
    {
        bool holds = true;
        for_each([&](auto k) { holds = holds && particles<k>().has_grid_fields(); });
        return holds;
    }

    /// Removes the particles of some failures.
    void remove(std::vector<StepFailure> const& failures)
    {
        for_each([&](auto k) {
            std::vector<std::uint32_t> rows;
            for (auto const& failure : failures)
                if (failure.material == k) rows.push_back(particles<k>().row(failure.particle));
            remove_particles(particles<k>(), mark_rows(particles<k>(), rows));
        });
    }

private:
    template <class Value>
    static std::vector<Value> sorted_by_id(std::vector<std::pair<std::uint32_t, Value>> of_ids)
    {
        std::sort(of_ids.begin(), of_ids.end(),
                  [](auto const& a, auto const& b) { return a.first < b.first; });
        std::vector<Value> values;
        values.reserve(of_ids.size());
        for (auto const& [id, value] : of_ids) values.push_back(value);
        return values;
    }

    template <std::size_t k>
    using StateOf = Record<Number, d, typename MaterialTraits<k>::Model::State>;

    /// One instantiation per material, whatever other fields particles have: respond() takes long to compile.
    template <std::size_t k>
    [[gnu::noinline]] Response<Number, d> response_of(StateOf<k> state) const
    {
        return model<k>().template respond<Number>(state, zeros<Matrix<Number, d>>(), Number(0));
    }

    template <std::size_t k>
    struct Part
    {
        typename MaterialTraits<k>::Model model;
        typename MaterialTraits<k>::Table particles;
    };
    template <std::size_t... k>
    static std::tuple<Part<k>...> tuple_of_parts(std::index_sequence<k...>);

    template <std::size_t... k>
    FIRN_COLD MaterialSets(List list, Lattice lattice, int kernel_degree, Backend const& backend,
                           std::index_sequence<k...>)
        : contact_(detail::BodyContactOf<List>::of(list)),
          sets_{Part<k>{std::move(std::get<k>(list.of)),
                        typename MaterialTraits<k>::Table(lattice, kernel_degree, backend)}...}
    {}

    [[no_unique_address]] typename detail::BodyContactOf<List>::Type contact_;
    decltype(tuple_of_parts(Places{})) sets_;
};

} // namespace firn

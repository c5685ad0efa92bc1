// SPDX-License-Identifier: MIT
#pragma once

#include <firn/particles/table_view.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

// Storage of the fields of a particle table: see ParticleTable.
namespace firn
{

namespace detail
{
/// Arrays in the backend's memory.
template <class Array, std::size_t count, class Backend>
std::array<Array, count> arrays_of(Backend const& backend)
{
    return [&]<std::size_t... i>(std::index_sequence<i...>)
    {
        return std::array<Array, count>{(static_cast<void>(i), Array(backend))...};
    }
    (std::make_index_sequence<count>{});
}

/// All elements of an array, in memory of the host.
template <class Array>
auto downloaded(Array const& array)
{
    std::vector<typename Array::Value> values(array.size());
    array.download(0, values);
    return values;
}

/// A vector in the backend's memory.
template <class Backend, class T>
auto array_of(Backend const& backend, std::vector<T> const& values)
{
    typename Backend::template Array<T> there(backend);
    there.resize(std::max<std::size_t>(values.size(), 1)); // so that it has an address
    there.upload(0, values);
    return there;
}
} // namespace detail

/// Copies the listed elements of an array.
template <class T>
struct GatherValues
{
    T const* from;
    std::uint32_t const* places;
    T* to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { to[i] = from[places[i]]; }
};

/// Copies values within an array, each from one place to another.
template <class T>
struct MoveValues
{
    T* values;
    std::uint32_t const *from, *to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { values[to[i]] = values[from[i]]; }
};

/// Writes values to the listed places of an array.
template <class T>
struct PutValues
{
    T const* values;
    std::uint32_t const* places;
    T* to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { to[places[i]] = values[i]; }
};

/// One array per component of the fields that are stored from step to step, positions and rows among them, in
/// any order of particles.
template <class Backend, class Space, class Set>
struct PersistentStorage
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using View = TableView<Number, d, Set>;
    using ConstView = TableView<Number const, d, Set>;
    using Offset = typename View::Offset;
    template <class T>
    using Array = typename Backend::template Array<T>;

    std::array<Array<Offset>, std::size_t(d)> offset;
    std::array<Array<Number>, Set::components(d)> component;
    Array<std::uint32_t> id;

    explicit PersistentStorage(Backend const& backend)
        : offset(detail::arrays_of<Array<Offset>, d>(backend)),
          component(detail::arrays_of<Array<Number>, Set::components(d)>(backend)), id(backend)
    {}

    /// Keeps the first `kept` particles, or as many as there are.
    void resize(std::size_t count, std::size_t kept)
    {
        for (auto& array : offset) array.resize(count, kept);
        for (auto& array : component) array.resize(count, kept);
        id.resize(count, kept);
    }

    /// As many particles as another storage has, with as much room for more; without contents.
    void resize_like(PersistentStorage const& other)
    {
        auto const resize = [](auto& array, auto const& model) {
            array.resize(0, 0); // or it would get spare room beyond the other's, and the other one beyond its
            array.resize(model.memory() / sizeof(*model.data()), 0);
            array.resize(model.size(), 0);
        };
        for (std::size_t a = 0; a < offset.size(); ++a) resize(offset[a], other.offset[a]);
        for (std::size_t c = 0; c < component.size(); ++c) resize(component[c], other.component[c]);
        resize(id, other.id);
    }

    /// Whether it can have so many particles without any growth.
    bool has_room(std::size_t count) const
    {
        auto const fits = [&](auto const& array) { return count * sizeof(*array.data()) <= array.memory(); };
        bool has = fits(id);
        for (auto const& array : offset) has = has && fits(array);
        for (auto const& array : component) has = has && fits(array);
        return has;
    }

    void swap(PersistentStorage& other) noexcept
    {
        for (std::size_t a = 0; a < offset.size(); ++a) offset[a].swap(other.offset[a]);
        for (std::size_t c = 0; c < component.size(); ++c) component[c].swap(other.component[c]);
        id.swap(other.id);
    }

    /// Copies the particles at `places` of another storage, except for their rows.
    void gather(Backend const& backend, PersistentStorage const& from, std::uint32_t const* places,
                std::size_t count)
    {
        resize(count, 0);
        for (std::size_t a = 0; a < offset.size(); ++a)
            backend.for_each(count, GatherValues<Offset>{from.offset[a].data(), places, offset[a].data()});
        for (std::size_t c = 0; c < component.size(); ++c)
            backend.for_each(count,
                             GatherValues<Number>{from.component[c].data(), places, component[c].data()});
    }

    View view() { return view_of<View>(*this); }
    ConstView view() const { return view_of<ConstView>(*this); }

    std::size_t memory() const
    {
        std::size_t bytes = id.memory();
        for (auto const& array : offset) bytes += array.memory();
        for (auto const& array : component) bytes += array.memory();
        return bytes;
    }

private:
    template <class Which, class Storage>
    static Which view_of(Storage& storage)
    {
        Which view{.offset = {}, .component = {}, .id = storage.id.data()};
        for (std::size_t a = 0; a < view.offset.size(); ++a) view.offset[a] = storage.offset[a].data();
        std::transform(storage.component.begin(), storage.component.end(), view.component.begin(),
                       [](auto& array) { return array.data(); });
        return view;
    }
};

/// One array per component of the fields that are gathered from the grid, by row.
template <class Backend, class Space, class Set>
class DerivedStorage
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Array = typename Backend::template Array<Number>;

public:
    using View = FieldsById<Number, d, Set>;
    using ConstView = FieldsById<Number const, d, Set>;

    DerivedStorage(Backend const& backend, std::size_t count)
        : component_(detail::arrays_of<Array, Set::components(d)>(backend))
    {
        resize(count);
    }

    void resize(std::size_t count)
    {
        for (auto& array : component_) array.resize(count);
    }

    View view() { return view_of<View>(component_); }
    ConstView view() const { return view_of<ConstView>(component_); }

    /// Sets all components of all fields from `first` on.
    void fill(std::size_t first, Record<Number, d, Set> record)
    {
        record.for_each([&](int c, Number const& value) {
            component_[std::size_t(c)].fill(first, component_[std::size_t(c)].size() - first, value);
        });
    }

    template <class Tag>
    void set(std::vector<FieldValue<Tag, Number, d>> const& by_row)
    {
        constexpr int first = Set::template first_component<Tag>(d);
        std::vector<Number> column(by_row.size());
        for (int c = 0; c < component_count<Tag>(d); ++c) {
            for (std::size_t row = 0; row < by_row.size(); ++row)
                column[row] = component_of<Tag, d>(by_row[row], c);
            component_[std::size_t(first + c)].upload(0, column);
        }
    }

    template <class Tag>
    std::vector<FieldValue<Tag, Number, d>> by_row(std::size_t count) const
    {
        constexpr int first = Set::template first_component<Tag>(d);
        std::vector<FieldValue<Tag, Number, d>> values(count, value_at_rest<Tag, Number, d>());
        for (int c = 0; c < component_count<Tag>(d); ++c) {
            auto const column = detail::downloaded(component_[std::size_t(first + c)]);
            for (std::size_t row = 0; row < count; ++row) component_of<Tag, d>(values[row], c) = column[row];
        }
        return values;
    }

    /// The column of a field's component.
    template <class Tag>
    Array const& column_of(int component) const
    {
        return component_[std::size_t(Set::template first_component<Tag>(d) + component)];
    }
    /// How many columns there are, one for each component.
    std::size_t columns() const { return component_.size(); }
    Array const& column(int c) const { return component_[static_cast<std::size_t>(c)]; }
    Array& column(int c) { return component_[static_cast<std::size_t>(c)]; }

    /// Copies the listed rows of another storage.
    void gather(Backend const& backend, DerivedStorage const& from, std::uint32_t const* rows)
    {
        for (std::size_t c = 0; c < component_.size(); ++c)
            backend.for_each(component_[c].size(),
                             GatherValues<Number>{from.component_[c].data(), rows, component_[c].data()});
    }

    std::size_t memory() const
    {
        std::size_t bytes = 0;
        for (auto const& array : component_) bytes += array.memory();
        return bytes;
    }

private:
    template <class Which, class Arrays>
    static Which view_of(Arrays& arrays)
    {
        Which view{.component = {}, .present = true};
        for (std::size_t c = 0; c < arrays.size(); ++c) view.component[c] = arrays[c].data();
        return view;
    }

    std::array<Array, Set::components(d)> component_;
};

} // namespace firn

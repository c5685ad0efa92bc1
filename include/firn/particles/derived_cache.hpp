// SPDX-License-Identifier: MIT
#pragma once

#include <firn/particles/storage.hpp>

#include <cstddef>
#include <optional>
#include <utility>

namespace firn
{

/// The fields that a table's particles gather from the grid, while they are cached beside the particles: by
/// row, with a second storage that a step writes.
///
/// They are cached from accept() or resize() on, and after a swap() of what a step wrote. A step that did not
/// write them leaves them on the grid, to be regathered. Storage outlives that, so that keep() can declare
/// its values valid again after a rollback.
template <class Backend, class Space, class Set>
class DerivedCache
{
public:
    using Storage = DerivedStorage<Backend, Space, Set>;
    using View = typename Storage::View;
    using ConstView = typename Storage::ConstView;

    explicit DerivedCache(Backend const& backend) : backend_(backend) {}

    bool is_cached() const { return source_ == Source::cache; }
    /// The cached values; a view without fields if they are on the grid.
    ConstView view() const { return is_cached() ? values().view() : ConstView{}; }
    /// If is_cached().
    Storage& values() { return *current_; }
    Storage const& values() const { return *current_; }

    /// Where `count` particles' values are written before accept() or, in a step, before swap().
    View place(std::size_t count) { return place(current_, count); }
    View next_place(std::size_t count) { return place(next_, count); }
    void accept() { set_cached(true); }
    /// After a step: what it wrote becomes current, or the values are on the grid.
    void swap(bool wrote)
    {
        if (wrote) current_.swap(next_);
        set_cached(wrote);
    }
    /// Undoes the exchange of a swap(); keep() says then whether values are cached.
    void swap_back() { current_.swap(next_); }
    /// Sets whether values are cached after some steps, and were `before`; frees storage that is unused.
    void keep(bool now, bool before)
    {
        set_cached(now);
        if (is_cached() || before) return;
        current_.reset();
        next_.reset();
    }

    /// Makes room for `count` particles, of which all but the existing ones are still to be filled.
    void resize(std::size_t count)
    {
        if (!current_) current_.emplace(backend_, count);
        next_.reset();
        current_->resize(count);
        set_cached(true);
    }
    /// Values of the listed rows, `count` of them, in a storage of their own; none if the values are on the
    /// grid.
    std::optional<Storage> gathered(std::uint32_t const* rows, std::size_t count) const
    {
        std::optional<Storage> values;
        if (!is_cached()) return values;
        values.emplace(backend_, count);
        values->gather(backend_, *current_, rows);
        return values;
    }
    /// Replaces the storage by such values.
    void replace(std::optional<Storage> values)
    {
        next_.reset();
        current_.swap(values);
        set_cached(is_cached());
    }

    std::size_t memory() const { return (current_ ? current_->memory() : 0) + (next_ ? next_->memory() : 0); }

private:
    /// Where the fields are to be had from.
    enum class Source
    {
        grid, ///< whatever storage there is
        cache ///< there is storage, and it has values
    };

    void set_cached(bool cached) { source_ = cached && current_ ? Source::cache : Source::grid; }

    View place(std::optional<Storage>& storage, std::size_t count)
    {
        if (!storage) storage.emplace(backend_, count);
        return storage->view();
    }

    Backend backend_;
    std::optional<Storage> current_, next_;
    Source source_ = Source::grid;
};

} // namespace firn

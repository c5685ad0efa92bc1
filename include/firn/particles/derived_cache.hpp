// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/particles/storage.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

namespace firn
{

/// The fields that a table's particles gather from the grid, while they are cached beside the particles: by
/// row, with a second storage that a step writes. While all particles have been added with the same values,
/// there is one row for all of them.
///
/// They are cached from accept(), resize() or extend() on, and after a swap() of what a step wrote. A step
/// that did not write them leaves them on the grid, to be regathered. Storage outlives that, so that keep()
/// can declare its values valid again after a rollback.
template <class Backend, class Space, class Set>
class DerivedCache
{
public:
    using Storage = DerivedStorage<Backend, Space, Set>;
    using View = typename Storage::View;
    using ConstView = typename Storage::ConstView;
    using Values = Record<typename Space::Scalar, Space::dimension, Set>;

    explicit DerivedCache(Backend const& backend) : backend_(backend) {}

    bool is_cached() const { return source_ == Source::cache; }
    /// The cached values; a view without fields if they are on the grid.
    ConstView view() const
    {
        if (!is_cached()) return {};
        ConstView view = std::as_const(*current_).view();
        view.same = same_.has_value();
        return view;
    }
    /// If is_cached(): a row for each particle.
    Storage& values()
    {
        if (same_) spread(count_);
        return *current_;
    }
    /// If is_cached(): the values that all particles have, if there is only one row of them; else all rows.
    std::optional<Values> const& same() const { return same_; }
    Storage const& rows() const { return *current_; }

    /// Where `count` particles' values are written before accept() or, in a step, before swap().
    View place(std::size_t count)
    {
        if (same_) {
            same_.reset();
            current_.reset();
        }
        return place(current_, count);
    }
    View next_place(std::size_t count)
    {
        if (same_) spread(count_); // since the step after that writes to this storage
        return place(next_, count);
    }
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
        same_.reset();
        current_.reset();
        next_.reset();
    }

    /// Makes room for `count` particles, all of which are still to be filled.
    void resize(std::size_t count)
    {
        if (!current_) current_.emplace(backend_, count);
        next_.reset();
        current_->resize(count);
        same_.reset();
        set_cached(true);
    }
    /// Adds particles with these values behind `size` existing ones, so that there are `count`.
    void extend(std::size_t size, std::size_t count, Values const& added)
    {
        next_.reset();
        if (size == 0) {
            if (!current_) current_.emplace(backend_, 1);
            current_->resize(1);
            current_->fill(0, added);
            same_ = added;
        }
        else if (!same_ || !has_same_bits(*same_, added)) {
            if (same_) spread(size);
            current_->resize(count);
            current_->fill(size, added);
        }
        count_ = count;
        set_cached(true);
    }
    /// Values of the listed rows, `count` of them, in a storage of their own; none if the values are on the
    /// grid, or the same for all.
    std::optional<Storage> gathered(std::uint32_t const* rows, std::size_t count) const
    {
        std::optional<Storage> values;
        if (!is_cached() || same_) return values;
        values.emplace(backend_, count);
        values->gather(backend_, *current_, rows);
        return values;
    }
    /// Replaces the storage by such values of `count` rows.
    void replace(std::optional<Storage> values, std::size_t count)
    {
        next_.reset();
        count_ = count;
        if (same_ && is_cached()) return;
        same_.reset();
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

    static bool has_same_bits(Values a, Values b)
    {
        using Number = typename Space::Scalar;
        std::vector<Number> numbers;
        a.for_each([&](int, Number const& value) { numbers.push_back(value); });
        bool same = true; // 0 and -0 are not
        b.for_each([&](int c, Number const& value) {
            same = same && std::memcmp(&numbers[std::size_t(c)], &value, sizeof value) == 0;
        });
        return same;
    }

    /// Gives each of `count` particles a row of its own.
    void spread(std::size_t count)
    {
        current_->resize(count);
        current_->fill(0, *same_);
        same_.reset();
    }

    void set_cached(bool cached) { source_ = cached && current_ ? Source::cache : Source::grid; }

    View place(std::optional<Storage>& storage, std::size_t count)
    {
        if (!storage) storage.emplace(backend_, count);
        return storage->view();
    }

    Backend backend_;
    std::optional<Storage> current_, next_;
    std::optional<Values> same_; ///< what the only row of `current_` holds for all particles
    std::size_t count_ = 0;      ///< of particles, while there is only one row
    Source source_ = Source::grid;
};

} // namespace firn

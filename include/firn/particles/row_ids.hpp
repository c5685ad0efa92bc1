// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

namespace firn
{

/// Which particles a table has, without looking at them: two of its marks are equal if none came or went
/// between them.
struct IdMark
{
    std::shared_ptr<std::vector<std::uint32_t> const> ids; ///< null: 0, 1, 2, …
    std::size_t size = 0;

    bool operator==(IdMark const&) const = default;
};

/// The permanent ids of a table's rows, in rising order. Nothing is stored while rows are ids, which they are
/// until a particle is removed, or one of another material is added between.
class RowIds
{
public:
    RowIds() = default;
    /// The ids of all rows, in rising order.
    explicit RowIds(std::vector<std::uint32_t> ids)
    {
        bool const rows_are_ids = ids.empty() || ids.back() == ids.size() - 1;
        if (!rows_are_ids) ids_ = std::make_shared<std::vector<std::uint32_t> const>(std::move(ids));
    }

    /// The mark of a table with so many rows.
    IdMark mark(std::size_t count) const { return {ids_, count}; }

    /// The permanent id of a row.
    std::uint32_t id(std::size_t row) const { return ids_ ? (*ids_)[row] : static_cast<std::uint32_t>(row); }
    /// The row of an existing id.
    std::uint32_t row(std::uint32_t id) const
    {
        if (!ids_) return id;
        return static_cast<std::uint32_t>(std::ranges::lower_bound(*ids_, id) - ids_->begin());
    }
    /// The ids of the first `count` rows.
    std::vector<std::uint32_t> first(std::size_t count) const
    {
        std::vector<std::uint32_t> ids(count);
        for (std::size_t row = 0; row < count; ++row) ids[row] = id(row);
        return ids;
    }

    /// The ids of the first `count` rows, and behind them of `more` rows whose ids begin with `first_id`.
    RowIds extended(std::size_t count, std::size_t more, std::uint32_t first_id) const
    {
        if (!ids_ && first_id == count) return {};
        std::vector<std::uint32_t> ids(count + more);
        for (std::size_t row = 0; row < count; ++row) ids[row] = id(row);
        std::iota(ids.begin() + static_cast<std::ptrdiff_t>(count), ids.end(), first_id);
        return RowIds(std::move(ids));
    }
    /// The ids of some rows, listed in rising order.
    RowIds kept(std::vector<std::uint32_t> const& rows) const
    {
        std::vector<std::uint32_t> ids;
        ids.reserve(rows.size());
        for (auto const row : rows) ids.push_back(id(row));
        return RowIds(std::move(ids));
    }

private:
    std::shared_ptr<std::vector<std::uint32_t> const> ids_; ///< null: rows are ids
};

} // namespace firn

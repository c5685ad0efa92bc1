// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/particles/row_ids.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

namespace firn
{

/// Finds particles by their permanent ids: at which index their values stand in positions(), download() and
/// all else that a solver returns by rising id.
///
///     IdLookup lookup; // or IdLookup<Snow> for the values of one material
///     auto const x = solver.positions();
///     x[lookup.index_of(solver, id)]
///
/// Each call looks whether particles have come or gone, which costs next to nothing. If so, the look-up reads
/// all ids once more. A call for one id then takes the same time for any number of particles. Steps and the
/// order of particles in memory change nothing of it.
template <class Which = EveryMaterial>
class IdLookup
{
public:
    /// The index of a particle. Throws an Error if there is none of this id.
    template <class Solver>
    std::size_t index_of(Solver const& solver, std::uint32_t id)
    {
        refresh(solver);
        return index_or_error(id);
    }

    /// The indices of some particles, in the order of the ids that were passed.
    template <class Solver>
    std::vector<std::size_t> indices_of(Solver const& solver, std::span<std::uint32_t const> ids)
    {
        refresh(solver);
        std::vector<std::size_t> indices;
        indices.reserve(ids.size());
        for (auto const id : ids) indices.push_back(index_or_error(id));
        return indices;
    }

    /// Whether there is a particle of this id.
    template <class Solver>
    bool contains(Solver const& solver, std::uint32_t id)
    {
        refresh(solver);
        return find(id) != none;
    }

private:
    static constexpr std::size_t none = std::size_t(-1);
    static constexpr std::uint32_t gap = std::uint32_t(-1);

    template <class Solver>
    void refresh(Solver const& solver)
    {
        auto const marks = solver.template id_marks<Which>();
        if (std::ranges::equal(marks, marks_)) return;
        auto const ids = solver.template ids<Which>();
        std::vector<std::uint32_t> window;
        std::unordered_map<std::uint32_t, std::uint32_t> scattered;
        auto const count = static_cast<std::uint32_t>(ids.size());
        std::uint32_t const first = count == 0 ? 0 : ids.front();
        std::size_t const width = count == 0 ? 0 : std::size_t(ids.back() - first) + 1;
        if (width > count) {                                 // else ids follow one another
            constexpr std::size_t numbers_per_particle = 16; // about what the other list takes
            if (width / numbers_per_particle <= count) {
                window.assign(width, gap);
                for (std::uint32_t i = 0; i < count; ++i) window[ids[i] - first] = i;
            }
            else {
                scattered.reserve(count);
                for (std::uint32_t i = 0; i < count; ++i) scattered.emplace(ids[i], i);
            }
        }
        marks_.assign(marks.begin(), marks.end());
        first_ = first;
        count_ = count;
        window_ = std::move(window);
        scattered_ = std::move(scattered);
    }

    std::size_t find(std::uint32_t id) const
    {
        if (!scattered_.empty()) {
            auto const found = scattered_.find(id);
            return found == scattered_.end() ? none : found->second;
        }
        if (id < first_) return none;
        std::size_t const place = id - first_;
        if (window_.empty()) return place < count_ ? place : none;
        return place < window_.size() && window_[place] != gap ? window_[place] : none;
    }

    std::size_t index_or_error(std::uint32_t id) const
    {
        std::size_t const index = find(id);
        if (index == none)
            throw Error{"there is no particle with the id " + std::to_string(id), "IdLookup",
                        "It was removed, is of another material, or was never added: ask contains() before, "
                        "or look ids() through."};
        return index;
    }

    std::vector<IdMark> marks_; ///< of the particles that the rest is about
    std::uint32_t first_ = 0, count_ = 0;
    std::vector<std::uint32_t> window_; ///< indices from the first id on; none: ids follow one another
    std::unordered_map<std::uint32_t, std::uint32_t> scattered_; ///< in place of the window, if not empty
};

} // namespace firn

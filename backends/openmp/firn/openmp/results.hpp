// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/workspace.hpp>

#include <cstddef>
#include <span>
#include <vector>

namespace firn::openmp::detail
{

/// The results of the parts of a loop, merged in the order of the parts, whichever thread did them. The
/// thread that works on a part calls begin() for it: then no other thread's cache needs to hold it.
template <class Result>
class ResultsOf
{
public:
    static ResultsOf& make_ready(Workspace& workspace, std::size_t parts)
    {
        auto& results = workspace.for_threads(1).template of<ResultsOf>(0);
        results.of_.resize(parts);
        return results;
    }
    Result& begin(std::size_t part) { return of_[part] = {}; }
    /// All of them; `parts` has their order, see CellOrder::merged and Grid::merged.
    template <class Parts>
    Result merged(Parts const& parts) const
    {
        return parts.merged(std::span<Result const>(of_));
    }

private:
    std::vector<Result> of_;
};

} // namespace firn::openmp::detail

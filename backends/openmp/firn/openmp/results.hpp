// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/workspace.hpp>

#include <cstddef>
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
    Result merged() const
    {
        Result all{};
        for (Result const& result : of_) all.merge(result);
        return all;
    }

private:
    std::vector<Result> of_;
};

} // namespace firn::openmp::detail

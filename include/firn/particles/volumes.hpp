// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_arrays.hpp>

#include <cstddef>
#include <iterator>
#include <string>
#include <vector>

namespace firn
{

/// The volumes at rest of particles that are added [m^3, in the plane m^2]: one for all of them, or an array
/// with one for each.
class Volumes
{
public:
    Volumes(double of_each) : of_each_(of_each) {}
    /// A std::vector, std::span or the like of floats or doubles, which is copied.
    template <HostArray<1> Array>
    Volumes(Array const& one_by_one)
        : are_listed_(true), list_(std::data(one_by_one), std::data(one_by_one) + std::size(one_by_one))
    {}

    /// Whether each particle has its own.
    bool are_listed() const { return are_listed_; }
    double operator[](std::size_t i) const { return are_listed_ ? list_[i] : of_each_; }

    /// Throws an Error unless there is one for each of `count` points, finite and above 0.
    void validate(std::size_t count) const
    {
        auto const is_good = [](double volume) { return is_finite(volume) && volume > 0; };
        auto const remedy = "Pass the volume in m^3 that one particle stands for: the body's volume over the "
                            "number of points.";
        if (!are_listed_) {
            require(is_good(of_each_), "the volume per point is not a finite number above 0", "Solver::add",
                    remedy);
            return;
        }
        if (list_.size() != count)
            throw Error{"there are " + std::to_string(list_.size()) + " volumes for " +
                            std::to_string(count) + " points",
                        "Solver::add", "Pass one volume for all, or one for each point."};
        for (std::size_t i = 0; i < count; ++i)
            if (!is_good(list_[i]))
                throw Error{"a volume is not a finite number above 0",
                            "Solver::add, volume " + std::to_string(i), remedy};
    }

private:
    bool are_listed_ = false;
    double of_each_ = 0;
    std::vector<double> list_;
};

} // namespace firn

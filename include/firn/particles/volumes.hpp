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

namespace detail
{
/// One number for all new particles, or an array with one for each: a std::vector, std::span or the like of
/// floats or doubles, which is copied.
class NumberOfEach
{
public:
    NumberOfEach(double of_all) : of_all_(of_all) {}
    template <HostArray<1> Array>
    NumberOfEach(Array const& one_by_one)
        : are_listed_(true), list_(std::data(one_by_one), std::data(one_by_one) + std::size(one_by_one))
    {}

    bool are_listed() const { return are_listed_; }
    double operator[](std::size_t i) const { return are_listed_ ? list_[i] : of_all_; }

    /// Throws an Error unless there is a number for each of `count` points, and each is good; `what` is one
    /// of them, and `are_wrong` says what is not good.
    template <class IsGood>
    void validate(std::size_t count, IsGood const& is_good, std::string const& what, char const* are_wrong,
                  char const* remedy) const
    {
        if (are_listed_ && list_.size() != count)
            throw Error{"there is not one " + what + " for each point, but " + std::to_string(list_.size()) +
                            " for " + std::to_string(count),
                        "Solver::add", "Pass one number for all, or one for each point."};
        for (std::size_t i = 0; i < (are_listed_ ? count : 1); ++i)
            if (!is_good((*this)[i]))
                throw Error{(are_listed_ ? "a " : "the ") + what + ' ' + are_wrong,
                            are_listed_ ? "Solver::add, " + what + ' ' + std::to_string(i) : "Solver::add",
                            remedy};
    }

private:
    bool are_listed_ = false;
    double of_all_ = 0;
    std::vector<double> list_;
};
} // namespace detail

/// The volumes at rest of particles that are added [m^3, in the plane m^2]: one for all of them, or an array
/// with one for each. They may come with densities of the particles' own, likewise one or an array.
class Volumes
{
public:
    Volumes(double of_each) : volumes_(of_each) {}
    template <HostArray<1> Array>
    Volumes(Array const& one_by_one) : volumes_(one_by_one)
    {}
    /// With densities [kg/m^3] in place of the model's. None is below that, by which steps are bounded.
    template <class OfVolumes, class OfDensities>
    Volumes(OfVolumes const& volumes, OfDensities const& densities)
        : volumes_(volumes), densities_(densities), have_densities_(true)
    {}

    /// Whether particles have volumes or densities one by one.
    bool are_listed() const { return volumes_.are_listed() || densities_.are_listed(); }
    /// Whether they have densities of their own.
    bool have_densities() const { return have_densities_; }

    double volume(std::size_t i) const { return volumes_[i]; }
    /// That of a particle, where the model has the given one.
    double density(std::size_t i, double of_model) const
    {
        return have_densities_ ? densities_[i] : of_model;
    }

    /// Throws an Error unless there is a volume for each of `count` points, finite and above 0, and likewise
    /// a density, finite and not below the model's, which is one of the scene's `Number`s.
    template <class Number>
    void validate(std::size_t count, Number density_of_model) const
    {
        volumes_.validate(
            count, [](double volume) { return is_finite(volume) && volume > 0; }, "volume",
            "is not a finite number above 0",
            "Pass the volume in m^3 that one particle stands for: the body's volume over the number of "
            "points.");
        if (!have_densities_) return;
        densities_.validate(
            count,
            [&](double density) {
                return is_finite(density) && static_cast<Number>(density) >= density_of_model;
            },
            "density", "is not finite, or below the model's, by which steps are bounded",
            "Pass kg/m^3, and let the model have the lowest of all.");
    }

private:
    detail::NumberOfEach volumes_, densities_ = 0.0;
    bool have_densities_ = false;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/failure_cause.hpp>
#include <firn/core/space.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

namespace firn
{

/// What failed in a step: the cause, the first particle, and where it was.
struct StepFailure
{
    /// The cause.
    FailureCause cause = FailureCause::none;
    std::uint32_t particle = 0;        ///< its permanent id
    std::size_t material = 0;          ///< its material's place in the scene
    Eigen::Vector3d position{0, 0, 0}; ///< before the step [m]; in the plane z is 0
    double time = 0;                   ///< at which the step began [s]
    double dt = 0;                     ///< length of the step [s]
    std::uint64_t count = 1;           ///< particles that failed in this step; this is the first
    /// In which of many worlds it was, and the position is that in this world: see Worlds.
    std::optional<std::uint32_t> world{};
};

/// A step that failed and cannot be repeated: the state is that of the last good step. `failure()` has the
/// numbers of the text.
class StepError : public Error
{
public:
    /// The numbers, and the sentences of an Error.
    StepError(StepFailure const& failure, std::string what_is_wrong, std::string where, std::string remedy)
        : Error(std::move(what_is_wrong), std::move(where), std::move(remedy)), failure_(failure)
    {}

    /// The numbers.
    StepFailure const& failure() const noexcept { return failure_; }

private:
    StepFailure failure_;
};

namespace detail
{
/// A place in words: "at (1 2) m", the first `d` coordinates. Eigen's own printing takes long
/// to compile, and g++ 12 warns about it with AVX-512.
[[gnu::cold]] inline std::string at_place(Eigen::Vector3d const& position, int d)
{
    std::ostringstream text;
    for (int a = 0; a < d; ++a) text << (a == 0 ? "at (" : " ") << position[a];
    text << ") m";
    return text.str();
}
/// The place of a failure, and its world if there are many: "at (1 2) m in world 3".
[[gnu::cold]] inline std::string at_place(StepFailure const& failure, int d)
{
    auto place = at_place(failure.position, d);
    if (failure.world) place += " in world " + std::to_string(*failure.world);
    return place;
}
} // namespace detail

} // namespace firn

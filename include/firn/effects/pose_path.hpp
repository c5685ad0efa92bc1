// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/motion.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace firn
{

/// Where a body is at given times, its keys. Between two of them its position lies on the straight line and
/// its orientation turns about one axis at a constant rate, the shorter way (slerp: Shoemake 1985, *Animating
/// rotation with quaternion curves*). Before the first key and after the last one it stands still.
///
/// A call's obstacle moves by `path.during(solver.time(), duration)`, a constant twist, of which each step
/// takes the pose of its own time. Where a key lies within a call, split the call there:
///
///     for (double left = frame; left > 0;) {
///         double const part = path.until_key(solver.time(), left);
///         hammer.motion = path.during(solver.time(), part);
///         solver.advance(part, hammer);
///         left -= part;
///     }
class PosePath
{
public:
    /// Adds a key at a time [s] behind all others: a position [m] and an orientation, from the body's frame
    /// to the world's. Throws an Error, and adds none, if the time does not come after the last one, or an
    /// obstacle may not have such a pose.
    void add(double time, Eigen::Vector3d const& position,
             Eigen::Quaterniond const& orientation = Eigen::Quaterniond::Identity())
    {
        Motion const pose{.position = position, .orientation = orientation, .time = time};
        pose.validate("PosePath::add");
        require(keys_.empty() || time > *keys_.back().time, "a key does not come after the one before it",
                "PosePath::add", "Add keys by rising time.");
        keys_.push_back(pose);
        keys_.back().orientation.normalize();
    }

    std::size_t size() const { return keys_.size(); } ///< how many keys there are

    /// The pose at a time [s]; velocities are 0.
    Motion at(double time) const
    {
        require(!keys_.empty(), "a path has no key", "PosePath::at", "Add poses first.");
        require(is_finite(time), "the time is not finite", "PosePath::at", "Pass seconds.");
        auto const after = std::upper_bound(keys_.begin(), keys_.end(), time,
                                            [](double t, Motion const& key) { return t < *key.time; });
        Motion pose = after == keys_.begin() ? keys_.front() : after[-1];
        if (after != keys_.begin() && after != keys_.end()) {
            double const share = (time - *pose.time) / (*after->time - *pose.time);
            pose.position += share * (after->position - pose.position);
            pose.orientation = pose.orientation.slerp(share, after->orientation);
        }
        pose.time = time;
        return pose;
    }

    /// The motion of a call that begins at a time [s] and takes `duration` [s]: a constant twist from the
    /// pose at its begin to that at its end. Keys between them are not seen: let no call span one at which
    /// the path turns, see until_key(). Throws an Error if the duration is not a finite number, 0 or above;
    /// with 0 the body stands.
    Motion during(double begin, double duration) const
    {
        require(is_finite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
                "PosePath::during", "Pass that of the call [s].");
        if (!(duration > 0)) return at(begin);
        return Motion::between(at(begin), at(begin + duration), duration);
    }

    /// For how long [s] a call that begins at a time [s] may go on without spanning a key: until the next
    /// one, or all of `duration` [s] if none comes before its end. A key that is less than 1e-9 of the
    /// duration from either end counts as there. Of several paths the shortest time is that of a call. Throws
    /// an Error unless the time is finite, and the duration a finite number, 0 or above.
    double until_key(double begin, double duration) const
    {
        require(is_finite(begin), "the time is not finite", "PosePath::until_key", "Pass seconds.");
        require(is_finite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
                "PosePath::until_key", "Pass what is left of the frame [s].");
        double const close = 1e-9 * duration;
        auto const next = std::upper_bound(keys_.begin(), keys_.end(), begin + close,
                                           [](double t, Motion const& key) { return t < *key.time; });
        return next != keys_.end() && *next->time < begin + duration - close ? *next->time - begin : duration;
    }

private:
    std::vector<Motion> keys_;
};

} // namespace firn

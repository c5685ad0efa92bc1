// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace firn::test
{

/// Of what the boards of a Hopper are.
enum class Boards
{
    boxes,
    capsules,    ///< in the plane: whose lower ends lie beside each other
    half_spaces, ///< without an opening, since they have no lower ends
};

struct HopperSetting
{
    Boards boards = Boards::boxes;
    double opening = 0; ///< [m]; 0: it is shut
    /// By how much boxes go on behind where their faces meet [cells]. 0: nothing but the edges of boards that
    /// lean against each other touch, and the walls of the tray stand on its floor.
    double overlap = 1;
    double slope = M_PI / 3;                                ///< of the boards [radians]
    double h = 0.02;                                        ///< of a cell [m]
    double height = 0.4;                                    ///< up to which it is filled [m]
    Eigen::Vector3d offset = Eigen::Vector3d(0.3, 0.21, 0); ///< from a node [cells]
    Contact contact = Contact::slip();
};

/// A hopper of two boards that lean against each other, in space of four; one with an opening stands over a
/// tray of boards that is closed at its sides.
template <class SceneType, ActsOn acts_on = ActsOn::surface_and_particles>
class Hopper
{
public:
    using Solver = typename SceneType::Solver;
    using Model = typename SceneType::Model;
    static constexpr int d = SceneType::d;

    Hopper(HopperSetting const& setting, Model const& model, typename SceneType::Backend const& backend = {})
        : setting_(setting), solver(lattice(setting.h), model, {}, {}, backend)
    {
        auto const [h, height] = std::array{setting.h, setting.height};
        double const half = height / std::tan(setting.slope) + setting.opening / 2;
        Vector<double, d> low = Vector<double, d>::Constant(-half), high = -low;
        low[1] = 0, high[1] = height;
        std::vector<Vector<double, d>> points;
        for (auto const& own : box_of_points<d>(low, high, h))
            if (depth_in_boards(own) < -h / 4) points.push_back(own + origin());
        solver.add(points, std::pow(h / 2, d));
        for (double const side : {-1.0, 1.0})
            for (int axis = 0; axis < d; axis += 2) add_board(axis, side);
        if (setting.opening > 0) add_tray(half + 4 * thickness());
    }

    /// Advances, and notes how many particles are in boards or have passed through them.
    void advance(double duration, double of_call = 0.005)
    {
        for (double left = duration; left > 1e-9; left -= of_call) {
            steps += solver.advance(std::min(of_call, left), Gravity{}, boards).substeps;
            std::size_t lost_now = 0;
            for (auto const& x : solver.positions()) {
                double const depth = depth_of(x - origin());
                deepest = std::max(deepest, depth / setting_.h);
                lost_now += depth > 0.5 * setting_.h;
            }
            lost = std::max(lost, lost_now);
        }
    }
    /// How many particles have come through the opening.
    std::size_t count_below() const
    {
        std::size_t count = 0;
        for (auto const& x : solver.positions()) count += (x - origin())[1] < 0;
        return count;
    }

private:
    /// Of boards, which are far thicker than what a particle moves in a call [m].
    double thickness() const { return 4 * setting_.h; }
    double overlap() const { return setting_.overlap * setting_.h; }
    double bottom() const { return setting_.opening > 0 ? -0.5 * setting_.height : 0; }
    Vector<double, d> origin() const
    {
        Vector<double, d> at;
        for (int a = 0; a < d; ++a) at[a] = setting_.offset[a] * setting_.h;
        return at;
    }
    Eigen::Vector3d in_space(Vector<double, d> const& own) const
    {
        Eigen::Vector3d at = Eigen::Vector3d::Zero();
        for (int a = 0; a < d; ++a) at[a] = own[a] + origin()[a];
        return at;
    }

    /// How far a place is behind the inner faces of the boards [m].
    double depth_in_boards(Vector<double, d> const& own) const
    {
        double deepest_here = -1e9;
        for (int axis = 0; axis < d; axis += 2)
            deepest_here = std::max(deepest_here,
                                    (std::abs(own[axis]) - setting_.opening / 2) * std::sin(setting_.slope) -
                                        own[1] * std::cos(setting_.slope));
        return deepest_here;
    }
    /// How deep it is in a board, or how far it is out of bounds [m].
    double depth_of(Vector<double, d> const& own) const
    {
        double depth = bottom() - own[1];
        if (tray_ > 0)
            for (int axis = 0; axis < d; axis += 2) depth = std::max(depth, std::abs(own[axis]) - tray_);
        else
            depth = std::max(depth, depth_in_boards(own) - thickness());
        for (auto const& distance : distances_) depth = std::max(depth, -distance(own));
        return depth;
    }

    template <class Shape>
    void add(Shape const& shape, Vector<double, d> const& own,
             Eigen::Quaterniond const& orientation = Eigen::Quaterniond::Identity())
    {
        distances_.push_back([=](Vector<double, d> const& x) {
            Eigen::Vector3d away = Eigen::Vector3d::Zero();
            away.head<d>() = x - own;
            away = orientation.inverse() * away;
            return shape.template surface<double, d>(Vector<double, d>(away.head<d>())).distance;
        });
        boards.list.push_back({.shape = shape,
                               .contact = setting_.contact,
                               .motion = {.position = in_space(own), .orientation = orientation},
                               .on_particles = acts_on == ActsOn::surface_and_particles});
    }
    void add_board(int axis, double side)
    {
        // in the plane of this axis and y: up along the board, and out of its inner face
        double const along = std::cos(setting_.slope), rise = std::sin(setting_.slope),
                     wide = 2 * setting_.height,
                     beyond = setting_.boards == Boards::boxes && setting_.opening <= 0 ? overlap() : 0,
                     length = 1.5 * setting_.height / rise + beyond;
        Vector<double, d> up = Vector<double, d>::Zero(), normal = up, foot = up;
        up[axis] = side * along, up[1] = rise;
        normal[axis] = -side * rise, normal[1] = along;
        foot[axis] = side * setting_.opening / 2;
        if (setting_.boards == Boards::half_spaces) {
            Eigen::Vector3d inwards = Eigen::Vector3d::Zero();
            for (int a = 0; a < d; ++a) inwards[a] = normal[a];
            return add(HalfSpace{inwards}, foot);
        }
        Vector<double, d> const middle = foot + up * (length / 2 - beyond) - normal * thickness() / 2;
        double const lean = (axis == 0 ? -side : side) * (M_PI / 2 - setting_.slope);
        Eigen::Vector3d const around = axis == 0 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
        Eigen::Quaterniond const orientation(Eigen::AngleAxisd(lean, around));
        if (setting_.boards == Boards::capsules)
            return add(Capsule{thickness() / 2, length / 2}, middle, orientation);
        Eigen::Vector3d half(wide, length / 2, wide);
        half[axis] = thickness() / 2;
        add(Box{half}, middle, orientation);
    }
    void add_tray(double half)
    {
        tray_ = half;
        double const wide = half + 2 * thickness(), low = bottom() - overlap(),
                     high = 3 * setting_.height - low;
        Vector<double, d> floor = Vector<double, d>::Zero();
        floor[1] = bottom() - thickness() / 2;
        add(Box{{wide, thickness() / 2, wide}}, floor);
        for (double const side : {-1.0, 1.0})
            for (int axis = 0; axis < d; axis += 2) {
                Vector<double, d> middle = Vector<double, d>::Zero();
                middle[axis] = side * (half + thickness() / 2), middle[1] = low + high / 2;
                Eigen::Vector3d extents(wide, high / 2, wide);
                extents[axis] = thickness() / 2;
                add(Box{extents}, middle);
            }
    }

    HopperSetting setting_;
    double tray_ = 0;                                                        // half its width [m]
    std::vector<std::function<double(Vector<double, d> const&)>> distances_; // from each board [m]

public:
    Solver solver;
    Obstacles<AnyShape<>, acts_on> boards;
    std::size_t lost =
        0; ///< the most that were out of bounds, or in a board by half a cell, at the end of a call
    std::uint64_t steps = 0;
    double deepest = -1e9; ///< [cells]
};

} // namespace firn::test

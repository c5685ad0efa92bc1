// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/refused.hpp"

#include <firn/effects/obstacle.hpp>
#include <firn/effects/pose_path.hpp>
#include <firn/effects/shapes/all.hpp>
#include <firn/effects/shapes/any_shape.hpp>
#include <firn/effects/shapes/inside.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/effects/shapes/union.hpp>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

std::vector<Eigen::Vector3d> some_points()
{
    std::mt19937 random(1);
    std::uniform_real_distribution<double> within(-1, 1);
    std::vector<Eigen::Vector3d> points(200);
    for (auto& x : points) x = {within(random), within(random), within(random)};
    return points;
}

/// Compares the surfaces of a shape as loops know it, and of another one.
template <class One, class Other>
void same_surface(One const& one, Other const& other)
{
    for (auto const& x : some_points()) {
        auto const a = surface_of<double, 3>(detail::plain(one), x), b = surface_of<double, 3>(other, x);
        CHECK(a.distance == b.distance);
        CHECK((a.normal == b.normal));
    }
}

Eigen::Quaterniond about_z(double angle)
{
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()));
}

} // namespace

TEST_CASE("a shape chosen at run time is the one that was chosen")
{
    AnyShape<> shape;
    same_surface(shape, HalfSpace{});
    CHECK(shape.reach() == 0);
    Capsule const capsule{0.2, 0.4};
    shape = capsule;
    same_surface(shape, capsule);
    CHECK(shape.reach() == capsule.reach());
    CHECK(shape.as<Box>() == nullptr);
    REQUIRE(shape.as<Capsule>() != nullptr);
    shape.as<Capsule>()->radius = -1;
    refused([&] { shape.validate(); });
    shape = Box{{0.3, 0.2, 0.1}};
    same_surface(shape, Box{{0.3, 0.2, 0.1}});
    CHECK(shape.reach(2) == Approx(std::hypot(0.3, 0.2)));

    std::vector<float> values;
    for (int z = 0; z < 3; ++z)
        for (int y = 0; y < 3; ++y)
            for (int x = 0; x < 3; ++x) values.push_back(float(x + y) - 1.5f);
    using Sampled = SignedDistanceGrid<float, 3>;
    Sampled const grid({0, 0, 0}, 0.5f, {3, 3, 3}, values);
    AnyShape<Sampled> const sampled = grid;
    static_assert(AnyShape<Sampled>::in_host_memory && !AnyShape<>::in_host_memory);
    for (auto const& x : some_points()) {
        Eigen::Vector3f const at = x.cast<float>();
        CHECK(surface_of<float, 3>(sampled.view(), at).distance ==
              surface_of<float, 3>(grid.view(), at).distance);
    }
}

TEST_CASE("the surface of a union is the nearest of its parts, each at its place")
{
    Union<Sphere, Box> const both{{{.shape = {0.3}, .position = {0.4, 0, 0}},
                                   {.shape = {{0.5, 0.1, 0.2}}, .orientation = about_z(M_PI / 3)}}};
    both.validate();
    CHECK(both.reach() == Approx(0.7));
    auto const plain = both.view();
    for (auto const& x : some_points()) {
        auto const found = plain.surface<double, 3>(x);
        auto const of_sphere = Sphere{0.3}.surface<double, 3>(x - Eigen::Vector3d(0.4, 0, 0));
        auto of_box = Box{{0.5, 0.1, 0.2}}.surface<double, 3>(about_z(-M_PI / 3) * x);
        of_box.normal = about_z(M_PI / 3) * of_box.normal;
        auto const& nearest = of_box.distance < of_sphere.distance ? of_box : of_sphere;
        CHECK(std::abs(found.distance - nearest.distance) <= 1e-14);
        CHECK((found.normal - nearest.normal).norm() <= 1e-12);
        // the normal is the gradient of the distance
        double const step = 1e-6;
        double const beyond = plain.surface<double, 3>(Eigen::Vector3d(x + step * found.normal)).distance;
        CHECK(beyond - found.distance == Approx(step).epsilon(1e-3));
    }
    CHECK(Union<Sphere, HalfSpace>{}.reach() == 0); // unbounded
    Union<Sphere> wrong{};
    std::get<0>(wrong.parts).position.x() = std::numeric_limits<double>::quiet_NaN();
    refused([&] { wrong.validate(); });
    Union<Box> leaves{};
    std::get<0>(leaves.parts).orientation = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX());
    refused([&] { leaves.validate_in_plane(); });
}

TEST_CASE("a region is of a union, of a shape chosen at run time, or of both, as its parts are one by one")
{
    Motion const pose{.position = {0.1, -0.2, 0.3}, .orientation = about_z(0.7)};
    Inside<Sphere> const ball{{0.6}, {.position = pose.position + about_z(0.7) * Eigen::Vector3d(0.4, 0, 0)}};
    Inside<Box> const box{{{0.8, 0.3, 0.5}}, pose};
    Union<Sphere, Box> const both{{{.shape = {0.6}, .position = {0.4, 0, 0}}, {.shape = box.shape}}};
    AnyShape<Union<Sphere, Box>> const chosen = both;
    Inside<Union<Sphere, Box>> const inside{both, pose};
    Inside<AnyShape<Union<Sphere, Box>>> const inside_chosen{chosen, pose};
    Outside<Union<AnyShape<>, Box>> const outside{
        {{{.shape = Sphere{0.6}, .position = {0.4, 0, 0}}, {box.shape}}}, pose};
    inside.validate();
    outside.validate_in_plane();
    auto const in_scene = outside.with_images(Lattice{0.1}, 3); // as loops know it
    std::size_t count = 0;
    for (auto const& x : some_points()) {
        bool const is_inside = ball(x) || box(x);
        count += is_inside ? 1 : 0;
        CHECK(inside(x) == is_inside);
        CHECK(inside_chosen(x) == is_inside);
        CHECK(outside(x) == !is_inside);
        CHECK(in_scene(x) == !is_inside);
    }
    CHECK(count > 20);

    // of samples in single precision, which are asked in it
    using Sampled = SignedDistanceGrid<float, 2>;
    std::vector<float> const values{-1, -1, 1, 1}; // solid where y < 0.5
    Sampled const grid({0, 0}, 1.0f, {2, 2}, values);
    Inside<Union<Sampled, Sphere>> const sampled{
        {{{.shape = grid}, {.shape = {0.1}, .position = {0.5, 1, 0}}}}};
    static_assert(Inside<Union<Sampled, Sphere>>::in_host_memory && !Inside<Union<Sphere>>::in_host_memory);
    CHECK(sampled(Eigen::Vector2d(0.5, 0.4)));
    CHECK(sampled(Eigen::Vector2d(0.5, 0.95)));
    CHECK_FALSE(sampled(Eigen::Vector2d(0.5, 0.7)));
    CHECK(Inside<AnyShape<Sampled>>{grid}(Eigen::Vector2d(0.5, 0.4)));
    CHECK_FALSE(Inside<AnyShape<Sampled>>{Sphere{0.1}}(Eigen::Vector2d(0.5, 0.4)));
    Inside<Union<Sphere>> wrong{};
    std::get<0>(wrong.shape.parts).shape.radius = -1;
    refused([&] { wrong.validate(); });
}

TEST_CASE("a path goes through its poses, straight and at a constant rate between them")
{
    PosePath path;
    refused([&] { (void)path.at(0); });
    path.add(1, {0, 1, 0});
    path.add(2, {2, 1, 0}, about_z(1.2));
    path.add(4, {2, 5, 0}, about_z(1.0));
    refused([&] { path.add(4, {0, 0, 0}); });
    refused([&] { path.add(5, {std::numeric_limits<double>::infinity(), 0, 0}); });
    refused([&] { path.add(5, {0, 0, 0}, Eigen::Quaterniond(0, 0, 0, 0)); });
    CHECK(path.size() == 3);
    auto const is_at = [&](double time, Eigen::Vector3d const& position, double angle) {
        Motion const pose = path.at(time);
        CHECK((pose.position - position).norm() <= 1e-14);
        CHECK(pose.orientation.angularDistance(about_z(angle)) <= 1e-7); // by an inverse cosine
        CHECK(pose.velocity.norm() == 0);
    };
    is_at(0, {0, 1, 0}, 0);
    is_at(1, {0, 1, 0}, 0);
    is_at(1.25, {0.5, 1, 0}, 0.3);
    is_at(2, {2, 1, 0}, 1.2);
    is_at(3, {2, 3, 0}, 1.1);
    is_at(7, {2, 5, 0}, 1.0);

    Motion const motion = path.during(1.25, 0.5);
    CHECK((motion.velocity - Eigen::Vector3d(2, 0, 0)).norm() <= 1e-12);
    CHECK((motion.angular_velocity - Eigen::Vector3d(0, 0, 1.2)).norm() <= 1e-12);
    CHECK(*motion.time == 1.25);
    Motion const later = motion.at(1.75);
    CHECK((later.position - path.at(1.75).position).norm() <= 1e-12);
    CHECK(path.during(5, 1).velocity.norm() == 0); // it stands
    CHECK(path.during(1.5, 0).velocity.norm() == 0);
    refused([&] { (void)path.during(1, -1); });

    CHECK(path.until_key(0, 0.5) == 0.5);
    CHECK(path.until_key(0.5, 2) == 0.5);
    CHECK(path.until_key(1, 2) == 1);
    CHECK(path.until_key(1.5, 0.5) == 0.5); // it ends with the key
    CHECK(path.until_key(1.5, 0.5 + 1e-10) == 0.5 + 1e-10);
    CHECK(path.until_key(2 - 1e-10, 1) == 1); // it begins with it
    CHECK(path.until_key(4, 100) == 100);
    CHECK(path.until_key(2, 0) == 0);
    CHECK(PosePath().until_key(0, 3) == 3);
    refused([&] { (void)path.until_key(1, -1); });
    refused([&] { (void)path.until_key(1, std::numeric_limits<double>::quiet_NaN()); });
    refused([&] { (void)path.until_key(std::numeric_limits<double>::infinity(), 1); });
}

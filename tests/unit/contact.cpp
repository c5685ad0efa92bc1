// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/test_lane.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

using Vec = Vector<double, 3>;

Vec random_vector(std::mt19937& random)
{
    std::normal_distribution<double> normal;
    return {normal(random), normal(random), normal(random)};
}

template <class Use>
void for_each_random(Use const& use)
{
    std::mt19937 random(5);
    for (int i = 0; i < 10000; ++i) {
        Vec const v = random_vector(random);
        use(v, Vec(random_vector(random).normalized()), std::abs(random_vector(random)[0]));
    }
}

} // namespace

TEST_CASE("friction sticks where the tangential speed is within mu times the approach, and slides beyond")
{
    Vec const up = Vec::UnitZ();
    auto const rule = Contact::coulomb(0.5);
    CHECK(rule.after<double, 3>({0.1, 0, -1}, up) == Vec(0, 0, 0)); // the swapped rule gives (-0.4, 0, 0)
    CHECK((rule.after<double, 3>({2, 0, -1}, up) - Vec(1.5, 0, 0)).norm() <= 1e-15);
    CHECK(rule.after<double, 3>({2, 0, 1}, up) == Vec(2, 0, 1));
    CHECK(rule.after<double, 3>({0, 0, -1}, up) == Vec(0, 0, 0));
}

TEST_CASE("contact never makes anything faster, keeps the direction of sliding, and is done after once")
{
    for_each_random([](Vec const& v, Vec const& n, double mu) {
        for (auto const& rule :
             {Contact::coulomb(mu), Contact::slip(), Contact::bound_slip(), Contact::sticky()}) {
            Vec const after = rule.after<double, 3>(v, n);
            CHECK(after.norm() <= v.norm() * (1 + 1e-15));
            CHECK(after.dot(n) >= -1e-15 * v.norm());
            Vec const tangential = v - n * v.dot(n), left = after - n * after.dot(n);
            CHECK((left * tangential.norm() - tangential * left.norm()).norm() <=
                  1e-14 * (1 + v.squaredNorm()));
            if (v.dot(n) < 0)
                CHECK((rule.after<double, 3>(after, n) - after).norm() <= 1e-15 * (1 + v.norm()));
        }
    });
}

TEST_CASE("no friction is slip, and infinite friction sticks on approach")
{
    auto const infinite = Contact::coulomb(std::numeric_limits<double>::infinity());
    for_each_random([&](Vec const& v, Vec const& n, double) {
        CHECK(Contact::coulomb(0).after<double, 3>(v, n) == Contact::slip().after<double, 3>(v, n));
        if (v.dot(n) < 0)
            CHECK(infinite.after<double, 3>(v, n).norm() == 0);
        else
            CHECK((infinite.after<double, 3>(v, n) - v).norm() <= 1e-15 * (1 + v.norm()));
    });
}

TEST_CASE("contact with packs of velocities is contact with each")
{
    using Pack = TestLane<double>;
    std::mt19937 random(8);
    for (int i = 0; i < 1000; ++i) {
        double v[3][4], n[3][4];
        Vector<Pack, 3> packed_v, packed_n;
        for (int l = 0; l < 4; ++l) {
            Vec const one = random_vector(random), normal = random_vector(random).normalized();
            for (int a = 0; a < 3; ++a) v[a][l] = one[a], n[a][l] = normal[a];
        }
        for (int a = 0; a < 3; ++a)
            packed_v[a] = LaneTraits<Pack>::load(v[a]), packed_n[a] = LaneTraits<Pack>::load(n[a]);
        auto const rule = Contact::coulomb(0.4);
        Vector<Pack, 3> const after = rule.after<Pack, 3>(packed_v, packed_n);
        for (int a = 0; a < 3; ++a) {
            double lane[4];
            LaneTraits<Pack>::store(after[a], lane);
            for (int l = 0; l < 4; ++l) {
                Vec const one =
                    rule.after<double, 3>({v[0][l], v[1][l], v[2][l]}, {n[0][l], n[1][l], n[2][l]});
                CHECK(std::abs(lane[l] - one[a]) <= 1e-14 * (1 + one.norm()));
            }
        }
    }
}

namespace
{

// One of each shape of the list; of one that is put on it there is to be one, too.
Sphere one_of(std::type_identity<Sphere>) { return {0.8}; }
Box one_of(std::type_identity<Box>) { return {{0.5, 0.7, 0.9}}; }
Capsule one_of(std::type_identity<Capsule>) { return {0.3, 0.6}; }
HalfSpace one_of(std::type_identity<HalfSpace>) { return {{0.6, -0.8, 0}}; }

template <class Shape, int d>
void check_distances()
{
    Shape const shape = one_of(std::type_identity<Shape>{});
    shape.validate();
    std::mt19937 random(9);
    int smooth = 0;
    double least = 0, most_growth = 0, of_normal = 0, of_gradient = 0;
    Vector<double, d> last = Vector<double, d>::Zero();
    for (int i = 0; i < 2000; ++i) {
        Vector<double, d> const x = random_vector(random).template head<d>();
        auto const here = shape.template surface<double, d>(x);
        least = std::min(least, here.distance);
        of_normal = std::max(of_normal, std::abs(here.normal.norm() - 1));
        auto const elsewhere = shape.template surface<double, d>(last);
        most_growth = std::max(most_growth, std::abs(elsewhere.distance - here.distance) / (last - x).norm());
        last = x;
        for (int a = 0; a < d; ++a) {
            double const step = 1e-6;
            Vector<double, d> const away = step * Vector<double, d>::Unit(a);
            auto const left = shape.template surface<double, d>(Vector<double, d>(x - away)),
                       right = shape.template surface<double, d>(Vector<double, d>(x + away));
            if ((left.normal - right.normal).norm() > 1e-3) continue; // another face is the closest one
            ++smooth;
            of_gradient = std::max(of_gradient,
                                   std::abs((right.distance - left.distance) / (2 * step) - here.normal[a]));
        }
    }
    CAPTURE(d, least);
    CHECK(least < -0.1); // some were inside
    CHECK(smooth > 1900 * d);
    CHECK(of_normal <= 1e-12);
    CHECK(most_growth <= 1 + 1e-12);
    CHECK(of_gradient <= 1e-5);
}

} // namespace

TEMPLATE_LIST_TEST_CASE(
    "the distance to a shape grows by no more than the way, and its gradient is the normal", "",
    AllPlainShapes)
{
    check_distances<TestType, 2>();
    check_distances<TestType, 3>();
}

TEST_CASE("shapes know their distances")
{
    CHECK(Sphere{2}.surface<double, 3>({3, 0, 4}).distance == Approx(3));
    CHECK(Capsule{1, 2}.surface<double, 3>({3, 1, 0}).distance == Approx(2));
    CHECK(Capsule{1, 2}.surface<double, 3>({0, 5, 0}).distance == Approx(2));
    CHECK(Box{{1, 2, 3}}.surface<double, 3>({4, 6, 0}).distance == Approx(5));
    CHECK(Box{{1, 2, 3}}.surface<double, 3>({0.5, 0, 0}).distance == Approx(-0.5));
    CHECK(HalfSpace{}.surface<double, 3>({7, -2, 1}).distance == Approx(-2));
    CHECK(Sphere{1}.surface<double, 3>({0, 0, 0}).normal.norm() == Approx(1));
    CHECK(Box{{1, 1, 1}}.surface<double, 3>({0, 0, 0}).normal.norm() == Approx(1));
    CHECK(Sphere{1}.surface<double, 2>({0, 3}).distance == Approx(2));
}

TEST_CASE("the surface of what turns is as fast as its farthest point, in the plane that of its section")
{
    Obstacle<Box> const box{.shape = {{3, 4, 100}}, .motion = {.angular_velocity = {0, 0, 2}}};
    CHECK(box.largest_speed(2) == Approx(10));
    CHECK(box.largest_speed(3) == Approx(2 * std::sqrt(10025.0)));
    Obstacle<Shell<Box>> const crate{.shape = {box.shape, 0.5}, .motion = box.motion};
    CHECK(crate.largest_speed(2) == Approx(10.5));
    CHECK(Obstacle<HalfSpace>{.motion = box.motion}.largest_speed(2) == 0);
}

TEST_CASE("an effect bounds the step by its speed in a space, or in any")
{
    struct Anywhere
    {
        double largest_speed() const { return 3; }
    };
    struct
    {
        double acceleration = 0, obstacle_speed = 0;
    } rule;
    detail::admit_effect<2>(rule, Anywhere{});
    CHECK(rule.obstacle_speed == 3);
    detail::admit_effect<2>(rule,
                            Obstacle<Box>{.shape = {{3, 4, 100}}, .motion = {.angular_velocity = {0, 0, 2}}});
    CHECK(rule.obstacle_speed == Approx(10));
}

TEST_CASE("the motion between two poses brings a body from one to the other, by the shortest rotation")
{
    using Turn = Eigen::AngleAxisd;
    Vec const axis = Vec(1, -2, 0.5).normalized();
    double const dt = 1.0 / 24;
    Motion before{.position = {1, 2, -3}, .orientation = Eigen::Quaterniond(Turn(2.5, Vec::UnitX()))};
    for (double angle : {0.0, 1e-12, 1e-5, 0.3, 3.1, M_PI, 3.3, -1.0, 6.2}) {
        CAPTURE(angle);
        Eigen::Quaterniond turned = Turn(angle, axis) * before.orientation;
        turned.coeffs() *= angle < 1 ? -1 : 1; // the same rotation, and no unit quaternion is asked for
        Motion const after{.position = {1.5, 2, 7}, .orientation = turned, .velocity = {9, 9, 9}};
        Motion const motion = Motion::between(before, after, dt);
        CHECK(!motion.time.has_value());
        CHECK(motion.position == before.position);
        CHECK((motion.velocity - Vec(12, 0, 240)).norm() <= 1e-12 * 240);
        double const shortest = std::abs(std::remainder(angle, 2 * M_PI));
        CHECK(motion.angular_velocity.norm() * dt == Approx(shortest).margin(1e-15));
        Motion const there = motion.later_by(dt);
        CHECK((there.position - after.position).norm() <= 1e-14);
        CHECK((there.rotation() - after.rotation()).norm() <= 1e-14);
    }
    // in the plane it stays there
    Motion::between(before = {}, {.orientation = Eigen::Quaterniond(Turn(-3, Vec::UnitZ()))}, dt)
        .validate_in_plane("here");
    before.time = 4;
    CHECK(Motion::between(before, {}, dt).time == 4.0); // as successive poses have it
    double const infinite = std::numeric_limits<double>::infinity();
    for (double wrong : {0.0, -1.0, infinite, std::nan("")})
        CHECK_THROWS_WITH(Motion::between({}, {}, wrong), Contains("Motion::between") && Contains("above 0"));
    CHECK_THROWS_AS(Motion::between({.position = {infinite, 0, 0}}, {}, dt), Error);
    CHECK_THROWS_AS(Motion::between({}, {.position = {0, std::nan(""), 0}}, dt), Error);
    CHECK_THROWS_AS(Motion::between({}, {.orientation = {0, 0, 0, 0}}, dt), Error);
    CHECK_THROWS_AS(Motion::between({}, {.position = {1, 0, 0}}, 1e-300), Error);
}

TEST_CASE("a motion without a time holds when it is asked for, and one with a time goes on")
{
    static_assert(std::is_trivially_copyable_v<decltype(Motion::time)>);
    Motion motion{.position = {1, 0, 0}, .velocity = {2, 0, 0}};
    CHECK(motion.at(7).position.x() == 1);
    CHECK(motion.at(7).time == 7.0);
    CHECK(motion.at(7).at(9).position.x() == 5);
    CHECK(motion.from(7).at(9).position.x() == 5);
    CHECK(motion.later_by(2).position.x() == 5);
    CHECK(!motion.later_by(2).time.has_value());
    motion.time = 6;
    CHECK(motion.at(7).position.x() == 3);
    CHECK(motion.from(7).at(7).position.x() == 3);
    CHECK(motion.later_by(2).time == 8.0);
    motion.time = std::nan("");
    CHECK_THROWS_AS(motion.validate("here"), Error);
}

TEST_CASE("a rotating body comes round, and moves its surface at v + omega x r")
{
    Motion const motion{
        .position = {1, 2, 3}, .velocity = {0.5, 0, 0}, .angular_velocity = {0, 0, 2 * M_PI}, .time = 1};
    auto const later = motion.at(2.25);
    CHECK((later.position - Eigen::Vector3d(1.625, 2, 3)).norm() <= 1e-14);
    CHECK((later.orientation * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 1, 0)).norm() <= 1e-12);

    Obstacle<Sphere> const wheel{.shape = {1}, .contact = Contact::sticky(), .motion = motion};
    auto const action = wheel.over<double, 3>({1.0, 1.0});
    LanePosition<double, 3> const place{
        lattice(0.1), {10, 25, 30}, Vec::Zero()}; // (1, 2.5, 3): half a metre above the centre
    auto const touched = action.touch<double>(place, Vec(0, 0, 0), wheel.contact);
    CHECK(touched.inside);
    CHECK((touched.velocity - Vec(0.5 - M_PI, 0, 0)).norm() <= 1e-12);
}

TEST_CASE("deeper inside a solid than the kernel reaches nothing slides, and only what leaves it moves")
{
    Obstacle<Box> const box{.shape = {{1, 1, 1}}, .motion = {.velocity = {0, 0, 0.5}}};
    auto const action = box.over<double, 3>({0, 0});
    auto const after = [&](double cells_deep, Vec const& before, double kernel_reach = 1.5) -> Vec {
        LanePosition<double, 3> const place{lattice(0.1), {10, 0, 0}, Vec(-cells_deep, 0, 0), kernel_reach};
        return action.touch<double>(place, before, box.contact).velocity;
    };
    CHECK((after(1.4, {-1, 2, 3}) - Vec(0, 2, 3)).norm() <= 1e-14);
    CHECK((after(1.6, {-1, 2, 3}) - Vec(0, 0, 0.5)).norm() <= 1e-14);
    CHECK((after(1.6, {1, 2, 3}) - Vec(1, 0, 0.5)).norm() <= 1e-14);
    CHECK((after(1.6, {1, 2, 3}, 2) - Vec(1, 2, 3)).norm() <= 1e-14);
}

TEST_CASE("in a corner the last word is that nothing moves into either wall")
{
    Obstacle<HalfSpace> const floor{.shape = {{0, 1, 0}}, .contact = Contact::coulomb(0.8)};
    Obstacle<HalfSpace> const slope{.shape = {Vec(1, 1, 0).normalized()}, .contact = Contact::coulomb(0.3)};
    auto const both = plain_effects(0, floor, slope).over<double, 3>({0, 0.1});
    Reactions<2> reactions;
    LanePosition<double, 3> const place{lattice(0.1), {0, 0, 0}, Vec(-1, -1, 0)};
    Vec const before(-3, -1, 0.5);
    Vec const after = apply_on_nodes<double, 3>(both, place, {2.0, true, 2.0}, before, reactions);
    CHECK(after[1] >= -1e-12);
    CHECK(after.dot(Vec(1, 1, 0)) >= -1e-12);
    CHECK((reactions.of[0].impulse + reactions.of[1].impulse - 2.0 * (before - after)).norm() <= 1e-12);
}

namespace
{

/// A particle at a height [m] over a node in the plane, that came there by a motion in a step of 0.01 s.
struct Lone
{
    double height;
    Eigen::Vector2d motion, velocity; ///< [m/s]
    static constexpr double dt = 0.01;

    /// Corrects the velocity; the displacement [m] by contact with some obstacles, and what they receive.
    template <class... Effects>
    Eigen::Vector2d touch(Effects const&... effects)
    {
        auto const all = plain_effects(0, effects...).template over<double, 2>({0, dt});
        Reactions<sizeof...(Effects)> reactions;
        LanePosition<double, 2> const place{lattice(0.1), {0, 0}, Eigen::Vector2d(0, height / 0.1)};
        Eigen::Vector2d const moved = motion * dt, before = velocity;
        Eigen::Vector2d const displacement =
            apply_on_particles<double, 2>(all, place, moved, true, 2.0, dt, velocity, reactions);
        received.setZero();
        for (auto const& of : reactions.of) received += of.impulse.template head<2>();
        CHECK((received - 2 * (before - velocity)).norm() <= 1e-14);
        return displacement;
    }
    Eigen::Vector2d received{0, 0}; ///< [N s]
};

Obstacle<HalfSpace> floor_for_particles(Contact const& contact)
{
    return {.contact = contact, .on_particles = true};
}

} // namespace

TEST_CASE("contact takes back of a particle's way what led into the obstacle, and no more")
{
    // moves with its velocity: it comes to rest where it was, and as far out again as it was inside
    Lone fast{-0.002, {1, -0.5}, {1, -0.5}};
    CHECK((fast.touch(floor_for_particles(Contact::coulomb(1))) - Eigen::Vector2d(-0.005, 0.007)).norm() <=
          1e-15);
    CHECK((fast.velocity - Eigen::Vector2d(0.5, 0)).norm() <= 1e-15);
    // flies at it by its own velocity, but rests, or slides, with the grid: no correction is due
    for (double slide : {0.0, 3.0}) {
        Lone own{-1e-4, {slide, 0}, {slide + 2, -5}};
        CHECK((own.touch(floor_for_particles(Contact::coulomb(0.1))) - Eigen::Vector2d(0, 1e-4)).norm() <=
              1e-15);
        CHECK((own.velocity - Eigen::Vector2d(slide + 1.5, 0)).norm() <= 1e-14);
    }
    Lone stuck{-1e-4, {0, 0}, {2, -5}};
    CHECK((stuck.touch(floor_for_particles(Contact::sticky())) - Eigen::Vector2d(0, 1e-4)).norm() <= 1e-15);
    CHECK(stuck.velocity.norm() == 0);
    // the other way about: the grid carries it in, its own velocity is away
    Lone carried{-0.002, {0, -0.5}, {0, 1}};
    CHECK((carried.touch(floor_for_particles(Contact::slip())) - Eigen::Vector2d(0, 0.007)).norm() <= 1e-15);
    CHECK(carried.velocity.y() == 1);
}

TEST_CASE("obstacles that do not act on particles do not change how others push them")
{
    Obstacle<HalfSpace> far{.motion = {.position = {0, -100, 0}}};
    auto const floor = floor_for_particles(Contact::coulomb(0.5));
    Lone alone{-0.003, {1, -0.5}, {1, -0.5}}, watched = alone, between = alone;
    Eigen::Vector2d const pushed = alone.touch(floor);
    CHECK(watched.touch(floor, far) == pushed);
    CHECK(watched.velocity == alone.velocity);
    CHECK(watched.touch(far, floor, far) == pushed);
    // one that does: motion that was already corrected needs no push
    far.on_particles = true;
    CHECK((between.touch(floor, far) - Eigen::Vector2d(-0.0025, 0.005)).norm() <= 1e-15);
}

TEST_CASE("a particle in a thick shell comes out on its own side over several steps, as out of a solid")
{
    Obstacle<Shell<HalfSpace>> const slab{.shape = {HalfSpace{}, 0.6}}; // six cells
    for (double side : {1.0, -1.0}) {
        Lone inside{0.05 * side, {0, -0.2 * side}, {0, -0.2 * side}};
        for (int step = 0; step < 12; ++step) {
            Eigen::Vector2d const way = inside.touch(slab);
            CHECK(way.y() * side >= 0);
            CHECK(way.norm() <= 0.1 * 0.25 + 1e-12);
            inside.height += way.y();
            inside.motion = inside.velocity;
        }
        CHECK(inside.height * side == Approx(0.3));
        CHECK(inside.velocity.norm() == 0);
        // one that was driven beyond the middle comes back to its side of it at once
        Lone through{-0.05 * side, {0, -10 * side}, {0, -10 * side}};
        double const came = through.height + through.touch(slab).y();
        CHECK(came * side >= 0.025 - 1e-12);
        CHECK(came * side <= 0.1);
    }
}

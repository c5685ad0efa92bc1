// SPDX-License-Identifier: MIT
// Read by incomplete_model.sh: effects of a user's own that are as they ought to be, and one for each way in
// which something of one would be ignored. The script knows how often each sentence is to be said.
#include <firn/firn.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
using Backend = firn::Cuda;
#else
#include <firn/openmp.hpp>
using Backend = firn::OpenMP;
#endif

#include <vector>

constexpr int d = 3;
using Solver = firn::Solver<Backend, firn::NeoHookean<firn::Space<d, float>>>;
template <class Real>
using Vec = firn::Vector<Real, d>;
template <class Real>
using Position = firn::LanePosition<Real, d>;
template <class Real>
using Node = firn::LaneNode<Real, d>;

struct Accelerates
{
    template <firn::Lane Real>
    FIRN_HOST_DEVICE Vec<Real> acceleration(Position<Real> const& place) const
    {
        return place.relative_to({0, 0, 0});
    }
};
struct OnMomentum
{
    template <firn::Lane Real>
    FIRN_HOST_DEVICE void on_momentum(Vec<Real>& momentum, Real mass) const
    {
        momentum[0] += mass;
    }
};
struct OnNode
{
    template <firn::Lane Real, int any>
    FIRN_HOST_DEVICE firn::Vector<Real, any> on_node(firn::LaneNode<Real, any> const& node,
                                                     firn::Vector<Real, any> const& velocity) const
    {
        return velocity * node.dt;
    }
};
struct Touches
{
    firn::Contact contact{};
    template <firn::Lane Real>
    FIRN_HOST_DEVICE firn::ContactResult<Real, d> touch(Position<Real> const&, Vec<Real> const&,
                                                        firn::Contact const&) const
    {
        return {};
    }
};

/// An effect with an action of these parts.
template <class... Parts>
struct Action : Parts...
{};
template <class ItsAction>
struct ByItself
{
    void validate() const {}
    template <class Number, int>
    FIRN_HOST_DEVICE ItsAction over(firn::Interval const&) const
    {
        return {};
    }
};
template <class... Parts>
struct Effect : ByItself<Action<Parts...>>
{
    double largest_acceleration() const { return 1; }
    double largest_speed() const { return 1; }
};

struct Overloaded : OnNode
{
    using OnNode::on_node;
    void on_node(int) const;
};
struct Static
{
    static void on_momentum(auto& momentum, auto) { momentum[0] += momentum[1]; }
};
struct Owner : Effect<OnMomentum>
{
    std::vector<double> table;
    auto plain() const { return Effect<OnMomentum>{}; }
};
template <class... All>
constexpr bool are_effects = (firn::NodeEffect<All, Solver::Real, d> && ...);
static_assert(are_effects<Effect<Accelerates>, Effect<OnMomentum>, Effect<OnNode>, Effect<Touches>>);
static_assert(are_effects<Effect<Accelerates, OnMomentum, OnNode, Touches>, Effect<Overloaded>,
                          Effect<Static>, ByItself<OnNode>, ByItself<Static>, Owner>);
static_assert(are_effects<firn::Gravity, firn::ReflectingWall, firn::Obstacle<firn::Shell<firn::Box>>>);

template <int way>
struct Wrong;

// the action has no hook, or one that is not called so
template <>
struct Wrong<0> // misspelt
{
    template <class Real>
    Vec<Real> accelerate(Position<Real> const&) const;
};
template <>
struct Wrong<1> // misspelt
{
    template <class Real>
    Vec<Real> on_nodes(Node<Real> const&, Vec<Real> const&) const;
};
template <>
struct Wrong<2> // empty
{};
template <>
struct Wrong<3> : OnMomentum // one is right, the other has no node parameter
{
    template <class Real, int any>
    firn::Vector<Real, any> on_node(firn::Vector<Real, any> const&) const;
};
template <>
struct Wrong<4> : Accelerates // returns nothing
{
    template <class Real>
    void on_node(Node<Real> const&, Vec<Real> const&) const;
};
template <>
struct Wrong<5> // of other numbers
{
    template <class Real>
    Vec<double> acceleration(Position<Real> const&) const;
};
template <>
struct Wrong<6> // not const
{
    template <class Real>
    Vec<Real> acceleration(Position<Real> const&);
};
template <>
struct Wrong<7> // for one number where packs of them come
{
#if defined(FIRN_HAS_XSIMD)
    Vec<float> acceleration(Position<float> const&) const;
#else
    Vec<double> acceleration(Position<double> const&) const;
#endif
};
template <>
struct Wrong<8> // changes a copy
{
    template <class Real>
    void on_momentum(Vec<Real>, Real) const;
};
template <>
struct Wrong<9> // returns a type that is refused
{
    template <class Real>
    Vec<Real> on_momentum(Vec<Real> const&, Real) const;
};
template <>
struct Wrong<10> : OnMomentum // several, none of which is called
{
    template <class Real>
    Vec<Real> on_node(Vec<Real> const&) const;
    float on_node(float) const;
};
template <>
struct Wrong<11> : OnNode // contact without a rule parameter
{
    firn::Contact contact;
    template <class Real>
    firn::ContactResult<Real, d> touch(Position<Real> const&, Vec<Real> const&) const;
};
template <>
struct Wrong<12> // contact without its rule
{
    template <class Real>
    firn::ContactResult<Real, d> touch(Position<Real> const&, Vec<Real> const&, firn::Contact const&) const;
};
template <>
struct Wrong<13> : Touches // would act on particles, and does not say how
{
    bool on_particles;
    template <class Real>
    firn::ContactResult<Real, d> hold(Position<Real> const&, Vec<Real> const&, Vec<Real> const&,
                                      firn::Contact const&) const;
};
template <>
struct Wrong<14> : OnNode // a value by the name of a hook
{
    Vec<float> acceleration;
};
template <>
struct Wrong<15> : Touches // would act on particles, and cannot
{
    bool on_particles;
};
template <>
struct Wrong<16> : OnNode // says that it is a wall, and is none
{
    static constexpr bool mirrors = true;
};
template <>
struct Wrong<17> // would change a copy of the impulse
{
    template <class Real>
    void on_impulse(Vec<Real>, Vec<Real> const&) const;
};
struct Final final : OnNode
{};
static constexpr int wrong_actions = 18;

struct WithoutValidate
{
    template <class Number, int>
    Action<OnNode> over(firn::Interval const&) const;
};
struct During
{
    void validate() const;
    template <class Number, int>
    Action<OnNode> during(firn::Interval const&) const;
};
struct OwnsSomething : Effect<OnNode>
{
    std::vector<double> table;
};
struct MisspeltBound : ByItself<Accelerates>
{
    double lagest_acceleration() const;
};
struct BoundOfTime : ByItself<Accelerates>
{
    double largest_acceleration(double) const;
};
struct SpeedOfTime : ByItself<OnNode>
{
    double largest_speed(double, double) const;
};
struct HoldsNothing : ByItself<OnNode>
{
    bool on_particles;
};

template <int... way>
void step(Solver& solver, std::integer_sequence<int, way...>)
{
    (solver.step(1e-4, firn::Gravity{}, Effect<Wrong<way>>{}), ...);
}
void step(Solver& solver)
{
    step(solver, std::make_integer_sequence<int, wrong_actions>{});
    solver.steps(3, 1e-4, ByItself<Final>{});
    solver.advance(1e-4, ByItself<float>{});

    solver.step(1e-4, WithoutValidate{});
    solver.step(1e-4, During{});
    solver.step(1e-4, OwnsSomething{});
    solver.step(1e-4, MisspeltBound{});
    solver.step(1e-4, BoundOfTime{});
    solver.step(1e-4, ByItself<Touches>{});
    solver.step(1e-4, SpeedOfTime{});
    solver.step(1e-4, HoldsNothing{});
}

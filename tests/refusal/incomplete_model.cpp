// SPDX-License-Identifier: MIT
// Read by incomplete_model.sh: a complete model, and with INCOMPLETE defined one for each member that is
// missing; for devices with UNMARKED defined a step with one that they cannot call; with NO_EFFECT steps with
// what is none; with NO_PRODUCT an implicit step of a model for explicit ones; with NO_FIELD transfers that
// carry what is none.
#include <firn/firn.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
using Backend = firn::Cuda;
#else
#include <firn/openmp.hpp>
using Backend = firn::OpenMP;
#endif

struct ItsSpace
{
    using Space = firn::Space<3, float>;
};
struct ItsState
{
    using State = firn::Fields<firn::DisplacementGradient>;
};
struct ItsDensity
{
    float density = 1000;
};
struct ItsValidate
{
    void validate() const {}
};
struct ItsRespond
{
    template <firn::Lane Real, class Particle>
    FIRN_HOST_DEVICE firn::Response<Real, 3> respond(Particle& state, firn::Matrix<Real, 3> const&,
                                                     Real) const
    {
        return {state[firn::DisplacementGradient{}], Real(1), firn::no_lanes<Real>(), firn::no_lanes<Real>()};
    }
};
struct AnswersWithStressAlone
{
    template <firn::Lane Real, class Particle>
    firn::Matrix<Real, 3> respond(Particle& state, firn::Matrix<Real, 3> const&, Real) const
    {
        return state[firn::DisplacementGradient{}];
    }
};

template <class... Members>
struct Model : Members...
{};

template <class... Members>
using SolverOf = firn::Solver<Backend, Model<Members...>>;

#if defined(UNMARKED)
struct ForHosts
{
    template <firn::Lane Real, class Particle>
    firn::Response<Real, 3> respond(Particle& state, firn::Matrix<Real, 3> const&, Real) const
    {
        return {state[firn::DisplacementGradient{}], Real(1), firn::no_lanes<Real>(), firn::no_lanes<Real>()};
    }
};
void step(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate, ForHosts>& solver) { solver.step(1e-4); }
#elif defined(NO_EFFECT)
void step(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>& solver)
{
    solver.step(1e-4, firn::Gravity{}, firn::Sphere{});
    solver.steps(2, 1e-4, std::vector<firn::Obstacle<firn::Sphere>>(2));
    solver.advance(1e-4, firn::RigidBody{});
}
#elif defined(NO_PRODUCT)
template <class By>
using StepsBy = firn::Solver<Backend, Model<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>,
                             firn::QuadraticBSpline, firn::Apic, By>;
void step(StepsBy<firn::SymplecticEuler>& solver) { solver.step(1e-4, firn::Gravity{}); }
void step(StepsBy<firn::Implicit>& solver) { solver.step(1e-4, firn::Gravity{}); }
#elif defined(NO_SURFACE)
struct Nothing
{};
void step(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>& solver)
{
    solver.step(1e-4, firn::Obstacle<Nothing>{});
}
#elif defined(NO_FIELD)
struct ItsName
{
    static constexpr auto name = "own";
};
struct ItsFields
{
    using State = firn::Fields<firn::Stiffness>;
    using Stored = State;
    using ScatteredTerms = firn::Fields<firn::NodeMass>;
    using NodeFields = ScatteredTerms;
    using GatheredTerms = ScatteredTerms;
};
struct ItsLists : ItsName, ItsFields
{};
struct BoundsStepsOfAnyKernel
{
    double largest_step(double) const { return 1; }
};
struct ItsScatter
{
    template <firn::Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const&, Real, Real, Terms&) const
    {}
};
struct ItsUpdate
{
    template <firn::Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const&, Real, Real, Values&) const
    {}
};
struct ItsGather
{
    template <firn::Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle&, Terms const&, Real) const
    {}
};
template <class... Members>
using Carries = firn::detail::CompleteField<Model<Members...>, float, 3>;
static_assert(Carries<ItsLists, ItsScatter, ItsUpdate, ItsGather>::value);
bool without_lists = Carries<ItsName, ItsScatter, ItsUpdate, ItsGather>::value;
bool without_name = Carries<ItsFields, ItsScatter, ItsUpdate, ItsGather>::value;
bool with_a_bound_that_is_not_called =
    Carries<ItsLists, ItsScatter, ItsUpdate, ItsGather, BoundsStepsOfAnyKernel>::value;
bool without_scatter = Carries<ItsLists, ItsUpdate, ItsGather>::value;
bool without_update = Carries<ItsLists, ItsScatter, ItsGather>::value;
bool without_gather = Carries<ItsLists, ItsScatter, ItsUpdate>::value;
std::size_t carries_nothing_whole =
    sizeof(firn::Solver<Backend, Model<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>,
                        firn::QuadraticBSpline, firn::Carrying<firn::Pic, Model<ItsLists, ItsScatter>>>);
#elif !defined(INCOMPLETE)
std::size_t complete = sizeof(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>);
#else
std::size_t without_state = sizeof(SolverOf<ItsSpace, ItsDensity, ItsValidate, ItsRespond>);
std::size_t without_density = sizeof(SolverOf<ItsSpace, ItsState, ItsValidate, ItsRespond>);
std::size_t without_validate = sizeof(SolverOf<ItsSpace, ItsState, ItsDensity, ItsRespond>);
std::size_t without_respond = sizeof(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate>);
std::size_t without_response =
    sizeof(SolverOf<ItsSpace, ItsState, ItsDensity, ItsValidate, AnswersWithStressAlone>);
// of five nodes along each axis, whatever their weights
struct Quartic
{
    static constexpr int degree = 4;
    static constexpr auto name = "quartic";
    static constexpr double gradient_bound = 3;
    template <class Real>
    static std::array<Real, 5> weights(Real t);
    template <class Real>
    static std::array<Real, 5> derivatives(Real t);
    template <class Real>
    static std::array<Real, 5> expanded(std::array<Real, 5> const& nodes);
};
static_assert(firn::InterpolationKernel<Quartic, float>);
std::size_t of_too_high_a_degree =
    sizeof(firn::Solver<Backend, Model<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond>, Quartic>);
std::size_t without_space = sizeof(SolverOf<ItsState, ItsDensity, ItsValidate, ItsRespond>);
float without_energy(Model<ItsSpace, ItsState, ItsDensity, ItsValidate, ItsRespond> const& model)
{
    auto const particle = firn::Record<float, 3, ItsState::State>::at_rest();
    return firn::EnergyDensity::observe<float, 3>(model, particle, Eigen::Matrix3f::Zero().eval());
}
#endif

// SPDX-License-Identifier: MIT
// Read by incomplete_model.sh: complete transfer schemes, and with INCOMPLETE defined one for each member
// that is missing, and solids of a plastic flow without its fields.
#include <firn/firn.hpp>

#if defined(__CUDACC__)
#include <firn/cuda.hpp>
using Backend = firn::Cuda;
#else
#include <firn/openmp.hpp>
using Backend = firn::OpenMP;
#endif

using Space = firn::Space<3, float>;

struct ItsState
{
    using State = firn::Fields<firn::Velocity>;
};
struct ItsStored
{
    using Stored = firn::Fields<>;
};
struct ItsScatterTerms
{
    template <class Kernel>
    static constexpr firn::Terms scatter_terms{.gradient = true};
};
struct ItsGatherTerms
{
    template <class Kernel>
    static constexpr firn::Terms gather_terms{.gradient = true};
};
template <bool keeps>
struct Keeps
{
    static constexpr bool keeps_old_velocity = keeps;
};
template <bool with_grid>
struct Moves
{
    static constexpr bool moves_with_grid = with_grid;
};
struct ItsFraction
{
    double fraction = 1;
};
struct ItsPasses
{
    int passes() const { return 1; }
};
struct ItsScatter
{
    template <class Kernel, firn::Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE firn::ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, firn::Matrix<Real, d> const& impulse, Real cell_size) const
    {
        return firn::Pic{}.scatter<Kernel, Real, d>(particle, mass, impulse, cell_size);
    }
};
struct ItsGather
{
    template <class Kernel, firn::Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE firn::Matrix<Real, d> gather(Particle& particle, firn::Gathered<Real, d> const& gathered,
                                                  Real inverse_cell_size) const
    {
        return firn::Pic{}.gather<Kernel, Real, d>(particle, gathered, inverse_cell_size);
    }
};
struct ItsMotion
{
    template <class Kernel, firn::Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE firn::Vector<Real, d> motion(Particle const&,
                                                  firn::Gathered<Real, d> const& gathered) const
    {
        return gathered.velocity;
    }
};
struct GathersNothing
{
    template <class Kernel, firn::Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE void gather(Particle&, firn::Gathered<Real, d> const&, Real) const
    {}
};

template <class... Members>
struct Scheme : Members...
{};

template <class... Members>
using SolverOf = firn::Solver<Backend, firn::NeoHookean<Space>, firn::QuadraticBSpline, Scheme<Members...>>;
template <class... Members>
using Simple = SolverOf<Members..., Keeps<false>, Moves<true>>;

template <class Number>
struct NothingStored : firn::NoFlow<firn::Space<3, Number>>
{};

std::size_t complete =
    sizeof(Simple<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter, ItsGather>);
std::size_t complete_with_all =
    sizeof(SolverOf<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter, ItsGather, Keeps<true>,
                    ItsFraction, ItsPasses, Moves<false>, ItsMotion>);
std::size_t of_a_flow = sizeof(firn::Elastoplastic<firn::HenckyLaw, NothingStored<float>>);

#if defined(INCOMPLETE)
std::size_t without_state = sizeof(Simple<ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter, ItsGather>);
std::size_t without_stored = sizeof(Simple<ItsState, ItsScatterTerms, ItsGatherTerms, ItsScatter, ItsGather>);
std::size_t without_scatter_terms =
    sizeof(Simple<ItsState, ItsStored, ItsGatherTerms, ItsScatter, ItsGather>);
std::size_t without_gather_terms =
    sizeof(Simple<ItsState, ItsStored, ItsScatterTerms, ItsScatter, ItsGather>);
std::size_t without_scatter = sizeof(Simple<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsGather>);
std::size_t without_gather = sizeof(Simple<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter>);
std::size_t without_a_gradient =
    sizeof(Simple<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter, GathersNothing>);
template <class... Members>
using Rest =
    SolverOf<ItsState, ItsStored, ItsScatterTerms, ItsGatherTerms, ItsScatter, ItsGather, Members...>;
std::size_t without_what_it_keeps = sizeof(Rest<Moves<true>>);
std::size_t without_how_it_moves = sizeof(Rest<Keeps<false>>);
std::size_t without_fraction = sizeof(Rest<Keeps<true>, Moves<true>>);
std::size_t without_motion = sizeof(Rest<Keeps<false>, Moves<false>>);
std::size_t extends_what_is_not_kept = sizeof(Rest<Keeps<false>, Moves<true>, ItsPasses>);

struct FlowWithoutState
{
    using Space = ::Space;
    static constexpr auto name = "forgetful";
    static constexpr float default_density = 1000;
    static firn::Lame<float> usual_elasticity() { return firn::lame<float>(1e5, 0.3); }
    template <class Law>
    static constexpr bool supports = true;
    void validate() const {}
};
std::size_t of_a_flow_without_state = sizeof(firn::Elastoplastic<firn::HenckyLaw, FlowWithoutState>);
#endif

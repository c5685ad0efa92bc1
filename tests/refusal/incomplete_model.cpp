// SPDX-License-Identifier: MIT
// Compiled by incomplete_model.sh, once as it is and once without each member that a model owes.
#include <firn/firn.hpp>
#include <firn/openmp.hpp>

struct Model
{
    using Space = firn::Space<3, float>;
#if !defined(WITHOUT_STATE)
    using State = firn::Fields<firn::DisplacementGradient>;
#endif
#if !defined(WITHOUT_DENSITY)
    float density = 1000;
#endif
#if !defined(WITHOUT_VALIDATE)
    void validate() const {}
#endif
#if !defined(WITHOUT_RESPOND)
    template <firn::Lane Real, class Particle>
    firn::Response<Real, 3> respond(Particle& state, firn::Matrix<Real, 3> const&, Real) const
    {
        return {state[firn::DisplacementGradient{}], Real(1), firn::nowhere<Real>(), firn::nowhere<Real>()};
    }
#endif
};

template class firn::Solver<firn::OpenMP, Model>;

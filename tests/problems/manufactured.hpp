// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace firn::test
{

/// Waves that stand in a unit square, or cube, between smooth walls, and the motion that they force on it,
/// known exactly:
///
///   u_x = A sin(2 pi X) sin(c pi t),   u_y = - A sin(2 pi Y) sin(c pi t),   c = sqrt(E / rho_0)
///
/// and along z as along x,
/// with an amplitude A so large that particles cross cells. (The axis-aligned manufactured solution on which
/// variants of the method are compared since Sadeghirad, Brannon & Burghardt 2011.)
struct StandingWaves
{
    static constexpr double young = 1e7, poisson = 0.3, density = 1000; ///< [Pa], -, [kg/m^3]
    static constexpr double speed = 100;                                ///< c [m/s]
    static constexpr double amplitude = 0.05;                           ///< A [m]
    static constexpr double half_period = 1 / speed;                    ///< [s]

    /// How far the waves are up: sin(c pi t) along x and z, the opposite along y.
    FIRN_HOST_DEVICE static double height(double time) { return std::sin(speed * M_PI * time); }
    static double sign(int axis) { return axis == 1 ? -1 : 1; }
};

/// The largest strain of the waves at a particle, signed, along each axis [-].
struct WaveStrain
{
    static constexpr auto name = "wave_strain";
    static constexpr auto shape = FieldShape::vector;
};

/// A particle's time, in half periods of the waves [-].
struct WaveTime
{
    static constexpr auto name = "wave_time";
    static constexpr auto shape = FieldShape::scalar;
};

/// sin(pi t) for lanes of t from 0 to 1: its Taylor polynomial about 1/2, of order 12 in single precision,
/// 6e-9 off at most, of order 18 in double, 1e-15 off.
template <Lane Real>
FIRN_HOST_DEVICE Real sine_of_half_periods(Real t)
{
    using Number = ScalarOf<Real>;
    constexpr int order = sizeof(Number) == 4 ? 12 : 18;
    Real const z = (t - Real(Number(0.5))) * Real(Number(M_PI)), z2 = z * z;
    Real sum(Number(1));
    for (int n = order - 1; n >= 1; n -= 2)
        sum = Real(Number(1)) - sum * z2 * Real(Number(1.0 / (n * (n + 1))));
    return sum;
}

/// A neo-Hookean solid that StandingWaves are forced on.
///
/// Waves need a force per mass b with rho_0 b = rho_0 u'' - dP/dX, P being the stress of their strains. It
/// enters as a stress, S = E/4 (F - 1) - P of the exact F, with the divergence rho_0 b: particles scatter
/// this force as they scatter their stress, so that the spreading adds no error.
template <class ModelType>
struct Driven : ModelType
{
    using Model = ModelType;
    using Space = typename Model::Space;
    using State = Join<typename Model::State, Fields<WaveStrain, WaveTime>>;

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        using Number = ScalarOf<Real>;
        constexpr int d = Space::dimension;
        auto response = Model::template respond<Real>(state, velocity_gradient, dt);
        Real& time = state[WaveTime{}];
        time = time + dt * Real(Number(1 / StandingWaves::half_period));
        Real const mu(Model::elasticity.mu), lambda(Model::elasticity.lambda), one(Number(1));
        Vector<Real, d> const strain = state[WaveStrain{}] * sine_of_half_periods(time);
        Real J = one;
        for (int a = 0; a < d; ++a) J = J * (one + strain[a]);
        Real const pressure = lambda * log(J), inverse_J = one / J;
        for (int a = 0; a < d; ++a) {
            Real const F = one + strain[a];
            Real inverse = inverse_J;
            for (int b = 0; b < d; ++b)
                if (b != a) inverse = inverse * (one + strain[b]);
            Real const wanted = strain[a] * Real(Number(StandingWaves::young / 4));
            Real const driving = wanted - (mu * (F - inverse) + pressure * inverse); // P_aa
            response.kirchhoff_stress(a, a) += driving * (one + state[DisplacementGradient{}](a, a));
        }
        return response;
    }
};

/// The square or cube of StandingWaves in a solver, for half a period, in some pieces between which it may be
/// compared with what is exact.
template <class SceneType>
class ManufacturedSolution : StandingWaves
{
public:
    using Transfer = typename SceneType::Transfer;
    using Solver = firn::Solver<typename SceneType::Backend, Driven<typename SceneType::Model>,
                                typename SceneType::Kernel, Transfer, typename SceneType::Integrator>;
    static constexpr int pieces = 5, d = SceneType::d;

    /// `cells` per metre, `per_cell` particles per cell and axis.
    ManufacturedSolution(int cells, int per_cell = 2, Transfer const& transfer = {},
                         StepControl const& control = {}, typename SceneType::Backend const& backend = {})
        : solver(lattice(1.0 / cells), material(), transfer, control, backend),
          points_(box_of_points<d>(Point::Zero(), Point::Ones(), 1.0 / cells, per_cell)), cells_(cells)
    {
        using Number = typename SceneType::Number;
        solver.add(points_, 1.0 / double(points_.size()));
        double const rate = amplitude * speed * M_PI, k = 2 * M_PI;
        std::vector<Vector<Number, d>> strains, velocities;
        std::vector<Matrix<Number, d>> gradients;
        for (auto const& X : points_) {
            Vector<Number, d> strain, velocity;
            Matrix<Number, d> gradient = Matrix<Number, d>::Zero();
            for (int a = 0; a < d; ++a) {
                double const of_axis = amplitude * k * sign(a) * std::cos(k * X[a]);
                strain[a] = Number(of_axis);
                velocity[a] = Number(rate * sign(a) * std::sin(k * X[a]));
                gradient(a, a) = Number(speed * M_PI * of_axis);
            }
            strains.push_back(strain);
            velocities.push_back(velocity);
            gradients.push_back(gradient);
        }
        solver.template upload<WaveStrain>(strains);
        solver.template upload<Velocity>(velocities);
        if constexpr (Solver::State::template contains<AffineVelocity>)
            solver.template upload<AffineVelocity>(gradients);
    }

    AdvanceReport advance(int piece)
    {
        return between_walls(
            [&](auto const&... walls) { return solver.advance(end_of(piece) - solver.time(), walls...); });
    }

    /// The same in so many steps of one length.
    void advance(int piece, int steps)
    {
        between_walls([&](auto const&... walls) {
            return solver.steps(std::size_t(steps), (end_of(piece) - solver.time()) / steps, walls...);
        });
    }

    /// Compares the particles with where they belong.
    void observe(int)
    {
        auto const x = solver.positions();
        double const u = amplitude * height(solver.time());
        double square = 0;
        for (std::size_t i = 0; i < x.size(); ++i) {
            Point exact = points_[i];
            for (int a = 0; a < d; ++a) exact[a] += u * sign(a) * std::sin(2 * M_PI * points_[i][a]);
            square += (x[i] - exact).squaredNorm() / double(x.size());
        }
        worst_ = std::max(worst_, std::sqrt(square) / amplitude);
    }

    /// The largest root mean square error of positions that was observed, over the amplitude.
    double error() const { return worst_; }

    Solver solver;

private:
    using Point = Vector<double, d>;

    static double end_of(int piece) { return half_period * (piece + 1) / pieces; }

    template <class Go>
    auto between_walls(Go const& go) const
    {
        auto const low = [](int axis) { return ReflectingWall{.axis = axis}; };
        auto const high = [&](int axis) { return ReflectingWall{.axis = axis, .node = cells_, .side = -1}; };
        if constexpr (d == 3)
            return go(low(0), high(0), low(1), high(1), low(2), high(2));
        else
            return go(low(0), high(0), low(1), high(1));
    }

    static typename Solver::Model material()
    {
        typename Solver::Model square;
        square.density = density;
        square.elasticity = lame<typename SceneType::Number>(young, poisson);
        return square;
    }

    std::vector<Point> points_;
    int cells_;
    double worst_ = 0;
};

} // namespace firn::test

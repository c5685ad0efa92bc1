// SPDX-License-Identifier: MIT
#pragma once

#include "problems/manufactured.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace firn::test
{

/// A ring whose shells turn to and fro about its centre, each by an angle of its own, known exactly (the
/// generalised vortex of Kamojjala et al. 2015):
///
///   x = Q(alpha) X,  alpha = g(t) h(R),  g = G sin(pi t / T),  h = (1 - q^2)^2 with q = 2 (R - 1) 2
///
/// for 0.75 m < R < 1.25 m. Shear without change of volume, through which particles cross cells obliquely;
/// both rims are free of stress.
struct Vortex
{
    static constexpr double density = 1000, young = 1000, poisson = 0.3; ///< [kg/m^3], [Pa], -
    static constexpr double duration = 1;                                ///< T [s]
    static constexpr double largest_angle = 0.1;                         ///< G [rad]

    /// h, h' and h'' at radii [m].
    template <Lane Real>
    struct Profile
    {
        Real h, slope, curvature;

        FIRN_HOST_DEVICE explicit Profile(Real R)
        {
            using Number = ScalarOf<Real>;
            auto const number = [](double value) { return Real(static_cast<Number>(value)); };
            Real const q = (R - number(1)) * number(4), q2 = q * q;
            h = (number(1) - q2) * (number(1) - q2);
            slope = number(-16) * q * (number(1) - q2);
            curvature = number(64) * (number(3) * q2 - number(1));
        }
    };

    /// The acceleration by which a neo-Hookean ring moves so, where the particle X at rest is at a time [half
    /// periods of duration].
    template <Lane Real>
    FIRN_HOST_DEVICE static Vector<Real, 2> acceleration(Vector<Real, 2> const& X, Real time)
    {
        using Number = ScalarOf<Real>;
        auto const number = [](double value) { return Real(static_cast<Number>(value)); };
        double const rate = M_PI / duration, mu_over_rho = young / (2 * (1 + poisson)) / density;
        Real const g = number(largest_angle) * sine_of_half_periods(time),
                   g_dot = number(largest_angle * rate) * sine_of_half_periods(time + number(0.5));
        Real const R = sqrt(X[0] * X[0] + X[1] * X[1]);
        Profile<Real> const at(R);
        Real const shear = g * at.slope, turning = g_dot * at.h, alpha = g * at.h;
        Real const outward = R * (number(mu_over_rho) * shear * shear - turning * turning),
                   along = number(-rate * rate) * R * alpha -
                           number(mu_over_rho) * (number(3) * shear + R * g * at.curvature);
        Real const cosine = sine_of_half_periods(number(0.5) + alpha * number(1 / M_PI)),
                   sine = sine_of_half_periods(number(1) - alpha * number(1 / M_PI)); // alpha may be below 0
        Vector<Real, 2> const direction{(X[0] * cosine - X[1] * sine) / R, (X[0] * sine + X[1] * cosine) / R};
        return {outward * direction[0] - along * direction[1], outward * direction[1] + along * direction[0]};
    }
};

/// Where a particle is at rest [m].
struct RestPosition
{
    static constexpr auto name = "rest_position";
    static constexpr auto shape = FieldShape::vector;
};

/// A neo-Hookean solid that a Vortex is forced on. The acceleration that it needs depends on the place, so it
/// is no effect on the grid: it changes the velocity that a particle has gathered.
template <class ModelType>
struct Spun : ModelType
{
    using Model = ModelType;
    using Space = typename Model::Space;
    using State = Join<typename Model::State, Fields<RestPosition, WaveTime>>;

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        using Number = ScalarOf<Real>;
        Real& time = state[WaveTime{}];
        time = time + dt * Real(Number(1 / Vortex::duration));
        if constexpr (requires { state[Velocity{}]; })
            state[Velocity{}] += Vortex::acceleration<Real>(state[RestPosition{}], time) * dt;
        return Model::template respond<Real>(state, velocity_gradient, dt);
    }
};

/// The ring in a solver, once to and back.
template <class SceneType>
class SpunRing
{
public:
    using Transfer = typename SceneType::Transfer;
    using Number = typename SceneType::Number;
    using Solver = firn::Solver<typename SceneType::Backend, Spun<typename SceneType::Model>,
                                typename SceneType::Kernel, Transfer>;
    static constexpr int pieces = 5;

    /// `cell_size` in m.
    explicit SpunRing(double cell_size) : solver(lattice(cell_size), material())
    {
        double const wave = std::sqrt(double(solver.model().elasticity.p_wave_modulus()) / Vortex::density);
        steps_ = int(std::ceil(Vortex::duration / pieces * wave / (0.4 * cell_size)));
        double const dt = Vortex::duration / (steps_ * pieces), start = Vortex::largest_angle * M_PI;
        for (auto const& X : ball_of_points<2>({0, 0}, 1.25, cell_size))
            if (X.norm() > 0.75) points_.push_back(X);
        solver.add(points_, cell_size * cell_size / 4);
        std::vector<Vector<Number, 2>> rest, velocities;
        std::vector<Matrix<Number, 2>> gradients;
        for (auto const& X : points_) {
            Vortex::Profile<double> const at(X.norm());
            Eigen::Vector2d const across{-X.y(), X.x()};
            Eigen::Matrix2d gradient = start * at.slope / X.norm() * across * X.transpose();
            gradient(0, 1) -= start * at.h;
            gradient(1, 0) += start * at.h;
            rest.push_back(X.template cast<Number>());
            // particles are accelerated at the ends of steps: here for the first one
            Eigen::Vector2d const velocity =
                start * at.h * across + dt * Vortex::acceleration<double>(X, 0.0);
            velocities.push_back(velocity.template cast<Number>());
            gradients.push_back(gradient.template cast<Number>());
        }
        solver.template upload<RestPosition>(rest);
        solver.template upload<Velocity>(velocities);
        if constexpr (Solver::State::template contains<AffineVelocity>)
            solver.template upload<AffineVelocity>(gradients);
    }

    void advance(int) { solver.steps(std::size_t(steps_), Vortex::duration / (steps_ * pieces)); }

    /// Compares the particles with where they belong.
    void observe(int)
    {
        auto const x = solver.positions();
        double square = 0;
        double const g = Vortex::largest_angle * std::sin(M_PI * solver.time() / Vortex::duration);
        for (std::size_t i = 0; i < x.size(); ++i) {
            Eigen::Rotation2Dd const turned(g * Vortex::Profile<double>(points_[i].norm()).h);
            square += (x[i] - turned * points_[i]).squaredNorm() / double(x.size());
        }
        worst_ = std::max(worst_, std::sqrt(square));
    }

    /// The largest root mean square error of positions that was observed [m].
    double error() const { return worst_; }

    Solver solver;

private:
    static typename Solver::Model material()
    {
        typename Solver::Model ring;
        ring.density = Vortex::density;
        ring.elasticity = lame<Number>(Vortex::young, Vortex::poisson);
        return ring;
    }

    std::vector<Eigen::Vector2d> points_;
    int steps_ = 0;
    double worst_ = 0;
};

} // namespace firn::test

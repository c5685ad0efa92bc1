// SPDX-License-Identifier: MIT
// Firn's part of the comparison with its peers: `firn_scene FOLDER [--threads N] [--precision float|double]
// [--state FILE]` steps a scene that scene.py wrote and prints what it cost as a line of JSON.
#include "../machine.hpp"

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <vector>

namespace
{

using namespace firn;

struct Options
{
    std::string folder, precision = "float", state;
    int threads = 1;
};

/// The lines of scene.txt: a name and a value each.
class Scene
{
public:
    explicit Scene(std::string const& folder)
    {
        std::ifstream file(folder + "/scene.txt");
        for (std::string name, value; file >> name >> value;) values_[name] = value;
        require(!values_.empty(), "there is no scene.txt", folder.c_str(), "compare.py writes scenes.");
        std::ifstream particles(folder + "/particles.bin", std::ios::binary);
        both_.resize(6 * std::size_t(number("particles")));
        require(bool(particles.read(reinterpret_cast<char*>(both_.data()),
                                    std::streamsize(both_.size() * sizeof(float)))),
                "there are fewer particles than scene.txt says", folder.c_str(), "Write the scene again.");
    }

    std::string const& text(std::string const& name) const
    {
        auto const found = values_.find(name);
        require(found != values_.end(), "scene.txt lacks a value", name.c_str(), "Write the scene again.");
        return found->second;
    }
    double number(std::string const& name) const { return std::stod(text(name)); }

    std::size_t size() const { return both_.size() / 6; }
    /// Position [m] (`part` 0) or velocity [m/s] (1).
    Eigen::Vector3d vector(std::size_t particle, int part) const
    {
        return Eigen::Vector3f(&both_[6 * particle + 3 * std::size_t(part)]).cast<double>();
    }

private:
    std::map<std::string, std::string> values_;
    std::vector<float> both_;
};

template <class Model>
Model material(Scene const& scene)
{
    using Number = typename Model::Number;
    auto const number = [&](char const* name) { return static_cast<Number>(scene.number(name)); };
    Model model;
    model.density = number("density");
    model.elasticity = {number("mu"), number("lambda_")};
    if constexpr (requires { model.hardening; }) {
        model.critical_compression = number("critical_compression");
        model.critical_stretch = number("critical_stretch");
        model.hardening = number("hardening");
        model.smallest_plastic_ratio = number("smallest_plastic_ratio");
        model.largest_plastic_ratio = number("largest_plastic_ratio");
    }
    return model;
}

/// Per particle, as float64: position, velocity, F or F_E by rows, J_P.
template <class Solver>
void write_state(Solver const& solver, std::string const& path)
{
    auto const x = solver.positions();
    auto const v = solver.template download<Velocity>();
    auto const H = solver.template download<DisplacementGradient>();
    std::vector<typename Solver::Number> J_P(solver.size(), 1);
    if constexpr (Solver::State::template contains<PlasticVolumeRatio>)
        J_P = solver.template download<PlasticVolumeRatio>();
    std::vector<double> all;
    for (std::size_t i = 0; i < solver.size(); ++i) {
        for (int a = 0; a < 3; ++a) all.push_back(x[i][a]);
        for (int a = 0; a < 3; ++a) all.push_back(double(v[i][a]));
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) all.push_back(double(H[i](a, b)) + (a == b ? 1 : 0));
        all.push_back(double(J_P[i]));
    }
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<char const*>(all.data()), std::streamsize(all.size() * sizeof(double)));
    require(bool(file), "the final state could not be written", path.c_str(), "Is there room?");
}

template <class Model, class Kernel>
void run(Scene const& scene, Options const& options)
{
    using Solver = Solver<OpenMP, Model, Kernel, Mls>;
    using Vec = Vector<typename Solver::Number, 3>;
    Solver solver(lattice(scene.number("cell")), material<Model>(scene), {}, {}, OpenMP{options.threads});
    std::vector<Eigen::Vector3d> points;
    std::vector<Vec> velocities;
    for (std::size_t i = 0; i < scene.size(); ++i) {
        points.push_back(scene.vector(i, 0));
        velocities.push_back(scene.vector(i, 1).template cast<typename Solver::Number>());
    }
    solver.add(points, scene.number("volume"));
    solver.template upload<Velocity>(velocities);

    double const dt = scene.number("dt");
    int const warm_up = int(scene.number("warm_up")), steps = int(scene.number("steps"));
    int beyond_stable = 0;
    for (int i = 0; i < warm_up; ++i) beyond_stable += solver.step(dt).beyond_stable;
    double const user = bench::user_seconds();
    auto const start = std::chrono::steady_clock::now();
    for (int i = 0; i < steps; ++i) beyond_stable += solver.step(dt).beyond_stable;
    std::chrono::duration<double> const wall = std::chrono::steady_clock::now() - start;
    double const per_particle_step = 1e9 / (double(solver.size()) * steps);
    std::printf("{\"user_ns\": %.4f, "
                "\"wall_ns\": %.4f, \"beyond_stable\": %d}\n",
                (bench::user_seconds() - user) * per_particle_step, wall.count() * per_particle_step,
                beyond_stable);
    if (!options.state.empty()) write_state(solver, options.state);
}

template <class Number>
void run(Scene const& scene, Options const& options)
{
    using Space = Space<3, Number>;
    auto const &model = scene.text("model"), &kernel = scene.text("kernel");
    if (model == NeoHookean<Space>::name && kernel == QuadraticBSpline::name)
        run<NeoHookean<Space>, QuadraticBSpline>(scene, options);
    else if (model == FixedCorotated<Space>::name && kernel == QuadraticBSpline::name)
        run<FixedCorotated<Space>, QuadraticBSpline>(scene, options);
    else if (model == Snow<Space>::name && kernel == QuadraticBSpline::name)
        run<Snow<Space>, QuadraticBSpline>(scene, options);
    else if (model == Snow<Space>::name && kernel == CubicBSpline::name)
        run<Snow<Space>, CubicBSpline>(scene, options);
    else
        throw Error{"no program for " + model + " with the " + kernel + " kernel", "firn_scene",
                    "Add it to firn_scene.cpp."};
}

Options read(int argc, char** argv)
{
    Options options;
    for (int i = 1; i < argc; ++i) {
        std::string const word = argv[i];
        auto const value = [&] {
            require(i + 1 < argc, "there is no value", word.c_str(), "Pass one.");
            return std::string(argv[++i]);
        };
        if (word == "--threads")
            options.threads = std::stoi(value());
        else if (word == "--precision")
            options.precision = value();
        else if (word == "--state")
            options.state = value();
        else
            options.folder = word;
    }
    return options;
}

} // namespace

int main(int argc, char** argv)
try {
    Options const options = read(argc, argv);
    Scene const scene(options.folder);
    if (options.precision == "double")
        run<double>(scene, options);
    else
        run<float>(scene, options);
}
catch (std::exception const& error) {
    std::cerr << error.what() << '\n';
    return 1;
}

// SPDX-License-Identifier: MIT
#pragma once

#include "results.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>

// The loop that the snow examples share: sample, add, advance frame by frame, write.
namespace firn::examples
{

/// What differs between the snow scenes. `effects(time, frame)` returns the effects of the frame that begins
/// at that time and lasts so long [s] as a tuple, obstacles included.
template <class Effects>
struct SnowScene
{
    std::string name;
    TriangleMesh mesh;              ///< in place [m]
    Eigen::Vector3d velocity;       ///< of the snow at the start [m/s]
    std::vector<std::string> drawn; ///< each obstacle's shape for render.py, in the order of the effects
    Camera camera;
    Effects effects;
};

template <class Solver, class Scene>
void write_report(std::filesystem::path const& path, Options const& options, Scene const& scene,
                  Solver const& solver, AdvanceReport const& total, MassAndMomentum const& start,
                  MassAndMomentum const& end, double seconds, double stepping, double output)
{
    double const steps = static_cast<double>(total.substeps) * static_cast<double>(solver.size());
    std::ostringstream text;
    text.precision(9);
    text << "{\n  \"schema\": 1,\n  \"scene\": \"" << scene.name << "\",\n  \"backend\": \""
         << options.backend << "\",\n  \"model\": \"" << Solver::Model::name << "\",\n  \"kernel\": \""
         << Solver::kernel::name << "\",\n  \"transfer\": \"" << Solver::Transfer::name
         << "\",\n  \"precision\": \"float\",\n  \"runs_on\": \"" << backend_info()
         << "\",\n  \"threads\": " << options.threads << ",\n  \"particles\": " << solver.size()
         << ",\n  \"cell_size\": " << solver.lattice().cell_size << ",\n  \"frames\": " << options.frames
         << ",\n  \"substeps\": " << total.substeps << ",\n  \"rejected_steps\": " << total.rejected
         << ",\n  \"dt_min\": " << (total.substeps ? total.smallest_dt : 0)
         << ",\n  \"dt_max\": " << total.largest_dt << ",\n  \"limited_by\": {";
    for (int i = 0; i < step_limit_count; ++i)
        text << (i ? ", " : "") << "\"" << describe(static_cast<StepLimit>(i))
             << "\": " << total.limited_by[i];
    text << "},\n  \"seconds\": {\"total\": " << seconds << ", \"stepping\": " << stepping
         << ", \"output\": " << output
         << "},\n  \"particle_steps_per_second\": " << (stepping > 0 ? steps / stepping : 0)
         << ",\n  \"bytes_per_particle\": " << Solver::bytes_per_particle
         << ",\n  \"state_bytes_per_particle\": " << Solver::state_bytes_per_particle
         << ",\n  \"solver_memory\": " << solver.memory() << ",\n  \"peak_memory\": " << peak_memory()
         << ",\n  \"mass_start\": " << start.mass << ",\n  \"mass_end\": " << end.mass
         << ",\n  \"momentum_start\": " << json(start.momentum)
         << ",\n  \"momentum_end\": " << json(end.momentum) << ",\n  \"particles_lost\": " << total.lost
         << ",\n  \"capped_particles\": " << total.capped << "\n}\n";
    if (is_first_rank()) write_text(path, text.str());
}

/// Runs a scene with one choice of kernel and transfer.
template <class Kernel, class Transfer, class Scene>
void simulate(Options const& options, Scene const& scene, Sampled const& body, Transfer transfer)
{
    using Clock = std::chrono::steady_clock;
    using Solver = firn::Solver<Backend, Snow<Space<3, float>>, Kernel, Transfer>;
    auto const since = [](Clock::time_point start) {
        return std::chrono::duration<double>(Clock::now() - start).count();
    };
    auto const started = Clock::now();

    double const cell = options.cell > 0 ? options.cell : std::cbrt(8 * body.volume_per_point);
    require(cell < std::cbrt(body.volume), "a cell would be larger than the body", "--cell",
            "Give a few hundredths of its size [m], or 0 for eight particles per cell.");
    auto snow = materials::fresh_snow<Space<3, float>>();
    // Crushed snow would otherwise limit the step of all particles: at J_P = 0.6 its wave is 7.4 times as
    // fast as in fresh snow, at 0.75 it is 3.5 times. report.json counts the particles at the cap.
    snow.smallest_plastic_ratio = 0.75f;
    Solver solver(lattice(cell), snow, transfer, {}, backend_with(options.threads));
    solver.add(body.points, body.volume_per_point, scene.velocity);
    std::cout << solver.size() << " particles, " << std::pow(cell, 3) / body.volume_per_point
              << " per cell, cell " << cell << " m, " << Solver::bytes_per_particle << " bytes per particle ("
              << Solver::state_bytes_per_particle << " of state), " << backend_info() << std::endl;

    Results results(options.out, options.write_ply);
    std::vector<DrawnObstacle> drawn;
    for (auto const& shape : scene.drawn) drawn.push_back({shape});
    auto const draw = [&](auto const& effects) {
        std::size_t i = 0;
        auto const keep = [&](auto const& effect) {
            if constexpr (requires { effect.motion; })
                drawn[i++].poses.push_back(effect.motion.at(solver.time()));
        };
        std::apply([&](auto const&... effect) { (keep(effect), ...); }, effects);
        results.obstacles(drawn, scene.camera, cell, std::cbrt(body.volume_per_point),
                          options.frames_per_second);
    };

    MassAndMomentum const start(solver);
    AdvanceReport total;
    double stepping = 0;
    // The wave in snow at its cap is that many times as fast as in fresh snow, so steps become that much
    // shorter.
    double const hardened = std::exp(0.5 * snow.hardening * (1 - snow.smallest_plastic_ratio));
    for (int frame = 0;; ++frame) {
        auto const effects = scene.effects(solver.time(), 1 / options.frames_per_second);
        results.frame(frame, solver);
        draw(effects);
        if (frame == options.frames) break;
        auto const before = Clock::now();
        auto const report = std::apply(
            [&](auto const&... effect) { return solver.advance(1 / options.frames_per_second, effect...); },
            effects);
        double const seconds = since(before);
        stepping += seconds;
        total.merge(report);
        double const per_step = seconds / static_cast<double>(report.substeps),
                     shortest = std::min(total.largest_dt / hardened, total.smallest_dt),
                     frames_left = options.frames - frame - 1;
        TimeLeft const left{seconds * frames_left, per_step *
                                                       std::max(static_cast<double>(report.substeps),
                                                                1 / options.frames_per_second / shortest) *
                                                       frames_left};
        if (frame == 0 && frames_left > 0)
            std::cout << "steps take about " << describe(left)
                      << " minutes: the latter if all of them become as short "
                      << "as in crushed snow, " << std::round(10 * hardened) / 10
                      << " times shorter than in fresh snow" << std::endl;
        show_progress(frame + 1, options.frames, solver.time(), report,
                      static_cast<double>(report.substeps) * static_cast<double>(solver.size()) / seconds,
                      left);
    }
    write_report(results.folder() / "report.json", options, scene, solver, total, start,
                 MassAndMomentum(solver), since(started), stepping, results.seconds());
}

/// Puts a mesh at a place: its bounding box centred in x and z, its lowest point at `height` [m] above
/// `where`.
inline void place(TriangleMesh& mesh, Eigen::Vector3d const& where)
{
    Eigen::AlignedBox3d box;
    for (auto const& x : mesh.vertices) box.extend(x);
    Eigen::Vector3d const shift = where - Eigen::Vector3d(box.center().x(), box.min().y(), box.center().z());
    for (auto& x : mesh.vertices) x += shift;
}

/// Runs the scene with the policies that the user asked for.
template <class Scene>
int run(Options const& options, Scene const& scene)
{
    auto const body = sample(scene.mesh, options.sampling);
    if (body.repaired) std::cout << "repaired: " << body.defect << "\n";
    std::cout << "solid of " << body.volume << " m^3, " << body.size.transpose() << " m across" << std::endl;
    if (body.size.maxCoeff() >= 100)
        std::cout << "That is large for snow: if the mesh file is in millimetres, pass --scale 0.001."
                  << std::endl;
    auto const with_kernel = [&]<class Kernel>(Kernel) {
        if (options.transfer == "pic")
            simulate<Kernel>(options, scene, body, Pic{});
        else if (options.transfer == "apic")
            simulate<Kernel>(options, scene, body, Apic{});
        else if (options.transfer == "mls")
            simulate<Kernel>(options, scene, body, Mls{});
        else
            simulate<Kernel>(options, scene, body, Flip{.fraction = options.flip});
    };
    if (options.kernel == "quadratic")
        with_kernel(QuadraticBSpline{});
    else
        with_kernel(CubicBSpline{});
    return 0;
}

} // namespace firn::examples

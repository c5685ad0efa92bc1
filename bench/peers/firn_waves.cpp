// SPDX-License-Identifier: MIT
// Problem P1 of speed_against_error with MLS in float, in steps of one length as its peers take them and in
// those of advance: firn_waves [--kernel quadratic|cubic] [--runs N] [--threads N] [--out TABLE]. See
// waves.py, which runs it.
#include "../timing.hpp"
#include "problems/manufactured.hpp"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace
{

using namespace firn;
using bench::median, bench::processor_seconds;

template <class Kernel>
using Waves = test::ManufacturedSolution<test::Scene<NeoHookean<test::PlaneFloat>, Kernel, Mls>>;

/// Steps of a half period, those of waves.py, by the number of cells.
using StepsOfCells = std::map<int, int>;
template <class Kernel>
StepsOfCells const steps_of =
    std::is_same_v<Kernel, CubicBSpline> ? StepsOfCells{{8, 15}, {16, 25}, {32, 50}, {64, 95}, {128, 190}}
                                         : StepsOfCells{{8, 15}, {16, 30}, {32, 55}, {64, 110}, {128, 215}};

/// Solves it several times, the first of which only warms up, and writes a row.
template <class Kernel>
void measure(int cells, bool equal, int runs, int threads, std::ostream& out)
{
    using Clock = std::chrono::steady_clock;
    std::vector<double> wall, processor;
    double error = 0;
    std::size_t steps = 0;
    for (int run = 0; run <= runs; ++run) {
        Waves<Kernel> waves(cells, 2, {}, {}, {threads});
        double spent = 0, spent_processor = 0;
        steps = 0;
        for (int piece = 0; piece < waves.pieces; ++piece) {
            double const processor_before = processor_seconds();
            auto const before = Clock::now();
            if (equal) {
                int const in_piece = steps_of<Kernel>.at(cells) / waves.pieces;
                waves.advance(piece, in_piece);
                steps += std::size_t(in_piece);
            }
            else
                steps += waves.advance(piece).substeps;
            spent += std::chrono::duration<double>(Clock::now() - before).count();
            spent_processor += processor_seconds() - processor_before;
            waves.observe(piece);
        }
        error = waves.error();
        if (run == 0) continue;
        wall.push_back(spent);
        processor.push_back(spent_processor);
    }
    out << "P1," << (equal ? "firn" : "firn_advance") << ",neo_hookean," << Kernel::name << ",mls,float,0.9,"
        << cells << ",4,yes," << error << ',' << median(wall) << ',' << double(steps) * 4 * cells * cells
        << ',' << Waves<Kernel>::Solver::bytes_per_particle << ",ok,0," << median(processor) << ',' << runs
        << ',' << steps << ",0," << threads << ",this machine,g++ " << __VERSION__ << ",,\n";
}

template <class Kernel>
void measure_all(int runs, int threads, std::ostream& out)
{
    for (auto const& [cells, steps] : steps_of<Kernel>)
        for (bool equal : {true, false}) measure<Kernel>(cells, equal, runs, threads, out);
}

} // namespace

int main(int argc, char** argv)
{
    int runs = 1, threads = 1;
    std::string path, kernel = "quadratic";
    for (int i = 1; i + 1 < argc; i += 2) {
        std::string const name = argv[i];
        if (name == "--runs")
            runs = std::stoi(argv[i + 1]);
        else if (name == "--threads")
            threads = std::stoi(argv[i + 1]);
        else if (name == "--kernel")
            kernel = argv[i + 1];
        else if (name == "--out")
            path = argv[i + 1];
        else {
            std::cerr << "stop: unknown argument " << name << '\n';
            return 1;
        }
    }
    std::ofstream file(path);
    std::ostream& out = path.empty() ? std::cout : file;
    out << "problem,backend,model,kernel,transfer,precision,cfl_fraction,cells,ppc,deterministic,error,"
           "seconds,particle_steps,bytes_per_particle,status,spread,cpu_seconds,runs,steps,rejected,threads,"
           "hardware,compiler,commit,date\n";
    if (kernel == "cubic")
        measure_all<CubicBSpline>(runs, threads, out);
    else if (kernel == "quadratic")
        measure_all<QuadraticBSpline>(runs, threads, out);
    else {
        std::cerr << "stop: no kernel is called " << kernel << ": quadratic, cubic\n";
        return 1;
    }
}

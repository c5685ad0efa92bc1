// SPDX-License-Identifier: MIT
// What an error costs: speed_against_error --grid short|long [options], see
// notes/2026-11-23-how-it-is-measured.md.
#include "error/grids.hpp"
#include "lists.hpp"

#include <firn/firn.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <fstream>
#include <iostream>
#include <regex>
#include <stdexcept>

namespace
{

using namespace firn;
using namespace firn::bench;

struct Options
{
    std::string grid, out = "speed_against_error.csv", only = "", commit = "unknown";
    Patience patience;
};

Options options_of(int argc, char** argv)
{
    Options options;
    for (int i = 1; i < argc; i += 2) {
        std::string const name = argv[i];
        if (i + 1 == argc) throw std::invalid_argument(name + " needs a value");
        std::string const value = argv[i + 1];
        if (name == "--grid" && (value == "short" || value == "long"))
            options.grid = value;
        else if (name == "--out")
            options.out = value;
        else if (name == "--only")
            options.only = value;
        else if (name == "--commit")
            options.commit = value;
        else if (name == "--threads")
            options.patience.threads = std::stoi(value);
        else if (name == "--runs")
            options.patience.runs = std::stoi(value), options.patience.least = 0;
        else
            throw std::invalid_argument("unknown argument " + name + " " + value);
    }
    if (options.grid.empty()) throw std::invalid_argument("choose --grid short or --grid long");
    if (options.patience.threads < 1 || options.patience.runs < 1)
        throw std::invalid_argument("threads and runs are numbers above 0");
    return options;
}

template <class Transfer>
void offer_kernels(Offer& offers)
{
    for_each_type<AllKernels>([&]<class Kernel>() {
        if constexpr (HasConstantInertia<Kernel> || !std::is_same_v<Transfer, Mls>)
            offer<Kernel, Transfer>(offers); // with the tent MLS is APIC
    });
}

/// A field of a line: without what would end it.
std::string plain(std::string text)
{
    std::replace_if(
        text.begin(), text.end(), [](char c) { return c == ',' || c == '\n' || c == '"'; }, ';');
    return text;
}

std::string compiler()
{
#if defined(__clang__)
    return __VERSION__; // says its name
#else
    return std::string("g++ ") + __VERSION__;
#endif
}

std::string today()
{
    std::time_t const now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
    char text[16];
    std::strftime(text, sizeof text, "%Y-%m-%d", std::gmtime(&now));
    return text;
}

void measure_all(Options const& options)
{
    Offer offers;
    offer_kernels<Pic>(offers);
    offer_kernels<Flip>(offers);
    offer_kernels<Apic>(offers);
    offer_kernels<Mls>(offers);

    std::ofstream out(options.out);
    if (!out) throw std::runtime_error("cannot write " + options.out);
    // what is the same in all rows of a run is repeated, so that files of several runs may be joined
    std::string const where = plain(hardware(options.patience.threads)) + "," + plain(compiler()) + "," +
                              plain(options.commit) + "," + today();
    out << "problem,backend,model,kernel,transfer,precision,cfl_fraction,cells,ppc,deterministic,error,"
           "seconds,particle_steps,bytes_per_particle,status,spread,cpu_seconds,runs,steps,rejected,threads,"
           "hardware,compiler,commit,date,energy_lost,acts_on\n";
    std::regex const wanted(options.only);
    std::size_t count = 0, failed = 0, absent = 0;
    for (Setting const& setting : named_grid(options.grid)) {
        if (!std::regex_search(name_of(setting), wanted)) continue;
        auto const offer = offers.find(name_of(setting));
        if (offer == offers.end()) {
            if (setting.acts_on != "settle") throw std::logic_error("nothing offers " + name_of(setting));
            ++absent;
            continue;
        }
        Row const row = offer->second(setting, options.patience);
        // sums meet in a fixed order on every backend: there is no other policy to compare with
        out << setting.problem << ',' << backend_name() << ',' << row.model << ',' << setting.kernel << ','
            << setting.transfer << ',' << setting.precision << ',' << setting.cfl_fraction << ','
            << setting.cells << ',' << std::pow(setting.per_cell, row.dimensions) << ",yes," << row.error
            << ',' << row.seconds << ',' << row.particle_steps << ',' << row.bytes_per_particle << ','
            << plain(row.status) << ',' << row.spread << ',' << row.cpu_seconds << ',' << row.runs << ','
            << row.steps << ',' << row.rejected << ',' << options.patience.threads << ',' << where << ',';
        if (std::isfinite(row.energy_lost)) out << row.energy_lost;
        out << ',' << setting.acts_on << std::endl;
        ++count;
        failed += row.status != "ok";
    }
    std::cout << count << " settings in " << options.out << ", of which " << failed << " failed";
    if (absent > 0) std::cout << "; " << absent << " more are not compiled for this backend";
    std::cout << '\n';
}

} // namespace

int main(int argc, char** argv)
{
    try {
        measure_all(options_of(argc, argv));
    }
    catch (std::exception const& error) {
        std::cerr << "stop: " << error.what() << '\n';
        return 1;
    }
}

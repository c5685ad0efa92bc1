// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "support/policies.hpp"

#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <string>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

// Hard cases: scenes that blow up where a code has a weakness, with a number each that it must keep. What was
// measured is checked, printed as a table when the program ends, and appended to a file that several
// processes may write at a time.
namespace firn::test
{

/// One number that was measured in a hard case, and what it must keep.
struct HardResult
{
    std::string hard_case, observable;
    double measured, limit;
    bool is_upper; ///< measured <= limit, else measured >= limit
    bool good;

    static constexpr char const* backend()
    {
#if defined(__CUDACC__)
        return "cuda";
#else
        return "openmp";
#endif
    }

    /// A line of the file: case, backend, observable, measured, limit, verdict. No text has a comma.
    std::string line() const
    {
        char numbers[80];
        std::snprintf(numbers, sizeof numbers, "%.4g,%s %.4g", measured, is_upper ? "<=" : ">=", limit);
        return hard_case + "," + backend() + "," + observable + "," + numbers + "," +
               (good ? "passed" : "FAILED") + "\n";
    }
};

/// What this process has measured: written as it comes, printed at the end.
class HardResults
{
public:
    static HardResults& all()
    {
        static HardResults results;
        return results;
    }

    void add(HardResult const& result)
    {
        results_.push_back(result);
        append(result.line());
    }

    ~HardResults()
    {
        if (results_.empty()) return;
        std::printf("%-5s %-8s %-86s %11s %14s %s\n", "case", "backend", "observable", "measured", "limit",
                    "verdict");
        for (auto const& r : results_)
            std::printf("%-5s %-8s %-86s %11.4g %3s %10.4g %s\n", r.hard_case.c_str(), HardResult::backend(),
                        r.observable.c_str(), r.measured, r.is_upper ? "<=" : ">=", r.limit,
                        r.good ? "passed" : "FAILED");
    }

private:
    /// The file is named by FIRN_HARD_CASES, or is hard_cases.csv in the working directory. The first call
    /// writes the header.
    static void append(std::string const& line)
    {
        char const* const named = std::getenv("FIRN_HARD_CASES");
        char const* const path = named ? named : "hard_cases.csv";
        int const file = ::open(path, O_WRONLY | O_CREAT | O_APPEND, 0644);
        if (file < 0) return; // a place that cannot be written is no failure of the case
        ::flock(file, LOCK_EX);
        struct stat status;
        bool const empty = ::fstat(file, &status) == 0 && status.st_size == 0;
        std::string const text =
            (empty ? "case,backend,observable,measured,limit,verdict\n" : std::string()) + line;
        if (::write(file, text.data(), text.size()) < 0) std::perror(path);
        ::close(file);
    }

    std::vector<HardResult> results_;
};

/// A hard case of the validation plan: H1 to H25.
struct HardCase
{
    std::string name;

    /// Checks and records that a number is at most a limit; one that is not a number is not.
    void at_most(std::string const& observable, double measured, double limit) const
    {
        keep({name, observable, measured, limit, true, measured <= limit});
    }

    void at_least(std::string const& observable, double measured, double limit) const
    {
        keep({name, observable, measured, limit, false, measured >= limit});
    }

private:
    static void keep(HardResult const& result)
    {
        REQUIRE(result.observable.find(',') == std::string::npos); // it would be two fields of a line
        HardResults::all().add(result);
        CAPTURE(result.hard_case, result.observable, result.measured, result.limit, result.is_upper);
        CHECK(result.good);
    }
};

/// The speed of pressure waves at rest [m/s].
template <class Model>
double wave_speed(Model const& model)
{
    return std::sqrt(double(model.elasticity.p_wave_modulus()) / double(model.density));
}

/// How many particles are not where numbers are.
template <class Solver>
std::size_t not_finite(Solver const& solver)
{
    std::size_t count = 0;
    auto const v = solver.template download<Velocity>();
    auto const x = solver.positions();
    for (std::size_t i = 0; i < x.size(); ++i) count += !(x[i].allFinite() && v[i].allFinite());
    return count;
}

/// The largest magnitude among values of a field.
template <class Values>
double largest_norm(Values const& values)
{
    double most = 0;
    for (auto const& value : values) most = std::max(most, double(value.norm()));
    return most;
}

} // namespace firn::test

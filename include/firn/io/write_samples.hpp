// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/write_particles.hpp>
#include <firn/particles/sample_fields.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <ostream>
#include <string>
#include <vector>

namespace firn
{

namespace detail
{
template <int d>
void check_grid(SampledGrid<d> const& grid, std::filesystem::path const& path)
{
    std::uint64_t count = 1;
    for (int a = 0; a < d; ++a) {
        require(grid.points[a] >= 1, "the grid has no point along an axis", path.string().c_str(),
                "Pass what sample_grid() returned.");
        count *= static_cast<std::uint64_t>(grid.points[a]);
        require(count <= grid.samples.size(), "the grid has more points than samples", path.string().c_str(),
                "Pass what sample_grid() returned.");
    }
    require(count == grid.samples.size(), "the grid has fewer points than samples", path.string().c_str(),
            "Pass what sample_grid() returned.");
}

/// Three numbers with blanks in between; `rest` for what two dimensions lack.
template <int d>
std::string three(Vector<double, d> const& numbers, double rest)
{
    std::string text;
    for (int a = 0; a < 3; ++a) text += (a > 0 ? " " : "") + exact_text(a < d ? numbers[a] : rest);
    return text;
}
} // namespace detail

/// Writes samples as VTK ImageData (`.vti`), which ParaView and PyVista open: `density` [kg/m^3], `velocity`
/// [m/s] and `stress` [Pa] in double precision, and the time [s] as the field datum `TimeValue`. Two
/// dimensions get zeros.
///
/// Throws firn::Error: the file cannot be created or not written to its end, the samples do not fit the grid,
/// the time is not finite.
template <int d>
void write_vti(std::filesystem::path const& path, SampledGrid<d> const& grid, double time = 0)
{
    detail::check_grid(grid, path);
    require(is_finite(time), "the time of the samples is not finite", path.string().c_str(), "Pass seconds.");
    std::size_t const count = grid.samples.size();
    std::string extent;
    for (int a = 0; a < 3; ++a)
        extent += (a > 0 ? " 0 " : "0 ") + std::to_string(a < d ? grid.points[a] - 1 : 0);
    std::string head = "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" "
                       "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<ImageData WholeExtent=\"" +
                       extent + "\" Origin=\"" + detail::three<d>(grid.low, 0) + "\" Spacing=\"" +
                       detail::three<d>(grid.spacing, 1) +
                       "\">\n<FieldData>\n<DataArray type=\"Float64\" Name=\"TimeValue\" "
                       "NumberOfTuples=\"1\" format=\"ascii\">" +
                       detail::exact_text(time) + "</DataArray>\n</FieldData>\n<Piece Extent=\"" + extent +
                       "\">\n<PointData>\n";
    std::uint64_t offset = 0;
    auto const add = [&](char const* name, std::uint64_t components) {
        head += std::string("<DataArray type=\"Float64\" Name=\"") + name + "\" NumberOfComponents=\"" +
                std::to_string(components) + "\" format=\"appended\" offset=\"" + std::to_string(offset) +
                "\"/>\n";
        offset += sizeof(std::uint64_t) + components * count * sizeof(double);
    };
    add("density", 1);
    add("velocity", 3);
    add("stress", 9);
    head += "</PointData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_";
    detail::replace_file(path, [&](std::ostream& out) {
        out.write(head.data(), static_cast<std::streamsize>(head.size()));
        std::vector<double> values;
        auto const put = [&](auto const& append) {
            values.clear();
            for (auto const& sample : grid.samples) append(sample);
            detail::put(out, std::vector<std::uint64_t>{values.size() * sizeof(double)});
            detail::put(out, values);
        };
        put([&](FieldSample<d> const& sample) { values.push_back(sample.density); });
        put([&](FieldSample<d> const& sample) {
            for (int i = 0; i < 3; ++i) values.push_back(i < d ? sample.velocity[i] : 0.0);
        });
        put([&](FieldSample<d> const& sample) {
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) values.push_back(i < d && j < d ? sample.stress(i, j) : 0.0);
        });
        out << "\n</AppendedData>\n</VTKFile>\n";
    });
}

/// Writes samples as text, a row for each point: its place [m], density [kg/m^3], velocity [m/s] and stress
/// [Pa] in columns that have names.
///
/// Throws firn::Error as write_vti().
template <int d>
void write_csv(std::filesystem::path const& path, SampledGrid<d> const& grid)
{
    detail::check_grid(grid, path);
    std::string const axes = "xyz";
    std::string head;
    for (int a = 0; a < d; ++a) head += std::string(1, axes[std::size_t(a)]) + ',';
    head += "density";
    for (int a = 0; a < d; ++a) head += std::string(",velocity_") + axes[std::size_t(a)];
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j)
            head += std::string(",stress_") + axes[std::size_t(i)] + axes[std::size_t(j)];
    detail::replace_file(path, [&](std::ostream& out) {
        out << head << '\n';
        for (std::size_t i = 0; i < grid.samples.size(); ++i) {
            auto const& sample = grid.samples[i];
            auto const x = grid.place(i);
            std::string row;
            for (int a = 0; a < d; ++a) row += detail::exact_text(x[a]) + ',';
            row += detail::exact_text(sample.density);
            for (int a = 0; a < d; ++a) row += ',' + detail::exact_text(sample.velocity[a]);
            for (int c = 0; c < d * d; ++c) row += ',' + detail::exact_text(sample.stress(c / d, c % d));
            out << row << '\n';
        }
    });
}

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/replace_file.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <numeric>
#include <ostream>
#include <string>
#include <vector>

namespace firn
{

/// One named value per particle: `components` numbers each, particle after particle.
struct ParticleField
{
    std::string name; ///< letters, digits and `_`
    int components;   ///< 1: a scalar or an integer, 3: a vector, 9: a matrix, row by row
    std::vector<float> values;
    std::vector<std::uint32_t> integers{}; ///< in place of values, where `is_integer`
    bool is_integer = false;

    /// How many numbers it has.
    std::size_t size() const { return is_integer ? integers.size() : values.size(); }
};

/// The particles at one time: their positions and fields.
///
/// Filled from any range: `ParticleFrame frame{t}; frame.at(x).vector("velocity", v).scalar("J_P", j);`
struct ParticleFrame
{
    double time = 0;                          ///< [s]
    std::vector<Eigen::Vector3d> positions{}; ///< [m]
    std::vector<ParticleField> fields{};

    /// Takes the positions [m] of a range of 2- or 3-vectors; z = 0 in two dimensions.
    template <class Range>
    ParticleFrame& at(Range const& range)
    {
        positions.clear();
        for (auto const& x : range) positions.push_back(in_space(x));
        return *this;
    }

    /// Adds a field of one number per particle.
    template <class Range>
    ParticleFrame& scalar(std::string name, Range const& range)
    {
        fields.push_back({std::move(name), 1, {}});
        for (auto const& value : range) fields.back().values.push_back(static_cast<float>(value));
        return *this;
    }

    /// Adds a field of one integer from 0 to 2^32 - 1 per particle, such as Solver::ids(). Throws an Error,
    /// and adds none, if a value is another number.
    template <class Range>
    ParticleFrame& integer(std::string name, Range const& range)
    {
        ParticleField field{std::move(name), 1, {}, {}, true};
        for (auto const& value : range) {
            auto const number = static_cast<double>(value); // which holds all of them
            if (!is_between(0, number, std::numeric_limits<std::uint32_t>::max()) ||
                !exactly_equal(number, std::floor(number)))
                throw Error{"a value is no integer from 0 to 2^32 - 1",
                            "ParticleFrame::integer, field '" + field.name + "'",
                            "Pass such integers, or the values as a scalar field."};
            field.integers.push_back(static_cast<std::uint32_t>(value));
        }
        fields.push_back(std::move(field));
        return *this;
    }

    /// Adds a field of one 2- or 3-vector per particle; z = 0 in two dimensions.
    template <class Range>
    ParticleFrame& vector(std::string name, Range const& range)
    {
        fields.push_back({std::move(name), 3, {}});
        for (auto const& value : range) {
            Eigen::Vector3f const v = in_space(value).template cast<float>();
            fields.back().values.insert(fields.back().values.end(), v.data(), v.data() + 3);
        }
        return *this;
    }

    /// Adds a field of one 2 x 2 or 3 x 3 matrix per particle; zeros for what two dimensions lack.
    template <class Range>
    ParticleFrame& matrix(std::string name, Range const& range)
    {
        fields.push_back({std::move(name), 9, {}});
        for (auto const& value : range)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    fields.back().values.push_back(
                        i < value.rows() && j < value.cols() ? static_cast<float>(value(i, j)) : 0.f);
        return *this;
    }

private:
    template <class Derived>
    static Eigen::Vector3d in_space(Eigen::MatrixBase<Derived> const& x)
    {
        constexpr int d = Derived::RowsAtCompileTime;
        static_assert(d == 2 || d == 3, "particles live in two or three dimensions");
        Eigen::Vector3d result = Eigen::Vector3d::Zero();
        result.template head<d>() = x.template cast<double>();
        return result;
    }
};

namespace detail
{

static_assert(
    std::endian::native == std::endian::little,
    "the writers copy memory into little-endian files; a big-endian machine needs a byte swap here");

/// Shortest text that reads back as the same number, whatever the locale.
inline std::string exact_text(double value)
{
    std::array<char, 32> text;
    auto const end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    return {text.data(), end};
}

/// A text as the value of an attribute of XML.
inline std::string escaped(std::string const& text)
{
    std::string written;
    for (char const c : text)
        if (c == '&')
            written += "&amp;";
        else if (c == '<')
            written += "&lt;";
        else if (c == '"')
            written += "&quot;";
        else
            written += c;
    return written;
}

template <class T>
void put(std::ostream& out, std::vector<T> const& values)
{
    out.write(reinterpret_cast<char const*>(values.data()),
              static_cast<std::streamsize>(values.size() * sizeof(T)));
}

inline void check_frame(ParticleFrame const& frame, std::filesystem::path const& path)
{
    auto const refuse = [&](std::string what, char const* remedy) {
        throw Error{std::move(what), path.string(), remedy};
    };
    if (!is_finite(frame.time)) refuse("the time of a frame is not finite", "Pass seconds.");
    // Cells count their points in 32 bits.
    if (frame.positions.size() > std::size_t(std::numeric_limits<std::int32_t>::max()))
        refuse("a frame holds more than 2^31 - 1 particles", "Write several files.");
    for (auto field = frame.fields.begin(); field != frame.fields.end(); ++field) {
        bool const plain = !field->name.empty() && std::ranges::all_of(field->name, [](unsigned char c) {
            return std::isalnum(c) || c == '_';
        });
        if (!plain)
            refuse("the field name '" + field->name + "' is not plain", "Use letters, digits and `_` only.");
        if (std::any_of(frame.fields.begin(), field, [&](auto const& f) { return f.name == field->name; }))
            refuse("two fields are named '" + field->name + "'", "Give each field its own name.");
        if (field->components != 1 && field->components != 3 && field->components != 9)
            refuse("the field '" + field->name + "' has " + std::to_string(field->components) + " components",
                   "Use 1 (scalar), 3 (vector) or 9 (matrix).");
        if (field->size() != frame.positions.size() * std::size_t(field->components))
            refuse("the field '" + field->name + "' holds " + std::to_string(field->size()) +
                       " numbers for " + std::to_string(frame.positions.size()) + " particles",
                   "Give one value to each particle.");
    }
}

/// The name of a field in PLY: see write_ply.
inline std::string name_in_ply(ParticleFrame const& frame, ParticleField const& field)
{
    bool const is_velocity = field.name == "velocity" && field.components == 3;
    bool const is_taken = std::ranges::any_of(frame.fields, [](auto const& f) { return f.name == "v"; });
    return is_velocity && !is_taken ? "v" : field.name;
}

/// The XML head of a VTP file; each appended array is a 64-bit length and its bytes.
inline std::string vtp_head(ParticleFrame const& frame)
{
    std::uint64_t offset = 0;
    auto const array = [&](std::string const& name, char const* type, int components, std::uint64_t bytes) {
        auto const text = "<DataArray type=\"" + std::string{type} + "\" Name=\"" + name +
                          "\" NumberOfComponents=\"" + std::to_string(components) +
                          "\" format=\"appended\" offset=\"" + std::to_string(offset) + "\"/>\n";
        offset += sizeof(std::uint64_t) + bytes;
        return text;
    };
    auto const count = frame.positions.size();
    std::string head =
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" "
        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n<FieldData>\n"
        "<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">";
    head += exact_text(frame.time) + "</DataArray>\n<DataArray type=\"Int32\" Name=\"firn_schema\" "
                                     "NumberOfTuples=\"1\" format=\"ascii\">1</DataArray>\n</FieldData>\n";
    head += "<Piece NumberOfPoints=\"" + std::to_string(count) + "\" NumberOfVerts=\"" + (count ? "1" : "0") +
            "\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n";
    // One statement for each array: their offsets follow one another.
    head += "<Points>\n" + array("Points", "Float64", 3, count * 24) + "</Points>\n<Verts>\n";
    head += array("connectivity", "Int32", 1, count * 4);
    head += array("offsets", "Int32", 1, count ? 4 : 0);
    head += "</Verts>\n<PointData>\n";
    for (auto const& field : frame.fields)
        head +=
            array(field.name, field.is_integer ? "UInt32" : "Float32", field.components, 4 * field.size());
    return head + "</PointData>\n</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_";
}

} // namespace detail

/// Writes a frame as VTK PolyData (`.vtp`): positions in double precision [m], the fields as float, and the
/// time [s] as the field datum `TimeValue`. ParaView and PyVista open it; all points are one poly-vertex.
///
/// Throws firn::Error: the file cannot be created or not written to its end, a field does not fit the frame.
inline void write_vtp(std::filesystem::path const& path, ParticleFrame const& frame)
{
    detail::check_frame(frame, path);
    detail::replace_file(path, [&](std::ostream& out) {
        auto const array = [&](auto const& values) {
            detail::put(out, std::vector<std::uint64_t>{values.size() * sizeof(values[0])});
            detail::put(out, values);
        };
        auto const head = detail::vtp_head(frame);
        out.write(head.data(), static_cast<std::streamsize>(head.size()));
        static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double));
        array(frame.positions);
        std::vector<std::int32_t> numbers(frame.positions.size());
        std::iota(numbers.begin(), numbers.end(), 0);
        array(numbers);
        numbers.assign(frame.positions.empty() ? 0 : 1, static_cast<std::int32_t>(frame.positions.size()));
        array(numbers);
        for (auto const& field : frame.fields) {
            if (field.is_integer)
                array(field.integers);
            else
                array(field.values);
        }
        out << "\n</AppendedData>\n</VTKFile>\n";
    });
}

/// Writes a frame as a binary little-endian PLY point cloud: x, y, z [m] and the fields as float, integers as
/// uint, a vector `name` as `name_x`, `name_y`, `name_z`, a matrix as `name_xx`, `name_xy` and so on; the
/// time [s] is a comment. A vector `velocity` is named `v`, as in Houdini, unless there is another `v`.
/// Houdini and Blender open it.
///
/// Throws firn::Error: the file cannot be created or not written to its end, a field does not fit the frame.
inline void write_ply(std::filesystem::path const& path, ParticleFrame const& frame)
{
    detail::check_frame(frame, path);
    std::vector<std::string> properties{"x", "y", "z"}, integers;
    for (auto const& field : frame.fields) {
        std::string const name = detail::name_in_ply(frame, field);
        if (field.is_integer) integers.push_back(name);
        if (field.components == 1)
            properties.push_back(name);
        else
            for (std::string const axis : {"_x", "_y", "_z"}) {
                if (field.components == 3)
                    properties.push_back(name + axis);
                else
                    for (char const* second : {"x", "y", "z"}) properties.push_back(name + axis + second);
            }
    }
    std::string head = "ply\nformat binary_little_endian 1.0\ncomment firn schema 1\ncomment time " +
                       detail::exact_text(frame.time) + " s\nelement vertex " +
                       std::to_string(frame.positions.size()) + "\n";
    for (auto name = properties.begin(); name != properties.end(); ++name) {
        if (std::find(properties.begin(), name, *name) != name)
            throw Error{"two PLY properties are named '" + *name + "'", path.string(), "Rename a field."};
        bool const is_integer = std::find(integers.begin(), integers.end(), *name) != integers.end();
        head += (is_integer ? "property uint " : "property float ") + *name + "\n";
    }
    head += "end_header\n";
    detail::replace_file(path, [&](std::ostream& out) {
        out.write(head.data(), static_cast<std::streamsize>(head.size()));
        std::size_t constexpr chunk = 4096;
        std::vector<std::uint32_t> rows; // both kinds of numbers have 32 bits
        auto const bits_of = [](float value) { return std::bit_cast<std::uint32_t>(value); };
        for (std::size_t first = 0; first < frame.positions.size(); first += chunk) {
            auto const last = std::min(first + chunk, frame.positions.size());
            rows.clear();
            rows.reserve(chunk * properties.size());
            for (auto p = first; p < last; ++p) {
                for (int i = 0; i < 3; ++i)
                    rows.push_back(bits_of(static_cast<float>(frame.positions[p][i])));
                for (auto const& field : frame.fields) {
                    auto const n = std::size_t(field.components);
                    for (std::size_t i = p * n; i < (p + 1) * n; ++i)
                        rows.push_back(field.is_integer ? field.integers[i] : bits_of(field.values[i]));
                }
            }
            detail::put(out, rows);
        }
    });
}

/// One file of a series: its time [s] and its path, relative to the folder of the index.
struct PvdEntry
{
    double time;
    std::filesystem::path file;
};

/// Writes a ParaView index (`.pvd`) of the files of a series.
///
/// Throws firn::Error: a time is not finite, a file has no name, the index cannot be created or not written
/// to its end.
inline void write_pvd(std::filesystem::path const& path, std::vector<PvdEntry> const& entries)
{
    for (auto const& entry : entries)
        require(is_finite(entry.time) && !entry.file.empty(),
                "the time of a file is not finite, or it has no name", path.string().c_str(),
                "Pass seconds, and paths from the folder of the index on.");
    std::string text = "<?xml version=\"1.0\"?>\n<!-- firn schema 1 -->\n<VTKFile type=\"Collection\" "
                       "version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n";
    for (auto const& entry : entries) {
        text += "<DataSet timestep=\"" + detail::exact_text(entry.time) + "\" group=\"\" part=\"0\" file=\"" +
                detail::escaped(entry.file.generic_string()) + "\"/>\n";
    }
    text += "</Collection>\n</VTKFile>\n";
    detail::replace_file(
        path, [&](std::ostream& out) { out.write(text.data(), static_cast<std::streamsize>(text.size())); });
}

/// A ParaView index that grows with its series and is whole on the disk after every frame.
class PvdIndex
{
public:
    explicit PvdIndex(std::filesystem::path path) : path_(std::move(path)) {}

    /// Adds a file (relative to the index's folder) of time `time` [s] and writes the index again. Throws an
    /// Error as write_pvd(), and adds none.
    void add(double time, std::filesystem::path file)
    {
        auto entries = entries_;
        entries.push_back({time, std::move(file)});
        write_pvd(path_, entries);
        entries_ = std::move(entries);
    }

private:
    std::filesystem::path path_;
    std::vector<PvdEntry> entries_;
};

} // namespace firn

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/io/polygon_file.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>

namespace firn::detail
{

/// Reads the polygons of a Wavefront OBJ file: vertices, faces, and the names of objects and groups.
///
/// assimp is not used for it: its coordinates are in single precision, its faces have no line numbers, and it
/// does not read `.5` as a number. Appendix B1 of Wavefront's *Advanced Visualizer Manual* describes the
/// format.
class ObjReader
{
public:
    explicit ObjReader(std::filesystem::path const& path) : path_(path) {}

    PolygonFile read()
    {
        std::ifstream stream(path_, std::ios::binary);
        std::string const text{std::istreambuf_iterator<char>(stream), {}};
        if (stream.bad()) throw Error{"the mesh file cannot be read", path_.string(), "Check the disk."};
        std::string_view rest = text;
        if (rest.starts_with("\xef\xbb\xbf")) rest.remove_prefix(3); // a byte order mark
        for (std::uint32_t line = 1; !rest.empty();) {
            line_ = line;
            interpret(next_line(rest, line));
        }
        check_corners();
        if (file_.vertices.empty() && file_.polygons.empty())
            throw Error{
                "this is no OBJ file: it holds neither vertices nor faces", path_.string(),
                "Check that the file is whole and of the kind its extension says, or export it again."};
        return std::move(file_);
    }

private:
    /// Removes a line from the text, with the lines that continue it behind a backslash.
    std::string_view next_line(std::string_view& rest, std::uint32_t& line)
    {
        joined_.clear();
        for (;;) {
            auto const end = rest.find('\n');
            auto piece = rest.substr(0, end);
            rest = end == std::string_view::npos ? std::string_view{} : rest.substr(end + 1);
            ++line;
            while (!piece.empty() && is_space(piece.back())) piece.remove_suffix(1);
            // a comment is not continued: it may end with a folder's name
            bool const goes_on = !piece.empty() && piece.back() == '\\' && !rest.empty() &&
                                 piece.find('#') == std::string_view::npos;
            if (!goes_on && joined_.empty()) return piece;
            joined_ += piece.substr(0, piece.size() - goes_on);
            joined_ += ' ';
            if (!goes_on) return joined_;
        }
    }

    static bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

    /// Removes a word from a line; a comment ends it.
    static std::string_view next_word(std::string_view& line)
    {
        while (!line.empty() && is_space(line.front())) line.remove_prefix(1);
        if (!line.empty() && line.front() == '#') line = {};
        auto const end = std::find_if(line.begin(), line.end(), is_space);
        auto const word = line.substr(0, static_cast<std::size_t>(end - line.begin()));
        line.remove_prefix(word.size());
        return word;
    }

    void interpret(std::string_view line)
    {
        auto const keyword = next_word(line);
        if (keyword == "v")
            vertex(line);
        else if (keyword == "f" || keyword == "fo")
            face(line);
        else if (keyword == "o" || keyword == "g") {
            std::string name{next_word(line)};
            while (!(line = trimmed(line)).empty()) (name += ' ') += next_word(line);
            file_.parts.push_back(std::move(name));
        }
    }

    static std::string_view trimmed(std::string_view line)
    {
        while (!line.empty() && is_space(line.front())) line.remove_prefix(1);
        return line.starts_with('#') ? std::string_view{} : line;
    }

    /// x y z, then perhaps a weight w or a colour.
    void vertex(std::string_view line)
    {
        std::array<double, 4> number{0, 0, 0, 1};
        std::size_t count = 0;
        for (auto word = next_word(line); !word.empty(); word = next_word(line), ++count)
            if (count < number.size()) number[count] = number_of(word);
        if (count < 3) refuse("a vertex has fewer than three coordinates");
        Eigen::Vector3d x{number[0], number[1], number[2]};
        if (count == 4) x /= number[3]; // homogeneous
        if (!all_finite(x)) refuse("vertex " + std::to_string(file_.vertices.size() + 1) + " is not finite");
        file_.vertices.push_back(x);
    }

    double number_of(std::string_view word) const
    {
        auto digits = word;
        if (digits.starts_with('+')) digits.remove_prefix(1);
        double number = 0;
        auto const [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
        if (error == std::errc::result_out_of_range)
            refuse("the number '" + std::string{word} + "' is too large or too small for double precision");
        if (error != std::errc{} || end != digits.data() + digits.size())
            refuse("'" + std::string{word.substr(0, 40)} + "' is no number",
                   word.find(',') != std::string_view::npos
                       ? "Export the mesh again with a point, not a comma, in its numbers."
                       : "The file is damaged, or of another kind: export it again.");
        return number;
    }

    /// Corners as v, v/vt, v//vn or v/vt/vn; a negative number counts back from the last vertex so far.
    void face(std::string_view line)
    {
        PolygonFile::Polygon polygon{file_.corners.size(), 0, {0, ++faces_, line_}};
        for (auto word = next_word(line); !word.empty(); word = next_word(line)) {
            std::int64_t index = 0;
            auto const number = word.substr(0, word.find('/'));
            auto const [end, error] = std::from_chars(number.data(), number.data() + number.size(), index);
            if (error != std::errc{} || end != number.data() + number.size() || index == 0)
                refuse("face " + std::to_string(faces_) + " names the vertex '" +
                       std::string{word.substr(0, 40)} + "', which is no number of one");
            auto const last = static_cast<std::int64_t>(file_.vertices.size());
            auto const vertex = index > 0 ? index - 1 : last + index;
            if (vertex < 0 || vertex >= std::numeric_limits<std::uint32_t>::max())
                refuse_corner(faces_, index);
            file_.corners.push_back(static_cast<std::uint32_t>(vertex));
            ++polygon.count;
        }
        if (polygon.count < 3) { // a point or a line
            file_.corners.resize(polygon.first);
            return;
        }
        if (file_.parts.empty()) file_.parts.emplace_back();
        polygon.face.part = static_cast<std::uint32_t>(file_.parts.size() - 1);
        file_.polygons.push_back(polygon);
    }

    /// Faces may name vertices that come later in the file, so corners are checked at its end.
    void check_corners()
    {
        for (auto const& polygon : file_.polygons)
            for (auto const corner : file_.corners_of(polygon))
                if (corner >= file_.vertices.size()) {
                    line_ = polygon.face.line;
                    refuse_corner(polygon.face.number, std::int64_t(corner) + 1);
                }
    }

    [[noreturn]] void refuse_corner(std::uint32_t face, std::int64_t index) const
    {
        refuse("face " + std::to_string(face) + " names vertex " + std::to_string(index) + " of " +
               std::to_string(file_.vertices.size()));
    }

    [[noreturn]] void
    refuse(std::string const& what,
           std::string const& remedy = "The file is damaged, or of another kind: export it again.") const
    {
        throw Error{what, path_.string() + ", line " + std::to_string(line_), remedy};
    }

    std::filesystem::path path_;
    PolygonFile file_;
    std::string joined_;
    std::uint32_t line_ = 0, faces_ = 0;
};

} // namespace firn::detail

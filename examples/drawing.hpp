// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

// What render.py draws beside the particles of a run: obstacles.json.
namespace firn::examples
{

inline std::string json(Eigen::Vector3d const& x)
{
    std::ostringstream text;
    text.precision(12);
    text << "[" << x[0] << ", " << x[1] << ", " << x[2] << "]";
    return text.str();
}

/// An obstacle: its shape as JSON members, and where it is: at every frame, or once if it rests.
struct DrawnObstacle
{
    std::string shape;
    std::vector<Motion> poses{};
};

inline DrawnObstacle drawn(Obstacle<HalfSpace> const& obstacle)
{
    return {R"("shape": "half_space", "point": [0, 0, 0], "normal": )" + json(obstacle.shape.normal),
            {obstacle.motion}};
}
inline DrawnObstacle drawn(Obstacle<Box> const& obstacle)
{
    return {R"("shape": "box", "half_extents": )" + json(obstacle.shape.half_extents), {obstacle.motion}};
}
inline DrawnObstacle drawn(Obstacle<Sphere> const& obstacle)
{
    return {R"("shape": "sphere", "radius": )" + std::to_string(obstacle.shape.radius), {obstacle.motion}};
}

/// A view for the pictures [m].
struct Camera
{
    Eigen::Vector3d position, focal_point;
};

/// A line across a picture of a plane scene, with which a quantity of the particles is compared.
struct Mark
{
    std::string label;
    int axis;       ///< 0: across x, 1: across y
    double place;   ///< on that axis [m]
    int frame = -1; ///< in which it is drawn, or -1: in all
};

/// What is drawn beside the particles, and how they are coloured.
struct Drawing
{
    int dimensions = 3;
    double cell_size, spacing; ///< of the lattice and of the particles [m]
    double frames_per_second = 24;
    std::optional<Camera> camera{};
    std::vector<DrawnObstacle> obstacles{};
    std::string colour_by{};          ///< the field of whole numbers that choose a particle's colour
    std::vector<std::string> names{}; ///< what these numbers stand for, from 0
    std::vector<Mark> marks{};
    std::string title{}; ///< of a plane scene's pictures
};

/// Writes a text file; throws an Error if that fails.
inline void write_text(std::filesystem::path const& path, std::string const& text)
{
    std::ofstream file(path);
    file << text;
    file.close();
    if (!file)
        throw Error{"a file cannot be written", path.string(),
                    "Check the folder's permissions and the space left."};
}

/// Writes what render.py needs beside the frames of a folder: obstacles.json.
inline void write_drawing(std::filesystem::path const& folder, Drawing const& drawing)
{
    std::ostringstream text;
    text.precision(12);
    auto const list = [&](char const* name, auto const& items, auto const& write) {
        text << ",\n  \"" << name << "\": [";
        for (std::size_t i = 0; i < items.size(); ++i) {
            text << (i ? ",\n    " : "\n    ");
            write(items[i]);
        }
        text << "]";
    };
    text << "{ \"dimensions\": " << drawing.dimensions << ", \"cell_size\": " << drawing.cell_size
         << ", \"particle_spacing\": " << drawing.spacing
         << ", \"frames_per_second\": " << drawing.frames_per_second << ",\n  \"title\": \"" << drawing.title
         << "\", \"colour_by\": \"" << drawing.colour_by << "\"";
    if (drawing.camera)
        text << ",\n  \"camera\": {\"position\": " << json(drawing.camera->position)
             << ", \"focal_point\": " << json(drawing.camera->focal_point) << "}";
    list("names", drawing.names, [&](std::string const& name) { text << "\"" << name << "\""; });
    list("marks", drawing.marks, [&](Mark const& mark) {
        text << "{\"label\": \"" << mark.label << "\", \"axis\": " << mark.axis
             << ", \"place\": " << mark.place << ", \"frame\": " << mark.frame << "}";
    });
    list("obstacles", drawing.obstacles, [&](DrawnObstacle const& obstacle) {
        text << "{" << obstacle.shape << ", \"poses\": [";
        for (std::size_t k = 0; k < obstacle.poses.size(); ++k) {
            auto const& q = obstacle.poses[k].orientation;
            text << (k ? ", " : "") << "{\"position\": " << json(obstacle.poses[k].position)
                 << ", \"quaternion\": [" << q.w() << ", " << q.x() << ", " << q.y() << ", " << q.z() << "]}";
        }
        text << "]}";
    });
    text << "\n}\n";
    write_text(folder / "obstacles.json", text.str());
}

} // namespace firn::examples

// SPDX-License-Identifier: MIT
#pragma once

#include <firn/io/polygon_file.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/io/weld.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

namespace firn::detail
{

/// Tells where something is in a mesh: in the scene and, of a mesh that was read, in its file.
class MeshPlace
{
public:
    explicit MeshPlace(TriangleMesh const& mesh) : mesh_(mesh)
    {
        for (auto const& triangle : mesh.triangles)
            for (auto const corner : triangle) box_.extend(mesh.vertices[corner]);
        auto const* source = mesh.source.get();
        if (source && source->vertices.size() == mesh.vertices.size()) source_ = source;
    }

    /// "near (0.5, 1, 0) m in the scene, (500, 0, 1000) in lid.obj, face 3 (line 12)": the mean of some of
    /// the mesh's vertices, and the face that has the first `of_face` of them, if any, as corners.
    std::string near(std::span<Eigen::Vector3d const> vertices, std::size_t of_face) const
    {
        Eigen::Vector3d const here = mean(vertices);
        std::string text = "near " + coordinates(here, box_);
        if (!source_) return text + " m";
        std::unordered_map<WeldKey, std::size_t, WeldHash> number;
        for (std::size_t i = 0; i < mesh_.vertices.size(); ++i)
            number.try_emplace(WeldKey{mesh_.vertices[i]}, i);
        std::vector<Eigen::Vector3d> in_file;
        for (auto const& x : vertices)
            if (auto const at = number.find(WeldKey{x}); at != number.end())
                in_file.push_back(source_->vertices[at->second]);
        if (in_file.empty()) return text + " m";
        Eigen::Vector3d const there = mean(in_file);
        bool const same = (there - here).norm() <= 1e-12 * (here.norm() + there.norm());
        text += same ? " m, in " : " m in the scene, " + coordinates(there, file_box()) + " in ";
        text += source_->file;
        if (auto const face = face_with(vertices.first(of_face))) text += ", " + *face;
        return text;
    }

private:
    static Eigen::Vector3d mean(std::span<Eigen::Vector3d const> vertices)
    {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (auto const& x : vertices) sum += x / double(vertices.size());
        return sum;
    }

    Eigen::AlignedBox3d file_box() const
    {
        Eigen::AlignedBox3d box;
        for (auto const& x : source_->vertices) box.extend(x);
        return box;
    }

    /// With enough digits to resolve a millionth of the mesh.
    static std::string coordinates(Eigen::Vector3d const& x, Eigen::AlignedBox3d const& box)
    {
        double const largest = box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()).maxCoeff();
        double const digits = 6 + std::floor(std::log10(largest / box.sizes().maxCoeff()));
        std::ostringstream text;
        text.precision(digits > 6 ? static_cast<int>(std::min(digits, 17.0)) : 6);
        text << "(" << x.x() << ", " << x.y() << ", " << x.z() << ")";
        return text.str();
    }

    std::optional<std::string> face_with(std::span<Eigen::Vector3d const> corners) const
    {
        if (corners.empty() || source_->faces.size() != mesh_.triangles.size()) return {};
        for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
            if (std::ranges::all_of(corners, [&](Eigen::Vector3d const& x) {
                    return std::ranges::any_of(mesh_.triangles[t],
                                               [&](auto corner) { return mesh_.vertices[corner] == x; });
                }))
                return describe(source_->faces[t], source_->parts);
        return {};
    }

    TriangleMesh const& mesh_;
    MeshSource const* source_ = nullptr;
    Eigen::AlignedBox3d box_;
};

} // namespace firn::detail

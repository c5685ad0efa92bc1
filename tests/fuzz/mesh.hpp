// SPDX-License-Identifier: MIT
#pragma once

#include "input.hpp"

#include <firn/io/read_mesh.hpp>

#include <array>

// Files that say they are meshes: refused, or triangles of finite corners. The importer of all kinds but OBJ
// is another project's and crashes on some: run.sh lets the fuzzer go on in child processes, and tells those
// faults from ours by where they happened.
namespace firn::fuzz
{

/// The first byte says of what kind the file is.
inline void mesh(Bytes bytes)
{
    Input input(bytes);
    constexpr std::array endings{".obj", ".stl", ".ply", ".gltf", ".glb"};
    TemporaryFile const file(endings[static_cast<std::size_t>(input.below(endings.size()))]);
    file.write(input.rest());
    try {
        TriangleMesh const mesh = read_mesh(file.path());
        expect(!mesh.triangles.empty(), "no triangles and no error");
        for (auto const& x : mesh.vertices) expect(x.allFinite(), "a corner is not finite");
        for (auto const& corners : mesh.triangles)
            for (auto const corner : corners) expect(corner < mesh.vertices.size(), "a corner is not there");
    }
    catch (Error const& error) {
        expect(!error.what_is_wrong().empty() && !error.where().empty() && !error.remedy().empty(),
               "a part of an error is missing");
    }
}

} // namespace firn::fuzz

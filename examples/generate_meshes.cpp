// SPDX-License-Identifier: MIT
// Writes meshes to try the other examples with: head.obj, torus.obj and open_head.obj. The last is not
// closed, and is refused until it is repaired.

#include "meshes.hpp"

#include <CLI/CLI.hpp>

#include <exception>
#include <filesystem>
#include <iostream>
#include <string>

int main(int argc, char** argv)
{
    std::string out = "out/meshes";
    CLI::App options{"Writes head.obj, open_head.obj and torus.obj: metres, y up, about 1 m large."};
    options.add_option("--out", out, "folder to write to")->capture_default_str();
    CLI11_PARSE(options, argc, argv);

    try {
        std::filesystem::create_directories(out);
        auto const write = [&](firn::TriangleMesh const& mesh, std::string const& name) {
            auto const path = std::filesystem::path(out) / name;
            firn::examples::write_obj(mesh, path);
            std::cout << path.string() << ": " << mesh.triangles.size() << " triangles\n";
        };
        write(firn::examples::head(), "head.obj");
        write(firn::examples::open_head(), "open_head.obj");
        write(firn::examples::torus(0.4, 0.12), "torus.obj");
    }
    catch (std::exception const& error) {
        std::cerr << error.what() << '\n';
        return 1;
    }
}

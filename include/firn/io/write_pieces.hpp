// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/error.hpp>
#include <firn/io/replace_file.hpp>
#include <firn/io/write_particles.hpp>

#include <filesystem>
#include <ostream>
#include <string>

// Frames of a scene on several ranks, of which each writes its part.
namespace firn
{

namespace detail
{
/// The file of a rank's piece, beside the file that lists the pieces: frame_3.vtp beside frame.pvtp.
inline std::filesystem::path piece_of_rank(std::filesystem::path const& list, int rank)
{
    return std::filesystem::path(list).replace_filename(list.stem().string() + "_" + std::to_string(rank) +
                                                        ".vtp");
}

/// The names, types and components of the fields of a frame, as a PVTP file lists them.
inline std::string list_of_fields(ParticleFrame const& frame)
{
    std::string list;
    for (auto const& field : frame.fields)
        list += "<PDataArray type=\"" + std::string(field.is_integer ? "UInt32" : "Float32") + "\" Name=\"" +
                field.name + "\" NumberOfComponents=\"" + std::to_string(field.components) + "\"/>\n";
    return list;
}
} // namespace detail

/// Writes a frame of which each rank has a part: see frame_here(). Rank 3 writes its particles to
/// `frame_3.vtp` (see write_vtp), and the first rank then writes `frame.pvtp`, which lists the pieces.
/// ParaView and VTK open it as one set of points. All ranks make the call, each with its own particles,
/// and need a folder that they share. The path ends in `.pvtp`; `backend` is that of the solver.
///
/// Throws the same Error on all ranks: a file cannot be created or not written to its end, a field does not
/// fit its frame, or ranks pass other paths, times or fields. A list of before is whole then, but its pieces
/// may be new.
template <class Backend>
void write_pieces(std::filesystem::path const& path, ParticleFrame const& frame, Backend const& backend)
{
    int rank = 0, ranks = 1;
    if constexpr (spans_ranks<Backend>) {
        rank = backend.rank();
        ranks = backend.ranks();
    }
    require(path.extension() == ".pvtp", "the list of the pieces of a frame is no PVTP file",
            path.string().c_str(), "Pass a path that ends in '.pvtp'.");
    std::string const fields = detail::list_of_fields(frame);
    detail::require_same_on_ranks(backend, "write_pieces",
                                  path.string() + " " + detail::exact_text(frame.time) + " " + fields);
    detail::on_all_ranks(backend, [&] { write_vtp(detail::piece_of_rank(path, rank), frame); });
    detail::on_first_rank(backend, [&] {
        std::string text =
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PPolyData\" version=\"1.0\" "
            "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PPolyData GhostLevel=\"0\">\n"
            "<PPoints>\n<PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/>\n"
            "</PPoints>\n<PPointData>\n" +
            fields + "</PPointData>\n";
        for (int r = 0; r < ranks; ++r)
            text += "<Piece Source=\"" + detail::escaped(detail::piece_of_rank(path, r).filename().string()) +
                    "\"/>\n";
        text += "</PPolyData>\n</VTKFile>\n";
        detail::replace_file(path, [&](std::ostream& out) {
            out.write(text.data(), static_cast<std::streamsize>(text.size()));
        });
    });
}

} // namespace firn

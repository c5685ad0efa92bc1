// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#if __has_include(<unistd.h>) && __has_include(<fcntl.h>)
#include <fcntl.h>
#include <unistd.h>
#endif

namespace firn::detail
{

/// What a new file survives once it has its name.
enum class Survives
{
    program, ///< the end of this program, however sudden
    machine, ///< that of the machine, too: waits until the disk has it
};

/// Waits until the disk has what was written to a file, or which files there are in a folder. False if that
/// failed. Where there is no POSIX the system writes when it likes.
inline bool flush_to_disk([[maybe_unused]] std::filesystem::path const& path)
{
#if __has_include(<unistd.h>) && __has_include(<fcntl.h>)
    int const file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return false;
    bool const flushed = ::fsync(file) == 0;
    ::close(file);
    return flushed;
#else
    return true;
#endif
}

/// Writes a file under a temporary name in the same folder and gives it its own only when all of it is
/// written, so that a reader never meets half a file and a failure leaves the file of before, and nothing
/// beside it; what `write` throws included.
template <class Write>
void replace_file(std::filesystem::path const& path, Write const& write,
                  Survives survives = Survives::program)
{
    require(!path.empty(), "a file has no name", "writing a file", "Pass the path of one.");
    auto temporary = path;
    temporary += ".part";
    std::error_code ignored;
    auto const refuse = [&](char const* what, std::string remedy) {
        std::filesystem::remove(temporary, ignored);
        throw Error{what, path.string(), std::move(remedy)};
    };
    auto const there = std::filesystem::status(path, ignored);
    if (std::filesystem::is_directory(there)) refuse("this is a folder", "Pass the name of a file.");
    if (std::filesystem::is_other(there) && there.type() != std::filesystem::file_type::unknown)
        refuse("this is no file, but a device or a pipe", "Pass the name of a file: it would be replaced.");
    std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
    if (!out)
        refuse("the file cannot be created", "Create its folder first, and check that it may be written.");
    try {
        write(out);
    }
    catch (...) {
        out.close();
        std::filesystem::remove(temporary, ignored);
        throw;
    }
    out.close();
    if (!out || (survives == Survives::machine && !flush_to_disk(temporary)))
        refuse("the file could not be written to its end", "Is the disk full?");
    std::error_code failed;
    std::filesystem::rename(temporary, path, failed);
    if (failed) refuse("the finished file could not be given its name", failed.message() + ".");
    if (survives == Survives::program) return;
    // Its name, too. Not every file system can be asked for that; what it has then is a whole file in any
    // case: the new one, or that of before.
    auto const folder = path.parent_path();
    flush_to_disk(folder.empty() ? "." : folder);
}

} // namespace firn::detail

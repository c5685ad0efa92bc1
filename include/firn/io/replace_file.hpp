// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <system_error>
#include <utility>

#if __has_include(<unistd.h>) && __has_include(<fcntl.h>)
#include <cerrno>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

namespace firn::detail
{

/// What a new file survives once it has its name.
enum class Survives
{
    program, ///< the end of this program, however sudden
    machine, ///< a crash of the machine, too: waits until the disk has it
};

/// Waits until the disk has the content of a file, or the list of files of a folder. False if that failed.
/// Without POSIX it does nothing, and the system writes when it likes.
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

/// Locks a file, which is made if need be, for one writer as long as this object lives. The lock ends with
/// the program, so a killed one leaves nothing to clear away. Where the system or the file system has no such
/// locks, every writer is admitted.
class OnlyWriter
{
public:
    explicit OnlyWriter([[maybe_unused]] std::filesystem::path const& path)
    {
#if defined(F_OFD_SETLK)
        for (;; ::close(file_)) {
            // does not follow a link to another file, nor wait for a reader of a pipe
            file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
            if (file_ < 0) return;
            // one byte far beyond the end: some file systems refuse others to write to bytes that are locked
            struct flock last = {};
            last.l_type = F_WRLCK;
            last.l_whence = SEEK_SET;
            last.l_start = std::numeric_limits<off_t>::max() - 1;
            last.l_len = 1;
            if (::fcntl(file_, F_OFD_SETLK, &last) != 0) {
                is_alone_ = errno != EAGAIN && errno != EACCES;
                return;
            }
            struct stat held, named; // it may have been renamed before it was locked
            if (::fstat(file_, &held) != 0) return;
            if (::stat(path.c_str(), &named) == 0 && held.st_dev == named.st_dev &&
                held.st_ino == named.st_ino)
                return;
        }
#endif
    }
    ~OnlyWriter()
    {
#if defined(F_OFD_SETLK)
        if (file_ >= 0) ::close(file_);
#endif
    }
    OnlyWriter(OnlyWriter const&) = delete;
    OnlyWriter& operator=(OnlyWriter const&) = delete;

    /// False if another writer holds the file.
    bool is_alone() const { return is_alone_; }

private:
    [[maybe_unused]] int file_ = -1;
    bool is_alone_ = true;
};

/// The target of a path that is a link, whether or not it exists.
inline std::filesystem::path followed(std::filesystem::path path)
{
    namespace fs = std::filesystem;
    std::error_code failed;
    for (int links = 0; fs::is_symlink(fs::symlink_status(path, failed)); ++links) {
        require(links < 40, "a link leads to itself", path.string().c_str(), "Pass the name of a file.");
        auto const to = fs::read_symlink(path, failed);
        if (failed) break;
        path = to.is_absolute() ? to : path.parent_path() / to;
    }
    return path;
}

/// Writes a file under a temporary name in the same folder, and renames it when all of it is written. So a
/// reader never sees half a file, and a failure, also an exception of `write`, leaves the previous file and
/// nothing beside it. Of two that write it at once the second is refused. They share the temporary name, so
/// the next program uses what a killed one leaves. A link stays, and its target is replaced.
template <class Write>
void replace_file(std::filesystem::path const& named, Write const& write,
                  Survives survives = Survives::program)
{
    require(!named.empty(), "a file has no name", "writing a file", "Pass the path of one.");
    require(named.native().find('\0') == std::filesystem::path::string_type::npos,
            "the name of a file has an end in its midst", named.string().c_str(), "Pass the path of one.");
    std::filesystem::path const path = followed(named);
    auto temporary = path;
    temporary += ".part";
    std::error_code ignored;
    auto const refuse = [&](char const* what, std::string remedy) {
        std::filesystem::remove(temporary, ignored);
        throw Error{what, path.string(), std::move(remedy)};
    };
    auto const there = std::filesystem::status(path, ignored);
    if (std::filesystem::is_directory(there))
        throw Error{"this is a folder", path.string(), "Pass the name of a file."};
    if (std::filesystem::is_other(there) && there.type() != std::filesystem::file_type::unknown)
        throw Error{"this is no file, but a device or a pipe", path.string(),
                    "Pass the name of a file: it would be replaced."};
    auto const before = std::filesystem::symlink_status(temporary, ignored);
    if (std::filesystem::exists(before) && !std::filesystem::is_regular_file(before))
        throw Error{"what has the name of the unfinished file is no file, but a folder, a link, a device or "
                    "a pipe",
                    temporary.string(), "Move it away."};
    OnlyWriter const writer(temporary);
    if (!writer.is_alone())
        throw Error{"another program is writing this file at this time", path.string(),
                    "Let one program, and one thread of it, write to a path."};
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
    // Its name, too. Not every file system can do that; it then has a whole file in any case, the new one or
    // the previous one.
    auto const folder = path.parent_path();
    flush_to_disk(folder.empty() ? "." : folder);
}

} // namespace firn::detail

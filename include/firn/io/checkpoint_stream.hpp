// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/checksum.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <istream>
#include <ostream>
#include <span>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

// The bytes of a checkpoint: its preamble, and what writes and reads values behind that. See checkpoint.hpp
// for the format.
namespace firn::detail
{

static_assert(
    std::endian::native == std::endian::little,
    "checkpoints copy memory into little-endian files; a big-endian machine needs a byte swap here");

inline constexpr std::array<char, 8> checkpoint_magic{'\x89', 'F', 'I', 'R', 'N', '\r', '\n', '\x1a'};
inline constexpr std::uint32_t checkpoint_schema = 5, newest_checkpoint_schema = 6;

/// The first bytes of a checkpoint of any schema.
struct CheckpointPreamble
{
    std::array<char, 8> magic = checkpoint_magic;
    std::uint32_t schema = checkpoint_schema;
    std::uint32_t byte_order = 0x01020304;
    std::uint64_t bytes = 0;    ///< of the file
    std::uint32_t checksum = 0; ///< of what follows
    std::uint32_t own_checksum = 0;

    std::span<char const> memory() const { return {reinterpret_cast<char const*>(this), sizeof(*this)}; }
    std::uint32_t find_own_checksum() const
    {
        Crc32 crc;
        crc.add(memory().first(sizeof(*this) - sizeof(own_checksum)));
        return crc.value();
    }
};
static_assert(sizeof(CheckpointPreamble) == 32 && std::is_trivially_copyable_v<CheckpointPreamble>);

/// Writes values to a stream, and keeps their number of bytes and checksum.
class CheckpointWriter
{
public:
    explicit CheckpointWriter(std::ostream& out) : out_(out) {}

    void bytes(void const* from, std::size_t count)
    {
        std::span<char const> const memory(static_cast<char const*>(from), count);
        crc_.add(memory);
        written_ += count;
        out_.write(memory.data(), static_cast<std::streamsize>(count));
    }
    template <class... Values>
    void values(Values const&... values)
    {
        static_assert((std::is_arithmetic_v<Values> && ...));
        (bytes(&values, sizeof(values)), ...);
    }
    template <class T>
    void all(std::vector<T> const& values)
    {
        bytes(values.data(), values.size() * sizeof(T));
    }
    void text(std::string const& text)
    {
        values(static_cast<std::uint32_t>(text.size()));
        bytes(text.data(), text.size());
    }

    std::uint64_t written() const { return written_; }
    std::uint32_t checksum() const { return crc_.value(); }

private:
    std::ostream& out_;
    std::uint64_t written_ = 0;
    Crc32 crc_;
};

/// Reads a file that has `left` bytes to come, with this checksum. Allocates no more memory than these bytes
/// can fill.
class CheckpointReader
{
public:
    CheckpointReader(std::istream& in, std::uint64_t left, std::uint32_t checksum, std::uint32_t schema)
        : in_(in), left_(left), checksum_(checksum), schema_(schema)
    {}

    std::uint32_t schema() const { return schema_; }

    void bytes(void* to, std::uint64_t count)
    {
        expect(count, 1);
        in_.read(static_cast<char*>(to), static_cast<std::streamsize>(count));
        require(bool(in_), "the file could not be read to its end", "read_checkpoint", "Check the disk.");
        left_ -= count;
        crc_.add({static_cast<char const*>(to), static_cast<std::size_t>(count)});
    }
    template <class... Values>
    void values(Values&... values)
    {
        static_assert((std::is_arithmetic_v<Values> && ...));
        (bytes(&values, sizeof(values)), ...);
    }
    template <class T>
    std::vector<T> all(std::uint64_t count)
    {
        static_assert(std::is_arithmetic_v<T>);
        expect(count, sizeof(T));
        std::vector<T> values(count);
        bytes(values.data(), count * sizeof(T));
        return values;
    }
    std::string text()
    {
        std::uint32_t size = 0;
        values(size);
        expect(size, 1);
        std::string text(size, ' ');
        bytes(text.data(), size);
        return text;
    }

    /// Refuses a count of things of at least `size` bytes each that do not fit into the bytes left.
    void expect(std::uint64_t count, std::uint64_t size) const
    {
        require(count <= left_ / size, "the file says that it holds more than it does", "read_checkpoint",
                "It was not written by this library: pass another one.");
    }
    /// Refuses a file that holds more bytes, or other ones than when it was opened.
    void expect_end() const
    {
        require(left_ == 0, "the file holds more than it says", "read_checkpoint",
                "It was not written by this library: pass another one.");
        require(crc_.value() == checksum_, "the file has changed while it was read", "read_checkpoint",
                "Read it while no program writes into it: write_checkpoint never does, it makes a new one.");
    }

private:
    std::istream& in_;
    std::uint64_t left_;
    std::uint32_t checksum_, schema_;
    Crc32 crc_;
};

/// Checks the length and checksums of a checkpoint of so many bytes, which a stream is at the begin of, and
/// returns a reader behind its preamble. `where` names it in errors.
inline CheckpointReader checked_checkpoint(std::istream& in, std::uint64_t bytes, std::string const& where)
{
    auto const refuse = [&](std::string what, char const* remedy) {
        throw Error{std::move(what), where, remedy};
    };
    CheckpointPreamble preamble;
    if (bytes < sizeof(preamble) || !in.read(reinterpret_cast<char*>(&preamble), sizeof(preamble)))
        refuse("the file has " + std::to_string(bytes) + " bytes, too few for a checkpoint",
               "It was cut off, or is none: pass another one.");
    if (preamble.magic != checkpoint_magic)
        refuse("this is no checkpoint", "Pass a file that write_checkpoint has written.");
    char const* const damaged = "Its checksum is wrong. Go on from an older checkpoint.";
    if (preamble.own_checksum != preamble.find_own_checksum())
        refuse("the checkpoint's first bytes are damaged", damaged);
    if (preamble.byte_order != CheckpointPreamble{}.byte_order)
        refuse("the checkpoint has another byte order", "Write it on a little-endian machine.");
    if (preamble.schema < checkpoint_schema || preamble.schema > newest_checkpoint_schema)
        refuse("the checkpoint is of schema " + std::to_string(preamble.schema) + ", known here are " +
                   std::to_string(checkpoint_schema) + " and " + std::to_string(newest_checkpoint_schema),
               preamble.schema > newest_checkpoint_schema
                   ? "It was written by a newer version of this library: read it with that one."
                   : "It was written by an older version of this library: read it with that one.");
    if (preamble.bytes != bytes)
        refuse("the file has " + std::to_string(bytes) + " bytes instead of " +
                   std::to_string(preamble.bytes),
               "It was cut off, or something was added. Go on from an older checkpoint.");
    Crc32 crc;
    std::vector<char> piece(std::size_t(1) << 16);
    for (std::uint64_t left = bytes - sizeof(preamble); left > 0;) {
        auto const next = static_cast<std::size_t>(std::min<std::uint64_t>(left, piece.size()));
        if (!in.read(piece.data(), static_cast<std::streamsize>(next)))
            refuse("the file could not be read to its end", "Check the disk.");
        crc.add({piece.data(), next});
        left -= next;
    }
    if (crc.value() != preamble.checksum) refuse("the checkpoint is damaged", damaged);
    in.seekg(sizeof(preamble));
    return {in, bytes - sizeof(preamble), preamble.checksum, preamble.schema};
}

/// The bytes of the checkpoint that a stream is at the begin of; fewer where the stream ends before. What is
/// no checkpoint is read as far as its preamble would be.
inline std::string bytes_of_checkpoint(std::istream& in)
{
    CheckpointPreamble preamble;
    std::string bytes(sizeof(preamble), '\0');
    auto const read = [&](std::size_t first, std::uint64_t count) {
        in.read(bytes.data() + first, static_cast<std::streamsize>(count));
        bytes.resize(first + static_cast<std::size_t>(in.gcount()));
    };
    read(0, sizeof(preamble));
    if (bytes.size() < sizeof(preamble)) return bytes;
    std::memcpy(&preamble, bytes.data(), sizeof(preamble));
    if (preamble.magic != checkpoint_magic || preamble.own_checksum != preamble.find_own_checksum())
        return bytes;
    while (in && bytes.size() < preamble.bytes) { // in pieces: a wrong length asks for no more than there is
        std::size_t const first = bytes.size();
        std::uint64_t const next = std::min<std::uint64_t>(preamble.bytes - first, std::uint64_t(1) << 24);
        bytes.resize(first + static_cast<std::size_t>(next));
        read(first, next);
    }
    return bytes;
}

/// What checked_checkpoint() returns, for a file, which it opens.
inline CheckpointReader open_checkpoint(std::filesystem::path const& path, std::ifstream& in)
{
    require(!path.empty(), "a file has no name", "read_checkpoint", "Pass the path of a checkpoint.");
    std::error_code failed;
    if (std::filesystem::is_regular_file(path, failed)) in.open(path, std::ios::binary | std::ios::ate);
    if (!in.is_open() || !in)
        throw Error{"there is no file that can be read", path.string(), "Pass the path of a checkpoint."};
    auto const bytes = static_cast<std::uint64_t>(in.tellg()); // of the open file, whatever has its name now
    in.seekg(0);
    return checked_checkpoint(in, bytes, path.string());
}

} // namespace firn::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <span>
#include <string>
#include <unistd.h>

// What the harnesses share: bytes of the fuzzer as numbers, and what to do when a promise is broken.
namespace firn::fuzz
{

using Bytes = std::span<std::uint8_t const>;

/// Ends the program: an invariant does not hold. The fuzzer keeps the input.
[[noreturn]] inline void broken(char const* what, std::string const& more = {})
{
    std::fprintf(stderr, "broken: %s %s\n", what, more.c_str());
    std::abort();
}

inline void expect(bool holds, char const* what)
{
    if (!holds) broken(what);
}

/// Reads bytes one after the other; behind the last one all are 0.
class Input
{
public:
    explicit Input(Bytes bytes) : left_(bytes) {}

    bool empty() const { return left_.empty(); }
    Bytes rest() const { return left_; }

    std::uint8_t byte()
    {
        if (left_.empty()) return 0;
        std::uint8_t const first = left_.front();
        left_ = left_.subspan(1);
        return first;
    }
    /// One of 0, …, count - 1.
    int below(int count) { return byte() % count; }

    /// A number between two, one of 65 536.
    double between(double low, double high)
    {
        double const share = (byte() * 256 + byte()) / 65535.0;
        return low + share * (high - low);
    }

    /// Any number at all: of those that break things, of 64 bits, or `usual` times a power of two.
    double any(double usual)
    {
        using Double = std::numeric_limits<double>;
        using Float = std::numeric_limits<float>;
        constexpr double odd[]{0,
                               -0.0,
                               1,
                               -1,
                               0.5,
                               2,
                               Double::quiet_NaN(),
                               Double::infinity(),
                               -Double::infinity(),
                               Double::denorm_min(),
                               Double::min(),
                               Double::max(),
                               -Double::max(),
                               Double::epsilon(),
                               Float::denorm_min(),
                               Float::min(),
                               Float::max(),
                               -Float::max(),
                               2.0 * Float::max(),
                               Float::epsilon(),
                               2147483648.0,
                               -2147483649.0,
                               4194304.0};
        switch (std::uint8_t const kind = byte(); kind % 4) {
        case 0:
            return odd[kind / 4 % std::size(odd)];
        case 1: {
            std::uint64_t bits = 0;
            for (int i = 0; i < 8; ++i) bits = bits << 8 | byte();
            return std::bit_cast<double>(bits);
        }
        case 2:
            return std::ldexp(usual, static_cast<std::int8_t>(byte()));
        default:
            return usual * between(-4, 4);
        }
    }

private:
    Bytes left_;
};

/// A file of this process's own, in memory where there is such a folder; gone with the object.
class TemporaryFile
{
public:
    explicit TemporaryFile(std::string const& ending)
    {
        namespace fs = std::filesystem;
        fs::path const memory = "/dev/shm";
        std::error_code ignored;
        path_ = (fs::is_directory(memory, ignored) ? memory : fs::temp_directory_path()) /
                ("firn-fuzz-" + std::to_string(::getpid()) + ending);
    }
    TemporaryFile(TemporaryFile const&) = delete;
    ~TemporaryFile()
    {
        std::error_code ignored;
        std::filesystem::remove(path_, ignored);
    }
    void write(Bytes bytes) const
    {
        std::ofstream(path_, std::ios::binary)
            .write(reinterpret_cast<char const*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    }
    std::string content() const
    {
        std::ifstream file(path_, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    std::filesystem::path const& path() const { return path_; }

private:
    std::filesystem::path path_;
};

} // namespace firn::fuzz

// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace firn::detail
{

/// CRC-32, the checksum of zip and Ethernet (ISO 3309: reflected polynomial 0xedb88320, all bits inverted
/// before and after), of bytes that come piece by piece. It finds every change within 32 neighbouring bits,
/// and all but one in 4e9 of other changes.
class Crc32
{
    /// of[k][b]: what byte b contributes after k more bytes, so that eight bytes are looked up at once.
    struct Tables
    {
        std::array<std::array<std::uint32_t, 256>, 8> of{};

        constexpr Tables()
        {
            for (std::uint32_t byte = 0; byte < 256; ++byte) {
                std::uint32_t rest = byte;
                for (int bit = 0; bit < 8; ++bit) rest = (rest >> 1) ^ ((rest & 1) != 0 ? 0xedb88320u : 0u);
                of[0][byte] = rest;
            }
            for (std::size_t k = 1; k < of.size(); ++k)
                for (std::size_t byte = 0; byte < 256; ++byte)
                    of[k][byte] = (of[k - 1][byte] >> 8) ^ of[0][of[k - 1][byte] & 0xff];
        }
    };

public:
    void add(std::span<char const> bytes)
    {
        static constexpr Tables tables;
        auto const byte = [&](std::size_t i) { return std::uint32_t(static_cast<unsigned char>(bytes[i])); };
        std::size_t i = 0;
        for (; i + 8 <= bytes.size(); i += 8) {
            std::uint32_t const first =
                rest_ ^ (byte(i) | byte(i + 1) << 8 | byte(i + 2) << 16 | byte(i + 3) << 24);
            rest_ = tables.of[7][first & 0xff] ^ tables.of[6][first >> 8 & 0xff] ^
                    tables.of[5][first >> 16 & 0xff] ^ tables.of[4][first >> 24] ^ tables.of[3][byte(i + 4)] ^
                    tables.of[2][byte(i + 5)] ^ tables.of[1][byte(i + 6)] ^ tables.of[0][byte(i + 7)];
        }
        for (; i < bytes.size(); ++i) rest_ = (rest_ >> 8) ^ tables.of[0][(rest_ ^ byte(i)) & 0xff];
    }

    std::uint32_t value() const { return ~rest_; }

private:
    std::uint32_t rest_ = ~std::uint32_t(0);
};

} // namespace firn::detail

// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

// Where nodes find their images behind reflecting walls, listed once for all loops over the same nodes: to
// look them up takes several times longer than to add them up.
namespace firn::openmp
{

/// Behind which walls an image lies.
struct BehindWalls
{
    std::uint32_t bits = 0;  ///< one for each wall
    float turns[3]{1, 1, 1}; ///< -1 for axes across which one of them lies
    static constexpr std::size_t most = 32;

    bool operator[](std::size_t wall) const { return ((bits >> wall) & 1) != 0; }
};

/// Nodes of a row whose sums are added to those of a pack of nodes: as many side by side from `place` on, or
/// one alone.
struct ImageInRow
{
    std::uint32_t lanes; ///< of the pack that it is added to: a bit for each
    BehindWalls behind;
    std::uint32_t block; ///< of nodes
    std::uint8_t row, place;
    bool is_single;
};

/// The images that packs of nodes look at. The first one of a pack that looks around is the pack itself.
class ImageLists
{
public:
    /// A pack of nodes that looks around.
    struct Pack
    {
        std::span<ImageInRow const> images; ///< none: it does not look around
        std::uint64_t are_images = 0;       ///< which of its nodes are behind a wall: a bit for each
    };
    /// `number` is that of the pack in its block.
    Pack of(std::size_t block, int number) const
    {
        if (first_of_block_[block] == nothing) return {};
        std::size_t const at = first_of_block_[block] + static_cast<std::size_t>(number);
        return {std::span(images_).subspan(packs_[at].begin, packs_[at + 1].begin - packs_[at].begin),
                packs_[at].are_images};
    }

    /// Whether they are those of these walls, and of the nodes with this numbering (see Grid::numbering), or
    /// of other nodes in the same blocks.
    template <class Walls, class NodeBlock>
    bool are_of(std::uint64_t numbering, Walls const& walls, std::vector<NodeBlock> const& blocks)
    {
        if (key_.size() != walls.size()) return false;
        for (std::size_t w = 0; w < walls.size(); ++w)
            if (!(key_[w] == Wall{walls[w].axis, walls[w].node, walls[w].side})) return false;
        if (numbering == numbering_) return true;
        if (blocks_.size() != blocks.size()) return false;
        for (std::size_t n = 0; n < blocks.size(); ++n)
            if (blocks_[n] != place_of(blocks[n])) return false;
        numbering_ = numbering;
        return true;
    }
    /// Takes those of another grid, which may hold for this one, too.
    void take(ImageLists& other)
    {
        std::swap(*this, other);
        numbering_ = 0;
    }
    /// Lists them anew: `list(block, number, *this)` calls add() for the images of a pack, and returns which
    /// of its nodes are images.
    template <class Walls, class NodeBlock, class List>
    void make(std::uint64_t numbering, Walls const& walls, std::vector<NodeBlock> const& blocks,
              int packs_of_block, List const& list)
    {
        numbering_ = 0; // of no nodes, until all is listed
        images_.clear();
        packs_.clear();
        key_.clear(); // of no walls, until all is listed
        first_of_block_.assign(blocks.size(), nothing);
        std::vector<PackInList> here(static_cast<std::size_t>(packs_of_block));
        for (std::size_t n = 0; n < blocks.size(); ++n) {
            std::uint32_t const before = count();
            for (int p = 0; p < packs_of_block; ++p)
                here[std::size_t(p)] = {count(), static_cast<std::uint32_t>(list(n, p, *this))};
            if (count() == before) continue;
            first_of_block_[n] = static_cast<std::uint32_t>(packs_.size());
            packs_.insert(packs_.end(), here.begin(), here.end());
        }
        packs_.push_back({count(), 0});
        blocks_.clear();
        for (auto const& block : blocks) blocks_.push_back(place_of(block));
        for (auto const& wall : walls) key_.push_back({wall.axis, wall.node, wall.side});
        numbering_ = numbering;
    }
    void add(ImageInRow const& image) { images_.push_back(image); }

    std::size_t memory() const
    {
        return images_.capacity() * sizeof(ImageInRow) + packs_.capacity() * sizeof(PackInList) +
               first_of_block_.capacity() * sizeof(std::uint32_t) + blocks_.capacity() * sizeof(Place);
    }

private:
    struct PackInList
    {
        std::uint32_t begin, are_images;
    };
    struct Wall
    {
        int axis, node, side;
        bool operator==(Wall const&) const = default;
    };
    using Place = std::array<int, 3>;
    template <class NodeBlock>
    static Place place_of(NodeBlock const& block)
    {
        Place place{};
        for (std::size_t a = 0; a < static_cast<std::size_t>(block.coordinates.size()); ++a)
            place[a] = block.coordinates[static_cast<int>(a)];
        return place;
    }
    static constexpr std::uint32_t nothing = std::numeric_limits<std::uint32_t>::max();

    std::uint32_t count() const { return static_cast<std::uint32_t>(images_.size()); }

    std::uint64_t numbering_ = 0;
    std::vector<Wall> key_;
    std::vector<Place> blocks_; ///< the coordinates of the blocks of nodes
    std::vector<ImageInRow> images_;
    std::vector<PackInList> packs_; ///< of blocks with packs that look around; the last one is behind all
    std::vector<std::uint32_t> first_of_block_; ///< by block of nodes
};

} // namespace firn::openmp

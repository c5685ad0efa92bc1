// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/lane.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/phases/solve_phase.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn
{

/// On any nodes that have mass: 1 as the preconditioned residual if they count in sums, and -1 of images
/// behind walls.
template <class Space, class Kernel, class Transfer>
struct MarkCounted : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Result = NothingFound;
    static constexpr bool asks_no_sums = true;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, NothingFound&) const
    {
        using Real = typename Node::Real;
        node.set(Phase::Own::conditioned, select(node.value(Phase::Own::mass) > Real(0),
                                                 select(counted(node), Real(1), Real(-1)), Real(0)));
    }
};

/// The directions along which the linear systems of a step searched, by which those that follow are
/// preconditioned: their matrices are nearly the same.
///
/// It is the inverse that limited-memory BFGS makes of pairs s = p and y = H p (Morales & Nocedal 2000,
/// *Automatic preconditioning by limited memory quasi-Newton updating*), in the compact form of Byrd, Nocedal
/// & Schnabel (1994). With S and Y of all pairs, R the upper triangle of S^T Y, and D its diagonal,
///
///   z = W D0^-1 W^T r + S R^-T D R^-1 S^T r,      W = I - S R^-T Y^T
///
/// D0 is the diagonal of nodes. So z is symmetric and positive definite in r, whatever R is, as long as all
/// of D is positive: directions along which the energy does not rise are not kept.
///
/// Vectors hold the nodes one after the other, in the order of their coordinates, and each rank has all of
/// them, so that sums have one order on any number of ranks. They are for scenes of few nodes: see
/// CoarseGrids::begin().
template <class Backend, class Space>
class KeptDirections
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Real = typename Backend::template Lane<Number>;
    using Array = typename Backend::template Array<Number>;

public:
    /// Whether there are any on the backend: the host works on what loops write.
    static constexpr bool possible = Backend::reaches_host_memory;
    /// The most directions.
    static constexpr std::size_t most = 64;
    /// The most numbers of a vector. Where many more directions are searched than are kept, those that are
    /// kept are of little use: a cube of 7 cells took more products with them.
    static constexpr std::size_t most_numbers = 4 * most;

    explicit KeptDirections(Backend const& backend)
        : backend_(backend), along_(backend), products_(backend), weights_(backend), left_(backend),
          found_(backend)
    {}

    /// There are none, and none is kept before begin().
    void clear() { used_ = kept_ = size_ = 0; }
    /// Whether directions of this step are kept.
    bool are_kept() const { return size_ > 0; }
    /// Whether those of systems before precondition this one.
    bool are_there() const { return used_ > 0; }

    /// Begins a step in which some are kept, on nodes of a box. `mark` calls MarkCounted for them.
    template <class Kernel, class Transfer, class Grid, class Mark>
    void begin(Grid& grid, Coordinates<d> const& low, Coordinates<d> const& high, Mark const& mark)
    {
        constexpr int channel = SolvePhase<Space, Kernel, Transfer>::Own::conditioned;
        auto const nodes = grid.nodes_by_index();
        listed_.clear();
        for_each_in_box(nodes, low, high, [&](Coordinates<d> const& at, std::uint32_t index) {
            nodes.value(index, channel) = 0;
            listed_.push_back({at, index, 0});
        });
        mark();
        auto const is_others = [&]([[maybe_unused]] Listed const& of) {
            if constexpr (spans_ranks<Backend>)
                return grid.share_of(of.index) != NodeShare::results;
            else
                return false;
        };
        for (auto& of : listed_) of.mark = nodes.value(of.index, channel);
        std::erase_if(listed_, [&](Listed const& of) { return !(of.mark * of.mark > 0) || is_others(of); });
        set(nodes);
    }

    /// Begins a linear system: it is preconditioned by all that are kept, and by the diagonal of nodes.
    template <class Kernel, class Transfer>
    void begin_system()
    {
        if (kept_ > most / 2) forget(kept_ - most / 2);
        used_ = kept_;
        if (used_ == 0) return;
        gather(weights_.data(), [&](Number const* values, std::size_t) {
            return Phase<Kernel, Transfer>::inverse_of(values[Own<Kernel, Transfer>::stiffness * apart_]);
        });
    }

    /// Preconditions the residual r of nodes. `turns`: what is held of them may have changed since. Returns
    /// r z.
    template <class Kernel, class Transfer>
    double condition(bool turns)
    {
        Number *const r = left_.data(), *const z = found_.data();
        gather_channels(r, Own<Kernel, Transfer>::residual);
        for (std::size_t j = 0; j < used_; ++j) share_[j] = product(vector(along_, j), r);
        for (std::size_t j = used_; j-- > 0;) { // R^-1 S^T r
            for (std::size_t i = j + 1; i < used_; ++i) share_[j] -= of(j, i) * share_[i];
            share_[j] *= inverse_[j];
        }
        for (std::size_t j = 0; j < used_; ++j) by_[j] = static_cast<Number>(-share_[j]);
        for (std::size_t i = 0; i < size_; i += lanes) {
            Real const left = sum_of_vectors(load(r + i), products_.data() + i);
            store(left, r + i);
            store(left * load(weights_.data() + i), z + i);
        }
        double sum = product(r, z);
        for (std::size_t j = 0; j < used_; ++j) {
            sum += share_[j] * share_[j] * of(j, j);
            share_[j] = share_[j] * of(j, j) - product(vector(products_, j), z);
        }
        for (std::size_t j = 0; j < used_; ++j) { // R^-T
            for (std::size_t i = 0; i < j; ++i) share_[j] -= of(i, j) * share_[i];
            share_[j] *= inverse_[j];
        }
        for (std::size_t j = 0; j < used_; ++j) by_[j] = static_cast<Number>(share_[j]);
        for (std::size_t i = 0; i < size_; i += lanes)
            store(sum_of_vectors(load(z + i), along_.data() + i), z + i);
        give<Kernel, Transfer>(z, turns);
        return sum;
    }

    /// Keeps the direction that nodes hold, with their product and p H p, if there is room.
    template <class Kernel, class Transfer>
    void keep(double curvature)
    {
        if (kept_ == most || !(curvature > 0) || !is_finite(curvature)) return;
        Number *const p = vector(along_, kept_), *const q = vector(products_, kept_);
        for (Number* const of : {p, q}) {
            std::fill(of + counted_ - std::min(lanes, counted_), of + counted_, Number(0)); // beside nodes
            std::fill(of + size_ - std::min(lanes, size_), of + size_, Number(0));
        }
        gather_channels(p, Phase<Kernel, Transfer>::Values::velocity);
        gather_channels(q, Own<Kernel, Transfer>::impulse);
        // directions of one system are conjugate
        for (std::size_t i = 0; i < kept_; ++i) of(i, kept_) = i < used_ ? product(vector(along_, i), q) : 0;
        of(kept_, kept_) = curvature;
        inverse_[kept_] = 1 / curvature;
        ++kept_;
    }

    /// Bytes held.
    std::size_t memory() const
    {
        return along_.memory() + products_.memory() + weights_.memory() + left_.memory() + found_.memory() +
               triangle_.capacity() * sizeof(double) + entries_.capacity() * sizeof(Entry) +
               listed_.capacity() * sizeof(Listed) + order_.capacity() * sizeof(std::uint32_t);
    }

private:
    template <class Kernel, class Transfer>
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    template <class Kernel, class Transfer>
    using Own = typename Phase<Kernel, Transfer>::Own;
    static constexpr std::size_t lanes = std::size_t(lane_width<Real>);

    /// A node, while they are listed.
    struct Listed
    {
        Coordinates<d> at;
        std::uint32_t index;
        Number mark;
    };
    /// A node's values, and where its first component is in vectors.
    struct Entry
    {
        Number* values;
        std::uint32_t place;
        bool is_own; ///< this rank says what it has
    };

    static Real load(Number const* from) { return LaneTraits<Real>::load(from); }
    static void store(Real const& lane, Number* to) { LaneTraits<Real>::store(lane, to); }
    Number* vector(Array& of_all, std::size_t j) { return of_all.data() + j * size_; }
    double& of(std::size_t i, std::size_t j) { return triangle_[i * most + j]; }

    /// The scalar product of two vectors: of nodes that count, which lie first.
    double product(Number const* a, Number const* b) const
    {
        Real sum(Number(0));
        for (std::size_t i = 0; i < counted_; i += lanes) sum += load(a + i) * load(b + i);
        Number numbers[lanes];
        store(sum, numbers);
        for (std::size_t half = lanes / 2; half > 0; half /= 2)
            for (std::size_t i = 0; i < half; ++i) numbers[i] += numbers[i + half];
        return double(numbers[0]);
    }
    /// A lane and shares of those of all vectors that are used, of which `first` is the first one's.
    Real sum_of_vectors(Real sum, Number const* first) const
    {
        for (std::size_t j = 0; j < used_; ++j) sum += load(first + j * size_) * Real(by_[j]);
        return sum;
    }

    /// Calls `use(coordinates, index)` for nodes of a box that are there.
    template <class Nodes, class Use>
    static void for_each_in_box(Nodes const& nodes, Coordinates<d> const& low, Coordinates<d> const& high,
                                Use const& use)
    {
        Coordinates<d> at = low;
        for (bool goes_on = true; goes_on;) {
            std::uint32_t index = nodes.find(at);
            for (; at[d - 1] <= high[d - 1]; index = nodes.find_next(at, index)) {
                if (index != Nodes::absent) use(at, index);
                ++at[d - 1];
            }
            goes_on = false;
            at[d - 1] = low[d - 1];
            for (int a = d - 2; a >= 0 && !goes_on; --a) {
                goes_on = ++at[a] <= high[a];
                if (!goes_on) at[a] = low[a];
            }
        }
    }

    /// Lists the nodes of all ranks. Those that count come first in vectors.
    template <class Nodes>
    void set(Nodes const& nodes)
    {
        entries_.clear();
        std::vector<Listed> of_ranks;
        if constexpr (spans_ranks<Backend>) {
            of_ranks = detail::of_all_ranks(backend_, listed_);
            std::ranges::sort(of_ranks,
                              [](Listed const& a, Listed const& b) { return is_before(a.at, b.at); });
        }
        std::vector<Listed> const& all = spans_ranks<Backend> ? of_ranks : listed_;
        std::size_t places = 0;
        auto const place = [&](bool counts) {
            std::size_t next_own = 0;
            for (auto const& of : all) {
                bool is_own = true;
                if constexpr (spans_ranks<Backend>) {
                    while (next_own < listed_.size() && is_before(listed_[next_own].at, of.at)) ++next_own;
                    is_own = next_own < listed_.size() && listed_[next_own].at == of.at;
                }
                if ((of.mark > 0) != counts) continue;
                std::uint32_t const index = spans_ranks<Backend> ? nodes.find(of.at) : of.index;
                if (index != Nodes::absent) {
                    Number* const values = &nodes.value(index, 0);
                    entries_.push_back({values, static_cast<std::uint32_t>(places), is_own});
                    apart_ = &nodes.value(index, 1) - values;
                }
                places += std::size_t(d);
            }
            places = (places + lanes - 1) / lanes * lanes;
        };
        place(true);
        counted_ = places;
        place(false);
        if (counted_ > most_numbers) return clear();
        size_ = places;
        if constexpr (spans_ranks<Backend>) {
            std::vector<std::uint32_t> own;
            for (auto const& entry : entries_)
                if (entry.is_own) own.push_back(entry.place);
            order_ = detail::of_all_ranks(backend_, std::move(own));
        }
        triangle_.resize(most * most);
        for (Array* const one : {&weights_, &left_, &found_}) {
            one->resize(size_, 0);
            std::fill(one->data(), one->data() + size_, Number(0)); // also between nodes
        }
        for (Array* const of_all : {&along_, &products_}) of_all->resize(most * size_, 0);
        used_ = kept_ = 0;
    }
    static bool is_before(Coordinates<d> const& a, Coordinates<d> const& b)
    {
        return std::lexicographical_compare(a.data(), a.data() + d, b.data(), b.data() + d);
    }

    /// Fills a vector with what nodes of all ranks have: `value(values of a node, component)`.
    template <class Value>
    void gather(Number* to, Value const& value)
    {
        if constexpr (spans_ranks<Backend>) {
            std::vector<Number> values;
            for (auto const& entry : entries_)
                for (std::size_t a = 0; a < std::size_t(d) && entry.is_own; ++a)
                    values.push_back(value(entry.values, a));
            values = detail::of_all_ranks(backend_, std::move(values));
            for (std::size_t i = 0; i < order_.size(); ++i)
                for (std::size_t a = 0; a < std::size_t(d); ++a)
                    to[order_[i] + a] = values[i * std::size_t(d) + a];
        }
        else
            for (auto const& entry : entries_)
                for (std::size_t a = 0; a < std::size_t(d); ++a) to[entry.place + a] = value(entry.values, a);
    }
    void gather_channels(Number* to, int first)
    {
        std::ptrdiff_t const apart = apart_, from = first * apart;
        gather(to, [=](Number const* values, std::size_t a) {
            return values[from + static_cast<std::ptrdiff_t>(a) * apart];
        });
    }

    /// Gives nodes their preconditioned residual, of which what they are held along is nothing.
    template <class Kernel, class Transfer>
    void give(Number const* z, bool turns) const
    {
        using OwnOf = Own<Kernel, Transfer>;
        for (auto const& entry : entries_)
            for (int a = 0; a < d; ++a) {
                Number along = z[entry.place + std::size_t(a)];
                if (turns)
                    along = sum_of<Number, d>([&](int b) {
                        return entry.values[OwnOf::free_at(a, b) * apart_] * z[entry.place + std::size_t(b)];
                    });
                entry.values[(OwnOf::conditioned + a) * apart_] = along;
            }
    }

    /// Forgets the oldest.
    void forget(std::size_t count)
    {
        kept_ -= count;
        for (Array* const of_all : {&along_, &products_})
            std::copy_n(of_all->data() + count * size_, kept_ * size_, of_all->data());
        for (std::size_t i = 0; i < kept_; ++i)
            for (std::size_t j = i; j < kept_; ++j) of(i, j) = of(i + count, j + count);
        std::copy_n(inverse_ + count, kept_, inverse_);
    }

    Backend backend_;
    std::vector<Listed> listed_; ///< those of this rank
    std::vector<Entry> entries_;
    std::ptrdiff_t apart_ = 0;           ///< two channels of a node
    std::vector<std::uint32_t> order_;   ///< the places of all ranks' nodes, one rank's behind the other's
    std::size_t size_ = 0, counted_ = 0; ///< of vectors, and of their part that counts in sums
    std::size_t kept_ = 0, used_ = 0;    ///< directions, and those by which this system is preconditioned
    Array along_, products_;             ///< S and Y, vector by vector
    Array weights_, left_, found_;       ///< one over the diagonal, r and z
    std::vector<double> triangle_;       ///< R
    double inverse_[most];               ///< of R's diagonal
    double share_[most];                 ///< what condition() finds for each direction
    Number by_[most];                    ///< the same, as shares of vectors
};

} // namespace firn

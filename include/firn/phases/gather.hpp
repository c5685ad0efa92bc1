// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/grid/cell_polynomial.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/phases/update_grid.hpp>

namespace firn
{

/// The gather (G2P): the sums over a particle's stencil that a transfer scheme asks for.
///
///   v_p      = sum_i w_ip v_i                                    and, for FLIP, that of the old velocities
///   affine   = sum_i w_ip v_i (x_i - x_p)^T D^-1                 D: the kernel's inertia
///   gradient = sum_i v_i grad w_ip^T
///   s_p      = sum_i w_ip s_i, or sum_i s_i grad w_ip            the terms of what the transfer carries
///
/// What becomes of them is for the scheme's own `gather` to say. They are computed in one of two ways. Either
/// nodes are read once for all particles of a cell (`CellNodes`), and particles gather from that. Or each
/// particle reads the nodes itself. A backend chooses. The sums are stored in scratch until they are asked
/// for, particle by particle (`gathered`).
template <class Space, class Kernel, class Transfer>
struct Gather
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using CarriedTerms = typename CarriedBy<Transfer>::GatheredTerms;
    static constexpr int node_channels = Values::template channels<Kernel>;
    static constexpr Terms terms = Transfer::template gather_terms<Kernel>;
    /// Whether velocities are asked for, beside what belongs to their gradient.
    static constexpr bool has_velocity = [] {
        if constexpr (requires { Transfer::gathers_velocity; }) return bool(Transfer::gathers_velocity);
        return true;
    }();

    // Scratch channels of a particle: its position, and what it gathered.
    static constexpr int velocity = d, old_velocity = 2 * d;
    static constexpr int affine = old_velocity + (Transfer::keeps_old_velocity ? d : 0);
    static constexpr int gradient = affine + (terms.affine ? d * d : 0);
    static constexpr int carried = gradient + (terms.gradient ? d * d : 0);
    static constexpr int scratch_channels = carried + CarriedTerms::components(d);

    template <class Real, class Items>
    FIRN_HOST_DEVICE static void set_position(Items& items, Vector<Real, d> const& x)
    {
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) items.set_scratch(a, x[a]);
    }

    template <class Real, class Items>
    FIRN_HOST_DEVICE static Vector<Real, d> position_of(Items const& items)
    {
        Vector<Real, d> x;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) x[a] = items.scratch(a);
        return x;
    }

    /// The nodes of a row of cells, expanded for all of its particles: a few channels at a time.
    template <class Real>
    using CellNodes = CellPolynomial<Kernel, Real, d, channels_at_once<Kernel, d>>;

    /// Gathers some channels of the cells' nodes into the scratch of a row of particles. A particle's cell
    /// may lie in another lane: `row.of_cells(value)` moves a value from the lanes of cells to those of their
    /// particles.
    template <class Row, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void gather(Row& row_of_cells, CellNodes<Real> const& nodes, int first)
    {
        Monomials<Kernel, Real, d> const powers(position_of<Real>(row_of_cells));
        auto const of_cells = [&](Real const& term) { return row_of_cells.of_cells(term); };
        if constexpr (CarriedBy<Transfer>::any)
            if (first >= Values::carried) {
                constexpr bool has_gradient = FieldsOfGradients<CarriedTerms>::components(d) > 0;
                store_carried(row_of_cells, nodes.template at<false, has_gradient>(powers, of_cells), first);
                return;
            }
        if (Transfer::keeps_old_velocity && first >= Values::old_velocity) {
            auto const found = nodes.template at<false, false>(powers, of_cells);
            FIRN_UNROLL
            for (int c = 0; c < nodes.channels; ++c)
                row_of_cells.set_scratch(old_velocity + first - Values::old_velocity + c, found.value[c]);
            return;
        }
        auto const found = nodes.template at<terms.affine, terms.gradient>(powers, of_cells);
        FIRN_UNROLL
        for (int c = 0; c < nodes.channels; ++c) {
            if constexpr (has_velocity) row_of_cells.set_scratch(velocity + first + c, found.value[c]);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine)
                    row_of_cells.set_scratch(affine + (first + c) * d + j, found.affine[c][j]);
                if constexpr (terms.gradient)
                    row_of_cells.set_scratch(gradient + (first + c) * d + j, found.gradient[c][j]);
            }
        }
    }

    /// The other way: each particle reads the nodes directly.
    template <class Row, class Real = typename Row::Real>
    FIRN_HOST_DEVICE static void gather(Row& row_of_cells)
    {
        Gathered<Real, d> const sum = gather<Real>(row_of_cells, position_of<Real>(row_of_cells));
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            if constexpr (has_velocity) row_of_cells.set_scratch(velocity + i, sum.velocity[i]);
            if constexpr (Transfer::keeps_old_velocity)
                row_of_cells.set_scratch(old_velocity + i, sum.old_velocity[i]);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine) row_of_cells.set_scratch(affine + i * d + j, sum.affine(i, j));
                if constexpr (terms.gradient)
                    row_of_cells.set_scratch(gradient + i * d + j, sum.gradient(i, j));
            }
        }
        if constexpr (CarriedBy<Transfer>::any) gather_carried<Real>(row_of_cells);
    }

    /// The gathered sums of some particles.
    template <class Real, class Items>
    FIRN_HOST_DEVICE static Gathered<Real, d> gathered(Items const& items)
    {
        Gathered<Real, d> sum;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            sum.velocity[i] = has_velocity ? items.scratch(velocity + i) : Real(0);
            if constexpr (Transfer::keeps_old_velocity) sum.old_velocity[i] = items.scratch(old_velocity + i);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) {
                if constexpr (terms.affine) sum.affine(i, j) = items.scratch(affine + i * d + j);
                if constexpr (terms.gradient) sum.gradient(i, j) = items.scratch(gradient + i * d + j);
            }
        }
        return sum;
    }

    /// The gathered terms of what the transfer carries.
    template <class Real, class Items>
    FIRN_HOST_DEVICE static Record<Real, d, CarriedTerms> carried_terms([[maybe_unused]] Items const& items)
    {
        Record<Real, d, CarriedTerms> gathered;
        for_each_component_of<CarriedTerms, d>(
            gathered, [&](int c, Real& value) { value = items.scratch(carried + c); });
        return gathered;
    }

private:
    /// Where a term of a carried field begins in the scratch.
    template <class Term>
    static constexpr int place_of = carried + CarriedTerms::template first_component<Term>(d);

    /// Stores those terms of carried fields that belong to the channels from `first` on.
    template <class Row, class Found>
    FIRN_HOST_DEVICE static void store_carried(Row& row_of_cells, Found const& found, int first)
    {
        for_each_field(CarriedTerms{}, [&](auto term) {
            using Term = decltype(term);
            using Tag = FieldOfTerm<Term>;
            for (int c = 0; c < component_count<Tag>(d); ++c) {
                int const channel = Values::template channel<Tag> + c - first;
                if (channel < 0 || channel >= channels_at_once<Kernel, d>) continue;
                if constexpr (std::is_same_v<Tag, Term>)
                    row_of_cells.set_scratch(place_of<Term> + c, found.value[channel]);
                else {
                    FIRN_UNROLL
                    for (int j = 0; j < d; ++j)
                        row_of_cells.set_scratch(place_of<Term> + c * d + j, found.gradient[channel][j]);
                }
            }
        });
    }

    /// The same for carried fields. Values are relative, as velocities are below.
    template <class Real, class Row>
    FIRN_HOST_DEVICE static void gather_carried(Row& row_of_cells)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        Nodes const nodes(position_of<Real>(row_of_cells));
        for_each_field(FieldsOfTerms<CarriedTerms>{}, [&](auto tag) {
            using Tag = decltype(tag);
            constexpr bool has_value = CarriedTerms::template contains<Tag>,
                           has_gradient = CarriedTerms::template contains<GradientTerm<Tag>>;
            FieldValue<Tag, Real, d> sums;
            for_each_component<Tag, d>(sums, [&](int c, Real& sum) {
                int const channel = Values::template channel<Tag> + c;
                Real const reference = row_of_cells.reference(channel);
                sum = Real(0);
                Vector<Real, d> slopes = zeros<Vector<Real, d>>();
                FIRN_UNROLL_ON_DEVICE
                for (int row = 0; row < Nodes::rows; ++row) {
                    Real plain(0), slope(0);
                    FIRN_UNROLL
                    for (int k = 0; k < Nodes::width; ++k) {
                        Real const value = row_of_cells.node(channel, row, k);
                        plain += value * nodes.weight[Nodes::last][std::size_t(k)];
                        slope += value * nodes.derivative[Nodes::last][std::size_t(k)];
                    }
                    sum += plain * nodes.row_weight(row);
                    FIRN_UNROLL
                    for (int a = 0; a < Nodes::last; ++a) slopes[a] += plain * nodes.row_gradient(row, a);
                    slopes[Nodes::last] += slope * nodes.row_weight(row);
                }
                if constexpr (has_value) row_of_cells.set_scratch(place_of<Tag> + c, reference + sum);
                if constexpr (has_gradient) {
                    FIRN_UNROLL
                    for (int j = 0; j < d; ++j)
                        row_of_cells.set_scratch(place_of<GradientTerm<Tag>> + c * d + j, slopes[j]);
                }
            });
        });
    }

    /// Sums over nodes of a particle's stencil: those of a row, of a plane, or all.
    template <class Real>
    struct NodeSum
    {
        Vector<Real, d> value, old; ///< velocities, and old velocities
        Matrix<Real, d> moment;     ///< column a: velocities times places along axis a
        Matrix<Real, d> slope;      ///< column a: with derivatives along axis a for weights
    };

    /// Adds what lies at place k along an axis, where sums over the axes behind it are known: three planes,
    /// three rows in each, and three nodes in each of these need fewer products than 27 nodes. Places are
    /// counted from the cell's centre, so that those of all particles are the same small numbers.
    template <class Real, class Nodes>
    FIRN_HOST_DEVICE static void add_along(Nodes const& nodes, int axis, int k, NodeSum<Real> const& inner,
                                           NodeSum<Real>& outer)
    {
        Real const w = nodes.weight[std::size_t(axis)][std::size_t(k)],
                   dw = nodes.derivative[std::size_t(axis)][std::size_t(k)];
        Number const place = Number(k) - Number(0.5) * Kernel::degree;
        auto const add = [&](Real& to, Real const& term) { to = k == 0 ? term : to + term; };
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            Real const weighted = inner.value[a] * w;
            add(outer.value[a], weighted);
            if constexpr (Transfer::keeps_old_velocity) add(outer.old[a], inner.old[a] * w);
            if constexpr (terms.affine)
                if (2 * k != Kernel::degree) add(outer.moment(a, axis), weighted * Real(place));
            if constexpr (terms.gradient) add(outer.slope(a, axis), inner.value[a] * dw);
            FIRN_UNROLL
            for (int b = axis + 1; b < d; ++b) {
                if constexpr (terms.affine) add(outer.moment(a, b), inner.moment(a, b) * w);
                if constexpr (terms.gradient) add(outer.slope(a, b), inner.slope(a, b) * w);
            }
        }
    }

    /// The sums over a particle's stencil. Its nodes are relative to a reference value, such as that of a
    /// node nearby. The weights add up to one, and their distances and gradients to zero, only up to a
    /// rounding, which in steady motion would be the same in every step.
    template <class Real, class Row>
    FIRN_HOST_DEVICE static Gathered<Real, d> gather(Row const& row_of_cells, Vector<Real, d> const& offset)
    {
        using Nodes = Stencil<Kernel, Real, d>;
        Nodes const nodes(offset);
        NodeSum<Real> all, of_plane, of_row;
        FIRN_UNROLL_ON_DEVICE
        for (int row = 0; row < Nodes::rows; ++row) {
            FIRN_UNROLL
            for (int k = 0; k < Nodes::width; ++k) {
                NodeSum<Real> node;
                FIRN_UNROLL
                for (int a = 0; a < d; ++a) {
                    node.value[a] = row_of_cells.node(Values::velocity + a, row, k);
                    if constexpr (Transfer::keeps_old_velocity)
                        node.old[a] = row_of_cells.node(Values::old_velocity + a, row, k);
                }
                add_along<Real>(nodes, Nodes::last, k, node, of_row);
            }
            if constexpr (d == 2)
                add_along<Real>(nodes, 0, row, of_row, all);
            else {
                int const j = Nodes::index(row, 1);
                add_along<Real>(nodes, 1, j, of_row, of_plane);
                if (j + 1 == Nodes::width) add_along<Real>(nodes, 0, Nodes::index(row, 0), of_plane, all);
            }
        }
        Gathered<Real, d> sum;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) {
            sum.velocity[a] = all.value[a] + row_of_cells.reference(Values::velocity + a);
            sum.old_velocity[a] = Real(0);
            if constexpr (Transfer::keeps_old_velocity)
                sum.old_velocity[a] = all.old[a] + row_of_cells.reference(Values::old_velocity + a);
            FIRN_UNROLL
            for (int b = 0; b < d; ++b) {
                sum.affine(a, b) = sum.gradient(a, b) = Real(0);
                if constexpr (terms.affine)
                    sum.affine(a, b) =
                        (all.moment(a, b) - all.value[a] * offset[b]) * Real(Number(Kernel::inverse_inertia));
                if constexpr (terms.gradient) sum.gradient(a, b) = all.slope(a, b);
            }
        }
        return sum;
    }
};

/// Regathers the fields that are not stored, by row, for reading. Positions are those of the last gather, and
/// the nodes are unchanged since.
template <class Space, class Kernel, class TransferType, class PersistentFields, class DerivedFields>
struct GatherVelocities : Gather<Space, Kernel, TransferType>
{
    using Transfer = TransferType;
    using Gather = firn::Gather<Space, Kernel, Transfer>;
    using Gather::d;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true};
    using Result = NothingFound;

    Transfer transfer;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, DerivedFields> velocities;
    Number cell_size; ///< [m]

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Gather::template set_position<typename Items::Real>(items, particles.position(items));
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        // A scheme may also set fields that are stored; they are not written. What it carries may depend on
        // them, as in G2p2g.
        auto particle =
            Record<Real, d, Join<typename Transfer::State, PersistentFields, DerivedFields>>::at_rest();
        if constexpr (CarriedBy<Transfer>::any) particles.load(items, particle);
        transfer.template gather<Kernel, Real, d>(particle, Gather::template gathered<Real>(items),
                                                  Real(1 / cell_size));
        carried_by(transfer).template gather<Real, d>(particle, Gather::template carried_terms<Real>(items),
                                                      Real(1 / cell_size));
        velocities.store(items, particles.id, particle);
    }
};

} // namespace firn

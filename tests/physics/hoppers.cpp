// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/hopper.hpp"

#include <firn/models/fluids/keeps_volume.hpp>

// Water and sand in hoppers of boards that act at their surface and on particles.
using namespace firn;
using namespace firn::test;

namespace
{

struct Kind
{
    Boards boards;
    double overlap; ///< [cells]
};

/// Whether nothing is lost in what is shut and in what has an opening, through which it flows.
template <class Model>
void check_hoppers(Model const& model, Contact const& contact)
{
    for (auto const& [boards, overlap] : {Kind{Boards::boxes, 1}, Kind{Boards::boxes, 0},
                                          Kind{Boards::capsules, 0}, Kind{Boards::half_spaces, 0}})
        for (double const degrees : {60.0, 75.0}) // of the slope: the boards form an angle of 60, or 30
            for (double const opening : {0.0, 0.08}) {
                if (boards == Boards::half_spaces && opening > 0) continue;
                CAPTURE(int(boards), overlap, degrees, opening);
                Hopper<Scene<Model, QuadraticBSpline, Mls>> hopper({.boards = boards,
                                                                    .opening = opening,
                                                                    .overlap = overlap,
                                                                    .slope = degrees * M_PI / 180,
                                                                    .contact = contact},
                                                                   model);
                hopper.advance(0.4);
                CHECK(hopper.lost == 0);
                CHECK(hopper.deepest < 0.01);                                             // [cells]
                if (opening > 0) CHECK(hopper.count_below() > hopper.solver.size() / 10); // it flows
            }
}

} // namespace

TEST_CASE("hoppers whose boards meet at sharp angles lose no water", "[physics][surface]")
{
    check_hoppers(KeepsVolume<Fluid<Plane>>(materials::water<Plane>(3)), Contact::slip());
}

TEST_CASE("hoppers whose boards meet at sharp angles lose no sand", "[physics][surface]")
{
    check_hoppers(materials::dry_sand<Plane>(), Contact::coulomb(0.3));
}

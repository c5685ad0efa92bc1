#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# A model that forgets a member is refused by the compiler, a host's or nvcc, with a sentence that names it, and by nvcc
# one that a device cannot call; so is one without a product in implicit steps, a transfer scheme or a plastic flow,
# what is no effect of a scene, one of which something would be ignored, a field that a transfer cannot carry, and an
# obstacle of a shape without a surface. So is what is complete by itself but not together, such as bodies and a
# reflecting wall:
# incomplete_model.sh COMPILER SOURCE EIGEN.
set -euo pipefail
compiler=$1 source=$2 eigen=$3
work=$(mktemp -d)
said=$work/said
trap 'rm -rf "$work"' EXIT
case $(basename "$compiler") in
nvcc*) flags=(-x cu --expt-relaxed-constexpr -diag-suppress=1675,20012 -Werror=cross-execution-space-call -O1 -I"$source/backends/cuda" --ptx -o /dev/null) ;;
*)
    flags=(-fopenmp -fsyntax-only -I"$source/backends/openmp" -include "$work/library.hpp")
    printf '#include <firn/%s.hpp>\n' firn openmp >"$work/library.hpp" # read once for all of them
    "$compiler" -std=c++20 -fopenmp -I"$source/backends/openmp" -I"$source/include" -isystem "$eigen" \
        -x c++-header "$work/library.hpp" -o "$work/library.hpp.gch"
    ;;
esac

unit=incomplete_model.cpp

# compiles <option>...: the unit
compiles() {
    "$compiler" -std=c++20 "${flags[@]}" -I"$source/include" -isystem "$eigen" "$@" \
        "$source/tests/refusal/$unit" >"$said" 2>&1
}

# names <times> <member> [policy]: so often the compiler says that a model, or this policy, lacks this member
names() {
    local -r times=$(grep -cF "the ${3:-model} lacks '$2" "$said" || true)
    # a compiler may show the line of the sentence, too
    [ "$times" = "$1" ] || [ "$times" = $((2 * $1)) ] ||
        { cat "$said"; echo "'$2' is named $times times where it is missing $1 times."; exit 1; }
}

compiles || { cat "$said"; echo "a complete model is refused."; exit 1; }
if compiles -DINCOMPLETE; then echo "models without their members compile."; exit 1; fi
names 1 "using State"
names 1 "density"
names 1 "void validate()"
names 2 "template <firn::Lane Real, class Particle> firn::Response<Real, d> respond("
names 1 "using Space"
names 1 "template <firn::Lane Real, class Particle> Real energy("
refused=$(grep -cE "error.*the kernel's degree is beyond" "$said" || true)
[ "$refused" = 1 ] || { cat "$said"; echo "it is said $refused times that a kernel's degree is too high."; exit 1; }
# What the compiler says of all else: effects, fields, shapes, transfer schemes and flows.
others() {
    if compiles -DNO_EFFECT; then echo "steps with what is no effect compile."; exit 1; fi
    refused=$(grep -c 'error.*this scene: pass Gravity, Obstacle<Shape>' "$said" || true)
    [ "$refused" = 3 ] || { cat "$said"; echo "it is said $refused times that something is no effect, not three times."; exit 1; }
    if compiles -DNO_PRODUCT; then echo "an implicit step of a model without a product compiles."; exit 1; fi
    errors=$(grep -cE '(error: |: error)' "$said" || true)
    refused=$(grep 'error' "$said" | grep -c "a material answers no product with its tangent" || true)
    [ "$errors $refused" = "1 1" ] || { cat "$said"; echo "it is not said, alone, that a model has no product."; exit 1; }
    if compiles -DNO_FIELD; then echo "a transfer carries fields without their members."; exit 1; fi
    while read -r times member; do
        said_times=$(grep 'error' "$said" | grep -cF "the carried field lacks $member" || true)
        [ "$said_times" = "$times" ] || { cat "$said"; echo "it is said $said_times times, not $times, that a field lacks $member."; exit 1; }
    done <<'END'
1 a list
1 'template <firn::Lane Real, int d, class Particle, class Terms> void scatter(
2 'template <firn::Lane Real, int d, class Sums, class Values> void update(
2 'template <firn::Lane Real, int d, class Particle, class Terms> void gather(
1 'static constexpr auto name'
END
    bounds=$(grep -c "error.*the carried field's bound on steps is to be" "$said" || true)
    [ "$bounds" = 1 ] || { cat "$said"; echo "it is said $bounds times that a bound on steps is not called."; exit 1; }
    if compiles -DNO_SURFACE; then echo "an obstacle of a shape without a surface compiles."; exit 1; fi
    grep -q "a shape lacks 'template <firn::Lane Real, int d> firn::SurfaceSample<Real, d> surface(" "$said" ||
        { cat "$said"; echo "it is not said what a shape lacks."; exit 1; }
    unit=incomplete_transfer.cpp
    compiles || { cat "$said"; echo "a complete transfer scheme is refused."; exit 1; }
    if compiles -DINCOMPLETE; then echo "transfer schemes without their members compile."; exit 1; fi
    while read -r times member; do names "$times" "$member" "transfer scheme"; done <<'END'
1 using State
1 using Stored
1 template <class Kernel> static constexpr firn::Terms scatter_terms'
1 template <class Kernel> static constexpr firn::Terms gather_terms'
1 static constexpr bool keeps_old_velocity'
1 static constexpr bool moves_with_grid'
1 fraction'
1 keeps_old_velocity = true'
1 template <class Kernel, firn::Lane Real, int d, class Particle> firn::ParticleContribution<Real, d> scatter(
2 template <class Kernel, firn::Lane Real, int d, class Particle> firn::Matrix<Real, d> gather(
1 template <class Kernel, firn::Lane Real, int d, class Particle> firn::Vector<Real, d> motion(
END
    names 1 "using State = firn::Fields<...>'" "plastic flow"
    errors=$(grep -cE '(error: |: error)' "$said" || true)
    [ "$errors" = 13 ] || { cat "$said"; echo "there are $errors errors, not one for each transfer scheme and flow."; exit 1; }
    unit=own_effects.cpp
    if compiles; then echo "effects that would be ignored compile."; exit 1; fi
    while read -r times sentence; do
        said_times=$(grep 'error' "$said" | grep -cF "$sentence" || true)
        [ "$said_times" = "$times" ] || { cat "$said"; echo "it is said $said_times times, not $times: $sentence"; exit 1; }
    done <<'END'
20 the action that the effect's over() returns is to have at least one of 'firn::Vector<Real, d> acceleration(
2 what was passed is no effect of this scene
1 the effect owns something, and steps know it as a plain value
3 the effect lacks what bounds the time step
2 the effect has a member by the name of plain, validate_in_plane, largest_acceleration or largest_speed
END
    errors=$(grep -cE '(error: |: error)' "$said" || true)
    [ "$errors" = 28 ] || { cat "$said"; echo "there are $errors errors, not one for each effect."; exit 1; }
    unit=refused_pairs.cpp
    if compiles; then echo "policies, effects and shapes that do not go together compile."; exit 1; fi
    while read -r times sentence; do # a class may be compiled for several steps, and refused for each
        said_times=$(grep 'error' "$said" | sort -u | grep -cF "$sentence" || true)
        [ "$said_times" = "$times" ] || { cat "$said"; echo "it is said $said_times times, not $times: $sentence"; exit 1; }
    done <<'END'
1 Bodies know no ReflectingWall
1 Xpic knows no ReflectingWall
1 Xpic knows no Bodies
1 Bodies exchange momentum alone
1 LocalDamping, and any action with on_impulse, needs the forces apart from the momentum
1 a ReflectingWall goes with no obstacles that act at their surface
1 Bodies know no obstacles that act at their surface
1 a Shell acts on particles: pass Obstacles<Shell<Shape>>, or ActsOn::surface_and_particles
1 a fluid that keeps its volume needs obstacles that act at their surface: pass Obstacles<Shape, ActsOn::surface>, or choose Fluid
1 Traction loads particles that are marked, and the transfer does not carry their marks
1 MarkedForce and HeldMarked act on particles that are marked, and the transfer does not carry their marks
1 a mark is a scalar from 0 to 1
1 a parameter that varies is a number of the model
1 a shape that changes its form is a solid: it makes no Shell
2 a shape that changes its form is an obstacle of its own
1 a shape that changes its form is an obstacle of its own, or Obstacles<DeformingGrid<...>>
4 a shape that changes its form is an obstacle, and makes no region
1 LocalDamping, and any action with on_impulse, needs forces that an implicit step has not found yet: choose Damping, or SymplecticEuler
1 implicit steps know no obstacles that act at their surface: let them act on nodes, or choose SymplecticEuler
1 implicit steps know no Bodies that touch: choose Materials, or SymplecticEuler
1 a fluid bears no shear, so no solve finds its state of rest: take firn::settle(solver, ...) of firn/settle.hpp
1 Xpic extends velocities that an implicit step has not found yet: choose another transfer, or SymplecticEuler
1 an implicit step moves particles with the grid, and this transfer moves them by velocities of their own: choose another one, or SymplecticEuler
1 the midpoint rule needs the velocity before the step where particles gather: choose Flip, or Implicit
END
    # nvcc goes on to where what is missing is asked for
    errors=$(grep -E '(error: |: error)' "$said" | grep -v "this table has no such field" | sort -u | wc -l)
    [ "$errors" = 27 ] || { cat "$said"; echo "there are $errors errors, not one for each that is refused."; exit 1; }
}
others
unit=incomplete_model.cpp
if [[ $(basename "$compiler") == nvcc* ]]; then # or it would compile into nothing
    if compiles -DUNMARKED; then echo "a model that a device cannot call compiles."; exit 1; fi
    grep -q 'calling a __host__ function' "$said" && grep -q 'respond' "$said" ||
        { cat "$said"; echo "it is not said that a device cannot call the model."; exit 1; }
fi
echo "a model without its Space, State, density, validate() or respond() is refused with a sentence that names it, and so is a transfer scheme or a flow without a member, what is no effect, an implicit step of a model without a product, an effect of which something would be ignored, an obstacle of no shape, and what does not go together"

// SPDX-License-Identifier: MIT
// One header of each component that was asked for, and one call: enough to see that headers and targets
// arrive.

#include <firn/core/error.hpp>

#ifdef HOST_HAS_REFERENCE
#include <firn/reference.hpp>
#endif
#ifdef HOST_HAS_OPENMP
#include <firn/openmp.hpp>
#endif
#ifdef HOST_HAS_IO
#include <firn/io/read_mesh.hpp>
#endif
#if defined(HOST_HAS_SAMPLING) && defined(HOST_COMPILES_CGAL)
#include <firn/sampling/mesh_interior.hpp>
#endif

#include <cstdio>

int main()
{
    try {
        firn::require(false, "nothing is wrong", "host", "Carry on.");
    }
    catch (firn::Error const& error) {
        std::puts(error.what());
        return 0;
    }
    return 1;
}

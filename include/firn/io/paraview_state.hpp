// SPDX-License-Identifier: MIT
#pragma once

#include <firn/io/replace_file.hpp>

#include <filesystem>
#include <ostream>
#include <string>

namespace firn
{

namespace detail
{
/// A text as Python writes it.
inline std::string python_text(std::string const& text)
{
    std::string quoted = "\"";
    for (char const c : text) {
        if (c == '"' || c == '\\') quoted += '\\';
        quoted += c;
    }
    return quoted + '"';
}
} // namespace detail

/// Writes a state of ParaView, as a script in Python, that shows a series of frames as points. `index` is the
/// series' `.pvd` in the same folder. The colour is that of `field` or, if no frame has it, of the velocity
/// or of whatever there is.
///
///     paraview --state=particles_state.py
///     pvbatch particles_state.py last_frame.png
///
/// Throws firn::Error: the file cannot be created or not written to its end.
inline void write_paraview_state(std::filesystem::path const& path, std::filesystem::path const& index,
                                 std::string const& field = "velocity")
{
    std::string const text = R"(# Shows a series of particles as points in ParaView, coloured by a field:
#     paraview --state=THIS_FILE          or File > Load State
#     pvbatch THIS_FILE picture.png       saves the last frame
import os
import sys

from paraview.simple import *

INDEX = )" + detail::python_text(index.generic_string()) +
                             R"(
FIELD = )" + detail::python_text(field) +
                             R"(
POINT_SIZE = 4  # pixels

folder = os.path.dirname(os.path.abspath(__file__))
series = PVDReader(registrationName=INDEX, FileName=os.path.join(folder, INDEX))
series.UpdatePipeline()
GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
GetAnimationScene().GoToLast()
view = GetActiveViewOrCreate("RenderView")
points = Show(series, view)
points.SetRepresentationType("Points")
points.PointSize = POINT_SIZE
names = series.PointData.keys()
for name in [FIELD, "velocity"] + [name for name in names if name != "id"]:
    if name in names:
        ColorBy(points, ("POINTS", name))
        points.RescaleTransferFunctionToDataRange(False, True)
        points.SetScalarBarVisibility(view, True)
        break
ResetCamera(view)
Render(view)
if sys.argv[-1].endswith(".png"):
    SaveScreenshot(sys.argv[-1], view)
)";
    detail::replace_file(
        path, [&](std::ostream& out) { out.write(text.data(), static_cast<std::streamsize>(text.size())); });
}

} // namespace firn

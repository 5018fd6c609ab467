"""A window to look at a result in, where there is a display."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._open3d import load_open3d
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.report.cameras import VIEWS, camera
from dqreg.report.colours import OFF_PART, SOURCE, TARGET, rgb
from dqreg.report.report_data import ReportData
from dqreg.report.text import unit_words

INSTEAD = "give --save view.png for a picture or --report report.html for an interactive page"
# Between two pictures, so that an idle window takes no core for itself.
PAUSE_SECONDS = 0.01


def require_display() -> None:
    """Raise unless a window can be hoped for."""
    if not sys.platform.startswith("linux") or _wayland_is_there():
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise InputError(f"there is no display for a window here; {INSTEAD}")
    # Asked before Open3D is: where nobody answers, it opens a window that nobody sees and waits for its end.
    if not _x_answers():
        raise InputError(f"the display {name!r} does not answer (DISPLAY in the environment); {INSTEAD}")


def _wayland_is_there() -> bool:
    name = os.environ.get("WAYLAND_DISPLAY")
    return bool(name) and (Path(os.environ.get("XDG_RUNTIME_DIR", "/")) / str(name)).exists()


def _x_answers() -> bool:
    library = ctypes.util.find_library("X11")
    if library is None:
        return True  # it cannot be asked
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if display:
        x11.XCloseDisplay(display)
    return bool(display)


def open_window(data: ReportData) -> None:
    """Show part and scan with its deviations in a window until it is closed."""
    open3d = load_open3d()
    window = open3d.visualization.Visualizer()
    if not window.create_window(window_name=title_of(data), width=1200, height=860):
        raise InputError(f"no window can be opened on this display; {INSTEAD}")
    for geometry in shapes_of(data):
        window.add_geometry(geometry)
    options = window.get_render_option()
    options.point_size = 2.5
    options.background_color = np.full(3, 0.85)
    _, up, towards = camera(*VIEWS[data.view])
    control = window.get_view_control()
    control.set_front(towards)
    control.set_up(up)
    # Not `window.run()`, in which Ctrl-C would wait for the window's end.
    while window.poll_events():
        window.update_renderer()
        time.sleep(PAUSE_SECONDS)
    window.destroy_window()


def title_of(data: ReportData) -> str:
    """What stands above the window: the verdict, and what the colours mean."""
    level = f"dqreg: {data.result.verdict.level}"
    if data.deviations is None or data.scale is None:
        return level
    end = f"{data.scale.limit:.3g}{unit_words(data.unit)}"
    if not data.scale.signed:
        return f"{level}; deviations from 0 to {end}"
    return f"{level}; deviations from blue, -{end}, to orange, +{end}"


def shapes_of(data: ReportData) -> list[Any]:
    """Open3D geometries of part and scan, about the middle of the part."""
    open3d = load_open3d()
    geometry = data.inputs.target.geometry
    colour = np.array(rgb(TARGET)) / 255.0
    vectors = open3d.utility.Vector3dVector
    target: Any
    if isinstance(geometry, Mesh):
        target = open3d.geometry.TriangleMesh(
            vectors(geometry.vertices), open3d.utility.Vector3iVector(geometry.faces.astype(np.int32))
        )
        target.compute_vertex_normals()
    else:
        target = open3d.geometry.PointCloud(vectors(geometry.points))
    target.paint_uniform_color(colour)
    scan = open3d.geometry.PointCloud(vectors(data.points))
    if data.deviations is None or data.scale is None:
        scan.paint_uniform_color(np.array(rgb(SOURCE)) / 255.0)
    else:
        colours = data.scale.table()[data.colour_codes(slice(None))]
        colours[~data.deviations.counted] = rgb(OFF_PART)
        scan.colors = vectors(colours / 255.0)
    return [target, scan]

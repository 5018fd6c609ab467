"""A window to look at a result in, where there is a display."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.open3d_gate import load_open3d
from dqreg.report.colours import OFF_PART, SOURCE, TARGET, rgb
from dqreg.report.story import Story


def require_display() -> None:
    """Raise unless a window can be hoped for.

    Raises
    ------
    InputError
        If neither X nor Wayland is there on Linux; the message says what to do instead.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            "there is no display for a window here; give --save view.png for a picture or --report report.html for an "
            "interactive page"
        )


def open_window(story: Story) -> None:
    """Show part and scan with its deviations in a window until it is closed.

    Parameters
    ----------
    story : Story
        What is shown.

    Raises
    ------
    InputError
        If no window can be opened.
    """
    open3d = load_open3d()
    window = open3d.visualization.Visualizer()
    if not window.create_window(window_name=f"dqreg: {story.result.verdict.level}", width=1200, height=860):
        raise InputError("no window can be opened on this display; use --save view.png or --report report.html")
    for geometry in shapes_of(story):
        window.add_geometry(geometry)
    window.get_render_option().point_size = 2.5
    window.run()
    window.destroy_window()


def shapes_of(story: Story) -> list[Any]:
    """Open3D geometries of part and scan, about the middle of the part.

    Parameters
    ----------
    story : Story
        What is shown.

    Returns
    -------
    list
        The target, then the scan in the colours of its deviations.
    """
    open3d = load_open3d()
    geometry = story.inputs.target.geometry
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
    scan = open3d.geometry.PointCloud(vectors(story.points))
    if story.deviations is None or story.scale is None:
        scan.paint_uniform_color(np.array(rgb(SOURCE)) / 255.0)
    else:
        colours = story.scale.table()[story.scale.codes(story.deviations.values)]
        colours[~story.deviations.counted] = rgb(OFF_PART)
        scan.colors = vectors(colours / 255.0)
    return [target, scan]

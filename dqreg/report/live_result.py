"""A result in the browser: part and scan, iterations, rivals, the ellipsoid of the pose."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg.geometry import Mesh
from dqreg.report.colours import OFF_PART, SOURCE, TARGET, rgb
from dqreg.report.live_server import add_ellipsoid, open_server, place
from dqreg.report.report_data import ReportData
from dqreg.report.text import text_of, unit_words
from dqreg.report.view3d import MAX_POINTS_ON_PART, MAX_TARGET_POINTS, MAX_TRIANGLES, fewer_triangles, poses_of, thinned


@dataclasses.dataclass(frozen=True)
class LiveResult:
    """A page that shows a result."""

    server: Any
    scene: dict[str, Any]  # Objects of the scene by name: part, scan
    controls: dict[str, Any]  # What the user moves, by its label


def serve_result(data: ReportData, port: int) -> LiveResult:
    """A server that shows a result; lengths in sizes of the target, as all that browsers draw is single precision."""
    server = open_server(port, "dqreg: a registration")
    scene = {"part": _add_target(server, data), "scan": _add_scan(server, data)}
    words = _verdict(data)
    if data.ellipsoid is not None and data.found:
        scene["ellipsoid"], larger = add_ellipsoid(server, "/ellipsoid", data.ellipsoid / data.size, np.zeros(3), 1.0)
        words += f"\n\nThe ellipsoid is one sigma of the middle of the part, drawn {larger:,.0f} times its size."
    server.gui.add_markdown(words)
    server.initial_camera.position, server.initial_camera.look_at = (0.9, -0.9, 0.7), (0.0, 0.0, 0.0)
    return LiveResult(server, scene, _add_controls(server, data, scene))


def _verdict(data: ReportData) -> str:
    verdict = data.result.verdict
    reasons = "\n".join(f"- {_plain(reason)}" for reason in verdict.reasons)
    return f"**{verdict.level.upper()}**\n\n{reasons}"


def _plain(words: str) -> str:
    # Markdown would take the signs of a file's name for its own.
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!" else c for c in words)


def _add_target(server: Any, data: ReportData) -> Any:
    geometry = data.inputs.target.geometry
    if isinstance(geometry, Mesh):
        vertices, faces = fewer_triangles(geometry.vertices / data.size, geometry.faces, MAX_TRIANGLES)
        return server.scene.add_mesh_simple("/part", vertices, faces, color=rgb(TARGET), side="double")
    rows = thinned(geometry.points, np.arange(len(geometry.points)), MAX_TARGET_POINTS)
    points = geometry.points[rows] / data.size
    return server.scene.add_point_cloud("/part", points, rgb(TARGET), point_size=0.002, precision="float32")


def _add_scan(server: Any, data: ReportData) -> Any:
    rows = thinned(data.points, np.arange(len(data.points)), MAX_POINTS_ON_PART)
    colours = np.tile(np.array(rgb(SOURCE), dtype=np.uint8), (len(rows), 1))
    if data.deviations is not None and data.scale is not None:
        table = np.asarray(data.scale.table(), dtype=np.uint8).reshape(-1, 3)
        on = data.deviations.counted[rows]
        colours[on] = table[data.colour_codes(rows[on])]
        colours[~on] = rgb(OFF_PART)
    points = data.points[rows] / data.size
    return server.scene.add_point_cloud("/scan", points, colours, point_size=0.003, precision="float32")


def _add_controls(server: Any, data: ReportData, scene: dict[str, Any]) -> dict[str, Any]:
    poses = poses_of(data)
    steps = [entry for entry in poses if entry["kind"] == "iteration"]
    named = [entry for entry in poses if entry["kind"] != "iteration"]
    said = server.gui.add_markdown("")

    def show(entry: dict[str, Any]) -> None:
        T = np.vstack([np.reshape(entry["T"], (3, 4)), [0.0, 0.0, 0.0, 1.0]])
        place(scene["scan"], T)
        unit = unit_words(data.unit)
        more = "".join(f", {name} {text_of(entry[name])}{unit}" for name in ("rms", "score") if name in entry)
        said.content = f"{entry['name']}{more}"

    controls: dict[str, Any] = {}
    if named:
        first = next((entry for entry in named if entry["kind"] == "after"), named[0])
        names = [entry["name"] for entry in named]
        chosen = controls["Pose"] = server.gui.add_dropdown("Pose", names, initial_value=first["name"])
        chosen.on_update(lambda _: show(next(entry for entry in named if entry["name"] == chosen.value)))
        show(first)
    if len(steps) > 1:
        slider = controls["Iteration"] = server.gui.add_slider("Iteration", 1, len(steps), 1, len(steps))
        slider.on_update(lambda _: show(steps[int(slider.value) - 1]))
    for name, handle in scene.items():
        controls[name] = _add_checkbox(server, name, handle)
    return controls


def _add_checkbox(server: Any, name: str, handle: Any) -> Any:
    box = server.gui.add_checkbox(f"Show the {name}", True)
    box.on_update(lambda _: setattr(handle, "visible", box.value))
    return box

"""The data of the interactive view: thinned, in 16-bit steps, so that a million points stay a small file.

A viewer of our own (`templates/viewer.js`, WebGL 2) instead of plotly.js: 20 kB in the place of 4.5 MB, it draws
hundreds of thousands of points on a phone, and nothing has to be fetched.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh
from dqreg.geometry.morton import morton_order
from dqreg.inspection import measure_deviations
from dqreg.report.cameras import VIEWS
from dqreg.report.part_mesh import fewer_triangles, sharp_edges
from dqreg.report.report_data import ReportData
from dqreg.rigid import pose

# What is drawn at most; about 10 bytes a point and 18 a triangle in the file.
POINTS_ON, POINTS_OFF, POINTS_TARGET, TRIANGLES = 150_000, 30_000, 120_000, 100_000
ALTERNATIVES, POSES = 6, 160
# Clutter farther off than this, in sizes of the target, is left out of the view.
FAR = 3.0
STEPS = 65535
# Longest semi-axis of the ellipsoid as it is drawn, in sizes of the target.
ELLIPSOID = 0.12


def scene_of(story: ReportData) -> dict[str, Any]:
    """Everything that the viewer draws, as plain JSON values; arrays as base64."""
    on, off = _parts_of_scan(story)
    scene: dict[str, Any] = {
        "unit": story.unit,
        "size": story.size,
        "origin": story.origin.tolist(),
        "found": story.found,
        "view": story.view,
        "views": {name: list(angles) for name, angles in VIEWS.items()},
        "onTotal": int(story.deviations.counted.sum()) if story.deviations else len(story.points),
        "spacing": float(story.result.settings.get("source_spacing") or 0.0) / story.size,
        "on": _cloud(story, on, with_values=True),
        "off": _cloud(story, off, with_values=False),
        "target": _target(story),
        "poses": _poses(story),
        "worst": [{"at": ((p.position - story.origin) / story.size).tolist(), "value": p.value} for p in story.worst],
        "motions": _motions(story),
        "ellipsoid": _ellipsoid(story),
    }
    if story.scale is not None:
        scene["scale"] = {
            "low": story.scale.low,
            "high": story.scale.limit,
            "table": _encoded(story.scale.table()),
            "signed": story.scale.signed,
        }
    if story.deviations is not None:
        scene["alternatives"] = [
            _alternative(story, on, k) for k in range(len(story.result.alternatives[:ALTERNATIVES]))
        ]
    return scene


def _parts_of_scan(story: ReportData) -> tuple[IntArray, IntArray]:
    """Rows of the scan that are drawn: on the part, and off it."""
    if story.deviations is None:
        return _thinned(story.points, np.arange(len(story.points)), POINTS_ON), np.zeros(0, dtype=np.int64)
    on = story.deviations.counted
    near = np.linalg.norm(story.points, axis=1) <= FAR * story.size
    return (
        _thinned(story.points, np.flatnonzero(on), POINTS_ON),
        _thinned(story.points, np.flatnonzero(~on & near), POINTS_OFF),
    )


def _thinned(points: FloatArray, rows: IntArray, most: int) -> IntArray:
    if len(rows) <= most:
        return rows
    # Even steps along a space-filling curve leave no holes.
    ordered = rows[morton_order(points[rows])]
    kept: IntArray = ordered[np.linspace(0, len(ordered) - 1, most).astype(np.int64)]
    return kept


def _cloud(story: ReportData, rows: IntArray, *, with_values: bool) -> dict[str, Any]:
    cloud = _quantised(story.points[rows] / story.size)
    if with_values and story.deviations is not None and story.scale is not None:
        values = story.deviations.values[rows]
        step = story.deviations.reach / 32767.0
        cloud["codes"] = _encoded(story.scale.codes(values))
        cloud["values"] = _encoded(np.rint(values / step).astype("<i2"))
        cloud["step"] = step
    return cloud


def _quantised(points: FloatArray) -> dict[str, Any]:
    low = points.min(axis=0) if len(points) else np.zeros(3)
    extent = np.maximum(points.max(axis=0) - low, 1e-12) if len(points) else np.ones(3)
    steps = np.rint((points - low) / extent * STEPS).astype("<u2")
    return {"low": low.tolist(), "extent": extent.tolist(), "count": len(points), "points": _encoded(steps)}


def _target(story: ReportData) -> dict[str, Any]:
    geometry = story.inputs.target.geometry
    if not isinstance(geometry, Mesh):
        rows = _thinned(geometry.points, np.arange(len(geometry.points)), POINTS_TARGET)
        return _quantised(geometry.points[rows] / story.size) | {"total": len(geometry.points), "kind": "cloud"}
    vertices, faces = fewer_triangles(geometry.vertices / story.size, geometry.faces, TRIANGLES)
    quantised = _quantised(vertices)
    return quantised | {
        "kind": "mesh",
        "total": len(geometry.faces),
        "faces": _encoded(faces.astype("<u4")),
        "drawn": len(faces),
        "edges": _encoded(sharp_edges(vertices, faces).astype("<f4")),
    }


def _poses(story: ReportData) -> list[dict[str, Any]]:
    """Before, after, alternatives and iterations, each as the motion from the points that are drawn."""
    drawn = story.result.T_target_source if story.found else story.T_before
    poses: list[dict[str, Any]] = []
    if story.T_before is not None:
        short, name = story.before_words[0], ", ".join(story.before_words)
        poses.append({"kind": "before", "name": name, "short": short, "T": story.T_before})
    if story.found:
        poses.append({"kind": "after", "name": "After", "T": story.result.T_target_source})
    for number, other in enumerate(story.result.alternatives[:ALTERNATIVES], 1):
        name = f"Alternative {number}"
        poses.append({"kind": "alternative", "name": name, "score": other.score, "T": other.T_target_source})
    history = story.result.history
    step = max(1, -(-len(history) // POSES))
    for record in history[::step]:
        name = f"iteration {record.number}, {record.stage}"
        poses.append({"kind": "iteration", "name": name, "rms": record.rms, "T": record.T_target_source})
    return [entry | {"T": _relative(entry["T"], drawn, story)} for entry in poses if np.isfinite(entry["T"]).all()]


def _relative(T: FloatArray, drawn: FloatArray | None, story: ReportData) -> list[float]:
    base = np.eye(4) if drawn is None else drawn
    motion = pose.about(T @ pose.inverse(base), -story.origin)
    motion[:3, 3] /= story.size
    return [float(x) for x in motion[:3].ravel()]


def _alternative(story: ReportData, rows: IntArray, number: int) -> dict[str, Any]:
    """Colours of the drawn points under another pose."""
    assert story.deviations is not None
    assert story.scale is not None
    other = story.result.alternatives[number].T_target_source
    about = pose.about(other @ pose.inverse(story.result.T_target_source), -story.origin)
    target = story.inputs.target
    spacing = float(story.result.settings.get("source_spacing") or 0.0)
    moved = pose.apply(about, story.points[rows])
    found = measure_deviations(moved, target.geometry, target.surface, spacing=spacing)
    return {"codes": _encoded(story.scale.codes(found.values))}


def _motions(story: ReportData) -> list[dict[str, Any]]:
    motions = []
    for number, direction in enumerate(story.result.observability, 1):
        # A file of old has the words only.
        if direction.kind is not None:
            motions.append(
                {
                    "number": number,
                    "kind": direction.kind,
                    "axis": direction.axis,
                    "through": ((direction.point - story.origin) / story.size).tolist(),
                    "strength": direction.strength,
                    "free": direction.is_free,
                }
            )
    return motions


def _ellipsoid(story: ReportData) -> list[list[float]] | None:
    """Semi-axes of one sigma of the translation, one a row, scaled to `ELLIPSOID` sizes."""
    if story.ellipsoid is None:
        return None
    axes = ELLIPSOID * story.ellipsoid / np.linalg.norm(story.ellipsoid, axis=1).max()
    rows: list[list[float]] = axes.tolist()
    return rows


def _encoded(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")

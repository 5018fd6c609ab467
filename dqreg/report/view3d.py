"""The data of the interactive view: thinned, in 16-bit steps, so that a million points stay a small file.

A viewer of our own (`templates/view3d.js`, WebGL 2) instead of plotly.js: 20 kB in the place of 4.5 MB, it draws
hundreds of thousands of points on a phone, and nothing has to be fetched.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg._open3d import load_open3d
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import faces_of, weld_edges
from dqreg.geometry.morton import morton_order
from dqreg.inspection import measure_deviations
from dqreg.inspection.decision.regions import MOST_FACES
from dqreg.report.cameras import VIEWS
from dqreg.report.report_data import ReportData
from dqreg.rigid import pose

# What is drawn at most; about 10 bytes a point and 18 a triangle in the file.
MAX_POINTS_ON_PART, MAX_POINTS_OFF_PART = 150_000, 30_000
MAX_TARGET_POINTS, MAX_TRIANGLES = 120_000, 100_000
MAX_ALTERNATIVES, MAX_POSES = 6, 160
# Clutter farther off than this, in sizes of the target, is left out of the view.
MAX_FAR_DIAGONALS = 3.0
# A coordinate is so many steps at most, in 16 bits.
COORDINATE_STEPS = 65535
# Longest semi-axis of the ellipsoid as it is drawn, in sizes of the target.
ELLIPSOID_DIAGONALS = 0.12
# Edges of the part are drawn where it turns by that much; a rough mesh, where a quarter of all are, shows none.
EDGE_DEG, ROUGH_EDGE_SHARE = 25.0, 0.25
# Cells that corners are put together in, in sizes of the mesh; larger ones follow until there are few enough.
FIRST_CELL_DIAGONALS, WIDENING_FACTOR = 0.0025, 1.3


def scene_of(data: ReportData) -> dict[str, Any]:
    """Everything that the viewer draws, as plain JSON values; arrays as base64."""
    on, off = _parts_of_scan(data)
    scene: dict[str, Any] = {
        "unit": data.unit,
        "size": data.size,
        "origin": data.origin.tolist(),
        "found": data.found,
        "view": data.view,
        "views": {name: list(angles) for name, angles in VIEWS.items()},
        "onTotal": int(data.deviations.counted.sum()) if data.deviations else len(data.points),
        "spacing": float(data.result.settings.get("source_spacing") or 0.0) / data.size,
        "on": _cloud(data, on, with_values=True),
        "off": _cloud(data, off, with_values=False),
        "target": _target(data),
        "poses": poses_of(data),
        "labels": [
            {
                "at": ((label.position - data.origin) / data.size).tolist(),
                "text": label.text,
                "title": label.title,
                "kind": label.kind,
            }
            for label in data.labels
        ],
        "motions": _motions(data),
        "ellipsoid": _ellipsoid(data),
    }
    if data.scale is not None:
        scene["scale"] = {
            "low": data.scale.low,
            "high": data.scale.limit,
            "table": _encoded(data.scale.table()),
            "signed": data.scale.signed,
        }
    if data.deviations is not None:
        count = min(len(data.result.alternatives), MAX_ALTERNATIVES)
        scene["alternatives"] = [_alternative(data, on, k) for k in range(count)]
    return scene


def _parts_of_scan(data: ReportData) -> tuple[IntArray, IntArray]:
    """Rows of the scan that are drawn: on the part, and off it."""
    if data.deviations is None:
        return thinned(data.points, np.arange(len(data.points)), MAX_POINTS_ON_PART), np.zeros(0, dtype=np.int64)
    on = data.deviations.counted
    near = np.linalg.norm(data.points, axis=1) <= MAX_FAR_DIAGONALS * data.size
    return (
        thinned(data.points, np.flatnonzero(on), MAX_POINTS_ON_PART),
        thinned(data.points, np.flatnonzero(~on & near), MAX_POINTS_OFF_PART),
    )


def thinned(points: FloatArray, rows: IntArray, most: int) -> IntArray:
    """Of some rows, at most so many, evenly over space."""
    if len(rows) <= most:
        return rows
    # Even steps along a space-filling curve leave no holes.
    ordered = rows[morton_order(points[rows])]
    kept: IntArray = ordered[np.linspace(0, len(ordered) - 1, most).astype(np.int64)]
    return kept


def _cloud(data: ReportData, rows: IntArray, *, with_values: bool) -> dict[str, Any]:
    cloud = _quantised(data.points[rows] / data.size)
    if with_values and data.deviations is not None and data.scale is not None:
        values = data.deviations.values[rows]
        step = data.deviations.reach / 32767.0
        cloud["codes"] = _encoded(data.colour_codes(rows))
        cloud["values"] = _encoded(np.rint(values / step).astype("<i2"))
        cloud["step"] = step
    return cloud


def _quantised(points: FloatArray) -> dict[str, Any]:
    low = points.min(axis=0) if len(points) else np.zeros(3)
    extent = np.maximum(points.max(axis=0) - low, 1e-12) if len(points) else np.ones(3)
    steps = np.rint((points - low) / extent * COORDINATE_STEPS).astype("<u2")
    return {"low": low.tolist(), "extent": extent.tolist(), "count": len(points), "points": _encoded(steps)}


def _target(data: ReportData) -> dict[str, Any]:
    geometry = data.inputs.target.geometry
    if not isinstance(geometry, Mesh):
        rows = thinned(geometry.points, np.arange(len(geometry.points)), MAX_TARGET_POINTS)
        return _quantised(geometry.points[rows] / data.size) | {"total": len(geometry.points), "kind": "cloud"}
    vertices, faces = fewer_triangles(geometry.vertices / data.size, geometry.faces, MAX_TRIANGLES)
    quantised = _quantised(vertices)
    return quantised | {
        "kind": "mesh",
        "total": len(geometry.faces),
        "faces": _encoded(faces.astype("<u4")),
        "drawn": len(faces),
        "edges": _encoded(sharp_edges(vertices, faces).astype("<f4")),
        **_numbers(geometry, len(faces)),
    }


def _numbers(mesh: Mesh, drawn: int) -> dict[str, Any]:
    """Number of the part's face that each drawn triangle is of, where the triangles are the part's own."""
    if drawn < len(mesh.faces):
        return {}
    count, labels = faces_of(mesh)
    return {"faceOf": _encoded(labels.astype("<u2"))} if count <= MOST_FACES else {}


def poses_of(data: ReportData) -> list[dict[str, Any]]:
    """Before, after, alternatives and iterations, each as the motion from the points that are drawn."""
    drawn = data.result.T_target_source if data.found else data.T_before
    poses: list[dict[str, Any]] = []
    if data.T_before is not None:
        short, name = data.before_words[0], ", ".join(data.before_words)
        poses.append({"kind": "before", "name": name, "short": short, "T": data.T_before})
    if data.found:
        poses.append({"kind": "after", "name": "After", "T": data.result.T_target_source})
    for number, other in enumerate(data.result.alternatives[:MAX_ALTERNATIVES], 1):
        name = f"Alternative {number}"
        poses.append({"kind": "alternative", "name": name, "score": other.score, "T": other.T_target_source})
    history = data.result.history
    step = max(1, -(-len(history) // MAX_POSES))
    for record in history[::step]:
        name = f"iteration {record.number}, {record.stage}"
        poses.append({"kind": "iteration", "name": name, "rms": record.rms, "T": record.T_target_source})
    return [entry | {"T": _relative(entry["T"], drawn, data)} for entry in poses if np.isfinite(entry["T"]).all()]


def _relative(T: FloatArray, drawn: FloatArray | None, data: ReportData) -> list[float]:
    base = np.eye(4) if drawn is None else drawn
    motion = pose.about(T @ pose.inverse(base), -data.origin)
    motion[:3, 3] /= data.size
    return [float(x) for x in motion[:3].ravel()]


def _alternative(data: ReportData, rows: IntArray, number: int) -> dict[str, Any]:
    """Colours of the drawn points under another pose."""
    assert data.deviations is not None
    assert data.scale is not None
    other = data.result.alternatives[number].T_target_source
    about = pose.about(other @ pose.inverse(data.result.T_target_source), -data.origin)
    target = data.inputs.target
    spacing = float(data.result.settings.get("source_spacing") or 0.0)
    moved = pose.apply(about, data.points[rows])
    found = measure_deviations(moved, target.geometry, target.surface, spacing=spacing)
    return {"codes": _encoded(data.scale.codes(found.values))}


def _motions(data: ReportData) -> list[dict[str, Any]]:
    motions = []
    for number, direction in enumerate(data.result.observability, 1):
        # A file of old has the words only.
        if direction.kind is not None:
            motions.append(
                {
                    "number": number,
                    "kind": direction.kind,
                    "axis": direction.axis,
                    "through": ((direction.point - data.origin) / data.size).tolist(),
                    "strength": direction.strength,
                    "free": direction.is_free,
                }
            )
    return motions


def _ellipsoid(data: ReportData) -> list[list[float]] | None:
    """Semi-axes of one sigma of the translation, one a row, scaled to `ELLIPSOID_DIAGONALS`."""
    if data.ellipsoid is None:
        return None
    axes = ELLIPSOID_DIAGONALS * data.ellipsoid / np.linalg.norm(data.ellipsoid, axis=1).max()
    rows: list[list[float]] = axes.tolist()
    return rows


def _encoded(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")


def fewer_triangles(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """The mesh, simplified where it has too many triangles to be mailed."""
    if len(faces) <= most:
        used, numbers = np.unique(faces, return_inverse=True)
        return vertices[used], numbers.reshape(-1, 3)
    open3d = load_open3d()
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    # Corners are put together cell by cell where their planes meet, which keeps edges sharp; collapsing edges one by
    # one is finer, and takes a minute for a million triangles.
    planes = open3d.geometry.SimplificationContraction.Quadric
    cell = _cell_for(vertices, faces, most)
    simple = mesh.simplify_vertex_clustering(cell, planes)
    while len(simple.triangles) > most:
        cell *= WIDENING_FACTOR
        simple = mesh.simplify_vertex_clustering(cell, planes)
    return np.asarray(simple.vertices).copy(), np.asarray(simple.triangles).astype(np.int64)


def _cell_for(vertices: FloatArray, faces: IntArray, most: int) -> float:
    """The first cell that leaves few enough triangles, counted before any is made: that takes a tenth of the time."""
    cell = float(np.linalg.norm(np.ptp(vertices, axis=0))) * FIRST_CELL_DIAGONALS
    while (left := _left(vertices, faces, cell)) > most:
        # Triangles are as many as cells of a surface; half of the steps that it seems to take are none too many.
        cell *= WIDENING_FACTOR ** max(1, int(0.5 * np.log(left / most) / (2.0 * np.log(WIDENING_FACTOR))))
    return cell


def _left(vertices: FloatArray, faces: IntArray, cell: float) -> int:
    """Triangles whose corners come into three different cells, each trio of cells once."""
    low = vertices.min(axis=0) - 0.5 * cell
    places = np.floor((vertices - low) / cell).astype(np.int64)
    wide = places.max(axis=0) + 1
    _, cells = np.unique((places[:, 0] * wide[1] + places[:, 1]) * wide[2] + places[:, 2], return_inverse=True)
    trios = cells[faces]
    trios = trios[(trios != np.roll(trios, 1, axis=1)).all(axis=1)]
    first = trios.argmin(axis=1)
    turned = np.take_along_axis(trios, (first[:, None] + np.arange(3)) % 3, axis=1)
    count = int(cells.max()) + 1
    keys = (turned[:, 0] * count + turned[:, 1]) * count + turned[:, 2]
    return len(np.unique(keys))


def sharp_edges(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Both ends of each edge where the surface turns sharply or ends. Shapes: returns (k, 2, 3)."""
    ends, owners = weld_edges(vertices, faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    starts = np.flatnonzero(np.r_[True, (ends[1:] != ends[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(ends)])
    twin = np.minimum(starts + 1, len(ends) - 1)
    turn = np.einsum("ij,ij->i", normals[owners[starts]], normals[owners[twin]])
    sharp = starts[(counts != 2) | (turn < np.cos(np.deg2rad(EDGE_DEG)))]
    if len(sharp) > ROUGH_EDGE_SHARE * len(starts) and len(starts) > 500:
        return np.zeros((0, 2, 3))
    places = np.unique(vertices, axis=0)
    edges: FloatArray = places[ends[sharp]]
    return edges

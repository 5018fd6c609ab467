"""The first step: what a file holds, and what is worth a question before the two sides are compared."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry import Mesh, PointCloud, prepare_scan
from dqreg.geometry.mesh_faces import faces_of
from dqreg.geometry.unit_check import find_unit_mistake
from dqreg.inspection import Face, part_faces, why_unsigned
from dqreg.inspection.decision.regions import MOST_FACES
from dqreg.studio.cleaning import kept_rows, leaving_plane, scan_points
from dqreg.studio.drawing import drawn_pose, frame_of
from dqreg.studio.payloads import cloud_payload, part_payload, rows_to_draw, shades
from dqreg.studio.worker_cache import Place, cached

# Points that spacing and noise are measured on.
MEASURED_POINTS = 20_000
# Gap between the two where they are drawn beside each other, in sizes of the part.
GAP_DIAGONALS = 0.15
# Parts whose numbers are all smaller are rather in metres than in millimetres.
MAX_METRES = 1.5
# Coordinates of faces below this many sizes are zero.
ZERO_DIAGONALS = 1e-7


@dataclasses.dataclass(frozen=True)
class Measure:
    """Spacing and noise of a scan, in its own unit."""

    spacing: float
    noise: float


def measure(place: Place) -> Measure:
    """Spacing and noise of the scan."""

    def make() -> Measure:
        scan = place.scan()
        cloud = scan if isinstance(scan, PointCloud) else PointCloud(scan_points(scan))
        found = prepare_scan(cloud, MEASURED_POINTS)
        return Measure(found.spacing, found.noise)

    return cached("measure", place.scan_key, make)


def read_scan(place: Place) -> dict[str, Any]:
    """What the file of the scan holds."""
    scan, found = place.scan(), measure(place)
    return _facts(scan) | {"spacing": found.spacing, "noise": found.noise}


def read_part(place: Place) -> dict[str, Any]:
    """What the file of the part holds, its faces, and its drawing."""
    part = place.part()
    words, data = part_payload(part, frame_of(part), triangle_labels(place))
    place.write("part.bin", data)
    return _facts(part) | {"faces": _faces(place), "drawing": words | {"file": "part.bin"}}


def draw_scan(place: Place) -> dict[str, Any]:
    """The scan to draw: first what the cuts leave, then what they leave out."""
    scan = place.scan()
    points = scan_points(scan)
    stays = kept_rows(points, place.visit.cuts)
    rows = rows_to_draw(points, stays)
    words, data = cloud_payload(points, frame_of(scan), rows)
    place.write("scan.bin", data + shades(points[np.concatenate(rows)]))
    return words | {"file": "scan.bin", "left": int(np.count_nonzero(stays))}


def compare_sides(place: Place) -> dict[str, Any]:
    """What is worth a question: units that do not fit, sides that look swapped; and where each is drawn."""
    scan, part = place.scan(), place.part()
    units = place.units()
    mistake = find_unit_mistake(scan, part, *units)
    questions: list[dict[str, Any]] = []
    if mistake is not None:
        questions.append(
            {
                "code": "units",
                "ratio": mistake.ratio,
                "scan_units": mistake.source_units,
                "part_units": mistake.target_units,
            }
        )
    elif units[1] is None:
        questions.append({"code": "unnamed", "likely": units[0] or _likely(part)})
    swapped = _look_swapped(scan, part)
    if swapped:
        questions.append({"code": "swapped", "why": swapped})
    return {"questions": questions, "units": units, "scale": place.scale(), "poses": _poses(place)}


def _likely(part: PointCloud | Mesh) -> str:
    """The unit that a part without one is most often in, by its numbers alone: only a suggestion."""
    return "mm" if float(_extent(part).max()) > MAX_METRES else "m"


def _look_swapped(scan: PointCloud | Mesh, part: PointCloud | Mesh) -> str:
    """What speaks for the two being the wrong way round: a surface on points, or a closed surface on an open one."""
    if isinstance(scan, Mesh) and isinstance(part, PointCloud):
        return "kinds"
    if isinstance(scan, Mesh) and isinstance(part, Mesh) and why_unsigned(part) and not why_unsigned(scan):
        return "open"
    return ""


def plane_question(place: Place) -> dict[str, Any]:
    """The plane that leaves the part, as a cut to be confirmed; None where there is none."""
    found = measure(place)
    answer = leaving_plane(place, found.spacing, found.noise)
    if answer is None:
        return {"plane": None}
    cut, points = answer
    return {"plane": dataclasses.asdict(cut), "points": points}


def _facts(geometry: PointCloud | Mesh) -> dict[str, Any]:
    points = geometry.vertices if isinstance(geometry, Mesh) else geometry.points
    low, high = bounds(points)
    frame = frame_of(geometry)
    facts: dict[str, Any] = {
        "kind": "mesh" if isinstance(geometry, Mesh) else "cloud",
        "points": len(points),
        "low": low.tolist(),
        "high": high.tolist(),
        "extents": (high - low).tolist(),
        "size": float(np.linalg.norm(high - low)),
        "frame": {"middle": frame.middle.tolist(), "size": frame.size},
        "units": geometry.units,
        "dropped": geometry.dropped,
    }
    if isinstance(geometry, Mesh):
        return facts | {"triangles": len(geometry.faces), "unsigned": why_unsigned(geometry), "normals": True}
    return facts | {"normals": geometry.normals is not None, "unsigned": why_unsigned(geometry)}


def faces_of_part(place: Place) -> tuple[Face, ...]:
    """Faces of the part; none of a cloud, or of a mesh that is too rough to be cut into faces."""
    part = place.part()
    if not isinstance(part, Mesh):
        return ()

    def make() -> tuple[Face, ...]:
        labels = triangle_labels(place)
        return part_faces(part) if labels is not None and labels.max() < MOST_FACES else ()

    return cached("faces", [place.part_path], make)


def triangle_labels(place: Place) -> IntArray | None:
    """Number of the face that each triangle of the part is of, (f,); None for a cloud."""
    part = place.part()
    return cached("labels", [place.part_path], lambda: faces_of(part)[1]) if isinstance(part, Mesh) else None


def _faces(place: Place) -> list[dict[str, Any]]:
    rows, faces, size = [], faces_of_part(place), frame_of(place.part()).size
    for face in faces:
        radius = None if face.feature is None or np.isnan(face.feature.radius) else face.feature.radius
        axis = None if face.feature is None or np.isnan(face.feature.axis).any() else face.feature.axis.tolist()
        rows.append(
            {
                "number": face.number,
                "kind": face.kind,
                "hole": face.is_hole,
                "area": face.area,
                # What rounding leaves of a zero is one.
                "centre": np.where(np.abs(face.centre) < ZERO_DIAGONALS * size, 0.0, face.centre).tolist(),
                "axis": axis,
                "diameter": None if radius is None else 2.0 * radius,
                "radii": None if face.torus is None else [face.torus.major_radius, face.torus.minor_radius],
            }
        )
    return rows


def _poses(place: Place) -> dict[str, list[float]]:
    scan, part = frame_of(place.scan()), frame_of(place.part())
    scale = place.scale()
    beside = np.eye(4)
    width = 0.5 * (_extent(place.part())[0] + scale * _extent(place.scan())[0]) + GAP_DIAGONALS * part.size
    beside[:3, 3] = part.middle - np.array([width, 0.0, 0.0]) - scale * scan.middle
    return {"as_scanned": drawn_pose(np.eye(4), scale, scan, part), "beside": drawn_pose(beside, scale, scan, part)}


def _extent(geometry: PointCloud | Mesh) -> FloatArray:
    low, high = bounds(geometry.vertices if isinstance(geometry, Mesh) else geometry.points)
    extent: FloatArray = high - low
    return extent

"""Datums of a part as one would choose them at the table: a stable seat, a long side, and what holds the rest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection.alignment import Datum, align_datums
from dqreg.inspection.features import Feature
from dqreg.inspection.part_faces import Face
from dqreg.inspection.plan.round_faces import is_arc

# Axes are perpendicular below that cosine, and parallel above that one.
PERPENDICULAR_COS, PARALLEL_COS = 0.1, 0.995
# A seat has the whole part on one side of it, but for that share of the part's size.
BELOW_SEAT_DIAGONALS = 1e-3
# A seat counts so many times its area: a part is set down on it.
SEAT_AREA_FACTOR = 2.0
# A plane has that share of the area of the largest face at least: a facet of a coarse hole has not.
MIN_PLANE_AREA_RATIO = 0.005
# Two holes hold a rotation where they are that share of the part's size apart.
MIN_APART_DIAGONALS = 0.2
# Candidates for each letter that are tried.
TRIED_CANDIDATES = 6


@dataclasses.dataclass(frozen=True, eq=False)
class SuggestedDatum:
    """A datum with the reason for it."""

    name: str
    face: Face
    reason: str


def suggest_datums(
    mesh: Mesh, faces: tuple[Face, ...], covered: Mapping[int, float] | None = None
) -> tuple[SuggestedDatum, ...]:
    """Three datums that hold all six motions; empty where the faces have none.

    A is the plane that a part stands on best: large in both directions, scanned, the part on one side of it. B is the
    longest plane perpendicular to A, C one perpendicular to both. Where there are none, two holes that are square to A,
    far apart, take their place; a round part has its largest cylinder first.

    >>> from dqreg.inspection import part_faces
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> [(each.name, each.face.area, each.reason) for each in suggest_datums(part, part_faces(part))][:2]
    [('A', 6.0, 'large and stable, the part stands on it'), ('B', 3.0, 'perpendicular to A, long')]
    """
    shares = {face.number: 1.0 if covered is None else covered.get(face.number, 0.0) for face in faces}
    sizes = _extents(mesh, faces)
    large = MIN_PLANE_AREA_RATIO * max((face.area for face in faces), default=0.0)
    planes = [face for face in faces if face.kind == "plane" and shares[face.number] > 0.0 and face.area >= large]
    holes = [face for face in faces if face.kind == "cylinder" and shares[face.number] > 0.0 and not is_arc(mesh, face)]
    seats = _seats(mesh, planes)

    def stable(face: Face) -> float:
        long, short = sizes[face.number]
        return (
            shares[face.number]
            * math.sqrt(face.area * short / max(long, 1e-300))
            * (SEAT_AREA_FACTOR if seats[face.number] else 1)
        )

    def long(face: Face) -> float:
        return shares[face.number] * sizes[face.number][0] * math.sqrt(face.area)

    first = _best(planes, stable)
    for a in first:
        for chosen in (*_planes(a, planes, long), *_holes(a, holes, mesh, shares), *_mixed(a, planes, holes, long)):
            found = (("A", a, "large and stable" + (", the part stands on it" if seats[a.number] else "")), *chosen)
            if _holds([(name, face) for name, face, _ in found]):
                return tuple(SuggestedDatum(*each) for each in found)
    return ()


Row = tuple[str, Face, str]


def _planes(a: Face, planes: list[Face], long: Callable[[Face], float]) -> Iterator[tuple[Row, Row]]:
    square = [face for face in planes if _cosine(face, a) < PERPENDICULAR_COS]
    for b in _best(square, long):
        for c in _best([face for face in square if _cosine(face, b) < PERPENDICULAR_COS], long):
            yield ("B", b, "perpendicular to A, long"), ("C", c, "perpendicular to A and B")


def _holes(a: Face, holes: list[Face], mesh: Mesh, shares: Mapping[int, float]) -> Iterator[tuple[Row, Row]]:
    along = [face for face in holes if _cosine(face, a) > PARALLEL_COS]
    for b in _best(along, lambda face: shares[face.number] * face.area):
        distances = {face.number: shares[face.number] * _across(face, b) for face in along}
        far = [face for face in along if distances[face.number] > MIN_APART_DIAGONALS * mesh.diagonal]
        for c in sorted(far, key=lambda face: -distances[face.number])[:TRIED_CANDIDATES]:
            yield (
                ("B", b, f"{_word(b)} square to A, the largest"),
                ("C", c, f"{_word(c)} far from B: together they hold the rotation about A's normal"),
            )


def _mixed(a: Face, planes: list[Face], holes: list[Face], long: Callable[[Face], float]) -> Iterator[tuple[Row, Row]]:
    square = _best([face for face in planes if _cosine(face, a) < PERPENDICULAR_COS], long)
    for b in _best([face for face in holes if _cosine(face, a) > PARALLEL_COS], lambda face: face.area):
        for c in square:
            yield ("B", b, f"{_word(b)} square to A"), ("C", c, "perpendicular to A: holds the rotation about B")
    for b in square:
        for c in _best([face for face in holes if _cosine(face, a) > PARALLEL_COS], lambda face: face.area):
            yield ("B", b, "perpendicular to A, long"), ("C", c, f"{_word(c)} square to A")


def _holds(rows: list[tuple[str, Face]]) -> bool:
    """Whether datums hold all six motions, as the alignment itself would."""
    features = [(name, face.feature) for name, face in rows if face.feature is not None]
    try:
        align_datums([Datum(name, feature, feature) for name, feature in features])
    except DegenerateGeometryError:
        return False
    return True


def _best(faces: list[Face], score: Callable[[Face], float]) -> list[Face]:
    # Equal ones keep the order of their numbers, whatever rounding does.
    return sorted(faces, key=lambda face: (-float(f"{score(face):.6g}"), face.number))[:TRIED_CANDIDATES]


def _feature(face: Face) -> Feature:
    assert face.feature is not None
    return face.feature


def _cosine(face: Face, other: Face) -> float:
    return abs(float(_feature(face).axis @ _feature(other).axis))


def _across(face: Face, other: Face) -> float:
    offset = _feature(face).point - _feature(other).point
    axis = _feature(other).axis
    return float(np.linalg.norm(offset - (offset @ axis) * axis))


def _word(face: Face) -> str:
    return "hole" if face.is_hole else "cylinder"


def _extents(mesh: Mesh, faces: tuple[Face, ...]) -> dict[int, tuple[float, float]]:
    """Longer and shorter extent of each flat face, by the moments of its area."""
    labels = faces_of(mesh)[1]
    middles, areas = mesh.corners.mean(axis=1), mesh.face_areas
    found = {}
    for face in faces:
        rows: IntArray = np.flatnonzero(labels == face.number)
        away = middles[rows] - face.centre
        corners = (mesh.corners[rows] - middles[rows, None]).reshape(-1, 3)
        # Of a triangle: its middle, and a twelfth of its corners' squares about that.
        own = (corners * np.repeat(areas[rows], 3)[:, None]).T @ corners / 12.0
        moments = ((away * areas[rows, None]).T @ away + own) / max(float(areas[rows].sum()), 1e-300)
        values = np.sqrt(np.maximum(np.linalg.eigvalsh(moments), 0.0) * 12.0)
        found[face.number] = float(values[2]), float(values[1])
    return found


def _seats(mesh: Mesh, planes: list[Face]) -> dict[int, bool]:
    """Whether a part can stand on each plane: all of it lies on one side."""
    points: FloatArray = mesh.vertices
    below = BELOW_SEAT_DIAGONALS * mesh.diagonal
    return {face.number: bool(((points - face.centre) @ _feature(face).axis).max() <= below) for face in planes}

"""The part cut into its natural faces at its sharp edges, and how the scan lies on each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.errors import InputError
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.mesh_faces import areas_of, faces_of
from dqreg.inspection.decision.coverage import weighted_median
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.solvers.robust import scatter_of

Outcome = Literal["pass", "fail", "undecided"]

# A face with fewer points than this share of the usual number on its area was not scanned: strays lie near it.
MIN_DENSITY_RATIO = 0.08
# More faces than that make no table: an organic shape, or a rough mesh. It is cut into eight boxes instead.
MOST_FACES = 400
# Places along the edges of faces at most.
MOST_PLACES = 400_000
# Points from which on a region is judged.
MIN_REGION_POINTS = 30
# A region is flat where its normals agree to that much.
FLAT_RESULTANT_LENGTH = 0.9998
FACES = "The part's faces that were scanned, cut where its surface turns sharply or a plane ends."
BOXES = "Eight boxes about the centre of the target, as it has no sharp edges to be cut at."


@dataclasses.dataclass(frozen=True)
class Region:
    """Deviations on one region of the part, target units.

    Attributes
    ----------
    number : int
        The same for the same mesh.
    name : str
        What and where it is.
    centre : ndarray, (3,)
        Mean of its scan points, about the target's origin.
    points : int
        Scan points that lie on it.
    median, spread, within : float
        Median, robust standard deviation (1.48 times the median distance from it), and what 95 % of the absolute
        deviations do not exceed.
    share_within : float or None
        Share of its points within the tolerance; None where none was given.
    outcome : {"pass", "fail", "undecided"} or None
        The decision on it; None where no tolerance was given.
    low, high : float
        Signed deviations allowed on it; infinite where no tolerance was given.
    """

    number: int
    name: str
    centre: FloatArray
    points: int
    median: float
    spread: float
    within: float
    share_within: float | None = None
    outcome: Outcome | None = None
    low: float = -np.inf
    high: float = np.inf


@dataclasses.dataclass(frozen=True, eq=False)
class Cut:
    """How the counted points of a scan fall into regions."""

    labels: IntArray  # (m,): Number of the region of each counted point
    areas: FloatArray | None  # Area of each region, where regions are faces of the part
    how: str  # In words
    of_triangle: IntArray | None = None  # Number of the face of each triangle, where regions are faces of the part


def cut_of(deviations: Deviations, *, by_face: bool = False) -> Cut:
    """The regions of a part's scan: its faces, or eight boxes where it has too many (unless asked for) or none."""
    target, on = deviations.target, np.flatnonzero(deviations.counted)
    if isinstance(target, Mesh):
        count, of_face = faces_of(target)
        if count <= MOST_FACES or by_face:
            return Cut(of_face[deviations.faces[on]], areas_of(target, of_face), FACES, of_face)
    middle = target.centre if isinstance(target, Mesh) else np.zeros(3)
    if isinstance(target, PointCloud):
        middle = 0.5 * np.add(*bounds(target.points))
    boxes = (deviations.points[on] - deviations.origin > middle) @ np.array([1, 2, 4])
    return Cut(boxes.astype(np.int64), None, BOXES)


def require_faces(deviations: Deviations, numbers: Sequence[int]) -> None:
    """`InputError` where the part has none of those faces."""
    if not isinstance(deviations.target, Mesh):
        raise InputError("tolerances of faces need a mesh as the target: a cloud has no faces")
    count = faces_of(deviations.target)[0]
    for number in numbers:
        if not 0 <= number < count:
            raise InputError(f"the part has no face {number}; its faces are 0 to {count - 1}")


def regions_of(deviations: Deviations, cut: Cut) -> tuple[Region, ...]:
    """Scanned regions, the one with the most scan points first."""
    on = np.flatnonzero(deviations.counted)
    # Positions near the origin, where a mean keeps its digits.
    points, normals = deviations.points[on] - deviations.origin, deviations.normals(on)
    counts = np.bincount(cut.labels) if len(cut.labels) else np.zeros(0, dtype=np.int64)
    known = counts >= MIN_REGION_POINTS
    if cut.areas is not None and known.any():
        density = counts / np.maximum(cut.areas[: len(counts)], np.finfo(float).tiny)
        known &= density >= MIN_DENSITY_RATIO * weighted_median(density[known], counts[known])
    biggest = np.argsort(-counts, kind="stable")
    regions = []
    for number in biggest[known[biggest]]:
        rows = cut.labels == number
        centre = points[rows].mean(axis=0)
        name = _box_name(int(number)) if cut.areas is None else _face_name(normals[rows])
        regions.append(_region(int(number), deviations.values[on[rows]], name, centre))
    return tuple(regions)


def edge_places(mesh: Mesh, of_triangle: IntArray, step: float) -> tuple[FloatArray, float]:
    """Places along all sides at which two faces of the part meet or one ends, and their distance. Shapes: (m, 3)."""
    sides = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    across = mesh.face_neighbours
    own = np.repeat(np.arange(len(mesh.faces)), 3)
    other = across.reshape(-1)
    border = (of_triangle[own] != of_triangle[other]) | (own == other)
    ends = mesh.vertices[sides[border]]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    step = max(step, float(lengths.sum()) / MOST_PLACES)
    counts = np.maximum(np.ceil(lengths / step).astype(np.int64), 1)
    side = np.repeat(np.arange(len(ends)), counts)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[side]
    return ends[side, 0] + share[:, None] * (ends[side, 1] - ends[side, 0]), step


def _region(number: int, values: FloatArray, name: str, centre: FloatArray) -> Region:
    return Region(
        number=number,
        name=name,
        centre=centre,
        points=len(values),
        median=float(np.median(values)),
        # Strays near a face are not the face's: half the points may be any without moving these two much.
        spread=scatter_of(values),
        within=float(np.quantile(np.abs(values), 0.95)),
    )


def _face_name(normals: FloatArray) -> str:
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < FLAT_RESULTANT_LENGTH:
        return "curved face"
    x, y, z = np.where(np.abs(mean / length) < 0.005, 0.0, mean / length)
    for sign, end in ((1.0, "+"), (-1.0, "−")):
        for axis, value in zip("xyz", (x, y, z), strict=True):
            if sign * value > 0.9999:
                return f"flat face towards {end}{axis}"
    return f"flat face towards ({x:.2f}, {y:.2f}, {z:.2f})"


def _box_name(number: int) -> str:
    return ", ".join(f"{axis} {'high' if number >> bit & 1 else 'low'}" for bit, axis in enumerate("xyz"))

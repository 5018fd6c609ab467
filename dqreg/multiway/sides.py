"""From which side each scan saw its surfaces, and pairs whose pose lays one side of a sheet on the other.

Normals of a scan without a viewpoint have no sign, so that front and back of a thin sheet fit each other as well as two
looks at the front. What was seen at once was seen from one side.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface, PointCloud, Scan
from dqreg.geometry.normals import orient_towards
from dqreg.multiway.edges import PART, Edge
from dqreg.multiway.planes import Body
from dqreg.multiway.scans import View
from dqreg.rigid import pose
from dqreg.trust.doubts import LOOKED_THROUGH
from dqreg.trust.free_space import BEHIND, Seen, looked_through

# Directions that are tried, points of a scan that are looked at, and scans of a turntable that are.
DIRECTIONS, POINTS, LOOKED_AT = 150, 3_000, 12
# Edge of a pixel in spacings; a point is behind another that is so many pixels nearer.
PIXEL, STEP = 2.0, 4.0
# Cosine below which a face is seen at a grazing angle.
GRAZING = 0.1
# Distance of a likely viewpoint in sizes of the scan.
FAR = 3.0
# Matches are of one place within so many spacings, and so many scales of noise along the normal.
NEAR, THICK, ALIKE = 2.0, 4.0, 0.8
# Share of opposite sides, and matches, from which a pair is wrong; and overlap from which it is looked at.
OPPOSED, FEWEST, OVERLAP = 0.3, 50, 0.08
# Cells of free space in spacings.
GAPS = 4.0


@dataclasses.dataclass(frozen=True)
class Eye:
    """Where a scanner stood, in the centred frame of its scan."""

    place: FloatArray  # (3,)
    certain: bool  # Given: else a direction alone, forwards or backwards for all scans


def eyes_of(views: Sequence[View], order: str) -> tuple[Eye | None, ...]:
    """Where each scan was taken from; None where nothing tells.

    On a turntable the scanner stands still, and all scans are in its frame: one direction from which no point hides
    another serves all of them. Its sign is open, and the same for all, which is enough to compare sides.
    """
    eyes = [_given(view) for view in views]
    usable = [k for k, view in enumerate(views) if view.usable]
    if order == "turntable" and all(eyes[k] is None for k in usable):
        sight = _line_of_sight([views[k] for k in usable[:: max(1, len(usable) // LOOKED_AT)]])
        if sight is not None:
            for k in usable:
                scan = views[k].scan
                eyes[k] = Eye(scan.points.mean(axis=0) + FAR * scan.diagonal * sight, certain=False)
    return tuple(eyes)


def _given(view: View) -> Eye | None:
    place = None if view.cloud is None or not view.usable else view.cloud.viewpoint
    return None if place is None else Eye(place - view.origin, certain=True)


def _line_of_sight(views: Sequence[View]) -> FloatArray | None:
    """Direction from which no point of any scan hides another and few faces are seen at a grazing angle."""
    k = np.arange(DIRECTIONS) + 0.5
    height, turn = 1.0 - k / DIRECTIONS, k * np.pi * (1.0 + 5.0**0.5)
    flat = np.sqrt(1.0 - height**2)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    hidden = np.array([np.mean([_hidden(view.scan, d) for view in views], axis=0) for d in directions])
    best = int(hidden.sum(axis=1).argmin())
    return directions[best] if hidden[best, 0] <= BEHIND else None


def _hidden(scan: Scan, direction: FloatArray) -> tuple[float, float]:
    """Shares of the points behind others, and on faces seen at a grazing angle."""
    points, normals = _some(scan.points), _some(scan.normals)
    across = np.linalg.svd(direction[None])[2][1:]
    pixel = PIXEL * scan.spacing * np.sqrt(len(scan.points) / len(points))
    cells = np.floor(points @ across.T / pixel).astype(np.int64)
    cells -= cells.min(axis=0)
    rows = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    depth = points @ direction
    nearest = np.full(int(rows.max()) + 1, -np.inf)
    np.maximum.at(nearest, rows, depth)
    return (
        float(np.mean(nearest[rows] - depth > STEP * pixel)),
        float(np.mean(np.abs(normals @ direction) < GRAZING)),
    )


def body_of(view: View, eye: Eye | None) -> Body:
    """A scan for the joint cost, with normals of known sign where it is known from where it was taken."""
    if eye is None or view.scan.oriented or view.surface.oriented:
        return Body(view.scan, view.surface, view.origin)
    scan = dataclasses.replace(
        view.scan, normals=orient_towards(view.scan.normals, view.scan.points, eye.place), oriented=True
    )
    assert view.cloud is not None
    cloud = PointCloud(view.cloud.points - view.origin, viewpoint=eye.place)
    return Body(scan, CloudSurface(cloud, view.surface.fitted), view.origin)


@dataclasses.dataclass(frozen=True)
class Sides:
    """All scans with what is known of the sides that they saw."""

    views: Sequence[View]
    bodies: tuple[Body | None, ...]  # None for scans that cannot be used
    known: dict[tuple[int, int, bytes], float] = dataclasses.field(default_factory=dict)

    @staticmethod
    def of(views: Sequence[View], order: str) -> Sides:
        """Scans of a known order."""
        eyes = eyes_of(views, order)
        bodies = [body_of(view, eye) if view.usable else None for view, eye in zip(views, eyes, strict=True)]
        return Sides(views, tuple(bodies))

    def checked(self, edges: Sequence[Edge]) -> list[Edge]:
        """The edges, with those marked that lay one side of a sheet on the other."""
        return [
            dataclasses.replace(edge, code="opposite_sides")
            if edge.found and edge.target != PART and self._wrong(edge)
            else edge
            for edge in edges
        ]

    def _wrong(self, edge: Edge) -> bool:
        T = edge.registration.T_target_source
        key = edge.target, edge.source, T.tobytes()
        if key not in self.known:
            self.known[key] = self.opposed(edge.target, edge.source, T)
        return self.known[key] > OPPOSED

    def opposed(self, i: int, j: int, T_i_j: FloatArray) -> float:
        """`opposed` of two scans at a pose between their own frames."""
        a, b = self.bodies[i], self.bodies[j]
        if a is None or b is None:
            return np.nan
        shift = pose.from_parts(np.eye(3), -a.origin)
        return opposed(a, b, shift @ T_i_j @ pose.from_parts(np.eye(3), b.origin))

    def contradictions(self, T_world_scan: FloatArray, overlap: FloatArray) -> Iterator[Contradiction]:
        """Pairs of placed scans that overlap, and that their sides or lines of sight contradict."""
        for i, j in np.argwhere(np.triu(np.nan_to_num(overlap), 1) >= OVERLAP).tolist():
            if self.bodies[i] is None or self.bodies[j] is None:
                continue
            T = pose.inverse(T_world_scan[i]) @ T_world_scan[j]
            if self.opposed(i, j, T) > OPPOSED:
                yield Contradiction("opposite_sides", i, j)
            elif seen_through(self.views[i], self.views[j], T) > LOOKED_THROUGH:
                yield Contradiction("looked_through", i, j)


@dataclasses.dataclass(frozen=True)
class Contradiction:
    """Two scans that cannot stand as they were placed."""

    code: Literal["opposite_sides", "looked_through"]
    target: int
    source: int


def opposed(a: Body, b: Body, T_a_b: FloatArray) -> float:
    """Share of the places matched at a pose that one scan saw from one side and the other from the other one.

    Sides that are a sheet apart do not match; NaN where signs are not known, or little matches. Poses are of the
    centred frames.
    """
    if a.scan is None or b.scan is None or not (a.scan.oriented and b.scan.oriented and a.surface.oriented):
        return np.nan
    points, normals = _some(b.scan.points), _some(b.scan.normals)
    moved = pose.apply(T_a_b, points)
    found = a.surface.closest(moved)
    cosines = np.einsum("ij,ij->i", normals @ T_a_b[:3, :3].T, found.normals)
    along = np.abs(np.einsum("ij,ij->i", moved - found.points, found.normals))
    noise = max(a.scan.noise, b.scan.noise, a.noise_floor)
    near = (found.distances <= NEAR * max(a.scan.spacing, b.scan.spacing)) & (along <= THICK * noise)
    alike = near & (np.abs(cosines) >= ALIKE)
    return float(np.mean(cosines[alike] < 0.0)) if np.count_nonzero(alike) >= FEWEST else np.nan


def seen_through(a: View, b: View, T_a_b: FloatArray) -> float:
    """Share of the points of two scans that stand where the other one's scanner looked through.

    NaN where no viewpoint was given: an origin that could be one is none on a turntable.
    """
    if a.cloud is None or b.cloud is None or (a.cloud.viewpoint is None and b.cloud.viewpoint is None):
        return np.nan
    clouds = a.cloud, b.cloud
    sides = [Seen(_some(cloud.points), cloud.viewpoint, np.zeros(3)) for cloud in clouds]
    thinned = float(np.sqrt(max(1.0, *(len(cloud.points) / POINTS for cloud in clouds))))
    return looked_through(sides[1], sides[0], T_a_b, GAPS * thinned * max(a.scan.spacing, b.scan.spacing))


def _some(rows: FloatArray) -> FloatArray:
    some: FloatArray = rows[:: max(1, len(rows) // POINTS)]
    return some

"""Which way the scan looks: a point of a thin wall is of the side that looks there, not of the nearest one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.surface import Closest, Surface
from dqreg.geometry.vector_rows import row_dots

# A face looks away from a normal beyond 120 degrees, and the same way within 60: between them are the rims of walls,
# about which normals of few points say little.
NORMAL_AWAY, NORMAL_ALIKE = -0.5, 0.5
# A face that is seen at a slant may look a little away from the sensor where the part is bent.
SIGHT_AWAY, SIGHT_ALIKE = -0.17, 0.0
# Where a larger share looks away, normals are inside out or of random signs, and the scan is of more views than the one
# that is known.
MAX_AWAY_NORMALS, MAX_AWAY_SIGHTS = 0.25, 0.1
# Points that are asked for that share.
MAX_ASKED_POINTS = 2_000

# Unit directions to which the surface looks at some rows of the scan, whose points are given; 0 where none is known.
Directions = Callable[[IntArray, FloatArray], FloatArray]


@dataclasses.dataclass(frozen=True)
class Facing:
    """Which way the surface looks at each point of a scan."""

    directions: Directions
    away: float  # Cosine below which a face is none that the point may be of
    alike: float  # Cosine above which a face is one that it may be of
    most: float = 1.0  # Share of the points at which the closest face may look away

    @staticmethod
    def by_normals(normals: FloatArray, R: FloatArray) -> Facing:
        """By oriented normals of the scan, (n, 3), rotated."""
        # Rows by a transposed view take twice as long.
        turned = np.ascontiguousarray(R.T)
        return Facing(
            lambda rows, _: np.take(normals, rows, axis=0) @ turned, NORMAL_AWAY, NORMAL_ALIKE, MAX_AWAY_NORMALS
        )

    @staticmethod
    def by_sight(viewpoint: FloatArray) -> Facing:
        """By the one place that all points were seen from, in the target's frame."""

        def directions(_: IntArray, points: FloatArray) -> FloatArray:
            lines = viewpoint - points
            lengths = np.linalg.norm(lines, axis=1, keepdims=True)
            return np.asarray(lines / np.maximum(lengths, np.finfo(float).tiny))

        return Facing(directions, SIGHT_AWAY, SIGHT_ALIKE, MAX_AWAY_SIGHTS)

    @staticmethod
    def as_before(normals: Callable[[IntArray], FloatArray]) -> Facing:
        """By the outward normals of the faces that some rows were found on under another pose."""
        return Facing(lambda rows, _: normals(rows), NORMAL_AWAY, NORMAL_ALIKE)

    def holds(self, points: FloatArray, surface: Surface, outside: float) -> bool:
        """Whether few enough of the points look away from what is closest to them."""
        rows = np.linspace(0, len(points) - 1, min(len(points), MAX_ASKED_POINTS)).astype(np.int64)
        some = np.take(points, rows, axis=0)
        cosines = outside * row_dots(surface.closest(some).normals, self.directions(rows, some))
        return bool(np.count_nonzero(cosines < self.away) <= self.most * len(rows))

    def closest(
        self, points: FloatArray, rows: IntArray, surface: Surface, outside: float = 1.0, within: float = np.inf
    ) -> Closest:
        """Closest places on faces that look the same way; the closest of all where there is none within a distance.

        ``rows`` are those of the points in the scan, ``outside`` is -1 where faces look inwards.
        """
        found = surface.closest(points)
        looks = self.directions(rows, points)
        away = np.flatnonzero(outside * row_dots(found.normals, looks) < self.away)
        if not len(away) or not isinstance(surface, MeshSurface):
            return found
        asked = np.take(points, away, axis=0), outside * np.take(looks, away, axis=0)
        places, distances, faces = surface._closest_facing(*asked, self.alike, within)
        held = faces >= 0
        away, faces = away[held], faces[held]
        found.points[away], found.distances[away], found.elements[away] = places[held], distances[held], faces
        found.normals[away] = surface.mesh.face_normals[faces]
        return found


def closest_as_before(points: FloatArray, surface: MeshSurface, normals: FloatArray) -> Closest:
    """Closest places of points that were found on faces of these normals before they were moved, (n, 3) both."""
    return Facing.as_before(lambda rows: normals[rows]).closest(points, np.arange(len(points)), surface)

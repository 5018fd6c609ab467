"""What two clouds show in some planes: faces, where these end, and where one of them has a hole."""

from __future__ import annotations

import dataclasses
import math
from functools import partial

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.threads import Later, all_results, unlocked_property
from dqreg.trust.closed_holes import Asked, closed_hole
from dqreg.trust.face_rims import SAME_RIM_SPACINGS, SPACE_NEIGHBOURS, Faces, Held, Plane, Points, Rims, stand_near
from dqreg.trust.overlap import IndexedPoints

# Share of the neighbours of a point that lie in the plane with it: faces that cross the plane are no part of it.
IN_PLANE_SHARE = 0.9
# Distances, in spacings, beyond which a point has none of the other cloud beside it.
GAP_SPACINGS = 4.0
# Points in the planes without which nothing is said.
MIN_PLANE_POINTS = 100
# Points above which clouds are many, and so many of them are asked first: limits were set by clouds of 2,000 to 4,000.
MANY_POINTS, FIRST_POINTS = 20_000, 6_000


@dataclasses.dataclass(frozen=True, eq=False)
class Shown:
    """What a cloud shows in a plane."""

    faces: Faces
    held: Held | None  # None for few points


@dataclasses.dataclass(frozen=True, eq=False)
class ShownPlanes:
    """Some planes, and both clouds at a pose."""

    planes: tuple[Plane, ...]
    within: float  # Distance from a plane within which a point lies in it
    sides: tuple[Points, Points]  # The source at the pose, the target
    clouds: tuple[IndexedPoints, IndexedPoints]  # Both, each in its own frame

    @unlocked_property
    def spacing(self) -> float:
        """Distance of neighbouring points, of the sparser side."""
        return max(cloud.spacing for cloud in self.clouds)

    @property
    def sparser(self) -> int:
        """Which side has fewer points."""
        return int(len(self.sides[1][0]) < len(self.sides[0][0]))

    @property
    def are_many(self) -> bool:
        """Whether some of the points are asked first."""
        return max(len(points) for points, _ in self.sides) > MANY_POINTS

    @unlocked_property
    def some(self) -> ShownPlanes:
        """The same with some of the points of both clouds, each of which knows its neighbours; itself of few."""
        if not self.are_many:
            return self
        (one, move), (other, stand) = all_results(self._thinned)
        return ShownPlanes(self.planes, self.within, (one, other), (move, stand))

    def begin(self) -> None:
        """Make that beside the caller, who takes over what is left of it."""
        if self.are_many:
            _ = self._thinned

    @unlocked_property
    def _thinned(self) -> list[Later[tuple[Points, IndexedPoints]]]:
        both = zip(self.sides, self.clouds, strict=True)
        return [Later(partial(_thinned, side[0], cloud)) for side, cloud in both]

    @unlocked_property
    def heights(self) -> tuple[FloatArray, FloatArray]:
        """Heights of all points of either cloud over each of the planes, (k, n): at once, each would take as long."""
        normals = np.array([plane.normal for plane in self.planes])
        offsets = np.einsum("ij,ij->i", normals, [plane.middle for plane in self.planes])[:, None]
        one, other = (product(normals, points.T) - offsets for points, _ in self.sides)
        return one, other

    @unlocked_property
    def shown(self) -> list[tuple[Shown, Shown]]:
        """What either cloud shows in each of the planes."""
        # Many small steps, here and below: two threads that take turns at them take as long, and more of both cores.
        found = []
        for k, plane in enumerate(self.planes):
            both = []
            for (points, tree), heights in zip(self.sides, self.heights, strict=True):
                faces = Faces.of(tree, heights[k], self.within)
                both.append(Shown(faces, Held.of(points, faces, plane, self.within)))
            found.append((both[0], both[1]))
        return found

    @unlocked_property
    def rims(self) -> list[tuple[Rims | None, Rims | None]]:
        """Rims of either cloud's faces in each of the planes."""

        def rims(held: Held | None) -> Rims | None:
            return None if held is None else held.rims(self.planes)

        return [(rims(one.held), rims(other.held)) for one, other in self.shown]

    def rims_beside(self, most: int, *, rest: bool = False) -> list[tuple[int, Rims, Rims]]:
        """Rims of the sparser cloud, of so many points of its faces, and those of the other beside them; by planes.

        The rest is of all of its other points.
        """
        first = self.sparser
        held = [(k, shown[first].held, shown[1 - first].held) for k, shown in enumerate(self.shown)]
        both = [(k, one, other) for k, one, other in held if one is not None and other is not None]
        step = math.ceil(sum(len(one.rows) for _, one, _ in both) / most)

        found = []
        for k, one, other in both:
            # Along a curve: every so manieth is an even sample.
            is_asked = (np.arange(len(one.rows)) % step == 0) != rest
            rims = one.rims(self.planes, np.flatnonzero(is_asked))
            near = other.near(rims.points, SAME_RIM_SPACINGS * max(one.spacing, other.spacing))
            found.append((k, rims, other.rims(self.planes, near)))
        return found

    def hole(self, asked: Asked) -> float:
        """Diameter of the largest hole of either cloud in a plane that the other's faces close; 0 for none."""
        (one, _), (other, _) = self.sides
        held = [(here.held, there.held) for here, there in self.shown]
        both = [(here, there) for here, there in held if here is not None and there is not None]
        return max(
            (max(closed_hole(here, there, other, asked), closed_hole(there, here, one, asked)) for here, there in both),
            default=0.0,
        )

    def beyond(self, side: int) -> float:
        """Share of a cloud's faces in the planes that has no point of the other one beside it; NaN for few points."""
        (points, _), (others, _) = self.sides[side], self.sides[1 - side]
        faces = [(shown[side].faces, shown[1 - side].faces) for shown in self.shown]
        inside, beyond = np.sum([_beyond(points, *each, others, GAP_SPACINGS * self.spacing) for each in faces], axis=0)
        return float(beyond / inside) if inside >= MIN_PLANE_POINTS else np.nan


def _thinned(points: FloatArray, cloud: IndexedPoints) -> tuple[Points, IndexedPoints]:
    """Some points of a cloud at the pose, and of itself; each is asked for the neighbours of all."""
    rows = sample_rows(len(points), FIRST_POINTS)
    own = np.take(cloud.points, rows, axis=0)
    tree = NeighbourTree(own, in_order=True)
    tree.remember(tree.nearest_to(np.arange(len(own)), SPACE_NEIGHBOURS)[0])
    return (np.take(points, rows, axis=0), tree), IndexedPoints(own, tree)


def _beyond(points: FloatArray, faces: Faces, theirs: Faces, others: FloatArray, gap: float) -> tuple[int, int]:
    """Points of a cloud's faces in a plane, and those without one of the other's within a gap; none for no faces."""
    rows = faces.flat(IN_PLANE_SHARE)
    if not len(rows) or not len(theirs.rows):
        return 0, 0
    return len(rows), int(
        np.count_nonzero(~stand_near(points, rows, others, theirs.rows, float(np.nextafter(gap, np.inf))))
    )

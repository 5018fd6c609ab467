"""Planes that two clouds have in common: where the faces in them end, and to which side they turn there."""

from __future__ import annotations

import dataclasses
from functools import cached_property, partial

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, product
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.threads import Later, all_results
from dqreg.rigid import pose
from dqreg.trust.face_rims import (
    Faces,
    Plane,
    Points,
    Rims,
    closed_hole,
    rims_in,
    shared_along,
    shared_rims,
)
from dqreg.trust.opposed_edges import Opposed, opposed_share, stand_near
from dqreg.trust.overlap import IndexedPoints, Overlap

# Planes of a corner, which fix a pose and leave nothing to check it by; most planes that are found, of which a corner
# may have some more by chance or beside a face's edges; the share of the common places that they hold, and the share
# below which a plane is none; places that are tried as one of it.
CORNER, PLANES, ALL, LEAST_SHARE, TRIED = 3, 6, 0.95, 0.02, 30
# A plane: normals within this angle, and distances within this share of the size, or so many times the noise.
SAME_COS, WITHIN, NOISY = np.cos(np.deg2rad(8.0)), 5e-3, 3.0
# Places look the same way within this angle; a plane that holds less of them than this is no wall: on a figure, where
# planes are chance, they came to 0.11 at most, in streets and rooms to 0.26 and more.
ALIKE_COS, LEAST_ALIKE = np.cos(np.deg2rad(30.0)), 0.125
# Share of the neighbours of a point that lie in the plane with it: faces that cross the plane are no part of it.
# Distances, in spacings, beyond which a point has none of the other cloud beside it; points in the planes without which
# nothing is said.
FLAT, GAP, FEWEST = 0.9, 4.0, 100
# Slides that are tried, in sizes; a plane that leans on the others by more of its normal than this is slid along none.
REACH, LEANING = 0.06, 0.2


@dataclasses.dataclass(frozen=True, eq=False)
class CommonPlanes:
    """The planes that two clouds have in common, and both clouds at the pose.

    The corner of any part fits the corner of any other: three planes fix a pose and leave nothing to check it by but
    where the faces in them end.
    """

    planes: tuple[Plane, ...]
    shares: tuple[float, ...]  # Of the common places, that each of them holds and none before it
    alike: tuple[float, ...]  # Of those that look the same way as each, that it and those beside it hold
    within: float  # Distance from a plane within which a point lies in it
    sides: tuple[Points, Points]  # The source at the pose, the target
    clouds: tuple[IndexedPoints, IndexedPoints]  # Both, each in its own frame

    @staticmethod
    def of(
        overlap: Overlap, moves: IndexedPoints, stands: IndexedPoints, T_target_source: FloatArray, size: float
    ) -> CommonPlanes | None:
        """Of two clouds of a size at a pose, (4, 4); None where they have no plane in common."""
        within = max(WITHIN * size, NOISY * float(np.median(overlap.noise)))
        planes, shares = _planes(overlap, within)
        if not planes:
            return None
        placed = pose.apply(T_target_source, moves.points)
        sides = (placed, moves.tree), (stands.points, stands.tree)
        return CommonPlanes(planes, shares, _alike(overlap, planes, shares), within, sides, (moves, stands))

    @cached_property
    def spacing(self) -> float:
        """Distance of neighbouring points, of the sparser side."""
        return max(cloud.spacing for cloud in self.clouds)

    @property
    def are_all(self) -> bool:
        """Whether they hold all that the clouds have in common."""
        return sum(self.shares) >= ALL

    @property
    def are_a_corner(self) -> bool:
        """Whether they are three at most, and hold all that the clouds have in common."""
        return len(self.planes) <= CORNER and self.are_all

    @property
    def largest(self) -> float:
        """Share of the common places that the largest of them holds."""
        return max(self.shares)

    def opposed_edges(self) -> float:
        """Share of the rims in both clouds beside which faces turn to opposite sides, of the plane with most of it.

        Both sides of a wall laid on each other are one plane; the faces beside them tell that it is not one face. NaN
        for few such rims. Asked where a plane holds what looks its way: a pose that is off by the width of a wall would
        leave all else there apart.
        """
        return opposed_share(all_results(self._opposed))

    def begin(self) -> None:
        """Make what `opposed_edges` asks of each plane beside the caller, who takes over what is left of it."""
        _ = self._opposed

    def closed_hole(self) -> float:
        """Diameter of the largest hole in a face of either cloud that the other one's face closes; 0 for none."""
        return max(self._holes)

    def ends_apart(self) -> float:
        """Share of the faces in the planes that reach beyond the other cloud, of that of two which has less of it.

        What one view alone shows of a face may be hidden from the other; that each shows what the other does not is
        another part. NaN for few points.
        """
        return float(np.minimum(self._beyond(0), self._beyond(1)))

    def rims_shared(self) -> float:
        """Share of the rims of faces that are where the other's faces have one, of the cloud that has more of them.

        Where two planes meet their faces end together, whatever the part: those rims are left out. NaN for few rims.
        """
        one, other = self._rims()
        return float(np.fmax(shared_rims(one, other), shared_rims(other, one)))

    def rims_elsewhere(self, size: float) -> tuple[float, float]:
        """What more of the rims would be shared after a slide of clouds of a size, and how far that is; zeros for none.

        The slide is the one that a plane forbids, by the rims in the other planes: both sides of a thin wall laid on
        each other are one plane, and the rims of the faces beside it tell that it is not one face.
        """
        found = (0.0, 0.0)
        normals = np.array([plane.normal for plane in self.planes])
        for k, normal in enumerate(normals):
            rest = np.delete(normals, k, axis=0)
            axis = normal - np.linalg.pinv(rest) @ (rest @ normal) if len(rest) else normal
            if not len(rest) or np.linalg.norm(axis) < LEANING:
                continue
            one, other = self._rims(but=k)
            slides, shares = shared_along(one, other, axis / np.linalg.norm(axis), REACH * size)
            gained = np.nan_to_num(shares - shares[len(shares) // 2])
            best = int(gained.argmax())
            found = max(found, (float(gained[best]), abs(float(slides[best]))))
        return found

    def _rims(self, but: int | None = None) -> tuple[list[Rims | None], list[Rims | None]]:
        """Rims of either cloud's faces in the planes but one."""
        shown = [each for k, each in enumerate(self._shown) if k != but]
        return [here.rims for here, _ in shown], [there.rims for _, there in shown]

    @cached_property
    def _opposed(self) -> list[Later[Opposed | None]]:
        """Opposed rims, plane by plane."""
        heights = self._heights

        def opposed(k: int) -> Opposed | None:
            one, other = heights.result()
            return Opposed.of(self.sides, (one[k], other[k]), self.planes[k], self.within)

        told = (k for k, alike in enumerate(self.alike) if alike >= LEAST_ALIKE)
        return [Later(partial(opposed, k)) for k in told]

    @cached_property
    def _heights(self) -> Later[tuple[FloatArray, FloatArray]]:
        """Heights of all points of either cloud over each of the planes, (k, n): at once, each would take as long."""
        normals = np.array([plane.normal for plane in self.planes])
        offsets = np.einsum("ij,ij->i", normals, [plane.middle for plane in self.planes])[:, None]

        def heights() -> tuple[FloatArray, FloatArray]:
            one, other = (product(normals, points.T) - offsets for points, _ in self.sides)
            return one, other

        return Later(heights)

    @cached_property
    def _shown(self) -> list[tuple[Shown, Shown]]:
        """What either cloud shows in each of the planes."""

        def shown(k: int, side: int) -> Shown:
            points, tree = self.sides[side]
            faces = Faces.of(tree, self._heights.result()[side][k], self.within)
            return Shown(faces, rims_in(points, faces, self.planes[k], self.planes, self.within))

        found = all_results([Later(partial(shown, k, side)) for k in range(len(self.planes)) for side in (0, 1)])
        return list(zip(found[::2], found[1::2], strict=True))

    @cached_property
    def _holes(self) -> list[float]:
        """Holes of either cloud in each of the planes that the other's faces close, see `closed_hole`."""
        (one, _), (other, _) = self.sides

        def hole(plane: Plane, here: Shown, there: Shown, others: FloatArray) -> float:
            if here.rims is None or there.rims is None:
                return 0.0
            return closed_hole(here.rims, there.rims, others, plane, self.within)

        asked = []
        for plane, (here, there) in zip(self.planes, self._shown, strict=True):
            asked += [Later(partial(hole, plane, here, there, other))]
            asked += [Later(partial(hole, plane, there, here, one))]
        return all_results(asked)

    def _beyond(self, side: int) -> float:
        """Share of a cloud's faces in the planes that has no point of the other one beside it; NaN for few points."""
        (points, _), (others, _) = self.sides[side], self.sides[1 - side]
        faces = [(shown[side].faces, shown[1 - side].faces) for shown in self._shown]
        found = all_results([Later(partial(_beyond, points, *each, others, GAP * self.spacing)) for each in faces])
        inside, beyond = np.sum(found, axis=0)
        return float(beyond / inside) if inside >= FEWEST else np.nan


@dataclasses.dataclass(frozen=True, eq=False)
class Shown:
    """What a cloud shows in a plane."""

    faces: Faces
    rims: Rims | None


def _beyond(points: FloatArray, faces: Faces, theirs: Faces, others: FloatArray, gap: float) -> tuple[int, int]:
    """Points of a cloud's faces in a plane, and those without one of the other's within a gap; none for no faces."""
    rows = faces.flat(FLAT)
    if not len(rows) or not len(theirs.rows):
        return 0, 0
    return len(rows), int(
        np.count_nonzero(~stand_near(points, rows, others, theirs.rows, float(np.nextafter(gap, np.inf))))
    )


def _planes(overlap: Overlap, within: float) -> tuple[tuple[Plane, ...], tuple[float, ...]]:
    """Planes that hold the common places, the fullest first, and the share that each of them holds."""
    left = np.ones(len(overlap.points), dtype=bool)
    planes: list[Plane] = []
    shares: list[float] = []
    for k in range(PLANES):
        rows = np.flatnonzero(left)
        if len(rows) < LEAST_SHARE * len(left) or (k >= CORNER and sum(shares) >= ALL):
            break
        held = _fullest(overlap, rows[sample_rows(len(rows), TRIED)], left, within)
        points = overlap.points[held]
        middle = points.mean(axis=0)
        planes.append(Plane(middle, np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]))
        shares.append(float(np.mean(held)))
        left &= ~held
    return tuple(planes), tuple(shares)


def _alike(overlap: Overlap, planes: tuple[Plane, ...], shares: tuple[float, ...]) -> tuple[float, ...]:
    """Share of the places that look the same way as each of the planes, held by it and those parallel to it."""
    normals = np.array([plane.normal for plane in planes])
    looking = np.mean(np.abs(product(normals, overlap.normals.T)) > ALIKE_COS, axis=1)
    held = (np.abs(normals @ normals.T) > SAME_COS) @ np.array(shares)
    return tuple((held / np.maximum(looking, held)).tolist())


def _fullest(overlap: Overlap, tried: IntArray, left: BoolArray, within: float) -> BoolArray:
    """Which places, (n,), of those left lie in the plane of one of some, of that in which most do."""
    normals = overlap.normals[tried]
    offsets = np.einsum("ij,ij->i", overlap.points[tried], normals)[:, None]
    held = left & (np.abs(product(normals, overlap.points.T) - offsets) < within)
    held &= np.abs(product(normals, overlap.normals.T)) > SAME_COS
    fullest: BoolArray = held[np.count_nonzero(held, axis=1).argmax()]
    return fullest

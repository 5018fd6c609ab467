"""Planes that two clouds have in common: where the faces in them end, and to which side they turn there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median, product
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.threads import unlocked_property
from dqreg.rigid import pose
from dqreg.trust.closed_holes import CLOSED, PERHAPS_CLOSED
from dqreg.trust.face_rims import (
    MIN_RIM_POINTS,
    SAME_RIM_SPACINGS,
    Plane,
    Rims,
    shared_along,
    shared_count,
    shared_rims,
)
from dqreg.trust.limits import CLOSED_HOLE_DIAGONALS, SHARED_RIM_SHARE_OF_MANY_PLANES
from dqreg.trust.opposed_edges import Opposed, opposed_share
from dqreg.trust.overlap import IndexedPoints, Overlap
from dqreg.trust.shown_planes import ShownPlanes
from dqreg.trust.turning_rims import CERTAIN_SIGMAS, Turning, shared_turning

# Planes of a corner, which fix a pose and leave nothing to check it by.
CORNER_PLANES = 3
# Most planes that are found: a corner may have some more by chance or beside a face's edges.
MAX_PLANES = 6
# Share of the common places that those planes hold.
COMMON_PLACE_SHARE = 0.95
# Share of the places below which a plane is none.
MIN_PLANE_SHARE = 0.02
# Places whose tangent plane is tried.
TRIED_PLACES = 30
# Normals of one plane are within this angle.
PLANE_NORMAL_COS = np.cos(np.deg2rad(8.0))
# Distances from one plane: within this share of the size, or so many times the noise.
PLANE_THICKNESS_DIAGONALS, PLANE_THICKNESS_SIGMAS = 5e-3, 3.0
# Places look the same way within this angle.
WALL_NORMAL_COS = np.cos(np.deg2rad(30.0))
# A plane that holds less of them than this is no wall: on a figure, where planes are chance, they came to 0.11 at most,
# in streets and rooms to 0.26 and more.
MIN_WALL_SHARE = 0.125
# Points of the faces in more planes than a corner has of which it is asked first whether they are rims of both clouds.
FIRST_RIM_POINTS = 2_000
# Share of its limit below which a hole in them is none.
MIN_HOLE_RATIO = 0.5
# Slides that are tried, in sizes.
SLIDE_DIAGONALS = 0.06
# A plane that leans on the others by more of its normal than this is slid along none.
MAX_LEANING = 0.2


@dataclasses.dataclass(frozen=True, eq=False)
class CommonPlanes:
    """The planes that two clouds have in common, and both clouds at the pose.

    The corner of any part fits the corner of any other: three planes fix a pose and leave nothing to check it by but
    where the faces in them end.
    """

    shown: ShownPlanes
    shares: tuple[float, ...]  # Of the common places, that each of them holds and none before it
    alike: tuple[float, ...]  # Of those that look the same way as each, that it and those beside it hold

    @staticmethod
    def of(
        overlap: Overlap, moves: IndexedPoints, stands: IndexedPoints, T_target_source: FloatArray, size: float
    ) -> CommonPlanes | None:
        """Of two clouds of a size at a pose, (4, 4); None where they have no plane in common.

        Places apart by more than a plane is thick are of two: between them a plane would be one more than a corner has.
        """
        within = plane_thickness(overlap, size)
        overlap = overlap.at(np.abs(overlap.residuals) <= within)
        planes, shares = _planes(overlap, within)
        if not planes:
            return None
        placed = pose.apply(T_target_source, moves.points)
        sides = (placed, moves.tree), (stands.points, stands.tree)
        return CommonPlanes(
            ShownPlanes(planes, within, sides, (moves, stands)), shares, _alike(overlap, planes, shares)
        )

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The planes, that with most of the common places first."""
        return self.shown.planes

    @property
    def are_all(self) -> bool:
        """Whether they hold all that the clouds have in common."""
        return sum(self.shares) >= COMMON_PLACE_SHARE

    @property
    def are_a_corner(self) -> bool:
        """Whether they are three at most, and hold all that the clouds have in common."""
        return len(self.planes) <= CORNER_PLANES and self.are_all

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
        # Many small steps: two threads that take turns at them take longer than one.
        return opposed_share(self._opposed, [*self._hardly_opposed.values()])

    def begin(self) -> None:
        """Make some points of many, and the neighbours of each, beside the caller, where they will be asked for."""
        if self.are_all:
            self.shown.begin()

    def closed_hole(self, size: float) -> float:
        """Diameter of the largest hole in a face of either cloud that the other one's face closes; 0 for none.

        Where some of many points show none that is half as wide as clouds of a size may have, no more are asked.
        """
        if self.shown.are_many and self.shown.some.hole(PERHAPS_CLOSED) < MIN_HOLE_RATIO * CLOSED_HOLE_DIAGONALS * size:
            return 0.0
        return self.shown.hole(CLOSED)

    def ends_and_rims(self) -> tuple[float, float]:
        """What speaks of where faces end: see `ends_apart` and `rims_shared`.

        In more planes than a corner has the rims decide, and where enough of them are shared no ends are asked about.
        """
        if not self.are_a_corner:
            for rest in (False, True):
                shared, error = self.rims_of_one(rest=rest)
                if shared - CERTAIN_SIGMAS * error >= SHARED_RIM_SHARE_OF_MANY_PLANES:
                    return np.nan, shared
        return self.ends_apart(), self.rims_shared()

    def ends_apart(self) -> float:
        """Share of the faces in the planes that reach beyond the other cloud, of that of two which has less of it.

        What one view alone shows of a face may be hidden from the other; that each shows what the other does not is
        another part. NaN for few points.
        """
        return float(np.minimum(self.shown.beyond(0), self.shown.beyond(1)))

    def rims_shared(self) -> float:
        """Share of the rims of faces that are where the other's faces have one, of the cloud that has more of them.

        Where two planes meet their faces end together, whatever the part: those rims are left out. NaN for few rims.
        """
        one, other = self._rims()
        return float(np.fmax(shared_rims(one, other), shared_rims(other, one)))

    def rims_of_one(self, *, rest: bool) -> tuple[float, float]:
        """The same of the sparser cloud, and its standard error; of some points of its faces, or of the rest as well.

        The share of all is no smaller. It is a count where all points of both clouds are asked.
        """
        rims = self._known_rims + (self.shown.some.rims_beside(FIRST_RIM_POINTS, rest=True) if rest else [])
        count, shared = np.sum([shared_count(one, other) for _, one, other in rims], axis=0) if rims else (0, 0)
        if not count >= MIN_RIM_POINTS:
            return np.nan, np.nan
        found = float(shared / count)
        is_count = rest and not self.shown.are_many
        return found, 0.0 if is_count else math.sqrt(max(found * (1.0 - found), 1.0 / count) / count)

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
            if not len(rest) or np.linalg.norm(axis) < MAX_LEANING:
                continue
            one, other = self._rims(but=k)
            slides, shares = shared_along(one, other, axis / np.linalg.norm(axis), SLIDE_DIAGONALS * size)
            gained = np.nan_to_num(shares - shares[len(shares) // 2])
            best = int(gained.argmax())
            found = max(found, (float(gained[best]), abs(float(slides[best]))))
        return found

    def _rims(self, but: int | None = None) -> tuple[list[Rims | None], list[Rims | None]]:
        """Rims of either cloud's faces in the planes but one."""
        shown = [each for k, each in enumerate(self.shown.rims) if k != but]
        return [here for here, _ in shown], [there for _, there in shown]

    @property
    def _know_rims(self) -> bool:
        """Whether rims are asked for in any case, of all points that opposed edges are."""
        return self.are_all and not self.shown.are_many

    @unlocked_property
    def _known_rims(self) -> list[tuple[int, Rims, Rims]]:
        """Rims that are asked for in any case: of a corner all, else some of the sparser cloud; and the other's."""
        if not self.are_a_corner:
            return self.shown.some.rims_beside(FIRST_RIM_POINTS)
        first = self.shown.sparser
        both = [(k, pair[first], pair[1 - first]) for k, pair in enumerate(self.shown.rims)]
        return [(k, one, other) for k, one, other in both if one is not None and other is not None]

    @unlocked_property
    def _hardly_opposed(self) -> dict[int, float]:
        """Share of opposed rims in the planes where those that are known tell for certain that these are few."""
        if not self._know_rims:
            return {}
        shown, heights = self.shown, self.shown.heights
        sides, found = (shown.sparser, 1 - shown.sparser), {}
        for k, *both in self._known_rims:
            if self.alike[k] < MIN_WALL_SHARE:
                continue
            one, other = (
                Turning.of(rims.rows, rims.outward, shown.sides[side], heights[side][k], shown.within, rims.spacing)
                for side, rims in zip(sides, both, strict=True)
            )
            turning = shared_turning(one, other, SAME_RIM_SPACINGS * max(rims.spacing for rims in both))
            if turning.are_hardly_opposed:
                found[k] = turning.opposed
        return found

    @property
    def _opposed(self) -> list[Opposed | None]:
        """Opposed rims, plane by plane, where these are not known to be few."""
        one, other = self.shown.heights
        asked = [k for k, alike in enumerate(self.alike) if alike >= MIN_WALL_SHARE and k not in self._hardly_opposed]
        within = self.shown.within
        return [Opposed.of(self.shown.sides, (one[k], other[k]), self.planes[k], within) for k in asked]


def plane_thickness(overlap: Overlap, size: float) -> float:
    """Distance within which places of two clouds of a size lie in one plane."""
    return max(PLANE_THICKNESS_DIAGONALS * size, PLANE_THICKNESS_SIGMAS * median(overlap.noise))


def _planes(overlap: Overlap, within: float) -> tuple[tuple[Plane, ...], tuple[float, ...]]:
    """Planes that hold the common places, the fullest first, and the share that each of them holds."""
    left = np.ones(len(overlap.points), dtype=bool)
    planes: list[Plane] = []
    shares: list[float] = []
    least = max(MIN_PLANE_SHARE * len(left), 1)
    for k in range(MAX_PLANES):
        rows = np.flatnonzero(left)
        if len(rows) < least or (k >= CORNER_PLANES and sum(shares) >= COMMON_PLACE_SHARE):
            break
        held = fullest_plane(overlap, rows[sample_rows(len(rows), TRIED_PLACES)], left, within)
        points = overlap.points[held]
        middle = points.mean(axis=0)
        planes.append(Plane(middle, np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]))
        shares.append(float(np.mean(held)))
        left &= ~held
    return tuple(planes), tuple(shares)


def _alike(overlap: Overlap, planes: tuple[Plane, ...], shares: tuple[float, ...]) -> tuple[float, ...]:
    """Share of the places that look the same way as each of the planes, held by it and those parallel to it."""
    normals = np.array([plane.normal for plane in planes])
    looking = np.mean(np.abs(product(normals, overlap.normals.T)) > WALL_NORMAL_COS, axis=1)
    held = (np.abs(normals @ normals.T) > PLANE_NORMAL_COS) @ np.array(shares)
    return tuple((held / np.maximum(looking, held)).tolist())


def fullest_plane(overlap: Overlap, tried: IntArray, left: BoolArray, within: float) -> BoolArray:
    """Which places, (n,), of those left lie in the plane of one of some, of that in which most do."""
    normals = overlap.normals[tried]
    offsets = np.einsum("ij,ij->i", overlap.points[tried], normals)[:, None]
    held = left & (np.abs(product(normals, overlap.points.T) - offsets) < within)
    held &= np.abs(product(normals, overlap.normals.T)) > PLANE_NORMAL_COS
    fullest: BoolArray = held[np.count_nonzero(held, axis=1).argmax()]
    return fullest

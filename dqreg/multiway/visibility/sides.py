"""From which side each scan saw its surfaces, and pairs whose pose lays one side of a sheet on the other.

Normals of a scan without a viewpoint have no sign, so that front and back of a thin sheet fit each other as well as two
looks at the front. What was seen at once was seen from one side.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import CloudSurface, PointCloud
from dqreg.geometry.normals import orient_towards
from dqreg.multiway.pairwise.pairs import Order
from dqreg.multiway.pose_graph.edges import PART, Edge, EdgeCode
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.scans.overlap import MIN_OVERLAP
from dqreg.multiway.scans.scans import View, every_so_many
from dqreg.multiway.visibility.free_space import FreeSpace
from dqreg.multiway.visibility.passed_rays import PassedRays
from dqreg.multiway.visibility.viewpoints import Viewpoint, Viewpoints, common_viewpoints, given_viewpoints
from dqreg.rigid import pose
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE

# Matches are of one place within so many spacings, and so many scales of noise along the normal,
NEAR_SPACINGS, NEAR_NOISES = 2.0, 4.0
# at this cosine of the normals, whichever side they face.
MIN_NORMAL_COS = 0.8
# Share of opposite sides, and matches, from which a pair is wrong.
MAX_OPPOSITE_SHARE, MIN_MATCHES = 0.3, 50
# A line of sight that was found may be off by 30 degrees: faces seen at a smaller cosine may be of either side.
MIN_SIGHT_COS = 0.5
# Share of what was looked through from which a pair is wrong: a pose of a pair is a little off.
LOOKED_THROUGH_SHARE = 0.1
# Accepted pairs that tell whether a line of sight is right, at least and at most, and the share that must agree.
TELLING_PAIRS, MIN_FITTING_SHARE = (3, 60), 0.8
# Points of a scan that are looked at.
COMPARED_POINTS = 3_000


def body_of(view: View, viewpoint: Viewpoint | None) -> Body:
    """A scan for the joint cost, with normals of known sign where it is known from where it was taken."""
    if viewpoint is None or view.scan.oriented or view.surface.oriented:
        return Body(view.scan, view.surface, view.origin)
    scan = dataclasses.replace(
        view.scan, normals=orient_towards(view.scan.normals, view.scan.points, viewpoint.place), oriented=True
    )
    assert view.cloud is not None
    cloud = PointCloud(view.cloud.points - view.origin, viewpoint=viewpoint.place)
    return Body(scan, CloudSurface(cloud, view.surface.fitted, derived=True), view.origin)


def viewpoints_of(views: Sequence[View], order: Order, edges: Sequence[Edge] = ()) -> Viewpoints:
    """Where each scan was taken from; None where nothing tells.

    A line of sight that serves all scans is one where accepted pairs agree with it; on a turntable it is one in any
    case, with an open sign.
    """
    given = given_viewpoints(views)
    common = common_viewpoints(views)
    if common is None:
        return given
    sure = _sure(edges)[: TELLING_PAIRS[1]]
    fits = [_fitting(FreeSpace.of(views, viewpoints), sure) for viewpoints in common]
    best = int(np.argmax(fits))
    if fits[best] >= MIN_FITTING_SHARE and fits[best] > fits[1 - best]:
        return tuple(
            None if viewpoint is None else dataclasses.replace(viewpoint, certain=True) for viewpoint in common[best]
        )
    return common[0] if order == "turntable" else given


def _sure(edges: Sequence[Edge]) -> list[tuple[int, int, FloatArray]]:
    """Pairs of scans with their pose, T_target_source: those accepted, and those both accepted on the part."""
    accepted = [edge for edge in edges if edge.level == "accepted"]
    on_part = {edge.source: edge.registration.T_target_source for edge in accepted if edge.target == PART}
    pairs = [(e.target, e.source, e.registration.T_target_source) for e in accepted if e.target != PART]
    return pairs + [(i, j, pose.inverse(on_part[i]) @ on_part[j]) for i, j in combinations(sorted(on_part), 2)]


def _fitting(free: FreeSpace, pairs: Sequence[tuple[int, int, FloatArray]]) -> float:
    """Share of the pairs in which next to nothing stands where the other's scanner looked through."""
    shares = np.array([free.share(*pair) for pair in pairs])
    shares = shares[np.isfinite(shares)]
    return float(np.mean(shares <= DEPTH_CONFLICT_SHARE)) if len(shares) >= TELLING_PAIRS[0] else 0.0


@dataclasses.dataclass(frozen=True)
class Sides:
    """All scans with what is known of the sides that they saw, and of what their scanners looked through."""

    bodies: tuple[Body | None, ...]  # None for scans that cannot be used
    free: FreeSpace
    rays: PassedRays | None = None  # Of scanners amid what they show
    # Places on lines of sight that may be off, in the centred frames
    sights: tuple[FloatArray | None, ...] = ()
    known: dict[tuple[int, int, bytes], EdgeCode | None] = dataclasses.field(default_factory=dict)

    @staticmethod
    def of(views: Sequence[View], order: Order, edges: Sequence[Edge] = ()) -> Sides:
        """Scans of a known order; accepted edges may tell where the scanner stood."""
        viewpoints = viewpoints_of(views, order, edges)
        bodies = [
            body_of(view, viewpoint) if view.usable else None for view, viewpoint in zip(views, viewpoints, strict=True)
        ]
        certain = tuple(viewpoint if viewpoint is not None and viewpoint.certain else None for viewpoint in viewpoints)
        sights = tuple(None if each is None or each.certain else each.place for each in viewpoints)
        return Sides(tuple(bodies), FreeSpace.of(views, certain), PassedRays.of(views), sights)

    def signed(self, views: Sequence[View]) -> tuple[View, ...]:
        """The scans with normals of known sign, where it is certain from which side they were taken."""
        return tuple(
            view if body is None or image is None else dataclasses.replace(view, signed=body.scan)
            for view, body, image in zip(views, self.bodies, self.free.images, strict=True)
        )

    def checked(self, edges: Sequence[Edge]) -> list[Edge]:
        """The edges, with those marked that lay one side of a sheet on the other, or stand in free space."""
        found = []
        for edge in edges:
            wrong = self._contradiction_code(edge) if edge.found and edge.target != PART else None
            found.append(edge if wrong is None else dataclasses.replace(edge, code=wrong))
        return found

    def _contradiction_code(self, edge: Edge) -> EdgeCode | None:
        i, j, T = edge.target, edge.source, edge.registration.T_target_source
        key = i, j, T.tobytes()
        if key not in self.known:
            opposite = self.opposed(i, j, T) > MAX_OPPOSITE_SHARE
            through = not opposite and self.free.share(i, j, T) > LOOKED_THROUGH_SHARE
            self.known[key] = "opposite_sides" if opposite else "looked_through" if through else None
        return self.known[key]

    def opposed(self, i: int, j: int, T_i_j: FloatArray) -> float:
        """`opposed` of two scans at a pose between their own frames."""
        a, b = self.bodies[i], self.bodies[j]
        if a is None or b is None:
            return np.nan
        shift = pose.from_parts(np.eye(3), -a.origin)
        sights = (self.sights[i], self.sights[j]) if self.sights else (None, None)
        return opposed(a, b, shift @ T_i_j @ pose.from_parts(np.eye(3), b.origin), sights)

    def contradictions(self, T_world_scan: FloatArray, overlap: FloatArray) -> Iterator[Contradiction]:
        """Pairs of placed scans that overlap, and that their sides or lines of sight contradict."""
        through = self.free.contradictions(T_world_scan)
        if self.rays is not None:
            through = np.maximum(through, self.rays.contradictions(T_world_scan))
        overlapping = np.nan_to_num(overlap) >= MIN_OVERLAP
        for i, j in np.argwhere(np.triu(overlapping | (through > 0.0), 1)).tolist():
            if self.bodies[i] is None or self.bodies[j] is None:
                continue
            T = pose.inverse(T_world_scan[i]) @ T_world_scan[j]
            if overlapping[i, j] and self.opposed(i, j, T) > MAX_OPPOSITE_SHARE:
                yield Contradiction("opposite_sides", i, j)
            elif through[i, j] > 0.0:
                yield Contradiction("looked_through", i, j)


@dataclasses.dataclass(frozen=True)
class Contradiction:
    """Two scans that cannot stand as they were placed."""

    code: Literal["opposite_sides", "looked_through"]
    target: int
    source: int


def opposed(
    a: Body, b: Body, T_a_b: FloatArray, sights: tuple[FloatArray | None, FloatArray | None] = (None, None)
) -> float:
    """Share of the places matched at a pose that one scan saw from one side and the other from the other one.

    Sides that are a sheet apart do not match; NaN where signs are not known, or little matches. Poses are of the
    centred frames.
    """
    if a.scan is None or b.scan is None or not (a.scan.oriented and b.scan.oriented and a.surface.oriented):
        return np.nan
    points, normals = (every_so_many(rows, COMPARED_POINTS) for rows in (b.scan.points, b.scan.normals))
    moved = pose.apply(T_a_b, points)
    found = a.surface.closest(moved)
    cosines = np.einsum("ij,ij->i", normals @ T_a_b[:3, :3].T, found.normals)
    along = np.abs(np.einsum("ij,ij->i", moved - found.points, found.normals))
    noise = max(a.scan.noise, b.scan.noise, a.noise_floor)
    near = (found.distances <= NEAR_SPACINGS * max(a.scan.spacing, b.scan.spacing)) & (along <= NEAR_NOISES * noise)
    alike = near & (np.abs(cosines) >= MIN_NORMAL_COS)
    alike &= _well_seen(found.points, found.normals, sights[0]) & _well_seen(points, normals, sights[1])
    return float(np.mean(cosines[alike] < 0.0)) if np.count_nonzero(alike) >= MIN_MATCHES else np.nan


def _well_seen(points: FloatArray, normals: FloatArray, place: FloatArray | None) -> BoolArray:
    """Which faces are on one side whatever a line of sight is off; all where the place is known."""
    if place is None:
        return np.ones(len(points), dtype=bool)
    toward = place - points
    cosines = np.einsum("ij,ij->i", normals, toward) / np.linalg.norm(toward, axis=1)
    return np.asarray(np.abs(cosines) >= MIN_SIGHT_COS)

"""Motions that may lead from a pose to others that explain the scan as well: of parts, and of clouds alike."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg._records import remembered
from dqreg.geometry import CloudSurface, Mesh, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.sampling import places_on
from dqreg.kernels.threads import unlocked_property
from dqreg.registration.fit.fit import Fit
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.search.cloud_rings import ring_turns
from dqreg.search.near_symmetry import is_symmetry, near_flips
from dqreg.search.periods import MIN_PERIOD_DIAGONALS, near_periods
from dqreg.search.plane_maps import MAX_LOST_SHARE, MIN_FLAT_SHARE, PLANE_POINTS, Planes, plane_maps
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.tangent_planes import TangentPlanes
from dqreg.trust.patch_tests import INLIER_SIGMAS

# Points of a scan that are asked how far it reaches.
EXTENT_POINTS = 5_000
# Refinement of the flips of a cloud.
REFINEMENT = Refinement(first=0.02, steps=10)
# Points of a cloud whose differences tell its periods: it is asked for one scan.
PERIOD_POINTS_OF_CLOUD = 600
# A free motion is a screw where its rotation moves the part by more than this share of the whole, and its shift by more
# than that share of the rotation's.
SCREW_ROTATION_SHARE, SCREW_SHIFT_SHARE = 0.3, 3e-3
# Motions that less than this share of the inliers constrains may be screws.
MIN_CARRIER_SHARE = 0.1
# Share of the inliers that shows an end of a part, this near to it in sizes: after any period they stick out by two
# thirds of that, and so many are enough to tell.
END_SHARE, END_DIAGONALS = 0.005, 0.35 * MIN_PERIOD_DIAGONALS

# Directions of planes that leave a shift along both open.
END_DIRECTIONS = 2

INLIERS: Key[FloatArray] = Key()


@dataclasses.dataclass(frozen=True, eq=False)
class _Places:
    """What is asked of a target, found once."""

    maps: FloatArray  # (k, 4, 4): Rotations that leave most of it in place, of a cloud periods as well
    points: FloatArray  # (n, 3): Some points of it
    normals: FloatArray  # (n, 3): Their normals
    size: float

    @unlocked_property
    def planes(self) -> Planes:
        """Its planes: few scans of a part ask for them."""
        return Planes.of(self.points, self.normals, self.size)

    @unlocked_property
    def reach(self) -> FloatArray:
        """Extent along each axis, (3,)."""
        return _extent(self.points)


# Of a target: of each surface that stands for it.
PLACES: Key[_Places] = Key()
RING_TURNS: Key[FloatArray] = Key()
FLIPS: Key[FloatArray] = Key()
TANGENT: Key[TangentPlanes] = Key()


def near_maps(fit: Fit, *, of_any: bool = False) -> FloatArray:
    """Those that leave most of the target in place, and that put the scan's planes into others of its, (k, 4, 4).

    A cloud is asked for more than its flips where the scan shows hardly more than planes, or in any case: only planes
    are found again so easily elsewhere that it is worth a tenth of a registration.
    """
    surface = fit.prepared.surface
    scan = _planes_of_scan(fit) if isinstance(surface, CloudSurface) else None
    if isinstance(surface, CloudSurface) and scan is not None and scan.flat < MIN_FLAT_SHARE and not of_any:
        # What a sensor saw from its stand, a street or a room, is no part that may lie the other way up.
        around = fit.prepared.is_from_a_stand
        return _half_screws(fit) if around else np.concatenate([_flips_of_cloud(fit, surface), _half_screws(fit)])
    found = _places(fit)
    # All of a part fits in its own place, or after what leaves the part in place.
    if scan is None and not _reaches_over(fit, found.reach):
        scan = _planes_of_scan(fit)
    others = []
    if scan is not None:
        # In a scene the search has compared poses by other objects too: where two directions are seen, ends are asked.
        reaching = _inliers(fit) if fit.is_scene and len(scan.directions) == END_DIRECTIONS else None
        others = [plane_maps(scan, found.planes, surface.diagonal, reaching=reaching)]
    return np.concatenate([found.maps, _periods(fit), _half_screws(fit), *others])


def plane_turns(fit: Fit) -> FloatArray:
    """Motions that put the planes of a scan into others of its part, by their ends across them, (k, 4, 4)."""
    size, reaching, planes = fit.prepared.surface.diagonal, _inliers(fit), _places(fit).planes
    return plane_maps(_planes_of_scan(fit).beside(planes), planes, size, reaching=reaching)


def ring_maps(fit: Fit) -> FloatArray:
    """Turns about its axis that put most of a target cloud that shows a ring onto itself, (k, 4, 4)."""
    surface, derived = fit.prepared.surface, fit.problem.target.derived
    if not isinstance(surface, CloudSurface):
        return np.zeros((0, 4, 4))
    return derived.once(RING_TURNS, lambda: ring_turns(surface, _tangent(fit, surface)), of=_counted(surface))


def _periods(fit: Fit) -> FloatArray:
    """Periods of a part that may lead to another pose, (k, 4, 4): none where the scan shows all its ends.

    They take longer to find than all else that is asked of a part, and no scan that shows its ends fits one period on.
    """
    target, none = fit.problem.target, np.zeros((0, 4, 4))
    # Of most parts it is known soon that they have none.
    known = remembered(target, "near_periods")
    if not isinstance(target.geometry, Mesh) or (known is not None and not len(known)):
        return none
    return none if _shows_the_ends(fit, target.geometry) else target.near_periods


def _shows_the_ends(fit: Fit, part: Mesh) -> bool:
    """Whether some of the scan lies at either end of a part along all axes."""
    near, margin = _inliers(fit), END_DIAGONALS * part.diagonal
    if not len(near):
        return False
    # Where more points are at an end than a rank says, so is the one of that rank.
    rank = min(int(END_SHARE * len(near)) + 1, len(near) - 1)
    ends = zip(near.T, *(part.bounds + np.array([[margin], [-margin]])), strict=True)
    return all(min(map(np.count_nonzero, (x <= low, x >= high))) > rank for x, low, high in ends)


def _inliers(fit: Fit) -> FloatArray:
    """Points on the target, (n, 3), of those that are asked how far the scan reaches."""

    def found() -> FloatArray:
        pairs, within = fit.run.pairs, INLIER_SIGMAS * fit.run.mixture.scale
        rows = sample_rows(len(pairs.moved), EXTENT_POINTS)
        return np.take(pairs.moved, rows[fit.on_part[rows] & (pairs.distances[rows] <= within)], axis=0)

    return fit.derived.once(INLIERS, found)


def _planes_of_scan(fit: Fit) -> Planes:
    pairs, within = fit.run.pairs, INLIER_SIGMAS * fit.run.mixture.scale
    # Of a scene, what is off the part is in no plane of it, and leaves the others their shares.
    is_asked = fit.on_part & (pairs.distances <= within) if fit.is_scene else np.ones(len(pairs.moved), dtype=bool)
    among = np.flatnonzero(is_asked)
    # Those that are looked at there.
    rows = among[sample_rows(len(among), PLANE_POINTS)]
    near = pairs.distances[rows] <= within
    normals = np.where(near[:, None], pairs.closest.normals[rows], 0.0)
    return Planes.of(pairs.moved[rows], normals, fit.prepared.surface.diagonal)


def _reaches_over(fit: Fit, whole: FloatArray) -> bool:
    """Whether the scan reaches from end to end of the target along all axes, up to what a motion may lose."""
    return bool((_extent(_inliers(fit)) >= (1.0 - MAX_LOST_SHARE) * whole).all())


def _extent(points: FloatArray) -> FloatArray:
    return np.subtract(*bounds(points)[::-1]) if len(points) else np.zeros(3)


def rows_beside(fit: Fit, poses: FloatArray, reach: float) -> IntArray:
    """Points that tell poses of the scan, (k, 4, 4), apart: all, or of a scene those that one puts into the part.

    Among those of a table few would be of a notch, and the pose to which it speaks would be as likely as the others.
    """
    scan, part = fit.prepared.scan, fit.problem.target.geometry
    if not fit.is_scene or not isinstance(part, Mesh):
        return np.arange(len(scan))
    inside = np.zeros(len(scan), dtype=bool)
    for T in poses:
        moved = pose.apply(T, scan.points)
        inside |= ((moved >= part.bounds[0] - reach) & (moved <= part.bounds[1] + reach)).all(axis=1)
    return np.flatnonzero(inside) if inside.any() else np.arange(len(scan))


def is_same_place(fit: Fit, T: FloatArray) -> bool:
    """Whether a motion leaves all of the target about in place: the pose after it is the same to whoever asks."""
    target, surface = fit.problem.target.geometry, fit.prepared.surface
    if isinstance(target, Mesh):
        return is_symmetry(T, target, surface)
    return isinstance(surface, CloudSurface) and _tangent(fit, surface).is_symmetry(T)


def _half_screws(fit: Fit) -> FloatArray:
    """Half-turns, either way, along screws that little constrains, such as that of a thread, (k, 4, 4)."""
    information = fit.information
    # The facets of a thread, and the ends of its turns, hold it a little.
    weak = information.free | (information.carriers < MIN_CARRIER_SHARE * float(fit.run.weights.sum()))
    if not weak.any():
        return np.zeros((0, 4, 4))
    twists = information.vectors[:, weak].T / scaling_by(information.lever)
    found = []
    for motion in twists:
        rate = float(np.linalg.norm(motion[:3]))
        shift = abs(float(motion[:3] @ motion[3:])) / max(rate, np.finfo(float).tiny)
        # Rotations of a round part, and shifts along a bar, are no screws.
        if shift > SCREW_SHIFT_SHARE * information.lever * rate > SCREW_SHIFT_SHARE * SCREW_ROTATION_SHARE:
            found += [twist.exp(sign * np.pi / rate * motion) for sign in (1.0, -1.0)]
    return np.array(found).reshape(-1, 4, 4)


def _places(fit: Fit) -> _Places:
    surface = fit.prepared.surface
    return fit.problem.target.derived.once(
        PLACES,
        lambda: _of_cloud(fit, surface) if isinstance(surface, CloudSurface) else _of_mesh(fit),
        of=_counted(surface),
    )


def _of_mesh(fit: Fit) -> _Places:
    target = fit.problem.target
    assert isinstance(target.geometry, Mesh)
    points, faces = places_on(target.geometry, PLANE_POINTS, np.random.default_rng(0))
    return _Places(target.near_rotations, points, target.geometry.face_normals[faces], fit.prepared.surface.diagonal)


def _of_cloud(fit: Fit, surface: CloudSurface) -> _Places:
    points, normals, _ = surface._distinct.sampled(PLANE_POINTS)
    tangent, flips = _tangent(fit, surface), _flips_of_cloud(fit, surface)
    maps = np.concatenate([flips, near_periods(tangent.facets(), tangent, PERIOD_POINTS_OF_CLOUD)])
    return _Places(maps, points, normals, surface.diagonal)


def _flips_of_cloud(fit: Fit, surface: CloudSurface) -> FloatArray:
    """Rotations that leave most of a target cloud in place, (k, 4, 4)."""

    def found() -> FloatArray:
        tangent = _tangent(fit, surface)
        flips = near_flips(tangent.facets(), tangent) if tangent.has_facets else np.zeros((0, 4, 4))
        if len(flips):
            # Moments of what was seen of a part are not the part's: its axes are off by a degree.
            flips = refined_on(flips, surface._distinct.points, surface, REFINEMENT)
        return flips

    return fit.problem.target.derived.once(FLIPS, found, of=_counted(surface))


def _tangent(fit: Fit, surface: CloudSurface) -> TangentPlanes:
    return fit.problem.target.derived.once(TANGENT, lambda: TangentPlanes(surface), of=_counted(surface))


def _counted(surface: Surface) -> int:
    """Points of a cloud, zero of a mesh: of a large cloud the loop asks cells, of a size that the scan decides."""
    return len(surface._distinct) if isinstance(surface, CloudSurface) else 0

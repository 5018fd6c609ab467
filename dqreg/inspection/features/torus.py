"""A torus through the corners of a face: fillets round a boss or along a bent edge, where they determine it."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.angles import gaps_around
from dqreg.inspection.features.starts import frame_along
from dqreg.rigid import twist

# Steps at most, and the step, in sizes of the points, below which nothing improves.
MAX_STEPS, MIN_STEP_SIZES = 60, 1e-15
# Fewest corners across the tube and round the axis that lie apart: three are on a circle of any face of revolution.
MIN_CORNERS_APART = 4
# Corners closer than that share of their size are one; so many are needed, since seven are on a torus of any shape.
SAME_CORNER_SIZES, MIN_CORNERS = 1e-6, MIN_CORNERS_APART**2
# Corners lie apart where their angles differ by that share of the range.
APART_RANGE_SHARE = 1e-2
# Share of the area, and the cosine, to which the triangles lean as the torus does.
LEANING_AREA_SHARE, LEANING_COS = 0.99, 0.7
# Both radii are held to that share by corners that are anywhere within the form error.
HELD_RADIUS_SHARE = 0.01


@dataclasses.dataclass(frozen=True, eq=False)
class Torus:
    """A torus through the corners of a face of a part.

    Attributes
    ----------
    centre : ndarray, (3,)
        In the part's frame.
    axis : ndarray, (3,)
        Unit vector; its largest component is positive.
    major_radius : float
        Of the circle in the middle of the tube.
    minor_radius : float
        Of the tube: of a fillet, its radius.
    form : float
        Form error: the width of the zone that holds the corners, a length. At most 1e-4 of the face's size, where the
        semi-axes of an elliptic fillet may differ by 0.5 to 2 %; its radius then lies between them.
    """

    centre: FloatArray
    axis: FloatArray
    major_radius: float
    minor_radius: float
    form: float


@dataclasses.dataclass(frozen=True)
class _Ring:
    """A torus in scaled coordinates, its axis the third column of its frame."""

    centre: FloatArray
    frame: FloatArray
    major: float
    minor: float

    def local(self, points: FloatArray) -> FloatArray:
        return (points - self.centre) @ self.frame

    def rows(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances, and their derivatives by two tilts, three shifts and both radii. Shapes: (n,), (n, 7)."""
        q = self.local(points)
        length, gradients, across = _gradients(q, self.major)
        tilts = np.cross(gradients, q)[:, :2]
        return length - self.minor, np.column_stack([tilts, -gradients, -across, -np.ones(len(q))])

    def moved(self, step: FloatArray) -> _Ring:
        turn = twist.exp(np.r_[step[:2], np.zeros(4)])[:3, :3]
        major, minor = self.major + float(step[5]), self.minor + float(step[6])
        return _Ring(self.centre + self.frame @ step[2:5], self.frame @ turn, major, minor)

    def cost(self, points: FloatArray) -> float:
        return float(np.sum((_gradients(self.local(points), self.major)[0] - self.minor) ** 2))


def fit_torus(corners: FloatArray, normals: FloatArray, allowed: float) -> Torus | None:
    """The torus that the corners of triangles lie on within a form error, None where there is none or many are.

    Shapes: corners (f, 3, 3), normals (f, 3).
    """
    flat = corners.reshape(-1, 3)
    middle = flat.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((flat - middle) ** 2, axis=1))))
    if size <= 0.0 or len(np.unique(np.round((flat - middle) / (SAME_CORNER_SIZES * size)), axis=0)) < MIN_CORNERS:
        return None
    points, centres = (flat - middle) / size, (corners.mean(axis=1) - middle) / size
    starts = [start for start in _starts(points, centres, normals) if start is not None]
    # Corners that are on no torus let it grow beyond all numbers.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        rings = [_refined(start, points) for start in starts]
    rings = [ring for ring in rings if ring.major > 0.0 and ring.minor > 0.0 and np.isfinite(ring.cost(points))]
    if not rings:
        return None
    best = min(rings, key=lambda ring: ring.cost(points))
    residuals, slopes = best.rows(points)
    form = float(np.ptp(residuals))
    sizes = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if size * form > allowed or not _is_held(best, points, slopes, form) or not _leans(best, centres, normals, sizes):
        return None
    axis = best.frame[:, 2]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return Torus(middle + size * best.centre, axis, size * best.major, size * best.minor, size * form)


def _gradients(q: FloatArray, major: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance from the circle in the middle of the tube, its gradient, and the part of it away from the axis."""
    tiny = np.finfo(float).tiny
    rho = np.hypot(q[:, 0], q[:, 1])
    length = np.hypot(rho - major, q[:, 2])
    across = (rho - major) / np.maximum(length, tiny)
    outward = q[:, :2] / np.maximum(rho, tiny)[:, None]
    return length, np.column_stack([across[:, None] * outward, q[:, 2] / np.maximum(length, tiny)]), across


def _starts(points: FloatArray, centres: FloatArray, normals: FloatArray) -> list[_Ring | None]:
    """Tori about the lines that the normals meet best: all normals of a surface of revolution meet its axis."""
    _, _, lines = np.linalg.svd(np.column_stack([np.cross(centres, normals), normals]), full_matrices=False)
    return [_about(points, line[:3], line[3:]) for line in lines[-1:-3:-1]]


def _about(points: FloatArray, axis: FloatArray, moment: FloatArray) -> _Ring | None:
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        # Normals that are square to one direction: an extruded face.
        return None
    frame, foot = frame_along(axis), np.cross(axis, moment) / length**2
    q = (points - foot) @ frame
    rho, z = np.hypot(q[:, 0], q[:, 1]), q[:, 2]
    solved = np.linalg.lstsq(np.column_stack([2.0 * rho, 2.0 * z, np.ones(len(z))]), rho**2 + z**2, rcond=None)[0]
    minor = float(np.sqrt(max(solved[2] + solved[0] ** 2 + solved[1] ** 2, 0.0)))
    return _Ring(foot + solved[1] * frame[:, 2], frame, float(solved[0]), minor)


def _refined(ring: _Ring, points: FloatArray) -> _Ring:
    """Gauss-Newton's steps, halved where they lead upwards."""
    cost = ring.cost(points)
    for _ in range(MAX_STEPS):
        residuals, slopes = ring.rows(points)
        if not np.isfinite(slopes).all():
            return ring
        step: FloatArray = np.linalg.lstsq(slopes, -residuals, rcond=1e-13)[0].astype(np.float64)
        for _ in range(8):
            moved = ring.moved(step)
            new = moved.cost(points)
            if new <= cost:
                break
            step = 0.5 * step
        if not new < cost:
            return ring
        ring, cost = moved, new
        if np.abs(step).max() < MIN_STEP_SIZES:
            break
    return ring


def _is_held(ring: _Ring, points: FloatArray, slopes: FloatArray, form: float) -> bool:
    """Whether there are corners enough both ways, and no corner within the form error changes a radius by much."""
    q = ring.local(points)
    tube = np.arctan2(q[:, 2], np.hypot(q[:, 0], q[:, 1]) - ring.major)
    if min(_apart(tube), _apart(np.arctan2(q[:, 1], q[:, 0]))) < MIN_CORNERS_APART:
        return False
    # Corners may all be off towards the worst: their errors are those of a shape, not of chance.
    slack = np.abs(np.linalg.pinv(slopes, rcond=1e-13))[5:].sum(axis=1) * max(0.5 * form, np.finfo(float).eps)
    return bool((slack <= HELD_RADIUS_SHARE * np.array([ring.major, ring.minor])).all())


def _apart(angles: FloatArray) -> int:
    """How many angles lie apart, the widest gap of the turn left out; a fine grid has many, however close they are."""
    gaps = gaps_around(angles)[1]
    widest = int(np.argmax(gaps))
    along = np.concatenate([[0.0], np.cumsum(np.roll(gaps, -1 - widest)[:-1])])
    count, last = 1, 0.0
    while along[-1] > 1e-9 and along[-1] - last > APART_RANGE_SHARE * along[-1]:
        last = float(along[np.searchsorted(along, last + APART_RANGE_SHARE * along[-1], side="right")])
        count += 1
    return count


def _leans(ring: _Ring, centres: FloatArray, normals: FloatArray, sizes: FloatArray) -> bool:
    """Whether the triangles lie along the torus, all on one side: the flat end that a fillet runs into does not."""
    cosines = np.einsum("ij,ij->i", _gradients(ring.local(centres), ring.major)[1] @ ring.frame.T, normals)
    whole = LEANING_AREA_SHARE * float(sizes.sum())
    return max(float(sizes[cosines > LEANING_COS].sum()), float(sizes[cosines < -LEANING_COS].sum())) >= whole

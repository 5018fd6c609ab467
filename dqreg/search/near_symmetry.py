"""Near symmetries: poses of a part, or of its mirror image, that only a small feature tells from the right one.

An initial pose that was given decides between them before any feature does. So the near symmetries of the result are
tried, and those that explain the scan as well, or better, are reported. A left-hand part scanned for a right-hand one,
or a sensor whose frame is left-handed, fits in all but a few features: its misfit may be no more than clutter leaves,
but it vanishes in the mirror.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Surface, sample_mesh
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis, angle_of
from dqreg.search.axes import cube_rotations, face_axes, moments, principal_axes
from dqreg.search.symmetry import MOST, NEARLY, SAME

# A motion that leaves this fraction of the part in place is a symmetry, which no scan can decide; in place to so much
# of the size, it is none to a scan with little noise.
ALL, EXACT = 0.998, 1e-4
# Points that check a motion, those of them that screen it, and the fraction that these may lack.
CHECKED, SCREENED, SLACK = 2_000, 100, 0.2
# Smaller moment in the larger one of the two across the axis of a ring, at least.
EQUAL_MOMENTS = 0.9
# Axes of the faces that are this near to the principal ones are the same.
SAME_FRAME_RAD = np.deg2rad(1.0)
# Maps that differ by less are one: the refinement on the scan leads to the same pose from both.
SAME_MAP_RAD = np.deg2rad(5.0)
# Half-turns across a ring that are tried, and those around each that fits.
FLIPS, FINER = 72, 7
# Teeth of a ring that are tried, and points that score a rotation by one.
TEETH, RING_POINTS = range(5, 41), 500
# A step of a ring fits where so much of what half a step moves out of place comes back into it: else it is the whole of
# a disc that fits, at any angle, and ICP itself rotates it. What breaks the ring stays out of place: of five bolts
# beside a block in the flange 0.28 to 0.4 come back, of orders that are none 0.13 at most. Orders that bring back less
# than so much of what the best one does are none beside it: three teeth and a tenth are no step.
COMES_BACK, OF_BEST = 0.2, 0.5
# Numbers of teeth that are kept, the best ones.
ORDERS_KEPT = 4


def near_flips(mesh: Mesh, surface: Surface) -> FloatArray:
    """Rotations about the principal axes that leave most of a part in place, but not all of it; by a tooth, of a ring.

    Shapes: returns (k, 4, 4). Some are `is_symmetry`: little noise may tell what they change.
    """
    ring = [*ring_steps(mesh, surface), *ring_flips(mesh, surface)]
    return _near_maps(mesh, surface, _about(mesh, cube_rotations(), ring), EXACT)


def near_mirrors(mesh: Mesh, surface: Surface) -> FloatArray:
    """Improper rotations about the principal axes that leave most of a part in place, but not all of it.

    Shapes: returns (k, 4, 4).
    """
    return _near_maps(mesh, surface, _about(mesh, [-R for R in cube_rotations()]), SAME)


def mirrors_about(mesh: Mesh) -> FloatArray:
    """All improper rotations about the centre of a part by its principal axes and its faces', (k, 4, 4)."""
    centre = moments(mesh)[0]
    return np.array([pose.from_parts(R, centre - R @ centre) for R in _about(mesh, [-R for R in cube_rotations()])])


def is_symmetry(T: FloatArray, mesh: Mesh, surface: Surface) -> bool:
    """Whether a motion leaves all of a part about in place."""
    points, limit = sample_mesh(mesh, CHECKED, np.random.default_rng(0)).points, SAME * surface.diagonal
    return bool(np.mean(surface.closest(pose.apply(T, points), within=2.0 * limit).distances <= limit) >= ALL)


def _about(mesh: Mesh, turns: Sequence[FloatArray], ring: Sequence[FloatArray] = ()) -> list[FloatArray]:
    """Orthogonal matrices in the frame of the principal axes and in that of the faces, as those of the part's frame."""
    frames = [principal_axes(*moments(mesh))[1]]
    faces = face_axes(mesh)
    if faces is not None and np.abs(faces.T @ frames[0]).max(axis=0).min() < np.cos(SAME_FRAME_RAD):
        frames.append(faces)
    # The identity and the inversion are the same in every frame.
    maps = [axes @ turn @ axes.T for axes in frames for turn in turns if axes is frames[0] or abs(np.trace(turn)) < 3.0]
    return maps + [frames[0] @ R @ frames[0].T for R in ring]


@dataclasses.dataclass(frozen=True)
class _Ring:
    """A part with equal moments across one of its axes, in the frame of the principal axes."""

    axis: FloatArray  # (3,): Of the frame
    centre: FloatArray
    axes: FloatArray
    arms: FloatArray  # (m, 3): Points of it, seen from the centre
    surface: Surface

    @staticmethod
    def of(mesh: Mesh, surface: Surface) -> _Ring | None:
        """The ring; None where no two moments, or all, are equal."""
        mean, covariance = moments(mesh)
        values = np.linalg.eigvalsh(covariance)
        low, high = (bool(values[k] > EQUAL_MOMENTS * values[k + 1]) for k in (0, 1))
        if low == high:
            return None
        centre, axes = principal_axes(mean, covariance)
        arms = (sample_mesh(mesh, RING_POINTS, np.random.default_rng(0)).points - centre) @ axes
        return _Ring(np.eye(3)[0 if high else 2], centre, axes, arms, surface)

    def in_place(self, rotations: Sequence[FloatArray]) -> FloatArray:
        """Mean gain of the points after each of some rotations, (k,)."""
        moved = np.concatenate([self.arms @ (self.axes @ R).T for R in rotations]) + self.centre
        return gains_of(moved, self.surface, NEARLY, len(rotations))


def ring_steps(mesh: Mesh, surface: Surface) -> list[FloatArray]:
    """Rotations by one tooth of a ring whose teeth fit each other, either way, in the frame of the principal axes.

    About an axis with equal moments across it the rotations of the cube miss them: a ring of 24 teeth fits itself at
    every 15 degrees.
    """
    ring = _Ring.of(mesh, surface)
    if ring is None:
        return []
    steps = 2.0 * np.pi / np.array(TEETH)
    whole, half = (ring.in_place([about_axis(ring.axis, angle) for angle in angles]) for angles in (steps, 0.5 * steps))
    # An order beside the right one fits as well, a little worse.
    beside = np.maximum(np.r_[0.0, whole[:-1]], np.r_[whole[1:], 0.0])
    back = np.where(whole > beside, whole - half, 0.0) / np.maximum(1.0 - half, np.finfo(float).eps)
    fits = np.flatnonzero(back > max(COMES_BACK, OF_BEST * float(back.max())))
    fits = fits[np.argsort(-whole[fits], kind="stable")][:ORDERS_KEPT]
    return [about_axis(ring.axis, sign * steps[k]) for k in fits for sign in (1.0, -1.0)]


def ring_flips(mesh: Mesh, surface: Surface) -> list[FloatArray]:
    """Half-turns of a ring about axes across its own that leave most of it in place: its moments name none of them."""
    ring = _Ring.of(mesh, surface)
    if ring is None:
        return []
    across = np.roll(ring.axis, 1)

    def flips(angles: FloatArray) -> list[FloatArray]:
        return [about_axis(about_axis(ring.axis, angle) @ across, np.pi) for angle in angles]

    angles = np.arange(FLIPS) * np.pi / FLIPS
    gains = ring.in_place(flips(angles))
    tops = np.flatnonzero((gains >= np.roll(gains, 1)) & (gains > np.roll(gains, -1)) & (gains > gains.mean()))
    tops = tops[np.argsort(-gains[tops], kind="stable")][:ORDERS_KEPT]
    found = []
    for angle in angles[tops]:
        fine = flips(angle + np.linspace(-0.5, 0.5, FINER) * np.pi / FLIPS)
        found.append(fine[int(ring.in_place(fine).argmax())])
    return found


def _near_maps(mesh: Mesh, surface: Surface, turns: list[FloatArray], same: float) -> FloatArray:
    """Those of some orthogonal matrices that, about the centre, leave most of a part in place, but not all exactly."""
    centre = moments(mesh)[0]
    points = sample_mesh(mesh, CHECKED, np.random.default_rng(0)).points
    maps = [pose.from_parts(R, centre - R @ centre) for R in turns]
    # Few points of all rotations in one query; most rotations move most of the part far away.
    few = np.concatenate([pose.apply(T, points[:: CHECKED // SCREENED]) for T in maps])
    within = 2.0 * NEARLY * surface.diagonal
    near = surface.closest(few, within=within).distances <= NEARLY * surface.diagonal
    fractions = near.reshape(len(maps), -1).mean(axis=1)
    found: list[tuple[float, FloatArray]] = []
    for T in (maps[k] for k in np.flatnonzero(fractions >= MOST - SLACK)):
        distances = surface.closest(pose.apply(T, points), within=within).distances / surface.diagonal
        fraction = float(np.mean(distances <= NEARLY))
        if fraction >= MOST and np.mean(distances <= same) < ALL:
            found.append((fraction, T))
    kept: list[FloatArray] = []
    for _, T in sorted(found, key=lambda pair: -pair[0]):
        # Both frames may come near to one symmetry.
        if all(angle_of(T[:3, :3] @ other[:3, :3].T) > SAME_MAP_RAD for other in kept):
            kept.append(T)
    return np.array(kept).reshape(-1, 4, 4)


def gains_of(points: FloatArray, surface: Surface, reach: float, count: int) -> FloatArray:
    """Mean of ``1 - (d / reach)^2``, 0 beyond the reach in sizes, for each of so many poses of the same points."""
    apart = surface.closest(points, within=reach * surface.diagonal).distances / (reach * surface.diagonal)
    return np.asarray(np.maximum(1.0 - apart**2, 0.0).reshape(count, -1).mean(axis=1))

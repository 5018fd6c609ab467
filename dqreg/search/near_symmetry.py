"""Near symmetries: poses of a part, or of its mirror image, that only a small feature tells from the right one.

An initial pose that was given decides between them before any feature does. So the near symmetries of the result are
tried, and those that explain the scan as well, or better, are reported. A left-hand part scanned for a right-hand one,
or a sensor whose frame is left-handed, fits in all but a few features: its misfit may be no more than clutter leaves,
but it vanishes in the mirror.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray, bounds
from dqreg.geometry import Mesh, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.sampling import places_on
from dqreg.kernels.threads import ask_clock
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.search.axes import cube_rotations, face_axes, half_sphere, moments, principal_axes
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.rings import Ring, ring_flips, ring_steps
from dqreg.search.scoring import distances_at, mean_gains
from dqreg.search.symmetry import NEAR_SYMMETRY_DIAGONALS, NEAR_SYMMETRY_FRACTION, ON_PART_DIAGONALS

# A motion that leaves this fraction of the part in place is a symmetry, which no scan can decide; in place to so much
# of the size, it is none to a scan with little noise.
SYMMETRY_FRACTION, EXACT_DIAGONALS = 0.998, 1e-4
# Points that check a motion.
CHECKING_POINTS = 2_000
# Those of them that screen it, few first, and the fraction that these may lack.
SCREEN_ROUNDS = ((25, 0.4), (100, 0.2))
# A quarter of them is enough where it says this much more or less than is asked: two and a half standard deviations.
EARLY_DIVISOR, EARLY_MARGIN = 4, 0.05
# Axes of the faces that are this near to the principal ones are the same.
SAME_FRAME_RAD = np.deg2rad(1.0)
# Maps that differ by less are one: the refinement on the scan leads to the same pose from both.
SAME_MAP_RAD = np.deg2rad(5.0)
# Shifts of a rotation that differ by less, in sizes, are one.
SAME_SHIFT_DIAGONALS = 0.5 * NEAR_SYMMETRY_DIAGONALS
# Planes through the centre, evenly in all directions, in which a part is mirrored; points that screen these, with the
# reach of their gain in sizes; and how many are kept, and their refinement.
MIRROR_PLANES = 200
SCREENING_POINTS, SCREENING_REACH_DIAGONALS = 100, 0.1
MIRRORS_KEPT = 12
REFINEMENT = Refinement(first=5e-2, steps=10, points=300)
# Points and edge of the bins of heights that find them.
PROFILE_POINTS, BIN_DIAGONALS = 1_000, 0.5 * NEAR_SYMMETRY_DIAGONALS


def near_flips(mesh: Mesh, surface: Surface) -> FloatArray:
    """Rotations about the principal axes that leave most of a part in place, but not all of it; by a tooth, of a ring.

    About the centre, or where they lay its ends or its largest planes into each other: what is on one side alone moves
    the centre. Shapes: returns (k, 4, 4). Some are `is_symmetry`: little noise may tell what they change.
    """
    ring = Ring.of(mesh, surface)
    turns = _about(mesh, cube_rotations(), [*ring_steps(ring), *ring_flips(ring)])
    laid = _laid_into_itself(mesh, cube_rotations(), surface.diagonal)
    return _near_maps(mesh, surface, [*_about_centre(mesh, turns), *laid], EXACT_DIAGONALS)


def near_mirrors(mesh: Mesh, surface: Surface) -> FloatArray:
    """Improper rotations that leave most of a part in place, but not all of it, (k, 4, 4).

    About the principal axes through the centre, or where they lay its ends or its largest planes into each other; and
    in planes near the centre, whatever their direction: that of two holes is no axis of the part.
    """
    mirrors = [-R for R in cube_rotations()]
    found = [*_about_centre(mesh, _about(mesh, mirrors)), *_laid_into_itself(mesh, mirrors, surface.diagonal)]
    return _near_maps(mesh, surface, [*found, *_in_any_plane(mesh, surface)], ON_PART_DIAGONALS)


def mirrors_about(mesh: Mesh) -> FloatArray:
    """All improper rotations about the centre of a part by its principal axes and its faces', (k, 4, 4)."""
    return np.array(_about_centre(mesh, _about(mesh, [-R for R in cube_rotations()])))


def is_symmetry(T: FloatArray, mesh: Mesh, surface: Surface, same: float = ON_PART_DIAGONALS) -> bool:
    """Whether a motion leaves all of a part about in place, to a share of its size."""
    points, limit = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0], same * surface.diagonal
    return bool(
        np.mean(surface.closest(pose.apply(T, points), within=2.0 * limit).distances <= limit) >= SYMMETRY_FRACTION
    )


def _about(mesh: Mesh, turns: Sequence[FloatArray], ring: Sequence[FloatArray] = ()) -> list[FloatArray]:
    """Orthogonal matrices in the frame of the principal axes and in that of the faces, as those of the part's frame."""
    frames = _frames(mesh)
    # The identity and the inversion are the same in every frame.
    maps = [axes @ turn @ axes.T for axes in frames for turn in turns if axes is frames[0] or abs(np.trace(turn)) < 3.0]
    return maps + [frames[0] @ R @ frames[0].T for R in ring]


def _frames(mesh: Mesh) -> list[FloatArray]:
    """Axes of a part, one a column: the principal ones, and those of its faces where these are others."""
    frames = [principal_axes(*moments(mesh))[1]]
    faces = face_axes(mesh)
    if faces is not None and np.abs(faces.T @ frames[0]).max(axis=0).min() < np.cos(SAME_FRAME_RAD):
        frames.append(faces)
    return frames


def _about_centre(mesh: Mesh, turns: Sequence[FloatArray]) -> list[FloatArray]:
    """Orthogonal matrices as motions about the centre of a part's surface."""
    centre = moments(mesh)[0]
    return [pose.from_parts(R, centre - R @ centre) for R in turns]


def _in_any_plane(mesh: Mesh, surface: Surface) -> FloatArray:
    """Reflections that may leave most of a part in place, (k, 4, 4), refined on it from planes through its centre."""
    points = places_on(mesh, REFINEMENT.points, np.random.default_rng(0))[0]
    normals = half_sphere(MIRROR_PLANES)
    turns = list(np.eye(3) - 2.0 * normals[:, :, None] * normals[:, None])
    mirrors = Poses.of(np.array(_about_centre(mesh, turns)))
    some = points[sample_rows(len(points), SCREENING_POINTS)]
    gains = mean_gains(mirrors, some, surface, SCREENING_REACH_DIAGONALS)
    kept = mirrors[np.argsort(-gains, kind="stable")[:MIRRORS_KEPT]]
    return refined_on(kept.matrices, points, surface, REFINEMENT)


def _laid_into_itself(mesh: Mesh, turns: Sequence[FloatArray], size: float) -> list[FloatArray]:
    """Turns along a part's axes with shifts that lay most of it into itself, where they are not about its centre.

    Along each axis the shift is that of its centre, of its ends or of its planes. Turns are signed permutations, proper
    or not.
    """
    points, laid = places_on(mesh, PROFILE_POINTS, np.random.default_rng(0))[0], []
    for axes in _frames(mesh):
        profile, centre = _Profile(mesh, points, axes, BIN_DIAGONALS * size), moments(mesh)[0] @ axes
        for turn in turns:
            shift = np.array([profile.shift(int(k), j, turn[j, k]) for j, k in enumerate(np.abs(turn).argmax(axis=1))])
            if np.abs(shift - (centre - turn @ centre)).max() > SAME_SHIFT_DIAGONALS * size:
                laid.append(pose.from_parts(axes @ turn @ axes.T, axes @ shift))
    return laid


class _Profile:
    """How much of a part, by points on it, lies at which height along each of its axes."""

    def __init__(self, mesh: Mesh, points: FloatArray, axes: FloatArray, edge: float) -> None:
        ask_clock()
        # Of faces alone: a vertex without one may be anywhere.
        used = np.zeros(len(mesh.vertices), dtype=bool)
        used[mesh.faces] = True
        low, high = bounds(mesh.vertices[used] @ axes)
        self._middles = moments(mesh)[0] @ axes, 0.5 * (low + high)
        self._heights = points @ axes
        self._edge, self._low = edge, self._heights.min(axis=0)
        self._bins = int(np.ptp(self._heights, axis=0).max() / edge) + 2
        self._full = [self._counts(self._heights[:, k], k) for k in range(3)]
        self._shifts: dict[tuple[int, int, float], float] = {}

    def shift(self, one: int, other: int, sign: float) -> float:
        """Shift after which most of the heights along one axis, of a sign, lie at heights along another."""
        if one == other and sign > 0.0:
            return 0.0
        if (one, other, sign) not in self._shifts:
            of_middles = [float(middle[other] - sign * middle[one]) for middle in self._middles]
            shifts, moved = [*of_middles, *self._of_planes(one, other, sign)], sign * self._heights[:, one]
            alike = [np.minimum(self._counts(moved + shift, other), self._full[other]).sum() for shift in shifts]
            self._shifts[one, other, sign] = shifts[int(np.argmax(alike))]
        return self._shifts[one, other, sign]

    def _counts(self, heights: FloatArray, axis: int) -> FloatArray:
        """Points in every two bins that follow each other, from the lowest of an axis on."""
        rows = np.floor((heights - self._low[axis]) / self._edge).astype(np.int64)
        counts = np.bincount(rows[(rows >= 0) & (rows < self._bins)], minlength=self._bins)
        # A plane may lie where two bins meet.
        return np.asarray(counts[1:] + counts[:-1], dtype=np.float64)

    def _of_planes(self, one: int, other: int, sign: float) -> list[float]:
        """Shifts with the largest sum of products of the counts, and of their squares: the largest planes decide."""
        there, here = self._full[other], self._full[one][:: int(sign)]
        # The lower end of the first bin of what is moved.
        first = self._low[one] if sign > 0.0 else -(self._low[one] + self._bins * self._edge)
        steps = [int(np.correlate(there**p, here**p, "full").argmax()) - len(here) + 1 for p in (1, 2)]
        return [float(self._low[other] - first + step * self._edge) for step in steps]


def _near_maps(mesh: Mesh, surface: Surface, motions: list[FloatArray], same: float) -> FloatArray:
    """Those of some motions, proper or not, that leave most of a part in place, but not all exactly."""
    points = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0]
    maps = np.array(motions)
    away, asked = np.zeros((len(maps), len(points))), np.zeros(len(points), dtype=bool)

    def shares(rows: IntArray, every: int) -> tuple[FloatArray, FloatArray]:
        """Shares of every so-manieth point that each of some maps leaves nearly in place, and in place.

        Of maps and points that were asked about before, only the other points are.
        """
        some = np.flatnonzero((np.arange(len(points)) % every == 0) & ~asked)
        limit = 2.0 * NEAR_SYMMETRY_DIAGONALS * surface.diagonal
        away[np.ix_(rows, some)] = distances_at(Poses.of(maps[rows]), points[some], surface, limit) / surface.diagonal
        asked[some] = True
        known = away[rows, ::every]
        return (known <= NEAR_SYMMETRY_DIAGONALS).mean(axis=1), (known <= same).mean(axis=1)

    # Few points of all motions in one query; most move most of the part far away.
    rows = np.arange(len(maps))
    for count, slack in SCREEN_ROUNDS:
        rows = rows[shares(rows, CHECKING_POINTS // count)[0] >= NEAR_SYMMETRY_FRACTION - slack]
    nearly, exactly = shares(rows, EARLY_DIVISOR)
    unclear = (np.abs(nearly - NEAR_SYMMETRY_FRACTION) <= EARLY_MARGIN) | (exactly >= SYMMETRY_FRACTION - EARLY_MARGIN)
    nearly[unclear], exactly[unclear] = shares(rows[unclear], 1)
    fits = np.flatnonzero((nearly >= NEAR_SYMMETRY_FRACTION) & (exactly < SYMMETRY_FRACTION))
    exact = list(maps[rows[exactly >= SYMMETRY_FRACTION]])
    kept: list[FloatArray] = []
    for T in maps[rows[fits[np.argsort(-nearly[fits], kind="stable")]]]:
        # Both frames, and both shifts, may come near to one symmetry.
        if all(angle_of(T[:3, :3] @ other[:3, :3].T) > SAME_MAP_RAD for other in [*exact, *kept]):
            kept.append(T)
    return np.array(kept).reshape(-1, 4, 4)

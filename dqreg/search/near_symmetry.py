"""Near symmetries: poses of a part, or of its mirror image, that only a small feature tells from the right one.

An initial pose that was given decides between them before any feature does. So the near symmetries of the result are
tried, and those that explain the scan as well, or better, are reported. A left-hand part scanned for a right-hand one,
or a sensor whose frame is left-handed, fits in all but a few features: its misfit may be no more than clutter leaves,
but it vanishes in the mirror.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, Surface
from dqreg.geometry.sampling import places_on
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.search.axes import cube_rotations, face_axes, moments, principal_axes
from dqreg.search.poses import Poses
from dqreg.search.rings import Ring, ring_flips, ring_steps
from dqreg.search.scoring import distances_at
from dqreg.search.symmetry import NEAR_SYMMETRY_DIAGONALS, NEAR_SYMMETRY_FRACTION, ON_PART_DIAGONALS

# A motion that leaves this fraction of the part in place is a symmetry, which no scan can decide; in place to so much
# of the size, it is none to a scan with little noise.
SYMMETRY_FRACTION, EXACT_DIAGONALS = 0.998, 1e-4
# Points that check a motion.
CHECKING_POINTS = 2_000
# Those of them that screen it, and the fraction that these may lack.
SCREENING_POINTS, SCREENING_SLACK = 100, 0.2
# A quarter of them is enough where it says this much more or less than is asked: two and a half standard deviations.
EARLY_DIVISOR, EARLY_MARGIN = 4, 0.05
# Axes of the faces that are this near to the principal ones are the same.
SAME_FRAME_RAD = np.deg2rad(1.0)
# Maps that differ by less are one: the refinement on the scan leads to the same pose from both.
SAME_MAP_RAD = np.deg2rad(5.0)


def near_flips(mesh: Mesh, surface: Surface) -> FloatArray:
    """Rotations about the principal axes that leave most of a part in place, but not all of it; by a tooth, of a ring.

    Shapes: returns (k, 4, 4). Some are `is_symmetry`: little noise may tell what they change.
    """
    ring = Ring.of(mesh, surface)
    return _near_maps(
        mesh, surface, _about(mesh, cube_rotations(), [*ring_steps(ring), *ring_flips(ring)]), EXACT_DIAGONALS
    )


def near_mirrors(mesh: Mesh, surface: Surface) -> FloatArray:
    """Improper rotations about the principal axes that leave most of a part in place, but not all of it.

    Shapes: returns (k, 4, 4).
    """
    return _near_maps(mesh, surface, _about(mesh, [-R for R in cube_rotations()]), ON_PART_DIAGONALS)


def mirrors_about(mesh: Mesh) -> FloatArray:
    """All improper rotations about the centre of a part by its principal axes and its faces', (k, 4, 4)."""
    centre = moments(mesh)[0]
    return np.array([pose.from_parts(R, centre - R @ centre) for R in _about(mesh, [-R for R in cube_rotations()])])


def is_symmetry(T: FloatArray, mesh: Mesh, surface: Surface, same: float = ON_PART_DIAGONALS) -> bool:
    """Whether a motion leaves all of a part about in place, to a share of its size."""
    points, limit = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0], same * surface.diagonal
    return bool(
        np.mean(surface.closest(pose.apply(T, points), within=2.0 * limit).distances <= limit) >= SYMMETRY_FRACTION
    )


def _about(mesh: Mesh, turns: Sequence[FloatArray], ring: Sequence[FloatArray] = ()) -> list[FloatArray]:
    """Orthogonal matrices in the frame of the principal axes and in that of the faces, as those of the part's frame."""
    frames = [principal_axes(*moments(mesh))[1]]
    faces = face_axes(mesh)
    if faces is not None and np.abs(faces.T @ frames[0]).max(axis=0).min() < np.cos(SAME_FRAME_RAD):
        frames.append(faces)
    # The identity and the inversion are the same in every frame.
    maps = [axes @ turn @ axes.T for axes in frames for turn in turns if axes is frames[0] or abs(np.trace(turn)) < 3.0]
    return maps + [frames[0] @ R @ frames[0].T for R in ring]


def _near_maps(mesh: Mesh, surface: Surface, turns: list[FloatArray], same: float) -> FloatArray:
    """Those of some orthogonal matrices that, about the centre, leave most of a part in place, but not all exactly."""
    centre = moments(mesh)[0]
    points = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0]
    maps = np.array([pose.from_parts(R, centre - R @ centre) for R in turns])
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

    # Few points of all rotations in one query; most rotations move most of the part far away.
    rows = np.flatnonzero(
        shares(np.arange(len(maps)), CHECKING_POINTS // SCREENING_POINTS)[0] >= NEAR_SYMMETRY_FRACTION - SCREENING_SLACK
    )
    nearly, exactly = shares(rows, EARLY_DIVISOR)
    unclear = (np.abs(nearly - NEAR_SYMMETRY_FRACTION) <= EARLY_MARGIN) | (exactly >= SYMMETRY_FRACTION - EARLY_MARGIN)
    nearly[unclear], exactly[unclear] = shares(rows[unclear], 1)
    fits = np.flatnonzero((nearly >= NEAR_SYMMETRY_FRACTION) & (exactly < SYMMETRY_FRACTION))
    kept: list[FloatArray] = []
    for T in maps[rows[fits[np.argsort(-nearly[fits], kind="stable")]]]:
        # Both frames may come near to one symmetry.
        if all(angle_of(T[:3, :3] @ other[:3, :3].T) > SAME_MAP_RAD for other in kept):
            kept.append(T)
    return np.array(kept).reshape(-1, 4, 4)

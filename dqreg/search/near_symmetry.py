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
from dqreg.geometry.morton import morton_order
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.sampling import places_on
from dqreg.kernels.threads import ask_clock
from dqreg.rigid import pose, single_pose
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
    ring, frames = Ring.of(mesh, surface), _frames(mesh)
    turns = _about(frames, cube_rotations(), [*ring_steps(ring), *ring_flips(ring)])
    laid = _laid_into_itself(mesh, frames, cube_rotations(), surface.diagonal)
    return _near_maps(mesh, surface, [*_about_centre(mesh, turns), *laid], EXACT_DIAGONALS)


def near_mirrors(mesh: Mesh, surface: Surface) -> FloatArray:
    """Improper rotations that leave most of a part in place, but not all of it, (k, 4, 4).

    About the principal axes through the centre, or where they lay its ends or its largest planes into each other; and
    in planes near the centre, whatever their direction: that of two holes is no axis of the part.
    """
    mirrors, frames = [-R for R in cube_rotations()], _frames(mesh)
    found = [*_about_centre(mesh, _about(frames, mirrors)), *_laid_into_itself(mesh, frames, mirrors, surface.diagonal)]
    return _near_maps(mesh, surface, [*found, *_in_any_plane(mesh, surface)], ON_PART_DIAGONALS)


def mirrors_about(mesh: Mesh) -> FloatArray:
    """All improper rotations about the centre of a part by its principal axes and its faces', (k, 4, 4)."""
    return np.array(_about_centre(mesh, _about(_frames(mesh), [-R for R in cube_rotations()])))


def is_symmetry(T: FloatArray, mesh: Mesh, surface: Surface, same: float = ON_PART_DIAGONALS) -> bool:
    """Whether a motion leaves all of a part about in place, to a share of its size."""
    points, limit = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0], same * surface.diagonal
    return bool(
        np.mean(surface.closest(pose.apply(T, points), within=2.0 * limit).distances <= limit) >= SYMMETRY_FRACTION
    )


def _about(frames: list[FloatArray], turns: Sequence[FloatArray], ring: Sequence[FloatArray] = ()) -> list[FloatArray]:
    """Orthogonal matrices in the frame of the principal axes and in that of the faces, as those of the part's frame."""
    # The identity and the inversion are the same in every frame.
    others = [turn for turn in turns if abs(np.trace(turn)) < 3.0]
    maps = [axes @ np.array(turns if axes is frames[0] else others) @ axes.T for axes in frames]
    return [*np.concatenate(maps), *(frames[0] @ R @ frames[0].T for R in ring)]


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
    return [single_pose.from_parts(R, centre - R @ centre) for R in turns]


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


def _laid_into_itself(mesh: Mesh, frames: list[FloatArray], turns: Sequence[FloatArray], size: float) -> FloatArray:
    """Turns along a part's axes with shifts that lay most of it into itself, (k, 4, 4), where not about its centre.

    Along each axis the shift is that of its centre, of its ends or of its planes. Turns are signed permutations, proper
    or not.
    """
    points, laid, all_turns = places_on(mesh, PROFILE_POINTS, np.random.default_rng(0))[0], [], np.array(turns)
    before = np.abs(all_turns).argmax(axis=2)
    is_flipped = (all_turns.sum(axis=2) < 0.0).astype(np.int64)
    for axes in frames:
        ask_clock()
        centre = moments(mesh)[0] @ axes
        shifts = _shifts_along(mesh, points, axes, BIN_DIAGONALS * size)[before, np.arange(3), is_flipped]
        moves = np.abs(shifts - (centre - all_turns @ centre)).max(axis=1) > SAME_SHIFT_DIAGONALS * size
        laid.append(pose.from_parts(axes @ all_turns[moves] @ axes.T, shifts[moves] @ axes.T))
    return np.concatenate(laid)


def _shifts_along(mesh: Mesh, points: FloatArray, axes: FloatArray, edge: float) -> FloatArray:
    """Shifts after which most of the heights along an axis, or turned over, lie at those along another, (3, 3, 2)."""
    # Of faces alone: a vertex without one may be anywhere.
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    ends, heights = bounds(mesh.vertices[used] @ axes), (points @ axes).T
    low, number = heights.min(axis=1), int(np.ptp(heights, axis=1).max() / edge) + 2

    def counts(heights: FloatArray, axis: IntArray) -> FloatArray:
        """Points in every two bins that follow each other, from the lowest of an axis on, of each row of heights."""
        bins, each = np.floor((heights - low[axis][:, None]) / edge), number + 1
        # Outside of them all is in a bin of its own.
        rows = np.where((bins >= 0) & (bins < number), bins, number).astype(np.int64)
        rows += each * np.arange(len(rows))[:, None]
        found = np.bincount(rows.ravel(), minlength=each * len(rows)).reshape(-1, each)
        # A plane may lie where two bins meet.
        return np.asarray(found[:, 1:-1] + found[:, :-2], dtype=np.float64)

    one, other, is_flipped = np.indices((3, 3, 2)).reshape(3, -1)
    sign, full = 1.0 - 2.0 * is_flipped, counts(heights, np.arange(3))
    # The lower end of the first bin of what is moved.
    first = np.where(is_flipped > 0, -(low[one] + number * edge), low[one])
    shifts = [middle[other] - sign * middle[one] for middle in (moments(mesh)[0] @ axes, 0.5 * np.add(*ends))]
    # The largest sum of products of the counts, and of their squares: the largest planes decide.
    row = one + 3 * is_flipped
    shifts += [
        low[other] - first + edge * _best_steps(full**p, np.concatenate([full, full[:, ::-1]]) ** p, other, row)
        for p in (1, 2)
    ]
    moved = sign[:, None] * heights[one] + np.array(shifts)[:, :, None]
    alike = np.minimum(counts(moved.reshape(-1, len(points)), np.tile(other, 4)).reshape(4, len(one), -1), full[other])
    best = np.array(shifts)[alike.sum(axis=2).argmax(axis=0), np.arange(len(one))]
    return np.where((one == other) & (is_flipped == 0), 0.0, best).reshape(3, 3, 2)


def _best_steps(there: FloatArray, here: FloatArray, one: IntArray, other: IntArray) -> IntArray:
    """Steps of some of the second rows, of k whole numbers, at which their products with some first ones are largest.

    Shapes: one (m,), other (m,).
    """
    count = there.shape[1]
    # Of lengths with large prime factors transforms take several times as long.
    length = 1 << (2 * count - 1).bit_length()
    spectra = [np.fft.rfft(rows, length) for rows in (there, here)]
    products = np.rint(np.fft.irfft(spectra[0][one] * spectra[1].conj()[other], length))
    return np.asarray(products[:, np.arange(1 - count, count)].argmax(axis=1) - count + 1)


def _near_maps(mesh: Mesh, surface: Surface, motions: list[FloatArray], same: float) -> FloatArray:
    """Those of some motions, proper or not, that leave most of a part in place, but not all exactly."""
    points = places_on(mesh, CHECKING_POINTS, np.random.default_rng(0))[0]
    # Each query begins where the one before it ended: in this order that is near.
    order = morton_order(points)
    maps = np.array(motions)
    # What is hardly turned is the part as it is, and no near symmetry.
    chords = np.linalg.norm(maps[:, :3, :3] - np.eye(3), axis=(1, 2))
    is_turned = chords > np.sqrt(8.0) * np.sin(0.5 * SAME_MAP_RAD)
    away, asked = np.zeros((len(maps), len(points))), np.zeros(len(points), dtype=bool)

    def shares(rows: IntArray, every: int) -> tuple[FloatArray, FloatArray]:
        """Shares of every so-manieth point that each of some maps leaves nearly in place, and in place.

        Of maps and points that were asked about before, only the other points are.
        """
        some = order[(order % every == 0) & ~asked[order]]
        limit = 2.0 * NEAR_SYMMETRY_DIAGONALS * surface.diagonal
        away[np.ix_(rows, some)] = distances_at(Poses.of(maps[rows]), points[some], surface, limit) / surface.diagonal
        asked[some] = True
        known = away[rows, ::every]
        return (known <= NEAR_SYMMETRY_DIAGONALS).mean(axis=1), (known <= same).mean(axis=1)

    # Few points of all motions in one query; most move most of the part far away.
    rows = np.flatnonzero(is_turned)
    for count, slack in SCREEN_ROUNDS:
        rows = rows[shares(rows, CHECKING_POINTS // count)[0] >= NEAR_SYMMETRY_FRACTION - slack]
    nearly, exactly = shares(rows, EARLY_DIVISOR)
    unclear = (np.abs(nearly - NEAR_SYMMETRY_FRACTION) <= EARLY_MARGIN) | (exactly >= SYMMETRY_FRACTION - EARLY_MARGIN)
    nearly[unclear], exactly[unclear] = shares(rows[unclear], 1)
    fits = np.flatnonzero((nearly >= NEAR_SYMMETRY_FRACTION) & (exactly < SYMMETRY_FRACTION))
    exact = [*maps[~is_turned], *maps[rows[exactly >= SYMMETRY_FRACTION]]]
    kept: list[FloatArray] = []
    for T in maps[rows[fits[np.argsort(-nearly[fits], kind="stable")]]]:
        # Both frames, and both shifts, may come near to one symmetry.
        if all(angle_of(T[:3, :3] @ other[:3, :3].T) > SAME_MAP_RAD for other in [*exact, *kept]):
            kept.append(T)
    return np.array(kept).reshape(-1, 4, 4)

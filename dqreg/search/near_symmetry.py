"""Near symmetries: poses of a part, or of its mirror image, that only a small feature tells from the right one.

An initial pose that was given decides between them before any feature does. So the near symmetries of the result are
tried, and those that explain the scan as well, or better, are reported. A left-hand part scanned for a right-hand one,
or a sensor whose frame is left-handed, fits in all but a few features: its misfit may be no more than clutter leaves,
but it vanishes in the mirror.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, Scan, Surface, sample_mesh
from dqreg.geometry.normals import sample_rows
from dqreg.rigid import pose
from dqreg.rigid.rotations import angle_of
from dqreg.search.axes import cube_rotations, face_axes, moments, principal_axes
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import refine
from dqreg.search.rings import ring_flips, ring_steps
from dqreg.search.scoring import PoseScores, mean_gains, score_poses
from dqreg.search.symmetry import MOST, NEARLY, SAME

# A motion that leaves this fraction of the part in place is a symmetry, which no scan can decide; in place to so much
# of the size, it is none to a scan with little noise.
ALL, EXACT = 0.998, 1e-4
# Points that check a motion, those of them that screen it, and the fraction that these may lack.
CHECKED, SCREENED, SLACK = 2_000, 100, 0.2
# Points that screen a flipped pose, and the mean gain that it may lack by them: few first, which most flips fail.
# Reach of their gain, in sizes.
SCREENS, REACH = ((60, 0.3), (300, 0.15)), 0.02
# Points that refine, points that score and steps of the refinement: few of all poses, and more of those that are not
# clearly worse by them. After four steps scores differ from those after six by a third of their standard error at most.
# Mirrors need more: none is a pose that the loop has led to. On one part of 30 six steps ended where nothing is gained.
FIRST, LAST, MIRRORED = (300, 1_000, 4), (1_000, 5_000, 6), (1_000, 5_000, 12)
# Standard errors of the mean log-likelihood beyond which a pose is clearly worse. Six motions fitted to so few points
# cost the others three log-likelihoods in the mean, over that number; twice of it in one case of sixteen.
CLEARLY, FITTED = 2.5, 6.0 / FIRST[0]
# First and last kernel scale of the refinement, in sizes.
WIDE, NARROW = 6e-3, 1e-3
# Points, steps and first kernel scale of mirrors that may leave little of a part in place.
FAR = (300, 1_000, 10), 5e-2
# Flips within so much mean log-likelihood are equally likely: half of what the notch of a block costs that is 0.7 % of
# its surface. What only a smaller fraction of the points favours is no decision.
EQUALLY_LIKELY = 0.015
# Axes of the faces that are this near to the principal ones are the same.
SAME_FRAME_RAD = np.deg2rad(1.0)
# Maps that differ by less are one: the refinement on the scan leads to the same pose from both.
SAME_MAP_RAD = np.deg2rad(5.0)


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


def flipped_poses(
    T_target_source: FloatArray, flips: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> list[tuple[FloatArray, float]]:
    """Flips, (k, 4, 4), of a pose that explain the scan as well as it does, or better, each with its rms."""
    flips = _worth_refining(T_target_source, flips, scan, surface) if len(flips) else flips
    if not len(flips):
        return []
    scores = _refined(T_target_source, flips, scan, surface, limit, floor, FIRST)[1]
    flips = _not_clearly_worse(flips, scores, 0)
    if not len(flips):
        return []
    poses, scores = _refined(T_target_source, flips, scan, surface, limit, floor)
    rms = np.sqrt((scores.distances**2).mean(axis=1))
    likely = np.flatnonzero(scores.as_likely(0, EQUALLY_LIKELY)[1:]) + 1
    return [(pose.from_parts(poses.R[k], poses.t[k]), float(rms[k])) for k in likely]


def gain_of_mirror(
    T_target_source: FloatArray, mirrors: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> float:
    """Mean log-likelihood that the scan gains by the best of some mirrors, (k, 4, 4)."""
    if not len(mirrors):
        return -np.inf
    scores = _refined(T_target_source, mirrors, scan, surface, limit, floor, FIRST)[1]
    best = 1 + int(scores.means[1:].argmax())
    if not len(_not_clearly_worse(mirrors, scores, 0)):
        return float(scores.means[best] - scores.means[0])
    mirrors = _not_clearly_worse(mirrors, scores, best)
    means = _refined(T_target_source, mirrors, scan, surface, limit, floor, MIRRORED)[1].means
    return float(means[1:].max() - means[0])


def far_mirrors(
    T_target_source: FloatArray, mirrors: FloatArray, scan: Scan, surface: Surface, limit: float, floor: float
) -> FloatArray:
    """Mirrors that explain the scan clearly better than its pose, once the scan has been refined under each, (k, 4, 4).

    What is no mirror image of itself is drawn aside in its mirror, so they are refined from farther off.
    """
    poses, scores = _refined(T_target_source, mirrors, scan, surface, limit, floor, FAR[0], FAR[1])
    deficit, error = scores.deficit(0)
    rows = np.flatnonzero(-deficit > EQUALLY_LIKELY + CLEARLY * error)
    return np.asarray(poses.matrices[rows] @ pose.inverse(T_target_source))


def _near_maps(mesh: Mesh, surface: Surface, turns: list[FloatArray], same: float) -> FloatArray:
    """Those of some orthogonal matrices that, about the centre, leave most of a part in place, but not all exactly."""
    centre = moments(mesh)[0]
    points = sample_mesh(mesh, CHECKED, np.random.default_rng(0)).points
    maps = [pose.from_parts(R, centre - R @ centre) for R in turns]
    # Few points of all rotations in one query; most rotations move most of the part far away.
    few = Poses.of(np.array(maps)).apply(points[:: CHECKED // SCREENED]).reshape(-1, 3)
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


def _refined(
    T_target_source: FloatArray,
    maps: FloatArray,
    scan: Scan,
    surface: Surface,
    limit: float,
    floor: float,
    points: tuple[int, int, int] = LAST,
    wide: float = WIDE,
) -> tuple[Poses, PoseScores]:
    """A pose, then the pose followed by each of some motions, (k, 4, 4), and refined; and the scores of all."""
    sample = OrientedPoints.on_faces(scan.points[sample_rows(len(scan), points[0])])
    widths = np.geomspace(wide, NARROW, points[2]) * surface.diagonal
    poses = Poses.of(T_target_source[None]) + refine(Poses.of(maps @ T_target_source), sample, surface, widths)
    return poses, score_poses(poses, scan.points[sample_rows(len(scan), points[1])], surface, limit, floor)


def _not_clearly_worse(maps: FloatArray, scores: PoseScores, best: int) -> FloatArray:
    """Those of some motions, (k, 4, 4), that few points leave about as likely as one of the poses scored."""
    deficit, error = scores.deficit(best)
    return np.asarray(maps[(deficit <= EQUALLY_LIKELY + FITTED + CLEARLY * error)[1:]])


def _worth_refining(T_target_source: FloatArray, flips: FloatArray, scan: Scan, surface: Surface) -> FloatArray:
    # A flip that leaves one point in six off the part is nowhere near as likely, whatever its refinement mends.
    for count, lacks in SCREENS:
        if len(flips):
            few = scan.points[sample_rows(len(scan), count)]
            moved = np.concatenate([pose.apply(T, few) for T in (T_target_source, *(flips @ T_target_source))])
            gains = mean_gains(moved, surface, REACH, len(flips) + 1)
            flips = flips[gains[1:] >= gains[0] - lacks]
    return flips

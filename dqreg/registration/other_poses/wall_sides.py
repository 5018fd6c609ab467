"""Poses that put a scan onto the other sides of thin walls: a sheet without normals fits inside and outside alike.

Where one leg of a folded sheet lies on its wrong side and the others on the right one, the few points at the fold lie
off the part; nothing else tells, and the loop stays there. So the scan is moved by the thickness along what its faces
look to, one leg or several at once, refined, and all points are asked. The legs that a scan shows may be others of the
part too, after a half-turn as a rule: unless an initial pose decides, those are asked alike.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import NamedTuple

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.icp import Correspondences
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.registration.fit.displacement import displacement_between, offset_from_start
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.near_places import plane_turns
from dqreg.registration.other_poses.rivals import JUDGING_POINTS, NO_POSES
from dqreg.registration.other_poses.slides import losses_and_scatter, losses_at
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose, twist
from dqreg.search.near_symmetry import is_symmetry
from dqreg.search.poses import Poses
from dqreg.search.refine import Refinement, refined_on
from dqreg.search.thin_walls import ThinWalls
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD
from dqreg.trust.patch_tests import INLIER_SIGMAS

# Points whose faces are looked at, and inliers among them without which nothing is asked.
COMPARED_POINTS, MIN_INLIERS = 2_000, 10
SCREENING_POINTS = 300
# Points that refine, points that are asked then and steps of the refinement: few of all poses, and more of those left.
FIRST_REFINEMENT = (400, 1_000, 3)
LAST_REFINEMENT = (1_000, JUDGING_POINTS, 4)
# Inliers look along a wall's direction within this; so large a share of them makes it one of the scan's.
WALL_NORMAL_RAD, MIN_WALL_SHARE = np.deg2rad(15.0), 0.02
# Where so many times as many look the other way both sides were scanned, unless the distances are so many times the
# noise.
OTHER_SIDE_RATIO, ACROSS_NOISE_RATIO = 0.25, 1.15
# Directions that are combined: the largest ones.
MAX_DIRECTIONS = 6
# A motion fits the sides of walls within this.
IN_PLACE_THICKNESSES = 0.25
# Share of the points that a motion may take off the part, more than it takes onto it, before it is refined.
MAX_LEAVING_SHARE = 0.1
# Damping of motions that no point holds, relative to the mean diagonal of the normal equations.
DAMPING = 1e-4
# Planes of the part that are found may be those of either side of a wall, or lie between them: so the scan is displaced
# by these shares of the thickness, along directions that leave so much beside those before.
DISPLACEMENTS_THICKNESSES = (0.0, -0.5, 0.5, -1.0, 1.0)
NEW_DIRECTION_SINE = 0.3
# Log-likelihood that a pose refined on some points may lose beyond what tells poses apart, by few points and by many:
# six motions fitted to one point in ten lose thirty in the mean.
REFINEMENT_LOG_LIKELIHOODS = (30.0, 60.0)
# Standard deviations of chance that what tells two poses apart has to come to: of noise that is large against the
# thickness few points beyond the middle of a wall decide, and came to 3.3 of them at a wrong pose, to 4 and more at
# 62 right ones.
CHANCE_SIGMAS = 3.5
# Poses that are kept, the best first; better poses that follow one another.
MAX_POSES, MAX_ROUNDS = 8, 2


@dataclasses.dataclass(frozen=True, eq=False)
class _Rivals:
    """Fits to poses on other sides of thin walls."""

    fits: tuple[Fit, ...] = ()
    losses: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(0))  # Log-likelihood of all points, (k,)
    scatter: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(0))  # Of that by chance, (k,)

    @property
    def equal(self) -> IntArray:
        """Which explain the scan as well as the pose."""
        return np.flatnonzero(self.losses < np.maximum(CONSTRAINT_LOG_LIKELIHOOD, CHANCE_SIGMAS * self.scatter))


WALL_SIDES: Key[_Rivals] = Key()


def on_best_sides(fit: Fit) -> Fit:
    """The fit, or that to a pose on other sides of thin walls that explains the scan better.

    Of equal poses, that near to an initial one.
    """
    if not fit.may_be_moved:
        return fit
    for _ in range(MAX_ROUNDS):
        found = _rivals(fit)
        losses = found.losses
        if losses.min(initial=0.0) < -CONSTRAINT_LOG_LIKELIHOOD:
            fit = found.fits[int(losses.argmin())]
            continue
        meant = [k for k in found.equal if _is_meant(fit, found.fits[k].T_target_source)]
        if not meant or _is_meant(fit, fit.T_target_source):
            break
        fit = found.fits[min(meant, key=lambda k: float(losses[k]))]
    return fit


def equal_sides(fit: Fit) -> FloatArray:
    """Poses on other sides of thin walls that explain the scan as well, (k, 4, 4)."""
    found = _rivals(fit)
    return np.array([found.fits[k].T_target_source for k in found.equal]).reshape(-1, 4, 4)


def rivals_of(fit: Fit) -> tuple[Fit, ...]:
    """Fits on other sides of thin walls that explain the scan about as well, or better."""
    return _rivals(fit).fits


def _rivals(fit: Fit) -> _Rivals:
    return fit.derived.once(WALL_SIDES, lambda: _compared(fit))


def _compared(fit: Fit) -> _Rivals:
    poses, least = _moved(fit)
    stages = (FIRST_REFINEMENT, LAST_REFINEMENT)
    for (points, asked, steps), roughly in zip(stages, REFINEMENT_LOG_LIKELIHOODS, strict=True):
        if not len(poses):
            return _Rivals()
        poses = _refined(fit, poses, least, points, steps)
        losses = losses_at(fit, np.concatenate([fit.T_target_source[None], poses]), asked)
        order = np.argsort(losses, kind="stable")
        poses = _other_places(fit, poses[order[losses[order] < CONSTRAINT_LOG_LIKELIHOOD + roughly]], least)[:MAX_POSES]
    return _ended(fit, poses, 0.5 * least / fit.prepared.surface.diagonal) if len(poses) else _Rivals()


def _ended(fit: Fit, poses: FloatArray, near: float) -> _Rivals:
    """Rivals at some poses, (k, 4, 4), or, where all points say so, where the loop ends that begins there and stays."""
    ends: list[Fit] = []
    for T in poses:
        there, other = fit.at(T), fit.resumed(T, fit.run.mixture.scale)
        # The loop may lead back to where it was; and what few points hold it may draw aside.
        stays = other.found and displacement_between(fit, T, other.T_target_source) < near
        ends += [other if stays else there, there]
    losses, scatter = losses_and_scatter(fit, np.stack([fit.T_target_source, *(end.T_target_source for end in ends)]))
    rows = np.arange(0, len(ends), 2) + losses.reshape(-1, 2).argmin(axis=1)
    return _Rivals(tuple(ends[k] for k in rows), losses[rows], scatter[rows])


def _moved(fit: Fit) -> tuple[FloatArray, float]:
    """The pose after motions onto other sides of walls that leave most of the scan on the part; least thickness.

    Those in place, and, where no initial pose decides, those that lay its planes into others of the part.
    """
    walls = _walls(fit)
    pairs = fit.evenly_asked() if len(walls.thickness) else None
    if pairs is None:
        return NO_POSES, 0.0
    near = np.flatnonzero(pairs.distances <= INLIER_SIGMAS * fit.run.mixture.scale)
    near = near[sample_rows(len(near), COMPARED_POINTS)]
    if len(near) < MIN_INLIERS:
        return NO_POSES, 0.0
    least = float(walls.thickness.min())
    within = max(INLIER_SIGMAS * _width(fit), IN_PLACE_THICKNESSES * least)
    points = _beside(fit, pairs, least, within)
    poses = _on_other_sides(fit, walls, pairs, near[sample_rows(len(near), FIRST_REFINEMENT[1])], within)
    if not _is_meant(fit, fit.T_target_source):
        poses = np.concatenate([poses, _in_other_planes(fit, walls, points, within)])
    return _staying(fit, poses, points, within), least


def _is_meant(fit: Fit, T: FloatArray) -> bool:
    """Whether a pose is near an initial one that was given."""
    given = fit.problem.start
    return given is not None and offset_from_start(fit, T, fit.problem.to_centred(given)) <= 1.0


def _on_other_sides(fit: Fit, walls: ThinWalls, pairs: Correspondences, rows: IntArray, within: float) -> FloatArray:
    """The pose after motions that lay what some of its pairs put on sides of walls on the other ones, (k, 4, 4)."""
    normals = np.take(pairs.closest.normals, rows, axis=0)
    along = normals @ walls.normals.T
    on = (along > np.cos(WALL_NORMAL_RAD)) & (along == along.max(axis=1, keepdims=True))
    counts = np.count_nonzero(on, axis=0)
    opposed = counts @ (walls.normals @ walls.normals.T < -np.cos(WALL_NORMAL_RAD))
    # No other place fits both sides; a leg that lies across its wall lies there by more than its noise.
    lies_across = fit.run.mixture.scale > ACROSS_NOISE_RATIO * _width(fit)
    is_one_sided = lies_across | (opposed <= OTHER_SIDE_RATIO * counts)
    kept = np.flatnonzero((counts > MIN_WALL_SHARE * len(rows)) & is_one_sided)
    kept = kept[np.argsort(-counts[kept], kind="stable")][:MAX_DIRECTIONS]
    if not len(kept):
        return NO_POSES
    chosen = np.array(list(itertools.product([0.0, 1.0], repeat=len(kept)))[1:])
    # Behind a face by its thickness is the other side.
    heights = pairs.point_to_plane[rows] + (chosen * walls.thickness[kept]) @ on[:, kept].T
    return _down(np.take(pairs.moved, rows, axis=0), normals, heights, within) @ fit.T_target_source


def _down(points: FloatArray, normals: FloatArray, heights: FloatArray, within: float) -> FloatArray:
    """Motions, (k, 4, 4), that take points, (n, 3), down to planes, each by some heights, (m, n), where most come near.

    One step is enough: they are as small as walls are thin. A rotation lays a leg down that lies across its wall.
    """
    middle = points.mean(axis=0)
    arms = points - middle
    lever = max(float(np.sqrt(row_dots(arms, arms).mean())), np.finfo(float).tiny)
    A = np.concatenate([np.cross(arms / lever, normals), normals], axis=1)
    H = A.T @ A
    steps = -np.linalg.solve(H + DAMPING * np.trace(H) / 6.0 * np.eye(6), A.T @ heights.T).T
    steps = steps[np.mean(np.abs(heights + steps @ A.T) <= within, axis=1) >= 1.0 - MAX_LEAVING_SHARE]
    steps[:, :3] /= lever
    there, back = (pose.from_parts(np.eye(3), sign * middle) for sign in (1.0, -1.0))
    return np.asarray(there @ twist.exp(steps) @ back).reshape(-1, 4, 4)


def _in_other_planes(fit: Fit, walls: ThinWalls, points: _Beside, within: float) -> FloatArray:
    """Poses, (k, 4, 4), that lay the planes of a scan, of which points are given, into others of the part."""
    poses = _staying(fit, plane_turns(fit) @ fit.T_target_source, points, float(walls.thickness.max()) + within)
    axes: list[FloatArray] = []
    for normal, thickness in zip(walls.normals, walls.thickness, strict=True):
        rest = normal - sum((normal @ axis) * axis for axis in axes)
        if (length := float(np.linalg.norm(rest))) > NEW_DIRECTION_SINE:
            axes.append(rest / length)
            shifted = np.repeat(poses, len(DISPLACEMENTS_THICKNESSES), axis=0)
            shifted[:, :3, 3] += np.tile(np.outer(DISPLACEMENTS_THICKNESSES, thickness * normal), (len(poses), 1))
            poses = shifted
    return _staying(fit, poses, points, within)


class _Beside(NamedTuple):
    """Points on a part and no farther off than a wall is thick, and the share of them that is to be on it."""

    points: FloatArray  # (n, 3)
    least: float


def _beside(fit: Fit, pairs: Correspondences, thickness: float, within: float) -> _Beside:
    """Those at a pose: where the part is deformed some are off it at either side of a wall, and others at the other."""
    near = np.flatnonzero(pairs.distances <= thickness + INLIER_SIGMAS * fit.run.mixture.scale)
    near = near[sample_rows(len(near), SCREENING_POINTS)]
    on_part = float(np.mean(pairs.distances[near] <= within))
    return _Beside(np.take(pairs.scan.points, near, axis=0), on_part - MAX_LEAVING_SHARE)


def _staying(fit: Fit, poses: FloatArray, beside: _Beside, within: float) -> FloatArray:
    """Poses, (k, 4, 4), at which about as many points as at the fit's lie within a distance of the part."""
    placed = Poses.of(poses).apply(beside.points).reshape(-1, 3)
    away = fit.prepared.surface.closest(placed, within=2.0 * within).distances
    on_part = np.mean(away.reshape(len(poses), len(beside.points)) <= within, axis=1)
    return np.asarray(poses[on_part >= beside.least])


def _width(fit: Fit) -> float:
    """Width of the scan's distances from the part: where it lies on both sides of a wall, what its own noise says."""
    scan, surface = fit.prepared.scan, fit.prepared.surface
    return min(fit.run.mixture.scale, max(noise_on(scan, surface), fit.floor))


def may_confuse_sides(fit: Fit) -> bool:
    """Whether the scan may show another side of a thin wall than that on which it lies, whatever was asked."""
    return len(_confused(fit).thickness) > 0


def _walls(fit: Fit) -> ThinWalls:
    """Thin walls whose sides the scan may confuse, where other poses are asked for."""
    is_asked = fit.found and not (fit.constraints.any or fit.problem.watch.is_over or fit.is_late)
    return _confused(fit) if is_asked else ThinWalls.none()


def _confused(fit: Fit) -> ThinWalls:
    """Thin walls whose sides the scan may confuse: with normals of its own, or seen from known places, it does not."""
    target, surface = fit.problem.target, fit.prepared.surface
    is_known = fit.run.pairs.same_sign or (fit.problem.viewpoints is not None and fit.prepared.scan.oriented)
    if is_known or not isinstance(target.geometry, Mesh) or not isinstance(surface, MeshSurface):
        return ThinWalls.none()
    walls = target.thin_walls
    # Thinner ones are within the noise.
    clear = walls.thickness > INLIER_SIGMAS * _width(fit)
    return ThinWalls(walls.normals[clear], walls.thickness[clear])


def _other_places(fit: Fit, poses: FloatArray, least: float) -> FloatArray:
    """Poses, (k, 4, 4), each once, without those that leave the scan, or all of the part, where it is at the fit."""
    surface, part, offset = fit.prepared.surface, fit.problem.target.geometry, IN_PLACE_THICKNESSES * least
    middle, share = fit.prepared.scan.points.mean(axis=0), offset / surface.diagonal
    poses = poses[Poses.of(poses).distinct(middle, share, offset, len(poses))]
    back = pose.inverse(fit.T_target_source)
    assert isinstance(part, Mesh)

    def is_other(T: FloatArray) -> bool:
        is_apart = displacement_between(fit, T, fit.T_target_source) > 2.0 * share
        return is_apart and not is_symmetry(T @ back, part, surface, share)

    return poses[np.flatnonzero([is_other(T) for T in poses])]


def _refined(fit: Fit, poses: FloatArray, least: float, points: int, steps: int) -> FloatArray:
    # From a half to the next: at one that is much narrower nothing holds what a wider one drew to where a part bends.
    widest, width = 0.5 * least, _width(fit)
    how = Refinement(widest, max(steps, math.ceil(math.log2(widest / width)) + 1), points, width)
    return refined_on(poses, fit.prepared.scan.points, fit.prepared.surface, how, unit=1.0)

"""Poses that put a scan onto the other sides of thin walls: a sheet without normals fits inside and outside alike.

Where one leg of a folded sheet lies on its wrong side and the others on the right one, the few points at the fold lie
off the part; nothing else tells, and the loop stays there. So the scan is moved by the thickness along what its faces
look to, one leg or several at once, refined, and all points are asked.
"""

from __future__ import annotations

import itertools

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.normals import sample_rows
from dqreg.registration.derived import Key
from dqreg.registration.displacement import displacement_between
from dqreg.registration.fit import Fit
from dqreg.registration.rivals import JUDGES, NO_POSES
from dqreg.registration.slides import losses_at
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import refine
from dqreg.search.thin_walls import ThinWalls
from dqreg.trust.limits import HOLDS
from dqreg.trust.patch_tests import ON

# Points whose faces are looked at, and points that screen a pose.
LOOKED_AT, SCREENING = 2_000, 300
# Points that refine, points that are asked then and steps of the refinement: few of all poses, and more of those left.
FIRST, LAST = (400, 1_000, 3), (1_000, JUDGES, 4)
# Inliers look along a wall's direction within this; so large a share of them makes it one of the scan's, and where so
# many times as many look the other way both sides were scanned, which no other place fits.
ALONG_RAD, SHARE, OTHER_WAY = np.deg2rad(15.0), 0.02, 0.25
# Directions that are combined: the largest of the scan. A motion fits them within this share of the thickness.
DIRECTIONS, FITS = 4, 0.25
# Share of the points that a motion may take off the part before it is refined.
MAY_LEAVE = 0.1
# Log-likelihood that a pose refined on some points may lose beyond what tells poses apart, by few points and by many:
# six motions fitted to one point in ten lose thirty in the mean.
ROUGHLY = (30.0, 60.0)
# Better poses that follow one another.
ROUNDS = 2

WALL_SIDES: Key[tuple[list[Fit], FloatArray]] = Key()


def on_best_sides(fit: Fit) -> Fit:
    """The fit, or that to a pose on other sides of thin walls that explains the scan better."""
    if fit.problem.options.method != "auto":
        return fit
    for _ in range(ROUNDS):
        rivals, losses = _rivals(fit)
        if not len(rivals) or not losses.min() < -HOLDS:
            break
        fit = rivals[int(losses.argmin())]
    return fit


def equal_sides(fit: Fit) -> FloatArray:
    """Poses on other sides of thin walls that explain the scan as well, (k, 4, 4)."""
    rivals, losses = _rivals(fit)
    return np.array(
        [rival.T_target_source for rival, loss in zip(rivals, losses, strict=True) if loss < HOLDS]
    ).reshape(-1, 4, 4)


def _rivals(fit: Fit) -> tuple[list[Fit], FloatArray]:
    """Fits on other sides of thin walls, and the log-likelihood, (k,), that all points together lose there."""
    return fit.derived.once(WALL_SIDES, lambda: _compared(fit))


def _compared(fit: Fit) -> tuple[list[Fit], FloatArray]:
    poses, least = _moved(fit)
    for (points, asked, steps), roughly in zip((FIRST, LAST), ROUGHLY, strict=True):
        if not len(poses):
            return [], np.zeros(0)
        poses = _refined(fit, poses, least, points, steps)
        losses = losses_at(fit, np.concatenate([fit.T_target_source[None], poses]), asked)
        poses = poses[losses < HOLDS + roughly]
    rivals, near = [], 0.5 * least / fit.prepared.surface.diagonal
    for T in poses:
        there, other = fit.at(T), fit.resumed(T, fit.run.mixture.scale)
        # The loop may lead back to where it was: then the pose of the refinement stays.
        stays = other.found and displacement_between(fit, T, other.T_target_source) < near
        rivals.append(other if stays else there)
    if not rivals:
        return [], np.zeros(0)
    return rivals, losses_at(fit, np.stack([fit.T_target_source, *(rival.T_target_source for rival in rivals)]))


def _moved(fit: Fit) -> tuple[FloatArray, float]:
    """The pose after motions onto the other sides of walls that leave most of the scan on the part; least thickness."""
    walls = _walls(fit)
    pairs = fit.evenly_asked() if len(walls.thickness) else None
    if pairs is None:
        return NO_POSES, 0.0
    near = np.flatnonzero(pairs.distances <= ON * fit.run.mixture.scale)
    near = near[sample_rows(len(near), LOOKED_AT)]
    along = np.take(pairs.closest.normals, near, axis=0) @ walls.normals.T
    counts = np.count_nonzero(along > np.cos(ALONG_RAD), axis=0)
    opposed = np.count_nonzero(along < -np.cos(ALONG_RAD), axis=0)
    kept = np.flatnonzero((counts > SHARE * len(near)) & (opposed <= OTHER_WAY * counts))
    kept = kept[np.argsort(-counts[kept], kind="stable")][:DIRECTIONS]
    if not len(kept):
        return NO_POSES, 0.0
    shifts, least = _shifts(walls.normals[kept], walls.thickness[kept]), float(walls.thickness[kept].min())
    points = np.take(pairs.moved, near[sample_rows(len(near), SCREENING)], axis=0)
    within = max(ON * fit.run.mixture.scale, FITS * least)
    away = fit.prepared.surface.closest((points + shifts[:, None]).reshape(-1, 3), within=2.0 * within).distances
    shifts = shifts[np.mean(away.reshape(len(shifts), -1) <= within, axis=1) >= 1.0 - MAY_LEAVE]
    poses = np.tile(fit.T_target_source, (len(shifts), 1, 1))
    poses[:, :3, 3] += shifts
    return poses, least


def _walls(fit: Fit) -> ThinWalls:
    """Thin walls whose sides the scan may confuse: with normals of its own, or seen from known places, it does not."""
    target, surface, none = fit.problem.target, fit.prepared.surface, ThinWalls.none()
    is_known = fit.run.pairs.same_sign or fit.problem.viewpoints is not None
    if not fit.found or is_known or fit.constraints.any or fit.problem.watch.is_over or fit.is_late:
        return none
    if not isinstance(target.geometry, Mesh) or not isinstance(surface, MeshSurface):
        return none
    walls = target.thin_walls
    # Thinner ones are within the noise.
    clear = walls.thickness > ON * fit.run.mixture.scale
    return ThinWalls(walls.normals[clear], walls.thickness[clear])


def _shifts(normals: FloatArray, thickness: FloatArray) -> FloatArray:
    """Translations, (k, 3), by the thickness inwards along one direction or several, and along no other of them."""
    found = []
    for chosen in itertools.product([0.0, 1.0], repeat=len(normals)):
        wanted = -np.array(chosen) * thickness
        shift = np.linalg.lstsq(normals, wanted, rcond=0.1)[0]
        if any(chosen) and np.abs(normals @ shift - wanted).max() <= FITS * thickness.min():
            found.append(shift)
    return np.array(found).reshape(-1, 3)


def _refined(fit: Fit, poses: FloatArray, least: float, points: int, steps: int) -> FloatArray:
    scan = fit.prepared.scan
    sample = OrientedPoints.on_faces(scan.points[sample_rows(len(scan), points)])
    widths = np.geomspace(0.5 * least, fit.run.mixture.scale, steps)
    return refine(Poses.of(poses), sample, fit.prepared.surface, widths).matrices

"""Normals and noise of a scan, from its neighbourhoods and what they would be on the target.

A neighbourhood that spans an edge, that lies on few rings of a LiDAR or that is noisy has another normal than the face
its point is closest to, at the right pose too. The closest points of its members, the feet, show what it would be on
the target: at a right pose they lie in the same plane, where faces cross they do not. Where the feet lie on a line, the
neighbourhood is of a single profile: its plane is that of the laser, and says nothing of a face or of the noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.cells import Cells
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NORMAL_NEIGHBOURS, fit_planes_among, sample_rows
from dqreg.geometry.vector_rows import nonzero_rows, row_dots, second_moment
from dqreg.rigid import pose

# Neighbourhoods that are looked at; those flatter than this, in their extent, have a normal worth comparing.
COMPARED_NEIGHBOURHOODS, MAX_ROUGHNESS = 1_500, 0.4
# Normals farther apart than this are of different faces; one that noise alone tilts by this much over the spread of its
# feet is no witness.
DISAGREEING_COS, MAX_NOISE_TILT_RAD = np.cos(np.deg2rad(35.0)), np.deg2rad(7.0)
# Neighbours that are of several profiles: what they leave of their planes is an upper estimate of the noise.
MANY = 3 * NORMAL_NEIGHBOURS
# Fewer of a single profile are those at rims.
PROFILES = 0.1
# Thickness of a scan in its length: what is thinner may be a single profile, whose neighbourhoods turn freely about it.
FLAT = 0.02
# Neighbourhoods without which no noise is estimated; and its quantile: in others there is an edge.
MIN_NEIGHBOURHOODS, NOISE_QUANTILE = 50, 0.3
# Points of a cell from which on its normal is another witness than those of its points, where that share of the cells
# beside the other cloud is smooth.
MIN_CELL_POINTS, SMOOTH_CELL_SHARE = 4.0, 0.25


@dataclasses.dataclass(frozen=True)
class Neighbourhoods:
    """What the neighbourhoods on the target say; NaN where too few are there, or where they are of a single profile."""

    apart: float = np.nan  # Share of those whose normal is neither that of the target nor that of their feet
    noise: float = np.nan  # Distance of their points from their own plane, root mean square, where their feet are flat

    @staticmethod
    def of(points: FloatArray, feet: FloatArray, normals: FloatArray, on: BoolArray, width: float) -> Neighbourhoods:
        """Those of points on a target that they are from by so many lengths, one sigma.

        Shapes: points, feet (their closest points), normals (the target's there) (n, 3), on (n,).
        """
        rows = np.flatnonzero(on)
        if len(rows) <= NORMAL_NEIGHBOURS or is_flat(points[rows]):
            return Neighbourhoods()
        rows = rows[sample_rows(len(rows), COMPARED_NEIGHBOURHOODS)]
        tree = NeighbourTree(points)
        indices, _ = tree.nearest(points[rows], NORMAL_NEIGHBOURS)
        own, there = fit_planes_among(points, indices), fit_planes_among(feet, indices)
        with np.errstate(divide="ignore", invalid="ignore"):
            smooth = np.nan_to_num(own.residuals / np.sqrt(own.lever), nan=np.inf) < MAX_ROUGHNESS
        wide = fit_planes_among(points, tree.nearest(points[rows], min(MANY, len(points)))[0])
        noise = min(width, float(np.quantile(wide.residuals[np.isfinite(wide.residuals)], NOISE_QUANTILE)))
        spans = noise / np.sqrt(NORMAL_NEIGHBOURS * np.maximum(there.lever, np.finfo(float).tiny)) < MAX_NOISE_TILT_RAD
        spans |= np.mean(spans) >= 1.0 - PROFILES
        quiet = spans & (there.residuals <= width)
        noise = (
            float(np.quantile(own.residuals[quiet], NOISE_QUANTILE))
            if np.count_nonzero(quiet) >= MIN_NEIGHBOURHOODS
            else np.nan
        )
        counted = smooth & spans & nonzero_rows(normals[rows])
        if not counted.any():
            return Neighbourhoods(noise=noise)
        scan = np.nan_to_num(own.normals[counted])
        others = normals[rows][counted], np.nan_to_num(there.normals[counted])
        apart = [np.abs(row_dots(scan, other)) < DISAGREEING_COS for other in others]
        return Neighbourhoods(float(np.mean(apart[0] & apart[1])), noise)


def apart_in_cells(source: FloatArray, target: FloatArray, T_target_source: FloatArray, width: float) -> float:
    """Share of cells of two clouds whose normals disagree, as wide as inliers are apart; NaN where too few have one.

    Where points are closer together than their noise is wide, or a depth camera rounds them to terraces, planes of the
    nearest ones turn freely; those of the means of cells do not. Shapes: (n, 3), (m, 3), (4, 4).
    """
    moves, stands = (Cells.of(PointCloud(points), width) for points in (source, target))
    if min(np.mean(cells.counts) for cells in (moves, stands)) < MIN_CELL_POINTS:
        return np.nan
    moved = pose.apply(T_target_source, moves.points)
    nearest, distances = NeighbourTree(stands.points).nearest(moved, 1)
    there = nearest[:, 0]
    own, other = moves.planes().fits, stands.planes().fits.taken(there)
    # Means of cells stand beside each other, but for noise in one plane.
    aside = np.abs(row_dots(moved - stands.points[there], np.nan_to_num(other.normals)))
    near = (distances[:, 0] <= 2.0 * width) & (aside <= width)
    with np.errstate(divide="ignore", invalid="ignore"):
        rough = [fits.residuals / np.sqrt(fits.lever) for fits in (own, other)]
    compared = near & (rough[0] < MAX_ROUGHNESS) & (rough[1] < MAX_ROUGHNESS)
    if np.count_nonzero(compared) < max(MIN_NEIGHBOURHOODS, SMOOTH_CELL_SHARE * np.count_nonzero(near)):
        return np.nan
    cosines = row_dots(own.normals, other.normals @ T_target_source[:3, :3])
    return float(np.mean(np.abs(cosines[compared]) < DISAGREEING_COS))


def is_flat(points: FloatArray) -> bool:
    """Whether points, (n, 3), lie in one plane: a single profile, or one face, is a weak witness of a pose."""
    arms = np.ascontiguousarray(points.T)
    arms -= arms.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(second_moment(arms))
    return bool(values[0] < FLAT**2 * values[2])

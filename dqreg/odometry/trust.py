"""How far a pose of the odometry may be trusted: a covariance from clusters of residuals, and the verdict's doubts.

A wall that the map holds two centimetres off pulls all of its points the same way; counted as independent, they would
promise a tenth of a millimetre. So residuals are summed over blocks of space, and only blocks count as independent:
``H^-1 (sum over blocks of g_b g_b^T) H^-1`` with the blocks' gradients g_b and the Hessian H of the point-to-plane
cost (Liang and Zeger 1986, "cluster-robust").
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.icp import Run
from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import pose
from dqreg.trust import Information, covariance_of, information_of

# Edge of a block, in voxels of the map.
BLOCK = 5.0
# Information that is not so many times what the noise of the normals alone would feign holds nothing: on real frames
# all six motions reach 15, the way along a corridor 1.
FEIGNED = 3.0


@dataclasses.dataclass(frozen=True)
class Held:
    """What the matches of a frame say about its pose.

    Attributes
    ----------
    information : Information
        Of the six motions, about the sensor.
    covariance : ndarray, (6, 6)
        Of a left increment about the sensor's place, in the map's frame; NaN where a motion is free.
    """

    information: Information
    covariance: FloatArray


def held_by(run: Run, surface: MapSurface, reach: float, voxel_size: float) -> Held:
    """Information and covariance at the end of a run.

    Parameters
    ----------
    run : Run
        Last stage of a frame against the map.
    surface : MapSurface
        The map.
    reach : float
        Distance of the frame's farthest point from the sensor: the lever of turns.
    voxel_size : float
        Edge of a voxel of the map.

    Returns
    -------
    Held
        About the sensor's place.
    """
    T, pairs = run.T_target_source, run.pairs
    points, normals = pose.apply(T, pairs.scan.points), pairs.closest.normals
    along = np.einsum("ij,ij->i", points - pairs.closest.points, normals)
    weights = np.where(normals.any(axis=1), run.weights, 0.0)
    centre = T[:3, 3]
    information = information_of(points, normals, along, weights, reach, centre)
    variances = surface.normal_variances(pairs.closest.elements)
    information = without_feigned(information, (points - centre) / reach, normals, weights * np.minimum(variances, 1.0))
    covariance = covariance_of(information)
    if not information.free.any() and weights.any():
        rows = np.hstack([np.cross(points - centre, normals), normals])
        covariance = clustered(rows, along, weights, _blocks(points, BLOCK * voxel_size), covariance)
    return Held(information, covariance)


def without_feigned(information: Information, arms: FloatArray, normals: FloatArray, wobble: FloatArray) -> Information:
    """Information with the motions that only the normals' noise seems to hold set free.

    Parameters
    ----------
    information : Information
        Of the six motions.
    arms : ndarray, (n, 3)
        Points from the centre, in levers.
    normals : ndarray, (n, 3)
        Unit normals.
    wobble : ndarray, (n,)
        Weight of each pair times the variance of its normal about both tangential axes together, rad^2.

    Returns
    -------
    Information
        The weakest first, as before.
    """
    moved = information.vectors[3:].T[:, None] + np.cross(information.vectors[:3].T[:, None], arms)
    across = np.sum(moved**2, axis=2) - np.einsum("kij,ij->ki", moved, normals) ** 2
    feigned = across @ (0.5 * wobble) / max(information.weight, np.finfo(float).tiny)
    values = np.where(information.values < FEIGNED * feigned, 0.0, information.values)
    order = np.argsort(values, kind="stable")
    return dataclasses.replace(
        information,
        values=values[order],
        vectors=information.vectors[:, order],
        carriers=information.carriers[order],
    )


def clustered(
    rows: FloatArray, residuals: FloatArray, weights: FloatArray, blocks: IntArray, independent: FloatArray
) -> FloatArray:
    """Covariance with residuals of one block taken as dependent.

    Parameters
    ----------
    rows : ndarray, (n, 6)
        Derivative of each residual.
    residuals, weights : ndarray, (n,)
        Distances along the normals, and weights.
    blocks : ndarray of int, (n,)
        Block of each residual.
    independent : ndarray, (6, 6)
        Covariance as if all were independent: what is returned where there are too few blocks, and added otherwise,
        because blocks that happen to agree promise too much.

    Returns
    -------
    ndarray, (6, 6)
        Symmetric, positive semidefinite.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> rows, noise, block = np.tile(np.eye(6), (600, 1)), np.repeat(rng.normal(size=60), 60), np.repeat(range(60), 60)
    >>> bool(clustered(rows, noise, np.ones(3600), block, np.eye(6) / 600)[0, 0] > 5 / 600)
    True
    """
    count = int(blocks.max()) + 1
    if count <= 12:
        return independent
    unit = np.sqrt((weights @ rows**2) / weights.sum())
    scaled = rows / unit
    hessian = (scaled * weights[:, None]).T @ scaled
    pulls = np.zeros((count, 6))
    np.add.at(pulls, blocks, scaled * (weights * residuals)[:, None])
    inverse = np.linalg.inv(hessian)
    spread = inverse @ (pulls.T @ pulls) @ inverse * (count / (count - 6.0))
    total: FloatArray = independent + spread / np.outer(unit, unit)
    return 0.5 * (total + total.T)


def _blocks(points: FloatArray, size: float) -> IntArray:
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    # Cells of one column, then of one plane: a number each.
    extent = cells.max(axis=0) + 1
    keys = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, numbers = np.unique(keys, return_inverse=True)
    flat: IntArray = numbers.reshape(-1).astype(np.int64)
    return flat

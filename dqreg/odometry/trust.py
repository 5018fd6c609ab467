"""How far a pose of the odometry may be trusted: what the matches hold, less what the map's noisy normals feign."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.icp import Run
from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import pose
from dqreg.trust import Information, covariance_of, information_of

# Information that is not so many times what the noise of the normals alone would feign holds nothing: on real frames
# all six motions reach 15, the way along a corridor 1.
FEIGNED = 3.0


@dataclasses.dataclass(frozen=True)
class Held:
    """What the matches of a frame say about its pose."""

    information: Information  # Of the six motions, about the sensor
    # (6, 6): Of a left increment about the sensor's place, in the map's frame; NaN where a motion is free
    covariance: FloatArray


def held_by(run: Run, surface: MapSurface, reach: float) -> Held:
    """Information and covariance at the end of a run.

    A wall that the map holds two centimetres off pulls all of its points the same way; counted as independent, they
    would promise a tenth of a millimetre. So the covariance is learned from how the residuals scatter from patch to
    patch.
    """
    T, pairs = run.T_target_source, run.pairs
    points, normals = pose.apply(T, pairs.scan.points), pairs.closest.normals
    along = np.einsum("ij,ij->i", points - pairs.closest.points, normals)
    weights = np.where(normals.any(axis=1), run.weights, 0.0)
    centre = T[:3, 3]
    matches = points, normals, along, weights, reach, centre
    variances = surface.normal_variances(pairs.closest.elements)
    wobble = weights * np.minimum(variances, 1.0)
    information = without_feigned(information_of(*matches), (points - centre) / reach, normals, wobble)
    twists = information.vectors[:, ~information.free] / np.r_[[reach] * 3, [1.0] * 3][:, None]
    if twists.shape[1]:
        scatter = information_of(*matches, patchwise=True, allowed=twists).scatter
        information = dataclasses.replace(information, scatter=scatter)
    return Held(information, covariance_of(information))


def without_feigned(information: Information, arms: FloatArray, normals: FloatArray, wobble: FloatArray) -> Information:
    """Information with the motions that only the normals' noise seems to hold set free."""
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

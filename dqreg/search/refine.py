"""Many poses refined at once: short, gated point-to-plane steps with a falling width, all poses in one batch."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.rigid.rotations import about_axis
from dqreg.search.features import Features

# Normals farther apart than this belong to different faces.
GATE_RAD = np.deg2rad(60.0)
# What holds the motions that no point holds, as a share of the weight.
DAMPING = 1e-4
# Where no point is near, nothing moves.
LEAST = 1e-12
# A rim point counts as much as so many face points, together with all others: it is less exact.
RIM_SHARE = 0.3


@dataclasses.dataclass(frozen=True)
class Sample:
    """Few places of a scan that stand for all."""

    # points, normals: (n, 3): On faces; normals of either sign, zero where unknown
    points: FloatArray
    normals: FloatArray
    # rims, outwards: (m, 3): At rims; m may be 0
    rims: FloatArray
    outwards: FloatArray

    @staticmethod
    def of(places: Features, count: int, rng: np.random.Generator) -> Sample:
        """Half evenly drawn, half with rare directions first, and a third as many rims as well."""
        face, rim = np.flatnonzero(~places.is_rim), np.flatnonzero(places.is_rim)
        weights = places.weights[face]
        even = rng.choice(face, size=min(len(face), count // 2), replace=False)
        rare = Features(places.points[face], places.directions[face], places.is_rim[face], weights).draw(
            count - len(even), rng
        )
        rows = np.concatenate([even, face[rare]])
        rims = rng.choice(rim, size=min(len(rim), count // 3), replace=False)
        return Sample(places.points[rows], places.directions[rows], places.points[rims], places.directions[rims])


def refine(
    R: FloatArray,
    t: FloatArray,
    sample: Sample,
    surface: Surface,
    edge_tree: NeighbourTree | None,
    widths: FloatArray,
    edges: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Refined poses, one damped step of points to planes for each width.

    Shapes: R (n, 3, 3), widths (k,), R (n, 3, 3).
    """
    if not len(R):
        return R, t
    middle = sample.points.mean(axis=0)
    lever = np.sqrt(((sample.points - middle) ** 2).sum(axis=1).mean())
    use_rims = edge_tree is not None and len(sample.rims) > 0
    for width in widths:
        centre = R @ middle + t
        H, g = _faces(R, t, centre, sample, surface, width, lever)
        if use_rims and edge_tree is not None:
            H_rim, g_rim = _rims(R, t, centre, sample, edges, edge_tree, width, lever)
            H, g = H + RIM_SHARE * H_rim, g + RIM_SHARE * g_rim
        scale = np.trace(H, axis1=1, axis2=2) / 6.0
        H = H + np.maximum(DAMPING * scale, LEAST)[:, None, None] * np.eye(6)
        step = np.linalg.solve(H, -g[:, :, None])[:, :, 0]
        turn = _rotations(step[:, :3])
        R, t = turn @ R, np.einsum("nij,nj->ni", turn, t - centre) + centre + lever * step[:, 3:]
    return R, t


def _faces(
    R: FloatArray, t: FloatArray, centre: FloatArray, sample: Sample, surface: Surface, width: float, lever: float
) -> tuple[FloatArray, FloatArray]:
    moved = sample.points @ R.transpose(0, 2, 1) + t[:, None, :]
    found = surface.closest(moved.reshape(-1, 3))
    normals = found.normals.reshape(moved.shape)
    gap = moved - found.points.reshape(moved.shape)
    turned = sample.normals @ R.transpose(0, 2, 1)
    # A point whose normal is unknown passes.
    unknown = np.asarray(~sample.normals.any(axis=1))
    facing = (np.abs(np.einsum("nmi,nmi->nm", turned, normals)) > np.cos(GATE_RAD)) | unknown[None, :]
    weights = facing * np.exp(-0.5 * (found.distances.reshape(moved.shape[:2]) / width) ** 2)
    return _normal_equations(moved - centre[:, None, :], normals, gap, weights / len(sample.points), lever)


def _rims(
    R: FloatArray,
    t: FloatArray,
    centre: FloatArray,
    sample: Sample,
    edges: FloatArray,
    tree: NeighbourTree,
    width: float,
    lever: float,
) -> tuple[FloatArray, FloatArray]:
    moved = sample.rims @ R.transpose(0, 2, 1) + t[:, None, :]
    rows, distances = tree.nearest(moved.reshape(-1, 3), 1)
    gap = moved - edges[rows[:, 0]].reshape(moved.shape)
    outwards = sample.outwards @ R.transpose(0, 2, 1)
    weights = np.exp(-0.5 * (distances.reshape(moved.shape[:2]) / width) ** 2)
    return _normal_equations(moved - centre[:, None, :], outwards, gap, weights / len(sample.rims), lever)


def _normal_equations(
    arms: FloatArray, normals: FloatArray, gap: FloatArray, weights: FloatArray, lever: float
) -> tuple[FloatArray, FloatArray]:
    # Lengths in levers, so that turns and shifts are of one size.
    residuals = np.einsum("nmi,nmi->nm", gap, normals) / lever
    J = np.concatenate([np.cross(arms / lever, normals), normals], axis=2)
    weighted = (J * weights[:, :, None]).transpose(0, 2, 1)
    return weighted @ J, (weighted @ residuals[:, :, None])[:, :, 0]


def _rotations(turns: FloatArray) -> FloatArray:
    angle = np.linalg.norm(turns, axis=1)
    return about_axis(turns / np.maximum(angle, np.finfo(float).tiny)[:, None], angle)

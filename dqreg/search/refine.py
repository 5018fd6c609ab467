"""Refinement of many poses in one batch: gated point-to-plane steps with a falling kernel scale."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Surface
from dqreg.geometry.surface import Hint
from dqreg.kernels.threads import ask_clock
from dqreg.rigid.rotations import about_axis
from dqreg.search.grids import Edges
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses

# Normals farther apart than this belong to different faces.
GATE_RAD = np.deg2rad(60.0)
# Damping of unconstrained motions, relative to the mean diagonal of the normal equations; and at least, so that nothing
# moves where no point is near.
DAMPING, LEAST_DAMPING = 1e-4, 1e-12
# Weight of all edge points together, where that of all points on faces is 1: they are less exact.
EDGE_WEIGHT = 0.3


def refine(
    poses: Poses, sample: OrientedPoints, surface: Surface, widths: FloatArray, edges: Edges | None = None
) -> Poses:
    """Poses after one damped point-to-plane step for each width, (k,); without edges those of the sample are unused."""
    if not len(poses):
        return poses
    faces, at_edges = sample.faces, sample.edges
    middle = faces.points.mean(axis=0)
    lever = np.sqrt(((faces.points - middle) ** 2).sum(axis=1).mean())
    before: Hint | None = None
    for width in widths:
        ask_clock()
        centre = poses.R @ middle + poses.t
        moved = poses.apply(faces.points)
        found = surface.closest(moved.reshape(-1, 3), before)
        before = moved.reshape(-1, 3), found
        H, g = _face_equations(poses, centre, faces, (moved, found), width, lever)
        if edges is not None and len(at_edges):
            H_edge, g_edge = _edge_equations(poses, centre, at_edges, edges, width, lever)
            H, g = H + EDGE_WEIGHT * H_edge, g + EDGE_WEIGHT * g_edge
        scale = np.trace(H, axis1=1, axis2=2) / 6.0
        H = H + np.maximum(DAMPING * scale, LEAST_DAMPING)[:, None, None] * np.eye(6)
        step = np.linalg.solve(H, -g[:, :, None])[:, :, 0]
        angle = np.linalg.norm(step[:, :3], axis=1)
        turn = about_axis(step[:, :3] / np.maximum(angle, np.finfo(float).tiny)[:, None], angle)
        poses = Poses(turn @ poses.R, np.einsum("nij,nj->ni", turn, poses.t - centre) + centre + lever * step[:, 3:])
    return poses


def _face_equations(
    poses: Poses, centre: FloatArray, sample: OrientedPoints, at: Hint, width: float, lever: float
) -> tuple[FloatArray, FloatArray]:
    moved, found = at
    normals = found.normals.reshape(moved.shape)
    gap = moved - found.points.reshape(moved.shape)
    turned = sample.directions @ poses.R.transpose(0, 2, 1)
    # A point whose normal is unknown passes.
    unknown = np.asarray(~sample.directions.any(axis=1))
    facing = (np.abs(np.einsum("nmi,nmi->nm", turned, normals)) > np.cos(GATE_RAD)) | unknown[None, :]
    weights = facing * np.exp(-0.5 * (found.distances.reshape(moved.shape[:2]) / width) ** 2)
    return _normal_equations(moved - centre[:, None, :], normals, gap, weights / len(sample), lever)


def _edge_equations(
    poses: Poses, centre: FloatArray, sample: OrientedPoints, edges: Edges, width: float, lever: float
) -> tuple[FloatArray, FloatArray]:
    moved = poses.apply(sample.points)
    rows, distances = edges.tree.nearest(moved.reshape(-1, 3), 1)
    gap = moved - edges.points[rows[:, 0]].reshape(moved.shape)
    outwards = sample.directions @ poses.R.transpose(0, 2, 1)
    weights = np.exp(-0.5 * (distances.reshape(moved.shape[:2]) / width) ** 2)
    return _normal_equations(moved - centre[:, None, :], outwards, gap, weights / len(sample), lever)


def _normal_equations(
    arms: FloatArray, normals: FloatArray, gap: FloatArray, weights: FloatArray, lever: float
) -> tuple[FloatArray, FloatArray]:
    # Lengths in levers, so that rotations and translations are of one size.
    residuals = np.einsum("nmi,nmi->nm", gap, normals) / lever
    J = np.concatenate([np.cross(arms / lever, normals), normals], axis=2)
    weighted = (J * weights[:, :, None]).transpose(0, 2, 1)
    return weighted @ J, (weighted @ residuals[:, :, None])[:, :, 0]

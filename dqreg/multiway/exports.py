"""Graphs and trajectories for other programs: g2o, GTSAM's order, KITTI, TUM."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.multiway.edges import PART, Edge, graph_of
from dqreg.rigid import pose, quaternion

# Rows and columns of a 6x6 matrix with the translation first.
SHIFT_FIRST = np.r_[3:6, 0:3]
# Weakest information about a motion that a file holds, as a fraction of the strongest: a free one is almost none.
WEAKEST = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Factors:
    """Relative poses as GTSAM's BetweenFactorPose3 takes them.

    Attributes
    ----------
    targets, sources : ndarray of int, (m,)
        Keys of the two poses; the part of `register_many` is the number after the last scan.
    poses : ndarray, (m, 4, 4)
        T_target_source.
    covariances : ndarray, (m, 6, 6)
        Rotation first, then translation; of a right increment in the source's frame. A free motion has a huge variance.
    """

    targets: IntArray
    sources: IntArray
    poses: FloatArray
    covariances: FloatArray


def factors_of(edges: Sequence[Edge], count: int) -> Factors:
    """Factors of the used edges."""
    graph = graph_of([edge for edge in edges if edge.used], count)
    # About the centre in the target's frame, then through the pose into the source's: both are adjoints.
    back = pose.adjoint(pose.from_parts(np.eye(3), -graph.centres) @ graph.measured)
    information = back.transpose(0, 2, 1) @ graph.information @ back
    scale = np.sqrt(np.maximum(np.einsum("mii->mi", information), np.finfo(float).tiny))
    scaled = information / scale[:, :, None] / scale[:, None]
    covariances = np.linalg.inv(scaled + WEAKEST * np.eye(6)) / scale[:, :, None] / scale[:, None]
    return Factors(graph.targets, graph.sources, graph.measured, covariances)


def to_g2o(T_world_scan: FloatArray, edges: Sequence[Edge], anchor: int) -> str:
    """The used edges and the poses as a g2o file.

    The information is that of a twist, translation first as the format has it and rotation in radians: what GTSAM and
    Ceres' examples read. (g2o itself counts rotations by the vector of the quaternion, half of that.)
    """
    factors = factors_of(edges, len(T_world_scan))
    placed = np.flatnonzero(np.isfinite(T_world_scan).all(axis=(1, 2)))
    lines = [f"VERTEX_SE3:QUAT {k} {_numbers(T_world_scan[k])}" for k in placed]
    if (factors.targets == len(T_world_scan)).any():
        lines.append(f"VERTEX_SE3:QUAT {len(T_world_scan)} {_numbers(np.eye(4))}")
    lines.append(f"FIX {len(T_world_scan) if anchor == PART else anchor}")
    for i, j, T, covariance in zip(factors.targets, factors.sources, factors.poses, factors.covariances, strict=True):
        information = np.linalg.inv(covariance)[np.ix_(SHIFT_FIRST, SHIFT_FIRST)]
        upper = " ".join(repr(float(value)) for value in information[np.triu_indices(6)])
        lines.append(f"EDGE_SE3:QUAT {i} {j} {_numbers(T)} {upper}")
    return "\n".join(lines) + "\n"


def to_trajectory(T_world_scan: FloatArray, form: str) -> str:
    """Poses as KITTI (a line a scan, NaN where it is not placed) or TUM (numbers as times; placed ones alone)."""
    placed = np.isfinite(T_world_scan).all(axis=(1, 2))
    if not placed.any():
        raise InputError("none of the scans was placed; there is no trajectory")
    if form == "kitti":
        return "".join(" ".join(map(repr, T[:3].ravel().tolist())) + "\n" for T in T_world_scan)
    return "".join(f"{k:.9f} {_numbers(T_world_scan[k])}\n" for k in np.flatnonzero(placed))


def _numbers(T: FloatArray) -> str:
    w, x, y, z = quaternion.from_matrix(T[:3, :3]).tolist()
    return " ".join(map(repr, [*T[:3, 3].tolist(), x, y, z, w]))

"""Graphs and trajectories for other programs: g2o, GTSAM's order, KITTI, TUM."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.files.g2o import to_g2o
from dqreg.files.trajectories import Form, found_rows, to_kitti, to_tum
from dqreg.multiway.pose_graph.edges import PART, Edge, graph_of
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.rigid import pose
from dqreg.rigid.twist import TRANSLATION_FIRST

# Weakest information about a motion that a file holds, as a fraction of the strongest: a free one is almost none.
MIN_INFORMATION_SHARE = 1e-9
# Of a pose: the mean of its chi-square.
DEGREES_OF_FREEDOM = 6


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
        That of a pair whose pose is farther from that of all scans than it allows is as much wider as its chi-square
        says.
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
    covariances = np.linalg.inv(scaled + MIN_INFORMATION_SHARE * np.eye(6)) / scale[:, :, None] / scale[:, None]
    wider = np.array([too_sharp(edge) for edge in edges if edge.used])
    return Factors(graph.targets, graph.sources, graph.measured, covariances * wider.reshape(-1, 1, 1))


def too_sharp(edge: Edge) -> float:
    """By how much the covariance of an edge is too small, in view of the poses of all scans; 1 where it is not."""
    return edge.chi2 / DEGREES_OF_FREEDOM if edge.chi2 > CHI2_LIMIT else 1.0


def to_pose_graph(T_world_scan: FloatArray, edges: Sequence[Edge], anchor: int) -> str:
    """The used edges and the poses as a g2o file; the part is the number after the last scan."""
    factors, part = factors_of(edges, len(T_world_scan)), len(T_world_scan)
    numbers = np.flatnonzero(found_rows(T_world_scan))
    poses = T_world_scan[numbers]
    if (factors.targets == part).any():
        numbers, poses = np.r_[numbers, part], np.concatenate([poses, np.eye(4)[None]])
    pairs = np.stack([factors.targets, factors.sources], axis=1)
    shifted = factors.covariances[:, TRANSLATION_FIRST[:, None], TRANSLATION_FIRST]
    information = np.asarray(np.linalg.inv(shifted), dtype=np.float64)
    return to_g2o(numbers, poses, part if anchor == PART else anchor, pairs, factors.poses, information)


def to_trajectory(T_world_scan: FloatArray, form: Form) -> str:
    """Poses as KITTI (a line a scan, NaN where it is not placed) or TUM (numbers as times; placed ones alone)."""
    if not found_rows(T_world_scan).any():
        raise InputError("none of the scans was placed; there is no trajectory")
    return to_kitti(T_world_scan) if form == "kitti" else to_tum(T_world_scan, np.arange(float(len(T_world_scan))))

"""Loops of three edges: how far the product of the poses is from the identity, and how far it may be."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.multiway.pose_graph import dual_poses
from dqreg.multiway.pose_graph.edges import with_lower_targets
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by

# Chi-square of six degrees of freedom that one good loop in a thousand exceeds.
CHI2_LIMIT = 22.46
# A loop whose sum of covariances is wider than this tells nothing: rotation in radians, translation in sizes.
MAX_LOOP_SIGMA_RAD, MAX_LOOP_SIGMA_SIZES = np.deg2rad(6.0), 0.06
# Loops looked at, at most.
MAX_LOOPS = 200_000


@dataclasses.dataclass(frozen=True)
class Loops:
    """Loops a -> b -> c -> a of a graph, and their errors."""

    nodes: IntArray  # (k, 3): The scans, ascending
    edges: IntArray  # (k, 3): Rows of the edges ab, bc, ac
    twists: FloatArray  # (k, 6): Twist of the product round the loop, in the frame of a
    chi2: FloatArray  # (k,): Its square in units of its covariance
    sharp: BoolArray  # (k,): Whether the covariance is narrow enough to tell anything

    @property
    def closes(self) -> BoolArray:
        """Loops that tell something and close, (k,)."""
        return np.asarray(self.sharp & (self.chi2 <= CHI2_LIMIT))

    @property
    def fails(self) -> BoolArray:
        """Loops that tell something and do not close, (k,)."""
        return np.asarray(self.sharp & ~(self.chi2 <= CHI2_LIMIT))

    def counts(self, loops: BoolArray, edges: int) -> IntArray:
        """In how many of some loops each edge takes part, (m,)."""
        return np.bincount(self.edges[loops].ravel(), minlength=edges)


def covariances_of(graph: PoseGraph, size: float, floor: float) -> FloatArray:
    """Covariances of the edges, (m, 6, 6), with a floor, a length, for what the shapes of the scans do to a pose.

    Free motions are as wide as a radian and the size of a scan.
    """
    scale = scaling_by(1.0, size)
    scaled = graph.information * scale[:, None] * scale
    covariance = np.linalg.inv(scaled + np.eye(6)) * scale[:, None] * scale
    covariance[:, range(6), range(6)] += (floor * scaling_by(2.0 / size)) ** 2
    return np.asarray(covariance)


def find_loops(graph: PoseGraph, size: float, floor: float) -> Loops:
    """All loops of three edges.

    The product is taken of dual quaternions; each edge's covariance is carried to the frame in which it ends.
    """
    ordered = with_lower_targets(graph)
    rows = _triangles(ordered)
    covariances = covariances_of(ordered, size, floor)
    ab, bc, ac = rows.T
    Z = dual_poses.from_matrices(ordered.measured)
    product = dual_poses.multiply(dual_poses.multiply(Z[ab], Z[bc]), dual_poses.inverse(Z[ac]))
    centre = pose.from_parts(np.eye(3), ordered.centres)
    inward = pose.inverse(centre)[ac]
    shift = dual_poses.from_matrices(inward)
    twists = dual_poses.log(dual_poses.multiply(dual_poses.multiply(shift, product), dual_poses.inverse(shift)))
    total = covariances[ac].copy()
    for motion, edge in ((inward @ centre[ab], ab), (inward @ ordered.measured[ab] @ centre[bc], bc)):
        A = pose.adjoint(motion)
        total += A @ covariances[edge] @ A.transpose(0, 2, 1)
    chi2 = (
        np.einsum("ki,ki->k", twists, np.linalg.solve(total, twists[..., None])[..., 0]) if len(rows) else np.zeros(0)
    )
    turn = np.sqrt(np.linalg.eigvalsh(total[:, :3, :3]).max(axis=1, initial=0.0))
    shifted = np.sqrt(np.linalg.eigvalsh(total[:, 3:, 3:]).max(axis=1, initial=0.0))
    sharp = (turn <= MAX_LOOP_SIGMA_RAD) & (shifted <= MAX_LOOP_SIGMA_SIZES * size)
    nodes = np.column_stack([ordered.targets[ab], ordered.sources[ab], ordered.sources[bc]])
    return Loops(nodes, rows, twists, chi2, sharp)


def _triangles(graph: PoseGraph) -> IntArray:
    """Rows of edges that make loops, each once. Shapes: returns (k, 3)."""
    row_of = {(int(i), int(j)): row for row, (i, j) in enumerate(zip(graph.targets, graph.sources, strict=True))}
    above: dict[int, list[int]] = {}
    for i, j in sorted(row_of):
        above.setdefault(i, []).append(j)
    found: list[tuple[int, int, int]] = []
    for (a, b), ab in sorted(row_of.items()):
        for c in above.get(b, ()):
            ac = row_of.get((a, c))
            if ac is not None:
                found.append((ab, row_of[b, c], ac))
        if len(found) >= MAX_LOOPS:
            break
    return np.array(found, dtype=np.int64).reshape(-1, 3)

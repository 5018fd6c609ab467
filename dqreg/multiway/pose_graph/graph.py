"""The pose graph: measured relative poses with their information, and the poses that explain them best.

An edge measures ``T_target_source``; its error is the twist that takes the measured pose to the one of the graph, a
left increment in the target's frame about the edge's centre, as `Registration.covariance` has it. Increments of the
poses are left ones in the world frame: ``T_world_scan = exp(twist) T_world_scan``. An edge then sees only the
difference of two of them, so that its part of the normal equations is one 6x6 block, four times.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import SuperLU, splu

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.pose_graph import dual_poses
from dqreg.rigid import pose

MAX_ITERATIONS = 50
# Steps below this, in radians and in sizes of the graph, change nothing.
CONVERGED_STEP = 1e-10
# Information added to every motion, as a fraction of the largest: what no edge holds stays where it is.
ADDED_INFORMATION_SHARE = 1e-12


@dataclasses.dataclass(frozen=True)
class PoseGraph:
    """Edges between n nodes."""

    count: int  # Number of nodes
    targets: IntArray  # (m,): Node in whose frame an edge is measured
    sources: IntArray  # (m,): The other node
    measured: FloatArray  # (m, 4, 4): T_target_source
    information: FloatArray  # (m, 6, 6): Of the error; zero along motions that an edge leaves free
    centres: FloatArray  # (m, 3): Points in the target frame about which the errors turn

    def part(self, rows: IntArray) -> PoseGraph:
        """The same nodes with some of the edges."""
        return PoseGraph(
            self.count,
            self.targets[rows],
            self.sources[rows],
            self.measured[rows],
            self.information[rows],
            self.centres[rows],
        )

    def joined(self, other: PoseGraph | None) -> PoseGraph:
        """The same nodes with the edges of another graph behind the own ones."""
        if other is None:
            return self
        return PoseGraph(
            self.count,
            np.concatenate([self.targets, other.targets]),
            np.concatenate([self.sources, other.sources]),
            np.concatenate([self.measured, other.measured]),
            np.concatenate([self.information, other.information]),
            np.concatenate([self.centres, other.centres]),
        )

    def errors(self, T: FloatArray) -> FloatArray:
        """Twists from the measured poses to those of the graph, about the centres. Shapes: T (n, 4, 4), (m, 6)."""
        there, (back, shift) = dual_poses.from_matrices(T), self._frames
        relative = dual_poses.multiply(dual_poses.inverse(there[self.targets]), there[self.sources])
        error = dual_poses.multiply(relative, back)
        return dual_poses.log(dual_poses.multiply(dual_poses.multiply(shift, error), dual_poses.inverse(shift)))

    @cached_property
    def _frames(self) -> tuple[FloatArray, FloatArray]:
        """The measured poses back, and the shifts of the centres to the origin, (m, 8): the same at each step."""
        back = dual_poses.inverse(dual_poses.from_matrices(self.measured))
        return back, dual_poses.from_matrices(pose.from_parts(np.eye(3), -self.centres))

    def chi2(self, T: FloatArray) -> FloatArray:
        """Squared errors in units of their covariances, (m,)."""
        return self.squared(self.errors(T))

    def squared(self, errors: FloatArray) -> FloatArray:
        """The same of errors, (m, 6)."""
        return np.asarray(np.einsum("mi,mij,mj->m", errors, self.information, errors))

    def jacobians(self, T: FloatArray) -> FloatArray:
        """What an increment of the source in the world frame does to the error, (m, 6, 6); of the target, minus it."""
        inward = pose.inverse(T[self.targets])
        inward[:, :3, 3] -= self.centres
        return pose.adjoint(inward)

    def blocks(self, T: FloatArray) -> FloatArray:
        """Information of each edge about increments in the world frame, (m, 6, 6)."""
        return self.blocks_of(self.jacobians(T))

    def blocks_of(self, B: FloatArray) -> FloatArray:
        """The same of jacobians, (m, 6, 6)."""
        return np.asarray(B.transpose(0, 2, 1) @ self.information @ B)


def normal_matrix(graph: PoseGraph, blocks: FloatArray) -> sparse.csc_matrix:
    """The matrix of the normal equations of all increments, (6 n, 6 n)."""
    i, j = graph.targets, graph.sources
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    values = np.concatenate([blocks, blocks, -blocks, -blocks])
    inner = np.arange(6)
    r = np.broadcast_to(6 * rows[:, None, None] + inner[:, None], values.shape).ravel()
    c = np.broadcast_to(6 * columns[:, None, None] + inner, values.shape).ravel()
    size = 6 * graph.count
    return sparse.csc_matrix((values.ravel(), (r, c)), shape=(size, size))


def factorised(matrix: sparse.csc_matrix, free: IntArray) -> SuperLU:
    """Factors of the rows and columns of the nodes that may move."""
    kept = (6 * free[:, None] + np.arange(6)).ravel()
    inner = matrix[kept][:, kept]
    ridge = ADDED_INFORMATION_SHARE * max(float(inner.diagonal().max(initial=0.0)), np.finfo(float).tiny)
    return splu((inner + ridge * sparse.identity(len(kept))).tocsc())


def solve_graph(graph: PoseGraph, T: FloatArray, free: IntArray, weights: FloatArray | None = None) -> FloatArray:
    """Poses with the least sum of squared errors, by Gauss-Newton steps on unit dual quaternions.

    Nodes that are not free stay as they are. Shapes: T (n, 4, 4), weights (m,), returns (n, 4, 4).
    """
    if not len(free) or not len(graph.targets):
        return T
    weights = np.ones(len(graph.targets)) if weights is None else weights
    # About the middle of the graph: increments about a far origin mix rotations with translations.
    middle = np.mean(T[:, :3, 3], axis=0)
    T = T.copy()
    T[:, :3, 3] -= middle
    size = max(float(np.abs(T[:, :3, 3]).max()), float(np.abs(graph.measured[:, :3, 3]).max()), np.finfo(float).tiny)
    errors = graph.errors(T)
    cost = float(weights @ graph.squared(errors))
    for _ in range(MAX_ITERATIONS):
        step = _step(graph, T, errors, free, weights)
        trial, left, length = T, errors, 1.0
        for _ in range(8):
            trial = _moved(T, free, length * step)
            left = graph.errors(trial)
            lower = float(weights @ graph.squared(left))
            if lower <= cost:
                break
            length *= 0.5
        else:
            break
        T, errors, cost = trial, left, lower
        if max(float(np.abs(step[:, :3]).max()), float(np.abs(step[:, 3:]).max()) / size) < CONVERGED_STEP:
            break
    T[:, :3, 3] += middle
    return T


def _step(graph: PoseGraph, T: FloatArray, errors: FloatArray, free: IntArray, weights: FloatArray) -> FloatArray:
    B = graph.jacobians(T)
    pull = weights[:, None] * np.einsum("mji,mjk,mk->mi", B, graph.information, errors)
    gradient = np.zeros((graph.count, 6))
    np.add.at(gradient, graph.sources, pull)
    np.add.at(gradient, graph.targets, -pull)
    matrix = normal_matrix(graph, weights[:, None, None] * graph.blocks_of(B))
    return np.asarray(factorised(matrix, free).solve(-gradient[free].ravel()).reshape(-1, 6))


def _moved(T: FloatArray, free: IntArray, step: FloatArray) -> FloatArray:
    moved = T.copy()
    turned = dual_poses.multiply(dual_poses.exp(step), dual_poses.from_matrices(T[free]))
    moved[free] = dual_poses.to_matrices(turned)
    return moved

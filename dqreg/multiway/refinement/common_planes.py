"""The last rounds of the joint refinement: faces that several scans see are planes that nobody knows, fitted with all.

Pairs compare a point with a plane through the few points around its match, which at the rim of a face is a blend of two
faces. Here the points of all scans on one piece of a face share its plane, and the pose of each scan follows from all
pieces that it sees: bundle adjustment of planes (Liu and Zhang, "BALM", 2021), in time linear in the number of points.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.threads import ask_clock
from dqreg.multiway.pose_graph import dual_poses
from dqreg.multiway.pose_graph.graph import PoseGraph, factorised, normal_matrix
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.joint import CONVERGED_SPACINGS
from dqreg.multiway.refinement.pooled_scans import Pieces, Pooled, centred
from dqreg.multiway.refinement.spread import root_of
from dqreg.multiway.refinement.step_prior import step_prior
from dqreg.multiway.refinement.unconstrained_motions import without_loose_motions
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by

# The scale of the first round, in spacings, and its least factor a round.
FIRST_SCALE_SPACINGS, MIN_SCALE_FACTOR = 0.4, 0.7
# Where it ends, in residuals of typical points.
LAST_SCALE_RESIDUALS = 1.5
# Rounds, and those that follow once the scale has settled.
ROUNDS, SETTLED_ROUNDS = 22, 4
STEPS_PER_ROUND = 2
# The scale has settled when it falls by less than this.
SETTLED_SCALE_FACTOR = 0.9
# Neighbours are looked for anew when a point has moved by so many spacings; the rounds end below the second number.
NEW_NEIGHBOURS_SPACINGS, STILL_SPACINGS = 0.5, 2e-3
# Faces have to be flat: residuals in spacings at most, and the share of the points on them at least.
FLAT_SPACINGS, FACE_SHARE = 0.1, 0.5
# Standard deviation of the corners of a scan about where pairs put it, in spacings, for what no face holds.
PAIR_SIGMA_SPACINGS = 0.5
# Points that face a motion, without which faces do not hold it, and without which covariances take it so.
MIN_FACING_POINTS, MIN_COVARIANCE_POINTS = 2.0, 10.0
# A scan that moves by more spacings than this from where pairs put it is none that they put right.
MAX_MOTION_SPACINGS = 3.0

# Places of the bodies on a table, and how many there are all the way round.
OnTable = tuple[Sequence[int], int]


@dataclasses.dataclass(frozen=True)
class PlacedBodies:
    """Poses of all bodies at once, and how sure they are."""

    T_world_body: FloatArray  # (n, 4, 4)
    covariance: FloatArray  # (6 k, 6 k): Of left increments of the free bodies about the centre
    centre: FloatArray  # (3,)
    rounds: int
    converged: bool
    by_steps: bool = False  # Whether equal steps of a table hold what faces do not


def refine_on_planes(
    bodies: Sequence[Body],
    T_world_body: FloatArray,
    free: IntArray,
    spacing: float,
    size: float,
    on_table: OnTable | None = None,
) -> PlacedBodies | None:
    """Poses of least squares with all planes of common faces unknown; None where faces do not suffice for it.

    All bodies move, so that what holds the one that is not free counts as well; then they are put back together. Equal
    steps of a table hold what faces do not, as closely as the poses without them say.
    Shapes: T_world_body (n, 4, 4), of the centred frames.
    """
    if any(body.scan is None for body in bodies) or not len(free):
        return None
    pooled = Pooled(bodies, size)
    found = _refined(pooled, bodies, T_world_body, free, spacing, size)
    steps = None if found is None or on_table is None else _steps(found, bodies, free, size, on_table)
    if found is None or steps is None:
        return found
    held = _refined(pooled, bodies, found.T_world_body, free, spacing, size, steps)
    return found if held is None or not held.converged else dataclasses.replace(held, by_steps=True)


def _steps(
    found: PlacedBodies, bodies: Sequence[Body], free: IntArray, size: float, on_table: OnTable
) -> PoseGraph | None:
    """The steps of the table that poses without them agree on, in sizes."""
    T = pose.from_parts(np.eye(3), -found.centre) @ found.T_world_body
    T[:, :3, 3] /= size
    scale = np.tile(np.r_[np.ones(3), np.full(3, 1.0 / size)], len(free))
    origins = np.array([body.origin for body in bodies]) / size
    return step_prior(T, found.covariance * np.outer(scale, scale), free, origins, *on_table)


def _refined(
    pooled: Pooled,
    bodies: Sequence[Body],
    T_world_body: FloatArray,
    free: IntArray,
    spacing: float,
    size: float,
    steps: PoseGraph | None = None,
) -> PlacedBodies | None:
    """The same, with what no face holds left where pairs, and steps, put it."""
    T, middle = centred(T_world_body, size)
    least = MIN_FACING_POINTS if steps is None else MIN_COVARIANCE_POINTS
    begun, places = T, _Places.of(bodies, T, spacing / size, size, steps)
    scale, settled, rounds, moved = FIRST_SCALE_SPACINGS * spacing / size, 0, 0, np.inf
    while rounds < ROUNDS and settled < SETTLED_ROUNDS and not (settled and moved < STILL_SPACINGS * spacing / size):
        ask_clock()
        pieces, rounds = pooled.pieces(T, scale, NEW_NEIGHBOURS_SPACINGS * spacing / size), rounds + 1
        lower = max(MIN_SCALE_FACTOR * scale, min(scale, LAST_SCALE_RESIDUALS * pieces.residual))
        settled = settled + 1 if lower > SETTLED_SCALE_FACTOR * scale else 0
        rough = pieces.residual * size > FLAT_SPACINGS * spacing or pieces.points < FACE_SHARE * len(pooled.points)
        if not pieces.points or (settled and rough):
            return None
        moved, scale = 0.0, lower
        for _ in range(STEPS_PER_ROUND):
            T, motion = _stepped(pieces, T, places, least if settled else 0.0)
            moved = max(moved, motion)
    if rough or _motion(bodies, begun, T, size) > MAX_MOTION_SPACINGS * spacing / size:
        return None
    root = _root_of_covariance(pieces, T, places, size)
    found = _anchored(begun, T, free)
    found[:, :3, 3] = size * found[:, :3, 3] + middle
    relative = _relative(root, free)
    return PlacedBodies(found, relative, middle, rounds, motion < CONVERGED_SPACINGS * spacing / size)


def _anchored(begun: FloatArray, T: FloatArray, free: IntArray) -> FloatArray:
    """All bodies together moved so that the one that is not free is where it was."""
    held = np.setdiff1d(np.arange(len(T)), free)
    return T.copy() if not len(held) else np.asarray(begun[held[0]] @ pose.inverse(T[held[0]]) @ T)


def _relative(root: FloatArray, free: IntArray) -> FloatArray:
    """The covariance of the increments of the free bodies against the one that is not, (6 k, 6 k).

    Of the root: all bodies may move together by far more than they move apart, which is a small difference.
    """
    count = len(root) // 6
    held = np.setdiff1d(np.arange(count), free)
    turn = np.eye(count)[free]
    turn[:, held] = -1.0
    apart = np.kron(turn, np.eye(6)) @ root
    return np.asarray(apart @ apart.T)


@dataclasses.dataclass(frozen=True)
class _Places:
    """Where pairs, and the steps of a table, put the scans: what holds them where no face does."""

    T: FloatArray  # (n, 4, 4)
    precisions: FloatArray  # (n, 6): Of rotations about the scan's origin and of translations
    steps: PoseGraph | None

    @staticmethod
    def of(bodies: Sequence[Body], T: FloatArray, spacing: float, unit: float, steps: PoseGraph | None) -> _Places:
        held = PAIR_SIGMA_SPACINGS * spacing
        radii = np.array([0.5 * body.surface.diagonal / unit for body in bodies])
        turns, shifts = np.repeat(radii[:, None] ** 2, 3, axis=1), np.ones((len(T), 3))
        return _Places(T, np.hstack([turns, shifts]) / held**2, steps)

    def lengths(self, T: FloatArray) -> FloatArray:
        """From increments in the world to motions of the scans' corners and origins, (n, 6, 6)."""
        units = np.sqrt(self.precisions / self.precisions[:, 5:])
        return np.asarray(units[:, :, None] * pose.adjoint(pose.from_parts(np.eye(3), -T[:, :3, 3])))

    def about(self, T: FloatArray) -> tuple[FloatArray, sparse.csc_matrix]:
        """Slopes and curvatures of their cost by increments in the world, (n, 6) and (6 n, 6 n)."""
        each, there = np.arange(len(T)), pose.from_parts(np.eye(3), -T[:, :3, 3])
        off = pose.log(there @ T @ pose.inverse(there @ self.T))
        turned = pose.adjoint(there)
        weighted = turned.transpose(0, 2, 1) * self.precisions[:, None]
        pull, held = np.einsum("kij,kj->ki", weighted, off), _placed(weighted @ turned, each, each, len(T))
        if self.steps is None:
            return pull, held
        graph, B = self.steps, self.steps.jacobians(T)
        slopes = np.einsum("mji,mjk,mk->mi", B, graph.information, graph.errors(T))
        np.add.at(pull, graph.sources, slopes)
        np.add.at(pull, graph.targets, -slopes)
        return pull, (held + normal_matrix(graph, graph.blocks(T))).tocsc()


def _stepped(pieces: Pieces, T: FloatArray, places: _Places, least: float) -> tuple[FloatArray, float]:
    """The next poses, and the largest motion of a scan's corners that faces hold."""
    matrix, counts, slopes = _normal(pieces, T, places, least)
    gradient, each = np.zeros((len(T), 6)), np.arange(len(T))
    np.add.at(gradient, pieces.scans, slopes)
    pull, held = places.about(T)
    whole = (counts.T @ matrix @ counts).tocsc() + held
    step = factorised(whole, each).solve(-(counts.T @ gradient.ravel() + pull.ravel()))
    turned = dual_poses.multiply(dual_poses.exp(step.reshape(-1, 6)), dual_poses.from_matrices(T))
    held_by_faces = (places.lengths(T) @ (counts @ step).reshape(-1, 6, 1))[:, :, 0]
    motions = np.linalg.norm(held_by_faces[:, :3], axis=1) + np.linalg.norm(held_by_faces[:, 3:], axis=1)
    return np.asarray(dual_poses.to_matrices(turned)), float(motions.max())


def _normal(
    pieces: Pieces, T: FloatArray, places: _Places, least: float
) -> tuple[sparse.csc_matrix, sparse.csc_matrix, FloatArray]:
    """The matrix of the normal equations of all increments in the world, what of it counts, and the groups' slopes.

    What counts turns increments into those that faces hold, (6 n, 6 n); slopes (g, 6). Where fewer than so many points
    face a motion, it rests on tilts of planes that nearly hold it, which follow the poses they were found at.
    """
    from dqreg.kernels.steps.plane_elimination import eliminate_planes

    table, slopes = _table(pieces, len(T)), np.zeros((len(pieces.scans), 6))
    blocks = np.zeros((int(table.max()) + 1, 6, 6))
    eliminate_planes(pieces.starts, pieces.scans, pieces.moved(T), pieces.residual**2, table, blocks, slopes)
    row, column = np.nonzero(np.triu(table >= 0))
    upper = _placed(blocks[table[row, column]], row, column, len(T))
    matrix = (sparse.triu(upper) + sparse.triu(upper, 1).T).tocsc()
    if not least:
        return matrix, sparse.identity(matrix.shape[0], format="csc"), slopes
    return matrix, without_loose_motions(matrix * pieces.residual**2, places.lengths(T), table >= 0, least), slopes


def _table(pieces: Pieces, count: int) -> IntArray:
    """Number of the block of each pair of scans that share a piece, and of each scan itself; -1 for the others."""
    number = np.repeat(np.arange(len(pieces.starts) - 1), np.diff(pieces.starts))
    seen = sparse.csr_matrix((np.ones(len(number)), (pieces.scans, number)), shape=(count, len(pieces.starts) - 1))
    shared = (seen @ seen.T).toarray() > 0.0
    np.fill_diagonal(shared, True)
    upper = np.triu(shared)
    table = np.full((count, count), -1, dtype=np.int64)
    table[upper] = np.arange(int(upper.sum()))
    return np.asarray(np.maximum(table, table.T))


def _placed(blocks: FloatArray, rows: IntArray, columns: IntArray, count: int) -> sparse.csc_matrix:
    inner = np.arange(6)
    r = np.broadcast_to(6 * rows[:, None, None] + inner[:, None], blocks.shape).ravel()
    c = np.broadcast_to(6 * columns[:, None, None] + inner, blocks.shape).ravel()
    return sparse.csc_matrix((blocks.ravel(), (r, c)), shape=(6 * count, 6 * count))


def _root_of_covariance(pieces: Pieces, T: FloatArray, places: _Places, unit: float) -> FloatArray:
    """What times its transpose is the covariance of increments about the world's origin, in lengths, (6 n, 6 n).

    A sandwich: pieces are independent of each other, whatever the scatter of each. Three numbers of a plane are fitted
    to its points, which makes their distances smaller than they are (HC3 of MacKinnon and White 1985).
    """
    matrix, counts, slopes = _normal(pieces, T, places, MIN_COVARIANCE_POINTS)
    each = np.arange(len(T))
    prior = places.about(T)[1]
    solve = factorised((counts.T @ matrix @ counts).tocsc() + prior, each).solve
    scores = counts.T @ pieces.scores(slopes, len(T))
    units = np.tile(scaling_by(1.0, unit), len(T))
    return np.asarray(units[:, None] * solve(root_of(((scores @ scores.T) + prior).toarray())))


def _motion(bodies: Sequence[Body], before: FloatArray, after: FloatArray, unit: float) -> float:
    """Largest motion of the corners of a scan, in units."""
    change = after - before
    turned = np.linalg.norm(change[:, :3, :3], 2, axis=(1, 2))
    half = np.array([0.5 * body.surface.diagonal / unit for body in bodies])
    return float((np.linalg.norm(change[:, :3, 3], axis=1) + half * turned).max())

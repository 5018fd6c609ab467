"""How sure the poses are: the covariance of all of them together, from the scatter of the planes' residuals.

Neighbouring residuals share the noise of the points and planes around them, and a point takes part in several pairs.
So the slopes of the cost are summed over small cells of the world, whatever pair they come from; cells are independent
(a sandwich, White 1980, clustered by cells): ``H^-1 (sum of u u^T) H^-1``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.icp.estimators import MIN_PLANES
from dqreg.multiway.pose_graph.graph import PoseGraph, factorised, normal_matrix
from dqreg.multiway.refinement.joint import linearised
from dqreg.multiway.refinement.planes import WeighedMatches
from dqreg.rigid import pose
from dqreg.rigid.twist import scaling_by

# Variance of a scaled motion, in squares of a radian or of the size, beyond which it is free.
FREE_VARIANCE = 1.0
# Share of the information about a motion that is left, at least, where the rest is that of errors of the normals.
MIN_INFORMATION_SHARE = 1e-3


@dataclasses.dataclass(frozen=True)
class WorldCovariance:
    """Covariance of the world increments of the free nodes about the world's origin, and what cells add to them."""

    covariance: FloatArray  # (6 k, 6 k): NaN in rows and columns of free motions
    cells: IntArray  # (c,): Numbers
    influences: FloatArray  # (6 k, c): What the errors of each cell do to the poses


def joint_covariance(
    T: FloatArray, planes: Sequence[WeighedMatches], free: IntArray, cell: float, size: float
) -> WorldCovariance:
    """How sure the free nodes are. Coordinates are relative to the middle of the graph, as ``T`` is given.

    Few cells tell the sizes of the errors and not how these go together: as far as there are few for the motions, the
    scatter is taken to be that of equal residuals everywhere, as large as all cells have it (shrinkage, Ledoit and Wolf
    2004).
    """
    faces = [each.on_faces for each in planes]
    graph, blocks, locked = _information(T, faces, planes)
    place = np.full(len(T), -1)
    place[free] = np.arange(len(free))
    inner = (6 * free[:, None] + np.arange(6)).ravel()
    solve = factorised(normal_matrix(graph, blocks + locked), free).solve
    held, beside = (normal_matrix(graph, part)[inner][:, inner].toarray() for part in (blocks, locked))
    inverse = solve(np.eye(len(inner)))
    cells, slopes = _by_cell(T, faces, place, cell, inverse)
    middle = (slopes @ slopes.T).toarray()
    alike = min(1.0, len(inner) / max(len(cells), 1))
    middle += alike * (float(np.trace(inverse @ middle)) / max(float(np.trace(inverse @ held)), 1.0) * held - middle)
    root = solve(root_of(middle + beside))
    covariance = root @ root.T
    scale = np.tile(scaling_by(1.0, size), len(free))
    # Nothing is known of a node that met no other one.
    loose = (np.diag(covariance) / scale**2 > FREE_VARIANCE) | (np.diag(held + beside) <= 0.0)
    covariance[loose] = np.nan
    covariance[:, loose] = np.nan
    return WorldCovariance(covariance, cells, solve(slopes.toarray()))


def root_of(matrix: FloatArray) -> FloatArray:
    """A matrix that times its transpose is this one, which is symmetric and not negative but for rounding, (n, n).

    Products of it with its transpose have no negative variances: two solutions with a matrix that is all but singular,
    one after the other, leave rounding of any size.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    scaled = matrix / scale / scale[:, None]
    try:
        root = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(scaled)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(scale[:, None] * root)


def beyond_noise(change: FloatArray, spread: WorldCovariance, other: WorldCovariance) -> FloatArray:
    """The part of a change of all poses, (k, 6), from one spread to another, that errors of the cells do not explain.

    Two estimates from the same points differ by their noise already: of the change of each pose the share is left by
    which its square exceeds what is expected of six numbers (James and Stein 1961).
    """
    cells, place = np.unique(np.concatenate([spread.cells, other.cells]), return_inverse=True)
    apart = np.zeros((len(spread.influences), len(cells)))
    apart[:, place[: len(spread.cells)]] = spread.influences
    apart[:, place[len(spread.cells) :]] -= other.influences
    found = np.zeros_like(change)
    for k, moved in enumerate(change):
        rows = apart[6 * k : 6 * k + 6]
        scale = np.maximum(np.linalg.norm(rows, axis=1), np.finfo(float).tiny)
        rows, whitened = rows / scale[:, None], moved / scale
        square = float(whitened @ np.linalg.pinv(rows @ rows.T, rcond=1e-12, hermitian=True) @ whitened)
        found[k] = np.sqrt(max(1.0 - 6.0 / max(square, 6.0), 0.0)) * moved
    return found


def _information(
    T: FloatArray, faces: Sequence[WeighedMatches], planes: Sequence[WeighedMatches]
) -> tuple[PoseGraph, FloatArray, FloatArray]:
    """What the faces hold, without what errors of their normals seem to, and what all edges together hold.

    Shapes: both (m, 6, 6), of increments in the world frame.
    """
    whole, _, _ = linearised(T, planes)
    firm = [k for k, each in enumerate(faces) if each.count >= MIN_PLANES]
    held = np.zeros((len(planes), 6, 6))
    if firm:
        graph, _, _ = linearised(T, [faces[k] for k in firm])
        to_centre = pose.adjoint(pose.from_parts(np.eye(3), graph.centres))
        apparent = np.array([faces[k].apparent for k in firm])
        B = graph.jacobians(T)
        for k, row in enumerate(firm):
            squares = without_apparent(graph.information[k], to_centre[k].T @ apparent[k] @ to_centre[k])
            held[row] = B[k].T @ squares @ B[k]
    outward = pose.adjoint(pose.inverse(T[whole.targets]))
    # Both ways of a pair look at the same edges.
    ways = {(each.target, each.source) for each in planes}
    locked = np.array([each.locked / (1 + ((each.source, each.target) in ways)) for each in planes])
    return whole, held, outward.transpose(0, 2, 1) @ locked @ outward


def without_apparent(information: FloatArray, apparent: FloatArray) -> FloatArray:
    """Information without the apparent part of it; a little of each motion is left. Shapes: (6, 6)."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / scale / scale[:, None])
    roots = np.sqrt(np.maximum(values, 1e-14))
    forth, back = (vectors * roots) * scale[:, None], vectors / roots / scale[:, None]
    shares, turn = np.linalg.eigh(np.eye(6) - back.T @ apparent @ back)
    root = forth @ turn
    return np.asarray((root * np.maximum(shares, MIN_INFORMATION_SHARE)) @ root.T)


def _by_cell(
    T: FloatArray, planes: Sequence[WeighedMatches], place: IntArray, cell: float, inverse: FloatArray
) -> tuple[IntArray, sparse.csc_matrix]:
    """Numbers of cells, and slopes of the cost by the increments of the free nodes, one column a cell, (6 k, cells)."""
    rows, cells, values = [], [], []
    inner = np.arange(6)
    for each in planes:
        ends = [(place[node], sign) for node, sign in ((each.source, 1.0), (each.target, -1.0)) if place[node] >= 0]
        numbers, slopes = each.scores(T[each.target], cell, _between(inverse, ends))
        for node, sign in ends:
            rows.append(np.broadcast_to(6 * node + inner, slopes.shape).ravel())
            cells.append(np.repeat(numbers, 6))
            values.append(sign * slopes.ravel())
    size = 6 * int((place >= 0).sum())
    if not rows:
        return np.zeros(0, dtype=np.int64), sparse.csc_matrix((size, 0))
    known, columns = np.unique(np.concatenate(cells), return_inverse=True)
    where = np.concatenate(rows), columns
    return known, sparse.csc_matrix((np.concatenate(values), where), shape=(size, len(known)))


def _between(covariance: FloatArray, ends: Sequence[tuple[int, float]]) -> FloatArray:
    """Covariance of the sum of the increments of some nodes, each with a sign, (6, 6)."""
    blocks = [sign * other * covariance[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] for i, sign in ends for j, other in ends]
    return np.asarray(np.sum(blocks, axis=0))

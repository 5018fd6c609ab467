"""How sure the poses are: the covariance of all of them together, from the scatter of the planes' residuals.

Neighbouring residuals share the noise of the points and planes around them, and a point takes part in several pairs.
So the slopes of the cost are summed over small cells of the world, whatever pair they come from; cells are independent
(a sandwich, White 1980, clustered by cells): ``H^-1 (sum of u u^T) H^-1``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import FloatArray, IntArray
from dqreg.icp.estimators import FEWEST_PLANES
from dqreg.multiway.graph import PoseGraph, factorised, normal_matrix
from dqreg.multiway.joint import linearised
from dqreg.multiway.planes import Planes
from dqreg.rigid import pose

# Variance of a scaled motion, in squares of a radian or of the size, beyond which it is free.
FREE = 1.0
# Share of the information about a motion that is left, at least, where the rest is that of errors of the normals.
LEAST_HELD = 1e-3


def joint_covariance(T: FloatArray, planes: Sequence[Planes], free: IntArray, cell: float, size: float) -> FloatArray:
    """Covariance of the world increments of the free nodes about the world's origin, (6 k, 6 k).

    Rows and columns of free motions are NaN. Coordinates are relative to the middle of the graph, as ``T`` is given.
    """
    faces = [each.on_faces for each in planes]
    graph, blocks, locked = _information(T, faces, planes)
    matrix = normal_matrix(graph, blocks + locked)
    place = np.full(len(T), -1)
    place[free] = np.arange(len(free))
    slopes = _by_cell(T, faces, place, cell)
    scale = np.tile(np.r_[[1.0] * 3, [size] * 3], len(free))
    solve = factorised(matrix, free).solve
    middle = (slopes @ slopes.T).toarray()
    inner = (6 * free[:, None] + np.arange(6)).ravel()
    middle += normal_matrix(graph, locked)[inner][:, inner].toarray()
    covariance = solve(solve(middle).T).T
    loose = np.diag(covariance) / scale**2 > FREE
    covariance[loose] = np.nan
    covariance[:, loose] = np.nan
    return 0.5 * (covariance + covariance.T)


def _information(
    T: FloatArray, faces: Sequence[Planes], planes: Sequence[Planes]
) -> tuple[PoseGraph, FloatArray, FloatArray]:
    """What the faces hold, without what errors of their normals seem to, and what all edges together hold.

    Shapes: both (m, 6, 6), of increments in the world frame.
    """
    whole, _, _ = linearised(T, planes)
    firm = [k for k, each in enumerate(faces) if each.count >= FEWEST_PLANES]
    held = np.zeros((len(planes), 6, 6))
    if firm:
        graph, _, _ = linearised(T, [faces[k] for k in firm])
        to_centre = pose.adjoint(pose.from_parts(np.eye(3), graph.centres))
        apparent = np.array([faces[k].apparent for k in firm])
        B = graph.jacobians(T)
        for k, row in enumerate(firm):
            squares = less(graph.information[k], to_centre[k].T @ apparent[k] @ to_centre[k])
            held[row] = B[k].T @ squares @ B[k]
    outward = pose.adjoint(pose.inverse(T[whole.targets]))
    # Both ways of a pair look at the same edges.
    ways = {(each.target, each.source) for each in planes}
    locked = np.array([each.locked / (1 + ((each.source, each.target) in ways)) for each in planes])
    return whole, held, outward.transpose(0, 2, 1) @ locked @ outward


def less(information: FloatArray, apparent: FloatArray) -> FloatArray:
    """Information without the apparent part of it; a little of each motion is left. Shapes: (6, 6)."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / scale / scale[:, None])
    roots = np.sqrt(np.maximum(values, 1e-14))
    forth, back = (vectors * roots) * scale[:, None], vectors / roots / scale[:, None]
    shares, turn = np.linalg.eigh(np.eye(6) - back.T @ apparent @ back)
    root = forth @ turn
    return np.asarray((root * np.maximum(shares, LEAST_HELD)) @ root.T)


def _by_cell(T: FloatArray, planes: Sequence[Planes], place: IntArray, cell: float) -> sparse.csc_matrix:
    """Slopes of the cost by the increments of the free nodes, one column a cell, (6 k, cells)."""
    rows, cells, values = [], [], []
    inner = np.arange(6)
    for each in planes:
        numbers, slopes = each.scores(T[each.target], cell)
        for node, sign in ((each.source, 1.0), (each.target, -1.0)):
            if place[node] >= 0:
                rows.append(np.broadcast_to(6 * place[node] + inner, slopes.shape).ravel())
                cells.append(np.repeat(numbers, 6))
                values.append(sign * slopes.ravel())
    size = 6 * int((place >= 0).sum())
    if not rows:
        return sparse.csc_matrix((size, 0))
    _, columns = np.unique(np.concatenate(cells), return_inverse=True)
    return sparse.csc_matrix((np.concatenate(values), (np.concatenate(rows), columns)), shape=(size, columns.max() + 1))

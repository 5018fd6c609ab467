"""What the normals of two clouds say of the motions: which of them the one alone holds, and how many points do."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.solvers.quadratic import JACOBIAN_ROWS
from dqreg.solvers.row_sums import MotionSums

# Normals that are estimates constrain what the shape leaves free: each side's by its own errors. Where less than this
# share of what the target's normals say is said by the scan's too, it is errors: right poses came to 0.4, slid ones of
# round parts and corridors to 0.16 at most.
MIN_CONFIRMED_SHARE = 0.25


def unconfirmed(sums: MotionSums, least: float) -> FloatArray:
    """Motions, as combinations of the unknowns, that the target's normals hold and the scan's do not confirm, (k, m).

    Of all mixtures those with the least confirmed shares: what errors say of one motion may be as much as the shape
    says of another, and an eigenvector of the information is any mixture of such two. What holds a motion by less than
    the least is nothing that there is to confirm.
    """
    both, compared = sums.of_both()
    values, vectors = np.linalg.eigh(compared)
    held = values > least
    unit = vectors[:, held] / np.sqrt(values[held])
    shares, mixtures = np.linalg.eigh(unit.T @ both @ unit)
    return np.asarray(unit @ mixtures[:, shares <= MIN_CONFIRMED_SHARE])


def carriers_of(
    points: FloatArray,
    normals: FloatArray,
    own: FloatArray,
    vectors: FloatArray,
    weights: FloatArray,
    counts: FloatArray | None,
    centre: FloatArray,
    lever: float,
) -> FloatArray:
    """Correspondences that carry each motion, (6, m) one a column: how many equal shares would add up as well, (m,).

    A share is ``w (v . J)^2``, or, where the scan has normals of its own, the product of what both sides' say.
    """
    from dqreg.kernels.evidence.both_sides import motion_shares
    from dqreg.kernels.threads import as_plain, over_chunks

    sums = np.zeros((max(-(-len(weights) // JACOBIAN_ROWS), 1), 2, vectors.shape[1]))
    of_rows = points, normals, own, vectors.T, weights, np.zeros(0) if counts is None else counts, centre
    over_chunks(
        motion_shares, len(weights), *map(as_plain, of_rows), float(lever), JACOBIAN_ROWS, sums, chunk=JACOBIAN_ROWS
    )
    shares, squares = sums.sum(axis=0)
    return np.asarray(np.maximum(shares, 0.0) ** 2 / np.where(squares > 0.0, squares, np.inf))

"""Surfaces onto surfaces: the plane-to-plane cost of generalised ICP (Segal et al. 2009) as a quadratic form.

Around its point each surface is a disc: a point of it may stand anywhere along the disc, and off it by a share of that
which its normal is unsure of. With unit normals n of the target and m of the source (turned to the target's frame),
and variances e_n and e_m, the difference of two points that belong together has the covariance

    C = (I - (1 - e_n) n n^T) + (I - (1 - e_m) m m^T)

in units that do not matter, and costs ``d^T C^-1 d``. With ``a = 1 - e_n``, ``b = 1 - e_m``, ``c = n . m`` Woodbury's
identity gives the inverse as a sum of squares,

    C^-1 = 1/2 (I + k u u^T + b/(2 - b) m m^T),   u = n + b c/(2 - b) m,
    k = a (2 - b) / ((2 - a)(2 - b) - a b c^2),

so that a pair is a point, a plane along u and a plane along m, and adds to the same 13x13 matrix as any other. Where
both normals agree and are sure, the plane counts and the point hardly does; where they differ, neither face is
believed, and the pair fades.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import NEIGHBOURS
from dqreg.icp.correspondences import Pairs
from dqreg.solvers.quadratic import QuadraticForm, plane_form, point_form

# Variance of every normal, rad^2, beyond that of its fit: how far a surface bends between the points of two clouds.
# On 23 measured pairs 0.03 to 0.1 gave about the same errors, 0.001 and none larger ones.
BEND = 0.04


def surface_form(
    p: FloatArray,
    q: FloatArray,
    directions: tuple[FloatArray, FloatArray],
    variances: tuple[FloatArray, FloatArray],
    weights: FloatArray,
    origins: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Matrix of ``sum w d^T C^-1 d``, ``d = R p + t - q``, with the covariances C held at their normals.

    Shapes: returns (13, 13).
    """
    (n, m), (sure_n, sure_m) = directions, (1.0 - np.clip(variance, 0.0, 1.0) for variance in variances)
    a, b = sure_n * n.any(axis=1), sure_m * m.any(axis=1)
    cosine = np.einsum("ij,ij->i", n, m)
    along = n + (b * cosine / (2.0 - b))[:, None] * m
    k = a * (2.0 - b) / ((2.0 - a) * (2.0 - b) - a * b * cosine**2)
    half = 0.5 * weights
    return (
        point_form(p, q, half, origins)
        + plane_form(p, q, along, half * k, origins)
        + plane_form(p, q, m, half * b / (2.0 - b), origins)
    )


def form_of_pairs(pairs: Pairs, weights: FloatArray) -> QuadraticForm:
    """The cost of weighted pairs, in units in which the distance between two sure and parallel planes counts once."""
    used = np.flatnonzero(weights > 0.0)
    w = weights[used]
    p, q = np.take(pairs.scan.points, used, axis=0), np.take(pairs.closest.points, used, axis=0)
    n = np.take(pairs.closest.normals, used, axis=0)
    m = np.take(pairs.scan.normals, used, axis=0) @ pairs.T_target_source[:3, :3].T
    scan, stands = pairs.scan, pairs.closest.variances
    with np.errstate(divide="ignore", invalid="ignore"):
        moves = (scan.residuals[used] ** 2) / (NEIGHBOURS * scan.levers[used])
    # A normal that was given and not fitted is taken at its word.
    moving = BEND + np.nan_to_num(moves, nan=0.0, posinf=1.0)
    standing = BEND + (np.zeros(len(used)) if stands is None else stands[used])
    origins = (w @ p / w.sum(), w @ q / w.sum())
    return QuadraticForm(surface_form(p, q, (n, m), (standing, moving), 2.0 * BEND * w, origins), *origins)

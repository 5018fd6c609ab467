"""Covariance of a fitted shape: from the scatter of its residuals between patches, where there are enough of them."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.morton import morton_order
from dqreg.inspection.features.models import FeatureKind, Shape, distances
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.solvers.sandwich import larger, scatter_of

# Seed wherever noise is drawn: the same scan has the same uncertainty.
DRAW_SEED = 20_261_122
# Points from which on neighbours' residuals are compared: form error makes them alike.
MIN_PATCHED_POINTS = 400
# What a point's residual keeps of its own error at least.
MIN_RESIDUAL_SHARE = 0.3
# Share of the variance of what neighbours have in common that is taken for an error of the scanner: no scan tells it
# from form. Of virtual scans, which have none, it makes the uncertainty of a distance between wavy faces twice as wide.
SCANNER_ERROR_SHARE = 0.1
# Lobes of a round shape that are tried: of one seen on a part of a turn a fit takes some of them for size and place.
# One lobe a turn is a shift.
LOBES = range(2, 10)
# Points farther than that many robust standard deviations are left out; fewer points tell no lobes.
OUTLIER_SIGMAS, MIN_POINTS = 5.0, 50


def covariance_of(
    kind: FeatureKind, shape: Shape, points: FloatArray, rows: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Of the parameters, (k, k). Shapes: points (n, 3), rows (r,), slopes (r, k).

    Form error is common to neighbouring points: taken as independent, a thousand of them would make it vanish.
    """
    variance = float(rows @ rows) / max(len(rows) - slopes.shape[1], 1)
    spread: FloatArray | None = None
    if len(points) >= MIN_PATCHED_POINTS and len(rows) == len(points):
        order = morton_order(points)
        none = np.zeros((slopes.shape[1],) * 2)
        # Scaled, so that parameters of any unit stand beside each other.
        scale = np.linalg.norm(slopes, axis=0)
        outward = normals_of(kind, shape, points)[order]
        spread = scatter_of(
            (slopes / scale)[order].T, points[order], outward, rows[order], np.ones(len(points)), none, variance
        )
        spread = None if spread is None else spread / scale / scale[:, None]
    if spread is None:
        spread = _of_few(rows, slopes, variance)
    covariance: FloatArray = 0.5 * (spread + spread.T)
    return covariance


def _of_few(rows: FloatArray, slopes: FloatArray, variance: float) -> FloatArray:
    """As if residuals were independent and alike, or as they scatter where each counts (HC3; MacKinnon and White 1985).

    In every direction the larger of both: of few points single ones decide.
    """
    bread = np.linalg.pinv(slopes.T @ slopes)
    alike = np.asarray(bread * variance)
    levers = np.einsum("ri,ij,rj->r", slopes, bread, slopes)
    each = (rows / np.maximum(1.0 - levers, MIN_RESIDUAL_SHARE))[:, None] * slopes @ bread
    scale = np.sqrt(np.diag(alike))
    if not scale.all():
        return alike
    both = scale[:, None] * scale
    return np.asarray(larger(alike / both, (each.T @ each) / both) * both)


def covariance_on(
    kind: FeatureKind, shape: Shape, points: FloatArray, *, covariance: FloatArray, rms: float, scanned: float
) -> FloatArray:
    """The covariance of a shape on a face of which a share was scanned, from that of a shape on any surface, (k, k).

    What neighbours' residuals have in common is the form of the face, which is a part of what is measured as far as it
    was scanned, or an error that the scanner repeats. All of it counts where nothing was scanned; where all was, a
    share of it stays for the scanner.
    """
    rows, slopes = distances(kind, shape, points)
    if len(rows) != len(points) or len(points) < MIN_PATCHED_POINTS:
        return covariance
    white = np.asarray(np.linalg.pinv(slopes.T @ slopes) * rms**2, dtype=np.float64)
    return without_form(covariance, white, scanned)


def without_form(covariance: FloatArray, white: FloatArray, scanned: float) -> FloatArray:
    """A covariance, (k, k), less what form of surface that was scanned adds to that of independent noise, (k, k)."""
    lengths = np.sqrt(np.diag(white))
    if not lengths.all():
        return covariance
    scale = lengths[:, None] * lengths
    values, axes = np.linalg.eigh(white / scale)
    root = axes * np.sqrt(np.maximum(values, 1e-12))
    inverse = axes / np.sqrt(np.maximum(values, 1e-12))
    excess, turned = np.linalg.eigh(inverse.T @ (covariance / scale) @ inverse)
    share = SCANNER_ERROR_SHARE + (1.0 - SCANNER_ERROR_SHARE) * (1.0 - scanned)
    wide = root @ turned
    found: FloatArray = ((wide * (1.0 + share * np.maximum(excess - 1.0, 0.0))) @ wide.T) * scale
    return found


def normals_of(kind: FeatureKind, shape: Shape, points: FloatArray) -> FloatArray:
    """Unit normals of a shape beside points, away from its axis or centre, (n, 3)."""
    if kind == "plane":
        return np.broadcast_to(shape.axis, points.shape)
    offsets = points - shape.point
    if kind == "slot":
        x = shape.frame[:, 0]
        offsets = offsets - np.clip(offsets @ x, -shape.half_length, shape.half_length)[:, None] * x
    if kind != "sphere":
        offsets = offsets - (offsets @ shape.axis)[:, None] * shape.axis
    outward: FloatArray = offsets / np.maximum(np.linalg.norm(offsets, axis=1), 1e-300)[:, None]
    if kind == "cone":
        outward = np.cos(shape.half_angle) * outward - np.sin(shape.half_angle) * shape.axis
    return outward


def hidden_form(kind: FeatureKind, shape: Shape, points: FloatArray) -> FloatArray:
    """Covariance of the parameters that lobes give them, (k, k), added to that of noise.

    The fit is repeated with each number of lobes beside the parameters; what these change by counts as often as the
    residuals ask for those lobes (Bayesian information criterion; Schwarz 1978). Of a whole turn nothing changes.
    """
    rows, slopes = distances(kind, shape, points)
    none = np.zeros((slopes.shape[1],) * 2)
    if kind not in ("cylinder", "cone") or len(points) < MIN_POINTS:
        return none
    local = shape.local(points)
    kept = np.abs(rows) <= OUTLIER_SIGMAS * GAUSSIAN_MEDIAN * float(np.median(np.abs(rows)))
    rows, slopes, turn = rows[kept], slopes[kept], np.arctan2(local[kept, 1], local[kept, 0])
    count, scale = len(rows), np.linalg.norm(slopes, axis=0)
    scores, changes = [0.0], [np.zeros(len(scale))]
    least = float(rows @ rows)
    if count < MIN_POINTS or least == 0.0 or not scale.all():
        return none
    for lobes in LOBES:
        both = np.column_stack([slopes / scale, np.cos(lobes * turn), np.sin(lobes * turn)])
        found = np.linalg.lstsq(both, rows, rcond=None)[0]
        left = rows - both @ found
        scores.append(count * np.log(max(float(left @ left) / least, np.finfo(float).tiny)) + 2.0 * np.log(count))
        changes.append(found[: len(scale)] / scale)
    weights = np.exp(-0.5 * (np.array(scores) - min(scores)))
    steps = np.array(changes)
    return np.asarray((steps.T * (weights / weights.sum())) @ steps)

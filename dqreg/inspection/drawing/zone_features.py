"""Features of a scanned face by other rules than least squares: minimum zone, inscribed, circumscribed.

Single points would decide them, so they are fitted to medians of blocks of neighbouring points.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection.decision.places import COVERAGE_FACTOR
from dqreg.inspection.decision.surface_model import blocks_of, sigma_of
from dqreg.inspection.drawing.random_field import Series, drawn_series
from dqreg.inspection.features import Feature, FeatureMethod, fit_feature
from dqreg.inspection.features.fit import ROUND
from dqreg.inspection.features.gauss import fit_gauss
from dqreg.inspection.features.models import distances
from dqreg.inspection.features.spread import normals_of
from dqreg.inspection.features.zone_spread import noise_covariance
from dqreg.solvers.sandwich import larger

PlannedFit = Literal["gauss", "minimum-zone", "inscribed", "circumscribed"]
METHODS: dict[PlannedFit, FeatureMethod] = {
    "gauss": "gauss",
    "minimum-zone": "chebyshev",
    "inscribed": "inscribed",
    "circumscribed": "circumscribed",
}


def zone_feature(gauss: Feature, fit: PlannedFit, points: FloatArray, normals: FloatArray, noise: float) -> Feature:
    """The feature of a face by another rule than least squares, from its points and the least squares one.

    An inscribed or circumscribed radius is without what noise adds to its extremes, see `Drawn.measured`.
    Shapes: (n, 3), (n, 3).
    """
    kind, method = gauss.kind, METHODS[fit]
    if method == "gauss":
        return gauss
    if fit in ("inscribed", "circumscribed") and kind not in ROUND:
        raise InputError(f'fit = "{fit}" is of cylinders and spheres; a {kind} has neither inside nor outside')
    blocks = blocks_of(points)
    rows = np.array(
        [each[np.argmin(np.linalg.norm(points[each] - points[each].mean(axis=0), axis=1))] for each in blocks]
    )
    offsets = distances(kind, gauss.shape, points)[0]
    medians = np.array([np.median(offsets[each]) for each in blocks])
    places = points[rows] + (medians - offsets[rows])[:, None] * normals_of(kind, gauss.shape, points[rows])
    found = fit_feature(places, kind, method=method, normals=normals[rows])
    sigma = sigma_of(noise, min(map(len, blocks)))
    if sigma > 0.0:
        own = noise_covariance(kind, method, places, shape=found.shape, sigma=sigma)
        lengths = np.sqrt(np.diag(own))
        both = lengths[:, None] * lengths
        found = dataclasses.replace(found, covariance=larger(own / both, found.covariance / both) * both)
    if fit in ("inscribed", "circumscribed"):
        found = _without_noise(found, places, sigma)
    return dataclasses.replace(found, points=len(points), outliers=gauss.outliers)


def _without_noise(found: Feature, places: FloatArray, sigma: float) -> Feature:
    """An inscribed or circumscribed feature with the radius that it has without the noise of its places."""
    sign = 1.0 if found.method == "circumscribed" else -1.0
    least = fit_gauss(found.kind, places)
    values, slopes = distances(found.kind, least, places)
    drawn = drawn_series([Series(places, values, slopes, sigma)])
    draws = sign * drawn.values[0]
    depth, wide = sign * (found.radius - least.radius), float((sign * values).max())
    # Least squares shapes follow each draw; the ring is beyond theirs by about the same share.
    share = depth / wide if wide > 0.0 else 1.0
    depth, room = drawn.measured(share * draws.max(axis=1), share * float(draws.mean(axis=0).max()), 0.0)
    k = found.parameters.index("radius")
    scale = np.ones(len(found.parameters))
    scale[k] = max(room / COVERAGE_FACTOR / max(found.sigma("radius"), np.finfo(float).tiny), 1.0)
    return dataclasses.replace(
        found, radius=least.radius + sign * depth, covariance=found.covariance * scale * scale[:, None]
    )

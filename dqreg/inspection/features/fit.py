"""Fits of ideal shapes to points: least squares, minimum zone, inscribed and circumscribed, with outliers cut."""

from __future__ import annotations

import dataclasses
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_vectors, require_workable
from dqreg._numbers import is_number
from dqreg.errors import DegenerateGeometryError, InputError, did_you_mean
from dqreg.inspection.features.feature import Feature, FeatureMethod
from dqreg.inspection.features.gauss import fit_gauss
from dqreg.inspection.features.models import FEWEST, PARAMETERS, FeatureKind, Shape, as_displacements, distances
from dqreg.inspection.features.spread import covariance_of
from dqreg.inspection.features.zone import fit_zone
from dqreg.inspection.features.zone_spread import zone_covariance
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# Shapes that have a largest one inside and a least one outside.
ROUND = ("circle", "cylinder", "sphere")
# Parameters are not held by points where a singular value is below that share of the largest one.
MIN_SINGULAR_RATIO = 1e-8
# Rounds of cutting outliers at most.
MAX_CUT_ROUNDS = 10


def fit_feature(
    points: ArrayLike,
    kind: FeatureKind,
    *,
    method: FeatureMethod = "gauss",
    normals: ArrayLike | None = None,
    cut: float | None = None,
) -> Feature:
    """Fit an ideal shape to points by orthogonal distances.

    ``gauss`` is the least squares shape (the digits of the points are reached), ``chebyshev`` the one of least form
    error (minimum zone), ``inscribed`` and ``circumscribed`` the largest within and the least about a circle, cylinder
    or sphere: linear programs from the least squares shape. A line's minimum zone is the least cylinder about it.
    Single points decide these: of a noisy scan an inscribed circle is too small, a circumscribed one too large, by
    three to five of its standard deviations, which are of its scatter alone. Plans measure by least squares.

    Parameters
    ----------
    points : array_like, (n, 3)
        Any length unit.
    kind : {"plane", "line", "circle", "cylinder", "cone", "sphere", "slot"}
        The shape; a slot is the wall of a hole with two flat sides and round ends.
    method : {"gauss", "chebyshev", "inscribed", "circumscribed"}
        What is least or largest.
    normals : array_like, (n, 3), optional
        Unit normals at the points: they tell the axis of a cylinder or cone at once, and the side of a plane.
    cut : float, optional
        Points farther than that many robust standard deviations are cut, and the shape fitted again, until none is.

    Returns
    -------
    Feature
        In the frame of the points.

    Raises
    ------
    InputError
        If a word or the points cannot be used.
    DegenerateGeometryError
        If the points are too few, or do not hold every parameter of the shape: an inscribed or circumscribed one is
        held by points that surround it, more than half of the way round.

    Examples
    --------
    >>> angle = np.linspace(0.0, 1.0, 50)
    >>> arc = np.column_stack([3 * np.cos(angle), 3 * np.sin(angle), np.zeros(50)])
    >>> found = fit_feature(arc + [10, 0, 5], "circle")
    >>> round(found.radius, 9), (found.point.round(9) + 0.0).tolist()
    (3.0, [10.0, 0.0, 5.0])
    """
    chosen = as_vectors(points, "points")
    sides = None if normals is None else as_vectors(normals, "normals")
    _check(chosen, kind, method)
    require_workable(chosen, "points")
    _check_options(chosen, sides, cut)
    _require_spread(chosen, kind)
    used = np.ones(len(chosen), dtype=bool)
    for _ in range(MAX_CUT_ROUNDS if cut is not None else 1):
        shape = fit_gauss(kind, chosen[used], None if sides is None else sides[used])
        if cut is None:
            break
        sizes = np.abs(_offsets(kind, shape, chosen))
        inside = sizes <= max(cut * GAUSSIAN_MEDIAN * float(np.median(sizes[used])), 1e-12 * float(np.ptp(chosen)))
        if (inside == used).all() or inside.sum() < FEWEST[kind]:
            break
        used = inside
    kept = chosen[used]
    _require_held(kind, shape, kept)
    gauss = shape
    if method != "gauss":
        shape = fit_zone(kind, method, kept, gauss)
    found = _feature(kind, method, shape, kept, len(chosen) - len(kept))
    if method != "gauss":
        spread = zone_covariance(kind, method, kept, shape=shape, gauss=gauss)
        found = dataclasses.replace(found, covariance=spread)
    if sides is not None and kind == "plane" and found.axis @ sides[used].mean(axis=0) < 0.0:
        return found.reversed()
    return found


def zone_width(points: FloatArray, kind: FeatureKind) -> float:
    """Form error of the minimum zone of points that hold the shape."""
    shape = fit_zone(kind, "chebyshev", points, fit_gauss(kind, points))
    return _form(kind, distances(kind, shape, points)[0], len(points))


def _check(points: FloatArray, kind: str, method: str) -> None:
    for word, known, name in ((kind, tuple(PARAMETERS), "kind"), (method, get_args(FeatureMethod), "method")):
        if word not in known:
            raise InputError(f"{name} must be one of {', '.join(known)}; got {word!r}{did_you_mean(str(word), known)}")
    if method in ("inscribed", "circumscribed") and kind not in ROUND:
        raise InputError(f"method {method!r} is for {', '.join(ROUND)}; a {kind} has neither inside nor outside")
    if len(points) < FEWEST[kind]:  # type: ignore[index]
        needed = FEWEST[kind]  # type: ignore[index]
        raise DegenerateGeometryError(f"a {kind} needs at least {needed} points; got {len(points)}")


def _check_options(points: FloatArray, normals: FloatArray | None, cut: float | None) -> None:
    if normals is not None and len(normals) != len(points):
        raise InputError(f"normals must be as many as points; got {len(normals)} for {len(points)} points")
    usable = cut is None or (is_number(cut) and cut > 0.0)
    if not usable:
        raise InputError(f"cut must be a number of standard deviations above 0; got {cut!r:.60}")


def _require_spread(points: FloatArray, kind: FeatureKind) -> None:
    """Points on one line, or one plane, are on so many shapes that a fit would find any of them."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    # Far from the origin the digits of the coordinates themselves are spread.
    rounding = 8.0 * np.finfo(float).eps * float(np.abs(points).max()) * np.sqrt(len(points))
    least = max(MIN_SINGULAR_RATIO * spread[0], rounding)
    needed = {"plane": 1, "line": 0, "circle": 1}.get(kind, 2)
    if spread[needed] <= least:
        raise _not_held(kind, len(points))


def _not_held(kind: FeatureKind, count: int) -> DegenerateGeometryError:
    return DegenerateGeometryError(
        f"{count} points do not hold a {kind}: they lie too nearly on one place, line, circle or plane; "
        "measure more of the feature, or fit another kind"
    )


def _offsets(kind: FeatureKind, shape: Shape, points: FloatArray) -> FloatArray:
    """Signed distance of each point; of a line the distance, of a circle the distance from its rim."""
    rows = distances(kind, shape, points)[0]
    if kind not in ("line", "circle"):
        return rows
    return np.hypot(rows[: len(points)], rows[len(points) :])


def _require_held(kind: FeatureKind, shape: Shape, points: FloatArray) -> None:
    _, slopes = distances(kind, shape, points)
    size = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    values = np.linalg.svd(slopes * as_displacements(kind, size), compute_uv=False) if size > 0.0 else np.zeros(1)
    if values[-1] <= MIN_SINGULAR_RATIO * max(values[0], np.finfo(float).tiny):
        raise _not_held(kind, len(points))


def _feature(kind: FeatureKind, method: FeatureMethod, shape: Shape, points: FloatArray, outliers: int) -> Feature:
    rows, slopes = distances(kind, shape, points)
    return Feature(
        kind=kind,
        method=method,
        point=shape.point,
        axis=np.full(3, np.nan) if kind == "sphere" else shape.axis,
        radius=shape.radius if kind not in ("plane", "line") else np.nan,
        half_angle=shape.half_angle if kind == "cone" else np.nan,
        form=_form(kind, rows, len(points)),
        rms=float(np.sqrt(np.mean(_offsets(kind, shape, points) ** 2))),
        points=len(points),
        outliers=outliers,
        covariance=covariance_of(kind, shape, points, rows, slopes),
        parameters=PARAMETERS[kind],
        frame=shape.frame,
        half_length=shape.half_length if kind == "slot" else np.nan,
    )


def _form(kind: FeatureKind, rows: FloatArray, count: int) -> float:
    if kind == "line":
        return 2.0 * float(np.hypot(rows[:count], rows[count:]).max())
    if kind == "circle":
        return float(np.ptp(rows[count:]))
    return float(np.ptp(rows))

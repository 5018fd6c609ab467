"""Fits of ideal shapes: exact data, other origins and units, 50-digit arithmetic, brute force, simulation."""

from __future__ import annotations

from typing import Any, get_args

import mpmath
import numpy as np
import pytest
from scipy.optimize import minimize

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.features import Feature, FeatureKind, fit_feature
from dqreg.inspection.features.gauss import fit_gauss
from dqreg.inspection.features.models import PARAMETERS, Shape, distances
from dqreg.inspection.features.starts import frame_along
from dqreg.inspection.features.zone import fit_zone
from dqreg.rigid import pose

# Slots have tests of their own.
KINDS = tuple(kind for kind in get_args(FeatureKind) if kind != "slot")
RADIUS, ANGLE = 2.0, 0.3


def made(kind: str, count: int, seed: int, *, noise: float = 0.0, arc: float = 2 * np.pi, origin: float = 0.0) -> Any:
    """Points of a shape of radius 2 at a random place, the frame and the place; noise along the normals."""
    rng = np.random.default_rng(seed)
    t, z = rng.uniform(0.0, arc, count), rng.uniform(-3.0, 3.0, count)
    radius = RADIUS + noise * rng.normal(size=count) + (np.tan(ANGLE) * z if kind == "cone" else 0.0)
    q = np.column_stack([radius * np.cos(t), radius * np.sin(t), z])
    if kind == "plane":
        q = np.column_stack([rng.uniform(-3.0, 3.0, (count, 2)), noise * rng.normal(size=count)])
    elif kind == "line":
        q = np.column_stack([noise * rng.normal(size=(count, 2)), z])
    elif kind == "circle":
        q[:, 2] = noise * rng.normal(size=count)
    elif kind == "sphere":
        q = rng.normal(size=(count, 3))
        q[:, 2] = np.abs(q[:, 2]) if arc < 6.0 else q[:, 2]
        q *= radius[:, None] / np.linalg.norm(q, axis=1)[:, None]
    frame, place = frame_along(rng.normal(size=3)), rng.normal(size=3) + origin
    return q @ frame.T + place, frame, place


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_those_of_finite_differences(kind: FeatureKind) -> None:
    rng = np.random.default_rng(0)
    shape = Shape(rng.normal(size=3), frame_along(rng.normal(size=3)), 1.3, 0.3 if kind == "cone" else 0.0)
    points, h = rng.normal(size=(20, 3)), 1e-6
    _, slopes = distances(kind, shape, points)
    for k, unit in enumerate(np.eye(slopes.shape[1])):
        ahead = distances(kind, shape.moved(kind, h * unit), points)[0]
        behind = distances(kind, shape.moved(kind, -h * unit), points)[0]
        np.testing.assert_allclose((ahead - behind) / (2 * h), slopes[:, k], atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("arc", [2 * np.pi, 0.6])
@pytest.mark.parametrize("origin", [0.0, 1e4])
def test_exact_points_give_the_shape_back(kind: FeatureKind, arc: float, origin: float) -> None:
    for seed in range(3):
        points, frame, place = made(kind, 40, seed, arc=arc, origin=origin)
        found = fit_feature(points, kind)
        # The digits of coordinates of that size, times what a tenth of a turn loses: (1 - cos 0.3)^-1 = 22.
        digits = 40.0 * np.finfo(float).eps * (10.0 + origin) * (22.0 if arc < 1.0 else 1.0)
        assert found.form <= digits
        if kind in ("circle", "cylinder", "sphere"):
            assert found.radius == pytest.approx(RADIUS, abs=digits * 22.0)
        if kind == "cone":
            assert abs(found.half_angle) == pytest.approx(ANGLE, abs=digits * 22.0)
            along = (found.point - place) @ frame[:, 2]
            assert found.radius == pytest.approx(RADIUS + np.tan(ANGLE) * along, abs=digits * 22.0)
        if kind != "sphere":
            assert np.linalg.norm(np.cross(found.axis, frame[:, 2])) <= digits * 22.0


@pytest.mark.parametrize("kind", KINDS)
def test_another_frame_and_unit_give_the_same_feature(kind: FeatureKind) -> None:
    points, _, _ = made(kind, 60, 5, noise=0.02)
    T, scale = pose.random(np.random.default_rng(1), reach=50.0), 25.4
    here, there = fit_feature(points, kind), fit_feature(scale * pose.apply(T, points), kind)
    assert there.form == pytest.approx(scale * here.form, rel=1e-9)
    assert there.rms == pytest.approx(scale * here.rms, rel=1e-9)
    if kind not in ("plane", "line"):
        assert there.radius == pytest.approx(scale * here.radius, rel=1e-9)


def cost_in_50_digits(kind: str, parameters: list[Any], points: np.ndarray) -> Any:
    """Sum of squared distances of a shape given by an axis point, an axis, a radius and a half angle, from scratch."""
    place, axis, radius, angle = parameters[:3], parameters[3:6], parameters[6], parameters[7]
    norm = mpmath.sqrt(sum(a * a for a in axis))
    total = mpmath.mpf(0)
    for row in points.tolist():
        offset = [mpmath.mpf(x) - c for x, c in zip(row, place, strict=True)]
        along = sum(o * a for o, a in zip(offset, axis, strict=True)) / norm
        squared = sum(o * o for o in offset)
        across = mpmath.sqrt(squared - along * along) if kind not in ("plane", "sphere") else mpmath.mpf(0)
        if kind == "plane":
            total += along**2
        elif kind == "line":
            total += squared - along**2
        elif kind == "circle":
            total += along**2 + (across - radius) ** 2
        elif kind == "sphere":
            total += (mpmath.sqrt(squared) - radius) ** 2
        else:
            slant = angle if kind == "cone" else mpmath.mpf(0)
            total += (mpmath.cos(slant) * (across - radius) - mpmath.sin(slant) * along) ** 2
    return total


@pytest.mark.parametrize("kind", KINDS)
def test_least_squares_are_stationary_in_50_digits(kind: FeatureKind) -> None:
    """Newton's step from the answer, in 50 digits and coordinates of its own, is below 1e-12 of the size."""
    points, _, _ = made(kind, 14, 11, noise=0.05, arc=3.0)
    shape = fit_gauss(kind, points)
    with mpmath.workdps(50):
        start = [mpmath.mpf(float(x)) for x in (*shape.point, *shape.axis, shape.radius, shape.half_angle)]
        # Along the shape's own parameters, which leave out what changes nothing.
        base = {"tilt_x": (3, shape.frame[:, 1], -1), "tilt_y": (3, shape.frame[:, 0], 1)}
        base |= {f"shift_{axis}": (0, shape.frame[:, k], 1) for k, axis in enumerate("xyz")}

        def cost(*step: Any) -> Any:
            here = list(start)
            for name, value in zip(PARAMETERS[kind], step, strict=True):
                if name in base:
                    first, direction, sign = base[name]
                    for k in range(3):
                        here[first + k] += sign * value * mpmath.mpf(float(direction[k]))
                else:
                    here[6 if name == "radius" else 7] += value
            return cost_in_50_digits(kind, here, points)

        count, h = len(PARAMETERS[kind]), mpmath.mpf(10) ** -12
        unit = [[h if i == j else mpmath.mpf(0) for j in range(count)] for i in range(count)]
        gradient = [(cost(*e) - cost(*[-x for x in e])) / (2 * h) for e in unit]
    # The Hessian needs no such digits.
    _, slopes = distances(kind, shape, points)
    newton = np.linalg.solve(2.0 * slopes.T @ slopes, np.array([float(g) for g in gradient]))
    assert np.abs(newton).max() < 1e-12


@pytest.mark.parametrize(
    ("kind", "method"),
    [(kind, "chebyshev") for kind in KINDS]
    + [(kind, method) for kind in ("circle", "cylinder", "sphere") for method in ("inscribed", "circumscribed")],
)
def test_no_search_finds_a_narrower_zone(kind: FeatureKind, method: Any) -> None:
    points, _, _ = made(kind, 25, 3, noise=0.03)
    shape = fit_gauss(kind, points)
    found = fit_zone(kind, method, points, shape)
    free = np.array([not (kind == "circle" and name in ("tilt_x", "tilt_y", "shift_z")) for name in PARAMETERS[kind]])

    def height(other: Shape) -> float:
        if kind == "line":
            return float(np.hypot(*distances(kind, other, points)[0].reshape(2, -1)).max())
        values = distances(kind, other, points)[0][-len(points) :]
        if method == "chebyshev":
            return float(np.abs(values).max())
        sizes = values + other.radius
        return float(sizes.max() if method == "circumscribed" else -sizes.min())

    best = height(found)
    assert best < height(shape)
    rng = np.random.default_rng(0)
    for _ in range(3):
        begin = rng.normal(0.0, 0.01, len(free))
        other = minimize(lambda step: height(shape.moved(kind, step * free)), begin, method="Nelder-Mead",
                         options={"xatol": 1e-12, "fatol": 1e-13, "maxfev": 3000})  # fmt: skip
        assert best <= other.fun + 1e-9 * RADIUS


@pytest.mark.parametrize("kind", KINDS)
def test_covariances_are_those_of_repeated_measurements(kind: FeatureKind) -> None:
    # What the truth's residuals ask of the fit, to first order, against the stated covariance: chi-squared with k
    # degrees of freedom, whose mean over 60 trials scatters by sqrt(2 k / 60); Student's t adds 2 / (n - k - 2) of it.
    count, squares = len(PARAMETERS[kind]), []
    for seed in range(60):
        points, frame, place = made(kind, 60, 100 + seed, noise=0.01, arc=4.0)
        truth = Shape(place, frame, RADIUS if kind not in ("plane", "line") else 0.0, ANGLE if kind == "cone" else 0.0)
        radial = truth.local(points) * [1.0, 1.0, 0.0]
        sides = radial / np.linalg.norm(radial, axis=1)[:, None] @ frame.T
        found = fit_feature(points, kind, normals=sides if kind in ("cylinder", "cone") else None)
        residuals, slopes = distances(kind, truth, points)
        error = np.linalg.lstsq(slopes, residuals, rcond=None)[0]
        squares.append(error @ np.linalg.solve(_turned(found, truth.frame.T @ found.frame), error))
    assert np.mean(squares) == pytest.approx(count, abs=4.0 * np.sqrt(2.0 * count / 60) + 0.06 * count)


def _turned(found: Feature, turn: np.ndarray) -> np.ndarray:
    """The covariance in the frame of the truth: local x and y of fit and truth differ by a turn about the axis."""
    matrix = np.eye(len(found.parameters))
    for names in (("tilt_x", "tilt_y"), ("shift_x", "shift_y", "shift_z")):
        known = [name for name in names if name in found.parameters]
        rows = [found.parameters.index(name) for name in known]
        axes = ["xyz".index(name[-1]) for name in known]
        matrix[np.ix_(rows, rows)] = turn[np.ix_(axes, axes)]
    if turn[2, 2] < 0.0 and "half_angle" in found.parameters:
        matrix[-1, -1] = -1.0
    covariance: np.ndarray = matrix @ found.covariance @ matrix.T
    return covariance


@pytest.mark.parametrize(
    ("kind", "method", "runs"),
    [("plane", "chebyshev", 12)]
    + [
        pytest.param(kind, method, 40, marks=pytest.mark.soak)
        for kind, method in (
            ("line", "chebyshev"), ("circle", "chebyshev"), ("circle", "inscribed"), ("cylinder", "chebyshev"),
            ("cylinder", "circumscribed"), ("sphere", "chebyshev"),
        )
    ],
)  # fmt: skip
def test_a_zone_is_as_uncertain_as_its_fit_repeats(kind: FeatureKind, method: Any, runs: int) -> None:
    # Of one set of places with other noise each time: the scatter of the place and the size, and the stated one.
    exact, frame, place = made(kind, 40, 1, arc=4.0)
    found, stated = [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        points = exact + 0.01 * rng.normal(size=exact.shape)
        shape = fit_feature(points, kind, method=method)
        offset = (shape.point - place) @ frame
        if kind == "plane":
            # Two planes of a part in 1000 of a radian: beside the same place.
            found.append([float((shape.point - place) @ shape.axis * np.sign(shape.axis @ frame[:, 2]))])
            arms = shape.frame.T @ (place - shape.point)
            row = np.array([arms[1], -arms[0], 1.0])
        else:
            found.append([shape.radius] if "radius" in shape.parameters else [float(np.hypot(offset[0], offset[1]))])
            row = np.zeros(len(shape.parameters))
            row[shape.parameters.index("radius") if "radius" in shape.parameters else 2] = 1.0
        stated.append(float(np.sqrt(row @ shape.covariance @ row)))
    scatter = float(np.std(found, ddof=1))
    # The scatter of 12 is known to a fifth, that of 40 to a ninth; light tails are taken for a little heavier.
    assert 0.55 < float(np.sqrt(np.mean(np.square(stated)))) / scatter < 2.2


def test_outliers_are_cut_and_counted() -> None:
    points, _, _ = made("cylinder", 300, 2, noise=0.01)
    points[:12] += np.random.default_rng(0).normal(size=(12, 3))
    found = fit_feature(points, "cylinder", cut=3.5)
    assert 8 <= found.outliers <= 20
    assert found.points + found.outliers == 300
    assert found.radius == pytest.approx(RADIUS, abs=0.005)
    assert abs(fit_feature(points, "cylinder").radius - RADIUS) > abs(found.radius - RADIUS)


def test_a_plane_faces_the_side_of_its_normals_and_moves_with_a_pose() -> None:
    points, frame, _ = made("plane", 50, 4, noise=0.01)
    for side in (1.0, -1.0):
        found = fit_feature(points, "plane", normals=np.tile(side * frame[:, 2], (50, 1)))
        assert found.axis @ frame[:, 2] == pytest.approx(side, abs=1e-3)
    T = pose.random(np.random.default_rng(3), reach=5.0)
    moved, again = found.moved(T), fit_feature(pose.apply(T, points), "plane")
    assert abs((moved.point - again.point) @ again.axis) < 1e-12
    # To the sign of a normal that nothing told.
    assert abs(moved.axis @ again.axis) == pytest.approx(1.0)
    assert moved.form == pytest.approx(again.form)


@pytest.mark.parametrize(
    ("points", "kind", "options", "error", "words"),
    [
        (np.zeros((3, 3)), "plane", {}, DegenerateGeometryError, "at least 4 points"),
        (np.zeros((9, 3)), "plane", {}, DegenerateGeometryError, "do not hold a plane"),
        (np.outer(np.arange(9.0), [1, 2, 3]), "plane", {}, DegenerateGeometryError, "do not hold a plane"),
        (np.eye(3)[[0, 1, 2] * 4], "cylindre", {}, InputError, "did you mean cylinder"),
        (np.eye(3)[[0, 1, 2] * 4], "plane", {"method": "inscribed"}, InputError, "neither inside nor outside"),
        (np.full((9, 3), np.nan), "plane", {}, InputError, "points"),
        (np.ones((9, 3)), "cone", {}, DegenerateGeometryError, "do not hold a cone"),
        (np.outer(np.arange(9.0), [1, 2, 3]), "slot", {}, DegenerateGeometryError, "do not hold a slot"),
        (np.random.default_rng(0).normal(size=(30, 3)) * [1, 1, 0], "cone", {}, DegenerateGeometryError, "plane"),
        (np.eye(3)[[0, 1, 2] * 4], "plane", {"normals": np.ones((3, 3))}, InputError, "got 3 for 12 points"),
        (np.eye(3)[[0, 1, 2] * 4], "plane", {"cut": float("nan")}, InputError, "above 0; got nan"),
        (np.eye(3)[[0, 1, 2] * 4], "plane", {"cut": "3"}, InputError, "above 0; got '3'"),
    ],
)
def test_what_cannot_be_fitted_is_named(points: Any, kind: Any, options: Any, error: Any, words: str) -> None:
    with pytest.raises(error, match=words):
        fit_feature(points, kind, **options)

"""Tori: fillets whose corners determine them, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.inspection.features.torus import Torus, fit_torus
from dqreg.rigid import twist


def grid(at, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Triangles of a surface over two parameters, and their normals. Shapes: (f, 3, 3), (f, 3)."""
    points = at(*np.meshgrid(u, v, indexing="ij"))
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.linalg.norm(normals, axis=1)[:, None]


def torus(major: float, minor: float):
    return lambda u, v: np.stack(
        [(major + minor * np.cos(v)) * np.cos(u), (major + minor * np.cos(v)) * np.sin(u), minor * np.sin(v)], axis=-1
    )


def found(corners: FloatArray, normals: FloatArray) -> Torus | None:
    return fit_torus(corners, normals, 1e-4 * float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))))


FULL = np.linspace(0.0, 2.0 * np.pi, 33)
QUARTER = np.linspace(np.pi, 1.5 * np.pi, 6)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
@pytest.mark.parametrize(("offset", "digits"), [(0.0, 1e-9), (5e6, 1e-7)])
@pytest.mark.parametrize(
    ("u", "v", "major", "minor"),
    [
        (FULL, FULL, 12.0, 2.0),
        (FULL, QUARTER, 12.0, 2.0),
        (np.linspace(0.0, 2.0 * np.pi, 161), QUARTER, 12.0, 2.0),
        (np.linspace(0.0, 0.5 * np.pi, 7), QUARTER, 30.0, 1.5),
        (np.linspace(-0.4, 0.4, 5), np.linspace(0.0, np.pi / 3.0, 4), 8.0, 3.0),
        (FULL, np.linspace(0.0, 0.5 * np.pi, 7), 1.0, 4.0),
    ],
    ids=[
        "full",
        "fillet round a boss",
        "cut finely round its axis",
        "fillet along a bend",
        "small patch",
        "rounded end of a shaft",
    ],
)
def test_radii_axis_and_centre_of_exact_corners(u, v, major, minor, offset: float, digits: float, unit: float) -> None:
    # At 5e6 the coordinates themselves end at 1e-9; a patch multiplies that.
    corners, normals = grid(torus(major, minor), u, v)
    turn = twist.exp(np.array([0.7, -0.4, 1.1, 0.0, 0.0, 0.0]))[:3, :3]
    shift = np.array([1.0, -2.0, 3.0]) + offset
    exact = found(unit * (corners @ turn.T + shift), normals @ turn.T)
    assert exact is not None
    size = unit * (major + minor)
    assert abs(exact.major_radius - unit * major) < digits * size
    assert abs(exact.minor_radius - unit * minor) < digits * size
    assert np.linalg.norm(exact.centre - unit * shift) < digits * size + 1e-15 * unit * offset * 4
    assert abs(exact.axis @ turn[:, 2]) > 1.0 - digits
    assert exact.axis[np.argmax(np.abs(exact.axis))] > 0.0


def profile(radius, height):
    return lambda u, v: np.stack([radius(v) * np.cos(u), radius(v) * np.sin(u), height(v)], axis=-1)


@pytest.mark.parametrize(
    ("at", "v"),
    [
        (profile(lambda v: 5.0 + 0.0 * v, lambda v: v), np.linspace(0.0, 4.0, 6)),
        (profile(lambda v: 5.0 + 0.3 * v, lambda v: v), np.linspace(0.0, 4.0, 6)),
        (profile(lambda v: 5.0 * np.cos(v), lambda v: 5.0 * np.sin(v)), np.linspace(0.1, 0.9, 6)),
        (profile(lambda v: 12.0 + 2.0 * np.cos(v), lambda v: 2.2 * np.sin(v)), QUARTER),
        (profile(lambda v: 500.0 + 2.0 * np.cos(v), lambda v: 2.2 * np.sin(v)), QUARTER),
        (profile(lambda v: 5.0 + 0.1 * v**2, lambda v: v), np.linspace(-1.0, 3.0, 6)),
        (torus(12.0, 2.0), QUARTER[[0, 2, 5]]),
        (torus(12.0, 2.0), QUARTER[[0, 5]]),
    ],
    ids=["cylinder", "cone", "sphere", "ellipse", "ellipse far out", "parabola", "three rims", "two rims"],
)
def test_other_shapes_are_no_torus(at, v: FloatArray) -> None:
    # Of a fillet with three rims a free profile says the same.
    assert found(*grid(at, FULL, v)) is None


def test_as_many_corners_as_a_torus_has_parameters_are_none() -> None:
    # Seven corners of any shape are on a torus, to the last digit.
    turns = np.linspace(0.0, 2.0 * np.pi, 7)[:-1]
    drawn = np.random.default_rng(5)
    for _ in range(20):
        rim = np.stack([np.cos(turns), np.sin(turns), 0.3 * drawn.standard_normal(6)], axis=1)
        fan = np.stack([np.tile([0.0, 0.0, 0.5], (6, 1)), rim, np.roll(rim, -1, axis=0)], axis=1)
        normals = np.cross(fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0])
        assert found(fan, normals / np.linalg.norm(normals, axis=1)[:, None]) is None


def test_a_free_patch_and_a_bent_flat_patch_are_no_torus() -> None:
    u = np.linspace(-1.0, 1.0, 8)
    saddle = grid(lambda x, y: np.stack([x, y, 0.2 * x**2 - 0.1 * y**3 + 0.1 * x * y], axis=-1), u, u)
    assert found(*saddle) is None
    # Corners of one flat face on the equator of a torus: they are on one circle only.
    turns = FULL[:-1]
    disk = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
    fan = np.stack([np.broadcast_to(disk[0], (30, 3)), disk[1:-1], disk[2:]], axis=1)
    assert found(fan, np.tile([0.0, 0.0, 1.0], (30, 1))) is None


def test_a_fillet_with_the_flat_end_that_it_runs_into_is_no_torus() -> None:
    # All corners of the flat end are on the rim of the fillet, and so on the torus.
    rounded, normals = grid(torus(12.0, 2.0), FULL, np.linspace(0.5 * np.pi, 0.0, 6))
    rim = np.stack([12.0 * np.cos(FULL[:-1]), 12.0 * np.sin(FULL[:-1]), np.full(len(FULL) - 1, 2.0)], axis=1)
    end = np.stack([np.broadcast_to(rim[0], (30, 3)), rim[1:-1], rim[2:]], axis=1)
    assert found(rounded, normals) is not None
    assert found(np.concatenate([rounded, end]), np.concatenate([normals, np.tile([0.0, 0.0, 1.0], (30, 1))])) is None

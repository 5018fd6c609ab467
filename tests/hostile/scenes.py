"""What the hostile inputs are made from: one part, one scan of it, one start; and the calls that must survive them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.registration.result.result import Registration
from dqreg.registration.target import Target, prepare_target
from dqreg.synth import disturbance
from tests.icp.scenes import bracket_mesh, bracket_points

PART = bracket_mesh()
SIZE = PART.diagonal
SCAN = bracket_points(25, seed=0)
FIXED = bracket_points(30, seed=1)
START = disturbance(np.random.default_rng(1), np.deg2rad(4.0), 0.02 * SIZE, PART.centre)


@cache
def part() -> Target:
    """The part, indexed once."""
    return prepare_target(PART)


def with_rows(rows: Any, base: FloatArray = SCAN) -> FloatArray:
    """The scan with hostile rows between its own."""
    hostile = np.atleast_2d(np.asarray(rows, dtype=np.float64))
    return np.insert(base, np.linspace(0, len(base), len(hostile)).astype(int), hostile, axis=0)


def with_faces(faces: Any, vertices: Any = ()) -> Mesh:
    """The part with more faces, and more vertices behind its own."""
    more = np.concatenate([PART.vertices, np.reshape(np.asarray(vertices, dtype=np.float64), (-1, 3))])
    return Mesh(more, np.concatenate([PART.faces, np.reshape(np.asarray(faces), (-1, 3))]))


def assert_kept(result: Registration) -> None:
    """What every result promises, asked again from outside the package.

    A pose is rigid to 1e-12 with the last row 0 0 0 1, or it is NaN as a whole and the verdict is "failed"; a
    covariance is NaN or symmetric positive semidefinite; numbers are finite or say that nothing was found.
    """
    T, C = result.T_target_source, result.covariance
    assert T.shape == (4, 4)
    assert C.shape == (6, 6)
    if np.isnan(T).all():
        assert result.verdict.level == "failed"
        assert np.isnan(C).all()
        assert np.isnan(result.rms)
    else:
        assert np.isfinite(T).all()
        assert result.verdict.level != "failed"
        assert np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max() <= 1e-12
        assert np.linalg.det(T[:3, :3]) > 0.0
        np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])
        assert result.rms >= 0.0
        assert np.isfinite(result.rms)
    np.testing.assert_array_equal(np.isnan(C), np.isnan(C).T)
    assert not np.isinf(C).any()
    known = ~np.isnan(np.diag(C))
    held = C[np.ix_(known, known)]
    assert np.isfinite(held).all()
    if len(held):
        scale = np.sqrt(np.where(np.diag(held) > 0.0, np.diag(held), 1.0))
        correlation = held / scale / scale[:, None]
        np.testing.assert_allclose(correlation, correlation.T, rtol=0.0, atol=1e-9)
        assert np.linalg.eigvalsh(correlation).min() >= -1e-9
    assert 0.0 <= result.inlier_fraction <= 1.0
    assert result.verdict.reasons
    assert all(result.verdict.reasons)

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

from dqreg.errors import DegenerateGeometryError
from dqreg.rigid.quaternion import to_matrix
from dqreg.solvers.closed_form import quaternion_form, require_determined
from tests.solvers.problems import fast
from tests.strategies import floats, unit_quaternions

matrices = arrays(np.float64, (3, 3), elements=floats(-10, 10))


@fast
@given(matrices, unit_quaternions())
def test_the_form_is_the_fit_of_the_rotation(H, r):
    assert r @ quaternion_form(H) @ r == pytest.approx(np.trace(to_matrix(r).T @ H), abs=1e-12)


@fast
@given(matrices)
def test_the_form_is_symmetric_and_has_no_trace(H):
    N = quaternion_form(H)
    np.testing.assert_array_equal(N, N.T)
    assert np.trace(N) == pytest.approx(0.0, abs=1e-13)


@fast
@given(matrices)
def test_its_eigenvalues_are_sums_of_singular_values(H):
    s1, s2, s3 = np.linalg.svd(H, compute_uv=False) * [1, 1, np.sign(np.linalg.det(H)) or 1.0]
    expected = [-s1 - s2 + s3, -s1 + s2 - s3, s1 - s2 - s3, s1 + s2 + s3]
    np.testing.assert_allclose(np.linalg.eigvalsh(quaternion_form(H)), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("lambda_2", "reach"), [(1.0, 1.0), (1.0 - 1e-13, 1.0), (0.5, 1e13)])
def test_a_gap_of_rounding_raises_and_is_told(lambda_2, reach):
    with pytest.raises(DegenerateGeometryError, match=f"{(1.0 - lambda_2):.3g}"):
        require_determined(1.0, 1.0 - lambda_2, reach)


def test_no_fit_at_all_raises():
    with pytest.raises(DegenerateGeometryError, match="is 0 "):
        require_determined(0.0, 0.0, 0.0)

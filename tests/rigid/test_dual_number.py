from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.rigid import DualNumber
from tests.strategies import floats

fast = settings(deadline=None, max_examples=40)
dual_numbers = st.builds(DualNumber, floats(-10, 10), floats(-10, 10))


def matrix(a):
    """The 2x2 matrices [[a, b], [0, a]] add and multiply as dual numbers do: eps is [[0, 1], [0, 0]]."""
    return np.array([[a.real, a.dual], [0.0, a.real]])


@fast
@given(dual_numbers, dual_numbers)
def test_equation_51(a, b):
    np.testing.assert_array_equal(matrix(a + b), matrix(a) + matrix(b))
    np.testing.assert_array_equal(matrix(a - b), matrix(a) - matrix(b))
    np.testing.assert_allclose(matrix(a * b), matrix(a) @ matrix(b), rtol=0, atol=1e-13)


@fast
@given(dual_numbers)
def test_equations_53_and_54(a):
    assert a * a.conjugate() == DualNumber(a.real * a.real, 0.0)
    assert a.modulus() == a.real


@fast
@given(floats(-3, 3), floats(-10, 10))
def test_equations_55_to_59(theta, d):
    # sin and cos of a dual angle (eq. 52); eq. 59 with eps^2 = 0 is a derivative, so differences are its oracle.
    angle = DualNumber(theta, d)
    h = 1e-5
    for function, value in ((math.sin, angle.sin()), (math.cos, angle.cos())):
        assert value.real == function(theta)
        slope = (function(theta + h) - function(theta - h)) / (2 * h)
        assert value.dual == pytest.approx(d * slope, abs=1e-8)
    one = angle.sin() * angle.sin() + angle.cos() * angle.cos()
    assert one.real == pytest.approx(1, abs=1e-15)
    assert one.dual == pytest.approx(0, abs=1e-14)


@fast
@given(dual_numbers)
def test_a_power_series_ends_after_the_slope(a):
    # Eqs. 58-59 for x^3: the product of three equals f(a) + eps b f'(a).
    cube = a * a * a
    extended = a.extend(lambda x: x**3, lambda x: 3 * x**2)
    assert cube.real == pytest.approx(extended.real, rel=1e-14, abs=1e-300)
    assert cube.dual == pytest.approx(extended.dual, rel=1e-13, abs=1e-300)


@fast
@given(floats(1e-3, 1e3), floats(-10, 10))
def test_square_root(a, b):
    root = DualNumber(a, b).sqrt()
    assert (root * root).real == pytest.approx(a, rel=1e-15)
    assert (root * root).dual == pytest.approx(b, rel=1e-14)


@pytest.mark.parametrize("real", [0.0, -1.0, math.nan])
def test_no_root_without_a_slope(real):
    with pytest.raises(InputError, match="positive"):
        DualNumber(real, 1.0).sqrt()

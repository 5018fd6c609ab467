from __future__ import annotations

import numpy as np
import pytest

from dqreg.papers.convergence import convergence_section, measure_convergence
from dqreg.papers.examples import measure_examples
from dqreg.papers.integration import integration_section, measure_orders
from dqreg.papers.interpolation import interpolation_section, measure_interpolation
from dqreg.papers.jacobians import CASES, measure_jacobians
from dqreg.papers.registration import measure_registration, registration_section


def test_examples_agree_except_the_last_line_of_example_2():
    wrong = [example for example in measure_examples() if example.difference > 1e-12]
    assert [(example.name, example.quantity) for example in wrong] == [
        ("Example 2", "turned i, as the last line prints it")
    ]
    np.testing.assert_allclose(wrong[0].ours, [0, 1, 0], atol=1e-15)


def test_slopes_of_the_integrators():
    orders = measure_orders()
    assert [order.expected for order in orders] == [1, 4]
    for order in orders:
        assert order.slope == pytest.approx(order.expected, abs=0.15)
    assert len(integration_section(orders).tables[1].rows) == len(orders[0].steps)


def test_interpolations_share_their_ends_and_differ_between():
    rates, slerp = measure_interpolation(200)
    for path in (rates, slerp):
        np.testing.assert_allclose(path.angle_deg[[0, -1]], [40.0, 160.0], atol=1e-10)
        np.testing.assert_allclose(np.linalg.norm(path.axis, axis=1), 1.0, atol=1e-14)
    # Eq. 29: the angle of eq. 33 is a straight line.
    np.testing.assert_allclose(rates.angle_deg, 40.0 + 120.0 * rates.fraction, atol=1e-10)
    # Slerp's speed is constant, up to differences of order (1/200)^2, and the way is the shortest.
    np.testing.assert_allclose(slerp.speed_deg, slerp.speed_deg[100], rtol=1e-3)
    assert slerp.swept_deg < rates.swept_deg - 5.0
    assert len(interpolation_section((rates, slerp)).figures[0].panels) == 3


def test_jacobians_agree_with_finite_differences():
    found = measure_jacobians(np.random.default_rng(0), draws=10)
    assert len(found) == len(CASES) == 11
    assert max(jacobian.error for jacobian in found) < 1e-9
    numbers = {int(number) for jacobian in found for number in jacobian.equation.split(",")}
    assert numbers == set(range(35, 47))


def test_horn_is_at_the_bound():
    rows = measure_registration(np.random.default_rng(1), trials=100)
    assert rows[0].turn_rad.value < 1e-14
    for row in rows[1:]:
        assert abs(row.turn_rad.value - row.bound[0]) < 4 * row.turn_rad.error + 0.01 * row.bound[0]
        assert abs(row.shift.value - row.bound[1]) < 4 * row.shift.error
    assert len(registration_section(rows).tables[0].rows) == 4


def test_icp_ends_at_the_truth_and_extrapolation_is_faster():
    paths = measure_convergence(np.random.default_rng(2), source_points=300, target_points=2_000)
    plain, extrapolated, _ = paths
    for path in paths:
        assert path.status == "converged"
        assert len(path.errors) == len(path.rms)
        # 300 points with noise 1e-3: 6 unknowns leave 1e-3 sqrt(6 / 300) = 1.4e-4; closest points add a little.
        assert path.errors[-1] < 1e-3
        assert path.errors[0] > 0.02
    assert len(extrapolated.errors) < len(plain.errors)
    rows = convergence_section(paths).tables[0].rows
    assert rows[-1][0] == max(len(path.errors) for path in paths)
    assert None in rows[-1]

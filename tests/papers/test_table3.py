from __future__ import annotations

import numpy as np
import pytest

from dqreg.papers.table3 import PRINTED_ROWS, _deviations, measure_table3, pooled, table3_section
from dqreg.papers.trials import SURE_SIGMAS
from dqreg.synth.parts.blocks import FEEDER_SIZE, feeder_vertices


def values(estimates):
    return np.array([estimate.value for estimate in estimates])


@pytest.fixture(scope="module")
def rows():
    return measure_table3(np.random.default_rng(1), choices=6, trials=10)


def test_stand_in_has_32_distinct_vertices_in_the_papers_box():
    vertices = feeder_vertices()
    assert vertices.shape == (32, 3)
    assert len(np.unique(vertices, axis=0)) == 32
    np.testing.assert_array_equal(np.ptp(vertices, axis=0), FEEDER_SIZE)
    np.testing.assert_array_equal(vertices.min(axis=0), 0.0)


def test_no_simple_polyhedron_has_the_printed_counts():
    vertices, edges, surfaces = 32, 48, 50
    assert vertices - edges + surfaces != 2
    # Three edges at every vertex: the least a solid has. Then 18 surfaces close it.
    assert 3 * vertices == 2 * edges
    assert vertices - edges + 18 == 2


def test_svd_and_dual_quaternions_agree_to_rounding(rows):
    # Points up to 400 units away in float64, thousands of operations: 1e-10 is far above rounding, far below noise.
    assert max(row.apart[0] for row in rows) < 1e-10
    assert max(row.apart[1] for row in rows) < 1e-12
    for row in rows:
        for deviations in row.deviations.values():
            np.testing.assert_allclose(values(deviations), values(row.deviations["svd"]), rtol=1e-9)


def test_deviations_are_those_of_the_bound(rows):
    # 6 x 9 degrees of freedom and four numbers of points: a deviation is good to 1 / sqrt(2 * 54) = 10 %.
    ratios = np.array([values(row.deviations["solve"]) / row.bound for row in rows])
    np.testing.assert_allclose(ratios, 1.0, atol=0.4)
    np.testing.assert_allclose(ratios.mean(), 1.0, atol=0.1)


def test_the_mean_of_the_points_is_known_best(rows):
    for row in rows:
        np.testing.assert_allclose(values(row.at_mean)[:3], 0.5 / np.sqrt(row.count), rtol=0.4)
        assert (values(row.at_mean)[:3] < values(row.deviations["solve"])[:3]).all()


def test_standard_errors_are_those_of_the_trials(rows):
    # Differences from the bound in standard errors: normal, so 16 of them stay within it and their rms is near one.
    off = np.array(
        [(e.value - b) / e.error for row in rows for e, b in zip(row.deviations["solve"], row.bound, strict=True)]
    )
    assert np.abs(off).max() < SURE_SIGMAS
    assert np.sqrt(np.mean(off**2)) < 2.0
    # By simulation: 2,000 tables of 6 choices and 10 trials of a standard normal number.
    drawn = np.random.default_rng(0).normal(size=(2000, 6, 10))
    found = [pooled(table.var(axis=1, ddof=1)[:, None], 10)[0] for table in drawn]
    assert np.std([e.value for e in found]) == pytest.approx(np.mean([e.error for e in found]), rel=0.05)
    # Divided by n - 1: the mean variance is one, not 9 / 10 of it.
    assert np.mean([e.value**2 for e in found]) == pytest.approx(1.0, abs=0.02)


def test_section_holds_the_printed_values_and_the_stand_in(rows):
    section = table3_section(rows)
    assert "stand-in" in " ".join(section.text)
    cells = {(row[0], row[1]): row[2:] for row in section.tables[0].rows}
    for count, (svd, dual) in PRINTED_ROWS.items():
        assert cells[count, "paper: SVD"] == svd
        assert cells[count, "paper: dual number"] == dual
    # The printed rotations are the same for both methods, as they must be; only the translations differ.
    assert all(svd[3] == dual[3] for svd, dual in PRINTED_ROWS.values())


def test_deviations_divide_by_one_less_than_the_trials():
    # Two trials at +1 and -1 about their mean: the sample variance is 2, and its root sqrt(2), not 1.
    T = np.tile(np.eye(4), (3, 2, 1, 1))
    T[:, 0, 0, 3], T[:, 1, 0, 3] = 1.0, -1.0
    assert values(_deviations(T, np.zeros((3, 3)))) == pytest.approx([np.sqrt(2.0), 0.0, 0.0, 0.0])

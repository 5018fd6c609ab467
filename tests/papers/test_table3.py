from __future__ import annotations

import numpy as np
import pytest

from dqreg.papers.table3 import PRINTED, measure_table3, table3_section
from dqreg.synth.parts.blocks import FEEDER_SIZE, feeder_vertices


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
            np.testing.assert_allclose(deviations, row.deviations["svd"], rtol=1e-9)


def test_deviations_are_those_of_the_bound(rows):
    # 6 x 9 degrees of freedom and four numbers of points: a deviation is good to 1 / sqrt(2 * 54) = 10 %.
    ratios = np.array([row.deviations["solve"] / row.bound for row in rows])
    np.testing.assert_allclose(ratios, 1.0, atol=0.4)
    np.testing.assert_allclose(ratios.mean(), 1.0, atol=0.1)


def test_the_mean_of_the_points_is_known_best(rows):
    for row in rows:
        np.testing.assert_allclose(row.at_mean[:3], 0.5 / np.sqrt(row.count), rtol=0.4)
        assert (row.at_mean[:3] < row.deviations["solve"][:3]).all()


def test_section_holds_the_printed_values_and_the_stand_in(rows):
    section = table3_section(rows)
    assert "stand-in" in " ".join(section.text)
    cells = {(row[0], row[1]): row[2:] for row in section.tables[0].rows}
    for count, (svd, dual) in PRINTED.items():
        assert cells[count, "paper: SVD"] == svd
        assert cells[count, "paper: dual number"] == dual
    # The printed rotations are the same for both methods, as they must be; only the translations differ.
    assert all(svd[3] == dual[3] for svd, dual in PRINTED.values())

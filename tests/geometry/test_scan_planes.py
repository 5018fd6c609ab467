"""Planes at some points of a scan, beside the columns of all points."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from dqreg.geometry import PointCloud, Scan, prepare_scan
from dqreg.geometry.scan import COLUMNS, with_planes


@pytest.fixture
def scan() -> Scan:
    rng = np.random.default_rng(0)
    return prepare_scan(PointCloud(np.c_[rng.uniform(size=(3_000, 2)), rng.normal(scale=1e-3, size=3_000)]), fitted=300)


def test_taken_rows_have_what_all_points_have(scan: Scan) -> None:
    rng = np.random.default_rng(1)
    rows = np.sort(rng.choice(len(scan), 700, replace=False))
    # Before all were written out, and after.
    for taken in (scan.taken(rows), [scan.normals, scan.taken(rows)][1]):
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(taken, name), getattr(scan, name)[rows])
        np.testing.assert_array_equal(rows[taken.fitted], np.intersect1d(rows, scan.fitted))
    assert not scan.taken(np.arange(1, 3)).normals.any()


def test_points_without_a_plane_have_none(scan: Scan) -> None:
    has_plane = np.zeros(len(scan), dtype=bool)
    has_plane[scan.fitted] = True
    assert np.isnan(scan.residuals[~has_plane]).all()
    assert np.isfinite(scan.residuals[has_plane]).all()
    assert not scan.normals[~has_plane].any()
    assert not scan.levers[~has_plane].any()
    np.testing.assert_allclose(np.abs(scan.normals[has_plane, 2]), 1.0, atol=0.01)


def test_a_copy_in_any_way_holds_the_same(scan: Scan) -> None:
    for other in (copy.copy(scan), pickle.loads(pickle.dumps(scan)), dataclasses.replace(scan, noise=1.0)):
        for name in (*COLUMNS, "fitted", "points"):
            np.testing.assert_array_equal(getattr(other, name), getattr(scan, name))


def test_more_planes_replace_those_that_were(scan: Scan) -> None:
    more = with_planes(scan, 900)
    assert more.fitted is not None
    assert len(more.fitted) == 900
    assert more.spacing == scan.spacing
    assert np.count_nonzero(more.directed) == 900
    assert with_planes(more, 500) is more


def test_what_is_no_column_is_no_attribute(scan: Scan) -> None:
    with pytest.raises(AttributeError):
        scan.nothing  # type: ignore[attr-defined]  # noqa: B018

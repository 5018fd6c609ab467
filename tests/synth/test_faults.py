"""Known faults: their size is exactly what was asked, whatever the facets."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.inspection import fit_feature
from dqreg.rigid import pose
from dqreg.synth import Scan, Scanner, form_error, moved_feature, scan_mesh
from dqreg.synth.parts import box, cylinder

TUBE = cylinder(diameter=20.0, height=10.0, segments=24)
WALL = np.flatnonzero(np.ptp(TUBE[0][TUBE[1]][:, :, 2], axis=1) > 1.0)
AXIS = (TUBE[0].mean(axis=0), (0.0, 0.0, 1.0))


def scan_of(part: tuple[np.ndarray, np.ndarray]) -> Scan:
    views = ((1, 0, 0.5), (-1, 0.5, 0.5), (0, 1, 0.5), (0.3, -1, 0.5), (0, 0, 1))
    return scan_mesh(*part, Scanner(views=views, pixels=90), rng=np.random.default_rng(0))


def on_wall(scan: Scan) -> np.ndarray:
    return scan.points[np.isin(scan.face_index, WALL)]


def test_facets_are_no_form_error_and_lobes_are() -> None:
    scan = scan_of(TUBE)
    # A circle of 24 sides: facets lie up to r (1 - cos(pi / 24)) = 0.0856 inside, on average two thirds of that.
    raw = fit_feature(on_wall(scan), "cylinder")
    assert raw.radius == pytest.approx(10.0 - 2 / 3 * 0.0856, abs=0.005)
    exact = fit_feature(on_wall(moved_feature(scan, TUBE, WALL, axis=AXIS)), "cylinder")
    assert exact.radius == pytest.approx(10.0, abs=1e-9)
    assert exact.form < 1e-9
    lobed = on_wall(form_error(scan, TUBE, WALL, 0.05, waves=3, axis=AXIS))
    assert fit_feature(lobed, "cylinder", method="chebyshev").form == pytest.approx(0.05, rel=0.02)
    wider = on_wall(moved_feature(scan, TUBE, WALL, larger=0.1, axis=AXIS))
    assert fit_feature(wider, "cylinder").radius == pytest.approx(10.1, abs=1e-9)


def test_waves_on_a_plane_are_its_flatness_and_a_motion_is_a_motion() -> None:
    part = box((30.0, 20.0, 10.0))
    scan = scan_of(part)
    top = np.flatnonzero((part[0][part[1]][:, :, 2] > 4.9).all(axis=1))
    rows = np.isin(scan.face_index, top)
    wavy = form_error(scan, part, top, 0.04)
    assert fit_feature(wavy.points[rows], "plane", method="chebyshev").form == pytest.approx(0.04, rel=0.02)
    np.testing.assert_array_equal(wavy.points[~rows], scan.points[~rows])
    T = pose.exp([0.01, 0.0, 0.0, 0.0, 0.0, 0.3])
    tilted = moved_feature(scan, part, top, T)
    np.testing.assert_allclose(tilted.points[rows], pose.apply(T, scan.points[rows]))
    np.testing.assert_allclose(tilted.normals[rows], pose.rotate(T, scan.normals[rows]))


def test_what_cannot_be_is_named() -> None:
    part = box((30.0, 20.0, 10.0))
    scan = scan_of(part)
    with pytest.raises(InputError, match="waves must be a whole number from 2 on"):
        form_error(scan, part, [0], 0.1, waves=1)
    with pytest.raises(InputError, match="amplitude must be"):
        form_error(scan, part, [0], -0.1)
    with pytest.raises(InputError, match="triangles must be numbers"):
        form_error(scan, part, [99], 0.1)
    below = np.flatnonzero((part[0][part[1]][:, :, 2] < -4.9).all(axis=1))
    with pytest.raises(InputError, match="no points on those"):
        moved_feature(scan, part, below, np.eye(4))

"""Lines of a face that is not whole: what a gap in the scan may hide, and what it may not."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.line_forms.straight_lines import _stretches
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import bracket

NOISE = 0.04


def test_a_boss_on_a_face_hides_nothing_of_its_lines_and_noise_is_no_form_that_a_gap_hides() -> None:
    part = Mesh(*bracket())
    upright, boss = (nearest_face(part, part_faces(part), at).number for at in ((12, 70, 50), (17, 46, 40)))
    scan = sample_mesh(part, 30_000, np.random.default_rng(23_300)).points
    # A third of the way round the boss was not seen, on two sides of it.
    turn = np.arctan2(scan[:, 2] - 40.0, scan[:, 1] - 32.0)
    on_boss = (scan[:, 0] > 12.5) & (scan[:, 0] < 21.5) & (np.hypot(scan[:, 1] - 32.0, scan[:, 2] - 40.0) > 13.0)
    scan = scan[~on_boss | (np.abs(np.abs(turn) - 0.5 * np.pi) > 0.17 * np.pi)]
    scan = scan + np.random.default_rng(1).normal(0.0, NOISE, scan.shape)
    rows = [
        {"kind": "straightness", "face": upright, "direction": [0, 1, 0], "tolerance": 0.1},
        {"kind": "roundness", "face": boss, "tolerance": 0.3},
    ]
    found = inspect(measure_deviations(scan, part, MeshSurface(part), reach=1.0), plan_of({"characteristic": rows}))
    straight, round_ = found.characteristics
    assert straight.value <= straight.uncertainty < 1.5 * NOISE
    assert round_.value <= round_.uncertainty < 6.0 * NOISE
    assert found.outcome == "pass"


def test_a_line_meets_a_face_beside_its_opening() -> None:
    corners = np.array([[-1, 0], [1, 0], [1, 2], [-1, 2], [-1, 3], [1, 3], [1, 4], [-1, 4]], dtype=float)
    triangles = corners[[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]]
    assert _stretches(triangles) == pytest.approx(np.array([[0.0, 2.0], [3.0, 4.0]]))
    assert _stretches(np.add(triangles, [5.0, 0.0])).shape == (0, 2)

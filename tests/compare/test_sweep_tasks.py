from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.compare.judge import judge
from dqreg.compare.sweep import Cell
from dqreg.compare.sweep_file import read_sweep
from dqreg.compare.sweep_tasks import build
from dqreg.rigid import pose


@pytest.mark.parametrize("frame", ["mm", "m", "m, UTM"])
@pytest.mark.parametrize("axis", ["frame", "noise"])
def test_truth_brings_the_scan_onto_the_part_in_every_frame(frame, axis):
    # No noise, no strays: every held-out point lies on the part. 5.8e6 m away, float64 is good to 1e-9 m.
    made = build(Cell(axis, frame, 0, points=2_000, noise=0.0, outliers=0.0, frame=frame))
    score = judge(made.ground_truth.truths[0], made.ground_truth)
    assert score.success
    assert score.overlap == 1.0
    assert score.surface_rms < 1e-7 * made.ground_truth.size
    assert made.task.start is not None
    assert not judge(made.task.start, made.ground_truth).success


def test_frames_hold_the_same_task():
    scores = []
    for frame in ("mm", "m", "m, UTM"):
        made = build(Cell("frame", frame, 0, points=500, frame=frame))
        assert made.task.start is not None
        scores.append(judge(made.task.start, made.ground_truth).worst / made.ground_truth.size)
    np.testing.assert_allclose(scores, scores[0], rtol=1e-6)


@pytest.mark.parametrize(("angle", "offset"), [(0.0, 0.1), (30.0, 0.0), (180.0, 0.2)])
def test_start_is_as_far_off_as_it_says(angle, offset):
    made = build(Cell("start_angle_deg", angle, 2, points=300, start_angle_deg=angle, start_offset=offset))
    assert made.task.start is not None
    score = judge(made.task.start, made.ground_truth)
    assert np.rad2deg(score.angle_rad) == pytest.approx(angle, abs=1e-6)
    assert score.offset == pytest.approx(offset * made.ground_truth.size, abs=1e-9 * made.ground_truth.size)


@pytest.mark.parametrize("share", [1.0, 0.6, 0.2])
def test_overlap_is_what_it_says(share):
    # Of clouds on an exact surface: a source point counts as covered if the target has one within three spacings.
    made = build(Cell("overlap", share, 0, points=4_000, noise=0.0, outliers=0.0, overlap=share))
    T, known = made.ground_truth.truths[0], made.ground_truth
    moved = pose.apply(T, made.task.source.points)
    covered = np.mean(known.surface.closest(moved).distances < 0.01 * known.size)
    assert covered == pytest.approx(share, abs=0.05)


def test_one_axis_of_starts_has_one_scan():
    near, far = (
        build(Cell("start_angle_deg", a, 1, points=400, start_angle_deg=a, start_offset=0.0)) for a in (5.0, 90.0)
    )
    np.testing.assert_array_equal(near.task.source.points, far.task.source.points)
    np.testing.assert_array_equal(near.ground_truth.truths, far.ground_truth.truths)


def test_a_symmetric_part_has_all_its_truths():
    made = build(Cell("nothing", "gear", 0, part="gear", points=300, nothing="gear"))
    assert len(made.ground_truth.truths) > 4
    assert made.task.start is None
    assert all(judge(T, made.ground_truth).success for T in made.ground_truth.truths)


def test_keys_tell_all_cells_apart():
    cells = [cell for cell, _ in read_sweep("standard").cells()]
    assert len({cell.key for cell in cells}) == len(cells)
    assert all(dataclasses.replace(cell, noise=0.123).key != cell.key for cell in cells)

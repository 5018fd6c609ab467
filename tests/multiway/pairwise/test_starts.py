from __future__ import annotations

import dataclasses
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.multiway.pairwise.pair_runs import PairJob, PairRunner
from dqreg.multiway.pairwise.starts import contradicted_starts, other_frame, read_starts_file
from dqreg.multiway.plan import _held_by_starts
from dqreg.multiway.pose_graph.edges import PART, Edge
from dqreg.multiway.scans.scans import View, read_views
from dqreg.rigid import pose
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of, world

COUNT, SIZE = 8, 2.0
STEPS = np.diag([0.5, 0.0, 0.0, 0.0, 0.6, 0.0])[[0, 4]]


def scene() -> tuple[list[View], np.ndarray, list[Edge]]:
    """Scans, where they stand, and edges of each to the next two."""
    rng, T = np.random.default_rng(4), world(COUNT, 0)
    views = [View(f"view{k}", PointCloud(rng.uniform(-1.0, 1.0, (50, 3)))) for k in range(COUNT)]
    edges = edges_of(T, [(k, k + step) for step in (1, 2) for k in range(COUNT - step)], 1e-3, 0)
    return views, T, [dataclasses.replace(edge, used=True) for edge in edges]


@pytest.mark.parametrize("wrong", [0, 3])
@pytest.mark.parametrize("step", STEPS)
def test_the_one_that_is_off_is_named_whichever_frame_all_are_in(wrong: int, step: np.ndarray) -> None:
    views, T, edges = scene()
    starts = [pose.exp(np.r_[1.0, 0.3, -2.0, 4.0, 5.0, 6.0]) @ each for each in T]
    assert not list(contradicted_starts(views, starts, T, edges, SIZE))
    starts[wrong] = starts[wrong] @ pose.exp(step)
    (reason,) = contradicted_starts(views, starts, T, edges, SIZE)
    assert reason.code == "contradicted_start"
    assert f"of view{wrong} " in reason


@pytest.mark.parametrize("step", STEPS)
def test_on_a_part_it_is_the_initial_pose_itself_that_counts(step: np.ndarray) -> None:
    views, T, edges = scene()
    on_part = [dataclasses.replace(edges[0], target=PART, source=k) for k in range(COUNT)]
    assert not list(contradicted_starts(views, list(T), T, on_part, SIZE))
    starts = [T[0] @ pose.exp(step), *T[1:]]
    (reason,) = contradicted_starts(views, starts, T, on_part, SIZE)
    assert "of view0 " in reason


def test_rough_drifting_and_missing_ones_contradict_nothing() -> None:
    views, T, edges = scene()
    drift = pose.exp(np.r_[0.0, 0.0, 0.08, 0.05, 0.0, 0.0])
    drifted = [T[0]]
    for k in range(1, COUNT):
        drifted.append(drifted[-1] @ pose.inverse(T[k - 1]) @ T[k] @ drift)
    assert pose.angle_between(T[-1], drifted[-1]) > 0.5
    assert not list(contradicted_starts(views, drifted, T, edges, SIZE))
    assert not list(contradicted_starts(views, [None] * COUNT, T, edges, SIZE))
    unplaced = [dataclasses.replace(edge, used=False) for edge in edges]
    assert not list(contradicted_starts(views, [np.eye(4)] * COUNT, np.full_like(T, np.nan), unplaced, SIZE))


@pytest.mark.parametrize(("code", "meant"), [("weakly_constrained", True), ("faces_apart", False)])
def test_of_two_poses_that_fit_the_one_that_was_given_is_meant(
    monkeypatch: pytest.MonkeyPatch, code: Code, meant: bool
) -> None:
    cloud = np.random.default_rng(0).normal(size=(60, 3))
    runner = PairRunner(read_views([cloud, cloud + 1.0], 0), None, "fast", 0, 1, np.inf, None, None)
    turned = pose.from_parts(pose.exp(np.r_[0.0, 0.0, 1.0, 0.0, 0.0, 0.0])[:3, :3], np.zeros(3))
    far = edges_of(np.stack([np.eye(4), turned]), [(0, 1)], 1e-3, 0)
    near = edges_of(np.tile(np.eye(4), (2, 1, 1)), [(0, 1)], 1e-3, 0)
    doubted = Verdict("suspect", (Reason("made by hand", code),))
    near = [dataclasses.replace(near[0], registration=dataclasses.replace(near[0].registration, verdict=doubted))]
    monkeypatch.setattr(PairRunner, "run", lambda *_: near)
    found = _held_by_starts(runner, [PairJob(0, 1, np.eye(4))], far, [np.eye(4)] * 2)
    assert (found[0] is near[0]) == meant


def test_poses_of_a_file_come_back_with_gaps(tmp_path: Path) -> None:
    T = world(3, 1)
    (tmp_path / "a.json").write_text(json.dumps({"T_world_scan": [T[0].tolist(), [[None] * 4] * 4, T[2].tolist()]}))
    np.savetxt(tmp_path / "a.txt", np.array([T[0, :3].ravel(), np.full(12, np.nan), T[2, :3].ravel()]), fmt="%.17g")
    for name in ("a.json", "a.txt"):
        np.testing.assert_array_equal(read_starts_file(tmp_path / name, 3), [T[0], np.full((4, 4), np.nan), T[2]])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "", "an empty file"),
        ("a.txt", "# nothing\n", "as initial poses: "),
        ("a.txt", "x y z", "as initial poses: "),
        ("a.txt", "1 2 3", "expected 12 .KITTI. or 8 .TUM. a pose"),
        ("a.tum", "0 1 2 3 0 0 0 0", "a quaternion of length 0"),
        ("a.tum", "0 1 2 3 0 0 0 0.1", "a quaternion of length 0.1"),
        ("a.json", "{}", "the key 'T_world_scan' is missing"),
        ("a.json", '{"T_world_scan": ["a"]}', r"T_world_scan\[0\] must be 4x4 numbers"),
        ("a.json", '{"T_world_scan": [[[1, 2], [3]]]}', r"T_world_scan\[0\] must be 4x4 numbers"),
        ("a.json", '{"T_world_scan": [[1, 2]]}', r"got shape \(2,\)"),
    ],
)
def test_a_file_without_poses_is_refused_by_name(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=words) as error:
            read_starts_file(tmp_path / name, 1)
    assert str(tmp_path / name) in str(error.value)


@pytest.mark.parametrize("times", [(0, 3), (0.5, 1), (1, 1)])
def test_a_line_for_each_scan_or_times_that_are_their_numbers(tmp_path: Path, times: tuple[float, float]) -> None:
    (tmp_path / "a.tum").write_text("".join(f"{time} 1 2 3 0 0 0 1\n" for time in times))
    assert len(read_starts_file(tmp_path / "a.tum", 2)) == 2
    with pytest.raises(InputError, match=r"a\.tum: 2 poses for 3 scans; expected .* the numbers of the scans, 0 to 2"):
        read_starts_file(tmp_path / "a.tum", 3)


def test_another_anchor_than_the_one_asked_for_is_said() -> None:
    views = [View(name) for name in ("left", "right")]
    assert not list(other_frame(views, {}, 0, 0))
    (reason,) = other_frame(views, {}, 0, 1)
    assert reason.code == "other_frame"
    assert "the world is the frame of right" in reason
    (reason,) = other_frame(views, {1: np.eye(4)}, 0, 1)
    assert "the world is that of the starts" in reason

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import dqreg
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, random_pose, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import bracket

PART = dqreg.Mesh(*bracket())
SIZE = PART.diagonal
SCAN = scan_mesh(
    PART.vertices,
    PART.faces,
    Scanner([(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)], pixels=150),
    Noise(range_sigma=3e-4 * SIZE),
    rng=np.random.default_rng(0),
).points
TARGET = dqreg.prepare_target(PART)


def start(degrees: float, seed: int = 0) -> np.ndarray:
    """A start that far off; the scan is made in the part's frame, so the truth is the identity."""
    return disturbance(np.random.default_rng(seed), np.deg2rad(degrees), 0.05 * SIZE, PART.centre)


def error(result: dqreg.Registration) -> float:
    return worst_vertex_displacement(result.T_target_source, np.eye(4), PART.vertices) / SIZE


def test_a_start_beyond_the_loop_but_meant_comes_home() -> None:
    rough = [start(35.0, seed) for seed in range(4)]
    results = [TARGET.register(SCAN, T, effort="fast") for T in rough]
    # 20,000 points: to a tenth of the noise.
    assert max(error(r) for r in results) <= 5e-5
    assert {r.verdict.level for r in results} == {"accepted"}


def test_a_start_at_the_other_side_is_not_overruled_but_told() -> None:
    turned = pose.about(pose.from_parts(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), PART.centre)
    result = TARGET.register(SCAN, turned, effort="fast")
    if error(result) > 0.02:
        assert result.verdict.level == "suspect"
        # The true pose is named among the others.
        found = [dataclasses.replace(result, T_target_source=a.T_target_source) for a in result.alternatives]
        assert min(error(r) for r in found) <= 1e-2


def test_a_good_pose_is_not_searched_for_again() -> None:
    stages: list[object] = []
    result = TARGET.register(SCAN, start(5.0), effort="fast", observe_search=stages.append)
    assert result.verdict.level == "accepted"
    assert stages == []


@pytest.mark.parametrize("options", [{"method": "dq"}, {"dof": "rz tx ty"}, {"search": "never"}])
def test_what_was_asked_for_in_so_many_words_is_done_alone(options: dict) -> None:
    stages: list[object] = []
    TARGET.register(SCAN, start(120.0), effort="fast", observe_search=stages.append, **options)
    assert stages == []


def test_always_searches_beside_a_good_start_and_keeps_the_pose() -> None:
    stages: list[object] = []
    result = TARGET.register(SCAN, start(5.0), effort="fast", search="always", observe_search=stages.append)
    assert stages != []
    assert error(result) <= 5e-5
    assert result.verdict.level == "accepted"
    assert result.settings["search"] == "always"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"start": None, "search": "never"}, "there is none"),
        ({"start": np.eye(4), "search": "always", "dof": "rz"}, "know nothing of dof"),
        ({"start": np.eye(4), "search": "sometimes"}, "never, doubt, always"),
    ],
)
def test_a_search_that_cannot_be_is_refused(given: dict, words: str) -> None:
    with pytest.raises(dqreg.InputError, match=words):
        TARGET.register(SCAN, effort="fast", **given)


def test_history_counts_on() -> None:
    result = TARGET.register(SCAN, start(35.0, 1), effort="fast")
    assert [record.number for record in result.history] == list(range(1, len(result.history) + 1))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mirrored_scan_of_a_nearly_symmetric_part_is_told(mirrored: bool) -> None:
    # Truth: the pose drawn here; a mirrored scan has none. Dense enough to see on which side the bracket's hole is.
    T = random_pose(np.random.default_rng(0), SIZE, PART.centre)
    points = SCAN * [1.0, 1.0, -1.0] if mirrored else SCAN
    verdict = TARGET.register(pose.apply(T, points), effort="fast").verdict
    assert verdict.level == ("suspect" if mirrored else "accepted")
    assert mirrored == ("mirrored" in verdict.codes)

# Either outcome is right here, so errors are looked at where they are caught.
# ruff: noqa: PT017
from __future__ import annotations

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dqreg.errors import DqregError, InputError
from dqreg.registration.register import register
from dqreg.registration.result.invariants import violated_invariant
from dqreg.registration.result.result import Registration
from dqreg.trust.records import Alternative, Verdict
from tests.hostile.scenes import FIXED, START, assert_kept, part
from tests.registration.result.test_result import failed, good
from tests.strategies import poses

NAN, INF = float("nan"), float("inf")
NUMBERS = st.one_of(
    st.floats(width=64), st.sampled_from([NAN, INF, -INF, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-160, 1e160, 1.0])
)
HUGE = np.eye(4)
HUGE[0, 0] = 1e200


def changed(T: Any, row: int, column: int, value: float) -> Any:
    """One entry replaced."""
    T = T.copy()
    T[row, column] = value
    return T


BROKEN: dict[str, tuple[dict[str, Any], str]] = {
    "one NaN in the pose": ({"T_target_source": changed(np.eye(4), 0, 3, NAN)}, "pose holds numbers"),
    "infinity in the pose": ({"T_target_source": changed(np.eye(4), 0, 3, INF)}, "pose holds numbers"),
    "a pose of three rows": ({"T_target_source": np.eye(4)[:3]}, "pose holds numbers"),
    "a mirror image": ({"T_target_source": np.diag([1.0, 1, -1, 1])}, "mirror"),
    "a scale of 1e-11": ({"T_target_source": np.diag([1 + 1e-11, 1, 1, 1])}, "not rigid"),
    "a rotation beyond squares": ({"T_target_source": HUGE}, "not rigid"),
    "a last row": ({"T_target_source": changed(np.eye(4), 3, 0, 1e-300)}, "last row"),
    "no pose but accepted": (
        {"T_target_source": np.full((4, 4), NAN), "verdict": Verdict("accepted", ("fine",))},
        "no pose, but the verdict accepted",
    ),
    "no pose but a covariance": (
        {"T_target_source": np.full((4, 4), NAN), "verdict": Verdict("failed", ("so",)), "rms": NAN},
        "a covariance of one",
    ),
    "rms NaN": ({"rms": NAN}, "distance of nan"),
    "rms negative": ({"rms": -1e-300}, "distance of -1e-300"),
    "rms infinite": ({"rms": INF}, "distance of inf"),
    "more inliers than points": ({"inlier_fraction": 1.1}, "inliers of 1.1"),
    "fewer inliers than none": ({"inlier_fraction": -0.1}, "inliers of -0.1"),
    "covariance not symmetric": ({"covariance": np.eye(6) + np.eye(6, k=1) * 1e-3}, "symmetric"),
    "covariance not positive": ({"covariance": np.eye(6) - 0.5}, "negative eigenvalue"),
    "negative variance": ({"covariance": -np.eye(6)}, "negative variances"),
    "covariance infinite": ({"covariance": np.diag([INF, 1, 1, 1, 1, 1])}, "infinite"),
    "covariance NaN in one place": ({"covariance": changed(np.eye(6), 0, 1, NAN)}, "NaN in places"),
    "covariance of four": ({"covariance": np.eye(4)}, "shape"),
    "an alternative that is none": ({"alternatives": (Alternative(HUGE, 0.1),)}, "alternative is not rigid"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_violated_invariant_becomes_a_failed_result_that_says_why(name: str) -> None:
    changes, words = BROKEN[name]
    result = dataclasses.replace(good(), **changes)
    assert_kept(result)
    assert result.verdict.level == "failed"
    assert words in result.verdict.reasons[0]
    assert "internal error" in result.verdict.reasons[0]
    assert np.isnan(result.T_target_source).all()


@pytest.mark.parametrize("make", [good, failed])
def test_a_kept_promise_changes_nothing(make: Any) -> None:
    result = make()
    again = dataclasses.replace(result)
    np.testing.assert_array_equal(again.T_target_source, result.T_target_source)
    assert again.verdict == result.verdict
    assert "internal" not in " ".join(result.verdict.reasons)


@settings(deadline=None, max_examples=300)
@given(
    T=st.one_of(hnp.arrays(np.float64, (4, 4), elements=NUMBERS), poses(), st.just(np.full((4, 4), NAN))),
    covariance=hnp.arrays(np.float64, (6, 6), elements=NUMBERS),
    root=st.booleans(),
    level=st.sampled_from(["accepted", "suspect", "failed"]),
    rms=NUMBERS,
    fraction=NUMBERS,
)
def test_no_numbers_whatsoever_get_past_the_door(
    T: Any, covariance: Any, root: bool, level: Any, rms: float, fraction: float
) -> None:
    with np.errstate(all="ignore"):
        covariance = covariance @ covariance.T if root else covariance
    kept = dataclasses.replace(
        good(), T_target_source=T, covariance=covariance, verdict=Verdict(level, ("so",)), rms=rms,
        inlier_fraction=fraction
    )  # fmt: skip
    assert violated_invariant(vars(kept)) == ""
    assert np.isnan(kept.T_target_source).all() or np.isfinite(kept.T_target_source).all()


# Rows of a scan that make trouble: any numbers, or many of one kind.
ROWS = st.one_of(
    hnp.arrays(np.float64, st.tuples(st.integers(0, 40), st.just(3)), elements=NUMBERS),
    hnp.arrays(np.float64, st.tuples(st.integers(3, 60), st.just(3)), elements=st.floats(-50.0, 50.0)),
    hnp.arrays(np.float64, st.tuples(st.integers(3, 40), st.just(3)), elements=st.sampled_from([0.0, 1.0, 2.0, 1e-9])),
    hnp.arrays(np.float32, st.tuples(st.integers(3, 40), st.just(3)), elements=st.floats(-9.0, 9.0, width=32)),
    hnp.arrays(np.int8, st.tuples(st.integers(3, 40), st.just(3))),
)
FAR_ROWS = np.array([[0.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])


@settings(deadline=None, max_examples=40)
# Beyond what single precision can square, or whole numbers can count in voxels of the other: they warned.
@example(rows=9.3e26 * FAR_ROWS, mixed=True, as_target=True, method="auto")
@example(rows=2.4e19 * FAR_ROWS[::2], mixed=True, as_target=True, method="auto")
@example(rows=1.1e19 * FAR_ROWS[::2], mixed=True, as_target=True, method="auto")
@given(rows=ROWS, mixed=st.booleans(), as_target=st.booleans(), method=st.sampled_from(["auto", "dq", "svd", "plane"]))
def test_no_points_whatsoever_make_a_bad_pose(rows: Any, mixed: bool, as_target: bool, method: str) -> None:
    cloud = np.vstack([FIXED[:200], rows]) if mixed else rows
    source, target = (FIXED[::3], cloud) if as_target else (cloud, part())
    try:
        assert_kept(register(source, target, START, effort="fast", method=method, max_iterations=8))
    except DqregError as error:
        assert str(error)


@pytest.mark.soak
@settings(deadline=None, max_examples=1_000)
@given(rows=ROWS, other=ROWS, searched=st.booleans(), method=st.sampled_from(["auto", "dq", "svd", "plane"]))
def test_no_two_clouds_whatsoever_make_a_bad_pose(rows: Any, other: Any, searched: bool, method: str) -> None:
    try:
        assert_kept(register(rows, other, None if searched else "identity", effort="fast", method=method))
    except DqregError as error:
        assert str(error)


def saved(tmp_path: Path, **entries: Any) -> Path:
    """A saved result with some entries replaced."""
    content = copy.deepcopy(good(source_scale=1.0, target_units="mm").to_dict()) | entries
    path = tmp_path / "result.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


SETTINGS = good(source_scale=1.0, target_units="mm").to_dict()["settings"]


@pytest.mark.parametrize(
    "entries",
    [
        {"T_target_source": np.diag([1 + 1e-9, 1, 1, 1]).tolist()},
        {"T_target_source": [[None] * 4] * 4},
        {"covariance": (-np.eye(6)).tolist()},
        {"covariance": np.eye(6, k=1).tolist()},
        {"rms": -1.0},
        {"rms": 1e999},
        {"inlier_fraction": 7},
        {"settings": {**SETTINGS, "source_scale": "ten"}},
        {"settings": {**SETTINGS, "source_scale": 0.0}},
        {"settings": {**SETTINGS, "source_scale": NAN}},
        {"settings": {**SETTINGS, "max_distance": -1.0}},
        {"settings": {**SETTINGS, "target_units": ["mm"]}},
        {"settings": {**SETTINGS, "seed": -1}},
        *({"settings": {**SETTINGS, name: "abc"}} for name in ("source_noise", "source_spacing", "used_points")),
        {"settings": {**SETTINGS, "seed": "7"}},
        {"settings": {**SETTINGS, "centre": [0, 0]}},
        {"settings": {**SETTINGS, "centre": [0, 0, 1e999]}},
    ],
    ids=str,
)
def test_a_file_that_breaks_a_promise_is_damaged(tmp_path: Path, entries: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="damaged dqreg result"):
        Registration.load(saved(tmp_path, **entries))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBERS | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@settings(deadline=None, max_examples=200)
@given(key=st.sampled_from(sorted(good().to_dict())), value=JSON)
def test_no_json_whatsoever_gets_past_the_loader(
    tmp_path_factory: pytest.TempPathFactory, key: str, value: Any
) -> None:
    path = saved(tmp_path_factory.mktemp("json"), **{key: value})
    try:
        result = Registration.load(path)
    except InputError as error:
        assert "result.json" in str(error)
    else:
        # What was read is written again, and read as it was.
        written = json.dumps(result.to_dict())
        path.write_text(written, encoding="utf-8")
        assert json.dumps(Registration.load(path).to_dict()) == written


def test_a_status_that_is_none_of_the_words_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="status: expected one of"):
        Registration.load(saved(tmp_path, status="<script>alert(1)</script>"))


@pytest.mark.parametrize("place", ["source", "target", "reason", "words"])
def test_a_report_escapes_every_string_that_came_from_outside(tmp_path: Path, place: str) -> None:
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'&"
    result = good(source="a.ply", target="b.stl", max_distance=1.0, source_scale=1.0, target_units="mm", diagonal=9.0)
    if place in ("source", "target"):
        result = dataclasses.replace(result, settings={**result.settings, place: evil})
    elif place == "reason":
        result = dataclasses.replace(result, verdict=Verdict("suspect", (evil,)))
    else:
        found = (dataclasses.replace(result.observability[0], words=evil), *result.observability[1:])
        result = dataclasses.replace(result, observability=found)
    result.save(tmp_path / "result.json")
    for told in (result, Registration.load(tmp_path / "result.json")):
        page = told.report(tmp_path / "report.html").read_text(encoding="utf-8")
        assert "<script>alert(1)" not in page
        assert "<img src=x" not in page
        assert "<img src=x" not in told._repr_html_()
        assert "<script>alert(1)" not in told._repr_html_()

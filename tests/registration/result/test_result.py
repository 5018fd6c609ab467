from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import InputError
from dqreg.registration.result.result import Alternative, Direction, Iteration, Registration, Verdict
from dqreg.rigid import pose
from dqreg.trust.records import Check, Reason
from tests.strategies import FloatArray, points, poses

NAN, INF = float("nan"), float("inf")
RECORD = Iteration(1, "coarse", 500, 480, 0.96, 0.1, 0.2, 0.01, 0.3, INF, 0.002, np.eye(4))


def covariance() -> FloatArray:
    """Covariance with one free shift: the row and column of it are NaN."""
    root = np.random.default_rng(0).normal(size=(6, 6))
    matrix = root @ root.T
    matrix[5] = matrix[:, 5] = NAN
    return matrix


def good(T: FloatArray | None = None, **settings_: Any) -> Registration:
    """Every field filled, with NaN and infinity wherever they may be."""
    return Registration(
        T_target_source=pose.random(np.random.default_rng(1), reach=100.0) if T is None else T,
        verdict=Verdict(
            "suspect",
            (Reason("unconstrained: translation along (0.00, 0.00, 1.00)", "unconstrained"), Reason("größer als 5σ")),
        ),
        status="converged",
        covariance=covariance(),
        observability=(
            Direction(0.0, NAN, "free", "translation", (0.0, 0.0, 1.0), (1.0 / 3.0, 2.0, -0.5)),
            Direction(0.5, 1e-300, "held"),
        ),
        alternatives=(Alternative(pose.random(np.random.default_rng(2)), 0.1), Alternative(np.eye(4), NAN)),
        history=(RECORD, dataclasses.replace(RECORD, number=2, motion=1e-9)),
        rms=1.0 / 3.0,
        inlier_fraction=0.1 + 0.2,
        timings={"read": 0.1, "total": 0.25},
        settings={
            "max_distance": np.float64(3.5),
            "seed": np.int64(7),
            "centre": np.arange(3.0),
            "units": None,
            **settings_,
        },
    )


def failed() -> Registration:
    return dataclasses.replace(
        good(),
        T_target_source=np.full((4, 4), NAN),
        verdict=Verdict("failed", ("no pose: nothing near",)),
        covariance=np.full((6, 6), NAN),
        observability=(),
        alternatives=(),
        rms=NAN,
        inlier_fraction=0.0,
    )


def assert_same(one: Any, other: Any) -> None:
    """Equal to the last bit, NaN equal to NaN."""
    assert type(one) is type(other)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    else:
        np.testing.assert_equal(one, other)


def test_a_verdict_and_directions_that_are_loaded_equal_those_saved(tmp_path: Path) -> None:
    asked = [
        Check("bent", "How bent?", value, "at most", limit, "1", None) for value, limit in ((NAN, 0.1), (0.2, INF))
    ]
    result = dataclasses.replace(good(), verdict=Verdict("suspect", ("free",), tuple(asked)))
    result.save(tmp_path / "result.npz")
    loaded = Registration.load(tmp_path / "result.npz")
    assert loaded.verdict == result.verdict
    assert loaded.observability == result.observability
    assert hash(loaded.verdict.checks) == hash(result.verdict.checks)
    assert loaded.verdict.checks[0] != dataclasses.replace(asked[0], value=0.0)
    assert asked[0] != "bent"


@pytest.mark.parametrize("make", [good, failed])
def test_what_is_saved_is_loaded_to_the_last_bit(tmp_path: Path, make: Callable[[], Registration]) -> None:
    result, path = make(), tmp_path / "result.json"
    result.save(path)
    loaded = Registration.load(str(path))
    # NaN is no equal of itself; its words are.
    assert repr(loaded.verdict.checks) == repr(result.verdict.checks)
    assert loaded.to_dict() == result.to_dict()
    for field in dataclasses.fields(result):
        if field.name != "settings":
            assert_same(getattr(result, field.name), getattr(loaded, field.name))
    # Settings come back as plain numbers and lists.
    assert loaded.settings == {"max_distance": 3.5, "seed": 7, "centre": [0.0, 1.0, 2.0], "units": None}


def test_codes_that_this_version_does_not_know_are_read_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    good().save(path)
    values = json.loads(path.read_text(encoding="utf-8"))
    values["verdict"]["codes"][0] = "of_later"
    check = dataclasses.asdict(Check("drift", "Drift", 0.0, "at most", 0.1, "1", passed=True))
    values["verdict"]["checks"] = [{**check, "code": "of_later"}]
    path.write_text(json.dumps(values), encoding="utf-8")
    verdict = Registration.load(path).verdict
    assert (verdict.codes[0], verdict.checks[0].code) == ("of_later", "of_later")


@settings(deadline=None, max_examples=30)
@given(poses())
def test_any_pose_survives_the_file(tmp_path_factory: pytest.TempPathFactory, T: FloatArray) -> None:
    path = tmp_path_factory.mktemp("poses") / "result.json"
    good(T).save(path)
    np.testing.assert_array_equal(Registration.load(path).T_target_source, T)


@pytest.mark.parametrize("make", [good, failed])
def test_the_file_is_strict_json_with_the_documented_keys(tmp_path: Path, make: Callable[[], Registration]) -> None:
    def refuse(literal: str) -> None:
        raise AssertionError(f"{literal} is no JSON")

    make().save(tmp_path / "result.json")
    content = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert set(content) == {
        "format",
        "units",
        "angle_units",
        "conventions",
        "T_target_source",
        "dual_quaternion",
        "verdict",
        "status",
        "covariance",
        "observability",
        "alternatives",
        "history",
        "rms",
        "inlier_fraction",
        "timings",
        "settings",
        "scale",
        "scale_sigma",
        "partial_information",
    }
    assert (content["units"], content["angle_units"]) == (None, "rad")
    assert good(target_units="mm").to_dict()["units"] == "mm"
    assert set(content["conventions"]) <= set(content)
    assert set(content["verdict"]) == {"level", "reasons", "codes", "checks", "confidence"}
    if make is failed:
        assert content["dual_quaternion"] is None
        assert content["rms"] is None
        assert content["T_target_source"] == [[None] * 4] * 4
    else:
        assert set(content["dual_quaternion"]) == {"real", "dual"}
        assert set(content["history"][0]) == {*(field.name for field in dataclasses.fields(Iteration)), "scale"}


def change(*path: Any, to: Any = "gone") -> Callable[[dict[str, Any]], None]:
    """Damage of a saved result: the value at a place is removed or replaced."""

    def damage(content: dict[str, Any]) -> None:
        inner: Any = content
        for key in path[:-1]:
            inner = inner[key]
        if to == "gone":
            del inner[path[-1]]
        else:
            inner[path[-1]] = to

    return damage


SCALED, TRANSPOSED = np.diag([2.0, 2, 2, 1]).tolist(), np.eye(4)
TRANSPOSED[3, 0] = 5.0
DAMAGES: dict[str, Callable[[dict[str, Any]], None]] = {
    "no pose": change("T_target_source"),
    "pose of text": change("T_target_source", to=[["a"] * 4] * 4),
    "pose of sixteen": change("T_target_source", to=np.eye(4).ravel().tolist()),
    "pose cut": change("T_target_source", to=np.eye(3).tolist()),
    "pose ragged": change("T_target_source", 0, to=[1.0]),
    "pose half known": change("T_target_source", 0, 0, to=None),
    "pose scaled": change("T_target_source", to=SCALED),
    "pose transposed": change("T_target_source", to=TRANSPOSED.tolist()),
    "pose beyond float64": change("T_target_source", 0, 0, to=10**400),
    "no verdict": change("verdict"),
    "verdict is text": change("verdict", to="accepted"),
    "level unknown": change("verdict", "level", to="perfect"),
    "level is a list": change("verdict", "level", to=["accepted"]),
    "reasons are one text": change("verdict", "reasons", to="because"),
    "reasons are numbers": change("verdict", "reasons", to=[1]),
    "codes are one text": change("verdict", "codes", to="because"),
    "a confidence of two": change("verdict", "confidence", to=2.0),
    "codes are numbers": change("verdict", "codes", to=[1, 2]),
    "a code is missing": change("verdict", "codes", to=["unconstrained"]),
    "status is a number": change("status", to=1),
    "covariance cut": change("covariance", to=[[1.0]]),
    "covariance is null": change("covariance", to=None),
    "observability is a number": change("observability", to=3),
    "direction without words": change("observability", 0, "words"),
    "motion of another kind": change("observability", 0, "kind", to="screw"),
    "axis of text": change("observability", 0, "axis", to="z"),
    "axis of two": change("observability", 0, "axis", to=[0.0, 1.0]),
    "direction of text": change("observability", 0, "strength", to="strong"),
    "alternative without pose": change("alternatives", 0, "T_target_source"),
    "alternative scaled": change("alternatives", 0, "T_target_source", to=SCALED),
    "history is a number": change("history", to=5),
    "record is a number": change("history", 0, to=5),
    "record without rms": change("history", 0, "rms"),
    "record with more": change("history", 0, "colour", to=1),
    "record of text": change("history", 0, "rms", to="small"),
    "rms is text": change("rms", to="small"),
    "rms is a list": change("rms", to=[1.0]),
    "timings are a list": change("timings", to=[1.0]),
    "timing is text": change("timings", "read", to="long"),
    "settings are a number": change("settings", to=3),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_file_is_refused_and_named(tmp_path: Path, name: str) -> None:
    content = copy.deepcopy(good().to_dict())
    DAMAGES[name](content)
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"damaged\.json is a damaged dqreg result"):
        Registration.load(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "found an empty file"),
        (b'{"format": "dqreg registration 1"', "is no readable dqreg result"),
        (b"\xff\xfe\x00", "found bytes that are no UTF-8 text"),
        (b"[" * 100_000, "is no readable dqreg result"),
        (b"[1, 2]", "is no dqreg result"),
        (b"{}", "is no dqreg result"),
        (b'{"format": "dqreg registration 2"}', "is no dqreg result"),
        (b'{"format": "dqreg registration 1"}', "is a damaged dqreg result"),
    ],
)
def test_what_is_no_result_is_refused_in_words(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "other.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"other\.json:? {message}"):
        Registration.load(path)


def test_a_missing_file_or_a_folder_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "gone.json", tmp_path):
        with pytest.raises(InputError, match="cannot read"):
            Registration.load(path)


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    for path in (tmp_path / "gone" / "result.json", tmp_path):
        with pytest.raises(InputError, match="cannot write"):
            good().save(path)
    assert list(tmp_path.iterdir()) == []


def test_a_result_that_json_cannot_hold_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        good(observe=object()).save(path)
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@settings(deadline=None)
@given(poses(), points())
def test_inverse_undoes_apply(T: FloatArray, cloud: FloatArray) -> None:
    result = good(T)
    moved = result.apply(cloud)
    np.testing.assert_array_equal(moved, pose.apply(T, cloud))
    # A rotation drawn by Hypothesis is orthonormal to 1e-15; a shift of a million costs its own digits.
    back = 1e-14 * (1e3 + np.abs(T[:3, 3]).max())
    np.testing.assert_allclose(pose.apply(result.inverse(), moved), cloud, rtol=0, atol=10.0 * back)
    np.testing.assert_allclose(result.inverse() @ T, np.eye(4), rtol=0, atol=10.0 * back)


def test_apply_takes_the_source_in_its_own_unit() -> None:
    result = good(source_scale=1e3)
    metres = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_array_equal(result.apply(metres), pose.apply(result.T_target_source, 1e3 * metres))


def test_the_dual_quaternion_is_the_pose() -> None:
    result = good()
    np.testing.assert_allclose(result.dual_quaternion.as_matrix(), result.T_target_source, rtol=0, atol=1e-12)


@pytest.mark.parametrize("wrong", [[1.0, 2.0], np.zeros((2, 2)), [[None, 0, 0]], "points"])
def test_apply_refuses_what_are_no_points(wrong: Any) -> None:
    with pytest.raises(InputError, match="points"):
        good().apply(wrong)


def test_nothing_found_moves_nothing() -> None:
    result = failed()
    for ask in (lambda: result.apply([[0.0, 0, 0]]), result.inverse, lambda: result.dual_quaternion):
        with pytest.raises(InputError, match="this registration found no pose: no pose: nothing near"):
            ask()
    assert np.isnan(result.T_target_source).all()


def test_the_kernel_scale_is_read_and_written_under_its_old_name_as_well(tmp_path: Path) -> None:
    content = good().to_dict()
    for record in content["history"]:
        assert record["scale"] == record.pop("kernel_scale") == RECORD.kernel_scale
    (tmp_path / "old.json").write_text(json.dumps(content))
    old = Registration.load(tmp_path / "old.json")
    assert old.history == good().history
    with pytest.warns(DeprecationWarning, match="Iteration.scale is the old name of kernel_scale") as told:
        assert old.history[0].scale == RECORD.kernel_scale
    assert told[0].filename == __file__


def test_a_file_of_old_has_sentences_and_words_without_codes_and_values(tmp_path: Path) -> None:
    content = good().to_dict()
    assert content["verdict"].pop("codes") == ["unconstrained", ""]
    for direction in content["observability"]:
        assert direction.pop("is_free") == (direction["sigma"] is None)
        for name in ("kind", "axis", "point"):
            del direction[name]
    (tmp_path / "old.json").write_text(json.dumps(content))
    old = Registration.load(tmp_path / "old.json")
    assert old.verdict == good().verdict
    assert old.verdict.codes == ("", "")
    assert [d.words for d in old.observability] == ["free", "held"]
    assert [d.is_free for d in old.observability] == [True, False]
    assert all(d.kind is None and np.isnan([d.axis, d.point]).all() for d in old.observability)

from __future__ import annotations

import dataclasses
import importlib
import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg.errors import InputError
from dqreg.files import code_identity, write_cloud
from dqreg.geometry import Mesh, sample_mesh
from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.report.tables import pairs_table, rescans, scans_table
from dqreg.multiway.scans.kept_pairs import digest_of
from dqreg.rigid import pose
from dqreg.synth.parts import bracket

POINTS, STEP_RAD = 1500, 0.5
SIX = np.eye(6, 3) + np.eye(6)[::-1, :3]
Turned = tuple[list[np.ndarray], np.ndarray, dqreg.Multiway]


def views_of_a_part(count: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Points of one part from so many sides, each in a frame of its own; and the true T_world_scan."""
    part, rng = Mesh(*bracket()), np.random.default_rng(0)
    scans, poses = [], []
    for k in range(count):
        T = pose.about(pose.exp(np.r_[0.0, 0.0, STEP_RAD * k, 0.0, 0.0, 0.0]), part.centre)
        cloud = sample_mesh(part, 3 * POINTS, rng)
        # More than half of the faces look towards the scanner.
        seen = cloud.normals @ (T[:3, :3].T @ np.array([1.0, 0.3, 0.6])) > -0.2
        scans.append(pose.apply(T, cloud.points[seen][:POINTS]))
        poses.append(pose.inverse(T))
    return scans, np.stack(poses)


@pytest.fixture(scope="module")
def turned() -> Turned:
    scans, truth = views_of_a_part(3)
    size = np.linalg.norm(np.ptp(scans[0], axis=0))
    return scans, truth, dqreg.register_many(scans, starts=begun_near(truth, size), effort="fast", workers=2)


@cache
def two_views() -> dqreg.Multiway:
    """Two scans from their true poses."""
    scans, truth = views_of_a_part(2)
    return dqreg.register_many(scans, starts=truth, effort="fast", workers=1)


def begun_near(truth: np.ndarray, size: float) -> np.ndarray:
    """Poses some tenths of a degree and of a per cent of the size off, (n, 4, 4)."""
    off = 0.005 * np.random.default_rng(1).normal(size=(len(truth), 6))
    return pose.exp(off * np.r_[1, 1, 1, size, size, size]) @ truth


def relative(T: np.ndarray) -> np.ndarray:
    return pose.inverse(T[0]) @ T


def test_views_of_a_part_come_to_their_places(turned: Turned) -> None:
    assert turned[2].verdict.level == "accepted", turned[2].verdict.reasons
    # Of three views, which meet two by two, poses end at one of two places, by where they begin; of four at one.
    scans, truth = views_of_a_part(4)
    size = np.linalg.norm(np.ptp(scans[0], axis=0))
    result = dqreg.register_many(scans, starts=begun_near(truth, size), effort="fast", workers=2)
    assert result.verdict.level == "accepted", result.verdict.reasons
    for T, exact, points in zip(relative(result.T_world_scan), relative(truth), scans, strict=True):
        apart = np.linalg.norm(pose.apply(T, points) - pose.apply(exact, points), axis=1).max()
        # The points stand 0.02 of the size apart: a twentieth of that.
        assert apart < 1e-3 * size


def test_the_answer_has_all_that_was_promised(turned: Turned) -> None:
    _, _, result = turned
    assert result.covariances.shape == (3, 6, 6)
    assert not result.covariances[0].any()
    joint = result.joint_covariance(1, 2)
    np.testing.assert_array_equal(joint[:6, :6], result.covariances[1])
    assert np.linalg.eigvalsh(joint / np.sqrt(np.outer(np.diag(joint), np.diag(joint)))).min() > -1e-9
    with pytest.raises(InputError, match="0 to 2; got 1 and 3"):
        result.joint_covariance(1, 3)
    assert result.overlap.shape == (3, 3)
    assert all(edge.chi2 >= 0.0 for edge in result.edges if edge.used)
    assert result.loop_errors[0].used


def test_what_the_sigmas_are_against_is_said(turned: Turned) -> None:
    result = turned[2]
    on_part = dataclasses.replace(result, settings={**result.settings, "anchor": PART})
    assert "against the anchor" in scans_table(result).note
    assert "against the part" in scans_table(on_part).note
    assert "anchor" not in {row[1] for row in scans_table(on_part).rows}


def test_the_tables_tell_what_a_scan_and_a_pair_are_off(turned: Turned) -> None:
    result = turned[2]
    for row, k in zip(scans_table(result).rows, result.placed, strict=True):
        used = [edge.registration.rms for edge in result.edges if edge.used and k in (edge.target, edge.source)]
        assert row[5] == np.median(used)
    far = dataclasses.replace(result, edges=tuple(dataclasses.replace(edge, chi2=346.0) for edge in result.edges))
    marked = [row[2] for row in pairs_table(far).rows]
    assert sum("beyond its covariance" in str(words) for words in marked) == sum(edge.used for edge in far.edges)


def test_a_saved_result_is_the_result(turned: Turned, tmp_path: Path) -> None:
    _, _, result = turned
    result.save(tmp_path / "poses.json")
    told = result.to_dict()
    assert (told["units"], told["angle_units"]) == (result.settings["units"], "rad")
    assert set(told["conventions"]) <= set(told)
    again = dqreg.Multiway.load(tmp_path / "poses.json")
    np.testing.assert_array_equal(again.T_world_scan, result.T_world_scan)
    np.testing.assert_array_equal(again.joint, result.joint)
    assert again.verdict == result.verdict
    assert again.verdict.codes == result.verdict.codes
    assert [edge.code for edge in again.edges] == [edge.code for edge in result.edges]
    assert again.loop_errors == result.loop_errors
    (tmp_path / "bad.json").write_text((tmp_path / "poses.json").read_text()[:500])
    with pytest.raises(InputError, match="readable"):
        dqreg.Multiway.load(tmp_path / "bad.json")


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"partial_information": None},
        {"partial_information": ...},
        {"covariance": ...},
        {"history": "none"},
        {"rms": -1.0},
        {"covariance": np.diag([1.0, 1, 1, 1, 1, -1]).tolist()},
        {"T_target_source": [[None] * 4] * 4},
        {"settings": {"seed": -1}},
    ],
    ids=lambda change: "-".join(change) or "as saved",
)
def test_a_registration_is_read_alike_by_itself_and_as_an_edge(change: dict[str, Any], tmp_path: Path) -> None:
    record = two_views().to_dict()
    own = record["edges"][0]["registration"]
    own |= change
    for name in [name for name, value in own.items() if value is ...]:
        del own[name]
    (tmp_path / "one.json").write_text(json.dumps(own))
    (tmp_path / "many.json").write_text(json.dumps(record))

    def told(load: Callable[[], dqreg.Registration]) -> Any:
        try:
            return load().to_dict()
        except InputError as error:
            return str(error).partition("result: ")[2]

    one = told(lambda: dqreg.Registration.load(tmp_path / "one.json"))
    assert one == told(lambda: dqreg.Multiway.load(tmp_path / "many.json").edges[0].registration)
    # What versions of old left out is no damage.
    is_damaged = bool(change) and "partial_information" not in change
    assert isinstance(one, str) == is_damaged


@pytest.mark.parametrize("load", [dqreg.Registration.load, dqreg.Multiway.load])
def test_what_is_no_file_of_a_result_is_told_alike(load: Callable[[Path], Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder; expected one file in it"):
        load(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "none.json")
    (tmp_path / "pose.json").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="no UTF-8"):
        load(tmp_path / "pose.json")
    (tmp_path / "pose.json").write_text("1 0 0 0")
    with pytest.raises(InputError, match="not a pose alone"):
        load(tmp_path / "pose.json")


def test_one_cloud_of_all_scans(turned: Turned) -> None:
    scans, _, result = turned
    cloud = result.merged()
    # Nothing tells from which side these scans were taken.
    assert cloud.normals is None
    assert len(cloud) < sum(map(len, scans)) == len(result.merged(voxel=0))
    with pytest.raises(InputError, match="voxel"):
        result.merged(voxel=-1.0)


def test_the_report_names_the_scans_and_loads_nothing(turned: Turned, tmp_path: Path) -> None:
    _, _, result = turned
    page = result.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert "ACCEPTED" in page
    assert all(name in page for name in result.names)
    # With the colon: pictures are in base64, where those four letters stand now and then.
    assert "http:" not in page
    assert "https:" not in page


@pytest.mark.parametrize(
    ("scans", "options", "named"),
    [
        ([], {}, "two scans"),
        ([SIX], {}, "two scans"),
        ("scans", {}, "list of paths"),
        ([np.zeros((0, 3)), np.zeros((0, 3))], {}, "scan 0: "),
        ([SIX, SIX], {}, "a copy of scan 0"),
        ({"left": SIX, "right": SIX}, {}, "right: a copy of left"),
        ([Path("missing.ply"), SIX], {}, r"missing\.ply"),
        ([SIX, 2 * SIX], {"anchor": 2}, "anchor"),
        ([SIX, 2 * SIX], {"order": "round"}, "order"),
        ([SIX, 2 * SIX], {"edges": "star"}, "edges"),
        ([SIX, 2 * SIX], {"edges": [(0, 2)]}, r"\(0, 2\)"),
        ([SIX, 2 * SIX], {"starts": [np.eye(4)]}, "starts"),
        ([SIX, 2 * SIX], {"effort": "some"}, "effort"),
        ([SIX, 2 * SIX], {"workers": 0}, "workers"),
        ([SIX, 2 * SIX], {"time_limit": 0}, "time_limit"),
        ([SIX, 2 * SIX], {"seed": -1}, "seed"),
    ],
)
def test_bad_input_is_named(scans: Any, options: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        dqreg.register_many(scans, **options)


@pytest.mark.parametrize(
    "option",
    [
        {"seed": True},
        {"seed": np.int64(3)},
        {"seed": 0.5},
        {"seed": None},
        {"time_limit": np.float32(60)},
        {"time_limit": 10**400},
        {"time_limit": float("nan")},
        {"time_limit": "60"},
        {"effort": ["fast"]},
        {"observe": 3},
    ],
    ids=lambda option: repr(option)[:30],
)
def test_options_of_a_pair_are_read_as_by_register(option: dict[str, Any]) -> None:
    # One scan is too few, which is found after the options were looked at.
    with pytest.raises(InputError) as of_many:
        dqreg.register_many([SIX], **option)
    try:
        dqreg.register(SIX, SIX, "identity", **option)
        expected = "two scans"
    except InputError as error:
        expected = re.escape(str(error))
    assert re.search(expected, str(of_many.value))


def test_scans_may_be_objects_of_other_libraries() -> None:
    # All in float64, so the answer is that of the arrays to the last bit.
    scans, truth = views_of_a_part(2)
    options: dict[str, Any] = {"starts": truth, "effort": "fast", "workers": 1}
    plain = two_views()
    rows = np.zeros(len(scans[0]), dtype=[("intensity", "f4"), *((axis, "f8") for axis in "xyz")])
    for axis, column in zip("xyz", scans[0].T, strict=True):
        rows[axis] = column
    message = dqreg.PointCloud(scans[1]).to_pointcloud2("lidar", 0.0, "float64")
    result = dqreg.register_many([rows, message], **options)
    assert plain.placed == (0, 1)
    np.testing.assert_array_equal(result.T_world_scan, plain.T_world_scan)


def test_what_cannot_be_used_is_left_out_and_the_rest_is_placed() -> None:
    scans, truth = views_of_a_part(2)
    odd = [scans[0], np.full((5, 3), np.nan), scans[1], scans[0].copy()]
    result = dqreg.register_many(odd, starts=[truth[0], None, truth[1], None], effort="fast", workers=1)
    assert result.placed == (0, 2, 3)
    assert result.verdict.level == "suspect"
    assert {"unreadable", "duplicate_scan"} <= set(result.verdict.codes)
    np.testing.assert_array_equal(result.T_world_scan[3], result.T_world_scan[0])


def test_a_scan_of_something_else_is_left_out_and_named() -> None:
    scans, truth = views_of_a_part(2)
    ball = np.random.default_rng(0).normal(size=(500, 3))
    ball *= 0.3 * np.ptp(scans[0]) / np.linalg.norm(ball, axis=1, keepdims=True)
    pairs = [(0, 1), (0, 2)]
    result = dqreg.register_many([*scans, ball], starts=[*truth, None], effort="fast", workers=1, edges=pairs)
    assert result.placed == (0, 1)
    assert "scan_left_out" in result.verdict.codes
    assert any("scan 2" in reason for reason in result.verdict.reasons)


def test_finished_pairs_are_taken_from_the_folder_and_others_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans, truth = views_of_a_part(2)
    options: dict[str, Any] = {"starts": truth, "effort": "fast", "workers": 1, "folder": tmp_path / "pairs"}
    dqreg.register_many(scans, **options)
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "pairs").iterdir()}
    second = dqreg.register_many(scans, **options)
    np.testing.assert_array_equal(second.T_world_scan, two_views().T_world_scan)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "pairs").iterdir()} == files
    dqreg.register_many(scans, **{**options, "seed": 1})
    again = {path: path.stat().st_mtime_ns for path in files}
    assert all(again[path] > before for path, before in files.items())
    # An edited dqreg of the same version.
    monkeypatch.setattr(code_identity, "_sources", lambda places: "edited")
    dqreg.register_many(scans, **{**options, "seed": 1})
    assert all(path.stat().st_mtime_ns > before for path, before in again.items())


def test_pairs_of_another_part_or_other_viewpoints_are_registered_anew(tmp_path: Path) -> None:
    scans, truth = views_of_a_part(2)
    vertices, faces = bracket()
    shift = pose.from_parts(np.eye(3), np.array([0.0, 0.0, 0.01 * np.ptp(vertices)]))
    options: dict[str, Any] = {"effort": "fast", "workers": 1, "edges": [(0, 1)], "folder": tmp_path / "pairs"}

    def written(T_part: Any) -> list[int]:
        part = Mesh(pose.apply(T_part, np.asarray(vertices)), faces)
        dqreg.register_many(scans, target=part, starts=truth, **options)
        return [path.stat().st_mtime_ns for path in sorted((tmp_path / "pairs").glob("-1-*.json"))]

    first, again, moved = written(np.eye(4)), written(np.eye(4)), written(shift)
    assert first == again
    assert len(first) == len(moved) > 0
    assert all(after > before for before, after in zip(first, moved, strict=True))
    clouds = [dqreg.PointCloud(points) for points in scans]
    signed = [dqreg.PointCloud(points, normals=np.tile([0.0, 0.0, 1.0], (len(points), 1))) for points in scans]
    named = [dqreg.PointCloud(points, units="mm") for points in scans]
    seen = [dqreg.PointCloud(points, viewpoint=[0.0, 0.0, 9.0]) for points in scans]
    assert len({digest_of(each[0]) for each in (clouds, signed, named, seen)}) == 4


def test_a_limit_is_told_first_and_scans_that_it_left_are_no_other_objects() -> None:
    scans, _ = views_of_a_part(3)
    verdict = dqreg.register_many(scans, effort="fast", workers=1, time_limit=1e-6).verdict
    assert verdict.codes[:2] == ("no_pose", "search_time_limit")
    words = " ".join(str(reason) for reason in verdict.reasons)
    assert "another object" not in words
    assert "not all of its pairs were registered" in words


def test_a_limit_that_ends_the_joint_refinement_keeps_the_poses_of_the_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    scans, truth = views_of_a_part(3)
    # Of a limit that no pair notices, next to nothing is left.
    monkeypatch.setattr(importlib.import_module("dqreg.multiway.register_many"), "JOINT_SHARE", 1e-12)
    result = dqreg.register_many(scans, starts=truth, effort="fast", workers=1, time_limit=1e3)
    assert (result.verdict.level, result.placed) == ("suspect", (0, 1, 2))
    assert result.verdict.codes == ("not_converged",)
    assert "the time limit ended the joint refinement" in str(result.verdict.reasons[0])
    assert np.isnan(result.covariances).all()
    assert np.abs(result.T_world_scan - truth)[:, :3, 3].max() < 0.01 * np.ptp(scans[0])


@pytest.mark.parametrize(
    ("times", "units"),
    [(1000.0, "m and mm"), (25.4, "inch and mm"), pytest.param(1.0 / 0.3048, "m and ft", marks=pytest.mark.soak)],
)
def test_a_scan_in_another_unit_is_told_in_words_of_units(times: float, units: str) -> None:
    scans, truth = views_of_a_part(3)
    scans[2] = times * scans[2]
    result = dqreg.register_many(scans, starts=[*truth[:2], None], effort="fast", workers=1)
    assert result.placed == (0, 1)
    assert any(f"ratio of {units}" in str(reason) for reason in result.verdict.reasons)


def test_an_observer_that_says_no_ends_the_pairs() -> None:
    scans, truth = views_of_a_part(3)
    options: dict[str, Any] = {"starts": truth, "effort": "fast", "workers": 1, "edges": "chain"}
    result = dqreg.register_many(scans, **options, observe=lambda progress: False)
    assert [edge.code for edge in result.edges] == ["used", "untried"]
    assert "search_time_limit" in result.verdict.codes
    assert result.placed == (0, 1)
    # What was not tried says nothing of the scans.
    assert [("more time" in words, "Scan it again" in words) for words in rescans(result)] == [(True, False)]


def test_from_files_to_files_on_the_command_line(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from dqreg.cli.multiway import EDGES, ORDERS, multiway_command
    from dqreg.multiway.pairwise import pairs

    assert (pairs.EDGE_PLANS, pairs.ORDERS) == (EDGES, ORDERS)
    scans, truth = views_of_a_part(2)
    for k, points in enumerate(scans):
        write_cloud(tmp_path / f"view{k}.ply", points)
    np.savetxt(tmp_path / "starts.txt", truth[:, :3].reshape(2, 12))
    words = [str(tmp_path / "view*.ply"), "--starts", str(tmp_path / "starts.txt"), "--effort", "fast"]
    for name, file in (("out", "poses.json"), ("fused", "model.ply"), ("graph", "graph.g2o")):
        words += [f"--{name}", str(tmp_path / file)]
    ran = CliRunner().invoke(multiway_command, words, standalone_mode=False, catch_exceptions=False)
    assert ran.return_value == 0, ran.output
    assert "ACCEPTED" in ran.output
    assert dqreg.Multiway.load(tmp_path / "poses.json").names == ("view0", "view1")
    assert (tmp_path / "model.ply").exists()
    graph = (tmp_path / "graph.g2o").read_text().split()
    assert (graph.count("VERTEX_SE3:QUAT"), graph.count("EDGE_SE3:QUAT")) == (2, 1)


def test_dense_scans_with_times_end_where_those_without_do() -> None:
    part = Mesh(*bracket())
    # More than three times the cells.
    scans = [sample_mesh(part, 20_000, np.random.default_rng(k)).points for k in range(2)]
    timed = [dqreg.PointCloud(points, times=np.linspace(0.0, 1.0, len(points))) for points in scans]
    plain, found = (
        dqreg.register_many(each, starts=[np.eye(4)] * 2, effort="fast", workers=1) for each in (scans, timed)
    )
    assert found.edges[0].found
    np.testing.assert_array_equal(found.T_world_scan, plain.T_world_scan)
    assert found.verdict.codes == plain.verdict.codes


def test_an_error_of_a_pair_is_told_in_its_own_words() -> None:
    part, rng = Mesh(*bracket(), units="mm"), np.random.default_rng(0)
    scans = [dqreg.PointCloud(sample_mesh(part, 800, rng).points / 1000.0) for _ in range(2)]
    result = dqreg.register_many(scans, target=part, starts=[np.eye(4)] * 2, effort="fast", workers=1)
    errors = [edge for edge in result.edges if edge.target == PART]
    assert len(errors) == 2
    assert all("unreadable" in edge.registration.verdict.codes for edge in errors)
    # Nothing was measured, so there is no share of inliers either.
    assert np.isnan([[edge.registration.rms, edge.registration.inlier_fraction] for edge in errors]).all()
    told = [reason for reason in result.verdict.reasons if "times smaller" in reason]
    assert [reason.code for reason in told] == ["unreadable"] * 2
    assert told[0].startswith("the part - scan 0: ")
    # What the errors say is not guessed at beside them.
    assert not any("another object" in reason for reason in result.verdict.reasons)


def test_a_part_in_another_unit_is_said_with_what_multiway_can_do() -> None:
    scans, _ = views_of_a_part(2)
    vertices, faces = bracket()
    part = Mesh(np.asarray(vertices) / 25.4, faces)
    result = dqreg.register_many(scans, target=part, edges=[(0, 1)], starts=[np.eye(4)] * 2, effort="fast", workers=1)
    words = " ".join(result.verdict.reasons)
    assert "Convert the scans or the part" in words
    assert "--source-units" not in words
    assert "another object" not in words

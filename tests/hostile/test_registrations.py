# Either outcome is right here, so errors are looked at where they are caught.
# ruff: noqa: PT017, RUF005
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, DqregError, InputError
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from tests.hostile.scenes import FIXED, PART, SCAN, SIZE, START, assert_kept, part
from tests.hostile.sides import CLOUDS, LINE, MESHES, PLANE, SOURCES, TARGETS, Entry

NAN, INF = float("nan"), float("inf")


def judged(entry: Entry, call: Callable[[Any], Registration], dropped: str) -> None:
    """Run one entry of a table and hold it to its outcome."""
    make, outcome, words = entry
    if isinstance(outcome, type):
        with pytest.raises(outcome, match=rf"(?s){words}") as caught:
            call(make())
        assert type(caught.value) is outcome
        return
    try:
        result = call(make())
    except DqregError as error:
        assert type(error) in outcome
        return
    assert_kept(result)
    assert result.verdict.level in outcome
    if words is not None:
        assert result.settings[dropped] == words


def soaked(name: str) -> Any:
    """An entry much like another one, for the long tests."""
    return pytest.param(name, marks=pytest.mark.soak)


@pytest.mark.parametrize("name", MESHES)
def test_what_is_no_mesh_or_cloud_is_refused_when_it_is_made(name: str) -> None:
    make, outcome, words = MESHES[name]
    with pytest.raises(outcome, match=rf"(?s){words}"):
        make()


@pytest.mark.parametrize("side", ["source", "target"])
@pytest.mark.parametrize("name", CLOUDS)
def test_what_cannot_be_used_on_either_side_is_refused_by_name(name: str, side: str) -> None:
    make, outcome, words = CLOUDS[name]
    sides = {"source": SCAN, "target": FIXED, side: make()}
    with pytest.raises(outcome, match=rf"(?s){side}.*({words})"):
        register(sides["source"], sides["target"], START, effort="fast")


@pytest.mark.parametrize("name", [soaked(name) if name == "3 times as large" else name for name in SOURCES])
def test_a_hostile_source_ends_in_words(name: str) -> None:
    judged(SOURCES[name], lambda made: register(made, part(), START, effort="fast"), "source_dropped")


@pytest.mark.parametrize("name", [soaked(name) if name == "zero normals" else name for name in TARGETS])
def test_a_hostile_target_ends_in_words(name: str) -> None:
    judged(TARGETS[name], lambda made: register(SCAN, made, START, effort="fast"), "target_dropped")


# The search for a start, on what it can stumble over; the long list is for the soak.
SEARCHED = ["one NaN", "six points", "coplanar", "a mesh of one triangle", "NaN normals"]


@pytest.mark.parametrize("name", SEARCHED)
def test_the_search_survives_a_hostile_source(name: str) -> None:
    make = SOURCES[name][0]
    assert_kept(register(make(), part(), effort="fast"))


@pytest.mark.parametrize("name", ["six points", "coplanar", "zero normals"])
def test_the_search_survives_a_hostile_target(name: str) -> None:
    assert_kept(register(SCAN, TARGETS[name][0](), effort="fast"))


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted(SOURCES.keys() - set(SEARCHED)))
def test_the_search_survives_every_hostile_source(name: str) -> None:
    make, outcome, words = SOURCES[name]
    allowed = outcome if isinstance(outcome, type) else {"accepted", "suspect", "failed", *outcome}
    judged((make, allowed, words), lambda made: register(made, part(), effort="fast"), "source_dropped")


@pytest.mark.soak
@pytest.mark.parametrize("name", sorted(TARGETS))
def test_the_search_survives_every_hostile_target(name: str) -> None:
    make, outcome, words = TARGETS[name]
    allowed = outcome if isinstance(outcome, type) else {"accepted", "suspect", "failed", *outcome}
    judged((make, allowed, words), lambda made: register(SCAN, made, effort="fast"), "target_dropped")


def entry(row: int, column: int, value: Any, of: Any = None) -> Any:
    """A pose with one entry changed."""
    T = np.eye(4) if of is None else of.copy()
    T[row, column] = value
    return T


COVARIANCE = np.diag([1e-4] * 3 + [1.0] * 3)
# Options that must be refused, with the words of it.
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "mirrored start": ({"start": np.diag([1.0, 1, -1, 1])}, "mirror"),
    "start turned inside out": ({"start": np.diag([-1.0, -1, -1, 1])}, "mirror"),
    "scaled start": ({"start": np.diag([2.0, 2, 2, 1])}, "not rigid"),
    "start in mm by 1e-3": ({"start": np.diag([1e-3, 1e-3, 1e-3, 1])}, "not rigid"),
    "sheared start": ({"start": entry(0, 1, 0.1)}, "not rigid"),
    "start of zeros": ({"start": np.zeros((4, 4))}, "last row"),
    "start of zeros above": ({"start": np.diag([0.0, 0, 0, 1])}, "not rigid"),
    "start of NaN": ({"start": np.full((4, 4), NAN)}, "16 numbers"),
    "start with one NaN": ({"start": entry(1, 3, NAN)}, r"\(1, 3\)"),
    "start with infinity": ({"start": entry(1, 3, INF)}, r"\(1, 3\)"),
    "start at 1e300 in the rotation": ({"start": entry(0, 0, 1e300)}, "not rigid"),
    "start at 1e300": ({"start": entry(0, 3, 1e300)}, "start"),
    "transposed start": ({"start": START.T}, "transposed"),
    "start of two rows": ({"start": START[:2]}, r"\(2, 4\)"),
    "start scaled by 1 %": ({"start": np.diag([1.01, 1.01, 1.01, 1])}, "not rigid"),
    "start of rotation alone": ({"start": START[:3, :3]}, r"\(3, 3\)"),
    "start of text": ({"start": "centre"}, "identity"),
    "start of rows of text": ({"start": [["1"] * 4] * 4}, "real numbers"),
    "start of None in rows": ({"start": [[None] * 4] * 4}, "None"),
    "complex start": ({"start": START + 0j}, "complex"),
    "start of many poses": ({"start": np.stack([START, START])}, r"\(2, 4, 4\)"),
    "start as a path that is none": ({"start": "no_such.txt"}, "start"),
    "start as a number": ({"start": 3}, "start"),
    "start as a dictionary": ({"start": {}}, "start"),
    "unknown method": ({"method": "magic"}, "magic"),
    "method of None": ({"method": None}, "method"),
    "method as a list": ({"method": ["dq"]}, "method"),
    "unknown effort": ({"effort": "heroic"}, "heroic"),
    "effort as a list": ({"effort": ["fast"]}, "effort"),
    "effort as a dictionary": ({"effort": {}}, "effort"),
    "max_distance zero": ({"max_distance": 0.0}, "max_distance"),
    "max_distance negative": ({"max_distance": -1.0}, "max_distance"),
    "max_distance NaN": ({"max_distance": NAN}, "max_distance"),
    "max_distance infinite": ({"max_distance": INF}, "max_distance"),
    "max_distance text": ({"max_distance": "5"}, "max_distance"),
    "max_distance array": ({"max_distance": np.ones(2)}, "max_distance"),
    "max_angle_deg zero": ({"max_angle_deg": 0.0}, "max_angle_deg"),
    "max_angle_deg 91": ({"max_angle_deg": 91.0}, "max_angle_deg"),
    "max_angle_deg NaN": ({"max_angle_deg": NAN}, "max_angle_deg"),
    "seed negative": ({"seed": -1}, "seed"),
    "seed a half": ({"seed": 0.5}, "seed"),
    "seed NaN": ({"seed": NAN}, "seed"),
    "seed infinite": ({"seed": INF}, "seed"),
    "seed None": ({"seed": None}, "seed"),
    "seed text": ({"seed": "7"}, "seed"),
    "max_iterations zero": ({"max_iterations": 0}, "max_iterations"),
    "max_iterations a half": ({"max_iterations": 2.5}, "max_iterations"),
    "max_iterations NaN": ({"max_iterations": NAN}, "max_iterations"),
    "max_iterations infinite": ({"max_iterations": INF}, "max_iterations"),
    "convergence zero": ({"convergence": 0.0}, "convergence"),
    "convergence one": ({"convergence": 1.0}, "convergence"),
    "convergence NaN": ({"convergence": NAN}, "convergence"),
    "units unknown": ({"units": "guess"}, "units"),
    "units as a list": ({"units": []}, "units"),
    "source_units unknown": ({"source_units": "parsec", "target_units": "mm"}, "parsec"),
    "source_units a number": ({"source_units": 3, "target_units": "mm"}, "3"),
    "source_units a list": ({"source_units": ["mm"], "target_units": "mm"}, "mm"),
    "target_units unknown": ({"target_units": "furlong"}, "furlong"),
    "time_limit zero": ({"time_limit": 0.0}, "time_limit"),
    "time_limit negative": ({"time_limit": -1.0}, "time_limit"),
    "time_limit NaN": ({"time_limit": NAN}, "time_limit"),
    "time_limit text": ({"time_limit": "soon"}, "time_limit"),
    "dof without start": ({"start": None, "dof": "rz"}, "start"),
    "dof unknown": ({"dof": "rq"}, "rq"),
    "dof a number": ({"dof": 6}, "6|dof|free"),
    "dof empty": ({"dof": ""}, "motion|dof|free"),
    "prior of one thing": ({"prior": (np.eye(4),)}, "prior"),
    "prior of a number": ({"prior": 3}, "prior"),
    "prior of text": ({"prior": "ab"}, "prior"),
    "prior with a mirrored pose": ({"start": None, "prior": (np.diag([1.0, 1, -1, 1]), COVARIANCE)}, "prior"),
    "prior with NaN": ({"prior": (np.eye(4), np.full((6, 6), NAN))}, ""),
    "prior of five": ({"prior": (np.eye(4), np.eye(5))}, ""),
    "prior not symmetric": ({"prior": (np.eye(4), COVARIANCE + np.eye(6, k=1))}, ""),
    "prior not positive": ({"prior": (np.eye(4), -COVARIANCE)}, ""),
    "accelerate text": ({"accelerate": "no"}, "accelerate"),
    "keep_inputs a number": ({"keep_inputs": 3}, "keep_inputs must be True or False; got 3"),
    "distance of True": ({"max_distance": True}, "max_distance must be a number; got True"),
    "iterations of True": ({"max_iterations": True}, "max_iterations must be a number; got True"),
    "seed of True": ({"seed": True}, "seed must be a whole number"),
    "time_limit of True": ({"time_limit": True}, "time_limit must be a number"),
    "observe a number": ({"observe": 3}, "observe"),
    "observe_search text": ({"observe_search": "x"}, "observe_search"),
}
# Unusual, but fine.
TAKEN: dict[str, dict[str, Any]] = {
    "start of lists": {"start": START.tolist()},
    "start of whole numbers": {"start": np.eye(4, dtype=int)},
    "start of seven digits": {"start": np.round(START, 7)},
    "start in Fortran order": {"start": np.asfortranarray(START)},
    "start read-only": {"start": np.broadcast_to(START, (4, 4))},
    "start of objects": {"start": START.astype(object)},
    "start at 1e12": {"start": pose.from_parts(np.eye(3), [1e12, 0, 0])},
    "max_distance tiny": {"max_distance": 1e-300},
    "max_distance huge": {"max_distance": 1e300},
    "max_angle_deg tiny": {"max_angle_deg": 1e-300},
    "convergence tiny": {"convergence": 1e-300},
    "convergence nearly one": {"convergence": 1.0 - 1e-12},
    "one iteration": {"max_iterations": 1},
    "seed of NumPy": {"seed": np.int64(3)},
    "seed of 2^100": {"seed": 2**100},
    "numbers of NumPy": {"max_distance": np.float32(30.0), "max_angle_deg": np.int16(60)},
    "no time at all": {"time_limit": 1e-300},
    "endless time": {"time_limit": 1e300},
    "time beyond all floats": {"time_limit": 10**400},
    "distance beyond all floats": {"max_distance": 10**400},
    "no time to search": {"start": None, "time_limit": 1e-9},
    "prior of zero covariance": {"prior": (START, 0.0 * COVARIANCE)},
    "prior beyond reach": {"prior": (pose.from_parts(np.eye(3), [1e6, 0, 0]), 1e-12 * COVARIANCE)},
    "prior sure of nothing": {"prior": (START, 1e30 * COVARIANCE)},
    "all motions locked but one": {"dof": "rz"},
    "locked, and a prior against it": {"dof": "tx", "prior": (pose.from_parts(np.eye(3), [0, 5.0, 0]), COVARIANCE)},
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_option_that_cannot_be_meant_is_refused_by_name(name: str) -> None:
    options, words = REFUSED[name]
    with pytest.raises(InputError, match=rf"(?s){words}"):
        register(**{"source": SCAN, "target": part(), "start": START, "effort": "fast", **options})


@pytest.mark.parametrize("name", TAKEN)
def test_an_unusual_option_ends_in_words(name: str) -> None:
    options = {"source": SCAN, "target": part(), "start": START, "effort": "fast", **TAKEN[name]}
    try:
        assert_kept(register(**options))
    except InputError as error:
        assert name.split()[0].rstrip(",") in str(error) or "covariance must have variances above 0" in str(error)


@pytest.mark.parametrize("method", ["auto", "dq", "dq-points", "svd", "plane"])
@pytest.mark.parametrize("name", ["line of threads", "plane on plane", "six on six", "zero noise", "no overlap"])
def test_no_method_makes_a_pose_of_nothing(name: str, method: str) -> None:
    threads = np.r_[LINE, LINE + [0.0, 0.0, 30.0]]
    sides = {
        "line of threads": (threads, threads),
        "plane on plane": (PLANE, PLANE),
        "six on six": (SCAN[::80], FIXED[::110]),
        "zero noise": (FIXED, FIXED),
        "no overlap": (SCAN + [3.0 * SIZE, 0.0, 0.0], FIXED),
    }
    source, target = sides[name]
    result = register(source, target, START, method=method, effort="fast")
    assert_kept(result)
    assert (result.verdict.level == "accepted") == (name == "zero noise")
    if name == "plane on plane":
        # Three motions are free: their variances are NaN, never small numbers. Sliding along and turning in the plane
        # touch rz, tx and ty, the rest is known.
        assert np.isnan(np.diag(result.covariance)).tolist() == [False, False, True, True, True, False]
    if name == "no overlap":
        assert result.verdict.level == "failed"


def test_a_pose_without_inliers_is_no_pose() -> None:
    # Six target points, and a kernel as wide as their noise: no scan point lies on them.
    result = register(SCAN, FIXED[::110], START, effort="fast")
    assert result.verdict.level == "failed"
    assert np.isnan(result.T_target_source).all()


def test_what_a_mask_hides_is_dropped_and_counted() -> None:
    hidden = np.ma.masked_array(np.vstack([SCAN, [[9e3, 9e3, 9e3]]]))
    hidden[-1] = np.ma.masked
    plain = register(SCAN, part(), START, effort="fast")
    result = register(hidden, part(), START, effort="fast")
    assert result.settings["source_dropped"] == 1
    np.testing.assert_array_equal(result.T_target_source, plain.T_target_source)


# More than three times the cells of every effort: both clouds are downsampled.
DENSE = [sample_mesh(PART, 50_000, np.random.default_rng(k)).points for k in range(2)]


@pytest.mark.parametrize(("effort", "start"), [("fast", START), ("normal", START), ("best", START), ("fast", None)])
def test_dense_clouds_with_times_end_where_those_without_do(effort: str, start: Any) -> None:
    source, target = (PointCloud(points, times=np.linspace(0.0, 1.0, len(points))) for points in DENSE)
    result = register(source, target, start, effort=effort)
    assert_kept(result)
    assert result.verdict.level == "accepted"
    np.testing.assert_array_equal(result.T_target_source, register(*DENSE, start, effort=effort).T_target_source)


def test_a_drift_in_time_is_told_of_clouds_that_are_downsampled() -> None:
    source, target = DENSE
    times = np.random.default_rng(2).uniform(size=len(source))
    moved = source + np.outer(times - 0.5, 0.005 * SIZE * np.array([0.6, 0.0, 0.8]))
    # Their order tells nothing: that of the rows has none.
    for known, codes in ((None, ("accepted",)), (times, ("drift",))):
        result = register(PointCloud(moved, times=known), target, "identity", effort="fast")
        assert result.verdict.codes == codes


def test_flipped_faces_and_open_sides_are_reported() -> None:
    faces = PART.faces.copy()
    faces[::2] = faces[::2, ::-1]
    assert any("against each other" in words for words in Mesh(PART.vertices, faces).faults)
    assert any("not watertight" in words for words in Mesh(PART.vertices, PART.faces[3:]).faults)
    assert any("inward" in words for words in Mesh(PART.vertices, PART.faces[:, ::-1]).faults)
    assert any("no area" in words for words in TARGETS["faces without area"][0]().faults)


def test_a_far_face_costs_the_others_nothing() -> None:
    # An area is rounding against the coordinates of its own face, not against the whole mesh.
    far = TARGETS["a face as far as 1e9"][0]()
    assert len(far.faces) == len(PART.faces) + 1
    assert far.dropped == 0


def test_a_line_with_strays_names_the_strays() -> None:
    with pytest.raises(DegenerateGeometryError, match="Remove the 1 stray up to 1e"):
        register(np.vstack([SCAN[:90], [[1e12, 0.0, 0.0]]]), part(), START)
    assert math.isfinite(SIZE)

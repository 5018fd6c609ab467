from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dqreg._arrays import FloatArray
from dqreg._open3d import load_open3d
from dqreg.errors import DegenerateGeometryError, DqregError, InputError, UnitsError
from dqreg.files import write_cloud
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.icp.history import Iteration
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.registration.target import prepare_target
from dqreg.rigid import pose
from dqreg.synth import disturbance, worst_vertex_displacement
from dqreg.synth.parts import box
from tests.icp.scenes import bracket_mesh, bracket_points, bumpy_cloud

PART = bracket_mesh()
SIZE = PART.diagonal
# Prepared once: that it answers as the bare part does is a law of its own below.
TARGET = prepare_target(PART)
SCAN = bracket_points(45, seed=0)
START = disturbance(np.random.default_rng(1), np.deg2rad(8.0), 0.03 * SIZE, PART.centre)
# Float32 copies of the coordinates, as Open3D's and trimesh's files hold them, are off by 1e-7 of the size.
ROUNDING = 1e-6 * SIZE


def worst(T: FloatArray, T_expected: FloatArray) -> float:
    return worst_vertex_displacement(T, T_expected, PART.vertices)


# Share of the size, or angle, to which a pose must repeat itself in other units or at another place.
SAME = 1e-9


def bytes_of(result: Registration) -> dict[str, Any]:
    """All of a result but the clock."""
    plain = result.to_dict()
    del plain["timings"]
    for record in plain["history"]:
        del record["seconds"]
    return plain


@pytest.fixture(scope="module")
def expected() -> Registration:
    result = register(SCAN, PART, START)
    assert result.verdict.level == "accepted"
    # The truth is the identity; 1,500 points with noise of 3e-4 of the size.
    assert worst(result.T_target_source, np.eye(4)) <= 1e-4 * SIZE
    return result


def as_legacy() -> tuple[Any, Any]:
    o3d = load_open3d()
    vector = o3d.utility.Vector3dVector
    cloud = o3d.geometry.PointCloud(vector(SCAN))
    return cloud, o3d.geometry.TriangleMesh(vector(PART.vertices), o3d.utility.Vector3iVector(PART.faces))


def as_tensor() -> tuple[Any, Any]:
    o3d = load_open3d()
    return tuple(
        made.from_legacy(value)
        for made, value in zip((o3d.t.geometry.PointCloud, o3d.t.geometry.TriangleMesh), as_legacy(), strict=True)
    )


def as_trimesh() -> tuple[Any, Any]:
    return trimesh.PointCloud(SCAN), trimesh.Trimesh(PART.vertices, PART.faces, process=False)


KINDS = {
    "lists": lambda: (SCAN.tolist(), PART),
    "PointCloud": lambda: (PointCloud(SCAN), PART),
    "Open3D legacy": as_legacy,
    "Open3D tensor": as_tensor,
    "trimesh": as_trimesh,
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_object_gives_the_same_pose(expected: Registration, kind: str) -> None:
    source, target = KINDS[kind]()
    result = register(source, target, START)
    assert result.verdict.level == "accepted"
    assert worst(result.T_target_source, expected.T_target_source) <= ROUNDING


@pytest.mark.parametrize("as_text", [str, Path])
def test_paths_give_the_same_pose(expected: Registration, tmp_path: Path, as_text: type) -> None:
    write_cloud(tmp_path / "scan.ply", SCAN)
    trimesh.Trimesh(PART.vertices, PART.faces, process=False).export(tmp_path / "part.stl")
    result = register(as_text(tmp_path / "scan.ply"), as_text(tmp_path / "part.stl"), START)
    assert worst(result.T_target_source, expected.T_target_source) <= ROUNDING


def test_a_prepared_target_gives_the_same_bytes(expected: Registration) -> None:
    target = prepare_target(PART)
    for result in (register(SCAN, target, START), target.register(SCAN, START), target.register(SCAN, START)):
        assert bytes_of(result) == bytes_of(expected)


def test_threads_share_a_target(expected: Registration) -> None:
    target = prepare_target(PART)
    found: list[Registration] = []
    threads = [threading.Thread(target=lambda: found.append(target.register(SCAN, START))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [bytes_of(result) for result in found] == [bytes_of(expected)] * 2


def test_the_same_seed_gives_the_same_bytes_where_something_is_drawn() -> None:
    # A mesh as the source is sampled, and the search for a start draws pairs.
    target, moved = prepare_target(PART), Mesh(pose.apply(START, PART.vertices), PART.faces)
    first, again = (target.register(moved, effort="fast", seed=3) for _ in range(2))
    assert bytes_of(first) == bytes_of(again)
    assert worst(first.T_target_source @ START, np.eye(4)) <= 1e-4 * SIZE
    # From a known start only the sample depends on the seed.
    one, other = (target.register(moved, pose.inverse(START), effort="fast", seed=seed) for seed in (3, 4))
    assert one.rms != other.rms


def test_a_start_is_target_from_source(expected: Registration) -> None:
    # The scan stands elsewhere; the start takes it back to near the part.
    elsewhere = disturbance(np.random.default_rng(2), 2.0, 3.0 * SIZE, np.zeros(3))
    result = register(pose.apply(elsewhere, SCAN), PART, START @ pose.inverse(elsewhere))
    assert worst(result.T_target_source @ elsewhere, expected.T_target_source) <= 1e-9 * SIZE
    assert result.settings["start"] == "given"
    # Three digits of the same start, as 3x4: projected, and settings say by how much (each number by 5e-4 at most).
    rounded = (START @ pose.inverse(elsewhere))[:3].copy()
    rounded[:, :3] = rounded[:, :3].round(3)
    again = register(pose.apply(elsewhere, SCAN), PART, rounded, effort="fast")
    assert 0.0 < again.settings["start_departure"] < 3 * 5e-4
    assert result.settings["start_departure"] < 1e-14
    assert worst(again.T_target_source @ elsewhere, expected.T_target_source) <= 1e-4 * SIZE
    near = register(pose.apply(START, SCAN), PART, "identity")
    assert worst(near.T_target_source @ START, expected.T_target_source) <= 1e-6 * SIZE
    assert near.settings["start"] == "identity"


def test_nothing_given_is_changed() -> None:
    points, start, vertices = SCAN.copy(), START.copy(), PART.vertices.copy()
    register(SCAN, PART, START, effort="fast")
    np.testing.assert_array_equal(SCAN, points)
    np.testing.assert_array_equal(START, start)
    np.testing.assert_array_equal(PART.vertices, vertices)


@pytest.mark.parametrize("to_mesh", [True, False], ids=["mesh", "cloud"])
def test_metres_are_millimetres_a_thousand_times_smaller(to_mesh: bool) -> None:
    # Measured 4e-15 of the size for a mesh and 1.3e-9 for a cloud.
    points = bracket_points(50, seed=7)
    small_start = pose.from_parts(START[:3, :3], 1e-3 * START[:3, 3])
    one, small = (
        register(k * SCAN, Mesh(k * PART.vertices, PART.faces) if to_mesh else k * points, start, effort="fast")
        for k, start in ((1.0, START), (1e-3, small_start))
    )
    T = small.T_target_source.copy()
    T[:3, 3] *= 1e3
    assert worst(T, one.T_target_source) <= SAME * SIZE
    assert pose.angle_between(T, one.T_target_source) <= SAME
    assert small.verdict.level == one.verdict.level
    assert small.rms == pytest.approx(1e-3 * one.rms, rel=1e-6)


@pytest.mark.parametrize("to_mesh", [True, False], ids=["mesh", "cloud"])
def test_coordinates_of_a_national_grid_cost_nothing_but_their_rounding(to_mesh: bool) -> None:
    # Coordinates of 4.4e6 are rounded to 6e-12 of the size; measured 1e-12 of the size for a mesh, 1.3e-9 for a cloud.
    far = pose.from_parts(np.eye(3), [5e5, 4.4e6, 100.0])
    points = bracket_points(50, seed=7)
    near_target = PART if to_mesh else points
    far_target = Mesh(pose.apply(far, PART.vertices), PART.faces) if to_mesh else pose.apply(far, points)
    one = register(SCAN, near_target, START, effort="fast")
    there = register(pose.apply(far, SCAN), far_target, far @ START @ pose.inverse(far), effort="fast")
    T = pose.inverse(far) @ there.T_target_source @ far
    assert worst(T, one.T_target_source) <= SAME * SIZE
    assert pose.angle_between(T, one.T_target_source) <= SAME
    assert there.verdict.level == one.verdict.level


@pytest.mark.parametrize("method", ["auto", "dq", "dq-points", "svd", "plane"])
def test_the_pose_is_rigid(method: str) -> None:
    T = register(SCAN, TARGET, START, method=method, effort="fast").T_target_source
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])


def test_all_methods_agree_on_clean_data() -> None:
    # Dense enough for the planes that say there is no noise.
    clean = bracket_points(60, seed=0, sigma=0.0)
    ends = {
        m: register(clean, TARGET, START, method=m, verdict=False).T_target_source
        for m in ("auto", "dq", "dq-points", "svd")
    }
    for T in ends.values():
        assert worst(T, np.eye(4)) <= 1e-6 * SIZE
    assert worst(ends["dq-points"], ends["svd"]) <= 1e-9 * SIZE


def test_rows_of_nan_are_left_out_and_counted(expected: Registration) -> None:
    spoilt = np.insert(SCAN, [0, 100, 200], [[np.nan, 0, 0], [0, np.inf, 0], [np.nan] * 3], axis=0)
    result = register(spoilt, TARGET, START)
    assert result.settings["source_dropped"] == 3
    np.testing.assert_array_equal(result.T_target_source, expected.T_target_source)


def test_units_are_converted_to_the_target_s(expected: Registration) -> None:
    result = register(SCAN / 1000.0, PART, START, source_units="m", target_units="mm")
    assert worst(result.T_target_source, expected.T_target_source) <= 1e-9 * SIZE
    assert result.settings["source_scale"] == 1000.0
    assert (result.settings["source_units"], result.settings["target_units"]) == ("m", "mm")
    # apply takes the source's own unit.
    np.testing.assert_allclose(result.apply(SCAN / 1000.0), expected.apply(SCAN), atol=1e-9 * SIZE)


def test_an_unknown_unit_converts_nothing(expected: Registration) -> None:
    result = register(SCAN, PART, START, source_units="mm")
    np.testing.assert_array_equal(result.T_target_source, expected.T_target_source)
    assert result.settings["source_scale"] == 1.0


def test_lengths_are_resolved_in_the_settings(expected: Registration) -> None:
    assert expected.settings["max_distance"] == pytest.approx(0.2 * SIZE, rel=0.05)
    assert register(SCAN, TARGET, START, max_distance=20.0).settings["max_distance"] == 20.0
    assert expected.settings["diagonal"] == pytest.approx(SIZE, rel=1e-12)
    assert expected.settings["target_kind"] == "mesh"
    assert expected.settings["used_points"] == len(SCAN)
    assert set(expected.timings) - {"compile"} == {"read", "prepare", "start", "register", "second try", "total"}


def test_no_overlap_is_no_pose_and_is_searched_for_unless_that_is_forbidden() -> None:
    far = pose.from_parts(np.eye(3), [10 * SIZE, 0.0, 0.0])
    found = register(SCAN, TARGET, far)
    assert found.verdict.codes == ("accepted", "contradicted_start")
    result = register(SCAN, TARGET, far, search="never")
    assert result.verdict.level == "failed"
    assert "max_distance" in result.verdict.reasons[0]
    assert result.status == "no correspondences"
    assert np.isnan(result.T_target_source).all()
    assert np.isnan(result.covariance).all()
    assert np.isnan(result.rms)
    assert result.inlier_fraction == 0.0
    with pytest.raises(InputError, match="found no pose"):
        result.apply(SCAN)


def test_the_observer_sees_every_iteration_and_may_stop() -> None:
    seen: list[Iteration] = []
    result = register(SCAN, TARGET, START, observe=seen.append)
    assert tuple(seen) == result.history
    stopped = register(SCAN, TARGET, START, observe=lambda record: record.number < 4)
    assert len(stopped.history) == 4
    assert stopped.status == "stopped by observer"
    assert stopped.verdict.level != "accepted"
    assert np.isfinite(stopped.T_target_source).all()


def test_an_observer_that_raises_is_heard() -> None:
    def refuse(_: Iteration) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        register(SCAN, TARGET, START, observe=refuse)


def changed(**entries: float) -> FloatArray:
    T = np.eye(4)
    for place, value in entries.items():
        T[int(place[1]), int(place[2])] = value
    return T


LINE = np.linspace(0.0, 5.0, 50)[:, None] * [1.0, 2.0, 3.0]
BAD: dict[str, tuple[dict[str, Any], type[DqregError], str]] = {
    "missing file": ({"source": "no_such_scan.ply"}, InputError, r"no_such_scan\.ply"),
    "missing target": ({"target": "no_such_part.stl"}, InputError, r"no_such_part\.stl"),
    "empty cloud": ({"source": np.zeros((0, 3))}, InputError, "source.*empty"),
    "all NaN": ({"source": np.full((5, 3), np.nan)}, InputError, "source.*5 rows"),
    "two points": ({"source": np.eye(3)[:2]}, InputError, "source has 2 usable points"),
    "one point": ({"source": np.eye(3)[:1]}, InputError, "source has 1 usable point;"),
    "wrong shape": ({"source": np.zeros((5, 2))}, InputError, r"source.*\(5, 2\)"),
    "text": ({"source": [["a", "b", "c"]]}, InputError, "source"),
    "nothing": ({"source": None}, InputError, "source"),
    "collinear source": ({"source": LINE}, DegenerateGeometryError, "50 points of the source"),
    "collinear target": ({"target": LINE}, DegenerateGeometryError, "50 points of the target"),
    "one place": ({"source": np.ones((50, 3))}, DegenerateGeometryError, "50 points of the source"),
    "far line": ({"source": LINE + 1e6}, DegenerateGeometryError, "source"),
    "scaled start": ({"start": np.diag([2.0, 2.0, 2.0, 1.0])}, InputError, "start is not rigid.* 3 "),
    "mirrored start": ({"start": np.diag([1.0, 1.0, -1.0, 1.0])}, InputError, "start.*mirror.*-1"),
    "transposed start": ({"start": changed(r30=5.0)}, InputError, r"start.*5\.0.*transposed"),
    "small start": ({"start": np.eye(3)}, InputError, r"start.*\(3, 3\)"),
    "NaN start": ({"start": changed(r03=np.nan)}, InputError, r"start.*\(0, 3\)"),
    "wrong word": ({"start": "centre"}, InputError, "start.*'centre'"),
    "word none": ({"start": "none"}, InputError, "did you mean None"),
    "rotation and translation": ({"start": (np.eye(3), np.zeros(3))}, InputError, r"start .*pose.from_parts\(R, t\)"),
    "word of others": ({"method": "point-to-plane"}, InputError, "did you mean plane"),
    "method": ({"method": "magic"}, InputError, "'magic'.*dq-points"),
    "effort": ({"effort": "heroic"}, InputError, "'heroic'.*normal"),
    "negative distance": ({"max_distance": -1.5}, InputError, r"max_distance.*-1\.5"),
    "no distance": ({"max_distance": 0.0}, InputError, r"max_distance.*0\.0"),
    "distance as text": ({"max_distance": "5 mm"}, InputError, r"max_distance.*'5 mm'"),
    "convergence as text": ({"convergence": "fine"}, InputError, r"convergence.*'fine'"),
    "NaN distance": ({"max_distance": np.nan}, InputError, "max_distance.*nan"),
    "angle": ({"max_angle_deg": 120.0}, InputError, r"max_angle_deg.*120\.0"),
    "iterations": ({"max_iterations": 0}, InputError, "max_iterations.*0"),
    "convergence": ({"convergence": 1.5}, InputError, r"convergence.*1\.5"),
    "seed": ({"seed": -1}, InputError, "seed.*-1"),
    "source units": ({"source_units": "parsec", "target_units": "mm"}, UnitsError, "'parsec'"),
    "target units": ({"target_units": "furlong"}, UnitsError, "'furlong'"),
    # Words that mean nothing are named before a start is missed.
    "motion without a start": ({"dof": "rz tw", "start": None}, InputError, "unknown motion 'tw'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_by_name_with_what_was_given(case: str) -> None:
    options, error, message = BAD[case]
    with pytest.raises(error, match=rf"(?s){message}"):
        register(**{"source": SCAN, "target": PART, "start": "identity", **options})


def test_tolerance_is_the_old_name_of_convergence() -> None:
    with pytest.warns(DeprecationWarning, match="tolerance is the old name of convergence") as told:
        old = register(SCAN, PART, "identity", tolerance=1e-3)
    assert told[0].filename == __file__
    new = register(SCAN, PART, "identity", convergence=1e-3)
    np.testing.assert_array_equal(old.T_target_source, new.T_target_source)
    assert old.settings["convergence"] == new.settings["convergence"] == 1e-3
    assert "tolerance" not in new.settings
    with pytest.raises(InputError, match="tolerance is the old name of convergence"):
        register(SCAN, PART, "identity", tolerance=1e-3, convergence=1e-4)


def test_an_unknown_extension_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.xyzzy"
    path.write_text("1 2 3\n")
    with pytest.raises(InputError, match=r"scan\.xyzzy"):
        register(path, PART)


def test_a_mesh_without_faces_is_refused(tmp_path: Path) -> None:
    o3d = load_open3d()
    bare = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(PART.vertices), o3d.utility.Vector3iVector())
    with pytest.raises(InputError, match=r"target.*no faces"):
        register(SCAN, bare)
    flat = Mesh(PART.vertices, PART.faces)
    with pytest.raises(InputError, match="none with an area"):
        register(SCAN, Mesh(0.0 * flat.vertices, flat.faces))


def test_clouds_register_to_clouds() -> None:
    points = bumpy_cloud(2_000)
    T = disturbance(np.random.default_rng(3), np.deg2rad(3.0), 0.03, points.mean(axis=0))
    result = register(points, pose.apply(T, points), "identity")
    np.testing.assert_allclose(result.T_target_source, T, atol=1e-12)
    assert result.settings["target_kind"] == "cloud"
    assert result.verdict.level == "accepted"


def test_the_axis_of_a_symmetry_is_named_in_the_frame_of_the_target() -> None:
    # A box far from the origin: its axes pass through its centre, wherever that is.
    vertices, faces = box((3.0, 2.0, 1.0))
    centre = np.array([100.0, 50.0, 20.0])
    part = Mesh(vertices + centre, faces)
    result = register(PointCloud(sample_mesh(part, 4_000, np.random.default_rng(0)).points), part)
    assert len(result.alternatives) == 3
    assert all("through (100, 50, 20)" in alternative.symmetry for alternative in result.alternatives)

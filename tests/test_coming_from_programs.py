"""Each row of the page for those who come from other programs: commands run, calls are compared where both exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg._open3d import load_open3d
from dqreg.files.write import write_cloud
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import bracket
from tests.report.browser import CHROMIUM

PAGE = Path(__file__).parents[1] / "docs" / "coming_from_programs.md"
ROW = re.compile(r"^\| (.+) \| `(.+)` \|$", re.M)
T_TRUE = pose.exp([0.05, -0.03, 0.04, 1.0, -2.0, 0.5])
# Points on a part of size 156 mm: one in 3 mm.
COUNT = 4000
DISTANCE = 8.0


def rows() -> list[tuple[str, str, str]]:
    sections = [(part.splitlines()[0], part) for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:]]
    found = [(name, there.strip("`"), here) for name, part in sections for there, here in ROW.findall(part)]
    return [(name, there, here) for name, there, here in found if there != "there"]


CALLS = [row for row in rows() if not row[2].startswith("dqreg ")]
# Reports and worker processes have tests of their own; here they cost more than all others together.
SLOW = re.compile(r" --report | batch ")
COMMANDS = [
    pytest.param(text, marks=[pytest.mark.soak] if SLOW.search(text) else [])
    for text in sorted({row[2] for row in rows() if row[2].startswith("dqreg ")})
]


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    o3d, part, rng = load_open3d(), dqreg.Mesh(*bracket()), np.random.default_rng(3)
    source, target = (sample_mesh(part, COUNT, rng) for _ in range(2))
    moved = pose.apply(pose.inverse(T_TRUE), source.points)
    clouds = []
    for points, normals in (
        (moved, pose.rotate(pose.inverse(T_TRUE), source.normals)),
        (target.points, target.normals),
    ):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.normals = o3d.utility.Vector3dVector(normals)
        clouds.append(cloud)
    guess = T_TRUE @ pose.exp([0.02, 0.0, 0.01, 0.5, 0.0, 0.0])
    return {
        "np": np, "dqreg": dqreg, "o3d": o3d, "reg": o3d.pipelines.registration, "a": clouds[0], "b": clouds[1],
        "source": moved, "target": target.points, "part": part, "guess": guess, "d": DISTANCE,
    }  # fmt: skip


def evaluated(text: str, names: dict[str, Any]) -> Any:
    if "small_gicp" in text:
        names = {**names, "small_gicp": pytest.importorskip("small_gicp")}
    if "kiss" in text or "odometry." in text:
        pytest.importorskip("kiss_icp")
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        config = KISSConfig()
        config.mapping.voxel_size = DISTANCE
        config.data.deskew = False
        names = {**names, "kiss": KissICP(config), "odometry": dqreg.Odometry()}
        for each in ("kiss.register_frame(source, np.zeros(0))", "odometry.register_frame(source)"):
            eval(each, names)
    return eval(text, names)


@pytest.mark.parametrize(("section", "there", "here"), CALLS, ids=lambda text: text[:40])
def test_both_calls_of_a_row_agree(section: str, there: str, here: str, names: dict[str, Any]) -> None:
    ours = evaluated(here, names)
    if section == "CloudCompare":
        np.testing.assert_allclose(ours, names["guess"], atol=1e-9)  # the pairs were made with it
        return
    theirs = evaluated(there, names)
    if isinstance(ours, dqreg.Registration):
        assert ours.verdict.level == "accepted"
        return
    if np.shape(theirs) == (4, 4):
        # Points 3 mm apart, each side with steps and weights of its own: a tenth of that, at any corner of the part.
        corners = pose.apply(pose.inverse(T_TRUE), names["part"].vertices)
        if section == "KISS-ICP":
            corners = np.zeros((1, 3))
        assert pose.offset_between(ours, theirs, corners).max() < 0.3
    else:
        np.testing.assert_allclose(ours, theirs, rtol=1e-9)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, names: dict[str, Any]) -> Path:
    path = tmp_path_factory.mktemp("programs")
    points = pose.apply(T_TRUE, names["source"])  # near where it belongs
    write_cloud(path / "scan.ply", points)
    write_cloud(path / "cad.ply", names["target"])
    part = names["part"]
    mesh = names["o3d"].geometry.TriangleMesh(
        names["o3d"].utility.Vector3dVector(part.vertices),
        names["o3d"].utility.Vector3iVector(part.faces.astype(np.int32)),
    )
    mesh.compute_triangle_normals()
    names["o3d"].io.write_triangle_mesh(str(path / "part.stl"), mesh)
    np.savetxt(path / "pose.txt", pose.exp([0.0, 0.0, 0.01, 0.0, 0.0, 0.2]))  # off in the motions left free
    (path / "parts.csv").write_text("scan,target,start\nscan.ply,part.stl,pose.txt\n", encoding="utf-8")
    (path / "scans").mkdir()
    walls = np.random.default_rng(0).uniform(-4, 4, (4000, 3))
    at = np.arange(4000)
    walls[at, at % 3] = 4.0 * np.sign(walls[at, at % 3])
    for step in range(3):
        np.save(path / "scans" / f"{step}.npy", walls - [0.1 * step, 0.0, 0.0])
        write_cloud(path / "scans" / f"{step}.ply", walls - [0.1 * step, 0.0, 0.0])
        (path / "scans" / f"{step}.npy").unlink()
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_a_row_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dqreg.cli.main import main

    if " odometry " in command:
        pytest.importorskip("kiss_icp")
    if command.endswith(".pdf") and CHROMIUM is None:
        pytest.skip("no Chromium to print with")
    monkeypatch.chdir(folder)
    words = shlex.split(command)[1:]
    if words[0] == "register":
        words += ["--effort", "fast"]
    with pytest.raises(SystemExit) as stop:
        main([*words, "--quiet"] if words[0] != "faces" else words)
    # 0: trusted; 3: trusted, and the part is outside of a tolerance or undecided.
    assert stop.value.code in (0, 3)
    for name in re.findall(r"--(?:out|aligned|deviations|report) (\S+)", command):
        assert (folder / name).exists()


UNMOVED = sorted({here for _, there, here in rows() if "-C2M_DIST" in there or "colour map" in there})


@pytest.mark.parametrize("command", UNMOVED)
def test_distances_to_a_part_are_those_of_the_scan_as_it_lies(
    command: str, folder: Path, names: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    trimesh = pytest.importorskip("trimesh")
    from dqreg.cli.main import main

    monkeypatch.chdir(folder)
    shifted = pose.apply(T_TRUE, names["source"]) + np.array([0.8, -0.5, 0.3])
    write_cloud(folder / "shifted.ply", shifted)
    words = shlex.split(re.sub(r" --(report|deviations) \S+", "", command).replace(" scan.ply ", " shifted.ply "))[1:]
    with pytest.raises(SystemExit) as stop:
        main([*words, "--quiet", "--effort", "fast", "--deviations", "shifted.npy"])
    # It lies a shift off the part, and the verdict says so.
    assert stop.value.code == 1
    ours = np.load(folder / "shifted.npy")
    _, theirs, _ = trimesh.proximity.closest_point(trimesh.load(folder / "part.stl"), shifted)
    # Points and part are float32 in their files: 156 mm in steps of 1e-5. A shift leaves faces by up to its length.
    np.testing.assert_allclose(np.abs(ours), theirs, atol=5e-5)
    assert 0.8 < theirs.max() < 1.0


def test_every_program_has_its_rows() -> None:
    assert len(UNMOVED) == 3
    counts = {name: sum(section == name for section, _, _ in rows()) for name, _, _ in rows()}
    least = {"Open3D": 6, "small_gicp": 3, "KISS-ICP": 3, "CloudCompare": 6, "PolyWorks|Inspector": 7}
    assert counts.keys() == least.keys()
    assert all(counts[name] >= number for name, number in least.items())

"""Recipes of many scans: what they make, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.main import main
from dqreg.errors import InputError
from dqreg.files import read_cloud, read_mesh
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.multiway.pairwise.starts import read_result_poses
from dqreg.odometry.trajectory import read_trajectory
from dqreg.rigid import pose
from dqreg.synth.many_cases import is_of_many, many_contents, write_many
from dqreg.synth.street import street

HERE = Path(__file__).parents[2] / "datasets_synth"
RECIPES = sorted((HERE / "many").glob("*.toml"))
TURNTABLE = 'seed = 1\n[part]\nkind = "box"\n[turntable]\nviews = 3\npixels = 12\nnoise = 0.0\n'


def test_every_recipe_of_many_scans_is_one() -> None:
    assert len(RECIPES) >= 3
    assert all(is_of_many(path) for path in RECIPES)
    assert not any(is_of_many(path) for path in (HERE / "recipes").glob("*.toml"))


def test_the_scans_of_a_turntable_lie_on_the_part_at_the_true_poses(tmp_path: Path) -> None:
    (tmp_path / "recipe.toml").write_text(TURNTABLE)
    folder = write_many(tmp_path / "case", tmp_path / "recipe.toml")
    truth = json.loads((folder / "truth.json").read_text())
    mesh = read_mesh(folder / "part.stl")
    surface = MeshSurface(Mesh(mesh.vertices, mesh.faces))
    poses = read_result_poses(folder / "truth.json")
    for name, T in zip(truth["scans"], poses, strict=True):
        points = read_cloud(folder / name).points
        # Without noise they are on it, but for the rounding of float32.
        assert surface.closest(pose.apply(T, points)).distances.max() < 1e-5 * np.abs(points).max()


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    first, again, other = (many_contents(TURNTABLE, Path(), seed) for seed in (5, 5, 6))
    assert first == again
    assert first["scans/view00.ply"] != other["scans/view00.ply"]


def test_the_command_makes_a_room(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "hall.toml").write_text("seed = 2\n[room]\nstops = 2\nrings = 6\n")
    with pytest.raises(SystemExit) as stop:
        main(["synth", str(tmp_path / "hall.toml"), "--out", str(tmp_path / "hall"), "--json"])
    assert stop.value.code == 0
    truth = json.loads(capsys.readouterr().out)["truth"]
    assert np.array(truth["T_world_scan"]).shape == (2, 4, 4)
    assert truth["viewpoints"] == [[0.0, 0.0, 0.0]] * 2
    assert not (tmp_path / "hall" / "part.stl").exists()


def test_the_frames_of_a_street_lie_on_it_at_the_poses_of_both_files(tmp_path: Path) -> None:
    (tmp_path / "street.toml").write_text("seed = 3\n[street]\nframes = 3\nrings = 8\nnoise = 0.0\n")
    folder = write_many(tmp_path / "street", tmp_path / "street.toml")
    truth = np.array(json.loads((folder / "truth.json").read_text())["T_world_scan"])
    poses, _ = read_trajectory(folder / "poses.txt")
    # The reader makes rotations of what it reads.
    np.testing.assert_allclose(poses, truth, atol=1e-14)
    # The same seed draws the same street; float32 rounds places up to 100 m away to 4e-6.
    surface = MeshSurface(Mesh(*street(np.random.default_rng(3))))
    for k, T in enumerate(truth):
        points = read_cloud(folder / "scans" / f"view{k:02d}.ply").points
        assert len(points) > 5_000
        assert surface.closest(pose.apply(T, points)).distances.max() < 2e-5


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("seed = 1\n", "turntable"),
        (TURNTABLE + "[room]\n", "turntable"),
        ("seed = 1\n[street]\n[room]\n", "street"),
        ('seed = 1\n[street]\n[part]\nkind = "box"\n', "part"),
        ("seed = 1\n[street]\nframes = 400\nstep = 2.0\n", "way along"),
        ("seed = 1\n[turntable]\n", "part.kind"),
        ('seed = 1\n[room]\n[part]\nkind = "box"\n', "part"),
        (TURNTABLE.replace("views = 3", "views = 1"), "turntable.views"),
        (TURNTABLE.replace("pixels = 12", "pixels = 1.5"), "turntable.pixels"),
        (TURNTABLE.replace("noise = 0.0", "noice = 0.0"), "noise"),
        (TURNTABLE.replace("seed = 1", "seed = -1"), "seed"),
        ("seed = = 1", "TOML"),
    ],
)
def test_a_wrong_recipe_is_named(text: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        many_contents(text, Path())


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "recipe.toml").write_text(TURNTABLE)
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "mine.txt").write_text("")
    with pytest.raises(InputError, match=r"mine\.txt"):
        write_many(tmp_path / "case", tmp_path / "recipe.toml")

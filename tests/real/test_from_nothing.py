"""Real data with no start given: CAD parts from random poses, a part on a table, and scans that overlap in part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.geometry.opening import as_geometry
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement

pytestmark = pytest.mark.real


# Truth: the drawn pose itself. One part of each kind: solid, plate with pockets, plate with holes that is nearly
# its own mirror image. 1e-3 is far below the distance to any other pose that nearly fits.
@pytest.mark.parametrize(
    "name",
    ["featuretype.STL", *(pytest.param(name, marks=pytest.mark.soak) for name in ("counterXP.3MF", "plate_holes.STL"))],
)
def test_two_views_from_a_random_pose(real_data: Path, name: str) -> None:
    part = as_geometry(real_data / "trimesh_cad" / name, "part")
    assert isinstance(part, dqreg.Mesh)
    rng = np.random.default_rng(1)
    views = [tuple(v) for v in rng.normal(size=(2, 3))]
    noise = Noise(range_sigma=3e-4 * part.diagonal)
    scan = scan_mesh(part.vertices, part.faces, Scanner(views, pixels=200), noise, rng=rng)
    truth = random_pose(rng, part.diagonal, part.centre)
    result = dqreg.register(pose.apply(pose.inverse(truth), scan.points), part, effort="fast")
    assert worst_vertex_displacement(result.T_target_source, truth, part.vertices) < 1e-3 * part.diagonal


def test_a_welded_part_is_found_on_its_table(real_data: Path) -> None:
    # The scan is cropped to a box of 0.5 m around the part, most of which is table. The reference is the data set's
    # own robust fit, no truth: 2 mm and 0.5 degrees are what it may be off.
    folder, name = real_data / "weld_tee_scan_cad", "table_8in10in_tee_x4y24_45"
    scan, part = as_geometry(folder / f"{name}.pcd", "scan").points, as_geometry(folder / "tee_nominal.stl", "part")
    inside = ((scan > (0.0, -0.9, -0.01)) & (scan < (0.5, -0.4, 0.23))).all(axis=1)
    reference = pose.inverse(np.loadtxt(folder / f"T_scan_part_fit_{name}.txt"))
    result = dqreg.register(scan[inside], part)
    at = pose.apply(pose.inverse(reference), part.centre)
    assert pose.offset_between(result.T_target_source, reference, at=at) < 2e-3
    assert pose.angle_between(result.T_target_source, reference) < np.deg2rad(0.5)


# Truth: the poses of the Stanford repository, good to some tenths of a millimetre on a bunny of 250 mm; and for the
# 30 % overlap the reference fit of simpleICP's data. Bounds in sizes of the source: 0.5 % is 1.2 mm.
@pytest.mark.parametrize(
    ("folder", "source", "target"),
    [("stanford_bunny_range", "top2", "top3"), ("simpleicp", "bunny_part2", "bunny_part1")],
    ids=["top2 to top3", "30 % overlap"],
)
def test_scans_that_overlap_in_part(real_data: Path, folder: str, source: str, target: str) -> None:
    at = real_data / folder
    sides = [as_geometry(at / f"{name}.ply", name).points for name in (source, target)]
    if folder == "simpleicp":
        truth = np.loadtxt(at / "T_part1_part2_reference_icp.txt")
    else:
        poses = [np.loadtxt(at / f"T_world_{name}.txt") for name in (source, target)]
        truth = pose.inverse(poses[1]) @ poses[0]
    result = dqreg.register(sides[0], dqreg.PointCloud(sides[1]))
    off = np.linalg.norm(pose.apply(result.T_target_source, sides[0]) - pose.apply(truth, sides[0]), axis=1)
    assert np.sqrt(np.mean(off**2)) < 5e-3 * np.linalg.norm(np.ptp(sides[0], axis=0))

"""Every measured pair from its reference, from flipped and shifted starts, from nothing, and with another target.

References are those of the data sets, see their notes: no truths. A pose is right within the tolerance of its pair.
The table of all verdicts is printed: ``pytest -m soak -s tests/real/test_wrong_starts.py``.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.geometry.opening import as_geometry
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose

pytestmark = [pytest.mark.real, pytest.mark.soak]

WELD = "weld_tee_scan_cad/table_8in10in_tee_x4y24_45.pcd"
BUNNY = "stanford_bunny_range"
KITCHEN = "redkitchen_fragments"


@dataclasses.dataclass(frozen=True)
class Pair:
    """A source, a target, a pose that is right, and within how many degrees and shares of the size."""

    source: str
    target: str
    reference: Callable[[Path], np.ndarray]
    degrees: float = 2.0
    share: float = 0.02


def stored(name: str, *, inverted: bool = False) -> Callable[[Path], np.ndarray]:
    """A pose as the data set stores it."""

    def read(folder: Path) -> np.ndarray:
        T = np.loadtxt(folder / name)
        return pose.inverse(T) if inverted else T

    return read


def between(target: str, source: str) -> Callable[[Path], np.ndarray]:
    """From the poses of two scans in one frame."""
    return lambda folder: pose.inverse(np.loadtxt(folder / target)) @ np.loadtxt(folder / source)


def bunny(target: str, source: str) -> Pair:
    """Two range scans of the bunny."""
    files = [f"{BUNNY}/{name}.ply" for name in (source, target)]
    return Pair(*files, between(f"{BUNNY}/T_world_{target}.txt", f"{BUNNY}/T_world_{source}.txt"))


PAIRS = {
    "weld tee on its CAD": Pair(
        WELD,
        "weld_tee_scan_cad/tee_nominal.stl",
        stored("weld_tee_scan_cad/T_scan_part_fit_table_8in10in_tee_x4y24_45.txt", inverted=True),
    ),
    "street, LiDAR": Pair(
        "small_gicp_kitti_pair/source.ply",
        "small_gicp_kitti_pair/target.ply",
        stored("small_gicp_kitti_pair/T_target_source.txt"),
    ),
    "car park, LiDAR": Pair(
        "libpointmatcher_car/car_cloud401.csv",
        "libpointmatcher_car/car_cloud400.csv",
        stored("libpointmatcher_car/T_400_401_utest_validT3d.txt"),
        degrees=3.0,
    ),
    "bunny 45 on 0": bunny("bun000", "bun045"),
    "bunny 90 on 45": bunny("bun045", "bun090"),
    "bunny 315 on 0": bunny("bun000", "bun315"),
    "dragon": Pair(
        "simpleicp/dragon2.ply", "simpleicp/dragon1.ply", stored("simpleicp/T_dragon1_dragon2_reference_icp.txt")
    ),
    "half a bunny": Pair(
        "simpleicp/bunny_part2.ply",
        "simpleicp/bunny_part1.ply",
        stored("simpleicp/T_part1_part2_reference_icp.txt"),
    ),
    "bunny on its model": Pair(
        "goicp_bunny/data_bunny.ply", "goicp_bunny/model_bunny.ply", stored("goicp_bunny/T_model_data_refined.txt")
    ),
    # Its two stored poses differ by 6.6 degrees, and the pose that the scans agree on by 6.9.
    "small bunny": Pair(
        "pcl_bunny/bun0.pcd", "pcl_bunny/bun4.pcd", stored("pcl_bunny/T_bun4_bun0_pcl_icp_test.txt"), 8.0, 0.05
    ),
    "milk in its scene": Pair(
        "pcl_milk_scene/milk.pcd",
        "pcl_milk_scene/milk_cartoon_all_small_clorox.pcd",
        stored("pcl_milk_scene/T_scene_milk.txt"),
    ),
    "kitchen 1 on 0": Pair(
        f"{KITCHEN}/cloud_bin_1.ply", f"{KITCHEN}/cloud_bin_0.ply", stored(f"{KITCHEN}/T_0_1.txt"), 3.0, 0.03
    ),
    "kitchen 4 on 0": Pair(
        f"{KITCHEN}/cloud_bin_4.ply", f"{KITCHEN}/cloud_bin_0.ply", stored(f"{KITCHEN}/T_0_4.txt"), 3.0, 0.03
    ),
    "kitchen 4 on 1": Pair(
        f"{KITCHEN}/cloud_bin_4.ply", f"{KITCHEN}/cloud_bin_1.ply", stored(f"{KITCHEN}/T_1_4.txt"), 3.0, 0.03
    ),
}
# Scans of each are laid on the target of the next: there is no right pose.
OTHERS = ["bunny 45 on 0", "dragon", "weld tee on its CAD", "kitchen 1 on 0", "car park, LiDAR", "milk in its scene"]


def starts_of(reference: np.ndarray, centre: np.ndarray, size: float) -> dict[str, np.ndarray | None]:
    """The reference; half-turns about two axes through the middle of the scan; shifts; nothing."""
    turns = {
        name: pose.about(pose.from_parts(np.diag(signs), np.zeros(3)), centre) @ reference
        for name, signs in (("half-turn about z", [-1.0, -1.0, 1.0]), ("half-turn about x", [1.0, -1.0, -1.0]))
    }
    shift = {
        f"shifted along {name}": pose.from_parts(np.eye(3), 0.3 * size * axis) @ reference
        for name, axis in zip("xy", np.eye(3), strict=False)
    }
    return {"reference": reference, **turns, **shift, "nothing": None}


def told(name: str, start: str, result: Registration, is_right: bool | None) -> None:
    """One row of the table."""
    words = {True: "right", False: "wrong", None: "none is right"}[is_right]
    codes = ", ".join(result.verdict.codes)
    sys.stdout.write(f"| {name} | {start} | {words} | {result.verdict.level} | {codes} |\n")
    sys.stdout.flush()


@pytest.mark.parametrize("name", PAIRS)
def test_nothing_wrong_is_accepted_whatever_the_start(real_data: Path, name: str) -> None:
    pair = PAIRS[name]
    source, target = as_geometry(real_data / pair.source, "source"), as_geometry(real_data / pair.target, "target")
    reference, size = pair.reference(real_data), float(np.linalg.norm(np.ptp(corners(target), axis=0)))
    centre = pose.apply(reference, source.points.mean(axis=0))
    verdicts = {}
    for start, T in starts_of(reference, centre, size).items():
        result = dqreg.register(source, target, T, effort="fast")
        found = result.T_target_source
        is_right = bool(
            np.isfinite(found).all()
            and pose.angle_between(found, reference) <= np.deg2rad(pair.degrees)
            and pose.offset_between(found, reference, at=source.points.mean(axis=0)) <= pair.share * size
        )
        told(name, start, result, is_right)
        verdicts[start] = is_right, result.verdict.level
    assert verdicts["reference"][0]
    assert [start for start, (is_right, level) in verdicts.items() if level == "accepted" and not is_right] == []


@pytest.mark.parametrize("index", range(len(OTHERS)))
def test_a_scan_of_something_else_is_not_accepted(real_data: Path, index: int) -> None:
    one, other = OTHERS[index], OTHERS[(index + 1) % len(OTHERS)]
    source = as_geometry(real_data / PAIRS[one].source, "source")
    target = as_geometry(real_data / PAIRS[other].target, "target")
    places = corners(target)
    scale = np.linalg.norm(np.ptp(places, axis=0)) / np.linalg.norm(np.ptp(source.points, axis=0))
    # Of one size, their middles on each other.
    points = (source.points - source.points.mean(axis=0)) * scale + places.mean(axis=0)
    for start in ("identity", None):
        result = dqreg.register(points, target, start, effort="fast")
        told(f"{one}, target of {other}", str(start or "nothing"), result, None)
        assert result.verdict.level != "accepted"


def corners(target: dqreg.Mesh | dqreg.PointCloud) -> np.ndarray:
    """Points that span the target."""
    return target.vertices if isinstance(target, dqreg.Mesh) else target.points

"""Real scans whose pose is known, for `from_nothing.py --real DATA`: which folders, which truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import dqreg
from dqreg.geometry.opening import as_geometry
from dqreg.rigid import pose

# Box that holds the part and little of the table, in metres, from the scene's own settings.
WELD_BOX = (0.0, -0.9, -0.01), (0.5, -0.4, 0.23)
BUNNY = ("bun000", "bun045", "bun090", "bun180", "bun270", "bun315", "chin", "ear_back", "top2", "top3")
# Scans of far-apart views that still share a part of the surface, and, last, three that share next to none (1 to 8 %).
FAR = (
    ("top3", "bun000"),
    ("top2", "top3"),
    ("chin", "bun000"),
    ("bun090", "bun000"),
    ("bun180", "bun090"),
    ("chin", "bun315"),
    ("ear_back", "bun180"),
    ("top2", "bun000"),
    ("ear_back", "bun000"),
    ("bun180", "bun000"),
)
KITCHEN = ((0, 1), (0, 4), (1, 4))


@dataclasses.dataclass(frozen=True)
class Pair:
    """A source, a target and the pose that is known of them; ``judged`` are the source points that shall be right."""

    name: str
    source: np.ndarray
    target: dqreg.PointCloud | dqreg.Mesh
    T_truth: np.ndarray
    judged: np.ndarray
    size: float


def real_pairs(data: Path) -> Iterator[Pair]:
    """All pairs of the list whose folder exists."""
    makers = {
        "weld_tee_scan_cad": _weld,
        "stanford_bunny_range": _bunny,
        "goicp_bunny": _goicp,
        "simpleicp": _simpleicp,
        "redkitchen_fragments": _kitchen,
        "pcl_milk_scene": _milk,
        "libpointmatcher_car": _car,
        "small_gicp_kitti_pair": _street,
    }
    for folder, make in makers.items():
        if (data / folder).is_dir():
            yield from make(data / folder)


def _weld(folder: Path) -> Iterator[Pair]:
    scan = _points(folder / "table_8in10in_tee_x4y24_45.pcd")
    part = as_geometry(folder / "tee_nominal.stl", "part")
    T = pose.inverse(_pose(folder / "T_scan_part_fit_table_8in10in_tee_x4y24_45.txt"))
    low, high = np.array(WELD_BOX)
    inside = ((scan > low) & (scan < high)).all(axis=1)
    corners = pose.apply(pose.inverse(T), part.vertices)
    yield _pair("weld tee, cropped", scan[inside], part, T, corners)
    yield _pair("weld tee, uncropped", scan, part, T, corners)


def _bunny(folder: Path) -> Iterator[Pair]:
    scans = {name: _points(folder / f"{name}.ply") for name in BUNNY}
    poses = {name: _pose(folder / f"T_world_{name}.txt") for name in BUNNY}
    merged = as_geometry(folder / "bun_zipper.ply", "mesh")
    for name in BUNNY:
        yield _pair(f"bunny {name} to mesh", scans[name], merged, poses[name])
    for source, target in FAR:
        T = pose.inverse(poses[target]) @ poses[source]
        yield _pair(f"bunny {source} to {target}", scans[source], dqreg.PointCloud(scans[target]), T)


def _goicp(folder: Path) -> Iterator[Pair]:
    source, target = (_points(folder / f"{side}_bunny.ply") for side in ("data", "model"))
    yield _pair("Go-ICP bunny", source, dqreg.PointCloud(target), _pose(folder / "T_model_data_refined.txt"))


def _simpleicp(folder: Path) -> Iterator[Pair]:
    names = (
        ("dragon", "dragon2", "dragon1", "T_dragon1_dragon2"),
        ("bunny, 30 % overlap", "bunny_part2", "bunny_part1", "T_part1_part2"),
    )
    for name, source, target, truth in names:
        sides = (_points(folder / f"{side}.ply") for side in (source, target))
        found, stands = sides
        yield _pair(f"simpleICP {name}", found, dqreg.PointCloud(stands), _pose(folder / f"{truth}_reference_icp.txt"))


def _kitchen(folder: Path) -> Iterator[Pair]:
    for i, j in KITCHEN:
        target = dqreg.PointCloud(_points(folder / f"cloud_bin_{i}.ply"))
        source = _points(folder / f"cloud_bin_{j}.ply")
        yield _pair(f"kitchen {j} to {i}", source, target, _pose(folder / f"T_{i}_{j}.txt"))


def _milk(folder: Path) -> Iterator[Pair]:
    milk, scene = (_points(folder / name) for name in ("milk.pcd", "milk_cartoon_all_small_clorox.pcd"))
    # The carton is cut from this scene, so it is moved to a drawn pose first.
    T = pose.random(np.random.default_rng(3), reach=1.0)
    moved = pose.apply(pose.inverse(T), milk)
    yield _pair("milk carton to scene", moved, dqreg.PointCloud(scene), T)
    turned = pose.apply(pose.inverse(T), scene)
    yield _pair("scene to milk carton", turned, dqreg.PointCloud(milk), T, moved)


def _car(folder: Path) -> Iterator[Pair]:
    target = as_geometry(folder / "car_cloud400.csv", "target")
    T = _pose(folder / "T_400_401_utest_validT3d.txt")
    yield _pair("LiDAR on a car", _points(folder / "car_cloud401.csv"), dqreg.PointCloud(target.points), T)


def _street(folder: Path) -> Iterator[Pair]:
    source, target = (_points(folder / f"{side}.ply") for side in ("source", "target"))
    yield _pair("LiDAR, street", source, dqreg.PointCloud(target), _pose(folder / "T_target_source.txt"))


def _pair(
    name: str,
    source: np.ndarray,
    target: dqreg.PointCloud | dqreg.Mesh,
    T_truth: np.ndarray,
    judged: np.ndarray | None = None,
) -> Pair:
    judged = source if judged is None else judged
    stands = target.vertices if isinstance(target, dqreg.Mesh) else target.points
    return Pair(name, source, target, T_truth, judged, min(_diagonal(judged), _diagonal(stands)))


def _diagonal(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _points(path: Path) -> np.ndarray:
    return as_geometry(path, path.name).points


def _pose(path: Path) -> np.ndarray:
    rows = np.loadtxt(path)
    return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]]) if rows.shape == (3, 4) else rows

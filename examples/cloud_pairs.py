"""Measured pairs of clouds, LiDAR and RGB-D, from raw points to pose: dqreg beside small_gicp and Open3D.

    python examples/cloud_pairs.py DATA [--sets street part kitti car kitchen rgbd]

DATA holds the folders that the sets name; simulated streets under a LiDAR and scans of a part, with exact truth, need
none. Every engine
begins at the identity. Each cell is the error against the pose that comes with the data, as a turn in degrees and as
the root mean square displacement of the scan in mm, and the CPU seconds of the whole call, on all threads: trees,
normals and thinning are counted, reading files is not. The smallest displacement of a row carries a star. References
are good to about 2 cm (car), and to what the tracking of a Kinect gives (kitchen, RGB-D): differences below that say
nothing. That of the road is the answer of small_gicp's GICP with voxels of 0.1 m, to its last digit: what is measured
there is the distance from that.

The peers thin as their manuals do for such data, 0.25 m for LiDAR and 0.02 m for RGB-D, of the part hardly, by the
distance between its points, and look for pairs up to 20 of these voxels away, which is kinder to them here than their
default of 4.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import dqreg
from dqreg._open3d import load_open3d
from dqreg.geometry.opening import as_geometry
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh
from dqreg.synth.many_views import street_drive
from dqreg.synth.parts import bracket

# Voxels of the peers, m.
LIDAR, RGBD, PART = 0.25, 0.02, 4e-4
REACH = 20
ITERATIONS = 100
# Farther off than this the pair is lost, whatever its last digits: degrees, and mm for LiDAR, RGB-D or the part.
LOST_DEG, LOST = 5.0, {LIDAR: 500.0, RGBD: 100.0, PART: 1.0}

# Simulated streets and parts on which nothing was tuned.
STREETS, PARTS = range(100, 108), range(100, 106)
# Size of the part, m; noise of its scanner, and how far its places differ from one scan to the next, in that size.
SIZE, NOISE, ELSEWHERE = 0.1, 1e-4, 0.2

Pair = tuple[str, np.ndarray, np.ndarray, np.ndarray, float]


def street(_: Path) -> Iterator[Pair]:
    """Two frames of a car's LiDAR, 0.8 m apart, in simulated streets."""
    for seed in STREETS:
        made = street_drive(2, rng=np.random.default_rng(seed))
        target, source = made.scans
        yield f"street {seed}", source, target, pose.inverse(made.T_world_scan[0]) @ made.T_world_scan[1], LIDAR


def part(_: Path) -> Iterator[Pair]:
    """Two clean scans of the bracket, 45,000 points each, from two places and from two others."""
    vertices, faces = bracket()
    corners = np.asarray(vertices)
    corners = (corners - corners.mean(axis=0)) * (SIZE / np.linalg.norm(np.ptp(corners, axis=0)))
    places, noise = SIZE * np.array([[1.5, 1.5, 1.5], [-1.5, 0.45, -1.2]]), Noise(range_sigma=NOISE * SIZE)
    for seed in PARTS:
        rng = np.random.default_rng(seed)
        target, source = (
            scan_mesh(corners, faces, Scanner([tuple(p) for p in stands], pixels=250), noise, rng=rng).points
            for stands in places + rng.normal(scale=ELSEWHERE * SIZE, size=(2, 2, 3))
        )
        T_source = disturbance(rng, np.deg2rad(2.0), 0.01 * SIZE, np.zeros(3))
        yield f"part {seed}", pose.apply(T_source, source), target, pose.inverse(T_source), PART


def kitti(data: Path) -> Iterator[Pair]:
    """Two sweeps of a spinning LiDAR on a road."""
    folder = data / "small_gicp_kitti_pair"
    yield "LiDAR, road", points(folder / "source.ply"), points(folder / "target.ply"), T(folder, "target_source"), LIDAR


def car(data: Path) -> Iterator[Pair]:
    """Two sweeps of a LiDAR in a yard, 15 degrees apart."""
    folder = data / "libpointmatcher_car"
    clouds = (points(folder / f"car_cloud{number}.csv") for number in (401, 400))
    yield "LiDAR, yard", *clouds, T(folder, "400_401_utest_validT3d"), LIDAR


def kitchen(data: Path) -> Iterator[Pair]:
    """Fused fragments of a kitchen; of the last two pairs less than half overlaps."""
    folder = data / "redkitchen_fragments"
    for i, j in ((0, 1), (0, 4), (1, 4)):
        clouds = (points(folder / f"cloud_bin_{number}.ply") for number in (j, i))
        yield f"kitchen {j} to {i}", *clouds, T(folder, f"{i}_{j}"), RGBD


def rgbd(data: Path) -> Iterator[Pair]:
    """Neighbouring depth images, half a second apart."""
    folder = data / "sevenscenes_rgbd"
    camera = np.loadtxt(folder / "camera-intrinsics.txt")
    before = None
    for file in sorted(folder.glob("*.depth.png")):
        image = np.asarray(load_open3d().io.read_image(str(file)))
        cloud = dqreg.PointCloud.from_depth(image, camera, normals=False).points
        T_world = np.loadtxt(file.with_name(file.name.replace("depth.png", "pose.txt")))
        if before is not None:
            yield f"RGB-D {file.name[6:12].lstrip('0')}", cloud, before[0], pose.inverse(before[1]) @ T_world, RGBD
        before = cloud, T_world


SETS: dict[str, Callable[[Path], Iterator[Pair]]] = {
    "street": street,
    "part": part,
    "kitti": kitti,
    "car": car,
    "kitchen": kitchen,
    "rgbd": rgbd,
}


def points(path: Path) -> np.ndarray:
    """Points of a file, (n, 3)."""
    return as_geometry(path, path.name).points


def T(folder: Path, name: str) -> np.ndarray:
    """Pose of a file, (4, 4)."""
    rows = np.loadtxt(folder / f"T_{name}.txt")
    return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])[:4]


def by_dqreg(source: np.ndarray, target: np.ndarray, voxel: float, method: str = "auto") -> np.ndarray:
    """Ours, with no length given."""
    return dqreg.register(source, target, "identity", method=method).T_target_source


def by_small_gicp(source: np.ndarray, target: np.ndarray, voxel: float) -> np.ndarray:
    """small_gicp's GICP, two threads."""
    import small_gicp

    fixed, tree = small_gicp.preprocess_points(target, downsampling_resolution=voxel, num_threads=2)
    moving, _ = small_gicp.preprocess_points(source, downsampling_resolution=voxel, num_threads=2)
    options = {"num_threads": 2, "max_correspondence_distance": REACH * voxel, "max_iterations": ITERATIONS}
    return small_gicp.align(fixed, moving, tree, registration_type="GICP", **options).T_target_source


def by_open3d(source: np.ndarray, target: np.ndarray, voxel: float, *, generalised: bool) -> np.ndarray:
    """Open3D's point-to-plane or generalised ICP."""
    open3d = load_open3d()
    registration = open3d.pipelines.registration
    clouds = []
    for cloud in (source, target):
        thin = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud)).voxel_down_sample(voxel)
        thin.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(16))
        clouds.append(thin)
    criteria = registration.ICPConvergenceCriteria(1e-6, 1e-6, ITERATIONS)
    if generalised:
        run, step = registration.registration_generalized_icp, registration.TransformationEstimationForGeneralizedICP()
    else:
        run, step = registration.registration_icp, registration.TransformationEstimationPointToPlane()
    return run(*clouds, REACH * voxel, np.eye(4), step, criteria).transformation


ENGINES: dict[str, Callable[[np.ndarray, np.ndarray, float], np.ndarray]] = {
    "dqreg": by_dqreg,
    "small_gicp GICP": by_small_gicp,
    "Open3D plane": lambda *pair: by_open3d(*pair, generalised=False),
    "Open3D GICP": lambda *pair: by_open3d(*pair, generalised=True),
}


def measured(pair: Pair, engine: Callable[[np.ndarray, np.ndarray, float], np.ndarray]) -> tuple[float, float, float]:
    """Turn [deg] and displacement [mm] off the truth, and CPU seconds."""
    _, source, target, T_truth, voxel = pair
    began = time.process_time()
    found = engine(source, target, voxel)
    seconds = time.process_time() - began
    some = source[:: max(len(source) // 20_000, 1)]
    off = pose.apply(found, some) - pose.apply(T_truth, some)
    return np.rad2deg(pose.angle_between(found, T_truth)), 1e3 * np.sqrt((off**2).sum(axis=1).mean()), seconds


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, nargs="?", default=Path())
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    arguments = parser.parse_args()
    missing = ["small_gicp GICP"] if not _importable("small_gicp") else []
    engines = {name: engine for name, engine in ENGINES.items() if name not in missing}
    print(f"{'deg / mm / CPU s':>18} " + "".join(f"{name:>26}" for name in engines), flush=True)
    # Libraries load when first used, which is none of a registration's time.
    warm = np.random.default_rng(0).uniform(size=(2_000, 3))
    for engine in engines.values():
        engine(warm, warm, 0.05)
    rows: list[list[tuple[float, float, float]]] = []
    lost = dict.fromkeys(engines, 0)
    for name in arguments.sets:
        for pair in SETS[name](arguments.data):
            row = [measured(pair, engine) for engine in engines.values()]
            best = min(mm for _, mm, _ in row)
            for engine, (deg, mm, _) in zip(engines, row, strict=True):
                lost[engine] += deg > LOST_DEG or mm > LOST[pair[-1]]
            print(f"{pair[0]:>18} " + "".join(f"{_cell(one, one[1] == best):>26}" for one in row), flush=True)
            rows.append(row)
    print(f"{'median':>18} " + "".join(f"{_cell(one):>26}" for one in np.median(rows, axis=0)))
    print(f"{'lost':>18} " + "".join(f"{count:>25} " for count in lost.values()))


def _importable(name: str) -> bool:
    from importlib.util import find_spec

    return find_spec(name) is not None


def _cell(measurement: tuple[float, float, float], best: bool = False) -> str:
    deg, mm, seconds = measurement
    return f"{deg:#.2g} / {mm:#6.3g} / {seconds:.2f}{'*' if best else ' '}"


if __name__ == "__main__":
    main()

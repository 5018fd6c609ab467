"""Other people's searches for a pose, as `from_nothing.py` runs them: FPFH with RANSAC, FGR, and KISS-Matcher.

Each gets lengths that fit the size of the part and a dense sample of the CAD with the true normals, and is refined by
Open3D's point-to-plane ICP. One that raises an error has found nothing.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np

import dqreg
from dqreg._open3d import load_open3d

# Voxel in sizes, samples of the CAD, and iterations of RANSAC.
VOXEL, CAD_SAMPLES, TRIES = 0.015, 100_000, 100_000

# From the points of a scan to T_target_source.
Method = Callable[[np.ndarray], np.ndarray]


def peers_of(target: dqreg.Mesh | dqreg.PointCloud, size: float, names: list[str]) -> dict[str, Method]:
    """The named peers, prepared for a target.

    `size` is the unit of their lengths: the diagonal of the part, or of the smaller of two clouds.
    """
    makers = {"ransac": _ransac, "fgr": _fgr, "kiss": _kiss}
    if not names:
        return {}
    return {name: makers[name](_Side.of_target(target, VOXEL * size)) for name in names}


def missing_peers(names: list[str]) -> list[str]:
    """What to install for those of the named peers that are not here."""
    return ["kiss-matcher"] if "kiss" in names and importlib.util.find_spec("kiss_matcher") is None else []


class _Side:
    """A cloud with normals, its places a voxel apart, and their histograms."""

    def __init__(self, cloud: Any, voxel: float) -> None:
        self.cloud, self.voxel = cloud, voxel

    @staticmethod
    def of_target(target: dqreg.Mesh | dqreg.PointCloud, voxel: float) -> _Side:
        open3d = load_open3d()
        if isinstance(target, dqreg.PointCloud):
            cloud = _cloud(target.points)
            cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * voxel, max_nn=30))
            return _Side(cloud, voxel)
        corners, faces = open3d.utility.Vector3dVector(target.vertices), open3d.utility.Vector3iVector(target.faces)
        open3d.utility.random.seed(0)
        part = open3d.geometry.TriangleMesh(corners, faces)
        return _Side(part.sample_points_uniformly(CAD_SAMPLES, use_triangle_normal=True), voxel)

    def described(self) -> tuple[Any, Any]:
        open3d = load_open3d()
        few = self.cloud.voxel_down_sample(self.voxel)
        few.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2.0 * self.voxel, max_nn=30))
        # The histograms depend on the signs of the normals: the peers do far better with consistent ones.
        few.orient_normals_consistent_tangent_plane(15)
        near = open3d.geometry.KDTreeSearchParamHybrid(radius=5.0 * self.voxel, max_nn=100)
        return few, open3d.pipelines.registration.compute_fpfh_feature(few, near)

    def places(self) -> np.ndarray:
        return np.asarray(self.cloud.voxel_down_sample(self.voxel).points)


def _ransac(target: _Side) -> Method:
    open3d = load_open3d()
    registration, reach = open3d.pipelines.registration, 1.5 * target.voxel
    stands, stands_features = target.described()

    def run(points: np.ndarray) -> np.ndarray:
        open3d.utility.random.seed(0)
        few, features = _Side(_cloud(points), target.voxel).described()
        found = registration.registration_ransac_based_on_feature_matching(
            few,
            stands,
            features,
            stands_features,
            True,
            reach,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                registration.CorrespondenceCheckerBasedOnDistance(reach),
            ],
            registration.RANSACConvergenceCriteria(TRIES, 0.999),
        )
        return _refined(points, target, found.transformation)

    return run


def _fgr(target: _Side) -> Method:
    registration = load_open3d().pipelines.registration
    stands, stands_features = target.described()

    def run(points: np.ndarray) -> np.ndarray:
        few, features = _Side(_cloud(points), target.voxel).described()
        option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=target.voxel)
        found = registration.registration_fgr_based_on_feature_matching(few, stands, features, stands_features, option)
        return _refined(points, target, found.transformation)

    return run


def _kiss(target: _Side) -> Method:
    import kiss_matcher

    stands = target.places() / target.voxel

    def run(points: np.ndarray) -> np.ndarray:
        # It takes no small voxels and clamps its bounds to metres; parts come in any unit, so they are scaled.
        config = kiss_matcher.KISSMatcherConfig(1.0, enable_noise_bound_clamping=False)
        few = _Side(_cloud(points), target.voxel).places() / target.voxel
        found = kiss_matcher.KISSMatcher(config).estimate(few, stands)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = found.rotation, target.voxel * np.asarray(found.translation).ravel()
        return _refined(points, target, T)

    return run


def _refined(points: np.ndarray, target: _Side, T: np.ndarray) -> np.ndarray:
    registration = load_open3d().pipelines.registration
    for reach in (2.0 * target.voxel, 0.5 * target.voxel):
        step = registration.TransformationEstimationPointToPlane()
        T = registration.registration_icp(_cloud(points), target.cloud, reach, T, step).transformation
    return np.asarray(T)


def _cloud(points: np.ndarray) -> Any:
    open3d = load_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

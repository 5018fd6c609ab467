"""Global registration by FPFH and RANSAC, refined by ICP (after Open3D's tutorial on global registration)."""

# A user's program imports Open3D itself.
# ruff: noqa: TID251
from __future__ import annotations

from typing import Any


def main(scene: Any) -> dict[str, Any]:
    import open3d
    from open3d.pipelines import registration

    open3d.utility.random.seed(0)
    voxel = scene.size / 30
    near = open3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel, max_nn=100)
    down = [cloud.voxel_down_sample(voxel) for cloud in (scene.source, scene.target)]
    features = [registration.compute_fpfh_feature(cloud, near) for cloud in down]
    coarse = registration.registration_ransac_based_on_feature_matching(
        *down, *features, True, 1.5 * voxel, registration.TransformationEstimationPointToPoint(False), 3,
        [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
         registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel)],
        registration.RANSACConvergenceCriteria(20_000, 0.999),
    )  # fmt: skip
    fine = registration.registration_icp(
        scene.source,
        scene.target,
        0.4 * voxel,
        coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
    )
    return {"refined": fine}

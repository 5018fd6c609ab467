"""Fast global registration by FPFH, refined by generalised ICP (after Open3D's example of FGR)."""

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
    option = registration.FastGlobalRegistrationOption(maximum_correspondence_distance=0.5 * voxel)
    coarse = registration.registration_fgr_based_on_feature_matching(*down, *features, option)
    fine = registration.registration_generalized_icp(scene.source, scene.target, 0.4 * voxel, coarse.transformation)
    return {"refined": fine}

"""Normal distributions transform, then colour-free refinement (after Open3D's example of NDT)."""

# A user's program imports Open3D itself.
# ruff: noqa: TID251
from __future__ import annotations

from typing import Any


def main(scene: Any) -> dict[str, Any]:
    from open3d.pipelines import registration

    option = registration.NormalDistributionsTransformOption()
    option.voxel_size = scene.size / 10
    coarse = registration.registration_ndt(scene.source, scene.target, option, scene.guess)
    fine = registration.registration_icp(
        scene.source, scene.target, scene.reach, coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(relative_fitness=1e-9, relative_rmse=1e-9, max_iteration=60),
    )  # fmt: skip
    return {"refined": fine}

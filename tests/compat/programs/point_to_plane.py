"""ICP from a rounded guess: point-to-point, then point-to-plane (after Open3D's tutorial on ICP)."""

# A user's program imports Open3D itself.
# ruff: noqa: TID251
from __future__ import annotations

from typing import Any


def main(scene: Any) -> dict[str, Any]:
    from open3d.pipelines import registration

    registration.evaluate_registration(scene.source, scene.target, scene.reach, scene.guess)
    points = registration.registration_icp(
        scene.source, scene.target, scene.reach, scene.guess, registration.TransformationEstimationPointToPoint(),
        registration.ICPConvergenceCriteria(max_iteration=200),
    )  # fmt: skip
    planes = registration.registration_icp(
        scene.source, scene.target, scene.reach, scene.guess, registration.TransformationEstimationPointToPlane()
    )
    registration.get_information_matrix_from_point_clouds(
        scene.source, scene.target, scene.reach, planes.transformation
    )
    return {"point-to-point": points, "point-to-plane": planes}

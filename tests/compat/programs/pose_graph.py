"""Three clouds into one frame by a pose graph (after Open3D's tutorial on multiway registration)."""

# A user's program imports Open3D itself.
# ruff: noqa: TID251
from __future__ import annotations

from typing import Any


def main(scene: Any) -> dict[str, Any]:
    import numpy as np
    import open3d
    from open3d.pipelines import registration

    third = open3d.geometry.PointCloud(scene.target)
    third.transform(scene.shift)
    clouds = [scene.source, scene.target, third]  # the last is the target moved by a known pose
    graph = registration.PoseGraph()
    graph.nodes.append(registration.PoseGraphNode(np.eye(4)))
    odometry = np.eye(4)
    starts = {(0, 1): scene.guess, (1, 2): scene.shift, (0, 2): scene.shift @ scene.guess}
    for (i, j), start in starts.items():
        fit = registration.registration_icp(
            clouds[i], clouds[j], scene.reach, start, registration.TransformationEstimationPointToPlane()
        )
        information = registration.get_information_matrix_from_point_clouds(
            clouds[i], clouds[j], scene.reach, fit.transformation
        )
        if j == i + 1:
            odometry = fit.transformation @ odometry
            graph.nodes.append(registration.PoseGraphNode(np.linalg.inv(odometry)))
        graph.edges.append(registration.PoseGraphEdge(i, j, fit.transformation, information, uncertain=j != i + 1))
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(scene.reach, 0.25, reference_node=0),
    )
    first = registration.evaluate_registration(
        scene.source, scene.target, scene.reach, np.linalg.inv(graph.nodes[1].pose)
    )
    return {"graph": first}

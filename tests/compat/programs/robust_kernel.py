"""Point-to-plane with Tukey's kernel on a noisy source (after Open3D's tutorial on robust kernels)."""

# A user's program imports Open3D itself.
# ruff: noqa: TID251
from __future__ import annotations

from typing import Any


def main(scene: Any) -> dict[str, Any]:
    import numpy as np
    import open3d
    from open3d.pipelines import registration

    sigma = 0.05 * scene.size
    noisy = open3d.geometry.PointCloud(scene.source)
    noise = np.random.default_rng(0).normal(scale=sigma, size=np.asarray(scene.source.points).shape)
    noise[::2] = 0.0  # every other point is good
    noisy.points = open3d.utility.Vector3dVector(np.asarray(scene.source.points) + noise)
    loss = registration.TukeyLoss(k=0.5 * sigma)
    method = registration.TransformationEstimationPointToPlane(loss)
    robust = registration.registration_icp(noisy, scene.target, 5.0 * sigma, scene.guess, method)
    return {"tukey": robust}

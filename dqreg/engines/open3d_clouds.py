"""Clouds as Open3D's legacy interface takes them."""

from __future__ import annotations

from typing import Any

from dqreg.engines.clouds import Cloud
from dqreg.open3d_gate import load_open3d


def open3d_cloud(cloud: Cloud) -> Any:
    """A legacy Open3D cloud.

    >>> import numpy as np
    >>> open3d_cloud(Cloud(np.zeros((2, 3)), None)).has_normals()
    False
    """
    open3d = load_open3d()
    converted = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
    if cloud.normals is not None:
        converted.normals = open3d.utility.Vector3dVector(cloud.normals)
    return converted


def with_normals(cloud: Any, settings: dict[str, Any], side: str) -> Any:
    """Fit normals where there are none, as Open3D does by itself (30 nearest neighbours)."""
    given = cloud.has_normals()
    if not given:
        # The default of `estimate_normals`, called without arguments in the ICP tutorial.
        cloud.estimate_normals(load_open3d().geometry.KDTreeSearchParamKNN(knn=30))
    settings[f"{side}_normals"] = "given" if given else "estimated, 30 nearest neighbours"
    return cloud

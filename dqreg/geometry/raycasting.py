"""Open3D's ray-casting scene of a mesh: the one place that builds and queries it.

The scene works in float32 and loses digits with size and distance from the origin. It therefore gets the mesh centred
and scaled to unit size, and finds faces only; callers compute points on them in float64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg._open3d import load_open3d


class RayScene:
    """Triangles in sizes of the mesh about its centre; read-only after it is built."""

    def __init__(self, vertices: FloatArray, faces: IntArray, centre: FloatArray, size: float) -> None:
        open3d = load_open3d()
        self._scene = open3d.t.geometry.RaycastingScene()
        # Vertices that no face uses may be anywhere, also beyond float32; the others are within a half.
        unit = np.clip((vertices - centre) / size, -1.0, 1.0)
        self._scene.add_triangles(
            open3d.core.Tensor(unit.astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32))
        )

    def first_faces(self, rays: NDArray[np.floating]) -> tuple[IntArray, NDArray[np.float32]]:
        """Face that each ray meets first, -1 for none, and how far from its origin, infinite for none.

        Shapes: rays (..., 6), origin and direction in sizes of the mesh about its centre.
        """
        found = self._scene.cast_rays(load_open3d().core.Tensor(rays.astype(np.float32)))
        distances = found["t_hit"].numpy()
        faces = found["primitive_ids"].numpy().astype(np.int64)
        faces[~np.isfinite(distances)] = -1
        return faces, distances

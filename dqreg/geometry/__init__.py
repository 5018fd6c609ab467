"""Clouds and meshes, and the surfaces they are to the loop.

`PointCloud` and `Mesh` hold checked data; `CloudSurface` and `MeshSurface` answer "what is closest?"; `prepare_scan`
turns a raw cloud into what the loop moves.
"""

from __future__ import annotations

from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.opening import as_geometry
from dqreg.geometry.sampling import sample_mesh
from dqreg.geometry.scan import Scan
from dqreg.geometry.scan_preparation import prepare_scan
from dqreg.geometry.surface import Closest, Surface

__all__ = [
    "Closest",
    "CloudSurface",
    "Mesh",
    "MeshSurface",
    "PointCloud",
    "Scan",
    "Surface",
    "as_geometry",
    "prepare_scan",
    "sample_mesh",
]

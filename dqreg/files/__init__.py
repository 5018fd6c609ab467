"""Scans and parts on disk, as plain arrays: the readers, the registry of formats and the PLY writer.

A cloud comes as `CloudData`, a mesh as `MeshData`; every failure is an `InputError` that names the file, what
was found and what was expected. What the numbers mean (normals, units, surfaces) is for other rooms.
"""

from __future__ import annotations

from dqreg.files.cloud_data import CloudData
from dqreg.files.formats import READERS, read_cloud, read_geometry, read_mesh
from dqreg.files.mesh_data import MeshData
from dqreg.files.write import write_cloud

__all__ = ["READERS", "CloudData", "MeshData", "read_cloud", "read_geometry", "read_mesh", "write_cloud"]

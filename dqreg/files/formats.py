"""The formats that can be read: which extension goes to which reader, and three functions that read them.

PLY may hold either; every other format is for clouds or for meshes. A mesh is never taken for a cloud:
its vertices sit where a mesher put them, dense in fillets and absent from flats, and measure nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from dqreg.errors import did_you_mean
from dqreg.files.cloud_data import CloudData
from dqreg.files.e57 import read_e57
from dqreg.files.kitti import read_kitti
from dqreg.files.las import read_las
from dqreg.files.mesh_data import MeshData
from dqreg.files.meshes import read_mesh_file
from dqreg.files.numpy_files import read_npy, read_npz
from dqreg.files.obj import read_obj
from dqreg.files.off import read_off
from dqreg.files.pcd import read_pcd
from dqreg.files.ply import read_ply
from dqreg.files.step import read_step
from dqreg.files.tables import read_pts, read_table
from dqreg.files.threemf import read_3mf
from dqreg.files.untrusted import require_own_kind, require_readable, unreadable

READERS: dict[str, Callable[[Path], CloudData | MeshData]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_table,
    ".asc": read_table,
    ".xyzn": read_table,
    ".txt": read_table,
    ".csv": read_table,
    ".npy": read_npy,
    ".npz": read_npz,
    ".stl": read_mesh_file,
    ".obj": read_obj,
    ".off": read_off,
    ".glb": read_mesh_file,
    ".gltf": read_mesh_file,
    ".3mf": read_3mf,
    ".step": read_step,
    ".stp": read_step,
    ".las": read_las,
    ".laz": read_las,
    ".e57": read_e57,
    ".bin": read_kitti,
    ".pts": read_pts,
}

_EXACT = "exact CAD surfaces; export the part as STEP (read with dqreg[step]), STL, PLY or OBJ from the CAD program"
_SCAN = "a scanner's format; export the scan as E57 (read with dqreg[scans]) or PLY, for example with CloudCompare"
# Formats that users do have, and what to do about them.
FOREIGN = {
    **dict.fromkeys((".iges", ".igs", ".brep", ".x_t", ".sldprt", ".ipt", ".3dm", ".jt", ".catpart", ".prt"), _EXACT),
    **dict.fromkeys((".ptx", ".fls", ".rcp", ".zfs", ".g3d"), _SCAN),
    **dict.fromkeys((".gz", ".zip", ".7z", ".bz2", ".xz"), "a compressed file; unpack it first"),
    **dict.fromkeys((".bag", ".mcap", ".db3"), "a bag of many scans; dqreg odometry reads it"),
    **dict.fromkeys((".png", ".tif", ".tiff"), "an image; of a depth image dqreg.PointCloud.from_depth makes a cloud"),
    **dict.fromkeys((".vtp", ".vtk", ".vtu"), "VTK's own data; save it as PLY, for example with ParaView"),
}


def read_geometry(path: str | os.PathLike[str]) -> CloudData | MeshData:
    r"""Mesh of a file that has faces, cloud of any other.

    Parameters
    ----------
    path : str or path
        A file with one of the extensions in `READERS`, in upper or lower case.

    Returns
    -------
    CloudData or MeshData
        Plain float64 arrays in the file's own frame and unit.

    Raises
    ------
    InputError
        If the file is missing, empty, damaged, cut short, of an unknown kind or not what its name says.
    MissingDependencyError
        If the format needs a package that is not installed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     scan = Path(folder) / "scan.csv"
    ...     _ = scan.write_text("x,y,z\n0,0,1\n4400000.123456,0,1\nnan,0,0\n")
    ...     cloud = read_geometry(scan)
    >>> cloud.points.shape, cloud.dropped
    ((2, 3), 1)
    """
    place = require_readable(path)
    extension = place.suffix.lower()
    if extension not in READERS:
        raise unreadable(place, *_unknown(extension))
    require_own_kind(place, extension)
    return READERS[extension](place)


def read_cloud(path: str | os.PathLike[str]) -> CloudData:
    """Cloud of a file.

    Parameters
    ----------
    path : str or path
        As in `read_geometry`.

    Returns
    -------
    CloudData
        Points, and what else the file says about them.

    Raises
    ------
    InputError
        As in `read_geometry`, and if the file holds a mesh: its vertices are not taken for points.

    Examples
    --------
    >>> read_cloud("no_such.ply")
    Traceback (most recent call last):
    ...
    dqreg.errors.InputError: cannot read no_such.ply: found no such file; expected the path of a scan or part
    """
    data = read_geometry(path)
    if isinstance(data, MeshData):
        found = f"a mesh of {len(data.faces)} faces"
        expected = "a cloud of points; pass the mesh as the target, or points of it as an array"
        raise unreadable(Path(path), found, expected)
    return data


def read_mesh(path: str | os.PathLike[str]) -> MeshData:
    """Mesh of a file.

    Parameters
    ----------
    path : str or path
        As in `read_geometry`.

    Returns
    -------
    MeshData
        Vertices and triangles.

    Raises
    ------
    InputError
        As in `read_geometry`, and if the file holds points without faces.

    Examples
    --------
    >>> read_mesh("no_such.stl")
    Traceback (most recent call last):
    ...
    dqreg.errors.InputError: cannot read no_such.stl: found no such file; expected the path of a scan or part
    """
    data = read_geometry(path)
    if isinstance(data, CloudData):
        raise unreadable(Path(path), f"{len(data.points)} points and no faces", "a mesh of triangles")
    return data


def _unknown(extension: str) -> tuple[str, str]:
    known = " ".join(sorted(READERS))
    if extension in FOREIGN:
        found, _, remedy = FOREIGN[extension].partition("; ")
        return f"{extension}: {found}", f"one of {known}; {remedy}"
    found = f"the extension {extension!r}" if extension else "a name without extension"
    return found, f"one of {known}{did_you_mean(extension, READERS)}"

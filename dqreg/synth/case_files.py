"""The bytes of a case's scan and part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg.arrays import FloatArray, IntArray

_PLY_TYPES = {np.dtype(np.float32): "float", np.dtype(np.float64): "double"}


def ply_bytes(points: NDArray[np.floating], comment: str) -> bytes:
    """Binary PLY of points, in the precision that they have.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Float32 or float64; trimesh would write either as float32.
    comment : str
        One line for the header.

    Returns
    -------
    bytes
        Little-endian PLY with the properties x, y, z.

    Examples
    --------
    >>> ply_bytes(np.zeros((2, 3)), "units mm").splitlines()[2].decode()
    'comment units mm'
    """
    kind = _PLY_TYPES[points.dtype]
    header = ["ply", "format binary_little_endian 1.0", f"comment {comment}", f"element vertex {len(points)}"]
    header += [f"property {kind} {axis}" for axis in "xyz"] + ["end_header", ""]
    return "\n".join(header).encode("ascii") + points.astype(points.dtype.newbyteorder("<")).tobytes()


def stl_bytes(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary STL of a mesh.

    Parameters
    ----------
    vertices : ndarray, (v, 3)
        Stored as float32.
    faces : ndarray, (f, 3)
        Vertex indices.

    Returns
    -------
    bytes
        Little-endian STL.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> len(stl_bytes(*box())) == 84 + 12 * 50
    True
    """
    import trimesh

    content: bytes = trimesh.exchange.stl.export_stl(trimesh.Trimesh(vertices, faces, process=False))
    return content

"""The bytes of a case's scan and part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dqreg.arrays import FloatArray, IntArray

_PLY_TYPES = {np.dtype(np.float32): "float", np.dtype(np.float64): "double"}


def ply_bytes(
    points: NDArray[np.floating],
    comments: Sequence[str],
    *,
    normals: NDArray[np.floating] | None = None,
    times: FloatArray | None = None,
) -> bytes:
    """Binary PLY of points, in the precision that they have.

    >>> ply_bytes(np.zeros((2, 3)), ["units mm"]).splitlines()[2].decode()
    'comment units mm'
    """
    columns = list(zip("xyz", points.T, strict=True))
    if normals is not None:
        columns += list(zip(("nx", "ny", "nz"), normals.T, strict=True))
    if times is not None:
        columns += [("time", times)]
    table = np.zeros(len(points), dtype=[(name, column.dtype.newbyteorder("<")) for name, column in columns])
    for name, column in columns:
        table[name] = column
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    header += [f"element vertex {len(points)}"]
    header += [f"property {_PLY_TYPES[column.dtype]} {name}" for name, column in columns] + ["end_header", ""]
    return "\n".join(header).encode("ascii") + table.tobytes()


def stl_bytes(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary STL of a mesh.

    >>> from dqreg.synth.parts import box
    >>> len(stl_bytes(*box())) == 84 + 12 * 50
    True
    """
    import trimesh

    content: bytes = trimesh.exchange.stl.export_stl(trimesh.Trimesh(vertices, faces, process=False))
    return content

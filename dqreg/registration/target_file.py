"""A prepared target in a file: arrays in an NPZ archive with a JSON header, no pickle.

What takes long is kept (coordinates checked and moved, fitted normals); Open3D's trees have no file form and are built
again, which takes about a microsecond a point or face.
"""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.strict_json import plain, record_from
from dqreg.geometry import CloudSurface, Mesh, PointCloud
from dqreg.registration.target_index import TargetIndex

FORMAT, VERSION = "dqreg target", 2
# What Open3D's trees take beside the arrays, measured as resident memory: 75 to 92 bytes a triangle, and a copy of the
# coordinates and the permutation with a few nodes for a cloud.
TREE_BYTES_A_FACE, TREE_BYTES_A_POINT = 85, 48


@dataclasses.dataclass(frozen=True)
class Header:
    """What stands beside the arrays."""

    format: str
    version: int
    kind: str
    name: str
    units: str | None
    dropped: int


def save_target(indexed: TargetIndex, path: str | Path) -> None:
    """Write a target, whole or not at all."""
    geometry = indexed.geometry
    header = Header(FORMAT, VERSION, indexed.kind, indexed.name, geometry.units, geometry.dropped)
    arrays: dict[str, Any] = {"origin": indexed.origin}
    if isinstance(geometry, Mesh):
        arrays |= {"vertices": geometry.vertices, "faces": geometry.faces, "flat": geometry.flat}
    else:
        fitted = indexed.surface.fitted if isinstance(indexed.surface, CloudSurface) else None
        arrays |= {"points": geometry.points, "normals": geometry.normals, "viewpoint": geometry.viewpoint}
        arrays |= {"fitted": fitted if geometry.normals is None else None}
    stream = io.BytesIO()
    text = np.frombuffer(json.dumps(plain(header)).encode(), dtype=np.uint8)
    np.savez(stream, header=text, **{name: array for name, array in arrays.items() if array is not None})
    write_atomically(Path(path), stream.getvalue())


def load_target(path: str | Path) -> TargetIndex:
    """Read what `save_target` wrote."""
    try:
        # NumPy leaves a file that is no archive open; bytes need no closing.
        with np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as archive:
            arrays: dict[str, NDArray[Any]] = dict(archive)
        header = json.loads(arrays["header"].tobytes())
        found, version = header["format"], header["version"]
    except (OSError, EOFError, KeyError, ValueError, TypeError, AttributeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is no readable prepared target (Target.save writes one): {error}") from error
    if found != FORMAT:
        raise InputError(f'{path} is no prepared target: its header says "format": {found!r}, expected {FORMAT!r}')
    if version != VERSION:
        raise InputError(
            f"{path} is a prepared target of version {version}, this program reads {VERSION}: prepare and save it again"
        )
    try:
        return _indexed(record_from(Header, header), arrays)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path} is a damaged prepared target: {type(error).__name__} {error}") from error


def _indexed(header: Header, arrays: dict[str, NDArray[Any]]) -> TargetIndex:
    units, dropped = header.units, header.dropped
    if header.kind == "mesh":
        mesh = Mesh(arrays["vertices"], arrays["faces"], units, dropped, arrays["flat"])
        return TargetIndex(mesh, arrays["origin"], header.name)
    cloud = PointCloud(arrays["points"], None, arrays.get("viewpoint"), units, dropped)
    if "normals" in arrays:
        # They are of unit length already; to normalise them again would change their last digits.
        object.__setattr__(cloud, "normals", _same_rows(arrays["normals"], cloud.points))
    fitted = arrays.get("fitted")
    return TargetIndex(cloud, arrays["origin"], header.name, fitted)


def _same_rows(normals: NDArray[Any], points: FloatArray) -> FloatArray:
    if normals.shape != points.shape:
        raise ValueError(f"normals of shape {normals.shape} for points of shape {points.shape}")
    return normals.astype(np.float64, copy=False)


def bytes_of(indexed: TargetIndex) -> int:
    """Memory that a built target holds, trees included."""
    geometry = indexed.geometry
    if isinstance(geometry, Mesh):
        trees = TREE_BYTES_A_FACE * len(geometry.faces)
    else:
        trees = TREE_BYTES_A_POINT * len(geometry.points)
    return trees + _held([indexed], set())


def _held(values: list[Any], seen: set[int]) -> int:
    # Arrays of the objects and of what they hold in turn, each once; a view counts with what it looks at.
    total = 0
    while values:
        value = values.pop()
        while isinstance(value, np.ndarray) and isinstance(value.base, np.ndarray):
            value = value.base
        if id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, np.ndarray):
            total += value.nbytes
        elif type(value).__module__.startswith("dqreg."):
            values.extend(vars(value).values())
    return total

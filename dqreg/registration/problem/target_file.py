"""A prepared target in a file: arrays in an NPZ archive with a JSON header, no pickle.

What takes long is kept (coordinates checked and moved, fitted normals); trees are built again, which takes about a
microsecond a point or face: no longer than to read them.
"""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, require_finite
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.numpy_files import numbers, read_arrays
from dqreg.files.strict_json import plain, record_from
from dqreg.files.units import factor
from dqreg.files.untrusted import require_readable
from dqreg.geometry import CloudSurface, Mesh, PointCloud
from dqreg.registration.problem.source import require_spread
from dqreg.registration.problem.strays import Strays
from dqreg.registration.problem.target_index import TargetIndex

FORMAT, VERSION = "dqreg target", 2
ARRAYS = ("origin", "vertices", "faces", "flat", "regions", "points", "normals", "viewpoint", "fitted")
# What Open3D's tree of a cloud takes beside the arrays: a copy of the coordinates, the permutation and a few nodes.
TREE_BYTES_A_POINT = 48


@dataclasses.dataclass(frozen=True)
class TargetHeader:
    """What stands beside the arrays."""

    format: str
    version: int
    kind: str
    name: str
    units: str | None
    dropped: int
    strays: Strays | None = None
    repeated: int = 0


def save_target(indexed: TargetIndex, path: str | Path) -> None:
    """Write a target, whole or not at all."""
    geometry = indexed.geometry
    named = indexed.kind, indexed.name, geometry.units
    repeated = geometry._repeated if isinstance(geometry, Mesh) else 0
    header = TargetHeader(FORMAT, VERSION, *named, geometry.dropped, indexed.strays, repeated)
    arrays: dict[str, Any] = {"origin": indexed.origin}
    if isinstance(geometry, Mesh):
        arrays |= {"vertices": geometry.vertices, "faces": geometry.faces, "flat": geometry.flat}
        arrays |= {"regions": geometry.regions}
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
        arrays = read_arrays(require_readable(path), ("header", *ARRAYS))
        header = json.loads(arrays["header"].tobytes())
        found, version = header["format"], header["version"]
    except (InputError, KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} is no readable prepared target (Target.save writes one): {error}") from error
    if found != FORMAT:
        raise InputError(f'{path} is no prepared target: its header says "format": {found!r:.60}, expected {FORMAT!r}')
    if version != VERSION:
        raise InputError(
            f"{path} is a prepared target of version {version!r:.60}, this program reads {VERSION}: prepare and save "
            "it again"
        )
    try:
        return _indexed(Path(path), record_from(TargetHeader, header), arrays)
    except (KeyError, TypeError, ValueError, IndexError, ArithmeticError) as error:
        raise InputError(f"{path} is a damaged prepared target: {type(error).__name__} {error}") from error


def _indexed(path: Path, header: TargetHeader, arrays: dict[str, NDArray[Any]]) -> TargetIndex:
    def read(name: str, *shape: int | None) -> FloatArray:
        array = numbers(path, arrays[name], name, shape)
        require_finite(array, name)
        return array

    units, dropped, origin = header.units, header.dropped, read("origin", 3)
    factor(units, None)
    if header.kind == "mesh":
        vertices = read("vertices", None, 3)
        flat = _faces(arrays["flat"], len(vertices))
        mesh = Mesh(vertices, arrays["faces"], units, dropped, flat, arrays.get("regions"))
        object.__setattr__(mesh, "_repeated", mesh._repeated + header.repeated)
        return TargetIndex(mesh, origin, header.name)
    if header.kind != "cloud" or dropped < 0:
        raise ValueError(f"a {header.kind!r:.20} with {dropped} rows dropped")
    viewpoint = read("viewpoint", 3) if "viewpoint" in arrays else None
    cloud = PointCloud(read("points", None, 3), None, viewpoint, units, dropped)
    require_spread(cloud.points, "target")
    if "normals" in arrays:
        # They are of unit length already; to normalise them again would change their last digits.
        object.__setattr__(cloud, "normals", _unit(read("normals", len(cloud.points), 3)))
    fitted = read("fitted", None, 4) if "fitted" in arrays else None
    index = TargetIndex(cloud, origin, header.name, fitted, strays=header.strays)
    # Fitted normals are one a distinct point, which only the surface counts.
    _ = index.surface
    return index


def _faces(array: NDArray[Any], count: int) -> NDArray[Any]:
    fits = array.dtype.kind in "iu" and array.ndim == 2 and array.shape[1] == 3
    if not fits or (array.size and not 0 <= int(array.min()) <= int(array.max()) < count):
        raise ValueError(f"flat faces of type {array.dtype} and shape {array.shape} on {count} vertices")
    return array.astype(np.int64)


def _unit(normals: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(normals, axis=1)
    if not np.allclose(lengths, 1.0, rtol=0.0, atol=1e-9):
        raise ValueError("normals that are not of length 1")
    return normals


def bytes_of(indexed: TargetIndex) -> int:
    """Memory that a built target holds, trees included."""
    # Whatever is still being found beside.
    geometry, _ = indexed.geometry, indexed.near_rotations
    trees = TREE_BYTES_A_POINT * len(geometry.points) if isinstance(geometry, PointCloud) else 0
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
        elif isinstance(value, dict):
            values.extend(value.values())
        elif type(value).__module__.startswith("dqreg."):
            values.extend(vars(value).values())
    return total

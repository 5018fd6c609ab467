"""The bytes of a case's scan and part."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.strict_json import plain
from dqreg.rigid import pose
from dqreg.synth.motion import Motion
from dqreg.synth.parts import Symmetry
from dqreg.synth.recipe import Recipe

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


def symmetry_record(symmetry: Symmetry | None, T_target_source: FloatArray) -> dict[str, Any]:
    """Say which other poses are true."""
    if symmetry is None:
        return {"symmetric_truths": None, "near_symmetric_truths": None, "symmetry_axis": None}
    axis = symmetry.axis
    return {
        "symmetric_truths": plain(np.concatenate([T_target_source[None], symmetry.poses[1:] @ T_target_source])),
        "near_symmetric_truths": plain(symmetry.near @ T_target_source),
        "symmetry_axis": None if axis is None else {"point": plain(axis[0]), "direction": plain(axis[1])},
    }


def motion_record(motion: Motion | None, centre: FloatArray, diagonal: float, T: FloatArray) -> dict[str, Any] | None:
    """Say how the part moved, in the frame of the scan.

    >>> motion_record(Motion(shift=(0.0, 0.0, 0.1)), np.zeros(3), 10.0, np.eye(4))["twist"]
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    """
    if motion is None:
        return None
    twist = pose.adjoint(T) @ motion.twist(centre, diagonal)
    return {
        "twist": plain(twist),
        "reference_time": float(motion.reference),
        "time_unit": "sweep",
        "undo": "p(reference_time) = exp((reference_time - time) twist) p; twist: rotation first, scan frame",
    }


def settings_record(recipe: Recipe) -> dict[str, Any]:
    """What the scan was taken with and what went wrong, defaults filled in.

    Keys are those of the recipe; angles are in degrees, no scene is None.
    """
    return {
        "scanner": {"kind": recipe.scanner_kind, **_in_degrees(dataclasses.asdict(recipe.scanner))},
        "noise": _in_degrees(dataclasses.asdict(recipe.noise)),
        "scene": None if recipe.scene.kind == "none" else dataclasses.asdict(recipe.scene),
    }


def json_text(record: Mapping[str, Any]) -> str:
    """JSON for people too: one line a key, and one a row of a matrix.

    >>> print(json_text({"T": [[1, 0], [0, 1]]}), end="")
    {
      "T": [
        [1, 0],
        [0, 1]
      ]
    }
    """
    text = json.dumps(record, indent=2, allow_nan=False)
    rows = re.compile(r"\[\s+([^][{}\"]*?)\s+\]")  # lists of numbers; the only text with brackets is quoted
    return rows.sub(lambda row: "[" + re.sub(r"\s+", " ", row[1]) + "]", text) + "\n"


def _in_degrees(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Angles as the recipe has them; twelve digits, so that 80 degrees do not become 80.00000000000001."""
    return {
        key.removesuffix("_rad") + "_deg" if key.endswith("_rad") else key: float(f"{np.rad2deg(value):.12g}")
        if key.endswith("_rad") and value is not None
        else value
        for key, value in settings.items()
    }

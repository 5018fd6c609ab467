"""Finished pairs on disk: what a result depends on, and which files are such results."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.json_records import read_json
from dqreg.geometry import Mesh, PointCloud
from dqreg.registration.result.result import Registration
from dqreg.registration.target import Target

# Under which key a file says what it depends on, and what it says of it at least.
KEY, SAID = "multiway", {"target", "source", "effort", "seed"}
# Names of such files.
NAME = re.compile(r"-?\d+-\d+-(search|near|start)\.json")


def digest_of(geometry: PointCloud | Mesh) -> str:
    """Tells points and faces, normals, viewpoint and unit from all others."""
    columns: tuple[Any, ...]
    if isinstance(geometry, Mesh):
        columns = geometry.vertices, geometry.faces
    else:
        columns = geometry.points, geometry.normals, geometry.viewpoint
    found = hashlib.sha256(f"{type(geometry).__name__} {geometry.units}".encode())
    for column in columns:
        shape = None if column is None else np.shape(column)
        found.update(f"{shape}".encode())
        if column is not None:
            found.update(np.ascontiguousarray(column).tobytes())
    return found.hexdigest()


def digest_of_part(part: Target) -> str:
    """The same of a part, wherever its frame is."""
    index = part.indexed
    name = f"{digest_of(index.geometry)} {index.origin.tolist()} {index.units}"
    return hashlib.sha256(name.encode()).hexdigest()


def kept(path: Path, fingerprint: dict[str, object]) -> Registration | None:
    """The result in a file, if all that it depends on is as it was."""
    try:
        if read_json(path, "a pair").pop(KEY) != fingerprint:
            return None
        return Registration.load(path)
    except (OSError, KeyError, InputError):
        return None


def keep(path: Path, result: Registration, fingerprint: dict[str, object]) -> None:
    """Write a result with what it depends on."""
    write_atomically(path, json.dumps({**result.to_dict(), KEY: fingerprint}, allow_nan=False))


def pairs_in(folder: Path) -> Iterator[Path]:
    """Files of a folder that hold a finished pair, by their names and by what they say: others may lie beside them."""
    for path in sorted(folder.glob("*.json")):
        if NAME.fullmatch(path.name) and _is_pair(path):
            yield path


def _is_pair(path: Path) -> bool:
    try:
        said = read_json(path, "a pair").get(KEY)
    except InputError:
        return False
    return isinstance(said, dict) and set(said) >= SAID

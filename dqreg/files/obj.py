"""Wavefront OBJ files.

Not read with trimesh, which (5.2) takes indices from the back for indices from the end of the file, and fans for faces.
"""

from __future__ import annotations

import itertools
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.polygons import triangles
from dqreg.files.units import unit_of_comment
from dqreg.files.untrusted import unreadable

# Statements of surfaces and curves that are no polygons.
FREEFORM = ("curv", "curv2", "surf", "cstype")


def read_obj(path: Path) -> MeshData:
    """Mesh of an OBJ file, its bodies joined."""
    vertices, lengths, corners = array("d"), array("q"), array("q")
    for line in _statements(path):
        kind, *words = line.split()
        try:
            if kind == "v":
                vertices.extend(_position(words))
            elif kind == "f":
                corners.extend(_corner(word, len(vertices) // 3) for word in words)
                lengths.append(len(words))
            elif kind in FREEFORM:
                raise ValueError("freeform")
        except (ValueError, OverflowError) as error:
            raise unreadable(path, f"the line {line.strip()[:60]!r}", _EXPECTED.get(kind, "faces only")) from error
        if kind == "f" and len(words) < 3:
            raise unreadable(path, "a face with fewer than three corners", "a whole file; was it cut short?")
    points: FloatArray = np.asarray(vertices).reshape(-1, 3)
    cut = triangles(path, points, np.asarray(lengths), np.asarray(corners))
    return make_mesh(path, points, cut, _units(path))


_EXPECTED = {
    "v": "v and x y z, perhaps with a weight of 1 or a colour",
    "f": "vertices counted from 1, or back from the last with -1",
}


def _statements(path: Path) -> Iterator[str]:
    kept = ""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        for line in stream:
            if "\0" in line:
                raise unreadable(path, "binary data", "text in UTF-8, not UTF-16")
            kept += line.partition("#")[0].rstrip()
            if kept.endswith("\\"):
                kept = kept[:-1] + " "
                continue
            if kept and not kept.isspace():
                yield kept
            kept = ""
    if kept.strip():
        yield kept


def _position(words: list[str]) -> list[float]:
    # A fourth number is the weight of a rational curve, a fourth to sixth (or seventh) a colour.
    if len(words) not in (3, 4, 6, 7) or (len(words) == 4 and float(words[3]) != 1.0):
        raise ValueError("no position")
    return [float(word) for word in words[:3]]


def _corner(word: str, count: int) -> int:
    index = int(word.partition("/")[0])
    if index == 0 or index < -count:
        raise ValueError("no such vertex")
    return index - 1 if index > 0 else count + index


def _units(path: Path) -> str | None:
    # Exporters that state a unit do so in the comments before the first vertex.
    with path.open(errors="replace") as stream:
        comments = itertools.takewhile(
            lambda line: not line.strip() or line.startswith("#"), itertools.islice(stream, 50)
        )
        units = {unit_of_comment(line.lstrip("# ")) for line in comments} - {None}
    return units.pop() if len(units) == 1 else None

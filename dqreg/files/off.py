"""OFF files: the text form in three dimensions, with or without normals and colours."""

from __future__ import annotations

import itertools
import re
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.polygons import triangles
from dqreg.files.untrusted import unreadable

# Texture, colours and normals follow the position in each row; a fourth coordinate or another dimension changes it.
KEYWORD = re.compile(r"(ST)?C?N?OFF")
OTHER_KEYWORD = re.compile(r"(ST)?C?N?4?n?OFF")


def read_off(path: Path) -> MeshData:
    """Mesh of an OFF file."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        rows = (line.partition("#")[0].split() for line in stream)
        return _mesh(path, (row for row in rows if row))


def _mesh(path: Path, rows: Iterator[list[str]]) -> MeshData:
    keyword, *counts = next(rows, [""])
    if not KEYWORD.fullmatch(keyword):
        found = f"the keyword {keyword}" if OTHER_KEYWORD.fullmatch(keyword) else f"a file that begins {keyword[:20]!r}"
        raise unreadable(path, found, "OFF in three dimensions, as text")
    if "BINARY" in (word.upper() for word in counts):
        raise unreadable(path, "binary OFF", "OFF as text")
    counts = counts or next(rows, [])
    if len(counts) < 2 or not all(word.isdecimal() and len(word) <= 18 for word in counts[:2]):
        raise unreadable(path, f"the counts {' '.join(counts)[:40]!r}", "numbers of vertices and faces")
    points, polygons = int(counts[0]), int(counts[1])
    try:
        vertices, lengths, corners = array("d"), array("q"), array("q")
        for row in itertools.islice(rows, points):
            x, y, z = map(float, row[:3])
            vertices.extend((x, y, z))
        for row in _whole(itertools.islice(rows, polygons)):
            lengths.append(int(row[0]))
            corners.extend(map(int, row[1 : 1 + lengths[-1]]))
    except (ValueError, OverflowError) as error:
        raise unreadable(path, f"a damaged row ({error})", "x y z, then faces as a count and vertices") from error
    if len(vertices) < 3 * points or len(lengths) < polygons:
        found = f"{len(vertices) // 3} vertices and {len(lengths)} faces"
        raise unreadable(path, found, f"the {points} and {polygons} of its header; was it cut short?")
    table: FloatArray = np.asarray(vertices).reshape(-1, 3)
    cut = triangles(path, table, np.asarray(lengths), np.asarray(corners))
    return make_mesh(path, table, cut)


def _whole(rows: Iterator[list[str]]) -> Iterator[list[str]]:
    for row in rows:
        if int(row[0]) < 0 or len(row) < 1 + int(row[0]):
            raise ValueError(f"{' '.join(row)[:40]!r} lacks corners")
        yield row

"""PLY files: a cloud, or a mesh where there are faces.

Read with NumPy, not with Open3D: on a file that is cut short, or whose x, y and z differ in type, Open3D's
reader (0.20) hands back memory that nobody wrote, without an error.
"""

from __future__ import annotations

import struct
from array import array
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.column_names import find_columns, find_times
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.ply_header import Element, PlyHeader, read_header
from dqreg.files.polygons import triangles
from dqreg.files.tables import parse_rows, read_text, stack_columns
from dqreg.files.untrusted import unreadable

INDEX_NAMES = ("vertex_indices", "vertex_index")
# struct's letters for the NumPy codes of PLY types.
LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}


def text_polygons(path: Path, face: Element, lines: list[str]) -> tuple[IntArray, IntArray]:
    """Lengths and corners of the polygons of a text file. Shapes: lengths (p,), corners (sum of lengths,)."""
    index = _index_column(path, face)
    if len(lines) < face.count:
        expected = f"the {face.count} of its header; was the file cut short?"
        raise unreadable(path, f"{len(lines)} face lines", expected)
    lengths, corners = array("q"), array("q")
    try:
        for line in lines[: face.count]:
            words, at = line.split(), 0
            for column in face.properties[:index]:
                at += 1 + (int(words[at]) if column.count_type else 0)
            count = int(words[at])
            polygon = words[at + 1 : at + 1 + count]
            if len(polygon) != count:
                raise ValueError(f"{count} corners are announced")
            corners.extend(map(int, polygon))
            lengths.append(count)
    except OverflowError as error:
        raise unreadable(path, "a vertex index of more than 64 bits", "indices of vertices") from error
    except (ValueError, IndexError) as error:
        raise unreadable(path, f"the face line {line[:60]!r}", "a count and as many vertex indices") from error
    return np.asarray(lengths), np.asarray(corners)


def binary_polygons(path: Path, header: PlyHeader, face: Element) -> tuple[IntArray, IntArray]:
    """Lengths and corners of the polygons of a binary file. Shapes: lengths (p,), corners (sum of lengths,)."""
    index = _index_column(path, face)
    before = header.elements[: header.elements.index(face)]
    if any(element.has_lists for element in before):
        raise unreadable(path, "lists of varying length before the faces", "faces right after vertices")
    start = header.size + sum(element.count * element.least_row_bytes for element in before)
    with path.open("rb") as stream:
        stream.seek(start)
        body = stream.read()
    try:
        alike = _alike_rows(body, face, header.byte_order)
        if alike is not None:
            corners = alike[f"list {index}"].astype(np.int64)
            return np.full(face.count, corners.shape[1], dtype=np.int64), corners.ravel()
        return _unlike_rows(body, face, header.byte_order, index)
    except (struct.error, ValueError) as error:
        expected = f"{face.count} faces; was it cut short?"
        raise unreadable(path, "a file that ends within its faces", expected) from error


def _index_column(path: Path, face: Element) -> int:
    for k, column in enumerate(face.properties):
        if column.name in INDEX_NAMES and column.count_type and column.type[0] != "f":
            return k
    names = ", ".join(column.name for column in face.properties) or "none"
    found = f"faces without vertex indices (columns: {names})"
    raise unreadable(path, found, f"an integer list named {INDEX_NAMES[0]}")


def _alike_rows(body: bytes, face: Element, order: str) -> np.ndarray[tuple[int], np.dtype[np.void]] | None:
    # Nearly every file has lists of one length; then a row is a fixed record and no loop is needed.
    fields: list[tuple[str, str, int]] = []
    at = 0
    for k, column in enumerate(face.properties):
        length = 1
        if column.count_type:
            (length,) = struct.unpack_from(order + LETTERS[column.count_type], body, at)
            if length <= 0:
                return None
            fields.append((f"count {k}", order + column.count_type, 1))
            at += int(column.count_type[1])
        fields.append((f"list {k}", order + column.type, length))
        at += length * int(column.type[1])
    row = np.dtype([(name, kind, (length,)) for name, kind, length in fields])
    if row.itemsize * face.count > len(body):
        return None
    rows = np.frombuffer(body, dtype=row, count=face.count)
    same = all((rows[name] == rows[name][0]).all() for name, _, _ in fields if name.startswith("count"))
    return rows if same else None


def _unlike_rows(body: bytes, face: Element, order: str, index: int) -> tuple[IntArray, IntArray]:
    # A row's place depends on the row before it, so this one loop cannot be an array operation.
    at, lengths, corners = 0, array("q"), array("q")
    for _ in range(face.count):
        for k, column in enumerate(face.properties):
            length = 1
            if column.count_type:
                (length,) = struct.unpack_from(order + LETTERS[column.count_type], body, at)
                at += int(column.count_type[1])
            if length < 0 or at + length * int(column.type[1]) > len(body):
                raise ValueError("a list is longer than the file")
            if k == index:
                corners.extend(struct.unpack_from(f"{order}{length}{LETTERS[column.type]}", body, at))
                lengths.append(length)
            at += length * int(column.type[1])
    return np.asarray(lengths), np.asarray(corners)


def read_ply(path: Path) -> CloudData | MeshData:
    """Mesh of a PLY file that has faces, else its cloud."""
    header = read_header(path)
    vertex = _vertex_table(path, header)
    positions, normals = find_columns(path, [column.name for column in vertex.properties])
    face = header.element("face")
    table, rest = _text_vertices(path, header, vertex) if not header.byte_order else (None, [])
    columns = _binary_vertices(path, header, vertex) if table is None else list(table.T)
    points = stack_columns(columns, positions)
    if face is None or not face.count:
        clock = find_times([column.name for column in vertex.properties])
        times = None if clock is None else stack_columns(columns, [clock])[:, 0]
        directions = None if normals is None else stack_columns(columns, normals)
        return make_cloud(path, points, directions, header.viewpoint, times, header.units)
    if header.byte_order:
        lengths, corners = binary_polygons(path, header, face)
    else:
        lengths, corners = text_polygons(path, face, rest)
    return make_mesh(path, points, triangles(path, points, lengths, corners), header.units)


def _vertex_table(path: Path, header: PlyHeader) -> Element:
    vertex, strips = header.element("vertex"), header.element("tristrips")
    if vertex is None:
        names = ", ".join(element.name for element in header.elements) or "none"
        raise unreadable(path, f"a PLY file without vertices (tables: {names})", "a table named vertex")
    if strips is not None and strips.count:
        raise unreadable(path, "triangle strips", "faces; save the mesh again, for example with MeshLab")
    before = header.elements[: header.elements.index(vertex)]
    if vertex.has_lists or any(element.has_lists for element in before):
        raise unreadable(path, "lists of varying length in or before the vertices", "the vertices first, without lists")
    return vertex


def _binary_vertices(path: Path, header: PlyHeader, vertex: Element) -> list[FloatArray]:
    before = header.elements[: header.elements.index(vertex)]
    # Columns are numbered, because a file may give two of them the same name.
    row = np.dtype([(str(k), header.byte_order + column.type) for k, column in enumerate(vertex.properties)])
    start = header.size + sum(element.count * element.least_row_bytes for element in before)
    rows = np.fromfile(path, dtype=row, count=vertex.count, offset=start)
    return [rows[name] for name in row.names or ()]


def _text_vertices(path: Path, header: PlyHeader, vertex: Element) -> tuple[FloatArray, list[str]]:
    lines = [line for line in read_text(path, skip_bytes=header.size).splitlines() if line and not line.isspace()]
    start = sum(element.count for element in header.elements[: header.elements.index(vertex)])
    stop = start + vertex.count
    if len(lines) < stop:
        raise unreadable(path, f"{max(0, len(lines) - start)} vertex lines", f"the {vertex.count} of its header")
    table = parse_rows(path, lines[start:stop], columns=len(vertex.properties))
    after = header.elements[header.elements.index(vertex) + 1 :]
    skipped = 0
    for element in after:
        if element.name == "face":
            break
        skipped += element.count
    return table, lines[stop + skipped :]

"""PLY files: a cloud, or a mesh where there are faces.

Read with NumPy, not with Open3D: on a file that is cut short, or whose x, y and z differ in type, Open3D's
reader (0.20) hands back memory that nobody wrote, without an error.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.cloud_data import CloudData, make_cloud
from dqreg.files.columns import find_columns, stack_columns
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.opening import unreadable
from dqreg.files.ply_faces import binary_polygons, text_polygons, triangles
from dqreg.files.ply_header import Element, PlyHeader, read_header
from dqreg.files.text_table import parse_rows, read_text


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
        cloud = make_cloud(path, points, None if normals is None else stack_columns(columns, normals))
        return dataclasses.replace(cloud, units=header.units)
    if header.byte_order:
        lengths, corners = binary_polygons(path, header, face)
    else:
        lengths, corners = text_polygons(path, face, rest)
    return make_mesh(path, points, triangles(lengths, corners), header.units)


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

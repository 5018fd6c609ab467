"""Hostile sources and targets, each with what must come of it: a named error, or a result that says what was dropped.

An entry is ``(make, outcome, words)``: ``make()`` gives the side; the outcome is an error or a set of verdict levels
that may come out; the words are a pattern that the error's message must hold, or the rows that the result must say it
dropped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from dqreg.errors import DegenerateGeometryError, InputError, UnitsError
from dqreg.geometry import Mesh, PointCloud
from tests.hostile.scenes import FIXED, PART, SCAN, SIZE, with_faces, with_rows

NAN, INF = float("nan"), float("inf")
Entry = tuple[Callable[[], Any], Any, Any]

ACCEPTED = {"accepted"}
DOUBTED = {"suspect", "failed"}
ANY = {"accepted", "suspect", "failed"}
RNG = np.random.default_rng(11)
PLANE = np.column_stack([RNG.uniform(-0.5, 0.5, (400, 2)) * SIZE, np.zeros(400)])
BALL = RNG.standard_normal((400, 3))
BALL *= 0.3 * SIZE / np.linalg.norm(BALL, axis=1, keepdims=True)
LINE = np.linspace(0.0, 5.0, 50)[:, None] * [1.0, 2.0, 3.0]
NORMALS = np.tile([0.0, 0.0, 1.0], (len(SCAN), 1))


def spoilt_normals(value: float | list[float], rows: slice) -> PointCloud:
    """The scan with normals of which some are spoilt."""
    normals = PointCloud(SCAN).points / np.linalg.norm(SCAN, axis=1, keepdims=True)
    normals[rows] = value
    return PointCloud(SCAN, normals)


def with_few(value: float) -> Any:
    """Normals of the fixed scan, of which fifty are spoilt."""
    normals = FIXED / np.linalg.norm(FIXED, axis=1, keepdims=True)
    normals[:50] = value
    return normals


def read_only(values: Any) -> Any:
    """A copy that may not be written to."""
    copy = values.copy()
    copy.flags.writeable = False
    return copy


def collapsed(axis: int) -> Mesh:
    """The part squeezed flat."""
    vertices = PART.vertices.copy()
    vertices[:, axis] = 0.0
    return Mesh(vertices, PART.faces)


# Clouds that either side may be.
CLOUDS: dict[str, Entry] = {
    # Numbers that are none.
    "all NaN": (lambda: np.full((9, 3), NAN), InputError, "9 rows"),
    "all infinite": (lambda: np.full((9, 3), INF), InputError, "9 rows"),
    "empty": (lambda: np.zeros((0, 3)), InputError, "empty"),
    "empty list": (list, InputError, "shape"),
    "None": (lambda: None, InputError, "NoneType"),
    "a number": (lambda: 3.5, InputError, "shape"),
    "text in rows": (lambda: [["a", "b", "c"]], InputError, "real numbers"),
    "bytes": (lambda: b"1 2 3", InputError, "real numbers"),
    "a dictionary": (lambda: {"cloud": SCAN}, InputError, "x, y and z; got cloud"),
    "a set": (lambda: {1.0, 2.0}, InputError, "real numbers"),
    "a function": (lambda: len, InputError, "real numbers"),
    "a generator": (lambda: (row for row in SCAN), InputError, "real numbers"),
    "complex": (lambda: SCAN + 1j, InputError, "complex"),
    "booleans": (lambda: SCAN > 0, InputError, "bool"),
    "dates": (lambda: np.zeros((9, 3), dtype="datetime64[s]"), InputError, "datetime"),
    "records": (
        lambda: np.zeros(9, dtype=[("a", "f8"), ("b", "f8"), ("c", "f8")]),
        InputError,
        "x, y and z; got a, b, c",
    ),
    "objects with None": (lambda: [[1.0, 2.0, None], [1, 2, 3]], InputError, "None"),
    "objects with lists": (lambda: np.array([[[1], [2], [3]], [1, 2, 3]], dtype=object), InputError, "real numbers"),
    "ragged rows": (lambda: [[1.0, 2.0, 3.0], [1.0, 2.0]], InputError, "real numbers"),
    "integers beyond float64": (lambda: [[10**400, 0, 0], [0, 1, 0], [1, 0, 0]], InputError, "real numbers"),
    # Shapes.
    "two columns": (lambda: SCAN[:, :2], InputError, r"\(n, 3\)"),
    "four columns": (lambda: np.c_[SCAN, SCAN[:, 0]], InputError, r"\(n, 3\)"),
    "transposed": (lambda: SCAN.T, InputError, r"\(n, 3\)"),
    "one row flat": (lambda: SCAN[0], InputError, r"\(n, 3\)"),
    "three axes": (lambda: SCAN[None], InputError, r"\(n, 3\)"),
    # Too little.
    "one point": (lambda: SCAN[:1], InputError, "1 usable point"),
    "two points": (lambda: SCAN[:2], InputError, "2 usable points"),
    "five points": (lambda: SCAN[::100], InputError, "5 usable points; at least six"),
    "two points and NaN": (lambda: np.r_[SCAN[:2], [[NAN] * 3] * 5], InputError, "2 usable points"),
    "one place": (lambda: np.tile(SCAN[:1], (50, 1)), DegenerateGeometryError, "one line"),
    "two places": (lambda: np.tile(SCAN[:2], (50, 1)), DegenerateGeometryError, "one line"),
    "a line": (lambda: LINE, DegenerateGeometryError, "one line"),
    "a far line": (lambda: LINE + 1e6, DegenerateGeometryError, "one line"),
    "a line along an axis": (lambda: LINE * [1, 0, 0], DegenerateGeometryError, "one line"),
    "a tiny line": (lambda: 1e-150 * LINE, InputError, "finer unit"),
    "a long line": (lambda: LINE[:25], DegenerateGeometryError, "one line"),
    # Beyond all sizes.
    "beyond float64's squares": (lambda: 1e200 * SCAN, InputError, "mark for a missing"),
    "at the end of float64": (lambda: SCAN / np.abs(SCAN).max() * 1.7e308, InputError, "mark for a missing"),
    "subnormal": (lambda: 1e-310 * SCAN, InputError, "finer unit"),
    "below float64's squares": (lambda: 1e-200 * SCAN, InputError, "finer unit"),
    "one point at 1e300": (lambda: with_rows([1e300, 0, 0]), InputError, "mark for a missing"),
    "one point at 1e160": (lambda: with_rows([1e160, 0, 0]), InputError, "mark for a missing"),
    "so far that nothing is left": (lambda: SCAN + 1e20, DegenerateGeometryError, "one line"),
}

# Scans that can be used in part or as a whole: what comes out, and how many rows the result says were dropped.
SOURCES: dict[str, Entry] = {
    "one NaN": (lambda: with_rows([NAN, 0, 0]), ACCEPTED, 1),
    "NaN in each column": (lambda: with_rows(np.where(np.eye(3) > 0, NAN, 0.0)), ACCEPTED, 3),
    "infinities of both signs": (lambda: with_rows([[INF, 0, 0], [-INF, 0, 0]]), ACCEPTED, 2),
    "a hundred NaN": (lambda: with_rows(np.full((100, 3), NAN)), ACCEPTED, 100),
    "more NaN than points": (lambda: with_rows(np.full((2_000, 3), NAN)), ACCEPTED, 2_000),
    "zeros of a missing return": (lambda: with_rows(np.zeros((300, 3))), ANY, 0),
    "every point twice": (lambda: np.repeat(SCAN, 2, axis=0), ACCEPTED, 0),
    "every point a hundred times": (lambda: np.tile(SCAN, (100, 1)), ACCEPTED, 0),
    "one point a thousand times": (lambda: with_rows(np.tile(SCAN[:1], (1_000, 1))), ACCEPTED, 0),
    "float32": (lambda: SCAN.astype(np.float32), ACCEPTED, 0),
    "float16": (lambda: SCAN.astype(np.float16), ANY, 0),
    "long double": (lambda: SCAN.astype(np.longdouble), ACCEPTED, 0),
    "big-endian": (lambda: SCAN.astype(">f8"), ACCEPTED, 0),
    "whole numbers": (lambda: np.round(SCAN).astype(np.int16), ANY, 0),
    "unsigned bytes": (lambda: np.abs(np.round(SCAN)).astype(np.uint8), ANY, 0),
    "objects": (lambda: SCAN.astype(object), ACCEPTED, 0),
    "a list of lists": (lambda: SCAN.tolist(), ACCEPTED, 0),
    "read-only": (lambda: read_only(SCAN), ACCEPTED, 0),
    "Fortran order": (lambda: np.asfortranarray(SCAN), ACCEPTED, 0),
    "every second row of a view": (lambda: np.repeat(SCAN, 2, axis=0)[::2], ACCEPTED, 0),
    "backwards view": (lambda: SCAN[::-1], ACCEPTED, 0),
    "columns of a wider array": (lambda: np.c_[SCAN, SCAN][:, 1:4][:, [2, 0, 1]], ACCEPTED, 0),
    "a broadcast view": (lambda: np.broadcast_to(SCAN, (3, *SCAN.shape))[1], ACCEPTED, 0),
    "a masked array": (lambda: np.ma.masked_array(SCAN, mask=np.zeros(SCAN.shape, dtype=bool)), ACCEPTED, 0),
    "a matrix": (lambda: SCAN.view(np.ndarray).copy(), ACCEPTED, 0),
    "six points": (lambda: SCAN[::80], DOUBTED, 0),
    "ten points": (lambda: SCAN[::47], DOUBTED, 0),
    "twenty-nine points": (lambda: SCAN[::16][:29], DOUBTED, 0),
    "coplanar": (lambda: PLANE, DOUBTED, 0),
    "a ball": (lambda: BALL, DOUBTED, 0),
    "a cube of noise": (lambda: np.random.default_rng(3).uniform(-0.5, 0.5, (400, 3)) * SIZE, DOUBTED, 0),
    "a lattice": (lambda: np.stack(np.meshgrid(*[np.arange(8.0)] * 3), -1).reshape(-1, 3), DOUBTED, 0),
    "the mirror image": (lambda: SCAN * [-1.0, 1.0, 1.0], DOUBTED, 0),
    "twice as large": (lambda: 2.0 * SCAN, DOUBTED, 0),
    # Its corner fits the part's to the last digit; the rest of it hangs beside the part.
    "2.2 times as large": (lambda: 2.2 * SCAN, DOUBTED, 0),
    "3 times as large": (lambda: 3.0 * SCAN, DOUBTED, 0),
    "stretched along x": (lambda: SCAN * [1.5, 1.0, 1.0], DOUBTED, 0),
    "turned inside out": (lambda: -SCAN, DOUBTED, 0),
    "in metres": (lambda: 1e-3 * SCAN, UnitsError, "times smaller than"),
    "in micrometres": (lambda: 1e3 * SCAN, UnitsError, "times as large as"),
    "one point at 1e6": (lambda: with_rows([1e6, 0, 0]), ACCEPTED, 1),
    "one point at 1e12": (lambda: with_rows([1e12, 0, 0]), ACCEPTED, 1),
    "one point at 1e30": (lambda: with_rows([1e30, 0, 0]), ACCEPTED, 1),
    "one point at 1e100": (lambda: with_rows([1e100, 0, 0]), InputError, "mark for a missing"),
    "nearly a line": (lambda: SCAN * [1.0, 1e-8, 1e-8], DOUBTED, 0),
    # Nothing of it is beside the part from the start: it is searched for.
    "far away": (lambda: SCAN + np.array([1e9, 0, 0]), {"accepted"}, 0),
    "a cluster and a stray": (lambda: np.r_[1e-6 * SCAN, [[SIZE, 0, 0]]], {"suspect", "failed", UnitsError}, 0),
    "NaN normals": (lambda: spoilt_normals(NAN, slice(0, 40)), ANY, 40),
    "infinite normals": (lambda: spoilt_normals(INF, slice(0, 40)), ANY, 40),
    "zero normals": (lambda: spoilt_normals(0.0, slice(0, 40)), ANY, 40),
    "normals of length 1e-300": (lambda: PointCloud(SCAN, 1e-300 * NORMALS), ANY, 0),
    "normals of length 1e300": (lambda: PointCloud(SCAN, 1e300 * NORMALS), ANY, 0),
    "all normals alike and wrong": (lambda: PointCloud(SCAN, NORMALS), DOUBTED, 0),
    "normals of whole numbers": (lambda: PointCloud(SCAN, NORMALS.astype(int)), DOUBTED, 0),
    "a viewpoint among the points": (lambda: PointCloud(SCAN, viewpoint=SCAN[0]), ANY, 0),
    "a viewpoint at 1e300": (lambda: PointCloud(SCAN, viewpoint=[1e300, 0, 0]), InputError, "viewpoint"),
    "a mesh of one triangle": (lambda: Mesh(np.eye(3), [[0, 1, 2]]), {"suspect", "failed", UnitsError}, 0),
    "a mesh with flat faces": (lambda: with_faces([[0, 0, 1], [2, 2, 2]]), ANY, 0),
    "a mesh with inner walls": (lambda: with_faces(PART.faces[:, ::-1]), ANY, 0),
    "a trimesh cloud": (lambda: trimesh.PointCloud(SCAN), ACCEPTED, 0),
}

# Targets for the good scan, and the rows or faces that the result says were dropped.
TARGETS: dict[str, Entry] = {
    "one NaN": (lambda: with_rows([NAN, 0, 0], FIXED), ANY, 1),
    "fifty NaN": (lambda: with_rows(np.full((50, 3), NAN), FIXED), ANY, 50),
    "infinities of both signs": (lambda: with_rows([[INF, 0, 0], [-INF, 0, 0]], FIXED), ANY, 2),
    "every point a hundred times": (lambda: np.tile(FIXED, (100, 1)), ANY, 0),
    "zeros of a missing return": (lambda: with_rows(np.zeros((300, 3)), FIXED), ANY, 0),
    "six points": (lambda: FIXED[::110], DOUBTED, 0),
    "ten points": (lambda: FIXED[::65], DOUBTED, 0),
    "coplanar": (lambda: PLANE, DOUBTED, 0),
    "a ball": (lambda: BALL, DOUBTED, 0),
    "one point at 1e12": (lambda: with_rows([1e12, 0, 0], FIXED), ANY, 1),
    "one point at 1e100": (lambda: with_rows([1e100, 0, 0], FIXED), InputError, "target.*mark for a missing"),
    "far away": (lambda: FIXED + np.array([1e9, 0, 0]), DOUBTED, 0),
    "NaN normals": (lambda: PointCloud(FIXED, with_few(NAN)), ANY, 50),
    "zero normals": (lambda: PointCloud(FIXED, with_few(0.0)), ANY, 50),
    "all normals alike": (lambda: PointCloud(FIXED, np.ones_like(FIXED)), ANY, 0),
    "one triangle": (lambda: Mesh(30 * np.eye(3), [[0, 1, 2]]), DOUBTED, 0),
    "faces without area": (lambda: with_faces([[0, 0, 1], [2, 2, 2], [0, 1, 0]]), ACCEPTED, 3),
    "a needle": (lambda: with_faces([[0, 1, len(PART.vertices)]], 0.5 * (PART.vertices[0] + PART.vertices[1])), ANY, 1),
    "faces twice": (lambda: with_faces(PART.faces), ANY, 0),
    "faces wound backwards": (lambda: Mesh(PART.vertices, PART.faces[:, ::-1]), ACCEPTED, 0),
    "half of the faces flipped": (lambda: flipped_half(), ACCEPTED, 0),
    "not watertight": (lambda: Mesh(PART.vertices, PART.faces[3:]), ANY, 0),
    "one face in four": (lambda: Mesh(PART.vertices, PART.faces[::4]), ANY, 0),
    "an unused NaN vertex": (lambda: with_faces(np.zeros((0, 3), dtype=int), [[NAN] * 3]), ACCEPTED, 0),
    "an unused vertex at 1e300": (lambda: with_faces(np.zeros((0, 3), dtype=int), [[1e300] * 3]), ACCEPTED, 0),
    "a face as far as 1e9": (lambda: with_far_face(1e9), {"suspect", "failed", UnitsError}, 0),
    "squeezed flat": (lambda: collapsed(2), DOUBTED, None),
    "float32 vertices": (lambda: Mesh(PART.vertices.astype(np.float32), PART.faces), ACCEPTED, 0),
    "unsigned faces": (lambda: Mesh(PART.vertices, PART.faces.astype(np.uint16)), ACCEPTED, 0),
    "read-only": (lambda: Mesh(read_only(PART.vertices), read_only(PART.faces)), ACCEPTED, 0),
    "Fortran order": (lambda: Mesh(np.asfortranarray(PART.vertices), np.asfortranarray(PART.faces)), ACCEPTED, 0),
}

# Meshes that are refused when they are made.
MESHES: dict[str, Entry] = {
    "no faces": (lambda: Mesh(PART.vertices, np.zeros((0, 3), dtype=int)), InputError, "no faces"),
    "no vertices": (lambda: Mesh(np.zeros((0, 3)), [[0, 1, 2]]), InputError, "there are 0"),
    "an index too large": (lambda: with_faces([[0, 1, 10**6]]), InputError, "1000000"),
    "an index below zero": (lambda: with_faces([[0, 1, -1]]), InputError, "-1"),
    "an index of 2^63": (lambda: Mesh(np.eye(3), np.array([[0, 1, 2**63]], dtype=np.uint64)), InputError, "vertices"),
    "indices as floats": (lambda: Mesh(np.eye(3), [[0.0, 1.0, 2.0]]), InputError, "integers"),
    "indices as text": (lambda: Mesh(np.eye(3), [["0", "1", "2"]]), InputError, "integers"),
    "indices as objects": (lambda: Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=object)), InputError, "integers"),
    "indices as booleans": (lambda: Mesh(np.eye(3), [[True, False, True]]), InputError, "integers"),
    "ragged faces": (lambda: Mesh(np.eye(3), [[0, 1, 2], [0, 1]]), InputError, "faces"),
    "faces of four": (lambda: Mesh(np.eye(4)[:, :3], [[0, 1, 2, 3]]), InputError, r"\(f, 3\)"),
    "faces as None": (lambda: Mesh(np.eye(3), None), InputError, "faces"),
    "faces as a number": (lambda: Mesh(np.eye(3), 3), InputError, "faces"),
    "a used NaN vertex": (lambda: with_faces([[0, 1, len(PART.vertices)]], [[NAN] * 3]), InputError, "NaN"),
    "a used infinite vertex": (lambda: with_faces([[0, 1, len(PART.vertices)]], [[INF] * 3]), InputError, "NaN"),
    "no area anywhere": (lambda: Mesh(0.0 * PART.vertices, PART.faces), InputError, "none with an area"),
    "all on one line": (lambda: Mesh(LINE, [[0, 1, 2], [3, 4, 5]]), InputError, "none with an area"),
    "beyond float64's squares": (lambda: Mesh(1e200 * PART.vertices, PART.faces), InputError, ""),
    "below float64's squares": (lambda: Mesh(1e-200 * PART.vertices, PART.faces), InputError, ""),
    "a used vertex at 1e300": (lambda: with_faces([[0, 1, len(PART.vertices)]], [[1e300] * 3]), InputError, ""),
    "vertices of two columns": (lambda: Mesh(np.eye(3)[:, :2], [[0, 1, 2]]), InputError, r"\(n, 3\)"),
    "vertices as text": (lambda: Mesh([["a"] * 3] * 3, [[0, 1, 2]]), InputError, "real numbers"),
    "fewer normals than points": (lambda: PointCloud(SCAN, NORMALS[:-1]), InputError, "one row per point"),
    "normals of two columns": (lambda: PointCloud(SCAN, NORMALS[:, :2]), InputError, r"\(n, 3\)"),
    "normals as text": (lambda: PointCloud(SCAN, "up"), InputError, "real numbers"),
    "all normals zero": (lambda: PointCloud(SCAN, 0.0 * NORMALS), InputError, "leave the normals out"),
    "all normals NaN": (lambda: PointCloud(SCAN, NAN * NORMALS), InputError, "leave the normals out"),
    "a NaN viewpoint": (lambda: PointCloud(SCAN, viewpoint=[0, 0, NAN]), InputError, "viewpoint"),
    "a flat viewpoint": (lambda: PointCloud(SCAN, viewpoint=[0, 0]), InputError, "viewpoint"),
    "a viewpoint of text": (lambda: PointCloud(SCAN, viewpoint="here"), InputError, "viewpoint"),
}


def flipped_half() -> Mesh:
    """Every second face wound backwards."""
    faces = PART.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return Mesh(PART.vertices, faces)


def with_far_face(far: float) -> Mesh:
    """The part and one triangle far away."""
    count = len(PART.vertices)
    return with_faces([[count, count + 1, count + 2]], far + SIZE * np.eye(3))

"""Files from strangers, each with the words that its refusal must hold; None where it may be read in part."""

from __future__ import annotations

import io
import json
import pickle
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from tests.hostile.good_files import (
    MODEL,
    POINTS,
    archive,
    body,
    glb,
    gltf_tree,
    good_files,
    model,
    npy,
    ply,
    text_of,
)

MILLION_MILLION = 10**12


def ply_text(*lines: str, rows: str = "0 0 0\n1 0 0\n0 1 0\n") -> bytes:
    """Text PLY with these header lines."""
    return ("\n".join(["ply", "format ascii 1.0", *lines, "end_header", ""]) + rows).encode()


VERTEX = ("element vertex 3", "property float x", "property float y", "property float z")
FACE = ("element face 1", "property list uchar int vertex_indices")


def ply_binary(*lines: str, rows: bytes) -> bytes:
    """Binary PLY with these header lines."""
    return "\n".join(["ply", "format binary_little_endian 1.0", *lines, "end_header", ""]).encode() + rows


def pcd_text(rows: str = "0 0 0\n1 0 0\n0 1 0\n", **entries: str) -> bytes:
    """Text PCD; entries replace or add header lines, an empty one leaves it out."""
    lines = {
        "VERSION": "0.7",
        "FIELDS": "x y z",
        "SIZE": "4 4 4",
        "TYPE": "F F F",
        "COUNT": "1 1 1",
        "WIDTH": "3",
        "HEIGHT": "1",
        "POINTS": "3",
        "DATA": "ascii",
    } | entries
    return ("# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in lines.items() if value) + rows).encode()


def gltf(change: Callable[[dict[str, Any]], object]) -> bytes:
    """Binary glTF with a changed tree."""
    tree, content = gltf_tree()
    change(tree)
    return glb(tree, content)


def e57_header(text: bytes = b"<e57Root/>", start: int = 48, page: int = 1024) -> bytes:
    """E57 with a header of one's own, and a description behind it."""
    head = b"ASTM-E57" + struct.pack("<IIQQQQ", 1, 0, 1024, start, len(text), page)
    return (head + text).ljust(1024, b"\0")


def las_header(points: int = 0, records: int = 0) -> bytes:
    """LAS 1.4 of points in format 6, with nothing behind the header."""
    head = bytearray(375)
    head[:4], head[24:26] = b"LASF", b"\x01\x04"
    struct.pack_into("<HIIBH", head, 94, 375, 375, records, 6, 30)
    struct.pack_into("<6d", head, 131, 1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0)
    struct.pack_into("<Q", head, 247, points)
    return bytes(head)


def npy_header(text: str, content: bytes = b"") -> bytes:
    """NumPy file with a header of one's own."""
    line = text.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(line)) + line + content


class Harmful:
    """Unpickled, it would leave a mark."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return (exec, ("raise SystemExit('a file was run')",))


def pickled() -> bytes:
    """NumPy file of an object."""
    stream = io.BytesIO()
    np.save(stream, np.array([Harmful()], dtype=object), allow_pickle=True)
    return stream.getvalue()


def stl_of(count: int, content: bytes = b"") -> bytes:
    """Binary STL that promises so many triangles."""
    return b"part".ljust(80) + struct.pack("<I", count) + content


def doubled(levels: int) -> bytes:
    """3MF whose every object holds the last one twice."""
    made = body(1)
    for k in range(2, levels + 2):
        parts = f'<component objectid="{k - 1}"/>' * 2
        made += f'<object id="{k}" type="model"><components>{parts}</components></object>'
    return model(made, f'<item objectid="{levels + 1}"/>')


def xml_bomb() -> str:
    """Entities of entities."""
    lines = ['<!ENTITY a0 "0">'] + [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10)]
    return f'<?xml version="1.0"?><!DOCTYPE model [{"".join(lines)}]><model unit="&a9;"></model>'


TRIANGLE = struct.pack("<3f", 0, 0, 1) + struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + b"\0\0"
NAN_TRIANGLE = struct.pack("<3f", 0, 0, 1) + struct.pack("<9f", float("nan"), *[0.0] * 8) + b"\0\0"
GOOD = good_files()

# Large ones are made when they are asked for.
BAD_FILES: dict[str, tuple[str, bytes | Callable[[], bytes], str | None]] = {
    # Nothing, and what the name does not say.
    "empty": ("a.ply", b"", "0 bytes"),
    "one byte": ("a.ply", b"p", "begins with"),
    "no extension": ("scan", b"1 2 3\n", "extension"),
    "unknown extension": ("scan.xyzzy", b"1 2 3\n", "xyzzy"),
    "a STEP file named iges": ("part.iges", b"ISO-10303-21;", "STL"),
    "a scan of Faro": ("scan.fls", b"Faro", "E57"),
    "e57 of its first bytes": ("scan.e57", b"ASTM-E57", "header"),
    "e57 with pages of four bytes": ("scan.e57", e57_header(page=4), "header"),
    "e57 with a description beyond the end": ("scan.e57", e57_header(start=10**9), "header"),
    "e57 with entities": ("scan.e57", e57_header(b'<!DOCTYPE a [<!ENTITY b SYSTEM "secret.bin">]>'), "entities"),
    "e57 of other bytes": ("scan.e57", b"1 2 3\n" * 200, "header"),
    "las of its first bytes": ("scan.las", b"LASF", "header"),
    "las of many records": ("scan.las", las_header(records=2**32 - 1), "records"),
    "las of many points": ("scan.las", las_header(points=2**40), "promise"),
    "las without points": ("scan.las", las_header(), "no points"),
    "laz of other bytes": ("scan.laz", b"1 2 3\n" * 200, "header"),
    "kitti cut short": ("a.bin", bytes(30), "16 bytes"),
    "kitti of other numbers": ("a.bin", bytes(range(64, 112)), "coordinates up to"),
    "kitti of NaN": ("a.bin", b"\xff" * 32, "NaN"),
    "pts without a count": ("a.pts", b"0 0 0\n1 0 0\n", "number of points"),
    "pts of a million million": ("a.pts", b"1000000000000\n0 0 0\n", "1 rows"),
    "pts of an absurd count": ("a.pts", b"9" * 5000 + b"\n0 0 0\n", "1 rows"),
    "pts of two columns": ("a.pts", b"2\n0 0\n1 0\n", "2 numbers"),
    "pts of no block": ("a.pts", b"0\n0\n", "no points"),
    "ply named stl": ("a.stl", GOOD["ply mesh little"][1], "PLY file"),
    "stl named ply": ("a.ply", GOOD["stl binary"][1], "begins with"),
    "npz named npy": ("a.npy", GOOD["npz"][1], "zip archive"),
    "pcd named xyz": ("a.xyz", GOOD["pcd text"][1], "PCD"),
    "glb named obj": ("a.obj", GOOD["glb"][1], "glTF"),
    "a picture named ply": ("a.ply", b"\x89PNG\r\n\x1a\n" + bytes(64), "PNG"),
    "a web page named stl": ("a.stl", b"<!DOCTYPE html><html></html>", "web page"),
    "an LFS pointer": ("a.ply", b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "zeros named npy": ("a.npy", bytes(4096), "no plain array"),
    "noise named ply": ("a.ply", np.random.default_rng(0).bytes(4096), "begins with"),
    "noise named npz": ("a.npz", np.random.default_rng(0).bytes(4096), "archive"),
    "noise named 3mf": ("a.3mf", np.random.default_rng(0).bytes(4096), "archive"),
    "noise named glb": ("a.glb", np.random.default_rng(0).bytes(4096), "JSON"),
    "noise named obj": ("a.obj", np.random.default_rng(0).bytes(4096), ""),
    "noise named off": ("a.off", np.random.default_rng(0).bytes(4096), "begins"),
    "noise named csv": ("a.csv", np.random.default_rng(0).bytes(4096), "binary data"),
    "UTF-16 text": ("a.xyz", "1 2 3\n4 5 6\n".encode("utf-16"), "UTF-16"),
    # PLY.
    "ply of 10^12 points, binary": (
        "a.ply",
        ply_binary(f"element vertex {MILLION_MILLION}", *VERTEX[1:], rows=bytes(36)),
        "1000000000000 vertex rows",
    ),
    "ply of 10^12 points, text": (
        "a.ply",
        ply_text(f"element vertex {MILLION_MILLION}", *VERTEX[1:]),
        "1000000000000 vertex rows",
    ),
    "ply of 10^12 faces, text": (
        "a.ply",
        ply_text(*VERTEX, f"element face {MILLION_MILLION}", FACE[1]),
        "1000000000000 face rows",
    ),
    "ply of 10^12 faces, binary": (
        "a.ply",
        ply_binary(*VERTEX, f"element face {MILLION_MILLION}", FACE[1], rows=bytes(36)),
        "1000000000000 face rows",
    ),
    "ply of 10^12 rows of nothing": (
        "a.ply",
        ply_text(f"element junk {MILLION_MILLION}", *VERTEX),
        "0 vertex lines",
    ),
    "ply of 10^400 points": ("a.ply", ply_text(f"element vertex {10**400}", *VERTEX[1:]), "rows"),
    "ply of 10^5000 points": ("a.ply", ply_text(f"element vertex {'9' * 5000}", *VERTEX[1:]), "header line"),
    "ply of -1 points": ("a.ply", ply_text("element vertex -1", *VERTEX[1:]), "header line"),
    "ply of no points": ("a.ply", ply_text("element vertex 0", *VERTEX[1:]), "no points"),
    "ply of 1.5 points": ("a.ply", ply_text("element vertex 1.5", *VERTEX[1:]), "header line"),
    "ply without an end": ("a.ply", b"ply\nformat ascii 1.0\n", "end_header"),
    "ply without format": ("a.ply", b"ply\n" + "\n".join([*VERTEX, "end_header\n"]).encode(), "format"),
    "ply of format 17": ("a.ply", b"ply\nformat middle_endian 1.0\nend_header\n", "header line"),
    "ply without x": ("a.ply", ply_text("element vertex 3", "property float y", rows="1\n2\n3\n"), "x, y and z"),
    "ply of unknown type": ("a.ply", ply_text("element vertex 3", "property quad x"), "header line"),
    "ply with a property of nothing": ("a.ply", ply_text("property float x", *VERTEX), "header line"),
    "ply with words for numbers": ("a.ply", ply_text(*VERTEX, rows="a b c\n" * 3), "could not convert"),
    "ply with short rows": ("a.ply", ply_text(*VERTEX, rows="0 0 0\n1 0\n0 1 0.0\n"), "as many numbers"),
    "ply with NaN points only": ("a.ply", ply_text(*VERTEX, rows="nan nan nan\n" * 3), "all NaN"),
    "ply with one NaN point": ("a.ply", ply_text(*VERTEX, rows="0 0 0\nnan 0 0\n0 1 0\n"), None),
    "ply with a NaN vertex": ("a.ply", ply_text(*VERTEX, *FACE, rows="0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n"), "NaN"),
    "ply with a face to 7": ("a.ply", ply_text(*VERTEX, *FACE, rows="0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"), "vertex 7"),
    "ply with a face to -1": ("a.ply", ply_text(*VERTEX, *FACE, rows="0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n"), "vertex -1"),
    "ply with a face to 10^30": (
        "a.ply",
        ply_text(*VERTEX, *FACE, rows=f"0 0 0\n1 0 0\n0 1 0\n3 0 1 {10**30}\n"),
        "64 bits",
    ),
    "ply with a face of 10^12 corners": (
        "a.ply",
        ply_text(*VERTEX, *FACE, rows=f"0 0 0\n1 0 0\n0 1 0\n{MILLION_MILLION} 0 1 2\n"),
        "face line",
    ),
    "ply with a face of -3 corners": (
        "a.ply",
        ply_text(*VERTEX, *FACE, rows="0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n"),
        "face line|no faces",
    ),
    "ply with a face of two": ("a.ply", ply_text(*VERTEX, *FACE, rows="0 0 0\n1 0 0\n0 1 0\n2 0 1\n"), "no faces"),
    "ply with a binary face of 2^32 corners": (
        "a.ply",
        ply_binary(*VERTEX, FACE[0], "property list uint int vertex_indices", rows=bytes(36) + b"\xff" * 4 + bytes(12)),
        "ends within its faces",
    ),
    "ply with a binary face of -1 corners": (
        "a.ply",
        ply_binary(*VERTEX, FACE[0], "property list int int vertex_indices", rows=bytes(36) + b"\xff" * 4 + bytes(12)),
        "ends within its faces",
    ),
    "ply with float indices": (
        "a.ply",
        ply_text(*VERTEX, FACE[0], "property list uchar float vertex_indices", rows="0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        "vertex indices",
    ),
    "ply with lists of float length": (
        "a.ply",
        ply_text(*VERTEX, FACE[0], "property list float int vertex_indices"),
        "header line",
    ),
    "ply with strips": (
        "a.ply",
        ply_text(
            *VERTEX,
            "element tristrips 1",
            "property list int int vertex_indices",
            rows="0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        ),
        "strips",
    ),
    "ply with x twice": (
        "a.ply",
        ply_text(*VERTEX, "property float x", rows="0 0 0 9\n1 0 0 9\n0 1 0 9\n"),
        None,
    ),
    "ply with a header of a megabyte": ("a.ply", b"ply\nformat ascii 1.0\n" + b"comment a\n" * 200_000, "end_header"),
    "ply with letters beyond ASCII": (
        "a.ply",
        ply("ascii", faces=False).replace(b"units mm", "größe".encode()),
        None,
    ),
    "ply with a null byte": ("a.ply", ply_text(*VERTEX, rows="0 0 0\n1 0 \0\n0 1 0\n"), "binary data"),
    # PCD.
    "pcd of 10^12 points": (
        "a.pcd",
        pcd_text(WIDTH=str(MILLION_MILLION), POINTS=str(MILLION_MILLION)),
        "1000000000000 points",
    ),
    "pcd of 10^12 binary points": (
        "a.pcd",
        pcd_text(WIDTH=str(MILLION_MILLION), POINTS=str(MILLION_MILLION), DATA="binary"),
        "1000000000000 points",
    ),
    "pcd with a count of 10^12": (
        "a.pcd",
        pcd_text(COUNT=f"1 1 {MILLION_MILLION}", DATA="binary"),
        "3 points but only",
    ),
    "pcd with a count of 0": ("a.pcd", pcd_text(COUNT="1 1 0"), "COUNT 0"),
    "pcd with a count of 10^5000": ("a.pcd", pcd_text(COUNT=f"1 1 {'9' * 5000}"), ""),
    "pcd of 10^5000 points": ("a.pcd", pcd_text(POINTS="9" * 5000), ""),
    "pcd without DATA": ("a.pcd", b"# .PCD v0.7\nFIELDS x y z\n", "DATA"),
    "pcd without FIELDS": ("a.pcd", pcd_text(FIELDS=""), "FIELDS"),
    "pcd without x": ("a.pcd", pcd_text(FIELDS="u v w"), "x, y and z"),
    "pcd with fewer sizes": ("a.pcd", pcd_text(SIZE="4 4"), "as many of each"),
    "pcd of size 3": ("a.pcd", pcd_text(SIZE="4 4 3"), "SIZE 3"),
    "pcd of type Z": ("a.pcd", pcd_text(TYPE="F F Z"), "TYPE Z"),
    "pcd of another grid": ("a.pcd", pcd_text(WIDTH="2"), "grid"),
    "pcd in an unknown coding": ("a.pcd", pcd_text(DATA="zip"), "DATA zip"),
    "pcd with words": ("a.pcd", pcd_text("a b c\n" * 3), "could not convert"),
    "pcd with a viewpoint of NaN": ("a.pcd", pcd_text(VIEWPOINT="nan 0 0 1 0 0 0"), "VIEWPOINT"),
    "pcd with half a viewpoint": ("a.pcd", pcd_text(VIEWPOINT="0 0 1"), "VIEWPOINT"),
    "pcd with a viewpoint at 1e300": ("a.pcd", pcd_text(VIEWPOINT="1e300 0 0 1 0 0 0"), None),
    "pcd with NaN points only": ("a.pcd", pcd_text("nan nan nan\n" * 3), "all NaN"),
    "pcd that unpacks to 4 GB": (
        "a.pcd",
        pcd_text("", WIDTH="357913941", POINTS="357913941", DATA="binary_compressed")
        + struct.pack("<II", 16, 357913941 * 12)
        + bytes(16),
        "compressed bytes",
    ),
    "pcd of compressed noise": (
        "a.pcd",
        pcd_text("", DATA="binary_compressed") + struct.pack("<II", 40, 36) + np.random.default_rng(1).bytes(40),
        None,
    ),
    # Text.
    "xyz of words": ("a.xyz", b"one two three\n", "no row of numbers"),
    "xyz of two columns": ("a.xyz", b"1 2\n3 4\n", "2 columns"),
    "xyz of seven columns": ("a.xyz", b"1 2 3 4 5 6 7\n", "7 columns"),
    "xyz of growing rows": ("a.xyz", b"1 2 3\n1 2 3 4\n", "as many numbers"),
    "xyz with colours": ("a.xyz", b"1 2 3 200 100 50\n" * 5, "columns 4 to 6"),
    "xyz beyond float64": ("a.xyz", b"1e999 0 0\n0 1 0\n1 0 0\n", None),
    "xyz of one endless line": ("a.xyz", b"1 " * 100_000, "100000 columns"),
    "xyz of hex numbers": ("a.xyz", b"0x10 0x20 0x30\n", "no row of numbers"),
    "xyz of underscores": ("a.xyz", b"1_0 2_0 3_0\n1_0 2_0 4_0\n", ""),
    "csv of other columns": ("a.csv", b"a,b,c\n1,2,3\n", "x, y and z"),
    "csv with x twice": ("a.csv", b"x,x,y,z\n1,2,3,4\n", None),
    "csv with fewer names": ("a.csv", b"x,y,z\n1,2,3,4\n", "3 column names"),
    "csv of names alone": ("a.csv", b"x,y,z\n", "no row of numbers"),
    "csv with gaps": ("a.csv", b"x,y,z\n1,2,3\n,2,\n3,4,5\n", None),
    "csv of formulas": ("a.csv", b"x,y,z\n=cmd|' /C calc'!A0,2,3\n1,2,3\n", ""),
    # NumPy.
    "npy of objects": ("a.npy", pickled(), "no plain array"),
    "npy of pickle alone": ("a.npy", pickle.dumps(Harmful()), "no plain array"),
    "npy of 10^12 rows": (
        "a.npy",
        npy_header(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({MILLION_MILLION}, 3), }}"),
        "no plain array",
    ),
    "npy of -1 rows": (
        "a.npy",
        npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3), }", bytes(240)),
        "",
    ),
    "npy of code": ("a.npy", npy_header("__import__('os').abort()"), "no plain array"),
    "npy of deep brackets": ("a.npy", npy_header("(" * 9_000), "no plain array"),
    "npy of complex": ("a.npy", npy(np.zeros((4, 3), dtype=complex)), "complex"),
    "npy of text": ("a.npy", npy(np.full((4, 3), "a")), "type <U1"),
    "npy of dates": ("a.npy", npy(np.zeros((4, 3), dtype="datetime64[s]")), "datetime"),
    "npy of booleans": ("a.npy", npy(np.zeros((4, 3), dtype=bool)), "bool"),
    "npy of one axis": ("a.npy", npy(np.zeros(12)), "shape"),
    "npy of three axes": ("a.npy", npy(np.zeros((2, 2, 3))), "shape"),
    "npy of no rows": ("a.npy", npy(np.zeros((0, 3))), "no points"),
    "npy of NaN": ("a.npy", npy(np.full((4, 3), np.nan)), "all NaN"),
    "npz without points": ("a.npz", archive(cloud_dot_npy=npy(POINTS)), "an array named points"),
    "npz of objects": ("a.npz", archive(points_dot_npy=pickled()), "no plain array points"),
    "npz that promises 10^12 rows": (
        "a.npz",
        archive(
            points_dot_npy=npy_header(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({MILLION_MILLION}, 3), }}")
        ),
        "promises",
    ),
    "npz of 100 MB of zeros": ("a.npz", lambda: archive(points_dot_npy=npy(np.zeros((4_200_000, 3)))), "unpack"),
    "npz of other normals": (
        "a.npz",
        archive(points_dot_npy=npy(POINTS), normals_dot_npy=npy(POINTS[:5])),
        "shape",
    ),
    "npz with names outside": ("a.npz", archive(__etc__points_dot_npy=npy(POINTS)), "an array named points"),
    # STL, OFF, OBJ.
    "stl of 4 billion triangles": ("a.stl", stl_of(2**32 - 1, TRIANGLE), "promises"),
    "stl of no triangles": ("a.stl", stl_of(0), ""),
    "stl of one NaN triangle": ("a.stl", stl_of(1, NAN_TRIANGLE), "NaN"),
    "stl of one flat triangle": ("a.stl", stl_of(1, bytes(50)), None),
    "stl of words": ("a.stl", b"solid a\nfacet\nendsolid a\n", ""),
    "stl that says solid and is binary": ("a.stl", b"solid".ljust(80) + struct.pack("<I", 5) + TRIANGLE, "promises"),
    "off of 10^12 vertices": ("a.off", f"OFF\n{MILLION_MILLION} 1 0\n0 0 0\n3 0 1 2\n".encode(), ""),
    "off of 10^12 faces": ("a.off", f"OFF\n3 {MILLION_MILLION} 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode(), ""),
    "off without numbers": ("a.off", b"OFF\n", ""),
    "off with a face to 9": ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "range|vertex 9"),
    "off with a face to -1": ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "range|vertex -1"),
    "obj of vertices alone": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", ""),
    "obj with a face to 9": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", ""),
    "obj with a face to 0": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "counted from 1"),
    "obj with a face to 10^30": ("a.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {10**30}\n".encode(), ""),
    "obj of NaN": ("a.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
    "obj with a material elsewhere": (
        "a.obj",
        b"mtllib ../../secret.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        None,
    ),
    # Scenes.
    "glb of another version": ("a.glb", GOOD["glb"][1][:4] + struct.pack("<I", 1) + GOOD["glb"][1][8:], ""),
    "glb with 10^12 numbers": ("a.glb", gltf(lambda t: t["accessors"][0].update(count=MILLION_MILLION)), "promise"),
    "glb with 10^12 zeros": (
        "a.glb",
        gltf(lambda t: t["accessors"].append({"componentType": 5126, "count": MILLION_MILLION, "type": "MAT4"})),
        "promise",
    ),
    "glb with 10^9 zeros": (
        "a.glb",
        gltf(lambda t: t["accessors"].append({"componentType": 5126, "count": 10**9, "type": "MAT4"})),
        "promise",
    ),
    "glb with a count of text": ("a.glb", gltf(lambda t: t["accessors"][0].update(count="8")), "promise"),
    "glb with a count of -1": ("a.glb", gltf(lambda t: t["accessors"][0].update(count=-1)), "promise"),
    "glb with a count of 1e9 as float": ("a.glb", gltf(lambda t: t["accessors"][0].update(count=1e9)), "promise"),
    "glb without accessors": ("a.glb", gltf(lambda t: t.pop("accessors")), ""),
    "glb with a list for a tree": ("a.glb", glb([], b""), "JSON"),  # type: ignore[arg-type]
    "glb with deep JSON": (
        "a.glb",
        b"glTF" + struct.pack("<III", 2, 200_020, 200_000) + b"JSON" + b"[" * 200_000,
        "JSON",
    ),
    "glb with a node in itself": ("a.glb", gltf(lambda t: t["nodes"][0].update(children=[0])), None),
    "glb with nodes in a ring": (
        "a.glb",
        gltf(lambda t: t.update(nodes=[{"mesh": 0, "children": [1]}, {"children": [0], "mesh": 0}])),
        None,
    ),
    "glb with a body placed 20,000 times": (
        "a.glb",
        gltf(lambda t: t.update(nodes=[{"mesh": 0}] * 20_000, scenes=[{"nodes": list(range(20_000))}])),
        None,
    ),
    "glb with a NaN placement": (
        "a.glb",
        gltf(lambda t: t["nodes"][0].update(matrix=[float("nan")] * 16)),
        "",
    ),
    "glb with a flat placement": ("a.glb", gltf(lambda t: t["nodes"][0].update(scale=[0, 0, 0])), None),
    "glb that names a file outside": (
        "a.glb",
        gltf(lambda t: t["buffers"][0].update(uri="../secret.bin")),
        "its own folder",
    ),
    "gltf that names a file outside": ("a.gltf", json.dumps(gltf_tree("../secret.bin")[0]).encode(), "own folder"),
    "gltf that hides the dots": ("a.gltf", json.dumps(gltf_tree("%2e%2e/secret.bin")[0]).encode(), "own folder"),
    "gltf that names an absolute file": ("a.gltf", json.dumps(gltf_tree("/etc/passwd")[0]).encode(), "own folder"),
    "gltf that names an address": ("a.gltf", json.dumps(gltf_tree("http://localhost/a")[0]).encode(), "own folder"),
    "gltf that names file:": ("a.gltf", json.dumps(gltf_tree("file:///etc/passwd")[0]).encode(), "own folder"),
    "gltf that names a missing file": ("a.gltf", json.dumps(gltf_tree("gone.bin")[0]).encode(), "no file is"),
    "gltf that names its folder": ("a.gltf", json.dumps(gltf_tree(".")[0]).encode(), "no file is"),
    "gltf that names a null character": ("a.gltf", json.dumps(gltf_tree("a\0b")[0]).encode(), ""),
    "gltf that names itself": ("a.gltf", json.dumps(gltf_tree("a.gltf")[0]).encode(), ""),
    "3mf without a model": ("a.3mf", archive(a_dot_txt="hello"), ""),
    "3mf with entities": ("a.3mf", archive(**{"3D__3dmodel_dot_model": xml_bomb()}), "entities"),
    "3mf with a file for an entity": (
        "a.3mf",
        archive(
            **{
                "3D__3dmodel_dot_model": '<!DOCTYPE m [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
                f"{MODEL}<resources>&e;</resources></model>"
            }
        ),
        "entities",
    ),
    "3mf doubled thirty times": ("a.3mf", doubled(30), "expand"),
    "3mf doubled a thousand times": ("a.3mf", doubled(1_000), "100 deep"),
    "3mf of an object in itself": (
        "a.3mf",
        model('<object id="1"><components><component objectid="1"/></components></object>', '<item objectid="1"/>'),
        "contain themselves",
    ),
    "3mf of a missing object": ("a.3mf", model(body(), '<item objectid="7"/>'), ""),
    "3mf without build": ("a.3mf", model(body(), ""), ""),
    "3mf of broken XML": ("a.3mf", archive(**{"3D__3dmodel_dot_model": MODEL + "<resources>"}), "cannot be read"),
    "3mf of text coordinates": (
        "a.3mf",
        model(body().replace('x="1.5"', 'x="wide"'), '<item objectid="1"/>'),
        "",
    ),
    "3mf of 100 MB of spaces": (
        "a.3mf",
        lambda: archive(**{"3D__3dmodel_dot_model": MODEL + " " * 10**8}),
        "unpack",
    ),
}
assert len(text_of(POINTS))


@cache
def bytes_of(name: str) -> bytes:
    content = BAD_FILES[name][1]
    return content() if callable(content) else content

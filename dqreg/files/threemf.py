"""3MF files: the objects of the build, each in its place.

Not read with trimesh, which (5.2) drops all but one item of a part number, reads supports as the part and a model again
for each component that names it.
"""

from __future__ import annotations

import dataclasses
import zipfile
import zlib
from array import array
from pathlib import Path
from xml.parsers import expat

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.units import UNIT_WORDS
from dqreg.files.untrusted import MAX_DEPTH, max_faces, require_safe_archive, unreadable

# Objects that are printed but are no part of the part.
SUPPORTS = ("support", "solidsupport", "other")
# Extensions that leave the surface where it is; lattices, slices and implicit bodies do not.
KNOWN_EXTENSIONS = ("/material/", "/production/")
# Places that objects may have, at some ten microseconds each.
MOST_PLACES = 100_000
# (file, id): an object, for other files of the archive count anew.
Name = tuple[str, str]


@dataclasses.dataclass
class _Object:
    """One object: its triangles, and the objects it is made of, each with its place."""

    kind: str
    vertices: array[float] = dataclasses.field(default_factory=lambda: array("d"))
    faces: array[int] = dataclasses.field(default_factory=lambda: array("q"))
    parts: list[tuple[Name, str | None]] = dataclasses.field(default_factory=list)


def read_3mf(path: Path) -> MeshData:
    """Mesh of a 3MF file: all its items, without supports."""
    require_safe_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            models = _read_models(path, archive)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise unreadable(path, f"a damaged archive ({error})", "a whole .3mf file") from error
    vertices, faces = _unfolded(path, models)
    return make_mesh(path, vertices, faces, models.unit)


class _Models:
    """What the models of one archive say."""

    def __init__(self, path: Path) -> None:
        self.path, self.file = path, ""
        self.unit: str | None = "mm"
        self.objects: dict[Name, _Object] = {}
        self.items: list[tuple[Name, str | None]] = []
        self.wanted: list[str] = []
        self._spaces: dict[str, str] = {}
        self._inside: _Object | None = None
        # Empty elements pack to a fiftieth of a byte each, and take as long to read as a triangle.
        self._elements, self._most = 0, 2 * max_faces(path)

    def parse(self, file: str, archive: zipfile.ZipFile, name: str) -> None:
        """Read one model."""
        self.file = file
        parser = expat.ParserCreate(namespace_separator="}")
        # The standard forbids document types, and with them all entities.
        parser.StartDoctypeDeclHandler = self._refuse_document_type
        parser.StartNamespaceDeclHandler = self._declare
        parser.StartElementHandler = self._start
        try:
            with archive.open(name) as stream:
                parser.ParseFile(stream)
        except (expat.ExpatError, LookupError, ValueError, OverflowError) as error:
            if type(error).__module__.startswith("dqreg"):
                raise
            found = f"a model that cannot be read ({type(error).__name__}: {error})"
            raise unreadable(self.path, found, "a whole .3mf file") from error

    def _refuse_document_type(self, *_: object) -> None:
        raise unreadable(self.path, "XML with a document type or entities", "a 3MF model, which has none")

    def _declare(self, prefix: str | None, uri: str) -> None:
        self._spaces[prefix or ""] = uri

    def _start(self, element: str, values: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > self._most:
            found = f"more than {self._most} elements in a file of {self.path.stat().st_size} bytes"
            raise unreadable(self.path, found, "as many as its vertices and triangles take")
        kind = element.rpartition("}")[2]
        inside = self._inside
        if kind == "vertex" and inside is not None:
            inside.vertices.extend((float(values["x"]), float(values["y"]), float(values["z"])))
        elif kind == "triangle" and inside is not None:
            inside.faces.extend((int(values["v1"]), int(values["v2"]), int(values["v3"])))
        elif kind == "object":
            self._inside = _Object(values.get("type", "model"))
            if self.objects.setdefault((self.file, values["id"]), self._inside) is not self._inside:
                raise unreadable(self.path, f"two objects {values['id']!r}", "one object of each id")
        elif kind == "component" and inside is not None:
            inside.parts.append((self._name(values), values.get("transform")))
        elif kind == "item" and not self.file:
            self.items.append((self._name(values), values.get("transform")))
        elif kind == "model":
            self._open(values)

    def _name(self, values: dict[str, str]) -> Name:
        place = next((value for key, value in values.items() if key.endswith("}path")), None)
        file = self.file if place is None else place.strip("/").lower()
        self.wanted.append(file)
        return file, values["objectid"]

    def _open(self, values: dict[str, str]) -> None:
        needed = [self._spaces.get(prefix, prefix) for prefix in values.get("requiredextensions", "").split()]
        unknown = [uri for uri in needed if not any(known in uri for known in KNOWN_EXTENSIONS)]
        if unknown:
            raise unreadable(self.path, f"the 3MF extension {', '.join(unknown)}", "objects of triangles")
        if not self.file:
            self.unit = UNIT_WORDS.get(values.get("unit", "millimeter"))


def _read_models(path: Path, archive: zipfile.ZipFile) -> _Models:
    names = {name.strip("/").lower(): name for name in archive.namelist()}
    root = next((name for name in names if name.endswith("3d/3dmodel.model")), None)
    if root is None:
        raise unreadable(path, "an archive without 3D/3dmodel.model", "a whole .3mf file")
    models = _Models(path)
    models.parse("", archive, names[root])
    # Each other file is read once, however many components name it.
    read = {"", root}
    for file in models.wanted:
        if file not in read:
            read.add(file)
            if file not in names:
                raise unreadable(path, f"an object of {file!r}, which is not in the archive", "a whole .3mf file")
            models.parse(file, archive, names[file])
    return models


def _unfolded(path: Path, models: _Models) -> tuple[FloatArray, IntArray]:
    all_vertices, all_faces, count, size = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0, 0
    waiting = [(name, _placement(path, text), 0) for name, text in reversed(models.items)]
    steps = 0
    while waiting:
        name, (turn, shift), depth = waiting.pop()
        body = models.objects.get(name)
        if body is None:
            raise unreadable(path, f"a place for the object {name[1]!r}, which is not there", "a whole .3mf file")
        if body.kind in SUPPORTS:
            continue
        steps, size = steps + 1 + len(body.parts), size + (len(body.faces) + len(body.vertices)) // 3
        if depth > MAX_DEPTH:
            found = f"objects that contain themselves or expand {MAX_DEPTH} deep"
            raise unreadable(path, found, "objects made of others")
        if size > max_faces(path) or steps > MOST_PLACES:
            raise unreadable(path, "objects that expand to more than a million", "a part")
        if len(body.faces):
            # What overflows is refused with the mesh, as a vertex that is not finite.
            with np.errstate(over="ignore", invalid="ignore"):
                vertices = np.array(body.vertices).reshape(-1, 3) @ turn + shift
            faces = np.array(body.faces, dtype=np.int64).reshape(-1, 3)
            # An index outside its own body must not land in the next one.
            invalid = (faces < 0) | (faces >= len(vertices))
            with np.errstate(over="ignore", invalid="ignore"):
                mirrored = np.linalg.det(turn) < 0.0
            all_faces.append(np.where(invalid, -1, faces + count)[:, :: -1 if mirrored else 1])
            all_vertices.append(vertices)
            count += len(vertices)
        for part, text in reversed(body.parts):
            inner, moved = _placement(path, text)
            with np.errstate(over="ignore", invalid="ignore"):
                waiting.append((part, (inner @ turn, moved @ turn + shift), depth + 1))
    return np.concatenate(all_vertices), np.concatenate(all_faces)


def _placement(path: Path, text: str | None) -> tuple[FloatArray, FloatArray]:
    # Rows of numbers that stand behind a row vector.
    if text is None:
        return np.eye(3), np.zeros(3)
    try:
        numbers = np.array([float(word) for word in text.split()], dtype=np.float64).reshape(4, 3)
    except ValueError:
        numbers = np.full((4, 3), np.nan)
    if not np.isfinite(numbers).all():
        raise unreadable(path, f"the placement {text[:60]!r}", "twelve finite numbers")
    return numbers[:3], numbers[3]

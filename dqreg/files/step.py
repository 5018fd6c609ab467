"""STEP files: exact surfaces, cut into triangles as finely as asked, each with the face that it is of.

OpenCASCADE reads them (package cascadio). Damaged files end it by a segmentation fault or keep it busy for ever, so it
runs in a process of its own, with limits of time and memory.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import signal
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import MissingDependencyError
from dqreg.files.limited_process import run_limited
from dqreg.files.mesh_data import MeshData, make_mesh
from dqreg.files.units import METRES, UNIT_WORDS
from dqreg.files.untrusted import max_faces, unreadable

# Largest distance of a triangle from its surface, in sizes of the part: below the noise of any optical scanner.
CHORD_DIAGONALS = 1e-5
# Largest turn between the normals of neighbouring triangles, radians.
MAX_TURN_RAD = 0.25
# The size by the points of the file may be off by that factor before the triangles are made anew.
MAX_GUESS_RATIO = 3.0
# Statements of surfaces that curve both ways: their triangles are as many as the chord is short, and OpenCASCADE's time
# for one torus or sphere grows with the third power of them (50,000: 1 s, 115,000: 16 s). They are cut coarsely first,
# and then as finely as these numbers of triangles allow: on one such face, and on all that curve both ways.
CURVED = re.compile(rb"(TOROIDAL|SPHERICAL|SPLINE|UNIFORM|BEZIER|OFFSET)_SURFACE|SURFACE_OF_REVOLUTION")
FIRST_CHORD_DIAGONALS = 2e-4
MOST_ON_ONE, MOST_ON_ALL = 50_000, 200_000
# Cuts at most, and the share of those numbers above which no further cut is worth its time.
MAX_CUTS, ENOUGH_LOAD = 4, 0.5
# Seconds and bytes that a file may take, and those for each of its bytes.
BASE_SECONDS, SECONDS_PER_BYTE = 20.0, 20e-6
BASE_MEMORY_BYTES, MEMORY_PER_BYTE = 2 << 30, 300
# Faces on one cylinder, cone, sphere or torus agree to that share of the part's size: CAD programs cut a hole in two.
SAME_SURFACE = 1e-7
# Bytes of a statement that is searched for, and statements of units that are looked at.
STATEMENT_BYTES, MAX_STATEMENTS = 2_000, 100

# At its start cascadio loads trimesh, three quarters of the time of a small file, and here nothing asks for it.
TESSELLATE = """
import sys
sys.modules["trimesh"] = None
try:
    import cascadio
except ImportError:
    del sys.modules["trimesh"]
    import cascadio
path, out, chord, turn = words
sys.exit(cascadio.step_to_glb(path, out, float(chord), float(turn), include_brep=True))
"""


def read_step(path: Path, chord: float | None = None) -> MeshData:
    """Mesh of a STEP file in the file's own unit, with the faces of its surfaces as regions.

    ``chord`` is the largest distance of a triangle from its surface, in the file's unit; default: 1e-5 of the size. The
    mesh tells which one was kept: surfaces that curve both ways are cut less finely where triangles would be too many.
    """
    if importlib.util.find_spec("cascadio") is None:
        raise MissingDependencyError(
            f"{path}: STEP files are read by cascadio; run: pip install 'dqreg[step]', or export the part as STL"
        )
    data = path.read_bytes()
    if not data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"ISO-10303-21"):
        raise unreadable(path, "no line ISO-10303-21 at its beginning", "a STEP file")
    unit, size = _unit(data), _size(data)
    wanted = chord if chord is not None else CHORD_DIAGONALS * size
    kept = max(wanted, FIRST_CHORD_DIAGONALS * size) if CURVED.search(data) else wanted
    for _ in range(MAX_CUTS):
        mesh, load = _tessellated(path, kept, unit)
        true = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        if chord is None and not true / MAX_GUESS_RATIO < size < MAX_GUESS_RATIO * true:
            size, kept, wanted = true, kept * true / size, CHORD_DIAGONALS * true
        elif kept <= wanted or load > ENOUGH_LOAD:
            break
        else:
            kept = max(wanted, kept * load)
    return mesh


def _tessellated(path: Path, chord: float, unit: str) -> tuple[MeshData, float]:
    """The mesh, and how many triangles lie on surfaces that curve both ways, as a share of those allowed."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "part.glb"
        _run(path, out, chord / float(METRES["mm"] / METRES[unit]))
        bodies = _bodies(path, out)
    vertices, faces, labels, surfaces = _joined(bodies)
    if len(faces) > max_faces(path):
        raise unreadable(path, f"surfaces that take {len(faces)} triangles", f"at most {max_faces(path)}")
    mesh = make_mesh(path, vertices * float(METRES["m"] / METRES[unit]), faces, unit)
    regions = _same_surfaces(mesh.faces, labels, surfaces)
    return MeshData(mesh.vertices, mesh.faces, unit, regions, chord), _load(labels, surfaces)


def _load(labels: IntArray, surfaces: list[StepSurface]) -> float:
    counts = np.bincount(labels, minlength=len(surfaces))
    curved = np.array([surface.kind in ("free", "sphere", "torus") for surface in surfaces])
    ideal = np.array([surface.kind in ("sphere", "torus") for surface in surfaces])
    on_one = float(np.max(counts[ideal], initial=0)) / MOST_ON_ONE
    return max(on_one, float(counts[curved].sum()) / MOST_ON_ALL, 1e-3)


def _run(path: Path, out: Path, chord_mm: float) -> None:
    size = path.stat().st_size
    seconds, memory = BASE_SECONDS + SECONDS_PER_BYTE * size, BASE_MEMORY_BYTES + MEMORY_PER_BYTE * size
    done = run_limited(TESSELLATE, path.resolve(), out, chord_mm, MAX_TURN_RAD, seconds=seconds, memory=memory)
    expected = "a whole STEP file; try to export it anew, or as STL"
    # Both say the same: the limit of processor time, or that of wall time.
    if done is None or -done.returncode in (getattr(signal, "SIGXCPU", None), getattr(signal, "SIGKILL", None)):
        found = f"surfaces that OpenCASCADE does not cut within {chord_mm:.2g} mm in {seconds:.0f} s"
        raise unreadable(path, found, expected)
    if done.returncode or not out.is_file():
        # A negative code is the signal that ended it: out of memory, out of time, or lost in a damaged file.
        found = f"what ends OpenCASCADE by signal {-done.returncode}" if done.returncode < 0 else "no shape in it"
        raise unreadable(path, found, expected)


Body = tuple[FloatArray, Any]


@dataclasses.dataclass(frozen=True)
class StepSurface:
    """What a face of a body is cut out of; ``values`` are those of a round shape, None for all others."""

    body: int
    kind: str
    values: FloatArray | None = None

    def is_same(self, other: StepSurface) -> bool:
        """Whether two faces are cut out of one round surface of one body."""
        a, b = self.values, other.values
        if a is None or b is None or (self.body, self.kind) != (other.body, other.kind) or a.shape != b.shape:
            return False
        return bool(np.abs(a - b).max() <= SAME_SURFACE * max(float(np.abs(a).max()), 1e-3))


def _bodies(path: Path, out: Path) -> list[Body]:
    """Placement, and the body with its faces, of each body of the scene; metres."""
    import cascadio.extension  # noqa: F401  It tells trimesh how faces are written.
    import trimesh

    try:
        scene = trimesh.load_scene(out, process=False, skip_materials=True)
        placed = (scene.graph[node] for node in scene.graph.nodes_geometry)
        bodies = [(np.asarray(pose, dtype=np.float64), scene.geometry[name]) for pose, name in placed]
    except Exception as error:
        # What a parser raises over what a damaged file became means the same to the user.
        found = f"what trimesh cannot parse ({type(error).__name__}: {error})"
        raise unreadable(path, found, "a STEP file of surfaces") from error
    bodies = [(pose, body) for pose, body in bodies if len(getattr(body, "faces", ()))]
    if not bodies:
        raise unreadable(path, "no surface in it", "a STEP file of a part, not of curves or points")
    return bodies


def _joined(bodies: list[Body]) -> tuple[FloatArray, IntArray, IntArray, list[StepSurface]]:
    """All bodies as one, the face of each triangle, and the surface of each face."""
    all_vertices, all_faces, all_labels, count = [], [], [], 0
    surfaces: list[StepSurface] = []
    for number, (pose, body) in enumerate(bodies):
        vertices = np.asarray(body.vertices, dtype=np.float64) @ pose[:3, :3].T + pose[:3, 3]
        faces = np.asarray(body.faces, dtype=np.int64)
        labels = np.asarray(body.face_attributes.get("brep_index", np.zeros(len(faces))), dtype=np.int64)
        known = body.metadata.get("cascadio", {}).get("brep_primitives", [])
        mirrored = np.linalg.det(pose[:3, :3]) < 0.0
        all_vertices.append(vertices)
        all_faces.append(faces[:, :: -1 if mirrored else 1] + count)
        all_labels.append(labels + len(surfaces))
        count += len(vertices)
        primitives = [*known, *[None] * (int(labels.max()) + 1 - len(known))]
        surfaces += [_surface(primitive, number) for primitive in primitives]
    return np.concatenate(all_vertices), np.concatenate(all_faces), np.concatenate(all_labels), surfaces


def _surface(primitive: Any, body: int) -> StepSurface:
    """A face's surface; what is equal for faces that are cut out of one round surface, and for no other."""
    kind = "free" if primitive is None else type(primitive).__name__.lower()
    if kind not in ("cylinder", "cone", "sphere", "torus"):
        return StepSurface(body, kind)
    values = {key: np.atleast_1d(value) for key, value in vars(primitive).items() if not key.startswith("extent")}
    values.pop("face_index", None)
    point = np.asarray(values.pop("origin", values.pop("apex", values.pop("center", None))), dtype=np.float64)
    axis = np.asarray(values.pop("axis", np.zeros(3)), dtype=np.float64)
    if kind == "cylinder":
        point = point - (point @ axis) * axis
    # A cone's reference radius is that of a plane which every face may choose anew.
    values.pop("ref_radius", None)
    # An axis means the same both ways round, but for a cone.
    axis = axis if kind == "cone" or axis[np.argmax(np.abs(axis))] > 0.0 else -axis
    return StepSurface(body, kind, np.concatenate([point, axis, *values.values()]))


def _same_surfaces(faces: IntArray, labels: IntArray, surfaces: list[StepSurface]) -> IntArray:
    """Faces numbered from 0, those that meet on one round surface as one. Shapes: (f, 3), (f,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owners = np.repeat(labels, 3)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    sides, owners = sides[order], owners[order]
    meets = (sides[1:] == sides[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    pairs = np.unique(np.sort(np.column_stack([owners[1:], owners[:-1]])[meets], axis=1), axis=0)
    joined = np.array([pair for pair in pairs.tolist() if surfaces[pair[0]].is_same(surfaces[pair[1]])])
    joined = joined.reshape(-1, 2).astype(np.int64)
    count = len(surfaces)
    graph = coo_array((np.ones(len(joined), dtype=bool), (joined[:, 0], joined[:, 1])), shape=(count, count))
    merged = connected_components(graph, directed=False)[1][labels]
    return np.unique(merged, return_inverse=True)[1].astype(np.int64)


def _unit(data: bytes) -> str:
    """The length unit that the file assigns to its shapes; millimetres where it names none that is known."""
    stated, begin = "mm", 0
    for _ in range(MAX_STATEMENTS):
        begin = data.find(b"LENGTH_UNIT", begin + 1)
        if begin < 0:
            break
        low = max(data.rfind(b";", max(begin - STATEMENT_BYTES, 0), begin), begin - STATEMENT_BYTES)
        words = data[low : data.find(b";", begin, begin + STATEMENT_BYTES)].decode("latin-1")
        named = re.search(r"CONVERSION_BASED_UNIT\s*\(\s*'(\w+)'", words)
        if named is not None:
            # The unit that it is converted to stands in a statement of its own: it is not that of the shapes.
            return UNIT_WORDS.get(named.group(1).lower(), "mm")
        prefix = re.search(r"SI_UNIT\s*\(\s*(\.\w+\.|\$)\s*,\s*\.METRE\.", words)
        if prefix is not None:
            stated = {".MILLI.": "mm", ".CENTI.": "cm", ".MICRO.": "um", "$": "m"}.get(prefix.group(1), "mm")
    return stated


def file_unit(path: Path) -> str:
    """The length unit of a STEP file."""
    return _unit(path.read_bytes())


def _size(data: bytes) -> float:
    """About the size of the part, by the points of its file; file's unit."""
    number = rb"\s*(-?[0-9][-+.0-9eE]{0,30})\s*"
    found = re.findall(rb"CARTESIAN_POINT\s{0,9}\([^(;]{0,200}\(" + number + b"," + number + b"," + number, data)
    points = np.array([[float(x) for x in row] for row in found if all(map(_is_number, row))]).reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return size if 0.0 < size < 1e9 else 100.0


def _is_number(text: bytes) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False

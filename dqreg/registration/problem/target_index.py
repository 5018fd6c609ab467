"""The target as the loop asks it: read, moved near the origin, indexed."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg._records import made_of, remember, remembered
from dqreg.errors import InputError
from dqreg.files.step import CHORD_DIAGONALS, file_unit, read_step
from dqreg.files.units import factor
from dqreg.files.untrusted import require_own_kind, require_readable
from dqreg.geometry import Closest, CloudSurface, Mesh, MeshSurface, PointCloud, Surface, prepare_scan
from dqreg.geometry.mesh_normals import smooth_normals_of
from dqreg.geometry.opening import as_geometry, describe
from dqreg.geometry.sides import without_signs
from dqreg.geometry.unit_check import principal_spreads
from dqreg.geometry.visibility import VisibleSurface, visible_faces
from dqreg.geometry.voxels import DENSE_RATIO, EVENLY_DENSE, VoxelCloud, first_size
from dqreg.kernels.kept import Kept
from dqreg.kernels.threads import Later, until
from dqreg.registration.problem.derived_values import Derived
from dqreg.registration.problem.source import require_spread
from dqreg.registration.problem.strays import Strays, without_strays
from dqreg.search import PairTable
from dqreg.search.near_symmetry import near_flips, near_mirrors
from dqreg.search.periods import near_periods
from dqreg.search.thin_walls import ThinWalls

# Chord of a STEP part, in the noise and in the spacing of its scan: neither shows it.
OF_NOISE, OF_SPACING = 0.1, 0.05
# And in sizes of the part: finer than the first, numbers end; coarser than the second, the shape does.
FINEST, COARSEST = 1e-6, 1e-3
# Points at which planes are fitted for it.
FITTED = 2_000
# What is derived and goes along with a copy: a few numbers that took longer to find than a tree takes to build.
SMALL = ("spreads", "diagonal", "near_rotations", "near_periods", "near_reflections")


@dataclasses.dataclass(frozen=True, eq=False)
class TargetIndex:
    """A target in a frame of its own near the origin: geometry, surface, and what the global search looks up.

    What is derived is built when first needed, the same whoever builds it, and only read from then on.
    """

    geometry: PointCloud | Mesh  # Moved so that ``origin`` is at zero: far-away coordinates cost no digits
    origin: FloatArray  # (3,): Middle of the bounding box in the target's frame
    name: str = ""  # What the caller gave, see `describe`
    # (m, 4): Normals and variances of a cloud's surface where they were fitted before
    fitted: FloatArray | None = dataclasses.field(default=None, repr=False)
    visible: BoolArray | None = dataclasses.field(default=None, repr=False)  # (n,): Faces to ask; None asks all
    strays: Strays | None = None  # What lay far from all other points of a cloud
    _lock: threading.Lock = dataclasses.field(default_factory=threading.Lock, repr=False, compare=False)
    # What is derived of it elsewhere, kept for the next scan; made twice alike where threads meet
    derived: Derived = dataclasses.field(default_factory=Derived, init=False, repr=False, compare=False)
    # Near symmetries while they are found beside
    _flips: Kept[FloatArray] | None = dataclasses.field(default=None, init=False, repr=False, compare=False)
    _evened: dict[tuple[int, float], VoxelCloud] = dataclasses.field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def surface(self) -> Surface:
        """The surface, built once and only read from then on."""
        with self._lock:
            built: Surface | None = remembered(self, "surface")
            if built is not None:
                return built
            surface: Surface
            if isinstance(self.geometry, Mesh):
                seen = self.visible
                surface = MeshSurface(self.geometry) if seen is None else VisibleSurface(self.geometry, seen)
            else:
                surface = CloudSurface(self.geometry, self.fitted)
                if not surface.oriented:
                    # It holds them now; those turned to a viewpoint are others.
                    object.__setattr__(self, "fitted", None)
            surface.closest(np.zeros((1, 3)))  # builds what is built lazily, while only one thread is here
            return surface

    def __getstate__(self) -> dict[str, Any]:
        if self._flips is not None:
            _ = self.near_rotations
        # Locks and Open3D's trees have no copy: what takes long stays, and the rest is built anew when it is asked for.
        kept = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.repr}
        built = remembered(self, "surface")
        fitted = self.fitted
        if isinstance(built, CloudSurface) and built._all_fitted and not built.oriented:
            fitted = built.fitted
        small = {name: value for name in SMALL if (value := remembered(self, name)) is not None}
        return {**kept, **small, "geometry": _without_caches(self.geometry), "fitted": fitted, "visible": self.visible}

    def __setstate__(self, state: dict[str, Any]) -> None:
        remember(self, **state, _lock=threading.Lock(), derived=Derived(), _flips=None, _evened={})

    def build(self) -> TargetIndex:
        """Itself, with all built that registrations ask for; near symmetries, asked for late, beside what follows."""
        self._build_surface()
        mesh, surface = self.geometry, self.surface
        if isinstance(mesh, Mesh) and remembered(self, "near_rotations") is None:
            flips = Kept(lambda: near_flips(mesh, surface))
            remember(self, _flips=flips)
            flips.begin()
        return self

    def _build_surface(self) -> None:
        """What the loop asks for: all but the near symmetries, which are for the answer."""
        mesh = self.geometry
        if not isinstance(mesh, Mesh):
            _ = self.spreads, self.surface
            if isinstance(self.surface, CloudSurface):
                _ = self.surface.normals
            return
        # What both threads ask for comes first; the spreads are waited for by whoever reads the scan.
        _ = mesh.corners, mesh.face_normals
        beside = Later(lambda: (self.spreads, mesh.is_closed, mesh._fans, mesh._moments))
        _ = self.surface
        beside.result()

    def build_beside(self, deadline: float = np.inf, *, judged: bool = True) -> Building:
        """A running thread that builds a mesh: the surface, then what a verdict asks, by a deadline; to be joined."""
        building = Building(self, deadline, judged=judged)
        building.start()
        return building

    def begin_evened(self, count: int) -> Evening:
        """`evened`, made beside the caller where the cloud is dense, once the edge of its cells is known."""
        geometry, known = self.geometry, self._evened.get((count, EVENLY_DENSE))
        if not isinstance(geometry, PointCloud) or len(geometry) <= DENSE_RATIO * count:
            return Evening(0.0, Later(lambda: self.evened(count), beside=False))
        if known is not None:
            return Evening(known.size, Later(lambda: known, beside=False))
        Later(lambda: self.spreads)  # whoever reads the scan asks for them
        return Evening(edge := first_size(geometry, count), Later(lambda: self.evened(count, edge)))

    def evened(self, count: int, size: float | None = None, evenly_dense: float = EVENLY_DENSE) -> VoxelCloud:
        """The cloud as the means of about so many cells, and their surface; built once and only read from then on.

        The size is that of `first_size`, where it is known.
        """
        if not isinstance(self.geometry, PointCloud):
            raise InputError("only a cloud has cells; the target is a mesh")
        with self._lock:
            key = count, evenly_dense
            if key not in self._evened:
                self._evened[key] = VoxelCloud.evened(self.geometry, count, size, evenly_dense=evenly_dense)
            return self._evened[key]

    def visible_from(self, viewpoints: FloatArray) -> TargetIndex:
        """The target with a surface of those faces alone that can be seen from some viewpoints, (k, 3)."""
        if not isinstance(self.geometry, Mesh):
            return self
        visible = visible_faces(self.geometry, viewpoints)
        if visible.all():
            return self
        if not visible.any():
            raise InputError(
                f"no face of the target can be seen from viewpoint at the pose found (it would be at "
                f"{(viewpoints + self.origin).round(6).tolist()} in target coordinates); is it in source coordinates "
                "and source units?"
            )
        return dataclasses.replace(self, visible=visible)

    @cached_property
    def spreads(self) -> FloatArray:
        """Standard deviations along the principal axes, (3,), for the look at units."""
        return principal_spreads(self.geometry)

    def smooth_normals(self, closest: Closest) -> FloatArray:
        """Normals of the smooth surface at places that the surface has named, (n, 3)."""
        if not isinstance(self.geometry, Mesh):
            return closest.normals
        return smooth_normals_of(self.geometry, closest.points, closest.elements, closest.normals)

    @cached_property
    def pairs(self) -> PairTable:
        """Pairs of oriented points that the global search looks up."""
        return PairTable.of(self.geometry, self.surface)

    @cached_property
    def near_rotations(self) -> FloatArray:
        """Rotations that leave most of a part in place, (k, 4, 4); none for a cloud."""
        if self._flips is not None:
            return self._flips.result()
        return near_flips(self.geometry, self.surface) if isinstance(self.geometry, Mesh) else np.zeros((0, 4, 4))

    @cached_property
    def near_periods(self) -> FloatArray:
        """Translations by a period of a part, (k, 4, 4), for scans that do not show its ends; none for a cloud."""
        return near_periods(self.geometry, self.surface) if isinstance(self.geometry, Mesh) else np.zeros((0, 4, 4))

    @cached_property
    def near_reflections(self) -> FloatArray:
        """Reflections that leave most of a part in place, (k, 4, 4); none for a cloud."""
        return near_mirrors(self.geometry, self.surface) if isinstance(self.geometry, Mesh) else np.zeros((0, 4, 4))

    @cached_property
    def thin_walls(self) -> ThinWalls:
        """Thin walls of a closed part, whose sides a scan may confuse."""
        return ThinWalls.of(self.geometry, self.surface) if isinstance(self.geometry, Mesh) else ThinWalls.none()

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box: that of its surface."""
        of = self.geometry
        return of.diagonal if isinstance(of, Mesh) else float(np.linalg.norm(np.subtract(*of._ends)))

    @property
    def units(self) -> str | None:
        """Length unit, where known."""
        return self.geometry.units

    @property
    def kind(self) -> str:
        """What the target is: "mesh" or "cloud"."""
        return "mesh" if isinstance(self.geometry, Mesh) else "cloud"


def _without_caches(geometry: PointCloud | Mesh) -> PointCloud | Mesh:
    # Not through the constructor, which would drop and count again what it finds.
    return made_of(type(geometry), {each.name: getattr(geometry, each.name) for each in dataclasses.fields(geometry)})


def index_target(target: Any) -> TargetIndex:
    """Read a target and move it to its own middle; one that is indexed stays as it is."""
    # A `Target` holds the index.
    target = getattr(target, "indexed", target)
    if isinstance(target, TargetIndex):
        return target
    geometry = as_geometry(target, "target")
    if isinstance(geometry, Mesh):
        return TargetIndex(geometry._shifted(-geometry.centre), geometry.centre, describe(target))
    geometry, strays = without_strays(geometry)
    require_spread(geometry.points, "target")
    origin = 0.5 * np.add(*geometry._ends)
    return TargetIndex(without_signs(geometry)._moved(-origin), origin, describe(target), strays=strays)


def index_for(target: Any, source: Any, source_units: str | None) -> tuple[TargetIndex, float | None]:
    """A target indexed for a scan; a STEP part is cut as finely as the scan can tell: its chord, in the file's unit."""
    if not isinstance(target, (str, os.PathLike)) or Path(target).suffix.lower() not in (".step", ".stp"):
        return index_target(target), None
    part, chord = cut_for(Path(target), source, source_units)
    return dataclasses.replace(index_target(part), name=describe(target)), chord


def cut_for(target: Path, source: Any, source_units: str | None) -> tuple[Mesh, float]:
    """The part of a STEP file for a scan, and the largest distance of its triangles from its surfaces."""
    path = require_readable(target)
    require_own_kind(path, path.suffix.lower())
    scan = as_geometry(source, "source")
    points = scan.points if isinstance(scan, PointCloud) else scan.vertices
    found = prepare_scan(PointCloud(points), FITTED)
    unit, own = file_unit(path), source_units or scan.units
    scale = factor(own, unit) if own is not None else 1.0
    size = float(np.linalg.norm(np.ptp(points, axis=0))) * scale
    wanted = min(OF_NOISE * found.noise, OF_SPACING * found.spacing) * scale or CHORD_DIAGONALS * size
    # The scan's size stands for the part's until that is known.
    chord = float(np.clip(wanted, FINEST * size, COARSEST * size))
    data = read_step(path, chord)
    part = float(np.linalg.norm(np.ptp(data.vertices, axis=0)))
    if not FINEST * part <= chord <= COARSEST * part:
        chord = float(np.clip(chord, FINEST * part, COARSEST * part))
        data = read_step(path, chord)
    # Surfaces that curve both ways may have been cut less finely than asked.
    return Mesh(data.vertices, data.faces, data.units, regions=data.regions), max(chord, data.chord or 0.0)


class Evening(NamedTuple):
    """A cloud that is being evened beside the caller."""

    edge: float  # Edge of its cells, unless they turn out wider; 0 if it has none
    cloud: Later[VoxelCloud]


class Building(threading.Thread):
    """Builds a mesh; the surface is ready before all is."""

    def __init__(self, index: TargetIndex, deadline: float, *, judged: bool) -> None:
        super().__init__(daemon=True)
        self._index, self._deadline, self._judged, self.surface_is_ready = index, deadline, judged, threading.Event()

    def run(self) -> None:
        """Build."""
        # What fails here fails again where it is asked for, in the caller's thread.
        with contextlib.suppress(Exception):
            if isinstance(self._index.geometry, Mesh):
                self._index._build_surface()
                self.surface_is_ready.set()
                with until(self._deadline):
                    _ = (self._index.near_rotations, self._index.thin_walls) if self._judged else None
        self.surface_is_ready.set()

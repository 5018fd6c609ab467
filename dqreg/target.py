"""Source and target as the front door takes them: read, converted, moved near the origin, indexed."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
from functools import cached_property
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, bounds
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.files import CloudData, read_geometry
from dqreg.geometry import Closest, CloudSurface, Mesh, MeshSurface, PointCloud, Surface, as_geometry, sample_mesh
from dqreg.geometry.smooth_normals import SmoothNormals
from dqreg.geometry.unit_mistake import principal_spreads
from dqreg.geometry.units import factor

# Points drawn from a mesh that is the source.
MESH_SAMPLES = 100_000
# Points that are asked first whether they lie on a line.
SPREAD_SAMPLE = 2_000
# A cloud whose second largest extent is below this share of its largest is a line.
LINE = 1e-9
# Of a cloud that is a line for its strays alone, at least this share spans an area.
BODY = 0.9


@dataclasses.dataclass(frozen=True)
class IndexedTarget:
    """A target ready to be asked, in a frame of its own near the origin.

    Attributes
    ----------
    geometry : PointCloud or Mesh
        Moved so that ``origin`` is at zero: far-away coordinates cost no digits.
    origin : ndarray, (3,)
        Middle of the bounding box in the target's frame.
    name : str
        What the caller gave, see `describe`.
    fitted : ndarray, (m, 3), optional
        Normals of a cloud's surface where they were fitted before.
    """

    geometry: PointCloud | Mesh
    origin: FloatArray
    name: str = ""
    fitted: FloatArray | None = dataclasses.field(default=None, repr=False)
    _lock: threading.Lock = dataclasses.field(default_factory=threading.Lock, repr=False, compare=False)

    @cached_property
    def surface(self) -> Surface:
        """The surface, built once and only read from then on."""
        with self._lock:
            if "surface" in self.__dict__:
                built: Surface = self.__dict__["surface"]
                return built
            surface: Surface
            if isinstance(self.geometry, Mesh):
                surface = MeshSurface(self.geometry)
            else:
                surface = CloudSurface(self.geometry, self.fitted)
            surface.closest(np.zeros((1, 3)))  # builds what is built lazily, while only one thread is here
            return surface

    def build(self) -> None:
        """Build now what a registration from a start asks for, so that none of them has to wait for it."""
        found = self.surface.closest(self.surface.centre[None])
        _ = self.spreads, self.smooth_normals(found)
        if isinstance(self.geometry, Mesh):
            _ = self.geometry.face_neighbours, self.geometry.is_closed
        elif isinstance(self.surface, CloudSurface):
            _ = self.surface.normals

    @cached_property
    def spreads(self) -> FloatArray:
        """Standard deviations along the principal axes, (3,), for the look at units."""
        return principal_spreads(self.geometry)

    def smooth_normals(self, closest: Closest) -> FloatArray:
        """Normals of the smooth surface at places that the surface has named, (n, 3)."""
        return closest.normals if self._smooth is None else self._smooth.at(closest.points, closest.elements)

    @cached_property
    def _smooth(self) -> SmoothNormals | None:
        return SmoothNormals(self.geometry) if isinstance(self.geometry, Mesh) else None

    @property
    def units(self) -> str | None:
        """Length unit, where known."""
        return self.geometry.units

    @property
    def kind(self) -> str:
        """What the target is: "mesh" or "cloud"."""
        return "mesh" if isinstance(self.geometry, Mesh) else "cloud"


def read_any(value: Any, name: str) -> PointCloud | Mesh:
    """Geometry of a path or an object.

    Parameters
    ----------
    value : path, array or object
        What the caller gave.
    name : str
        What the caller calls it, for messages.

    Returns
    -------
    PointCloud or Mesh
        Checked geometry.

    Raises
    ------
    InputError
        If it cannot be read or used.
    """
    if not isinstance(value, (str, os.PathLike)):
        return as_geometry(value, name)
    data = read_geometry(value)
    try:
        if isinstance(data, CloudData):
            return PointCloud(data.points, data.normals, data.viewpoint, data.units, data.dropped)
        return Mesh(data.vertices, data.faces, data.units)
    except InputError as error:
        raise InputError(f"{name} {os.fspath(value)}: {error}") from error


def index_target(target: Any) -> IndexedTarget:
    """Read a target and move it to its own middle.

    Parameters
    ----------
    target : path, array or object
        What the caller gave.

    Returns
    -------
    IndexedTarget
        Its trees are built when first asked.

    Raises
    ------
    InputError
        If it cannot be used as a target.
    """
    geometry = read_any(target, "target")
    if isinstance(geometry, Mesh):
        origin = geometry.centre
        return IndexedTarget(
            dataclasses.replace(geometry, vertices=geometry.vertices - origin), origin, describe(target)
        )
    require_spread(geometry.points, "target")
    origin = 0.5 * np.add(*bounds(geometry.points))
    return IndexedTarget(moved(geometry, -origin, 1.0), origin, describe(target))


@dataclasses.dataclass(frozen=True)
class CentredSource:
    """A source in target units, moved near the origin.

    Attributes
    ----------
    cloud : PointCloud
        Points scaled, then moved so that ``origin`` is at zero.
    origin : ndarray, (3,)
        Middle of the bounding box of the scaled source.
    scale : float
        Factor from source units to target units.
    """

    cloud: PointCloud
    origin: FloatArray
    scale: float


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Both sides of a registration, kept so that its result can be looked at: deviations, pictures, reports.

    Attributes
    ----------
    source : CentredSource
        The scan, in target units.
    target : IndexedTarget
        What it was registered to.
    """

    source: CentredSource
    target: IndexedTarget

    @staticmethod
    def read(
        source: Any, target: Any, source_units: str | None = None, target_units: str | None = None, seed: int = 0
    ) -> Inputs:
        """Both sides from whatever `dqreg.register` takes.

        Parameters
        ----------
        source, target : path, array or object
            The scan and the target.
        source_units, target_units : str or None
            As in `centre_source`.
        seed : int
            For sampling a mesh that is the source.

        Returns
        -------
        Inputs
            Read, converted and moved near the origin.

        Raises
        ------
        InputError, UnitsError, DegenerateGeometryError
            If either side cannot be used.
        """
        indexed = index_target(target)
        units = target_units or indexed.units
        return Inputs(centre_source(source, source_units, units, np.random.default_rng(seed)), indexed)


def describe(value: Any) -> str:
    """Name of what a caller gave, for reports: a path as it was written, else the type and the size.

    Parameters
    ----------
    value : path, array or object
        A source or a target.

    Returns
    -------
    str
        A short name.

    Examples
    --------
    >>> describe("part.stl"), describe(np.zeros((10, 3)))
    ('part.stl', 'ndarray of 10')
    """
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    size = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"{type(value).__name__}{size}"


def centre_source(
    source: Any, source_units: str | None, target_units: str | None, rng: np.random.Generator
) -> CentredSource:
    """Read a source, convert its unit, and move it to its own middle.

    Parameters
    ----------
    source : path, array or object
        What the caller gave; a mesh is sampled.
    source_units, target_units : str or None
        Named units win over what a file says; a unit that is not known converts nothing.
    rng : numpy.random.Generator
        For sampling a mesh.

    Returns
    -------
    CentredSource
        Ready to be prepared.

    Raises
    ------
    InputError, UnitsError, DegenerateGeometryError
        If it cannot be used as a source.
    """
    geometry = read_any(source, "source")
    if isinstance(geometry, Mesh):
        geometry = sample_mesh(geometry, MESH_SAMPLES, rng)
    scale = factor(source_units or geometry.units, target_units)
    require_spread(geometry.points, "source")
    origin = 0.5 * scale * np.add(*bounds(geometry.points))
    return CentredSource(moved(geometry, -origin, scale), origin, scale)


def moved(cloud: PointCloud, offset: FloatArray, scale: float) -> PointCloud:
    """The cloud scaled about zero, then shifted.

    Parameters
    ----------
    cloud : PointCloud
        Any cloud.
    offset : ndarray, (3,)
        Shift after scaling.
    scale : float
        Factor.

    Returns
    -------
    PointCloud
        A new cloud.
    """
    viewpoint = None if cloud.viewpoint is None else scale * cloud.viewpoint + offset
    points = cloud.points + offset if scale == 1.0 else scale * cloud.points + offset
    return dataclasses.replace(cloud, points=points, viewpoint=viewpoint)


def require_spread(points: FloatArray, name: str) -> None:
    """Raise unless the points are three at least and not on one line.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Finite points.
    name : str
        What the caller calls them.

    Raises
    ------
    InputError
        If there are fewer than three.
    DegenerateGeometryError
        If they all lie on one line: a turn about it could never be seen.
    """
    if len(points) < 3:
        raise InputError(f"{name} has {len(points)} usable points; at least three are needed to fix a pose")
    # Some points that span an area settle it; only if they do not, all are looked at.
    if len(points) > 2 * SPREAD_SAMPLE:
        with contextlib.suppress(DegenerateGeometryError):
            require_spread(points[:: len(points) // SPREAD_SAMPLE], name)
            return
    centred = points - points.mean(axis=0)
    extents = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred), 0.0))
    # Squaring halves the digits, so what looks like a line is looked at again without it.
    if extents[1] <= 1e-6 * extents[2]:
        extents = np.linalg.svd(centred, compute_uv=False)[::-1]
    rounding = 8.0 * np.finfo(float).eps * np.abs(points).max() * np.sqrt(len(points))
    if extents[1] <= max(LINE * extents[2], rounding):
        raise DegenerateGeometryError(
            f"all {len(points)} points of the {name} lie on one line (spread across it {extents[1]:.3g}, along it "
            f"{extents[2]:.3g}); a turn about that line cannot be determined. {_remedy(points)}"
        )


def _remedy(points: FloatArray) -> str:
    away = np.abs(points - np.median(points, axis=0)).max(axis=1)
    body = points[away <= np.quantile(away, BODY)]
    if len(body) >= 3 and len(body) < len(points):
        with contextlib.suppress(DegenerateGeometryError):
            require_spread(body, "points")
            strays = int(np.count_nonzero(away > 1e3 * np.quantile(away, BODY)))
            return f"Remove the {strays} strays up to {away.max():.3g} from the middle: the others span an area"
    return "Give points that span an area"

"""The source as the loop takes it: read, converted to the target's unit, moved near the origin."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Any, NamedTuple

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.files.units import factor
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.opening import as_geometry
from dqreg.geometry.sides import without_signs
from dqreg.icp.loop import MIN_CORRESPONDENCES
from dqreg.registration.problem.strays import Strays, without_strays

# Points drawn from a mesh that is the source.
MESH_SAMPLES = 100_000
# Points that are asked first whether they lie on a line.
SPREAD_SAMPLE = 250
# A cloud whose second largest extent is below this share of its largest is a line.
LINE = 1e-9
# Of a cloud that is a line for its strays alone, at least this share spans an area.
BODY = 0.9


@dataclasses.dataclass(frozen=True)
class CentredSource:
    """A source in target units, moved near the origin."""

    cloud: PointCloud  # Points scaled, then moved so that ``origin`` is at zero
    origin: FloatArray  # (3,): Middle of the bounding box of the scaled source
    scale: float  # Factor from source units to target units, and what else was asked for
    mesh: Mesh | None = None  # The mesh that the points were drawn from, as it was given
    unsided: FloatArray | None = None  # (n, 3): Normals as they were given, where they have no side: not the cloud's
    strays: Strays | None = None  # What lay far from all other points

    def centred(self, points: FloatArray) -> FloatArray:
        """Points of the caller's frame in this one, (n, 3)."""
        return self.scale * points - self.origin

    def oriented_from(self, viewpoints: FloatArray) -> CentredSource:
        """The same with the signs of estimated normals from where the scanner stood, where that is one place."""
        if len(viewpoints) > 1 or self.cloud.normals is not None:
            return self
        place = self.centred(viewpoints)[0]
        return dataclasses.replace(self, cloud=dataclasses.replace(self.cloud, viewpoint=place))

    @property
    def without_viewpoint(self) -> CentredSource:
        """The same with no place of a scanner: the one that the source tells is not to be used."""
        return (
            self
            if self.cloud.viewpoint is None
            else dataclasses.replace(self, cloud=dataclasses.replace(self.cloud, viewpoint=None))
        )

    @property
    def viewpoint(self) -> FloatArray | None:
        """Where the scanner stood that the source itself tells, in the caller's frame, (3,)."""
        place = self.cloud.viewpoint
        return None if place is None else (place + self.origin) / self.scale

    def as_given(self) -> tuple[FloatArray, FloatArray | None]:
        """Points, or the vertices of a mesh, and normals as they were given, to the rounding of the coordinates."""
        if self.mesh is not None:
            return self.mesh.vertices, None
        normals = self.cloud.normals if self.unsided is None else self.unsided
        return (self.cloud.points + self.origin) / self.scale, normals


def centre_source(
    source: Any,
    source_units: str | None,
    target_units: str | None,
    seed: int | np.random.Generator,
    scale: float = 1.0,
) -> CentredSource:
    """Read a source, convert its unit, and move it to its own middle; of a mesh, a sample that the seed decides."""
    return read_source(source, seed).centred(source_units, target_units, scale)


class ReadSource(NamedTuple):
    """A source as it was read and checked, in its own frame and unit."""

    cloud: PointCloud
    mesh: Mesh | None  # That the points were drawn from
    strays: Strays | None

    def centred(self, source_units: str | None, target_units: str | None, scale: float = 1.0) -> CentredSource:
        """The same in the target's unit, moved to its own middle."""
        scale = scale * factor(source_units or self.cloud.units, target_units)
        origin = 0.5 * scale * np.add(*self.cloud._ends)
        cloud = self.cloud if self.mesh else without_signs(self.cloud)
        unsided = None if cloud is self.cloud else self.cloud.normals
        return CentredSource(cloud._moved(-origin, scale), origin, scale, self.mesh, unsided, self.strays)


def read_source(source: Any, seed: int | np.random.Generator) -> ReadSource:
    """A source from whatever `dqreg.register` takes."""
    geometry = as_geometry(source, "source")
    mesh = geometry if isinstance(geometry, Mesh) else None
    strays = None
    if isinstance(geometry, Mesh):
        geometry = sample_mesh(geometry, MESH_SAMPLES, np.random.default_rng(seed))
    else:
        geometry, strays = without_strays(geometry)
    require_spread(geometry.points, "source")
    return ReadSource(geometry, mesh, strays)


def require_one_place(viewpoints: FloatArray, geometry: PointCloud | Mesh) -> None:
    """Raise where several viewpoints are given between two clouds: which points were seen from which is not known."""
    if len(viewpoints) > 1 and not isinstance(geometry, Mesh):
        raise InputError(
            f"several viewpoints hide faces of a mesh, and this target is a cloud, which takes one: got "
            f"{len(viewpoints)}; give the place of one scanner, or leave viewpoint out"
        )


def require_spread(points: FloatArray, name: str) -> None:
    """Raise unless the points are as many as a pose needs, and not on one line."""
    if len(points) < MIN_CORRESPONDENCES:
        many = "" if len(points) == 1 else "s"
        raise InputError(
            f"{name} has {len(points)} usable point{many}; at least six are needed, one for each degree of freedom of "
            "a pose. Give more; points that are matched already go to dqreg.solve"
        )
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
    if MIN_CORRESPONDENCES <= len(body) < len(points):
        with contextlib.suppress(DegenerateGeometryError):
            require_spread(body, "points")
            strays = int(np.count_nonzero(away > 1e3 * np.quantile(away, BODY)))
            many = "" if strays == 1 else "s"
            return f"Remove the {strays} stray{many} up to {away.max():.3g} from the middle: the others span an area"
    return "Give points that span an area"

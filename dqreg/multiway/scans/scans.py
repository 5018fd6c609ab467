"""The scans, each read, centred and indexed once, whatever the number of pairs that it takes part in."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_float, bounds
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.files.untrusted import require_readable
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, prepare_scan, sample_mesh
from dqreg.geometry.opening import as_geometry
from dqreg.multiway.scans.kept_pairs import digest_of
from dqreg.registration.problem.source import MESH_SAMPLES
from dqreg.registration.problem.strays import Strays, without_strays
from dqreg.registration.problem.target_index import index_target
from dqreg.registration.target import Target
from dqreg.trust.free_space import MAX_HIDDEN_SHARE, hidden_share
from dqreg.trust.records import Reason

# Scans that are compared at least.
MIN_SCANS = 2
# Scans of a faulty call that the message names.
NAMED_SCANS = 3


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """One scan, in its own frame and centred; or why it cannot be used."""

    name: str  # Name of its file without the suffix, or its number
    cloud: PointCloud | None = None  # As it was given, without strays beyond all doubt, in its own frame
    target: Target | None = None  # The same, centred and indexed
    problem: str = ""  # Why it cannot be used; "" where it can
    copy_of: int | None = None  # Number of an earlier scan with the same points
    hidden: float = 0.0  # Share of its points that the viewpoint it came with cannot have seen; it is not used then
    signed: Scan | None = None  # As `scan`, where other scans told from which side it was taken
    strays: Strays | None = None  # What lay far from all its other points

    @property
    def usable(self) -> bool:
        """Whether it takes part."""
        return not self.problem and self.copy_of is None

    @property
    def surface(self) -> CloudSurface:
        """Its points as a surface, in the centred frame."""
        assert self.target is not None
        surface = self.target.indexed.surface
        assert isinstance(surface, CloudSurface)
        return surface

    @property
    def origin(self) -> FloatArray:
        """Origin of the centred frame, (3,)."""
        assert self.target is not None
        return self.target.indexed.origin

    @cached_property
    def scan(self) -> Scan:
        """Its points in Morton order with normals, spacing and noise, in the centred frame."""
        if self.signed is not None:
            return self.signed
        assert self.target is not None
        geometry = self.target.indexed.geometry
        assert isinstance(geometry, PointCloud)
        return prepare_scan(geometry)

    @cached_property
    def digest(self) -> str:
        """Tells its points from all others."""
        assert self.cloud is not None
        return hashlib.sha256(np.ascontiguousarray(self.cloud.points).tobytes()).hexdigest()

    @cached_property
    def whole_digest(self) -> str:
        """Tells all that its registrations depend on from that of others."""
        assert self.cloud is not None
        return digest_of(self.cloud)


def read_views(scans: Sequence[Any] | Mapping[str, Any], seed: int, viewpoints: Any = None) -> tuple[View, ...]:
    """Read all scans, by their names in a mapping; what cannot be used is left out, unless fewer than two remain.

    Viewpoints are "origin", one place for all or one a scan, each in the scan's own frame; None where it is not known.
    """
    names = [str(name) for name in scans] if isinstance(scans, Mapping) else None
    scans = list(scans.values()) if isinstance(scans, Mapping) else scans
    shape, kind = getattr(scans, "shape", ()), getattr(getattr(scans, "dtype", None), "kind", "")
    if kind in tuple("fiu") and len(shape) < 3:
        raise InputError(f"scans must be a list of paths, arrays or clouds; got one array of shape {shape}")
    if isinstance(scans, (str, os.PathLike)) or not (hasattr(scans, "__len__") and hasattr(scans, "__getitem__")):
        raise InputError(f"scans must be a list of paths, arrays or clouds; got {type(scans).__name__}")
    if len(scans) < MIN_SCANS:
        raise InputError(f"multiway registration needs two scans at least; got {len(scans)}")
    places = _places(viewpoints, len(scans))
    views: list[View] = []
    known: dict[str, int] = {}
    for number, read in enumerate(_seen([_read(given, k, seed, places[k]) for k, given in enumerate(scans)])):
        view = _indexed(read if names is None else dataclasses.replace(read, name=names[number]))
        if not view.problem:
            first = known.setdefault(view.digest, number)
            view = view if first == number else dataclasses.replace(view, copy_of=first, target=None)
        views.append(view)
    _require_some(views)
    return tuple(views)


def _places(viewpoints: Any, count: int) -> list[FloatArray | None]:
    if viewpoints is None:
        return [None] * count
    if isinstance(viewpoints, str):
        if viewpoints != "origin":
            raise InputError(
                f'viewpoints must be "origin", one place (3,) or one a scan (n, 3); got {viewpoints!r:.60}'
            )
        viewpoints = np.zeros(3)
    rows = list(viewpoints) if isinstance(viewpoints, (list, tuple)) else viewpoints
    known = [place is not None for place in rows] if isinstance(rows, list) and len(rows) == count else [True] * count
    if not all(known):
        rows = [np.zeros(3) if place is None else place for place in rows]
    places = as_float(rows, "viewpoints")
    if places.shape not in ((3,), (count, 3)) or not np.isfinite(places).all():
        raise InputError(
            f'viewpoints must be "origin", one finite place (3,) or one a scan, ({count}, 3), None where it is not '
            f"known, in the frame of the scan; got shape {places.shape}"
        )
    return [place if there else None for place, there in zip(np.broadcast_to(places, (count, 3)), known, strict=True)]


def _read(given: Any, number: int, seed: int, place: FloatArray | None) -> View:
    name = f"scan {number}"
    if isinstance(given, (str, os.PathLike)):
        # A name that is not there is a mistake of the call; a file without anything in it is one of the scan.
        if not Path(given).is_file():
            require_readable(Path(given))
        name = Path(given).stem
    try:
        geometry = as_geometry(given, f"scans[{number}]")
        if isinstance(geometry, Mesh):
            geometry = sample_mesh(geometry, MESH_SAMPLES, np.random.default_rng([seed, number]))
        if place is not None:
            geometry = dataclasses.replace(geometry, viewpoint=place)
        geometry, strays = without_strays(geometry)
        return View(name, geometry, hidden=_hidden_share(geometry), strays=strays)
    except (InputError, DegenerateGeometryError) as error:
        return View(name, problem=str(error))


def _indexed(view: View) -> View:
    if view.cloud is None:
        return view
    try:
        return dataclasses.replace(view, target=Target(index_target(view.cloud).build()))
    except (InputError, DegenerateGeometryError) as error:
        return View(view.name, problem=str(error))


def _seen(views: Sequence[View]) -> list[View]:
    """The scans without the viewpoints that cannot have seen them; where most are wrong, all were given wrongly."""
    given = [view for view in views if view.cloud is not None and view.cloud.viewpoint is not None]
    none_seen = 2 * sum(view.hidden > MAX_HIDDEN_SHARE for view in given) > len(given)
    return [
        dataclasses.replace(view, cloud=dataclasses.replace(view.cloud, viewpoint=None))
        if view.cloud is not None and (none_seen or view.hidden > MAX_HIDDEN_SHARE)
        else dataclasses.replace(view, hidden=0.0)
        for view in views
    ]


def every_so_many(rows: FloatArray, count: int) -> FloatArray:
    """Rows as far from each other as leaves so many of them, or less than twice as many."""
    some: FloatArray = rows[:: max(1, len(rows) // count)]
    return some


def _hidden_share(cloud: PointCloud) -> float:
    """Share of the points of a scan that stand behind others, seen from its viewpoint; 0 where it has none."""
    return 0.0 if cloud.viewpoint is None else hidden_share(cloud.points, cloud.viewpoint)


def _require_some(views: Sequence[View]) -> None:
    usable = [view for view in views if view.usable]
    if len(usable) < MIN_SCANS:
        bad = [view for view in views if not view.usable]
        why = "; ".join(
            f"{view.name}: {view.problem or f'a copy of {views[view.copy_of or 0].name}'}" for view in bad[:NAMED_SCANS]
        )
        more = f"; and {len(bad) - NAMED_SCANS} more" if len(bad) > NAMED_SCANS else ""
        raise InputError(f"multiway registration needs two usable scans at least; {why}{more}")
    units = {view.cloud.units: view.name for view in usable if view.cloud is not None and view.cloud.units}
    if len(units) > 1:
        listed = ", ".join(f"{name} in {unit}" for unit, name in units.items())
        raise InputError(f"all scans must have one length unit; got {listed}. Convert them first")


def unit_of(views: Sequence[View]) -> str | None:
    """The length unit of the scans, where one of them names it."""
    return next((view.cloud.units for view in views if view.usable and view.cloud and view.cloud.units), None)


def typical_size(views: Sequence[View]) -> float:
    """Median diagonal of the usable scans."""
    return float(np.median([size_of(view) for view in views if view.usable]))


def size_of(view: View) -> float:
    """Diagonal of a scan."""
    assert view.cloud is not None
    return float(np.linalg.norm(np.subtract(*bounds(view.cloud.points))))


def typical_spacing(views: Sequence[View]) -> float:
    """Median spacing of the usable scans."""
    return float(np.median([view.scan.spacing for view in views if view.usable]))


def stray_remarks(views: Sequence[View]) -> list[Reason]:
    """What lay far from all other points of each scan."""
    return [view.strays.remark(view.name) for view in views if view.strays is not None]

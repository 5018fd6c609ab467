"""What a worker process remembers between two tasks of a visit, so that a step does not repeat the one before it."""

from __future__ import annotations

import dataclasses
import json
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.strict_json import plain
from dqreg.files.units import factor
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.opening import as_geometry
from dqreg.studio.visit import Side, Visit

Value = TypeVar("Value")
# Values remembered; the oldest goes first.
MAX_VALUES = 12
MIRROR = np.array([-1.0, 1.0, 1.0])
_VALUES: OrderedDict[str, Any] = OrderedDict()


def cached(name: str, key: Any, make: Callable[[], Value]) -> Value:
    """The value of a key, made where it is not known; one that was made of anything else is forgotten in time."""
    word = _word(name, key)
    if word not in _VALUES:
        remember(name, key, make())
    _VALUES.move_to_end(word)
    found: Value = _VALUES[word]
    return found


def remember(name: str, key: Any, value: Any) -> None:
    """Have a value at hand for `cached`."""
    while len(_VALUES) >= MAX_VALUES:
        _VALUES.popitem(last=False)
    _VALUES[_word(name, key)] = value


def forget() -> None:
    """Nothing is at hand any more: all is made again."""
    _VALUES.clear()


def _word(name: str, key: Any) -> str:
    return f"{name} {json.dumps(plain(key), sort_keys=True, default=str)}"


@dataclasses.dataclass(frozen=True)
class Place:
    """A visit and the folder that its files are in."""

    folder: Path
    visit: Visit

    def path(self, side: Side | None, name: str) -> Path:
        """Where the file of a side lies."""
        if side is None:
            raise InputError(f"there is no {name} yet: drop its file on the page")
        return self.folder / side.path

    @property
    def scan_path(self) -> Path:
        """The file of the scan, as it was given."""
        return self.path(self.visit.scan, "scan")

    @property
    def part_path(self) -> Path:
        """The file of the part."""
        return self.path(self.visit.part, "part")

    @property
    def scan_key(self) -> list[Any]:
        """What tells the points of the scan from those of another one."""
        return [str(self.scan_path), self.visit.mirrored]

    def scan(self) -> PointCloud | Mesh:
        """The scan: as it was given, or its mirror image."""
        path = self.scan_path
        given = cached("geometry", _mark(path), lambda: as_geometry(path, "scan"))
        return cached("mirrored", _mark(path), lambda: mirrored(given)) if self.visit.mirrored else given

    def part(self) -> PointCloud | Mesh:
        """The part, as it was given."""
        path = self.part_path
        return cached("geometry", _mark(path), lambda: as_geometry(path, "part"))

    def units(self) -> tuple[str | None, str | None]:
        """Units of scan and part: what was named, else what the files say; None where neither does."""
        visit = self.visit
        scan = visit.scan.units if visit.scan and visit.scan.units else self.scan().units
        part = visit.part.units if visit.part and visit.part.units else self.part().units
        return scan, part

    def scale(self) -> float:
        """What lengths of the scan are multiplied with to be in the unit of the part."""
        return factor(*self.units())

    def write(self, name: str, content: bytes | str) -> Path:
        """A file of the visit."""
        write_atomically(self.folder / name, content)
        return self.folder / name


def mirrored(given: PointCloud | Mesh) -> PointCloud | Mesh:
    """The mirror image of a scan, seen from the mirror image of where it was seen from."""
    if isinstance(given, Mesh):
        return Mesh(given.vertices * MIRROR, given.faces[:, ::-1], units=given.units)
    normals = None if given.normals is None else given.normals * MIRROR
    viewpoint = None if given.viewpoint is None else given.viewpoint * MIRROR
    return dataclasses.replace(given, points=given.points * MIRROR, normals=normals, viewpoint=viewpoint)


def _mark(path: Path) -> list[Any]:
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(f"cannot read {path.name}: {error.strerror or error}; drop the file again") from error
    return [str(path), found.st_size, found.st_mtime_ns]

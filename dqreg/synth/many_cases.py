"""Cases of many scans from a recipe to a folder: a part on a turntable, stops in a room, or a drive along a street."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._numbers import is_number, is_whole
from dqreg.errors import InputError
from dqreg.files.strict_json import plain
from dqreg.files.units import METRES
from dqreg.files.untrusted import read_record
from dqreg.files.write import ply_bytes
from dqreg.synth.case_contents import PART, RECIPE, TRUTH, json_text, stl_bytes
from dqreg.synth.cases import require_replaceable, write_folder
from dqreg.synth.many_views import MAX_DRIVE_M, ManyViews, room_stops, street_drive, turntable_views
from dqreg.synth.recipe_keys import build, check_name, check_seed, get_table, get_text, require_known
from dqreg.synth.recipe_tables import check_part, make_mesh

SCANS, POSES = "scans", "poses.txt"
# Tables that say what is scanned: a recipe has one of them.
KINDS = ("turntable", "room", "street")
TOP = ("name", "seed", "units", "part", *KINDS)


@dataclass(frozen=True)
class Turntable:
    """Table ``[turntable]``: equal steps all the way round; noise in diagonals of the part."""

    views: int = 24
    pixels: int = 150
    elevation_deg: float = 35.0
    noise: float = 1e-4

    def __post_init__(self) -> None:
        _require_between(self, views=(2, 720), pixels=(10, 2000), elevation_deg=(-89.0, 89.0), noise=(0.0, 0.1))


@dataclass(frozen=True)
class Room:
    """Table ``[room]``: stops of a LiDAR on a round; noise along the rays, a length."""

    stops: int = 8
    rings: int = 48
    noise: float = 0.005

    def __post_init__(self) -> None:
        _require_between(self, stops=(2, 500), rings=(4, 500), noise=(0.0, 1.0))


@dataclass(frozen=True)
class Street:
    """Table ``[street]``: frames of a car's LiDAR; the way between two frames and the noise along the rays, lengths."""

    frames: int = 40
    step: float = 0.8
    noise: float = 0.02
    rings: int = 64

    def __post_init__(self) -> None:
        _require_between(self, frames=(2, 500), step=(0.0, 5.0), noise=(0.0, 1.0), rings=(4, 500))
        if self.frames * self.step > MAX_DRIVE_M:
            raise InputError.of(
                f"x step is the way along the street, at most {MAX_DRIVE_M:g}; got {self.frames * self.step:g}",
                name="frames",
            )


def is_of_many(path: str | os.PathLike[str]) -> bool:
    """Whether a recipe describes many scans; what cannot be read is left to the reader of single scans."""
    try:
        data = tomllib.loads(read_record(Path(path), "a recipe (TOML)"))
    except (InputError, tomllib.TOMLDecodeError):
        return False
    return any(kind in data for kind in KINDS)


def write_many(folder: str | os.PathLike[str], recipe: str | os.PathLike[str], *, seed: int | None = None) -> Path:
    """Make the folder of a recipe of many scans, whole or not at all: scans, truth, the recipe, and the part if any."""
    folder, text = Path(folder).resolve(), read_record(Path(recipe), "a recipe (TOML)")
    contents = many_contents(text, Path(recipe).parent, seed)
    require_replaceable(folder, (SCANS, POSES, PART, TRUTH, RECIPE))
    write_folder(folder, contents)
    return folder


def many_contents(text: str, folder: Path, seed: int | None = None) -> dict[str, bytes]:
    """Bytes of the files of a recipe's text; a part's file is looked up from the folder."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"the recipe is not TOML: {error}") from error
    require_known(data, TOP, "")
    if sum(kind in data for kind in KINDS) != 1:
        raise InputError("recipe: give one of the tables [turntable], [room] and [street]")
    seed = check_seed(data.get("seed")) if seed is None else check_seed(seed)
    units = get_text(data, "units", "mm", METRES)
    made, files = _made(data, folder, np.random.default_rng(seed))
    digits = max(len(str(len(made.scans) - 1)), 2)
    names = [f"{SCANS}/view{k:0{digits}d}.ply" for k in range(len(made.scans))]
    truth = {
        "T_world_scan": plain(made.T_world_scan),
        "viewpoints": plain(made.viewpoints),
        "scans": names,
        "units": units,
        "points": [len(scan) for scan in made.scans],
        "seed": seed,
        "name": check_name(data.get("name", "many")),
        "recipe": RECIPE,
    }
    for name, scan in zip(names, made.scans, strict=True):
        files[name] = ply_bytes({axis: (column, "f4") for axis, column in zip("xyz", scan.T, strict=True)})
    return {**files, TRUTH: json_text(truth).encode(), RECIPE: text.encode()}


def _made(data: Mapping[str, Any], folder: Path, rng: np.random.Generator) -> tuple[ManyViews, dict[str, bytes]]:
    if "turntable" not in data and "part" in data:
        raise InputError("recipe: [part] means nothing for a room or a street; take it out")
    if "room" in data:
        room: Room = build(Room, "room", get_table(data, "room", None))
        return room_stops(room.stops, noise=room.noise, rings=room.rings, rng=rng), {}
    if "street" in data:
        way: Street = build(Street, "street", get_table(data, "street", None))
        drive = street_drive(way.frames, step=way.step, noise=way.noise, rings=way.rings, rng=rng)
        # As KITTI has them, which every program that compares trajectories reads.
        rows = [" ".join(map(repr, T[:3].ravel().tolist())) for T in drive.T_world_scan]
        return drive, {POSES: ("\n".join(rows) + "\n").encode()}
    table: Turntable = build(Turntable, "turntable", get_table(data, "turntable", None))
    part = make_mesh(check_part(get_table(data, "part", None)), folder)
    made = turntable_views(
        part, table.views, pixels=table.pixels, noise=table.noise, elevation_deg=table.elevation_deg, rng=rng
    )
    return made, {PART: stl_bytes(*part)}


def _require_between(table: object, **limits: tuple[float, float]) -> None:
    for name, (low, high) in limits.items():
        value = getattr(table, name)
        is_kind, kind = (is_whole, "a whole number") if isinstance(low, int) else (is_number, "a number")
        if not is_kind(value) or not low <= value <= high:
            raise InputError.of(f"must be {kind} from {low} to {high}", name=name, given=value)

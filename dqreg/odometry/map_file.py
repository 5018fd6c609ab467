"""The map of an odometry in a file: an NPZ archive with a JSON header, no pickle."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.numpy_files import numbers, read_arrays
from dqreg.files.strict_json import plain
from dqreg.files.untrusted import require_readable
from dqreg.odometry.settings import OdometrySettings, Resolved

# Since version 2 the lengths hold the noise of the first frame, since 3 the settings the search in the map.
FORMAT, VERSION = "dqreg map", 3


@dataclasses.dataclass(frozen=True)
class SavedMap:
    """What a file holds."""

    points: FloatArray  # (n, 3): Map frame
    T_map_frame: FloatArray  # (4, 4): Last trusted pose
    settings: OdometrySettings
    lengths: Resolved


def save_map(path: str | Path, saved: SavedMap) -> None:
    """Write a map, whole or not at all."""
    header = {
        "format": FORMAT,
        "version": VERSION,
        "settings": dataclasses.asdict(saved.settings),
        "lengths": dataclasses.asdict(saved.lengths),
    }
    text = np.frombuffer(json.dumps(plain(header)).encode(), dtype=np.uint8)
    stream = io.BytesIO()
    np.savez(stream, header=text, points=saved.points, T_map_frame=saved.T_map_frame)
    write_atomically(Path(path), stream.getvalue())


def load_map(path: str | Path) -> SavedMap:
    """Read what `save_map` wrote."""
    place = require_readable(path, "a map that Odometry.save wrote")
    arrays = read_arrays(place, ("header", "points", "T_map_frame"))
    try:
        header: dict[str, Any] = json.loads(arrays["header"].tobytes())
        if header["format"] != FORMAT:
            raise ValueError(f"it is {header['format']!r:.60}")
        if (version := header["version"]) not in range(1, VERSION + 1):
            raise ValueError(
                f"it is a map of version {version!r:.20}, and versions 1 to {VERSION} are read; for a newer one update "
                "dqreg, or map the place again with this one"
            )
        settings, lengths = OdometrySettings(**header["settings"]), Resolved(**header["lengths"])
        usable = all(
            0.0 < float(getattr(lengths, name)) < np.inf for name in ("voxel_size", "max_range", "reach", "near")
        )
        if not usable or lengths.max_points_per_voxel < 1:
            raise ValueError("its lengths are none")
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} is no map that Odometry.save of this version wrote: {error}") from error
    points = numbers(place, arrays.get("points", np.zeros(0)), "points", (None, 3))
    T = numbers(place, arrays.get("T_map_frame", np.zeros(0)), "T_map_frame", (4, 4))
    if not len(points):
        raise InputError(f"{path} holds a map without points; save it after the first frame")
    if bad := int(np.count_nonzero(~np.isfinite(points).all(axis=1))):
        raise InputError(f"{path} holds a map of which {bad} of {len(points)} points are not finite; save it anew")
    return SavedMap(points, as_pose(T, f"{path}: T_map_frame"), settings, lengths)

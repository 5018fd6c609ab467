"""Names of the columns of points: positions, normals, times; in files and in the clouds of other libraries."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from dqreg.files.units import UNIT_WORDS
from dqreg.files.untrusted import unreadable

AXES = ("x", "y", "z")
# In lower case, as sensor_msgs, PCL, E57, CloudCompare and the drivers of LiDARs have them.
POSITION_NAMES = (AXES, ("cartesianx", "cartesiany", "cartesianz"))
NORMAL_NAMES = (
    ("normal_x", "normal_y", "normal_z"),
    ("nx", "ny", "nz"),
    ("nor:normalx", "nor:normaly", "nor:normalz"),
    ("normalx", "normaly", "normalz"),
)
# The time of each point.
TIME_NAMES = ("t", "time", "timestamp", "timestamps", "times", "stamps", "time_stamp", "offset_time", "gps_time")


def find_columns(path: Path, names: Sequence[str]) -> tuple[list[int], list[int] | None]:
    """Where x, y, z and, if there are any, the three normal components stand.

    >>> find_columns(Path("a.csv"), ["Intensity", "X", "Y", "Z"])
    ([1, 2, 3], None)
    """
    lower = [name.lower() for name in names]
    found = [
        next(([lower.index(name) for name in trio] for trio in trios if set(trio) <= set(lower)), None)
        for trios in (POSITION_NAMES, NORMAL_NAMES)
    ]
    if found[0] is None:
        raise unreadable(path, f"the columns {', '.join(names) or '(none)'}", "columns named x, y and z")
    return found[0], found[1]


def find_times(names: Sequence[str]) -> int | None:
    """Where the time of each point stands.

    >>> find_times(["x", "y", "z", "Time"])
    3
    """
    lower = [name.lower() for name in names]
    return next((lower.index(name) for name in TIME_NAMES if name in lower), None)


# As metrology programs and ParaView have them:
# "X [mm]", "X (mm)", "x_mm", "X coord", "Z-Position (m)", "nx", "Points:0", "Normals:2"; blanks are gone.
DECORATED = re.compile(
    r"(?P<kind>n|normal_?)?(?P<axis>[xyz])(?:[-_]?(?:coord(?:inate)?|pos(?:ition)?)s?)?"
    r"(?:[\[(](?P<inside>[a-zµμ]*)[\])]|_(?P<behind>[a-z]+))?"
    r"|(?P<field>points|normals)[:_](?P<number>[012])"
)


def plain_names(names: Sequence[str]) -> tuple[list[str], list[str | None]]:
    """The names that columns of coordinates go by elsewhere, and the length unit that each states.

    >>> plain_names(["X [mm]", "Quality", "Points:1"])
    (['x', 'Quality', 'y'], ['mm', None, None])
    """
    if set(AXES) <= {name.lower() for name in names}:
        return list(names), [None] * len(names)
    found = [_plain(name) for name in names]
    return [name for name, _ in found], [unit for _, unit in found]


def _plain(name: str) -> tuple[str, str | None]:
    match = DECORATED.fullmatch("".join(name.lower().split()))
    if match is None:
        return name, None
    if match["field"]:
        return ("n" if match["field"] == "normals" else "") + AXES[int(match["number"])], None
    word = match["inside"] or match["behind"]
    unit = None if word is None else UNIT_WORDS.get(word.replace("µ", "u").replace("μ", "u"))
    # "x_raw" is another column than x.
    if match["behind"] and unit is None:
        return name, None
    return ("n" if match["kind"] else "") + match["axis"], unit


def common_unit(path: Path, units: Sequence[str | None]) -> str | None:
    """The length unit that the columns of a position state; `InputError` where they differ."""
    stated = dict.fromkeys(unit for unit in units if unit is not None)
    if len(stated) > 1:
        raise unreadable(path, f"x, y and z in {' and '.join(stated)}", "one length unit for all three")
    return next(iter(stated), None)

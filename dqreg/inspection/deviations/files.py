"""Deviations as files: a coloured cloud, a table, an array; whole or not at all."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.files import write_cloud
from dqreg.files.atomic import write_atomically
from dqreg.files.csv_text import csv_text
from dqreg.inspection.membership.membership import FLAGS_IN_WORDS, ON_PART
from dqreg.inspection.tolerances import PointLimits

# Blue and vermilion are those of Okabe and Ito (2008); either branch only darkens from the middle, and beyond the
# limit follows a colour of its own. A reader who sees no red from green still sees blue from yellow, one a branch.
RGB_STOPS = ((0, 62, 110), (0, 114, 178), (134, 188, 222), (247, 247, 247), (246, 185, 122), (213, 94, 0), (140, 55, 0))
BELOW_RGB, ABOVE_RGB = (30, 10, 70), (75, 0, 20)
# What belongs to something else.
BEYOND_RGB = (128, 128, 128)

ByteArray = NDArray[np.uint8]


def colours_of(values: FloatArray, limit: float, reach: float = np.inf) -> ByteArray:
    """Colour of each deviation.

    Parameters
    ----------
    values : ndarray, (n,)
        Deviations; without signs they take the upper branch.
    limit : float
        Where the scale ends on both sides, > 0, a length.
    reach : float
        Deviations beyond are grey.

    Returns
    -------
    ndarray of uint8, (n, 3)
        Red, green, blue.

    Examples
    --------
    >>> colours_of(np.array([-1.0, 0.0, 1.0, 1.5, 9.0]), 1.0, reach=5.0).tolist()
    [[0, 62, 110], [247, 247, 247], [140, 55, 0], [75, 0, 20], [128, 128, 128]]
    """
    stops = np.array(RGB_STOPS, dtype=np.float64)
    at = np.linspace(-limit, limit, len(stops))
    colours = np.zeros((len(values), 3), dtype=np.uint8)
    for k in range(3):
        colours[:, k] = np.rint(np.interp(values, at, stops[:, k]))
    colours[values < -limit] = BELOW_RGB
    colours[values > limit] = ABOVE_RGB
    colours[np.abs(values) > reach] = BEYOND_RGB
    return colours


SUFFIXES = (".ply", ".csv", ".npy")
# flag: see `membership`; within: 1 in tolerance, 0 out of it.
LENGTHS = ("x", "y", "z", "deviation", "closest_x", "closest_y", "closest_z")
OTHERS = ("face", "row", "normal_x", "normal_y", "normal_z", "flag")
# Digits of lengths in a table: a step of that share of the scan's noise, which rounding widens by 2e-5, or of the
# target's size where that is more or no noise is known. And of unit normals.
OF_NOISE, OF_SIZE = 0.02, 1e-8
NORMAL_DIGITS = 4


def require_suffix(path: str | os.PathLike[str]) -> str:
    """Suffix of a file of deviations, in lower case.

    >>> require_suffix("DEV.PLY")
    '.ply'
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"cannot write {path}: deviations are written as {', '.join(SUFFIXES)}; got {suffix!r}")
    return suffix


def write_array(path: str | os.PathLike[str], values: FloatArray) -> None:
    """Write deviations as a NumPy file."""
    stream = io.BytesIO()
    np.save(stream, values)
    write_atomically(path, stream.getvalue())


def decimals_of(size: float, noise: float | None) -> int:
    """Decimals of lengths in a table.

    >>> decimals_of(200.0, None), decimals_of(200.0, 0.03), decimals_of(0.2, 3e-5)
    (6, 4, 7)
    """
    step = max(OF_SIZE * size, OF_NOISE * (noise or 0.0))
    return max(0, math.ceil(-math.log10(step))) if step > 0.0 else 9


def write_table(
    path: str | os.PathLike[str],
    lengths: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    flags: NDArray[np.int8],
    within: NDArray[np.bool_] | None,
    *,
    decimals: int,
    units: str | None,
) -> None:
    """Write deviations as a CSV file, one row a point. Shapes: lengths (n, 7): point, deviation, closest place."""
    columns: list[NDArray[Any]] = [lengths, faces, np.arange(len(faces)), normals, flags]
    formats = [f"%.{decimals}f"] * 7 + ["%d"] * 2 + [f"%.{NORMAL_DIGITS}f"] * 3 + ["%d"]
    names = [*(f"{name} [{units}]" if units else name for name in LENGTHS), *OTHERS]
    if within is not None:
        columns, formats, names = [*columns, within], [*formats, "%d"], [*names, "within"]
    stream = io.StringIO()
    stream.write(",".join(names) + "\n")
    np.savetxt(stream, np.column_stack(columns), fmt=formats, delimiter=",")
    write_atomically(path, stream.getvalue())


SECTION = ("section", "curve", "arc", "x", "y", "z", "normal_x", "normal_y", "normal_z", "deviation", "sigma", "points")


def write_sections(
    path: str | os.PathLike[str], sections: Iterable[tuple[str, FloatArray]], *, decimals: int, units: str | None
) -> None:
    """Write deviations along sections as a CSV file, one row a place: a name, and columns as in `SECTION` after it.

    A place without scan points has no deviation.
    """
    lengths = ("arc", "x", "y", "z", "deviation", "sigma")
    head = [f"{name} [{units}]" if units and name in lengths else name for name in SECTION]
    length = f"%.{decimals}f"
    formats = ["%d", *[length] * 4, *[f"%.{NORMAL_DIGITS}f"] * 3, length, length, "%d"]
    table = (
        [name, *("" if math.isnan(x) else f % (x + 0.0) for x, f in zip(row, formats, strict=True))]
        for name, rows in sections
        for row in rows.tolist()
    )
    write_atomically(path, csv_text(head, table))


def write_coloured(
    path: str | os.PathLike[str],
    points: FloatArray,
    values: FloatArray,
    *,
    limit: float,
    reach: float,
    flags: NDArray[np.int8],
    reason: str,
    signed: bool,
    units: str | None,
    allowed: PointLimits | None = None,
) -> None:
    """Write deviations as a PLY cloud whose colours end at the limit, or where a point is out of its own tolerance."""
    unit = units or "target units"
    low = f"blue {-limit:.6g}, white 0, " if signed else "white 0, "
    comments = [f"deviation in {unit}: {reason}", f"colours: {low}orange {limit:.6g} {unit}; darker beyond"]
    if np.isfinite(reach):
        comments.append(f"grey: farther than {reach:.6g} {unit}, taken for something else")
    if units:
        comments.append(f"units {units}")
    comments.append(f"flag: {FLAGS_IN_WORDS}; {ON_PART} is coloured")
    colours = colours_of(values, limit)
    if allowed is not None:
        colours[values < allowed.low], colours[values > allowed.high] = BELOW_RGB, ABOVE_RGB
        comments.append("dark also: out of the tolerance of its own face")
    colours[flags != ON_PART] = BEYOND_RGB
    write_cloud(path, points, colors=colours, fields={"deviation": values, "flag": flags}, comments=comments)

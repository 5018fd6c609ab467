"""Which named columns of a table, a PLY or a PCD file are coordinates and which are normals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.files.opening import unreadable

POSITION_NAMES = ("x", "y", "z")
NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"))


def find_columns(path: Path, names: Sequence[str]) -> tuple[list[int], list[int] | None]:
    """Where x, y, z and, if there are any, the three normal components stand.

    >>> find_columns(Path("a.csv"), ["Intensity", "X", "Y", "Z"])
    ([1, 2, 3], None)
    """
    lower = [name.lower() for name in names]
    if not set(POSITION_NAMES) <= set(lower):
        raise unreadable(path, f"the columns {', '.join(names) or '(none)'}", "columns named x, y and z")
    positions = [lower.index(name) for name in POSITION_NAMES]
    for trio in NORMAL_NAMES:
        if set(trio) <= set(lower):
            return positions, [lower.index(name) for name in trio]
    return positions, None


def stack_columns(columns: Sequence[FloatArray], wanted: Sequence[int]) -> FloatArray:
    """Some columns side by side, in float64.

    Shapes: returns (n, number wanted).

    >>> stack_columns([np.array([1, 2]), np.array([3, 4])], [1, 0]).tolist()
    [[3.0, 1.0], [4.0, 2.0]]
    """
    # The cast of a signalling NaN warns; as any NaN it is dropped and counted later.
    with np.errstate(invalid="ignore"):
        return np.stack([columns[k].astype(np.float64) for k in wanted], axis=1)
